//! One scene in two formats.

use fanal::scene::readers::load;

use super::{folder, load_text, picture};

const PBRT: &str = r#"# A box with two blocks
Film "rgb" "integer xresolution" 32 "integer yresolution" [ 24 ] "string filename" "box.exr"
PixelFilter "box"
Sampler "zsobol" "integer pixelsamples" 8
Integrator "volpath" "integer maxdepth" [ 5 ]
Scale -1 1 1
LookAt 0 1 4.2  0 1 0  0 1 0
Camera "perspective" "float fov" 36
WorldBegin
MakeNamedMaterial "white" "string type" "diffuse" "rgb reflectance" [ .7 .7 .7 ]
MakeNamedMaterial "red" "string type" [ "diffuse" ] "rgb reflectance" [ 0.6 0.05 0.05 ]
AttributeBegin
    NamedMaterial "white"
    Translate 0 1 -1
    Shape "trianglemesh" "point3 P" [ -1 -1 0  1 -1 0  1 1 0  -1 1 0 ] "integer indices" [ 0 1 2 0 2 3 ]
AttributeEnd
AttributeBegin
    NamedMaterial "white"
    Rotate -90 1 0 0
    Shape "bilinearmesh" "point3 P" [ -1 -1 0  1 -1 0  -1 1 0  1 1 0 ]
AttributeEnd
NamedMaterial "red"
Shape "trianglemesh" "point3 P" [ -1 0 -1  -1 0 1  -1 2 1  -1 2 -1 ] "integer indices" [ 0 1 2 0 2 3 ]
AttributeBegin
    Material "conductor" "spectrum eta" "metal-Au-eta" "spectrum k" "metal-Au-k" "float roughness" 0.04
    Translate -.4 .35 -.3
    Shape "sphere" "float radius" .35
AttributeEnd
AttributeBegin
    Material "dielectric" "float eta" 1.5
    Translate .4 .3 .2
    Shape "sphere" "float radius" .3
AttributeEnd
AttributeBegin
    Material "diffuse" "rgb reflectance" [ 0 0 0 ]
    AreaLightSource "diffuse" "rgb L" [ 17 12 4 ] "float scale" 0.5
    Shape "trianglemesh" "point3 P" [ -.3 1.99 -.3  .3 1.99 -.3  .3 1.99 .3  -.3 1.99 .3 ] "integer indices" [ 0 1 2 0 2 3 ]
AttributeEnd
LightSource "point" "rgb I" [ .2 .3 .4 ] "point3 from" [ 0 1.5 2 ]
"#;

const JSON: &str = r#"{
    "version": 1,
    "camera": { "to_world": [-1, 0, 0, 0,  0, 1, 0, 1,  0, 0, -1, 4.2,  0, 0, 0, 1], "fov": 46.8470554 },
    "film": { "width": 32, "height": 24, "filter": { "type": "box", "radius": 0.5 } },
    "render": { "max_depth": 6, "spp": 8 },
    "materials": {
        "white": { "type": "two_sided", "material": { "type": "diffuse", "reflectance": { "type": "rgb", "value": [0.7, 0.7, 0.7] } } },
        "red": { "type": "two_sided", "material": { "type": "diffuse", "reflectance": { "type": "rgb", "value": [0.6, 0.05, 0.05] } } },
        "gold": { "type": "two_sided", "material": { "type": "rough_conductor", "alpha": 0.2, "distribution": "ggx",
            "eta": [0.143036, 0.375307, 1.442045], "k": [3.982997, 2.385556, 1.603359] } },
        "glass": { "type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0 },
        "black": { "type": "two_sided", "material": { "type": "diffuse", "reflectance": { "type": "rgb", "value": [0, 0, 0] } } }
    },
    "meshes": {
        "back": { "type": "inline", "positions": [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], "triangles": [[0, 1, 2], [0, 2, 3]] },
        "wall": { "type": "inline", "positions": [[-1, 0, -1], [-1, 0, 1], [-1, 2, 1], [-1, 2, -1]], "triangles": [[0, 1, 2], [0, 2, 3]] },
        "lamp": { "type": "inline", "positions": [[-0.3, 1.99, -0.3], [0.3, 1.99, -0.3], [0.3, 1.99, 0.3], [-0.3, 1.99, 0.3]],
            "triangles": [[0, 1, 2], [0, 2, 3]] }
    },
    "shapes": [
        { "geometry": { "type": "mesh", "mesh": "back" }, "to_world": [1, 0, 0, 0,  0, 1, 0, 1,  0, 0, 1, -1,  0, 0, 0, 1], "material": "white" },
        { "geometry": { "type": "mesh", "mesh": "back" }, "to_world": [1, 0, 0, 0,  0, 0, 1, 0,  0, -1, 0, 0,  0, 0, 0, 1], "material": "white" },
        { "geometry": { "type": "mesh", "mesh": "wall" }, "material": "red" },
        { "geometry": { "type": "sphere", "center": [-0.4, 0.35, -0.3], "radius": 0.35 }, "material": "gold" },
        { "geometry": { "type": "sphere", "center": [0.4, 0.3, 0.2], "radius": 0.3 }, "material": "glass" },
        { "geometry": { "type": "mesh", "mesh": "lamp" }, "material": "black", "emission": [8.5, 6, 2] }
    ],
    "lights": [ { "type": "point", "position": [0, 1.5, 2], "intensity": [0.2, 0.3, 0.4] } ]
}"#;

/// pbrt's vertical field of view for a picture 4/3 as wide as high; its camera mirrors, which the scale undoes.
#[test]
fn s09_a_box_is_the_same_box_in_our_own_format() {
    let folder = folder();
    let from_pbrt = load_text(folder.path(), PBRT).unwrap();
    assert_eq!(from_pbrt.warnings, Vec::<String>::new());
    std::fs::write(folder.path().join("scene.json"), JSON).unwrap();
    let from_json = load(&folder.path().join("scene.json")).unwrap();
    assert!((from_pbrt.file.camera.fov - from_json.file.camera.fov).abs() < 1e-4, "{}", from_pbrt.file.camera.fov);
    assert_eq!(from_pbrt.file.film, from_json.file.film);
    assert_eq!(from_pbrt.file.render, from_json.file.render);
    let [a, b] = [&from_pbrt, &from_json].map(|loaded| picture(loaded, 8));
    let mean = b.pixels.iter().map(|pixel| pixel.element_sum()).sum::<f32>() / (3 * b.pixels.len()) as f32;
    assert!(mean > 0.05, "{mean}");
    for (a, b) in a.pixels.iter().zip(&b.pixels) {
        assert!((*a - *b).abs().max_element() <= 1e-4 * mean.max(b.max_element()), "{a} {b}");
    }
}

/// Without the scale, the picture is mirrored: pbrt's space is left-handed.
#[test]
fn the_camera_is_left_handed() {
    let folder = folder();
    let [straight, mirrored] = [PBRT.to_owned(), PBRT.replace("Scale -1 1 1\n", "")]
        .map(|text| load_text(folder.path(), &text).unwrap().file.camera.to_world);
    assert_eq!(straight, [-1., 0., 0., 0., 0., 1., 0., 1., 0., 0., -1., 4.2, 0., 0., 0., 1.]);
    assert_eq!(mirrored, [1., 0., 0., 0., 0., 1., 0., 1., 0., 0., -1., 4.2, 0., 0., 0., 1.]);
}
