//! What Mitsuba's files of different ages and habits mean: both dialects, instances, colours, pictures, approximations.

use crate::support::scenes;

use std::path::Path;

use fanal::base::Error;
use fanal::picture::read_image;
use fanal::scene::Scene;
use fanal::scene::file::{Filter, LightFile, MaterialFile, PrincipledFile, SceneFile, TextureFile, Wrap};
use fanal::scene::readers::{LoadedScene, load};
use glam::Vec3;
use image::{DynamicImage, ImageFormat, Rgb32FImage, RgbImage};
use tempfile::TempDir;

fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let pixel = |x, y| image::Rgb([(x * 16) as u8, (y * 16) as u8, 128]);
    RgbImage::from_fn(16, 16, pixel).save_with_format(folder.path().join("paint.bmp"), ImageFormat::Bmp).unwrap();
    let sky = |x, y| image::Rgb([x as f32, y as f32, 0.5]);
    let sky = DynamicImage::ImageRgb32F(Rgb32FImage::from_fn(8, 4, sky));
    sky.save_with_format(folder.path().join("sky.hdr"), ImageFormat::Hdr).unwrap();
    std::fs::write(folder.path().join("one.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n")
        .unwrap();
    folder
}

fn load_text(folder: &TempDir, text: &str) -> Result<LoadedScene, Error> {
    let path = folder.path().join("tested.xml");
    std::fs::write(&path, text).unwrap();
    load(&path)
}

fn load_body(folder: &TempDir, version: &str, body: &str) -> Result<LoadedScene, Error> {
    load_text(folder, &format!("<scene version=\"{version}\">\n<sensor type=\"perspective\"/>\n{body}\n</scene>"))
}

const OLD: &str = r##"<?xml version="1.0" encoding="utf-8"?>
<scene version="0.5.0">
    <integrator type="path"><integer name="maxDepth" value="7"/><boolean name="strictNormals" value="true"/></integrator>
    <sensor type="thinlens">
        <float name="fov" value="40"/><string name="fovAxis" value="y"/>
        <float name="apertureRadius" value="0.1"/><float name="focusDistance" value="5"/>
        <transform name="toWorld"><lookAt origin="0, 1, 6" target="0, 1, 0" up="0, 1, 0"/></transform>
        <sampler type="ldsampler"><integer name="sampleCount" value="16"/></sampler>
        <film type="ldrfilm">
            <integer name="width" value="24"/><integer name="height" value="16"/>
            <string name="fileFormat" value="png"/><boolean name="banner" value="false"/><float name="gamma" value="2.2"/>
            <rfilter type="box"/>
        </film>
    </sensor>
    <texture type="bitmap" id="paint">
        <string name="filename" value="paint.bmp"/><float name="uscale" value="2"/><float name="voffset" value="0.25"/>
        <float name="gamma" value="1"/><string name="wrapMode" value="mirror"/><string name="filterType" value="nearest"/>
    </texture>
    <bsdf type="diffuse" id="painted"><ref name="reflectance" id="paint"/></bsdf>
    <bsdf type="roughplastic" id="coat">
        <srgb name="diffuseReflectance" value="#ff8000"/><float name="intIOR" value="1.5"/><float name="extIOR" value="1"/>
        <float name="alpha" value="0.2"/>
    </bsdf>
    <bsdf type="twosided" id="metal"><bsdf type="conductor"/></bsdf>
    <bsdf type="dielectric" id="glass"><spectrum name="specularTransmittance" value="1, 0.5, 0.25"/></bsdf>
    <shape type="rectangle"><transform name="toWorld"><rotate x="1" angle="-90"/><scale value="4"/></transform><ref id="painted"/></shape>
    <shape type="sphere"><point name="center" x="-2" y="1" z="0"/><ref id="coat"/></shape>
    <shape type="sphere"><point name="center" x="2" y="1" z="0"/><float name="radius" value="0.5"/><ref id="glass"/></shape>
    <shape type="obj"><string name="filename" value="one.obj"/><boolean name="faceNormals" value="true"/><ref id="metal"/></shape>
    <shape type="sphere"><point name="center" x="0" y="4" z="0"/><boolean name="flipNormals" value="false"/>
        <emitter type="area"><spectrum name="radiance" value="3"/></emitter></shape>
    <emitter type="spot"><float name="cutoffAngle" value="40"/><float name="samplingWeight" value="2"/></emitter>
    <emitter type="envmap"><string name="filename" value="sky.hdr"/><float name="scale" value="0.1"/></emitter>
</scene>"##;

const NEW: &str = r##"<scene version="3.0.0">
    <integrator type="path"><integer name="max_depth" value="7"/></integrator>
    <sensor type="thinlens">
        <float name="fov" value="40"/><string name="fov_axis" value="y"/>
        <float name="aperture_radius" value="0.1"/><float name="focus_distance" value="5"/>
        <transform name="to_world"><lookat origin="0, 1, 6" target="0, 1, 0" up="0, 1, 0"/></transform>
        <sampler type="independent"><integer name="sample_count" value="16"/></sampler>
        <film type="hdrfilm">
            <integer name="width" value="24"/><integer name="height" value="16"/><rfilter type="box"/>
        </film>
    </sensor>
    <texture type="bitmap" id="paint">
        <string name="filename" value="paint.bmp"/><boolean name="raw" value="true"/>
        <transform name="to_uv"><scale x="2"/><translate y="0.25"/></transform>
        <string name="wrap_mode" value="mirror"/><string name="filter_type" value="nearest"/>
    </texture>
    <bsdf type="diffuse" id="painted"><ref name="reflectance" id="paint"/></bsdf>
    <bsdf type="roughplastic" id="coat">
        <rgb name="diffuse_reflectance" value="#ff8000"/><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/>
        <float name="alpha" value="0.2"/>
    </bsdf>
    <bsdf type="twosided" id="metal"><bsdf type="conductor"><string name="material" value="Cu"/></bsdf></bsdf>
    <bsdf type="dielectric" id="glass"><rgb name="specular_transmittance" value="1 0.5 0.25"/></bsdf>
    <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="4"/></transform><ref id="painted"/></shape>
    <shape type="sphere"><point name="center" x="-2" y="1" z="0"/><ref id="coat"/></shape>
    <shape type="sphere"><point name="center" x="2" y="1" z="0"/><float name="radius" value="0.5"/><ref name="bsdf" id="glass"/></shape>
    <shape type="obj"><string name="filename" value="one.obj"/><boolean name="face_normals" value="true"/><ref id="metal"/></shape>
    <shape type="sphere"><point name="center" value="0 4 0"/><emitter type="area"><rgb name="radiance" value="3"/></emitter></shape>
    <emitter type="spot"><float name="cutoff_angle" value="40"/></emitter>
    <emitter type="envmap"><string name="filename" value="sky.hdr"/><float name="scale" value="0.1"/></emitter>
</scene>"##;

/// The same scene in the words of 0.5 and of 3: the same file, and the same picture bit for bit.
#[test]
fn s09_both_dialects_give_the_same_picture() {
    let folder = folder();
    let [old, new] = [OLD, NEW].map(|text| load_text(&folder, text).unwrap_or_else(|error| panic!("{error}")));
    assert_eq!(old.file, new.file);
    assert_eq!(old.images, new.images);
    assert_eq!((&old.warnings, &new.warnings), (&vec![], &vec![]));
    assert!(matches!(new.file.materials["glass"], MaterialFile::Tinted { .. }));
    let [old, new] = [old, new].map(|loaded| {
        let scene = Scene::build(&loaded, [24, 16]).unwrap();
        scenes::picture(&scene, &scenes::settings(scenes::GUIDES[0], 4, 1))
    });
    assert_eq!(old, new);
    assert!(scenes::mean(&old) > 0.01, "{}", scenes::mean(&old));
}

#[test]
fn instances_place_the_group_again() {
    let folder = folder();
    let body = r#"<shape type="shapegroup" id="pair">
            <shape type="obj"><string name="filename" value="one.obj"/><transform name="to_world"><scale value="2"/></transform>
                <bsdf type="plastic"/></shape>
            <shape type="sphere"><float name="radius" value="0.5"/></shape>
        </shape>
        <shape type="instance"><ref id="pair"/><transform name="to_world"><translate x="1"/></transform></shape>
        <shape type="instance"><ref id="pair"/><transform name="to_world"><rotate z="1" angle="90"/></transform></shape>"#;
    let loaded = load_body(&folder, "3.0.0", body).unwrap();
    let file = &loaded.file;
    assert_eq!((file.shapes.len(), file.meshes.len(), file.materials.len()), (4, 1, 2));
    assert_eq!(file.shapes[0].to_world, [2., 0., 0., 1., 0., 2., 0., 0., 0., 0., 2., 0., 0., 0., 0., 1.]);
    assert!((file.shapes[2].to_world[4] - 2.0).abs() < 1e-6, "scaled, then turned");
    assert_eq!(file.shapes[0].material, file.shapes[2].material);
    for (wrong, why) in [
        ("<shape type='shapegroup'><shape type='sphere'><emitter type='area'/></shape></shape>", "emits"),
        ("<shape type='shapegroup'><shape type='instance'/></shape>", "inside a shapegroup"),
        ("<shape type='instance'/>", "shapegroup"),
        ("<shape type='sphere' id='s'/><shape type='instance'><ref id='s'/></shape>", "shapegroup"),
    ] {
        let message = load_body(&folder, "3.0.0", wrong).expect_err(why).to_string();
        assert!(message.contains("tested.xml:3: ") && message.contains(why), "{message}");
    }
}

/// Every way to write a colour; values of the spectra as Mitsuba 3.9.1 has them in its RGB mode.
#[test]
fn colours() {
    let folder = folder();
    let diffuse = |color: &str| {
        let loaded = load_body(&folder, "3.0.0", &format!("<bsdf type='diffuse' id='d'>{color}</bsdf>"));
        match &loaded.unwrap_or_else(|error| panic!("{error}")).file.materials["d"] {
            MaterialFile::Diffuse { reflectance: TextureFile::Rgb { value } } => *value,
            other => panic!("{other:?}"),
        }
    };
    let light = |version: &str, color: &str| {
        let loaded = load_body(&folder, version, &format!("<emitter type='point'>{color}</emitter>"));
        match loaded.unwrap_or_else(|error| panic!("{error}")).file.lights[0] {
            LightFile::Point { intensity, .. } => intensity,
            ref other => panic!("{other:?}"),
        }
    };
    let near = |a: [f32; 3], b: [f32; 3]| {
        assert!(a.iter().zip(b).all(|(x, y)| (x - y).abs() <= 0.005 * y.max(0.5)), "{a:?} {b:?}");
    };
    near(diffuse("<rgb name='reflectance' value='0.25'/>"), [0.25; 3]);
    near(diffuse("<rgb name='reflectance' value='#ff0080'/>"), [1.0, 0.0, 0.2159]);
    near(diffuse("<srgb name='reflectance' value='0.5'/>"), [0.2140; 3]);
    near(diffuse("<spectrum name='reflectance' value='0.3'/>"), [0.3; 3]);
    near(diffuse("<spectrum name='reflectance' value='400:0.1, 700:0.9'/>"), [0.742853, 0.48114, 0.208325]);
    near(diffuse("<spectrum name='reflectance' type='uniform'><float name='value' value='0.3'/></spectrum>"), [0.3; 3]);
    near(light("3.0.0", "<spectrum name='intensity' value='400:0.1 700:0.9'/>"), [0.872215, 0.458728, 0.181301]);
    near(light("3.0.0", "<spectrum name='intensity' value='0.3'/>"), [0.361438, 0.284487, 0.272675]);
    near(light("0.6.0", "<spectrum name='intensity' value='0.3'/>"), [0.3; 3]);
    near(light("0.6.0", "<spectrum name='intensity' value='1, 2, 3'/>"), [1.0, 2.0, 3.0]);
    near(light("3.0.0", "<spectrum name='intensity' type='d65'/>"), [1.0; 3]);
    // 3000 K is redder than 6500 K, which is nearly white; both follow Stefan and Boltzmann's growth.
    let [warm, white] = ["3000K", "6500"]
        .map(|kelvin| light("0.6.0", &format!("<blackbody name='intensity' temperature='{kelvin}' scale='0.001'/>")));
    assert!(warm[0] > 3.0 * warm[2] && (white[0] / white[2] - 1.0).abs() < 0.1 && white[1] > 10.0 * warm[1]);
    for wrong in ["<rgb name='reflectance' value='#12'/>", "<spectrum name='reflectance' value='500:1, 400:1'/>"] {
        let result = load_body(&folder, "3.0.0", &format!("<bsdf type='diffuse' id='d'>{wrong}</bsdf>"));
        assert!(matches!(result, Err(Error::Malformed { .. })), "{wrong}");
    }
}

/// 0.6 sees spectra of wavelengths under equal energy, Mitsuba 3 under D65: the white of the classic Cornell box (its values every 20 nm).
#[test]
fn spectra_of_old_files() {
    let folder = folder();
    let white = "400:0.343, 420:0.687, 440:0.745, 460:0.765, 480:0.745, 500:0.747, 520:0.735, 540:0.737, 560:0.737, \
        580:0.737, 600:0.740, 620:0.741, 640:0.742, 660:0.739, 680:0.736, 700:0.737";
    let of = |version: &str| {
        let body = format!("<bsdf type='diffuse' id='d'><spectrum name='reflectance' value='{white}'/></bsdf>");
        let loaded = load_body(&folder, version, &body).unwrap_or_else(|error| panic!("{error}"));
        let MaterialFile::Diffuse { reflectance: TextureFile::Rgb { value } } = loaded.file.materials["d"] else {
            panic!("one colour")
        };
        value
    };
    let near = |a: [f32; 3], b: [f32; 3]| (0..3).all(|i| (a[i] - b[i]).abs() < 0.015);
    assert!(near(of("0.6.0"), [0.886, 0.699, 0.666]), "{:?}", of("0.6.0"));
    assert!(near(of("3.0.0"), [0.737, 0.742, 0.736]), "{:?}", of("3.0.0"));
}

/// 0.6 takes the last of several values, and a texture before any; Mitsuba 3 refuses them. And what else files of its time have.
#[test]
fn habits_of_old_files() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("maps")).unwrap();
    std::fs::copy(folder.path().join("paint.bmp"), folder.path().join("maps/paint.bmp")).unwrap();
    let twice = "<bsdf type='diffuse' id='d'><texture type='bitmap' name='reflectance'>\
        <string name='filename' value='maps\\paint.bmp'/></texture><spectrum name='reflectance' value='0.3'/></bsdf>
        <bsdf type='roughplastic' id='p'><float name='alpha' value='0.2'/><float name='alpha' value='0.4'/></bsdf>";
    let loaded = load_body(&folder, "0.6.0", twice).unwrap_or_else(|error| panic!("{error}"));
    let MaterialFile::Diffuse { reflectance: TextureFile::Bitmap { file, .. } } = &loaded.file.materials["d"] else {
        panic!("{:?}", loaded.file.materials["d"])
    };
    assert_eq!(file, "maps/paint.bmp");
    assert!(matches!(loaded.file.materials["p"], MaterialFile::Plastic { alpha: 0.4, .. }), "the last");
    assert_eq!(loaded.warnings.iter().filter(|warning| warning.contains("is given twice")).count(), 2);
    assert!(load_body(&folder, "3.0.0", twice).expect_err("twice").to_string().contains("given twice"));
    // A spectrum whose type is a texture's.
    let texture = "<bsdf type='diffuse' id='d'><spectrum type='bitmap' name='reflectance'>\
        <string name='filename' value='paint.bmp'/></spectrum></bsdf>";
    let loaded = load_body(&folder, "3.0.0", texture).unwrap_or_else(|error| panic!("{error}"));
    assert!(matches!(loaded.file.materials["d"], MaterialFile::Diffuse { reflectance: TextureFile::Bitmap { .. } }));
    // Without a direction up each version has its own.
    for (version, up) in [("0.6.0", [0.0, -1.0, 0.0]), ("3.0.0", [0.0, 0.0, -1.0])] {
        let text = format!(
            "<scene version='{version}'><sensor type='perspective'><transform name='to_world'>\
            <lookat origin='0 0 0' target='4 0 0'/></transform></sensor></scene>"
        );
        let camera = load_text(&folder, &text).unwrap_or_else(|error| panic!("{error}")).file.camera.to_world;
        assert_eq!([camera[1], camera[5], camera[9]].map(|x| x + 0.0), up, "{version}: {camera:?}");
    }
    // The medium around a camera, by any name.
    let camera = "<scene version='0.6.0'><medium type='homogeneous' id='fog'/><sensor type='perspective'>\
        <ref name='interior' id='fog'/></sensor></scene>";
    let loaded = load_text(&folder, camera).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(loaded.file.camera.medium.as_deref(), Some("fog"));
}

/// What is done in another way is read, and said with its line.
#[test]
fn approximations_are_named() {
    let folder = folder();
    let board = "<texture type='checkerboard' name='alpha'/>";
    for (version, body, what) in [
        (
            "3.0.0",
            "<bsdf type='roughconductor'><texture type='checkerboard' name='alpha_u'/></bsdf>".into(),
            "the mean of its texture",
        ),
        (
            "3.0.0",
            "<bsdf type='roughplastic'><float name='alpha_u' value='0.1'/><float name='alpha_v' value='0.4'/></bsdf>"
                .into(),
            "geometric mean",
        ),
        ("3.0.0", "<bsdf type='twosided'><bsdf type='diffuse'/><bsdf type='plastic'/></bsdf>".into(), "both sides"),
        ("0.6.0", "<emitter type='collimated'/>".into(), "emitter \"collimated\" is left out"),
        ("0.6.0", "<bsdf type='irawan'/>".into(), "a diffuse surface stands in"),
        ("0.6.0", "<bsdf type='varnish'><bsdf type='plastic'/></bsdf>".into(), "the one inside is used"),
        ("3.0.0", "<shape type='sdfgrid'/>".into(), "shape \"sdfgrid\" is not known: it is left out"),
        ("3.0.0", "<shape type='cube'><bsdf type='diffuse'/><bsdf type='plastic'/></shape>".into(), "the first one"),
        ("3.0.0", "<shape type='cube'><bsdf type='null'/><emitter type='area'/></shape>".into(), "read as black"),
        ("3.0.0", "<include filename='../lights.xml'/>".into(), "the include is left out"),
        ("3.0.0", "<bsdf type='hair'><float name='eumelanin' value='0.3'/></bsdf>".into(), "hair is read as"),
        ("3.0.0", "<bsdf type='pplastic'><float name='alpha' value='0.3'/></bsdf>".into(), "not polarised"),
        ("3.0.0", "<boolean name='embree_use_robust_intersection' value='true'/>".into(), "is not used"),
        (
            "0.6.0",
            "<bsdf type='phong'><rgb name='diffuseReflectance' value='0'/>\
            <rgb name='specularReflectance' value='9 9 3'/></bsdf>"
                .into(),
            "scaled down to 1",
        ),
        ("3.0.0", "<integrator type='prb'/>".into(), "instead of the integrator \"prb\""),
        (
            "3.0.0",
            "<sensor type='perspective'><film type='hdrfilm'><rfilter type='box'/></film></sensor>".into(),
            "first sensor",
        ),
        ("0.6.0", "<bsdf type='phong'><float name='exponent' value='50'/></bsdf>".into(), "roughplastic with alpha"),
        ("0.6.0", "<bsdf type='ward'/>".into(), "roughplastic with alpha"),
        ("0.6.0", "<bsdf type='coating'><bsdf type='diffuse'/></bsdf>".into(), "coating is left out"),
        ("0.6.0", format!("<bsdf type='roughdiffuse'>{board}</bsdf>"), "the mean of its texture"),
        ("0.6.0", "<bsdf type='roughconductor'><string name='distribution' value='as'/></bsdf>".into(), "beckmann"),
    ] {
        let loaded = load_body(&folder, version, &body).unwrap_or_else(|error| panic!("{error}"));
        let said = loaded.warnings.iter().any(|warning| warning.contains("tested.xml:3: ") && warning.contains(what));
        assert!(said, "{body}: {:?}", loaded.warnings);
    }
    let loaded = load_text(&folder, "<scene><sensor type='perspective'/></scene>").unwrap();
    assert!(loaded.warnings[0].contains("read as 0.6"), "{:?}", loaded.warnings);
    for (version, body, supported) in [
        ("4.0.0", "", "3.x"),
        ("3.0.0", "<integrator type='aov' id='a'><ref id='a'/></integrator>", "inside one another"),
        (
            "3.0.0",
            "<texture type='scale' id='a'><ref id='a'/></texture><bsdf type='diffuse'><ref name='reflectance' id='a'/></bsdf>",
            "inside one another",
        ),
    ] {
        let message = load_body(&folder, version, body).expect_err(body).to_string();
        assert!(message.contains("tested.xml:") && message.contains(supported), "{message}");
    }
    let distant = "<scene version='3.0.0'><sensor type='distant'/></scene>";
    let loaded = load_text(&folder, distant).unwrap_or_else(|error| panic!("{error}"));
    assert!(
        loaded.warnings[0].contains("distant") && loaded.warnings[0].contains("perspective"),
        "{:?}",
        loaded.warnings
    );
    let message = load_text(&folder, "<scene version='3.0.0'/>").expect_err("nothing").to_string();
    assert!(message.contains("neither sensor nor shapes"), "{message}");
}

/// A default holds from where it stands to the end of the scene, wherever that is; the first one of a name stands.
#[test]
fn defaults_hold_inside_objects() {
    let folder = folder();
    for version in ["0.6.0", "3.0.0"] {
        let body = r#"<bsdf type="diffuse" id="a"><default name="grey" value="0.25"/><rgb name="reflectance" value="$grey"/></bsdf>
            <shape type="sphere"><emitter type="area"><default name="grey" value="0.75"/><default name="power" value="7"/>
            <rgb name="radiance" value="$power"/></emitter></shape>
            <bsdf type="twosided" id="b"><bsdf type="diffuse"><rgb name="reflectance" value="$grey"/></bsdf></bsdf>"#;
        let loaded = load_body(&folder, version, body).unwrap_or_else(|error| panic!("{error}"));
        let grey = MaterialFile::Diffuse { reflectance: TextureFile::rgb([0.25; 3]) };
        assert_eq!((&loaded.file.materials["a"], loaded.file.materials["b"].innermost()), (&grey, &grey));
        assert_eq!(loaded.file.shapes[0].emission, Some([7.0; 3]));
        assert_eq!(loaded.warnings, Vec::<String>::new());
        let early =
            r#"<bsdf type="diffuse"><rgb name="reflectance" value="$grey"/></bsdf><default name="grey" value="1"/>"#;
        let message = load_body(&folder, version, early).expect_err("used before it is there").to_string();
        assert!(message.contains("tested.xml:3: ") && message.contains("$grey"), "{message}");
    }
}

/// What an object has no use for is said, once for all that are alike; what looks like a slip of the pen is an error.
#[test]
fn unused_properties_are_named() {
    let folder = folder();
    let body = "<bsdf type='diffuse' id='d'><float name='sheen' value='1'/>\
            <texture type='bitmap' name='dirt'><string name='filename' value='none.png'/></texture></bsdf>
        <shape type='cube'><integer name='importance' value='2'/><ref id='d'/></shape>
        <shape type='cube'><integer name='importance' value='many'/><ref id='d'/></shape>
        <emitter type='point'><ref name='glow' id='c'/><spectrum name='intensity' value='1'/></emitter>
        <rgb id='c' value='1'/>";
    for version in ["0.6.0", "3.0.0"] {
        let mut warnings = load_body(&folder, version, body).unwrap_or_else(|error| panic!("{error}")).warnings;
        let place = folder.path().join("tested.xml").display().to_string();
        warnings.iter_mut().for_each(|warning| *warning = warning.replacen(&place, "tested.xml", 1));
        let told = [
            "tested.xml:3: the property \"sheen\" of the bsdf \"diffuse\" is not used",
            "tested.xml:3: the property \"dirt\" of the bsdf \"diffuse\" is not used",
            "tested.xml:4: the property \"importance\" of the shape \"cube\" is not used, nor are 1 more like it",
            "tested.xml:6: the property \"glow\" of the emitter \"point\" is not used",
        ];
        assert_eq!(warnings, told, "{version}");
    }
    for (version, wrong, near) in [
        ("3.0.0", "<bsdf type='diffuse'><rgb name='relfectance' value='1'/></bsdf>", "reflectance"),
        ("0.6.0", "<shape type='sphere'><transform name='toWolrd'/></shape>", "to_world"),
        ("0.6.0", "<bsdf type='roughplastic'><float name='alhpa' value='1'/></bsdf>", "alpha"),
        ("0.6.0", "<integrator type='path'><integer name='maxDeptj' value='1'/></integrator>", "max_depth"),
        ("3.0.0", "<emitter type='point'><ref name='intensety' id='c'/></emitter><rgb id='c' value='1'/>", "intensity"),
    ] {
        let message = load_body(&folder, version, wrong).expect_err(near).to_string();
        assert!(message.contains("tested.xml:3: ") && message.contains(&format!("\"{near}\" seems")), "{message}");
    }
}

/// Shapes without area are left out, with their lines; instances with that of the instance.
#[test]
fn shapes_without_area_are_left_out() {
    let folder = folder();
    std::fs::write(folder.path().join("line.obj"), "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n").unwrap();
    std::fs::write(folder.path().join("bare.obj"), "v 0 0 0\nv 1 0 0\n").unwrap();
    let body = "<shape type='obj' id='line'><string name='filename' value='line.obj'/></shape>
        <shape type='obj'><string name='filename' value='bare.obj'/><emitter type='area'/></shape>
        <shape type='cylinder'><float name='radius' value='0'/></shape>
        <shape type='cylinder'><point name='p1' x='0' y='0' z='0'/></shape>
        <shape type='rectangle'><transform name='to_world'><scale x='0'/></transform></shape>
        <shape type='sphere'><float name='radius' value='0'/><emitter type='area'/></shape>
        <shape type='shapegroup' id='g'><shape type='obj'><string name='filename' value='line.obj'/></shape></shape>
        <shape type='instance'><ref id='g'/></shape>
        <shape type='obj' id='kept'><string name='filename' value='one.obj'/></shape>";
    let loaded = load_body(&folder, "3.0.0", body).unwrap_or_else(|error| panic!("{error}"));
    let names: Vec<&str> = loaded.file.shapes.iter().map(|shape| shape.name.as_str()).collect();
    assert_eq!(names, ["kept"]);
    assert_eq!(loaded.meshes.keys().collect::<Vec<_>>(), ["cylinder", "one.obj", "rectangle"]);
    assert!(loaded.file.meshes.keys().eq(loaded.meshes.keys()));
    for (line, told) in [
        (3, "the shape \"line\" is left out: "),
        (3, "line.obj: the mesh has no triangles with an area (1 without)"),
        (4, "the shape, which emits light, is left out: "),
        (4, "bare.obj: the mesh has no triangles"),
        (5, "the shape is left out: it has no area"),
        (6, "the shape is left out: it has no area"),
        (7, "the shape is left out: it has no area"),
        (8, "the shape, which emits light, is left out: it has no area"),
        (10, "line.obj: the mesh has no triangles with an area (1 without)"),
    ] {
        let place = format!("tested.xml:{line}: ");
        let said = loaded.warnings.iter().any(|warning| warning.contains(&place) && warning.contains(told));
        assert!(said, "{line}, {told}: {:#?}", loaded.warnings);
    }
    assert!(Scene::build(&loaded, [4, 4]).is_ok());
}

/// A picture comes back from every format, within what the format loses; damage to any byte is an error or other values.
#[test]
fn picture_formats() {
    let folder = folder();
    let smooth = |x: u32, y: u32| image::Rgb([100 + 4 * x as u8, 120 + 3 * y as u8, 140]);
    let picture = DynamicImage::ImageRgb8(RgbImage::from_fn(16, 12, smooth));
    for (name, format, loss) in
        [("a.bmp", ImageFormat::Bmp, 1e-6), ("a.tga", ImageFormat::Tga, 1e-6), ("a.jpg", ImageFormat::Jpeg, 0.06)]
    {
        let path = folder.path().join(name);
        picture.save_with_format(&path, format).unwrap();
        let read = read_image(&path, true).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!((read.width, read.height), (16, 12));
        for (i, pixel) in read.pixels.iter().enumerate() {
            let image::Rgb(wanted) = smooth(i as u32 % 16, i as u32 / 16);
            let wanted = glam::Vec3::from_array(wanted.map(|x| f32::from(x) / 255.0));
            assert!((*pixel - wanted).abs().max_element() <= loss, "{name} {i}: {pixel} {wanted}");
        }
        let linear = read_image(&path, false).unwrap().pixels[0];
        assert!(linear.x < read.pixels[0].x, "sRGB values become darker");
        damage(&path);
    }
    let sky = read_image(&folder.path().join("sky.hdr"), false).unwrap();
    assert_eq!((sky.pixels[3], sky.pixels[8 + 1].y), (glam::Vec3::new(3.0, 0.0, 0.5), 1.0));
    // Others begin with another name.
    let bytes = std::fs::read(folder.path().join("sky.hdr")).unwrap();
    let end = bytes.iter().position(|&byte| byte == b'\n').unwrap();
    std::fs::write(folder.path().join("rgbe.hdr"), [b"#?RGBE", &bytes[end..]].concat()).unwrap();
    assert_eq!(read_image(&folder.path().join("rgbe.hdr"), false).unwrap(), sky);
    damage(&folder.path().join("sky.hdr"));
    // 65535 × 65535 pixels in a header alone.
    let mut huge = vec![0u8; 18];
    huge[2] = 2;
    huge[12..16].fill(0xFF);
    huge[16] = 24;
    std::fs::write(folder.path().join("huge.tga"), &huge).unwrap();
    let error = read_image(&folder.path().join("huge.tga"), true).unwrap_err();
    assert!(matches!(error, Error::Limit { .. } | Error::Malformed { .. }), "{error}");
}

fn damage(path: &Path) {
    let whole = std::fs::read(path).unwrap();
    for at in 0..whole.len() {
        for flip in [0xFF, 0x01, 0x80] {
            let mut bytes = whole.clone();
            bytes[at] ^= flip;
            std::fs::write(path, &bytes).unwrap();
            let _ = read_image(path, false);
        }
        std::fs::write(path, &whole[..at]).unwrap();
        let _ = read_image(path, false);
    }
}

/// OBJ counts v from the bottom, PLY from the top; `flip_tex_coords` says otherwise.
#[test]
fn texture_coordinates_flip() {
    let folder = folder();
    let uvs = |option: &str| {
        let body = format!("<shape type='obj'><string name='filename' value='one.obj'/>{option}</shape>");
        let loaded = load_body(&folder, "3.0.0", &body).unwrap_or_else(|error| panic!("{error}"));
        loaded.meshes.values().next().unwrap().uvs.clone()
    };
    let (turned, kept) = (uvs(""), uvs("<boolean name='flip_tex_coords' value='false'/>"));
    assert!(turned.iter().zip(&kept).all(|(a, b)| a.x == b.x && a.y == 1.0 - b.y) && kept[2].y == 1.0);
}

/// Colours fitted to spectra have negative indices of refraction here and there. Only squares count, so they are as good as positive
/// ones: value of `roughconductor` in Mitsuba 3.7.1 (`scalar_rgb`), which is the same for both. An index around the metal divides.
#[test]
fn negative_indices_of_metals() {
    let folder = folder();
    let metal = |version: &str, kind: &str, body: &str| {
        let text = format!("<bsdf type='{kind}' id='m'>{body}</bsdf><shape type='sphere'><ref id='m'/></shape>");
        load_body(&folder, version, &text)
    };
    let value = |eta: &str, k: &str| {
        let body =
            format!("<float name='alpha' value='0.4'/><rgb name='eta' value='{eta}'/><rgb name='k' value='{k}'/>");
        let loaded = metal("3.0.0", "roughconductor", &body).unwrap_or_else(|error| panic!("{error}"));
        let scene = Scene::build(&loaded, [1, 1]).unwrap();
        let [wo, wi] = [glam::Vec3::new(0.6, 0.0, 0.8), glam::Vec3::new(-0.5, 0.1, 0.86).normalize()];
        scene.materials()[0].eval(glam::Vec2::ZERO, wo, wi)
    };
    let negative = value("-0.14 0.4 1.4", "3.9 -2.4 1.6");
    assert_eq!(negative, value("0.14 0.4 1.4", "3.9 2.4 1.6"));
    assert!((negative - glam::Vec3::new(0.582085, 0.47751, 0.199135)).abs().max_element() < 1e-3, "{negative}");
    let index = "<rgb name='eta' value='-1.333, 2.666, 4'/><rgb name='k' value='1.333'/>";
    let loaded = metal("0.6.0", "conductor", &format!("{index}<string name='extEta' value='water'/>")).unwrap();
    let MaterialFile::Conductor { eta, k, .. } = loaded.file.materials["m"] else { panic!() };
    assert!((eta[0] + 1.0).abs() < 1e-4 && (eta[1] - 2.0).abs() < 1e-4 && (k[2] - 1.0).abs() < 1e-4, "{eta:?} {k:?}");
    let wrong = metal("3.0.0", "conductor", &format!("{index}<float name='ext_eta' value='0'/>"));
    assert!(wrong.expect_err("an index of 0").to_string().contains("ext_eta is 0"));
}

/// Texture options survive the way through the JSON model's names.
#[test]
fn texture_options() {
    let json = r#"{"type": "bitmap", "file": "a.png", "wrap": "clamp", "filter": "nearest"}"#;
    let texture: TextureFile = serde_json::from_str(json).unwrap();
    assert!(matches!(texture, TextureFile::Bitmap { wrap: Wrap::Clamp, filter: Filter::Nearest, .. }));
}

/// Materials of principled and bumped surfaces in XML and in JSON.
#[test]
fn principled_and_bumps() {
    let folder = folder();
    let paint = "<texture type='bitmap'><string name='filename' value='paint.bmp'/><boolean name='raw' value='true'/></texture>";
    let body = format!(
        "<bsdf type='principled' id='p'><texture name='base_color' type='bitmap'><string name='filename' \
        value='paint.bmp'/></texture><float name='roughness' value='0.3'/><float name='specular' value='0.5'/>\
        <float name='clearcoat' value='0.8'/></bsdf>\
        <bsdf type='twosided' id='b'><bsdf type='bumpmap'>{paint}<float name='scale' value='2'/><bsdf type='diffuse'/></bsdf></bsdf>\
        <bsdf type='normalmap' id='n'>{paint}<bsdf type='blendbsdf'><float name='weight' value='0.25'/>\
        <bsdf type='diffuse'/><bsdf type='conductor'/></bsdf></bsdf>"
    );
    let loaded = load_body(&folder, "3.0.0", &body).unwrap_or_else(|error| panic!("{error}"));
    let MaterialFile::Principled(PrincipledFile { base_color: TextureFile::Bitmap { .. }, eta, clearcoat, .. }) =
        &loaded.file.materials["p"]
    else {
        panic!("{:?}", loaded.file.materials["p"]);
    };
    assert!((eta - 1.5).abs() < 1e-5 && *clearcoat == 0.8);
    assert!(loaded.file.materials["b"].is_bumped() && loaded.file.materials["b"].is_two_sided());
    assert_eq!(loaded.file.materials["n"].parts().len(), 2);
    assert_eq!(loaded.warnings.len(), 1, "{:?}", loaded.warnings);
    let copy = folder.path().join("copy.json");
    fanal::scene::readers::save(&loaded.file, &copy).unwrap();
    assert_eq!(load(&copy).unwrap().file, loaded.file);
    for (wrong, why) in [
        ("<bsdf type='principled' id='a'><float name='sheen' value='2'/></bsdf>".to_owned(), "from 0 to 1"),
        ("<bsdf type='principled' id='a'><float name='eta' value='0.5'/></bsdf>".to_owned(), "at least 1"),
        (
            "<bsdf type='twosided' id='a'><bsdf type='principled'><float name='spec_trans' value='1'/></bsdf></bsdf>"
                .to_owned(),
            "two-sided",
        ),
        ("<bsdf type='bumpmap' id='a'><bsdf type='diffuse'/></bsdf>".to_owned(), "needs a texture"),
        (
            format!(
                "<bsdf type='bumpmap' id='a'>{paint}<bsdf type='normalmap'>{paint}<bsdf type='diffuse'/></bsdf></bsdf>"
            ),
            "inside another",
        ),
        ("<bsdf type='blendbsdf' id='a'><bsdf type='diffuse'/></bsdf>".to_owned(), "two bsdfs"),
    ] {
        let message = load_body(&folder, "3.0.0", &wrong).expect_err(why).to_string();
        assert!(message.contains("tested.xml:3: ") && message.contains(why), "{message}");
    }
}

/// Oren and Nayar's surface in the words of 0.6 and in JSON.
#[test]
fn rough_diffuse() {
    let folder = folder();
    let body = "<bsdf type='roughdiffuse' id='a'/><bsdf type='roughdiffuse' id='b'><rgb name='diffuseReflectance' value='0.1, 0.2, 0.3'/>\
        <float name='alpha' value='0.7'/><boolean name='useFastApprox' value='true'/></bsdf>";
    let loaded = load_body(&folder, "0.6.0", body).unwrap_or_else(|error| panic!("{error}"));
    let material = |value, alpha, qualitative| MaterialFile::RoughDiffuse {
        reflectance: TextureFile::rgb(value),
        alpha,
        qualitative,
    };
    assert_eq!(loaded.file.materials["a"], material([0.5; 3], 0.2, false));
    assert_eq!(loaded.file.materials["b"], material([0.1, 0.2, 0.3], 0.7, true));
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    let copy = folder.path().join("copy.json");
    fanal::scene::readers::save(&loaded.file, &copy).unwrap();
    assert_eq!(load(&copy).unwrap().file, loaded.file);
    let wrong = "<bsdf type='roughdiffuse' id='a'><float name='alpha' value='-0.1'/></bsdf>";
    let message = load_body(&folder, "0.6.0", wrong).expect_err("a negative roughness").to_string();
    assert!(message.contains("tested.xml:3: ") && message.contains("alpha"), "{message}");
}

/// A ball of albedo 0.8 with a map under a sky of 1: it sends back at most 0.8, and not much less. 256 paths in each of some hundred
/// pixels leave a standard error below 0.002. A flat map changes no bit; a strong one does, and leaks no light.
#[test]
fn bumps_keep_energy() {
    let folder = folder();
    let put = |name: &str, pixel: &dyn Fn(u32, u32) -> [u8; 3]| {
        let picture = RgbImage::from_fn(16, 16, |x, y| image::Rgb(pixel(x, y)));
        picture.save_with_format(folder.path().join(name), ImageFormat::Bmp).unwrap();
    };
    put("flat.bmp", &|_, _| [90; 3]);
    put("rough.bmp", &|x, y| [((x * 7 + y * 13) % 16 * 16) as u8; 3]);
    let render = |bsdf: &str| {
        let text = format!(
            "<scene version='3.0.0'><integrator type='path'><integer name='max_depth' value='20'/></integrator>\
            <sensor type='perspective'><float name='fov' value='14'/><transform name='to_world'>\
            <lookat origin='0 -5 0' target='0 0 0' up='0 0 1'/></transform></sensor>\
            <emitter type='constant'/><shape type='sphere'>{bsdf}</shape></scene>"
        );
        let loaded = load_text(&folder, &text).unwrap_or_else(|error| panic!("{error}"));
        let scene = Scene::build(&loaded, [12, 12]).unwrap();
        scenes::picture(&scene, &scenes::settings(scenes::GUIDES[0], 256, 3))
    };
    let plain = "<bsdf type='diffuse'><rgb name='reflectance' value='0.8'/></bsdf>";
    let bumped = |file: &str, inner: &str| {
        let texture = format!("<texture type='bitmap'><string name='filename' value='{file}'/></texture>");
        format!("<bsdf type='bumpmap'>{texture}<float name='scale' value='0.5'/>{inner}</bsdf>")
    };
    let smooth = render(plain);
    assert_eq!(render(&bumped("flat.bmp", plain)), smooth);
    assert!((scenes::mean(&smooth) - 0.8).abs() < 0.006, "{}", scenes::mean(&smooth));
    let rough = scenes::mean(&render(&bumped("rough.bmp", plain)));
    assert!(rough < 0.8 && rough > 0.4, "{rough}");
    let glass = scenes::mean(&render(&bumped("rough.bmp", "<bsdf type='dielectric'/>")));
    assert!(glass < 1.001 && glass > 0.5, "{glass}");
    // Facets throw light at one another, so less is lost than the model without that loses: 10 % at 0.7.
    let chalk = |fast| {
        format!(
            "<bsdf type='roughdiffuse'><rgb name='reflectance' value='1'/><float name='alpha' value='0.7'/>\
            <boolean name='use_fast_approx' value='{fast}'/></bsdf>"
        )
    };
    let [whole, fast] = [false, true].map(|fast| scenes::mean(&render(&chalk(fast))));
    assert!((0.88..1.0).contains(&whole) && (0.75..whole).contains(&fast), "{whole} {fast}");
    let white = "<bsdf type='principled'><rgb name='base_color' value='1'/><float name='sheen' value='1'/></bsdf>";
    let white = scenes::mean(&render(white));
    assert!(white < 1.005 && white > 0.8, "{white}");
}

/// A turned sphere carries its texture with it: seen from +z, the pole of a sphere turned by 90° about x is elsewhere.
#[test]
fn spheres_turn_their_textures() {
    let folder = folder();
    let body = |turn: &str| {
        format!(
            "<emitter type='constant'/><shape type='sphere'><transform name='to_world'>{turn}</transform>\
            <bsdf type='diffuse'><texture name='reflectance' type='checkerboard'><rgb name='color0' value='0'/>\
            <rgb name='color1' value='1'/></texture></bsdf></shape>"
        )
    };
    let uv = |turn: &str, direction: glam::Vec3| {
        let loaded = load_body(&folder, "3.0.0", &body(turn)).unwrap_or_else(|error| panic!("{error}"));
        let scene = Scene::build(&loaded, [1, 1]).unwrap();
        let ray = fanal::geometry::Ray { origin: direction * 5.0, direction: -direction };
        scene.intersect(&ray).expect("a sphere at the origin").uv
    };
    let near = |a: glam::Vec2, b: [f32; 2]| assert!(a.distance(b.into()) < 1e-5, "{a} {b:?}");
    let expected = [0.48f32.atan2(0.36) / std::f32::consts::TAU, 0.8f32.acos() / std::f32::consts::PI];
    near(uv("<scale value='2'/>", glam::Vec3::new(0.36, 0.48, 0.8)), expected);
    // Turned by 90° about x, +y goes to +z and +z to −y.
    near(uv("<rotate x='1' angle='90'/>", glam::Vec3::new(0.36, -0.8, 0.48)), expected);
}

/// An orthographic sensor shows from −1 to 1 across, scaled by its transform, at any distance.
#[test]
fn orthographic_sensors_show_what_their_transform_says() {
    let folder = tempfile::tempdir().unwrap();
    let scene = "<scene version='3.0.0'><sensor type='orthographic'>
        <transform name='to_world'><scale x='3' y='3'/><translate z='5'/></transform>
        <film type='hdrfilm'><integer name='width' value='8'/><integer name='height' value='4'/></film></sensor>
        <shape type='rectangle'><bsdf type='diffuse'/></shape></scene>";
    let loaded = load_text(&folder, scene).unwrap();
    assert_eq!(loaded.file.camera.orthographic_width, Some(2.0));
    let camera = Scene::build(&loaded, [8, 4]).unwrap().camera;
    let [corner, middle] = [[0.0, 0.0], [4.0, 2.0]].map(|film| camera.ray(film, [0.5; 2]));
    assert!((corner.origin - Vec3::new(3.0, 1.5, 5.01)).length() < 1e-5, "{:?}", corner.origin);
    assert!((middle.origin - Vec3::Z * 5.01).length() < 1e-5);
    assert_eq!([corner.direction, middle.direction], [Vec3::Z; 2]);
    let text = serde_json::to_string(&loaded.file).unwrap();
    assert_eq!(serde_json::from_str::<SceneFile>(&text).unwrap(), loaded.file);
}
