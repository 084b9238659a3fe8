//! One good file of every kind that the readers know, and scenes that use them.

use std::io::Write;

use fanal::base::Error;
use fanal::scene::file::{Filter, MaterialFile, MeshFile, SceneFile, TextureFile, Wrap, identity3};
use fanal::scene::readers::{LoadedScene, load};
use tempfile::TempDir;

/// A folder with one good file of every kind.
pub fn folder() -> TempDir {
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

pub const OBJ: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\n\
    f 1/1 3/3 2/2\nf 1/1 2/2 4/4\nf 1/1 4/4 3/3\nf 2/2 3/3 4/4\n";

pub fn ply() -> Vec<u8> {
    let mut out = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nelement face 1\nproperty list uchar uint vertex_indices\nend_header\n"
        .to_vec();
    [0f32, 0., 0., 1., 0., 0., 0., 1., 0.].iter().for_each(|x| out.extend(x.to_le_bytes()));
    out.push(3);
    [0u32, 1, 2].iter().for_each(|i| out.extend(i.to_le_bytes()));
    out
}

pub fn serialized() -> Vec<u8> {
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

pub fn png() -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, 16, 16);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let pixels: Vec<u8> = (0..16 * 16 * 3).map(|i| (i * 7 % 256) as u8).collect();
    encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
    out
}

pub const XML: &str = r#"<?xml version="1.0"?>
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

pub const MATERIALS: &str = r#"<scene version="3.0.0">
    <texture type="checkerboard" id="board"><transform name="to_uv"><scale x="4" y="2"/><translate x="0.5"/></transform></texture>
    <bsdf type="dielectric" id="glass"><string name="ext_ior" value="water"/></bsdf>
    <bsdf type="twosided" id="metal"><bsdf type="roughconductor"><string name="material" value="Al"/></bsdf></bsdf>
    <bsdf type="diffuse" id="painted">
        <texture name="reflectance" type="bitmap">
            <string name="filename" value="grey.png"/><boolean name="raw" value="true"/>
        </texture>
    </bsdf>
</scene>"#;

/// A scene of pbrt that has a bit of everything.
pub const PBRT: &str = r#"# pbrt
Film "rgb" "integer xresolution" 32 "integer yresolution" [ 24 ] "float iso" 150 "string sensor" "cie1931"
PixelFilter "gaussian" "float xradius" 1.5 "float yradius" 1.5 "float sigma" .5
Sampler "halton" "integer pixelsamples" 4
Integrator "path" "integer maxdepth" 7
ColorSpace "rec2020"
LookAt 0 1 5  0 1 0  0 1 0
Camera "perspective" "float fov" 40 "float lensradius" .01 "float focaldistance" 5 "float screenwindow" [ -1.2 1.2 -.9 .9 ]
WorldBegin
MakeNamedMedium "fog" "string type" "homogeneous" "rgb sigma_a" [ .1 .1 .2 ] "rgb sigma_s" [ .3 .4 .5 ] "float g" .3
Texture "picture" "spectrum" "imagemap" "string filename" "grey.png" "float uscale" 2 "bool invert" true
Texture "board" "spectrum" "checkerboard" "rgb tex1" [ .1 .5 .9 ] "float vscale" 3
Texture "product" "spectrum" "scale" "texture tex" "picture" "rgb scale" [ .5 .6 .7 ]
Texture "mixture" "spectrum" "mix" "texture amount" "picture" "rgb tex1" [ 1 0 0 ] "rgb tex2" [ 0 1 0 ]
Texture "bumps" "float" "imagemap" "string filename" "grey.png" "string encoding" "linear" "float scale" .1
MakeNamedMaterial "red" "string type" "diffuse" "texture reflectance" "product"
MakeNamedMaterial "coat" "string type" "coateddiffuse" "texture reflectance" "mixture" "float roughness" .2 "texture displacement" "bumps"
MakeNamedMaterial "gold" "string type" "conductor" "spectrum eta" "metal-Au-eta" "spectrum k" [ 400 2 500 2 700 4 ] "float roughness" .1
MakeNamedMaterial "both" "string type" "mix" "string materials" [ "red" "gold" ] "float amount" .3
MakeNamedMaterial "layers" "string type" "coatedconductor" "float interface.roughness" .1
AttributeBegin
  AreaLightSource "diffuse" "blackbody L" 4000 "float scale" 3 "bool twosided" true
  Translate 0 2 0 Rotate 90 1 0 0 Shape "disk" "float radius" .5
AttributeEnd
LightSource "infinite" "string filename" "grey.png" "float scale" .2
LightSource "spot" "point3 from" [ 1 3 1 ] "point3 to" [ 0 0 0 ] "float power" 20
LightSource "distant" "spectrum L" "stdillum-A" "point3 from" [ 0 1 1 ]
ObjectBegin "things"
  NamedMaterial "both" Shape "sphere" "float radius" .3 "float alpha" .5
  Material "dielectric" "spectrum eta" "glass-BK7" Translate .7 0 0
  Shape "cylinder" "float radius" .2 "float zmin" 0 "float phimax" 270
  NamedMaterial "layers" Shape "plymesh" "string filename" "triangle.ply"
ObjectEnd
AttributeBegin Scale 1 2 1 ObjectInstance "things" AttributeEnd
AttributeBegin ReverseOrientation ConcatTransform [ 1 0 0 0  0 1 0 0  0 0 1 0  1 0 0 1 ] ObjectInstance "things" AttributeEnd
NamedMaterial "coat"
Shape "trianglemesh" "point3 P" [ -2 0 -2  2 0 -2  2 0 2  -2 0 2 ] "normal N" [ 0 1 0 0 1 0 0 1 0 0 1 0 ]
  "point2 uv" [ 0 0 1 0 1 1 0 1 ] "integer indices" [ 0 1 2 0 2 3 ]
Material "diffuse" "texture reflectance" "board"
Shape "bilinearmesh" "point3 P" [ -2 0 -2  2 0 -2  -2 2 -2  2 2 -2.5 ]
AttributeBegin MediumInterface "fog" "" Material "interface" Shape "sphere" "float radius" .4 AttributeEnd
"#;

/// What the XML above means, written by hand.
pub const JSON: &str = r#"{
    "version": 1,
    "camera": {
        "to_world": [-1, 0, 0, 0,  0, 1, 0, 0,  0, 0, -1, 5,  0, 0, 0, 1],
        "fov": 40, "aperture_radius": 0.1, "focus_distance": 5, "near_clip": 0.01
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

pub fn refused(result: Result<LoadedScene, Error>, why: &str) -> Error {
    let error = result.expect_err(why);
    let typed = matches!(
        error,
        Error::Io { .. }
            | Error::Malformed { .. }
            | Error::Unsupported { .. }
            | Error::Limit { .. }
            | Error::Missing { .. }
    );
    assert!(typed, "{why}: {error:?}");
    error
}

pub fn xml_with(body: &str) -> String {
    format!("<scene version=\"3.0.0\">\n<sensor type=\"perspective\"/>\n{body}\n</scene>")
}

pub fn load_xml(folder: &TempDir, text: &str) -> Result<LoadedScene, Error> {
    let path = folder.path().join("tested.xml");
    std::fs::write(&path, text).unwrap();
    load(&path)
}

/// A scene that uses one file.
pub fn scene_with(mesh: Option<MeshFile>, texture: Option<&str>) -> SceneFile {
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
pub fn scene_using(name: &str, used: &str) -> SceneFile {
    let file = used.to_owned();
    match name {
        "tetrahedron.obj" => {
            scene_with(Some(MeshFile::Obj { file, face_normals: false, flip_v: false, materials: Vec::new() }), None)
        }
        "triangle.ply" => {
            scene_with(Some(MeshFile::Ply { file, face_normals: false, flip_v: false, as_given: false }), None)
        }
        "hair.txt" => scene_with(Some(MeshFile::Curves { file, straight: false, wider: 1.0 }), None),
        "two.serialized" => scene_with(Some(MeshFile::Serialized { file, index: 1, face_normals: false }), None),
        _ => scene_with(None, Some(used)),
    }
}

pub const FILES: [&str; 5] = ["tetrahedron.obj", "triangle.ply", "two.serialized", "grey.png", "sky.exr"];
