//! Scene readers: one scene in both formats, hostile input, and the shared scenes where they are at hand.

use crate::support::{files, scenes};

use std::path::Path;

use fanal::base::Error;
use fanal::generate::build::{Builder, diffuse};
use fanal::picture::{read_exr_channels, read_image};
use fanal::scene::Scene;
use fanal::scene::file::{
    Distribution, FilterFile, GeometryFile, LightFile, MaterialFile, MeshFile, SceneFile, TextureFile,
};
use fanal::scene::readers::{LoadedScene, Missing, load, load_lacking, resolve, save};
use glam::{Mat4, Vec3};

use files::{JSON, MATERIALS, XML, folder, load_xml, refused, scene_with, xml_with};

/// Rounds what a rotation leaves at 1e-17 instead of 0.
fn tidy(mut file: SceneFile) -> SceneFile {
    let clean = |x: &mut f32| *x = (*x * 1e5).round() / 1e5 + 0.0;
    file.camera.to_world.iter_mut().for_each(clean);
    clean(&mut file.camera.fov);
    for light in &mut file.lights {
        if let LightFile::Directional { direction, .. } = light {
            direction.iter_mut().for_each(clean);
        }
    }
    file
}

#[test]
fn s09_both_formats_mean_the_same() {
    let folder = folder();
    let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    put("scene.xml", XML);
    put("materials.xml", MATERIALS);
    let from_xml = load(folder.path()).unwrap();
    put("scene.json", JSON);
    let from_json = load(folder.path()).unwrap();
    assert_eq!(tidy(from_xml.file), tidy(from_json.file.clone()));
    assert_eq!(from_xml.meshes, from_json.meshes);
    assert_eq!(from_xml.images, from_json.images);
    assert_eq!(from_xml.warnings, Vec::<String>::new());
    assert_eq!(from_json.meshes.len(), 4);
    assert_eq!(from_json.images.keys().collect::<Vec<_>>(), ["grey.png (raw)", "sky.exr"]);
    let smooth = &from_json.meshes["tetrahedron.obj"];
    assert_eq!(smooth.normals.len(), smooth.positions.len(), "smooth normals are made where there are none");
    assert!(from_json.meshes["tetrahedron.obj (face normals)"].normals.is_empty());
    let copy = folder.path().join("copy.json");
    save(&from_json.file, &copy).unwrap();
    assert_eq!(load(&copy).unwrap().file, from_json.file);
}

/// The scene through Mitsuba's format, through ours written by hand, and through ours as saved from the other: pictures of the same
/// bits.
#[test]
fn s09_both_formats_give_the_same_picture() {
    let folder = folder();
    let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    put("materials.xml", MATERIALS);
    put("scene.xml", XML);
    put("scene.json", JSON);
    let picture = |loaded: &LoadedScene| {
        let scene = Scene::build(loaded, [24, 16]).unwrap();
        scenes::picture(&scene, &scenes::settings(scenes::GUIDES[1], 4, 1))
    };
    let [from_xml, from_json] = ["scene.xml", "scene.json"].map(|name| load(&folder.path().join(name)).unwrap());
    save(&from_xml.file, &folder.path().join("saved.json")).unwrap();
    let saved = load(&folder.path().join("saved.json")).unwrap();
    let exact = picture(&from_xml);
    assert!(scenes::mean(&exact) > 0.01 && exact == picture(&saved), "saved and loaded again");
    let [from_xml, from_json] =
        [from_xml, from_json].map(|loaded| picture(&LoadedScene { file: tidy(loaded.file.clone()), ..loaded }));
    assert!(from_xml == from_json);
}

/// One mesh from every kind of file that holds meshes: pictures of the same bits.
#[test]
fn s09_every_mesh_format_gives_the_same_picture() {
    let folder = folder();
    let corners = [[0f32, 0., 1.], [1., 0., 0.], [0., 1., 0.]];
    let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    put("one.obj", "v 0 0 1\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    put(
        "one.ply",
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
         element face 1\nproperty list uchar uint vertex_indices\nend_header\n0 0 1\n1 0 0\n0 1 0\n3 0 1 2\n",
    );
    let meshes = [
        MeshFile::Inline { positions: corners.to_vec(), normals: vec![], uvs: vec![], triangles: vec![[0, 1, 2]] },
        MeshFile::Obj { file: "one.obj".into(), face_normals: true, flip_v: false, materials: Vec::new() },
        MeshFile::Ply { file: "one.ply".into(), face_normals: true, flip_v: false, as_given: false },
        MeshFile::Serialized { file: "two.serialized".into(), index: 1, face_normals: true },
    ];
    let pictures = meshes.map(|mesh| {
        let mut b = Builder::new("one triangle", [24, 16]);
        let grey = b.add_material("grey", diffuse([0.5; 3]));
        b.add_mesh("triangle", mesh, Mat4::from_rotation_y(0.3), (Vec3::ZERO, 2.0), &grey);
        b.add_light(LightFile::Constant { radiance: [1.0; 3] });
        b.look_at(Vec3::new(1.0, 1.0, 3.0), Vec3::new(0.3, 0.3, 0.3), Vec3::Y, 30.0);
        let loaded = resolve(b.finish(), folder.path(), Path::new("made up")).unwrap();
        scenes::picture(&Scene::build(&loaded, [24, 16]).unwrap(), &scenes::settings(scenes::GUIDES[1], 4, 1))
    });
    // Some of it is the triangle, which is darker than the sky.
    assert!(scenes::mean(&pictures[0]) < 0.97, "{}", scenes::mean(&pictures[0]));
    assert!(pictures.iter().all(|picture| *picture == pictures[0]));
}

/// Filters of Mitsuba films by their defaults; where nothing is said, Mitsuba's own is a Gaussian. Those with negative lobes cannot
/// be sampled.
#[test]
fn filters_of_mitsuba() {
    let folder = folder();
    let sensor = r#"<sensor type="perspective"/>"#;
    let with = |filter: &str| {
        let own = format!(r#"<sensor type="perspective"><film type="hdrfilm">{filter}</film></sensor>"#);
        load_xml(&folder, &xml_with("").replace(sensor, &own))
    };
    let wide = FilterFile::Gaussian { stddev: 0.75, radius: None };
    for (filter, expected, warned) in [
        ("", FilterFile::GAUSSIAN, false),
        (r#"<rfilter type="box"/>"#, FilterFile::default(), false),
        (r#"<rfilter type="box"><float name="radius" value="2"/></rfilter>"#, FilterFile::Box { radius: 2.0 }, false),
        (r#"<rfilter type="sinc"/>"#, FilterFile::GAUSSIAN, true),
        (r#"<rfilter type="tent"/>"#, FilterFile::TENT, false),
        (r#"<rfilter type="tent"><float name="radius" value="2"/></rfilter>"#, FilterFile::Tent { radius: 2.0 }, false),
        (r#"<rfilter type="gaussian"/>"#, FilterFile::GAUSSIAN, false),
        (r#"<rfilter type="gaussian"><float name="stddev" value="0.75"/></rfilter>"#, wide, false),
        (r#"<rfilter type="mitchell"><float name="B" value="0.3"/></rfilter>"#, FilterFile::GAUSSIAN, true),
        (r#"<rfilter type="catmullrom"/>"#, FilterFile::GAUSSIAN, true),
        (r#"<rfilter type="lanczos"><integer name="lobes" value="3"/></rfilter>"#, FilterFile::GAUSSIAN, true),
    ] {
        let loaded = with(filter).unwrap();
        assert_eq!(loaded.file.film.filter, expected, "{filter}");
        let says =
            loaded.warnings.iter().any(|warning| warning.contains("tested.xml:") && warning.contains("Gaussian"));
        assert_eq!(says, warned, "{filter}: {:?}", loaded.warnings);
    }
    for (filter, words) in [
        (r#"<rfilter type="guassian"/>"#, "gaussian"),
        (r#"<rfilter type="box"><float name="radius" value="-2"/></rfilter>"#, "radius"),
        (r#"<rfilter type="tent"><float name="radius" value="-2"/></rfilter>"#, "radius"),
        (r#"<rfilter type="gaussian"><float name="stddev" value="1e9"/></rfilter>"#, "stddev"),
    ] {
        let message = with(filter).unwrap_err().to_string();
        assert!(message.contains("tested.xml:") && message.contains(words), "{filter}: {message}");
    }
}

/// Every kind of material and shape by its defaults, and what is done in another way is said.
#[test]
fn materials_and_shapes_of_mitsuba() {
    let folder = folder();
    let body = r#"
        <shape type="disk"><bsdf type="mask"><texture name="opacity" type="checkerboard"/>
            <bsdf type="twosided"><bsdf type="plastic"/></bsdf></bsdf></shape>
        <shape type="cylinder"><point name="p0" x="1" y="0" z="0"/><point name="p1" x="1" y="0" z="4"/>
            <float name="radius" value="0.5"/>
            <bsdf type="roughplastic"><rgb name="diffuse_reflectance" value="0.1 0.2 0.3"/><float name="alpha" value="0.2"/>
            <string name="distribution" value="ggx"/><boolean name="nonlinear" value="true"/></bsdf></shape>
        <shape type="cube"><bsdf type="roughdielectric"><float name="alpha" value="0.3"/></bsdf></shape>
        <shape type="cube"><bsdf type="thindielectric"/></shape>
        <shape type="cube"><bsdf type="bumpmap"><texture name="any" type="checkerboard"/><bsdf type="diffuse"/></bsdf></shape>
        <shape type="cube"><bsdf type="mask"><bsdf type="diffuse"/></bsdf><emitter type="area"/></shape>"#;
    let loaded = load_xml(&folder, &xml_with(body)).unwrap();
    let material = |i: usize| &loaded.file.materials[&loaded.file.shapes[i].material];
    let MaterialFile::Mask { opacity: TextureFile::Checkerboard { .. }, .. } = material(0) else {
        panic!("{:?}", material(0));
    };
    let (int_ior, ext_ior) = (1.49, 1.000277);
    let plain = MaterialFile::Plastic {
        alpha: 0.0,
        distribution: Distribution::Beckmann,
        int_ior,
        ext_ior,
        diffuse_reflectance: TextureFile::rgb([0.5; 3]),
        specular_reflectance: TextureFile::rgb([1.0; 3]),
        nonlinear: false,
    };
    assert_eq!(*material(0).innermost(), plain);
    let rough = MaterialFile::Plastic {
        alpha: 0.2,
        distribution: Distribution::Ggx,
        int_ior,
        ext_ior,
        diffuse_reflectance: TextureFile::rgb([0.1, 0.2, 0.3]),
        specular_reflectance: TextureFile::rgb([1.0; 3]),
        nonlinear: true,
    };
    assert_eq!(*material(1), rough);
    let glass =
        MaterialFile::RoughDielectric { alpha: 0.3, distribution: Distribution::Beckmann, int_ior: 1.5046, ext_ior };
    assert_eq!(*material(2), glass);
    assert_eq!(*material(3), MaterialFile::ThinDielectric { int_ior: 1.5046, ext_ior });
    assert!(matches!(material(4), MaterialFile::BumpMap { texture: TextureFile::Checkerboard { .. }, .. }));
    let places: Vec<bool> = ["disk is made of", "cylinder is made of", "without slopes", "mask is left out"]
        .map(|what| loaded.warnings.iter().any(|warning| warning.contains("tested.xml:") && warning.contains(what)))
        .to_vec();
    assert_eq!(places, [true; 4], "{:?}", loaded.warnings);
    // The cylinder stands on p0 and ends at p1, half a unit around.
    let m = loaded.file.shapes[1].to_world;
    let at = |p: [f32; 3]| {
        [0, 1, 2].map(|row| m[4 * row] * p[0] + m[4 * row + 1] * p[1] + m[4 * row + 2] * p[2] + m[4 * row + 3])
    };
    assert_eq!((at([0.0; 3]), at([0.0, 0.0, 1.0])), ([1.0, 0.0, 0.0], [1.0, 0.0, 4.0]));
    let [x, y, z] = at([1.0, 0.0, 0.0]);
    assert!(((x - 1.0).hypot(y) - 0.5).abs() < 1e-6 && z == 0.0);
    let copy = folder.path().join("copy.json");
    save(&loaded.file, &copy).unwrap();
    assert_eq!(load(&copy).unwrap().file, loaded.file);
}

/// Never a panic; an error of the kinds that name a place.
#[test]
fn unknown_or_wrong_xml_is_refused_with_its_line() {
    let folder = folder();
    load_xml(&folder, &xml_with("")).unwrap();
    for body in [
        "<bsdf type='diffuze' id='a'/>",
        "<shape type='sphere'><emitter type='aera'/></shape>",
        "<emitter type='constnat'/>",
        "<bsdf type='diffuse'><float name='reflectence' value='1'/></bsdf>",
        "<bsdf type='diffuse'><rgb name='reflectance' value='0.1 0.2'/></bsdf>",
        "<bsdf type='diffuse'><rgb name='reflectance' value='nan'/></bsdf>",
        "<bsdf type='diffuse' id='a'><rgb name='reflectance' value='2'/></bsdf>",
        "<bsdf type='conductor'><string name='material' value='Unobtainium'/></bsdf>",
        "<bsdf type='dielectric' id='a'><float name='int_ior' value='0'/></bsdf>",
        "<bsdf type='roughconductor' id='a'><float name='alpha' value='-1'/></bsdf>",
        "<bsdf type='twosided' id='a'><ref id='a'/></bsdf>",
        "<bsdf type='twosided' id='a'><bsdf type='dielectric'/></bsdf>",
        "<bsdf type='twosided' id='a'><bsdf type='mask'><bsdf type='thindielectric'/></bsdf></bsdf>",
        "<bsdf type='mask' id='a'><bsdf type='mask'><bsdf type='diffuse'/></bsdf></bsdf>",
        "<bsdf type='mask' id='a'/>",
        "<bsdf type='mask' id='a'><float name='opacity' value='2'/><bsdf type='diffuse'/></bsdf>",
        "<bsdf type='plastic' id='a'><float name='int_ior' value='-1'/></bsdf>",
        "<bsdf type='plastic' id='a'><float name='int_iro' value='1.1'/></bsdf>",
        "<bsdf type='roughplastic' id='a'><string name='alpha' value='rough'/></bsdf>",
        "<bsdf type='roughdielectric' id='a'><string name='distribution' value='cosine'/></bsdf>",
        "<shape type='cylinder'><float name='radius' value='-1'/></shape>",
        "<shape type='cube'><float name='size' value='1'><default name='a' value='b'/></float></shape>$a",
        "<shape type='cubo'/>",
        "<shape type='cube'><ref id='nothing'/></shape>",
        "<shape type='cube'><transform name='to_world'><matrix value='1 0 0 0 0 1 0 0 0 0 nan 0 0 0 0 1'/></transform></shape>",
        "<shape type='cube'><transform name='to_world'><matrix value='1 0 0 0 0 1'/></transform></shape>",
        "<shape type='cube'><transform name='to_world'><scale x='0'/></transform></shape>",
        "<shape type='cube'><transform name='to_world'><shear x='1'/></transform></shape>",
        "<shape type='sphere'><float name='radius' value='-1'/></shape>",
        "<shape type='sphere'><emitter type='area'><rgb name='radiance' value='-1'/></emitter></shape>",
        "<shape type='obj'><string name='filename' value='../tetrahedron.obj'/></shape>",
        "<shape type='obj'><string name='filename' value='/etc/passwd'/></shape>",
        "<shape type='cube'>text</shape>",
        "<shape type='cube' color='red'/>",
        "<emitter type='area'/>",
        "<emitter type='constant'/><emitter type='constant'/>",
        "<shape type='cube'><medium type='homogeneus' name='interior'/></shape>",
        "<string name='a' value='$undefined'/>",
        "<include filename='tested.xml'/>",
    ] {
        let message = refused(load_xml(&folder, &xml_with(body)), body).to_string();
        assert!(message.contains("tested.xml:3: "), "{body}: {message}");
    }
    refused(load_xml(&folder, &xml_with("<include filename='grey.png'/>")), "not XML");
    let missing = "<bsdf type='diffuse' id='a'><texture name='reflectance' type='bitmap'>\
        <string name='filename' value='none.png'/></texture></bsdf>";
    assert!(matches!(refused(load_xml(&folder, &xml_with(missing)), missing), Error::Missing { .. }));
}

#[test]
fn wrong_json_is_refused_with_its_place() {
    let folder = folder();
    let path = folder.path().join("scene.json");
    for (from, to, place) in [
        ("\"version\": 1", "\"version\": 2", "(version)"),
        ("\"fov\": 40", "\"fov\": 180", "(camera.fov)"),
        ("\"fov\": 40", "\"fov\": 1e39", "(camera.fov)"),
        ("\"fov\": 40", "\"fov\": 40, \"zoom\": 2", "scene.json:5: "),
        ("\"width\": 32", "\"width\": 0", "(film.width)"),
        ("\"width\": 32", "\"width\": 20000", "(film.width)"),
        ("\"spp\": 16", "\"spp\": 0", "(render.spp)"),
        ("-1, 0, 0, 0, ", "0, 0, 0, 0, ", "(camera.to_world)"),
        ("\"material\": \"glass\"", "\"material\": \"wax\"", "(shapes[0].material)"),
        ("\"mesh\": \"triangle.ply\"", "\"mesh\": \"none\"", "(shapes[3].geometry.mesh)"),
        ("\"alpha\": 0.1", "\"alpha\": -0.1", "(materials.metal.material.alpha)"),
        ("[17, 12, 4]", "[17, -12, 4]", "(shapes[5].emission)"),
        ("\"beam_width\": 30", "\"beam_width\": 50", "(lights[0].beam_width)"),
        ("[0, -1, 0]", "[0, 0, 0]", "(lights[1].direction)"),
        ("\"file\": \"sky.exr\"", "\"file\": \"a/../../sky.exr\"", "(lights[3])"),
        ("\"file\": \"triangle.ply\"", "\"file\": \"tetrahedron.obj\"", "tetrahedron.obj"),
        ("\"materials\": {", "\"materials\": { \"n\": { \"type\": \"null\", \"alpha\": 1 },", "unknown field `alpha`"),
        (
            "\"meshes\": {",
            "\"meshes\": { \"r\": { \"type\": \"rectangle\", \"flip_v\": true },",
            "unknown field `flip_v`",
        ),
    ] {
        assert!(JSON.contains(from), "{from}");
        std::fs::write(&path, JSON.replacen(from, to, 1)).unwrap();
        let message = refused(load(&path), to).to_string();
        assert!(message.contains(place), "{to}: {message}");
    }
    for eighth in 0..8 {
        std::fs::write(&path, &JSON[..JSON.len() * eighth / 8]).unwrap();
        refused(load(&path), "cut JSON");
    }
    refused(load(&folder.path().join("nothing.json")), "missing");
    refused(load(&folder.path().join("sky.exr")), "not a scene");
}

/// A surface that would reflect more than arrives is warned of, and rendered as it is.
#[test]
fn pictures_brighter_than_white() {
    let folder = folder();
    let path = folder.path().join("scene.json");
    for (scale, warned) in [(1, false), (4, true)] {
        std::fs::write(&path, JSON.replacen("\"raw\": true", &format!("\"raw\": true, \"scale\": {scale}"), 1))
            .unwrap();
        let warnings = load(&path).unwrap().warnings;
        let told = |warning: &String| warning.contains("the reflectance of \"painted\" reaches 4");
        assert_eq!(warnings.iter().any(told), warned, "{scale}: {warnings:?}");
    }
}

#[test]
fn a08_triangles_without_area_are_counted() {
    let mesh = MeshFile::Inline {
        positions: vec![[0.; 3], [1., 0., 0.], [0., 1., 0.]],
        normals: vec![],
        uvs: vec![],
        triangles: vec![[0, 1, 2], [0, 0, 1]],
    };
    let loaded = resolve(scene_with(Some(mesh), None), Path::new(""), Path::new("made up")).unwrap();
    assert_eq!((loaded.skipped_triangles, loaded.warnings.len()), (1, 1));
}

/// Files are read side by side; of several broken ones the error is always that of the first, meshes before pictures.
#[test]
fn the_first_of_many_errors_is_told() {
    let folder = folder();
    std::fs::write(folder.path().join("broken.obj"), "v 0 0 0\nv 1\nf 1 2 3\n").unwrap();
    let mesh = MeshFile::Obj { file: "broken.obj".into(), face_normals: false, flip_v: false, materials: Vec::new() };
    let told = |mesh: Option<&MeshFile>, pictures: std::ops::Range<usize>| {
        let mut scene = scene_with(mesh.cloned(), Some("grey.png"));
        let good = scene.materials["t"].clone();
        for i in pictures {
            let name = format!("broken-{i}.png");
            std::fs::write(folder.path().join(&name), "GIF89a").unwrap();
            let mut material = good.clone();
            for (_, texture) in material.textures_mut() {
                if let TextureFile::Bitmap { file, .. } = texture {
                    *file = name.clone();
                }
            }
            scene.materials.insert(format!("m{i}"), material);
        }
        refused(resolve(scene, folder.path(), Path::new("scene")), "a file is broken").to_string()
    };
    for _ in 0..20 {
        assert!(told(None, 3..9).contains("broken-3.png"));
        assert!(told(Some(&mesh), 3..9).contains("broken.obj:2"));
    }
}

/// A scene in XML whose fourth and fifth line lack a mesh each, whose sixth and later lines lack pictures.
const LACKING: &str = r#"<shape type="obj" id="lost"><string name="filename" value="lost.obj"/></shape>
<shape type="ply" id="lamp"><string name="filename" value="a/lamp.ply"/><emitter type="area"/></shape>
<bsdf type="diffuse" id="wall"><texture name="reflectance" type="bitmap"><string name="filename" value="wall.png"/></texture></bsdf>
<bsdf type="roughplastic" id="coat"><texture name="alpha" type="bitmap"><string name="filename" value="alpha.png"/></texture></bsdf>
<bsdf type="normalmap" id="bent"><texture type="bitmap"><string name="filename" value="bent.png"/></texture>
    <bsdf type="diffuse"><texture name="reflectance" type="bitmap"><string name="filename" value="wall.png"/></texture></bsdf></bsdf>
<shape type="sphere" id="kept"><ref id="wall"/></shape>
<emitter type="envmap"><string name="filename" value="lost.exr"/><float name="scale" value="3"/></emitter>"#;

/// All files that are not there are named at once, with their lines.
#[test]
fn missing_files_are_named_together() {
    let folder = folder();
    let message = refused(load_xml(&folder, &xml_with(LACKING)), "missing").to_string();
    let files =
        [("lost.obj", 3), ("a/lamp.ply", 4), ("wall.png", 5), ("alpha.png", 6), ("bent.png", 7), ("lost.exr", 10)];
    let mut rest = message.as_str();
    for (file, line) in files {
        let told = format!("{file} (named at {}:{line})", folder.path().join("tested.xml").display());
        let at = rest.find(&told).unwrap_or_else(|| panic!("{told}, or its order: {message}"));
        rest = &rest[at + told.len()..];
    }
    assert!(message.contains("6 files are missing") && message.matches("wall.png").count() == 1, "{message}");
    let path = folder.path().join("scene.json");
    let lost = JSON
        .replace("\"file\": \"triangle.ply\"", "\"file\": \"lost.ply\"")
        .replace("\"file\": \"sky.exr\"", "\"file\": \"lost.exr\"");
    std::fs::write(&path, lost).unwrap();
    let message = refused(load(&path), "missing").to_string();
    for told in
        ["lost.ply (named at", "scene.json (meshes.triangle.ply))", "lost.exr (named at", "scene.json (lights[3]))"]
    {
        assert!(message.contains(told), "{told}: {message}");
    }
}

/// Without its missing files a scene is one of its own: shapes are gone, colours stand for pictures, and each is said.
#[test]
fn missing_files_are_skipped() {
    let folder = folder();
    let path = folder.path().join("tested.xml");
    std::fs::write(&path, xml_with(LACKING)).unwrap();
    let skip = || load_lacking(&path, &[], Missing::Skip).unwrap_or_else(|error| panic!("{error}"));
    let loaded = skip();
    assert_eq!(loaded.missing, ["lost.obj", "a/lamp.ply", "wall.png", "alpha.png", "bent.png", "lost.exr"]);
    let names: Vec<&str> = loaded.file.shapes.iter().map(|shape| shape.name.as_str()).collect();
    assert_eq!((names, loaded.file.meshes.len(), loaded.images.len()), (vec!["kept"], 0, 0));
    assert_eq!(loaded.file.lights, [LightFile::Constant { radiance: [1.5; 3] }]);
    let grey = MaterialFile::Diffuse { reflectance: TextureFile::rgb([0.5; 3]) };
    assert_eq!(loaded.file.materials["wall"], grey);
    let bent = MaterialFile::NormalMap { texture: TextureFile::rgb([0.5, 0.5, 1.0]), material: Box::new(grey) };
    assert_eq!(loaded.file.materials["bent"], bent);
    let MaterialFile::RoughnessMap { texture, .. } = &loaded.file.materials["coat"] else { panic!("a rough coat") };
    assert_eq!(*texture, TextureFile::rgb([0.5; 3]));
    for told in [
        "tested.xml:3: the shape \"lost\" is left out: its mesh \"lost.obj\" is missing",
        "tested.xml:4: the shape \"lamp\", which emits light, is left out: its mesh \"a/lamp.ply\" is missing",
        "tested.xml:5: the picture \"wall.png\" is missing: the constant 0.5 is used instead",
        "tested.xml:6: the picture \"alpha.png\" is missing: the constant 0.5 is used instead",
        "tested.xml:7: the picture \"bent.png\" is missing: the constant 0.5, 0.5, 1 is used instead",
        "tested.xml:10: the picture \"lost.exr\" is missing: the constant 1.5 is used instead",
    ] {
        assert_eq!(loaded.warnings.iter().filter(|w| w.contains(told)).count(), 1, "{told}: {:#?}", loaded.warnings);
    }
    let scene = Scene::build(&loaded, [6, 4]).unwrap();
    let image = scenes::picture(&scene, &scenes::settings(scenes::GUIDES[0], 4, 1));
    assert!(image.pixels.iter().all(|pixel| pixel.is_finite()));
    // With any of the files back the scene is another one.
    std::fs::copy(folder.path().join("tetrahedron.obj"), folder.path().join("lost.obj")).unwrap();
    let more = skip();
    assert!(more.crc32() != loaded.crc32() && more.file.shapes.len() == 2);
    std::fs::copy(folder.path().join("grey.png"), folder.path().join("wall.png")).unwrap();
    assert!(skip().crc32() != more.crc32());
    // What is there and unsound is no missing file, nor is a path that leads out.
    std::fs::write(folder.path().join("lost.exr"), "no picture").unwrap();
    refused(load_lacking(&path, &[], Missing::Skip), "not a picture");
    std::fs::write(&path, xml_with(&LACKING.replace("a/lamp.ply", "../lamp.ply"))).unwrap();
    let message = refused(load_lacking(&path, &[], Missing::Skip), "out of the folder").to_string();
    assert!(message.contains("climbs out"), "{message}");
}

#[test]
fn shared_scenes() {
    let shared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/scenes");
    if !shared.is_dir() {
        return;
    }
    for (name, shapes, lights, size) in [
        ("cornell-box", 8, 0, (256, 256)),
        ("torus", 5, 1, (320, 240)),
        ("veach-bidir", 14, 0, (256, 256)),
        ("veach-mis", 9, 0, (320, 180)),
    ] {
        let loaded = load(&shared.join(name)).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(loaded.file.shapes.len(), shapes, "{name}");
        assert_eq!(loaded.file.lights.len(), lights, "{name}");
        assert_eq!((loaded.file.film.width, loaded.file.film.height), size);
        assert_eq!(loaded.file.render.max_depth, 20);
        println!("{name}: skipped {}, warnings {:?}", loaded.skipped_triangles, loaded.warnings);
        for shape in &loaded.file.shapes {
            if let GeometryFile::Mesh { mesh } = &shape.geometry {
                assert!(!loaded.meshes[mesh].triangles.is_empty());
            }
        }
        let (width, height, channels) = read_exr_channels(&shared.join(name).join("reference.exr")).unwrap();
        assert_eq!((width as u32, height as u32), size);
        assert!(channels.len() >= 3);
        let image = read_image(&shared.join(name).join("reference.exr"), false).unwrap();
        assert_eq!((image.width, image.height), (width, height));
    }
}
