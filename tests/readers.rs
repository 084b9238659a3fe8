//! Scene readers: one scene in both formats, hostile input, and the shared scenes where they are at hand.

use std::io::Write;
use std::path::Path;

use fanal::base::Error;
use fanal::scene::file::{
    Distribution, Filter, FilterFile, GeometryFile, LightFile, MaterialFile, MeshFile, SceneFile, TextureFile, Wrap,
    identity3,
};
use fanal::scene::readers::{LoadedScene, load, read_exr_channels, read_image, resolve, save};
use tempfile::TempDir;

/// A folder with one good file of every kind.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    put("tetrahedron.obj", OBJ.as_bytes());
    put("triangle.ply", &ply());
    put("two.serialized", &serialized());
    put("grey.png", &png());
    let sky = |x, y| (x as f32, y as f32, 0.5f32);
    exr::prelude::write_rgb_file(folder.path().join("sky.exr"), 8, 4, sky).unwrap();
    folder
}

const OBJ: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\n\
    f 1/1 3/3 2/2\nf 1/1 2/2 4/4\nf 1/1 4/4 3/3\nf 2/2 3/3 4/4\n";

fn ply() -> Vec<u8> {
    let mut out = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nelement face 1\nproperty list uchar uint vertex_indices\nend_header\n"
        .to_vec();
    [0f32, 0., 0., 1., 0., 0., 0., 1., 0.].iter().for_each(|x| out.extend(x.to_le_bytes()));
    out.push(3);
    [0u32, 1, 2].iter().for_each(|i| out.extend(i.to_le_bytes()));
    out
}

fn serialized() -> Vec<u8> {
    let (mut out, mut starts) = (Vec::new(), Vec::new());
    for shape in 0..2u8 {
        starts.push(out.len() as u64);
        out.extend([0x1C, 0x04, 0x04, 0x00]);
        let mut body = 0x1000u32.to_le_bytes().to_vec();
        body.extend(b"triangle\0");
        body.extend(3u64.to_le_bytes());
        body.extend(1u64.to_le_bytes());
        [0f32, 0., shape.into(), 1., 0., 0., 0., 1., 0.].iter().for_each(|x| body.extend(x.to_le_bytes()));
        [0u32, 1, 2].iter().for_each(|i| body.extend(i.to_le_bytes()));
        let mut encoder = flate2::write::ZlibEncoder::new(&mut out, flate2::Compression::default());
        encoder.write_all(&body).unwrap();
        encoder.finish().unwrap();
    }
    starts.iter().for_each(|start| out.extend(start.to_le_bytes()));
    out.extend(2u32.to_le_bytes());
    out
}

fn png() -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, 16, 16);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let pixels: Vec<u8> = (0..16 * 16 * 3).map(|i| (i * 7 % 256) as u8).collect();
    encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
    out
}

const XML: &str = r#"<?xml version="1.0"?>
<scene version="3.0.0">
    <default name="side" value="32"/>
    <default name="si" value="unused"/>
    <integrator type="path"><integer name="max_depth" value="7"/></integrator>
    <sensor type="thinlens">
        <float name="fov" value="40"/>
        <string name="fov_axis" value="y"/>
        <float name="aperture_radius" value="0.1"/>
        <float name="focus_distance" value="5"/>
        <transform name="to_world">
            <scale value="2"/><scale value="0.5"/>
            <rotate y="1" angle="180"/>
            <translate z="5"/>
        </transform>
        <sampler type="independent"><integer name="sample_count" value="16"/></sampler>
        <film type="hdrfilm">
            <integer name="width" value="$side"/><integer name="height" value="$side"/>
            <rfilter type="box"/>
        </film>
    </sensor>
    <include filename="materials.xml"/>
    <shape type="obj" id="solid"><string name="filename" value="tetrahedron.obj"/><ref id="glass"/></shape>
    <shape type="obj"><string name="filename" value="tetrahedron.obj"/><ref id="metal"/></shape>
    <shape type="obj">
        <string name="filename" value="tetrahedron.obj"/><boolean name="face_normals" value="true"/>
        <bsdf type="diffuse"><ref name="reflectance" id="board"/></bsdf>
    </shape>
    <shape type="ply"><string name="filename" value="triangle.ply"/><ref id="painted"/></shape>
    <shape type="serialized">
        <string name="filename" value="two.serialized"/><integer name="shape_index" value="1"/>
        <boolean name="flip_normals" value="true"/>
    </shape>
    <shape type="sphere" id="lamp">
        <point name="center" x="0" y="3" z="0"/><float name="radius" value="0.5"/>
        <emitter type="area"><rgb name="radiance" value="17, 12, 4"/></emitter>
    </shape>
    <emitter type="spot"><float name="cutoff_angle" value="40"/><rgb name="intensity" value="3"/></emitter>
    <emitter type="directional">
        <transform name="to_world"><rotate x="1" angle="90"/></transform>
    </emitter>
    <emitter type="point"><point name="position" value="1 2 3"/></emitter>
    <emitter type="envmap"><string name="filename" value="sky.exr"/></emitter>
</scene>"#;

const MATERIALS: &str = r#"<scene version="3.0.0">
    <texture type="checkerboard" id="board"><transform name="to_uv"><scale x="4" y="2"/><translate x="0.5"/></transform></texture>
    <bsdf type="dielectric" id="glass"><string name="ext_ior" value="water"/></bsdf>
    <bsdf type="twosided" id="metal"><bsdf type="roughconductor"><string name="material" value="Al"/></bsdf></bsdf>
    <bsdf type="diffuse" id="painted">
        <texture name="reflectance" type="bitmap">
            <string name="filename" value="grey.png"/><boolean name="raw" value="true"/>
        </texture>
    </bsdf>
</scene>"#;

/// What the XML above means, written by hand.
const JSON: &str = r#"{
    "version": 1,
    "camera": {
        "to_world": [-1, 0, 0, 0,  0, 1, 0, 0,  0, 0, -1, 5,  0, 0, 0, 1],
        "fov": 40, "aperture_radius": 0.1, "focus_distance": 5
    },
    "film": { "width": 32, "height": 32 },
    "render": { "max_depth": 7, "spp": 16 },
    "materials": {
        "glass": { "type": "dielectric", "int_ior": 1.5046, "ext_ior": 1.333 },
        "metal": { "type": "two_sided", "material": {
            "type": "rough_conductor", "alpha": 0.1,
            "eta": [1.657501, 0.880405, 0.521244], "k": [9.223811, 6.269502, 4.837004] } },
        "painted": { "type": "diffuse", "reflectance": { "type": "bitmap", "file": "grey.png", "raw": true } },
        "shape 2": { "type": "diffuse", "reflectance": {
            "type": "checkerboard", "color0": [0.4, 0.4, 0.4], "color1": [0.2, 0.2, 0.2],
            "to_uv": [4, 0, 0.5, 0, 2, 0, 0, 0, 1] } },
        "default": { "type": "diffuse", "reflectance": { "type": "rgb", "value": [0.5, 0.5, 0.5] } },
        "default emitter": { "type": "diffuse", "reflectance": { "type": "rgb", "value": [0, 0, 0] } }
    },
    "meshes": {
        "tetrahedron.obj": { "type": "obj", "file": "tetrahedron.obj" },
        "tetrahedron.obj (face normals)": { "type": "obj", "file": "tetrahedron.obj", "face_normals": true },
        "triangle.ply": { "type": "ply", "file": "triangle.ply" },
        "two.serialized 1": { "type": "serialized", "file": "two.serialized", "index": 1 }
    },
    "shapes": [
        { "name": "solid", "geometry": { "type": "mesh", "mesh": "tetrahedron.obj" }, "material": "glass" },
        { "geometry": { "type": "mesh", "mesh": "tetrahedron.obj" }, "material": "metal" },
        { "geometry": { "type": "mesh", "mesh": "tetrahedron.obj (face normals)" }, "material": "shape 2" },
        { "geometry": { "type": "mesh", "mesh": "triangle.ply" }, "material": "painted" },
        { "geometry": { "type": "mesh", "mesh": "two.serialized 1" }, "flip_normals": true, "material": "default" },
        { "name": "lamp", "geometry": { "type": "sphere", "center": [0, 3, 0], "radius": 0.5 },
          "material": "default emitter", "emission": [17, 12, 4] }
    ],
    "lights": [
        { "type": "spot", "to_world": [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1], "intensity": [3, 3, 3],
          "cutoff_angle": 40, "beam_width": 30 },
        { "type": "directional", "direction": [0, -1, 0], "irradiance": [1, 1, 1] },
        { "type": "point", "position": [1, 2, 3], "intensity": [1, 1, 1] },
        { "type": "envmap", "file": "sky.exr" }
    ]
}"#;

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
        (r#"<rfilter type="sinc"/>"#, "gaussian"),
        (r#"<rfilter type="box"><float name="radius" value="2"/></rfilter>"#, "radius"),
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
fn refused(result: Result<LoadedScene, Error>, why: &str) -> Error {
    let error = result.expect_err(why);
    let typed =
        matches!(error, Error::Io { .. } | Error::Malformed { .. } | Error::Unsupported { .. } | Error::Limit { .. });
    assert!(typed, "{why}: {error:?}");
    error
}

fn xml_with(body: &str) -> String {
    format!("<scene version=\"3.0.0\">\n<sensor type=\"perspective\"/>\n{body}\n</scene>")
}

fn load_xml(folder: &TempDir, text: &str) -> Result<LoadedScene, Error> {
    let path = folder.path().join("tested.xml");
    std::fs::write(&path, text).unwrap();
    load(&path)
}

#[test]
fn unknown_or_wrong_xml_is_refused_with_its_line() {
    let folder = folder();
    load_xml(&folder, &xml_with("")).unwrap();
    for body in [
        "<bsdf type='velvet' id='a'/>",
        "<bsdf type='diffuse'><float name='sheen' value='1'/></bsdf>",
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
        "<bsdf type='plastic' id='a'><float name='alpha' value='0.1'/></bsdf>",
        "<bsdf type='roughplastic' id='a'><string name='alpha' value='rough'/></bsdf>",
        "<bsdf type='roughdielectric' id='a'><string name='distribution' value='cosine'/></bsdf>",
        "<shape type='cylinder'><float name='radius' value='0'/></shape>",
        "<shape type='cylinder'><point name='p1' x='0' y='0' z='0'/></shape>",
        "<shape type='torus'/>",
        "<shape type='cube'><ref id='nothing'/></shape>",
        "<shape type='cube'><transform name='to_world'><matrix value='1 0 0 0 0 1 0 0 0 0 nan 0 0 0 0 1'/></transform></shape>",
        "<shape type='cube'><transform name='to_world'><matrix value='1 0 0 0 0 1'/></transform></shape>",
        "<shape type='cube'><transform name='to_world'><scale x='0'/></transform></shape>",
        "<shape type='cube'><transform name='to_world'><shear x='1'/></transform></shape>",
        "<shape type='sphere'><transform name='to_world'><scale x='2'/></transform></shape>",
        "<shape type='sphere'><float name='radius' value='-1'/></shape>",
        "<shape type='sphere'><emitter type='area'><rgb name='radiance' value='-1'/></emitter></shape>",
        "<shape type='obj'><string name='filename' value='../tetrahedron.obj'/></shape>",
        "<shape type='obj'><string name='filename' value='/etc/passwd'/></shape>",
        "<shape type='cube'>text</shape>",
        "<shape type='cube' color='red'/>",
        "<emitter type='area'/>",
        "<emitter type='constant'/><emitter type='constant'/>",
        "<medium type='homogeneous'/>",
        "<string name='a' value='$undefined'/>",
        "<include filename='../outside.xml'/>",
        "<include filename='tested.xml'/>",
    ] {
        let message = refused(load_xml(&folder, &xml_with(body)), body).to_string();
        assert!(message.contains("tested.xml:3: "), "{body}: {message}");
    }
    refused(load_xml(&folder, &xml_with("<include filename='grey.png'/>")), "not XML");
    let missing = "<bsdf type='diffuse' id='a'><texture name='reflectance' type='bitmap'>\
        <string name='filename' value='none.png'/></texture></bsdf>";
    assert!(matches!(refused(load_xml(&folder, &xml_with(missing)), missing), Error::Io { .. }));
}

#[test]
fn bombs_are_refused() {
    let folder = folder();
    let entities: String =
        (1..10).map(|i| format!("<!ENTITY e{i} \"{}\">", format!("&e{};", i - 1).repeat(10))).collect();
    let bomb = format!("<!DOCTYPE scene [<!ENTITY e0 \"ha\">{entities}]><scene version=\"&e9;\"/>");
    refused(load_xml(&folder, &bomb), "entities");
    let mut defaults = "<default name='d0x' value='0123456789'/>".to_owned();
    for i in 1..30 {
        defaults += &format!("<default name='d{i}x' value='{}'/>", format!("$d{}x", i - 1).repeat(10));
    }
    assert!(matches!(refused(load_xml(&folder, &xml_with(&defaults)), "defaults"), Error::Limit { .. }));
    let deep = format!("{}{}", "<shape type='cube'>".repeat(5000), "</shape>".repeat(5000));
    refused(load_xml(&folder, &xml_with(&deep)), "nesting");
    // Each file includes the next one twice.
    for i in 0..40 {
        let text = xml_with(&format!("<include filename='i{}.xml'/>", i + 1).repeat(2));
        std::fs::write(folder.path().join(format!("i{i}.xml")), text).unwrap();
    }
    refused(load(&folder.path().join("i0.xml")), "includes");
    for i in 0..2 {
        let text = xml_with(&format!("<include filename='loop{}.xml'/>", 1 - i));
        std::fs::write(folder.path().join(format!("loop{i}.xml")), text).unwrap();
    }
    let error = refused(load(&folder.path().join("loop0.xml")), "recursive include");
    assert!(error.to_string().contains("includes itself"), "{error}");
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

/// A scene that uses one file.
fn scene_with(mesh: Option<MeshFile>, texture: Option<&str>) -> SceneFile {
    let mut file: SceneFile = serde_json::from_str(JSON).unwrap();
    file.shapes.clear();
    file.lights.clear();
    file.materials.clear();
    file.meshes = mesh.map(|mesh| ("m".to_owned(), mesh)).into_iter().collect();
    if let Some(name) = texture {
        let reflectance = TextureFile::Bitmap {
            file: name.to_owned(),
            to_uv: identity3(),
            raw: true,
            scale: 1.0,
            wrap: Wrap::Repeat,
            filter: Filter::Bilinear,
        };
        file.materials.insert("t".to_owned(), MaterialFile::Diffuse { reflectance });
    }
    file
}

/// The scene that uses `used` as if it were the good file `name`.
fn scene_using(name: &str, used: &str) -> SceneFile {
    let file = used.to_owned();
    match name {
        "tetrahedron.obj" => scene_with(Some(MeshFile::Obj { file, face_normals: false, flip_v: false }), None),
        "triangle.ply" => scene_with(Some(MeshFile::Ply { file, face_normals: false, flip_v: false }), None),
        "two.serialized" => scene_with(Some(MeshFile::Serialized { file, index: 1, face_normals: false }), None),
        _ => scene_with(None, Some(used)),
    }
}

const FILES: [&str; 5] = ["tetrahedron.obj", "triangle.ply", "two.serialized", "grey.png", "sky.exr"];

#[test]
fn cut_files_are_refused() {
    let folder = folder();
    for name in FILES {
        let scene = scene_using(name, "cut");
        let whole = std::fs::read(folder.path().join(name)).unwrap();
        std::fs::write(folder.path().join("cut"), &whole).unwrap();
        resolve(scene.clone(), folder.path(), Path::new("scene")).unwrap_or_else(|error| panic!("{name}: {error}"));
        for eighth in 0..8 {
            std::fs::write(folder.path().join("cut"), &whole[..whole.len() * eighth / 8]).unwrap();
            let result = resolve(scene.clone(), folder.path(), Path::new("scene"));
            // A text that ends between two lines may still be a mesh.
            if name != "tetrahedron.obj" || eighth < 4 {
                let message = refused(result, name).to_string();
                assert!(message.contains("cut"), "{message}");
            }
        }
    }
}

/// Every byte of a file damaged in three ways: an error or other values, no panic.
#[test]
fn damaged_files_are_survived() {
    let folder = folder();
    let path = folder.path().join("damaged");
    for name in FILES {
        let scene = scene_using(name, "damaged");
        let whole = std::fs::read(folder.path().join(name)).unwrap();
        for at in 0..whole.len() {
            for damage in [0xFF, 0x01, 0x80] {
                let mut bytes = whole.clone();
                bytes[at] ^= damage;
                std::fs::write(&path, &bytes).unwrap();
                let _ = resolve(scene.clone(), folder.path(), Path::new("scene"));
                if name == "sky.exr" {
                    let _ = read_exr_channels(&path);
                }
            }
        }
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
