//! Scenes as others write them: what is rare in the documentation of a format, and common in its files.

use std::io::Write;

use fanal::geometry::Ray;
use fanal::scene::Scene;
use fanal::scene::file::{Distribution, GeometryFile, LightFile, MaterialFile, TextureFile, identity3};
use fanal::scene::readers::{LoadedScene, load, save};
use glam::Vec3;

use crate::support::files::{folder, load_xml, xml_with};

fn loaded(body: &str) -> LoadedScene {
    load_xml(&folder(), &xml_with(body)).unwrap_or_else(|error| panic!("{body}: {error}"))
}

fn warned(loaded: &LoadedScene, words: &str) -> bool {
    loaded.warnings.iter().any(|warning| warning.contains(words))
}

/// A sphere that is scaled unevenly becomes an ellipsoid whose front is outside, at the places that its equation says, with the texture
/// coordinates of a sphere; one that is not stays a sphere.
#[test]
fn ellipsoids() {
    let body = "<shape type='sphere'><point name='center' x='1' y='0' z='0'/><float name='radius' value='2'/>\
        <transform name='to_world'><scale x='3' y='1' z='0.5'/></transform></shape>\
        <shape type='sphere'><transform name='to_world'><scale value='-3'/></transform></shape>";
    let loaded = loaded(body);
    assert!(warned(&loaded, "scaled unevenly") && loaded.warnings.len() == 1, "{:?}", loaded.warnings);
    let [shape, sphere] = &loaded.file.shapes[..] else { panic!("two shapes") };
    assert!(matches!(sphere.geometry, GeometryFile::Sphere { .. }) && sphere.flip_normals);
    let GeometryFile::Mesh { mesh } = &shape.geometry else { panic!("{:?}", shape.geometry) };
    assert!(!shape.flip_normals && shape.to_world[0] == 3.0 && shape.to_world[10] == 0.5);
    let mesh = &loaded.meshes[mesh];
    let center = Vec3::X;
    for (position, (normal, uv)) in mesh.positions.iter().zip(mesh.normals.iter().zip(&mesh.uvs)) {
        let out = (*position - center) / 2.0;
        assert!((out.length() - 1.0).abs() < 1e-6 && out.distance(*normal) < 1e-6, "{position} {normal}");
        assert!((uv.y - out.z.clamp(-1.0, 1.0).acos() / std::f32::consts::PI).abs() < 1e-3, "{uv} at {out}");
    }
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|i| mesh.positions[i as usize]);
        assert!((b - a).cross(c - a).dot((a + b + c) / 3.0 - center) > 0.0);
    }
}

/// What is mixed loses its holes and bumps, of which a warning tells, and stays two-sided.
#[test]
fn blends_of_what_has_bumps_and_holes() {
    let diffuse = "<bsdf type='diffuse'><rgb name='reflectance' value='0.25'/></bsdf>";
    let bumped = format!(
        "<bsdf type='twosided'><bsdf type='bumpmap'><texture type='bitmap'><string name='filename' value='grey.png'/>\
        </texture>{diffuse}</bsdf></bsdf>"
    );
    let masked = format!("<bsdf type='mask'><float name='opacity' value='0.5'/>{bumped}</bsdf>");
    for (kind, weight) in [
        ("blendbsdf", "<float name='weight' value='0.5'/>"),
        ("mixturebsdf", "<string name='weights' value='0.5, 0.5'/>"),
    ] {
        let loaded = loaded(&format!("<bsdf type='{kind}' id='m'>{weight}{bumped}{masked}</bsdf>"));
        let MaterialFile::Blend { materials, .. } = &loaded.file.materials["m"] else { panic!("a blend") };
        for part in materials.iter() {
            let MaterialFile::TwoSided { material } = part else { panic!("{part:?}") };
            assert_eq!(**material, MaterialFile::Diffuse { reflectance: TextureFile::rgb([0.25; 3]) });
        }
        assert!(warned(&loaded, "bumps of what is mixed") && warned(&loaded, "holes of what is mixed"));
    }
}

/// Metals by every name that Mitsuba's files of them have, and lamps of daylight with a colour.
#[test]
fn names_and_colours() {
    let metal = |name: &str| {
        let body = format!("<bsdf type='conductor' id='m'><string name='material' value='{name}'/></bsdf>");
        match &loaded(&body).file.materials["m"] {
            MaterialFile::Conductor { eta, k, .. } => (*eta, *k),
            other => panic!("{other:?}"),
        }
    };
    for (name, same) in [("Cu_palik", "Cu"), ("K_palik", "K"), ("Na", "Na_palik"), ("Se-e", "Se"), ("Ni", "Ni_palik")] {
        assert_eq!(metal(name), metal(same), "{name}");
    }
    assert_ne!(metal("Cu"), metal("Cu2O"));
    let body = "<emitter type='point'><spectrum name='intensity' type='d65'><rgb name='color' value='3 1 0.5'/>\
        <float name='scale' value='2'/></spectrum></emitter>";
    let LightFile::Point { intensity, .. } = &loaded(body).file.lights[0] else { panic!("a point") };
    assert_eq!(*intensity, [6.0, 2.0, 1.0]);
}

/// Light that only goes through, and comes from both sides alike.
#[test]
fn diffuse_transmitters() {
    let body = "<bsdf type='difftrans' id='m'><rgb name='transmittance' value='0.1 0.2 0.3'/></bsdf>";
    let [reflectance, transmittance] = [[0.0; 3], [0.1, 0.2, 0.3]].map(TextureFile::rgb);
    assert_eq!(loaded(body).file.materials["m"], MaterialFile::Translucent { reflectance, transmittance });
}

/// The depth of integrators that are kept beside the folders of scenes is in the scene.
#[test]
fn depth_of_an_integrator_that_is_elsewhere() {
    let body = "<default name='maxDepth' value='6'/><default name='integrator' value='path'/>";
    let depth = |file: &str| {
        let loaded = loaded(&format!("{body}<include filename='{file}'/>"));
        assert!(warned(&loaded, "the include is left out"));
        loaded.file.render.max_depth
    };
    assert_eq!(depth("../_integrators/$integrator.xml"), 6);
    assert_eq!(depth("../lights/$integrator.xml"), 20);
}

/// An environment of the format that pbrt's files have most, in both of its byte orders.
#[test]
fn pfm_environments() {
    let folder = folder();
    for (name, order) in [("little.pfm", "-1.0"), ("big.pfm", "1.0")] {
        let mut file = std::fs::File::create(folder.path().join(name)).unwrap();
        write!(file, "PF\n4 3\n{order}\n").unwrap();
        for i in 0..36u8 {
            let number = f32::from(i);
            file.write_all(&if order == "1.0" { number.to_be_bytes() } else { number.to_le_bytes() }).unwrap();
        }
        let body = format!("<emitter type='envmap'><string name='filename' value='{name}'/></emitter>");
        let loaded = load_xml(&folder, &xml_with(&body)).unwrap_or_else(|error| panic!("{error}"));
        let image = loaded.images.values().next().expect("a picture").to_image();
        assert_eq!([image.width, image.height], [4, 3]);
        assert_eq!((image.pixels[0], image.pixels[11]), (Vec3::new(24.0, 25.0, 26.0), Vec3::new(9.0, 10.0, 11.0)));
    }
}

/// Roughness that is not the same in all directions, in Mitsuba's words and in our own; plastic has one, and only facets may have a grain.
#[test]
fn roughness_with_a_grain() {
    let folder = folder();
    let axes = "<float name='alpha_u' value='0.4'/><float name='alpha_v' value='0.1'/>";
    for kind in ["roughconductor", "roughdielectric", "principled"] {
        let axes = if kind == "principled" { "<float name='anisotropic' value='0.8'/>" } else { axes };
        let loaded = load_xml(&folder, &xml_with(&format!("<bsdf type='{kind}' id='m'>{axes}</bsdf>"))).unwrap();
        assert!(loaded.warnings.iter().all(|warning| !warning.contains("anisotropic")), "{:?}", loaded.warnings);
        let MaterialFile::Anisotropic { aspect, rotation, material } = &loaded.file.materials["m"] else {
            panic!("{kind}")
        };
        let expected = if kind == "principled" { 0.28f32.sqrt().recip() } else { 2.0 };
        assert!((aspect - expected).abs() < 1e-6 && *rotation == 0.0, "{aspect}");
        if let MaterialFile::RoughConductor { alpha, .. } | MaterialFile::RoughDielectric { alpha, .. } = **material {
            assert!((alpha - 0.2).abs() < 1e-6, "{alpha}");
        }
        let copy = folder.path().join("copy.json");
        save(&loaded.file, &copy).unwrap();
        assert_eq!(load(&copy).unwrap().file, loaded.file);
    }
    let loaded = load_xml(&folder, &xml_with(&format!("<bsdf type='roughplastic' id='m'>{axes}</bsdf>"))).unwrap();
    assert!(loaded.warnings.iter().any(|warning| warning.contains("geometric mean")), "{:?}", loaded.warnings);
    let diffuse = || Box::new(MaterialFile::Diffuse { reflectance: TextureFile::rgb([0.5; 3]) });
    let glass = || {
        Box::new(MaterialFile::RoughDielectric {
            alpha: 0.1,
            distribution: Distribution::Ggx,
            int_ior: 1.5,
            ext_ior: 1.0,
        })
    };
    for (aspect, material, words) in
        [(2.0, diffuse(), "grain"), (0.0, glass(), "aspect"), (f32::NAN, glass(), "aspect")]
    {
        let mut file = loaded.file.clone();
        file.materials.insert("m".to_owned(), MaterialFile::Anisotropic { aspect, rotation: 0.0, material });
        let message = save(&file, &folder.path().join("wrong.json")).expect_err(words).to_string();
        assert!(message.contains("materials.m") && message.contains(words), "{message}");
    }
}

/// Grains go by ∂p/∂u, however a shape is placed and whatever its normals are: on a rectangle along its x axis, on a sphere along its parallels.
/// Other materials do not ask.
#[test]
fn grains_lie_along_u() {
    let metal = |axes: &str| format!("<bsdf type='roughconductor'>{axes}</bsdf>");
    let place =
        "<transform name='to_world'><rotate z='1' angle='30'/><rotate x='1' angle='20'/><translate z='5'/></transform>";
    let shapes = |axes: &str| {
        let metal = metal(axes);
        format!(
            "<shape type='rectangle'>{place}{metal}</shape>\
             <shape type='sphere'><point name='center' x='20'/>{metal}</shape>"
        )
    };
    let scene = |axes: &str| {
        Scene::build(&load_xml(&folder(), &xml_with(&shapes(axes))).unwrap_or_else(|error| panic!("{error}")), [4, 4])
            .unwrap()
    };
    let brushed = scene("<float name='alpha_u' value='0.4'/><float name='alpha_v' value='0.1'/>");
    let even = scene("<float name='alpha' value='0.2'/>");
    let turn = glam::Mat3::from_rotation_x(20f32.to_radians()) * glam::Mat3::from_rotation_z(30f32.to_radians());
    let aslant = Vec3::new(0.6, 0.0, 0.8);
    for (ray, along) in [
        (Ray { origin: Vec3::new(0.1, 0.2, 9.0), direction: Vec3::NEG_Z }, turn * Vec3::X),
        (Ray { origin: Vec3::X * 20.0 + 3.0 * aslant, direction: -aslant }, Vec3::Y),
    ] {
        let surface = brushed.intersect(&ray).expect("a shape");
        let found = surface.frame().to_world(Vec3::new(surface.angle.cos(), surface.angle.sin(), 0.0));
        assert!(found.distance(along) < 1e-4, "{found} {along}");
        assert_eq!(even.intersect(&ray).expect("a shape").angle, 0.0);
    }
}

/// Curves of both kinds are tubes where their points say, saved and loaded again; a file that is missing is one like any other.
#[test]
fn curves_are_tubes() {
    let folder = folder();
    std::fs::write(folder.path().join("hair.txt"), "0 0 0 .1\n1 0 0 .1\n2 0 0 .1\n3 0 0 .1\n\n0 9 0 1\n").unwrap();
    let shape = |kind: &str, file: &str| {
        let file = format!("<string name='filename' value='{file}'/>");
        load_xml(&folder, &xml_with(&format!("<shape type='{kind}'>{file}</shape>")))
    };
    for (kind, [least, most]) in [("linearcurve", [0.0, 3.0]), ("bsplinecurve", [1.0, 2.0])] {
        let loaded = shape(kind, "hair.txt").unwrap_or_else(|error| panic!("{error}"));
        assert!(loaded.warnings.iter().any(|warning| warning.contains("tubes")), "{:?}", loaded.warnings);
        let [low, high] = Scene::build(&loaded, [4, 4]).unwrap().accel.bounds();
        assert!((low.x - least).abs() < 1e-5 && (high.x - most).abs() < 1e-5, "{low} {high}");
        assert!((0.09..0.11).contains(&high.y) && low.y < -0.09, "{low} {high}");
        let copy = folder.path().join("copy.json");
        save(&loaded.file, &copy).unwrap();
        assert_eq!(load(&copy).unwrap().file, loaded.file);
    }
    assert!(shape("linearcurve", "none.txt").unwrap_err().to_string().contains("none.txt"));
    assert!(shape("linearcurve", "../hair.txt").unwrap_err().to_string().contains("tested.xml:3"));
}

/// Roughness from a texture, in Mitsuba's words and in our own; only facets may have one.
#[test]
fn roughness_that_varies() {
    let folder = folder();
    let board = "<texture name='alpha' type='checkerboard'><rgb name='color0' value='0.1'/><rgb name='color1' value='0.4'/></texture>";
    let texture = |value: f32| [value; 3];
    let map = TextureFile::Checkerboard { color0: texture(0.1), color1: texture(0.4), to_uv: identity3() };
    for kind in ["roughconductor", "roughdielectric", "roughplastic"] {
        let body = format!("<bsdf type='{kind}' id='m'>{board}</bsdf>");
        let loaded = load_xml(&folder, &xml_with(&body)).unwrap_or_else(|error| panic!("{error}"));
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        let MaterialFile::RoughnessMap { texture, material } = &loaded.file.materials["m"] else { panic!("{kind}") };
        assert_eq!(*texture, map);
        assert!(material.has_facets());
        let copy = folder.path().join("copy.json");
        save(&loaded.file, &copy).unwrap();
        assert_eq!(load(&copy).unwrap().file, loaded.file);
    }
    let body = "<bsdf type='roughdielectric' id='m'><rgb name='specular_reflectance' value='0.5'/>\
        <texture name='alpha' type='bitmap'><string name='filename' value='grey.png'/><boolean name='raw' value='true'/></texture></bsdf>";
    let loaded = load_xml(&folder, &xml_with(body)).unwrap_or_else(|error| panic!("{error}"));
    let MaterialFile::RoughnessMap { material, .. } = &loaded.file.materials["m"] else { panic!("a map") };
    assert!(matches!(**material, MaterialFile::Tinted { .. }));
    let mut file = loaded.file.clone();
    let material = Box::new(MaterialFile::Diffuse { reflectance: TextureFile::rgb([0.5; 3]) });
    file.materials.insert("m".to_owned(), MaterialFile::RoughnessMap { texture: map, material });
    let message = save(&file, &folder.path().join("wrong.json")).expect_err("no facets").to_string();
    assert!(message.contains("materials.m") && message.contains("varies"), "{message}");
}
