//! Scenes as others write them: what public scenes of Mitsuba use, in excerpts of our own making that have no more than their words
//! (docs/scenes.md lists the scenes), vertex colours, and textured emission.

use crate::support::scenes;

use std::path::Path;

use fanal::geometry::Ray;
use fanal::lights::Light;
use fanal::scene::Scene;
use fanal::scene::file::{
    GeometryFile, GridFile, IDENTITY, LightFile, MaterialFile, MediumFile, ProfileFile, TextureFile,
};
use fanal::scene::readers::{LoadedScene, Missing, load, load_lacking};
use glam::{Vec2, Vec3};
use image::{ImageFormat, RgbImage};
use tempfile::TempDir;

fn put(folder: &TempDir, name: &str, bytes: impl AsRef<[u8]>) {
    let path = folder.path().join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, bytes).unwrap();
}

fn read(folder: &TempDir, text: &str) -> LoadedScene {
    put(folder, "scene.xml", text);
    load(&folder.path().join("scene.xml")).unwrap_or_else(|error| panic!("{error}"))
}

fn warned(loaded: &LoadedScene, words: &str) -> bool {
    loaded.warnings.iter().any(|warning| warning.contains(words))
}

/// Two triangles in z = 0 whose corners are red, green, blue and white, with colours of their faces beside.
const SQUARE: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
    property float r\nproperty float g\nproperty float b\nelement face 2\nproperty list uchar int vertex_indices\n\
    property float r\nproperty float g\nproperty float b\nend_header\n-1 -1 0 1 0 0\n1 -1 0 0 1 0\n1 1 0 1 1 1\n-1 1 0 0 0 1\n\
    3 0 1 2 0.1 0.2 0.3\n3 0 2 3 0.4 0.5 0.6\n";

/// The ball of the material test scenes of Mitsuba (mitsuba-data, `docs/scenes` and `scenes/StandardShaderBall`): materials and lamps
/// in files that names choose, spectra, lamps of no surface.
#[test]
fn ball_of_parts() {
    let folder = tempfile::tempdir().unwrap();
    put(&folder, "materials/banana.xml", "<scene version='3.0.0'><bsdf type='principled' id='skin' name='skin'>
        <spectrum name='base_color' value='400:0.1754, 500:0.23, 600:0.6, 700:0.69'/><float name='roughness' value='0.5'/></bsdf></scene>");
    put(
        &folder,
        "lamps/warm.xml",
        "<scene version='3.0.0'><shape type='rectangle' id='lamp' name='lamp'>
        <boolean name='flip_normals' value='True'/><transform name='to_world'><translate z='4'/></transform>
        <emitter type='area' name='emitter'><spectrum name='radiance' filename='lamps/warm.spd'/></emitter>
        <bsdf type='null' name='bsdf'/></shape></scene>",
    );
    put(&folder, "common/meshes/square.ply", SQUARE);
    put(&folder, "lamps/warm.spd", "# nm, W\n400 1.0\n550 2.0\n700 3.0\n");
    let loaded = read(&folder, "<scene version='3.0.0'><default name='fruit' value='banana'/><default name='light' value='warm'/>
        <integrator type='Path' id='elm__0' name='elm__0'><integer name='maxDepth' value='5'/></integrator>
        <include filename='materials/$fruit.xml'/><include filename='lamps/$light.xml'/>
        <sensor type='perspective'><transform name='toWorld'><lookAt origin='0, -4, 1' target='0, 0, 0' up='0, 0, 1'/></transform>
        <sampler type='independent'><integer name='sample_count' value='$spp'/></sampler></sensor>
        <shape type='Sphere'><ref id='skin'/></shape><path value='../../common'/><path value='common'/>
        <shape type='ply'><string name='filename' value='meshes/square.ply'/></shape></scene>");
    assert_eq!((loaded.file.shapes.len(), loaded.file.render.max_depth), (3, 5));
    assert!(loaded.meshes.contains_key("common/meshes/square.ply"));
    let lamp = loaded.file.shapes[0].emission.unwrap();
    assert!(lamp[0] > 2.0 && lamp[0] > lamp[2] && lamp[2] > 0.5, "{lamp:?}");
    assert!(warned(&loaded, "$spp") && warned(&loaded, "read as black"), "{:?}", loaded.warnings);
    assert!(loaded.file.shapes[0].flip_normals);
    let picture = scenes::picture(&Scene::build(&loaded, [8, 6]).unwrap(), &scenes::settings(scenes::GUIDES[0], 4, 1));
    assert!(scenes::mean(&picture) > 0.0);
}

/// A box as path guiding is tested with (Tom94/practical-path-guiding, anadodik/sdmm-mitsuba): integrators of their own, those beside
/// the folder, ids of Collada, metals by name, glass with what it has no use for.
#[test]
fn box_for_guiding() {
    let folder = tempfile::tempdir().unwrap();
    let loaded = read(&folder, "<?xml version='1.0' encoding='utf-8'?><scene version='0.6.0'>
        <default name='integrator' value='ppg'/><include filename='../_integrators/$integrator.xml'/>
        <sensor type='perspective'><float name='fov' value='19.5'/><float name='shutterOpen' value='0'/><transform name='toWorld'>
        <matrix value='-1 0 0 0 0 1 0 1 0 0 -1 6.8 0 0 0 1'/></transform><sampler type='independent'>
        <integer name='sampleCount' value='8'/><integer name='seed' value='1234'/></sampler>
        <film type='hdrfilm'><integer name='width' value='12'/><integer name='height' value='9'/><rfilter type='box'/></film></sensor>
        <bsdf type='twosided' id='a.b#1'><bsdf type='phong'><string name='sdmmFilename' value='phong.sdmm'/>
        <rgb name='diffuseReflectance' value='0 0 0'/><rgb name='specularReflectance' value='9.2 9.2 9.2'/>
        <float name='exponent' value='98'/></bsdf></bsdf>
        <bsdf type='conductor' id='metal'><string name='material' value='Al'/><float name='alpha' value='0.1'/></bsdf>
        <shape type='sphere'><animation name='toWorld'><transform time='0'><scale value='0.3'/><translate x='0.5'/></transform>
        <transform time='1'><translate x='9'/></transform></animation><ref id='metal'/></shape>
        <shape type='cube'><ref name='bsdf' id='a.b#1'/></shape>
        <shape type='rectangle'><emitter type='area'><spectrum name='radiance' value='400:0, 500:16, 600:31.2, 700:36.8'/></emitter></shape>
        </scene>");
    assert_eq!((loaded.file.film.width, loaded.file.render.spp, loaded.file.shapes.len()), (12, 8, 3));
    assert!(warned(&loaded, "the include is left out") && warned(&loaded, "animation begins"), "{:?}", loaded.warnings);
    assert_eq!(loaded.file.shapes[0].to_world[3], 0.5);
    assert!(warned(&loaded, "scaled down to 1"), "{:?}", loaded.warnings);
}

/// Glass of milk and smoke (yysun997/improved-path-guiding, BachiLi/lajolla_public): measured media, grids, borders of nothing else.
#[test]
fn media_by_name_and_by_grid() {
    let folder = tempfile::tempdir().unwrap();
    let mut grid = b"VOL\x03".to_vec();
    [1u32, 2, 1, 1, 1].iter().for_each(|word| grid.extend(word.to_le_bytes()));
    [-1f32, -1.0, -1.0, 1.0, 1.0, 1.0].iter().for_each(|corner| grid.extend(corner.to_le_bytes()));
    [0.5f32, 1.5].iter().for_each(|value| grid.extend(value.to_le_bytes()));
    put(&folder, "smoke.vol", grid);
    let loaded = read(&folder, "<scene version='0.5.0'><integrator type='volpath'><integer name='maxDepth' value='-1'/></integrator>
        <medium type='homogeneous' id='milk'><string name='material' value='Regular Milk'/><float name='scale' value='0.01'/></medium>
        <medium type='heterogeneous' id='smoke'><string name='method' value='woodcock'/><volume name='density' type='gridvolume'>
        <string name='filename' value='smoke.vol'/></volume><volume name='albedo' type='constvolume'><rgb name='value' value='0.9'/></volume>
        <float name='scale' value='100'/><float name='stepSize' value='0.1'/><phase type='rayleigh'/></medium>
        <shape type='sphere'><bsdf type='roughdielectric'><float name='intIOR' value='1.33'/></bsdf><ref name='interior' id='milk'/></shape>
        <shape type='cube'><ref name='interior' id='smoke'/></shape></scene>");
    let MediumFile::Homogeneous { sigma_t, albedo, g } = &loaded.file.media["milk"] else { panic!("it varies") };
    assert!(
        (sigma_t[0] - 18.20673).abs() < 1e-3 && albedo[2] > 0.999 && (g - 0.714).abs() < 0.01,
        "{sigma_t:?} {albedo:?} {g}"
    );
    let MediumFile::Grid(smoke) = &loaded.file.media["smoke"] else { panic!("it is the same everywhere") };
    let density = GridFile::Vol { file: "smoke.vol".into(), to_world: IDENTITY, own_box: true, centred: true };
    assert_eq!((&smoke.density, smoke.sigma_t, smoke.albedo, smoke.g), (&density, [100.0; 3], [0.9; 3], 0.0));
    assert_eq!(loaded.file.materials[&loaded.file.shapes[1].material], MaterialFile::Null {});
    for told in ["no sensor", "read as isotropic"] {
        assert!(warned(&loaded, told), "{told}: {:?}", loaded.warnings);
    }
    // The camera of scenes without any sees both.
    let scene = Scene::build(&loaded, [16, 9]).unwrap();
    let ray = scene.camera.ray([8.0, 4.5], [0.5; 2]);
    assert!(scene.intersect(&ray).is_some());
}

/// Radio scenes of Sionna and exports of mitsuba-blender: no camera, materials of other programs, files that are not there.
#[test]
fn exports_without_a_camera() {
    let folder = tempfile::tempdir().unwrap();
    put(&folder, "meshes/floor.ply", SQUARE);
    put(&folder, "scene.xml", "<scene version='2.1.0'><integrator type='path'><integer name='max_depth' value='12'/></integrator>
        <bsdf type='itu-radio-material' id='mat-itu_metal'><string name='type' value='metal'/><float name='thickness' value='0.1'/></bsdf>
        <bsdf type='twosided' id='mat-grating' name='mat-grating'><bsdf type='roughgrating' name='bsdf'><float name='height' value='0.04'/></bsdf></bsdf>
        <emitter type='constant' id='World'><rgb value='1.0 1.0 1.0' name='radiance'/></emitter>
        <shape type='merge'><shape type='ply' id='mesh-floor'><string name='filename' value='meshes/floor.ply'/>
        <boolean name='face_normals' value='true'/><ref id='mat-itu_metal' name='bsdf'/></shape>
        <shape type='ply' id='mesh-wall'><string name='filename' value='meshes/wall.ply'/><ref id='mat-grating' name='bsdf'/></shape></shape></scene>");
    let loaded =
        load_lacking(&folder.path().join("scene.xml"), &[], Missing::Skip).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((loaded.file.shapes.len(), loaded.missing.as_slice()), (1, &["meshes/wall.ply".to_owned()][..]));
    assert!(warned(&loaded, "itu-radio-material") && warned(&loaded, "roughgrating"), "{:?}", loaded.warnings);
    let picture = scenes::picture(&Scene::build(&loaded, [16, 9]).unwrap(), &scenes::settings(scenes::GUIDES[0], 4, 1));
    assert!(scenes::mean(&picture) > 0.3, "{}", scenes::mean(&picture));
}

/// The test scenes of mitsuba-data for emitters and materials, and what Disney's material is called in lajolla.
#[test]
fn materials_of_other_names() {
    let folder = tempfile::tempdir().unwrap();
    RgbImage::new(4, 4).save_with_format(folder.path().join("flower.bmp"), ImageFormat::Bmp).unwrap();
    let loaded = read(&folder, "<scene version='0.5.0'><sensor type='perspective'/><integrator type='moment'><integrator type='direct'/></integrator>
        <bsdf type='disneybsdf' id='disney'><rgb name='baseColor' value='0.82 0.67 0.16'/><float name='specularTransmission' value='0.5'/>
        <float name='subsurface' value='0.25'/><float name='specularTint' value='0.75'/><float name='clearcoatGloss' value='0.5'/></bsdf>
        <bsdf type='mixturebsdf' id='three'><string name='weights' value='0.5, 0.25, 0.25'/><bsdf type='diffuse'/><bsdf type='plastic'/>
        <bsdf type='conductor'/></bsdf>
        <bsdf type='mixturebsdf' id='half'><string name='weights' value='0.5'/><bsdf type='diffuse'><rgb name='reflectance' value='1 1 1' intent='reflectance'/></bsdf></bsdf>
        <texture type='gridtexture' id='grid'><rgb name='color0' value='0.2'/><rgb name='color1' value='0.4'/><float name='lineWidth' value='.01'/></texture>
        <bsdf type='diffuse' id='lined'><ref name='reflectance' id='grid'/></bsdf>
        <bsdf type='principledthin' id='leaf'><rgb name='base_color' value='0.7 0.1 0.1'/><float name='eta' value='1.33'/>
        <texture name='spec_trans' type='checkerboard'><float name='color0' value='0.2'/><float name='color1' value='0.8'/></texture>
        <texture name='diff_trans' type='checkerboard'><float name='color0' value='0.4'/><float name='color1' value='1.4'/></texture></bsdf>
        <emitter type='spot' id='light_4'><texture name='texture' type='bitmap'><string name='filename' value='flower.bmp'/></texture></emitter>
        <emitter type='projector'><float name='scale' value='2'/><float name='fov' value='40'/><texture name='irradiance' type='checkerboard'>
        <rgb name='color0' value='1 1 0'/><rgb name='color1' value='0.5 0.5 0'/></texture></emitter></scene>");
    let MaterialFile::Principled(disney) = &loaded.file.materials["disney"] else {
        panic!("{:?}", loaded.file.materials)
    };
    assert_eq!((disney.spec_trans, disney.flatness, disney.spec_tint, disney.clearcoat_gloss), (0.5, 0.25, 0.75, 0.5));
    assert_eq!(loaded.file.materials["three"].parts().len(), 3);
    // What is missing to a sum of 1 is absorbed.
    let MaterialFile::Blend { weight, materials } = &loaded.file.materials["half"] else { panic!() };
    assert_eq!(*weight, TextureFile::rgb([0.5; 3]));
    assert!(
        matches!(materials[0].innermost(), MaterialFile::Diffuse { reflectance } if *reflectance == TextureFile::rgb([0.0; 3]))
    );
    let MaterialFile::Blend { weight: TextureFile::Rgb { value: outer }, materials } = &loaded.file.materials["three"]
    else {
        panic!()
    };
    let MaterialFile::Blend { weight: TextureFile::Rgb { value: inner }, .. } = &materials[0] else { panic!() };
    assert!((outer[0] - 0.25).abs() < 1e-6 && (inner[0] - 1.0 / 3.0).abs() < 1e-6, "{outer:?} {inner:?}");
    let MaterialFile::PrincipledThin(leaf) = &loaded.file.materials["leaf"] else {
        panic!("{:?}", loaded.file.materials["leaf"]);
    };
    let TextureFile::Checkerboard { color0, color1, .. } = &leaf.diff_trans else { panic!("{leaf:?}") };
    // From 0 to 2 there.
    assert_eq!((*color0, *color1, leaf.eta), ([0.2; 3], [0.7; 3], 1.33));
    assert!(matches!(leaf.spec_trans, TextureFile::Checkerboard { color1: [0.8, 0.8, 0.8], .. }), "{leaf:?}");
    let MaterialFile::Diffuse { reflectance: TextureFile::Rgb { value } } = loaded.file.materials["lined"] else {
        panic!()
    };
    assert!((value[0] - 0.3).abs() < 1e-6, "{value:?}");
    let [LightFile::Projector { profile, .. }, LightFile::Projector { intensity, fov, texture, .. }] =
        &loaded.file.lights[..]
    else {
        panic!("{:?}", loaded.file.lights)
    };
    assert_eq!((*profile, *fov), (ProfileFile::Cone { beam_width: 15.0 }, 40.0));
    assert!((intensity[0] - 2.0 * std::f32::consts::PI).abs() < 1e-5, "{intensity:?}");
    assert!(matches!(texture, TextureFile::Checkerboard { color0: [1.0, 1.0, 0.0], .. }), "{texture:?}");
}

fn color_at(scene: &Scene, x: f32, y: f32) -> Vec3 {
    let surface =
        scene.intersect(&Ray { origin: Vec3::new(x, y, 5.0), direction: Vec3::NEG_Z }).expect("a surface below");
    let [wo, wi] = [Vec3::Z, Vec3::new(0.0, 0.6, 0.8)];
    scene.material(&surface).eval(surface.uv, wo, wi) * std::f32::consts::PI / 0.8
}

/// Colours of vertices are interpolated linearly within each triangle, those of faces are the same all over it, and so it is in PLY, in
/// OBJ and in the words of 0.6. Beside a picture there is their mean.
#[test]
fn colours_of_vertices_and_faces() {
    let folder = tempfile::tempdir().unwrap();
    put(&folder, "square.ply", SQUARE);
    put(&folder, "square.obj", "v -1 -1 0 1 0 0\nv 1 -1 0 0 1 0\nv 1 1 0 1 1 1\nv -1 1 0 0 0 1\nf 1 2 3\nf 1 3 4\n");
    let scene = |version: &str, file: &str, texture: &str| {
        let kind = &file[file.len() - 3..];
        let text = format!(
            "<scene version='{version}'><sensor type='perspective'/><bsdf type='diffuse' id='d'>{texture}</bsdf>
            <shape type='{kind}'><string name='filename' value='{file}'/><ref id='d'/></shape>
            <shape type='sphere'><point name='center' x='9' y='0' z='0'/><ref id='d'/></shape></scene>"
        );
        let loaded = read(&folder, &text);
        let copy = folder.path().join("copy.json");
        fanal::scene::readers::save(&loaded.file, &copy).unwrap();
        let again = load(&copy).unwrap();
        assert_eq!((&again.file, again.attributes.len()), (&loaded.file, 1));
        assert!(warned(&loaded, "a sphere has no \""), "{:?}", loaded.warnings);
        Scene::build(&loaded, [4, 4]).unwrap()
    };
    let attribute = |name: &str| {
        format!("<texture type='mesh_attribute' name='reflectance'><string name='name' value='{name}'/></texture>")
    };
    let near = |a: Vec3, b: Vec3| assert!(a.distance(b) < 2e-3, "{a} {b}");
    for (version, file, texture) in [
        ("3.0.0", "square.ply", attribute("vertex_color")),
        ("3.0.0", "square.obj", attribute("vertex_color")),
        ("0.6.0", "square.ply", "<texture type='vertexcolors' name='reflectance'/>".to_owned()),
    ] {
        let scene = scene(version, file, &texture);
        near(color_at(&scene, 0.999, -0.999), Vec3::new(0.001, 0.998, 0.001));
        // Halfway from red to green, and inside: a quarter red, a quarter green, half white.
        near(color_at(&scene, 0.0, -0.9999), Vec3::new(0.5, 0.5, 0.0));
        near(color_at(&scene, 0.5, 0.0), Vec3::new(0.75, 0.75, 0.5));
        near(color_at(&scene, -0.5, 0.0), Vec3::new(0.5 + 0.25, 0.25, 0.5 + 0.0));
        near(color_at(&scene, 9.0, 0.0), Vec3::splat(0.5));
    }
    let faces = scene("3.0.0", "square.ply", &attribute("face_color"));
    near(color_at(&faces, 0.5, -0.2), Vec3::new(0.1, 0.2, 0.3));
    near(color_at(&faces, -0.5, 0.2), Vec3::new(0.4, 0.5, 0.6));
    put(
        &folder,
        "scene.xml",
        format!(
            "<scene version='3.0.0'><sensor type='perspective'/><bsdf type='mask' id='m'>
        <texture name='opacity' type='checkerboard'/><bsdf type='diffuse'>{}</bsdf></bsdf>
        <shape type='ply'><string name='filename' value='square.ply'/><ref id='m'/></shape></scene>",
            attribute("vertex_color")
        ),
    );
    let mixed = Scene::build(&load(&folder.path().join("scene.xml")).unwrap(), [4, 4]).unwrap();
    near(color_at(&mixed, 0.5, -0.2), Vec3::new(2.0 / 3.0, 0.5, 0.5));
    // A grain is measured by the texture coordinates, so that there is the mean beside it, too.
    put(
        &folder,
        "brushed.ply",
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        property float u\nproperty float v\nproperty float r\nproperty float g\nproperty float b\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n\
        -1 -1 0 0 0 1 0 0\n1 -1 0 1 0 0 1 0\n0 1 0 0.5 1 0 0 1\n3 0 1 2\n",
    );
    put(
        &folder,
        "scene.xml",
        "<scene version='3.0.0'><sensor type='perspective'/><shape type='ply'>
        <string name='filename' value='brushed.ply'/>
        <bsdf type='roughconductor'><float name='alpha_u' value='0.4'/><float name='alpha_v' value='0.1'/>
        <texture type='mesh_attribute' name='specular_reflectance'><string name='name' value='vertex_color'/></texture>
        </bsdf></shape></scene>",
    );
    let brushed = Scene::build(&load(&folder.path().join("scene.xml")).unwrap(), [4, 4]).unwrap();
    let ray = Ray { origin: Vec3::new(0.0, -0.5, 5.0), direction: Vec3::NEG_Z };
    let u = brushed.intersect(&ray).expect("the triangle").uv.x;
    assert!((u - 0.5).abs() < 1e-5, "{u}");
}

/// A lamp whose picture is half dark: seen, it shows its picture; its power is the picture's mean; and a floor below it gets the same
/// light whether lamps are sampled or only run into. 64² paths in each of 48 pixels: both means have a standard error below 1 %.
#[test]
fn lamps_with_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let pixel = |x: u32, y: u32| image::Rgb(if x < 4 { [0, 0, 0] } else { [255, (y * 30) as u8, 40] });
    RgbImage::from_fn(8, 8, pixel).save_with_format(folder.path().join("lamp.bmp"), ImageFormat::Bmp).unwrap();
    let text = |shape: &str| {
        format!("<scene version='3.0.0'><sensor type='perspective'><float name='fov' value='60'/>
        <transform name='to_world'><lookat origin='0, 0.1, 1.5' target='0, 0, 0' up='0, 1, 0'/></transform></sensor>
        <integrator type='path'><integer name='max_depth' value='2'/></integrator>
        <shape type='rectangle'><bsdf type='diffuse'/></shape>
        <shape type='{shape}'><transform name='to_world'><scale value='0.5'/><rotate x='1' angle='180'/><translate z='2'/></transform>
        <emitter type='area'><texture type='bitmap' name='radiance'><string name='filename' value='lamp.bmp'/></texture></emitter></shape></scene>")
    };
    for shape in ["rectangle", "sphere"] {
        let loaded = read(&folder, &text(shape));
        assert!(!warned(&loaded, "mean of its texture"), "{:?}", loaded.warnings);
        let scene = Scene::build(&loaded, [8, 6]).unwrap();
        let Light::Area(light) = &scene.lights.lights[0] else { panic!("an area light") };
        let mut seen = [0; 2];
        for i in 0..64 {
            let at = Vec2::new((i % 8) as f32 - 3.5, (i / 8) as f32 - 3.5) / 8.5;
            let Some(surface) = scene.intersect(&Ray { origin: at.extend(0.5), direction: Vec3::Z }) else { continue };
            seen[usize::from(light.emitted(&surface, Vec3::NEG_Z).x > 0.5)] += 1;
        }
        assert!(seen[0] >= 16 && seen[1] >= 16, "{shape}: {seen:?}");
        let settings = scenes::settings(scenes::GUIDES[0], 4096, 5);
        let sampled = scenes::mean(&scenes::picture(&scene, &settings));
        let mut blind = settings;
        blind.transport.light_sampling = false;
        let met = scenes::mean(&scenes::picture(&scene, &blind));
        assert!((sampled / met - 1.0).abs() < 0.04, "{shape}: {sampled} {met}");
        if let GeometryFile::Mesh { .. } = loaded.file.shapes[1].geometry {
            let mean = (0..64)
                .map(|i| pixel(i % 8, i / 8).0.map(|x| srgb(f32::from(x) / 255.0)))
                .fold([0.0; 3], |sum, c| [0, 1, 2].map(|k| sum[k] + c[k] / 64.0));
            let power = light.power() / std::f32::consts::PI;
            assert!((power - Vec3::from_array(mean)).abs().max_element() < 0.03, "{power} {mean:?}");
        }
    }
}

fn srgb(x: f32) -> f32 {
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

/// Texts in Latin-1 that say so are read; others that are not UTF-8 are not.
#[test]
fn texts_in_latin_1() {
    let folder = tempfile::tempdir().unwrap();
    let body = |encoding: &str| {
        let mut text = format!("<?xml version='1.0' encoding='{encoding}'?><!-- caf").into_bytes();
        text.push(0xE9);
        text.extend(b" --><scene version='3.0.0'><sensor type='perspective'/></scene>");
        text
    };
    put(&folder, "scene.xml", body("iso-8859-1"));
    assert!(warned(&load(&folder.path().join("scene.xml")).unwrap(), "Latin-1"));
    put(&folder, "scene.xml", body("utf-8"));
    assert!(load(Path::new(&folder.path().join("scene.xml"))).is_err());
}

/// A mesh with several materials (anadodik/sdmm-mitsuba, `mirror-balls`): faces have that of their `usemtl`, under its name; the others
/// have the one without a name, or are grey. Names that no face has change nothing.
#[test]
fn materials_of_faces() {
    let folder = tempfile::tempdir().unwrap();
    put(
        &folder,
        "balls.obj",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nusemtl MirrorBall\nf 2 4 3\nf 1 2 4\nusemtl a glass\nf 1 4 3\nusemtl Floor\nf 1 2 3\n",
    );
    let scene = |materials: &str| {
        read(
            &folder,
            &format!(
                "<scene version='0.5.0'><sensor type='perspective'/><bsdf type='dielectric' id='clear'/>
            <shape type='obj' id='balls'><string name='filename' value='balls.obj'/>{materials}</shape></scene>"
            ),
        )
    };
    let faces = |loaded: &LoadedScene| -> Vec<(usize, MaterialFile)> {
        let of = |shape: &fanal::scene::file::ShapeFile| {
            let GeometryFile::Mesh { mesh } = &shape.geometry else { panic!("{shape:?}") };
            assert_eq!(shape.name, "balls");
            (loaded.meshes[mesh].triangles.len(), loaded.file.materials[&shape.material].clone())
        };
        loaded.file.shapes.iter().map(of).collect()
    };
    let three = "<bsdf type='conductor' name='MirrorBall'/><ref id='clear' name='a glass'/><bsdf type='plastic' name='none of these'/>";
    let loaded = scene(three);
    let [(2, MaterialFile::Conductor { .. }), (1, MaterialFile::Dielectric { .. }), (2, MaterialFile::Diffuse { .. })] =
        &faces(&loaded)[..]
    else {
        panic!("{:?}", faces(&loaded));
    };
    assert!(
        warned(&loaded, "no such faces") && warned(&loaded, "faces of \"\", \"Floor\" have no material"),
        "{:?}",
        loaded.warnings
    );
    let rest = scene(&format!("{three}<bsdf type='null'/>"));
    assert!(matches!(faces(&rest)[2], (2, MaterialFile::Null {})), "{:?}", faces(&rest));
    // Names that are not those of faces, as in exports: the first one is used, as that of a shape with one is whatever its name.
    let other = scene("<bsdf type='conductor' name='bsdf'/><bsdf type='plastic' name='mirrorball'/>");
    assert!(matches!(faces(&other)[..], [(5, MaterialFile::Conductor { .. })]), "{:?}", faces(&other));
    assert!(warned(&other, "a second material of a shape"), "{:?}", other.warnings);
    assert!(matches!(faces(&scene("<bsdf type='conductor' name='Floor'/>"))[..], [(5, _)]));
    // And back through our own format.
    let copy = folder.path().join("copy.json");
    fanal::scene::readers::save(&loaded.file, &copy).unwrap();
    let again = load(&copy).unwrap();
    assert_eq!((&again.file, again.meshes.len()), (&loaded.file, 3));
    let picture = scenes::picture(&Scene::build(&loaded, [4, 4]).unwrap(), &scenes::settings(scenes::GUIDES[0], 1, 1));
    assert_eq!(scenes::mean(&picture), 0.0);
}
