//! glTF: one scene in this format and in ours, geometry, nodes, cameras, lights, files.

use std::path::Path;

use fanal::base::Error;
use fanal::geometry::mesh::Mesh;
use fanal::scene::Scene;
use fanal::scene::file::{GeometryFile, LightFile, MeshFile, SceneFile};
use fanal::scene::readers::{LoadedScene, Missing, load, load_lacking, save};
use glam::{Mat4, Quat, Vec3};
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::support::gltf::{Document, FLOAT, I8, U8, U16, U32, png};
use crate::support::{files, scenes};

pub fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

/// Loads a text document; `more` may add to it.
pub fn loaded(document: &Document) -> LoadedScene {
    let folder = folder();
    let path = folder.path().join("tested.gltf");
    std::fs::write(&path, document.text()).unwrap();
    load(&path).unwrap_or_else(|error| panic!("{error}: {}", document.json))
}

/// The error that a document gives.
pub fn refused(document: &Document, why: &str) -> String {
    let folder = folder();
    let path = folder.path().join("tested.gltf");
    std::fs::write(&path, document.text()).unwrap();
    let message = files::refused(load(&path), why).to_string();
    assert!(message.contains("tested.gltf"), "{why}: {message}");
    message
}

pub fn warns(loaded: &LoadedScene, words: &str) -> bool {
    loaded.warnings.iter().any(|warning| warning.contains("tested.gl") && warning.contains(words))
}

/// Whether a number is what it should be.
fn near(a: f32, b: f32) -> bool {
    (a - b).abs() <= 1e-5 * b.abs().max(1.0)
}

/// The mesh of shape `index`.
pub fn mesh(loaded: &LoadedScene, index: usize) -> &Mesh {
    let GeometryFile::Mesh { mesh } = &loaded.file.shapes[index].geometry else { panic!("a mesh") };
    &loaded.meshes[mesh]
}

/// The corners of the triangles of shape `index`, where they are in the world.
fn corners(loaded: &LoadedScene, index: usize) -> Vec<[Vec3; 3]> {
    let mesh = mesh(loaded, index);
    let to_world = Mat4::from_cols_array(&loaded.file.shapes[index].to_world).transpose();
    let place = |vertex: u32| to_world.transform_point3(mesh.positions[vertex as usize]);
    mesh.triangles.iter().map(|triangle| triangle.map(place)).collect()
}

const QUAD: [f32; 12] = [-1., -1., 0., 1., -1., 0., 1., 1., 0., -1., 1., 0.];

/// A square of the box.
struct Wall {
    turn: Quat,
    offset: Vec3,
    scale: Vec3,
    color: [f32; 3],
    emission: [f32; 3],
}

fn walls() -> [Wall; 7] {
    use std::f32::consts::FRAC_PI_2;
    let (grey, dark) = ([0.7; 3], [0.0; 3]);
    let wall = |turn, offset, color| Wall { turn, offset, scale: Vec3::ONE, color, emission: dark };
    let turn = Quat::from_rotation_y(0.4);
    let block = wall(turn, Vec3::new(0.3, -0.5, 0.1), [0.2, 0.3, 0.8]);
    let lamp = wall(Quat::from_rotation_x(FRAC_PI_2), Vec3::Y * 0.99, dark);
    [
        wall(Quat::from_rotation_x(-FRAC_PI_2), Vec3::NEG_Y, grey),
        wall(Quat::from_rotation_x(FRAC_PI_2), Vec3::Y, grey),
        wall(Quat::IDENTITY, Vec3::NEG_Z, grey),
        wall(Quat::from_rotation_y(FRAC_PI_2), Vec3::NEG_X, [0.7, 0.1, 0.1]),
        wall(Quat::from_rotation_y(-FRAC_PI_2), Vec3::X, [0.1, 0.7, 0.1]),
        Wall { scale: Vec3::new(0.3, 0.5, 1.0), ..block },
        Wall { scale: Vec3::splat(0.3), emission: [12.0, 10.0, 8.0], ..lamp },
    ]
}

fn in_gltf() -> Document {
    let mut document = Document::new();
    let positions = document.floats(3, &QUAD);
    let indices = document.indices(U8, &[0, 1, 2, 0, 2, 3]);
    for Wall { turn, offset, scale, color, emission } in walls() {
        let material = document.add(
            "materials",
            json!({
                "pbrMetallicRoughness": {
                    "baseColorFactor": [color[0], color[1], color[2], 1.0], "metallicFactor": 0.25, "roughnessFactor": 0.75
                },
                "emissiveFactor": emission.map(|channel| channel / 20.0),
                "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 20.0 } }
            }),
        );
        let mesh =
            document.mesh(json!({ "attributes": { "POSITION": positions }, "indices": indices, "material": material }));
        document.add_node(json!({
            "mesh": mesh, "rotation": turn.to_array(), "translation": offset.to_array(), "scale": scale.to_array()
        }));
    }
    let camera = document.add(
        "cameras",
        json!({ "type": "perspective", "perspective": { "yfov": 0.8, "aspectRatio": 1.5, "znear": 0.1 } }),
    );
    document.add_node(json!({ "camera": camera, "translation": [0.1, 0.0, 3.4], "rotation": [0.0, 0.6, 0.0, 0.8] }));
    // A camera that looks into the box, however it is turned: the scale of its node does not count.
    document.json["nodes"][7]["rotation"] = json!([0.0, 0.0, 0.0, 1.0]);
    document.json["nodes"][7]["scale"] = json!([2.0, 2.0, 2.0]);
    document
}

fn in_json() -> Value {
    let row_major = |matrix: Mat4| matrix.transpose().to_cols_array().to_vec();
    let mut materials = serde_json::Map::new();
    let mut shapes = vec![];
    for (i, Wall { turn, offset, scale, color, emission }) in walls().into_iter().enumerate() {
        let rgb = |value: [f32; 3]| json!({ "type": "rgb", "value": value });
        let principled = json!({
            "type": "principled", "base_color": rgb(color), "metallic": rgb([0.25; 3]), "roughness": rgb([0.75; 3]), "eta": 1.5
        });
        materials.insert(format!("wall {i}"), json!({ "type": "two_sided", "material": principled }));
        let to_world = Mat4::from_scale_rotation_translation(scale, turn, offset);
        let geometry = json!({ "type": "mesh", "mesh": "square" });
        let mut shape =
            json!({ "geometry": geometry, "to_world": row_major(to_world), "material": format!("wall {i}") });
        if emission != [0.0; 3] {
            shape["emission"] = json!(emission);
        }
        shapes.push(shape);
    }
    json!({
        "version": 1,
        "camera": {
            "to_world": [-1, 0, 0, 0.1, 0, 1, 0, 0, 0, 0, -1, 3.4, 0, 0, 0, 1],
            "fov": (2.0 * (0.4f64.tan() * 1.5).atan()).to_degrees()
        },
        "film": { "width": 1080, "height": 720 },
        "materials": materials,
        "meshes": { "square": {
            "type": "inline", "positions": QUAD.as_chunks::<3>().0, "triangles": [[0, 1, 2], [0, 2, 3]]
        } },
        "shapes": shapes
    })
}

/// The box through glTF, as text and binary, and through our own format: the same picture.
#[test]
fn s09_the_same_box_gives_the_same_picture() {
    let folder = folder();
    let document = in_gltf();
    std::fs::write(folder.path().join("tested.gltf"), document.text()).unwrap();
    std::fs::write(folder.path().join("tested.glb"), document.binary()).unwrap();
    std::fs::write(folder.path().join("tested.json"), in_json().to_string()).unwrap();
    let [text, binary, own] =
        ["tested.gltf", "tested.glb", "tested.json"].map(|name| load(&folder.path().join(name)).unwrap());
    assert_eq!(text.warnings, Vec::<String>::new());
    assert_eq!((&text.file.shapes, &text.meshes), (&binary.file.shapes, &binary.meshes));
    assert_eq!(text.file.film, own.file.film);
    assert!(near(text.file.camera.fov, own.file.camera.fov));
    let picture = |loaded: &LoadedScene| {
        let scene = Scene::build(loaded, [24, 16]).unwrap();
        scenes::picture(&scene, &scenes::settings(scenes::GUIDES[0], 8, 1))
    };
    let [text, binary, own] = [text, binary, own].map(|loaded| picture(&loaded));
    assert!(scenes::mean(&own) > 0.05 && text == binary);
    let most = own.pixels.iter().map(|pixel| pixel.max_element()).fold(0.0, f32::max);
    for (a, b) in text.pixels.iter().zip(&own.pixels) {
        assert!(a.abs_diff_eq(*b, 1e-4 * b.max_element().max(1e-3 * most)), "{a} {b}");
    }
}

/// The same two triangles by every way to write them.
#[test]
fn geometry_of_every_kind() {
    let mut document = Document::new();
    let positions = document.floats(3, &QUAD);
    let show = |document: &mut Document, primitive: Value| {
        let mesh = document.mesh(primitive);
        document.add_node(json!({ "mesh": mesh }))
    };
    for component in [U8, U16, U32] {
        let indices = document.indices(component, &[0, 1, 2, 0, 2, 3]);
        show(&mut document, json!({ "attributes": { "POSITION": positions }, "indices": indices }));
    }
    let strip = document.indices(U16, &[1, 2, 0, 3]);
    show(&mut document, json!({ "attributes": { "POSITION": positions }, "indices": strip, "mode": 5 }));
    show(&mut document, json!({ "attributes": { "POSITION": positions }, "mode": 6 }));
    let all: Vec<f32> = [0, 1, 2, 0, 2, 3].iter().flat_map(|i| QUAD[3 * i..3 * i + 3].to_vec()).collect();
    let all = document.floats(3, &all);
    show(&mut document, json!({ "attributes": { "POSITION": all } }));
    // Positions and normals in turns, from the second byte group on.
    let mut bytes = vec![0; 8];
    for position in QUAD.as_chunks::<3>().0 {
        position.iter().chain(&[0.0, 0.0, 1.0]).for_each(|x: &f32| bytes.extend(x.to_le_bytes()));
    }
    let view = document.view(&bytes);
    document.json["bufferViews"][view]["byteStride"] = json!(24);
    let column = |offset: u32| json!({ "bufferView": view, "byteOffset": offset, "componentType": FLOAT, "count": 4, "type": "VEC3" });
    let [p, n] = [8, 20].map(|offset| document.add("accessors", column(offset)));
    let indices = document.indices(U8, &[0, 1, 2, 0, 2, 3]);
    show(&mut document, json!({ "attributes": { "POSITION": p, "NORMAL": n }, "indices": indices }));
    // Small integers, normalised and not.
    let bytes = document.view(&[129, 129, 0, 0, 127, 129, 0, 0, 127, 127, 0, 0, 129, 127, 0, 0]);
    document.json["bufferViews"][bytes]["byteStride"] = json!(4);
    let small = document.add(
        "accessors",
        json!({ "bufferView": bytes, "componentType": I8, "normalized": true, "count": 4, "type": "VEC3" }),
    );
    show(&mut document, json!({ "attributes": { "POSITION": small }, "indices": indices }));
    let bytes = document.view(&[255, 255, 0, 0, 1, 255, 0, 0, 1, 1, 0, 0, 255, 1, 0, 0]);
    document.json["bufferViews"][bytes]["byteStride"] = json!(4);
    let small =
        document.add("accessors", json!({ "bufferView": bytes, "componentType": I8, "count": 4, "type": "VEC3" }));
    show(&mut document, json!({ "attributes": { "POSITION": small }, "indices": indices }));
    // Two vertices that replace zeros.
    let (which, with) = (document.view(&[1, 3]), document.view(bytemuck::cast_slice(&[2f32, 0., 0., 0., 2., 0.])));
    let sparse = json!({
        "count": 2, "indices": { "bufferView": which, "componentType": U8 }, "values": { "bufferView": with }
    });
    let some =
        document.add("accessors", json!({ "componentType": FLOAT, "count": 4, "type": "VEC3", "sparse": sparse }));
    let three = document.indices(U8, &[0, 1, 3]);
    show(&mut document, json!({ "attributes": { "POSITION": some }, "indices": three }));
    show(&mut document, json!({ "attributes": { "POSITION": positions }, "mode": 1 }));
    let loaded = loaded(&document);
    let expected = corners(&loaded, 0);
    let area = |triangle: &[Vec3; 3]| (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]);
    assert_eq!(loaded.file.shapes.len(), 10);
    for shape in 0..9 {
        let found = corners(&loaded, shape);
        let sum: Vec3 = found.iter().map(area).sum();
        assert!(sum.distance(Vec3::Z * 8.0) < 1e-4 && found.len() == 2, "shape {shape}: {found:?}");
        assert!(found.iter().flatten().all(|p| expected.iter().flatten().any(|q| p.distance(*q) < 1e-6)), "{shape}");
        assert_eq!(mesh(&loaded, shape).normals.len(), if shape == 6 { 4 } else { 0 });
    }
    assert_eq!(corners(&loaded, 9), [[Vec3::ZERO, Vec3::X * 2.0, Vec3::Y * 2.0]]);
    assert!(warns(&loaded, "points and lines"));
    let path = Path::new("never written.json");
    let error = save(&loaded.file, path).unwrap_err();
    assert!(matches!(error, Error::Unsupported { .. }), "{error}");
    assert!(loaded.file.meshes.values().all(|mesh| matches!(mesh, MeshFile::Held { .. })));
}

/// Of a buffer that many primitives share, each has the vertices that it uses.
#[test]
fn shared_vertices_are_not_copied() {
    let mut document = Document::new();
    let positions: Vec<f32> = (0..3000).map(|i| (i * i % 101) as f32).collect();
    let positions = document.floats(3, &positions);
    for first in 0..3 {
        let indices = document.indices(U32, &[first, first + 500, first + 900]);
        let mesh = document.mesh(json!({ "attributes": { "POSITION": positions }, "indices": indices }));
        document.add_node(json!({ "mesh": mesh }));
    }
    let loaded = loaded(&document);
    assert!((0..3).all(|shape| mesh(&loaded, shape).positions.len() == 3));
}

#[test]
fn nodes_place_their_meshes() {
    let mut document = Document::new();
    document.square(None);
    let matrix = Mat4::from_cols_array(&[0., 2., 0., 0., -1., 0., 0., 0., 0., 0., 1., 0., 5., 6., 7., 1.]);
    document.json["nodes"][0] = json!({ "matrix": matrix.to_cols_array(), "children": [1, 2] });
    document.add("nodes", json!({ "mesh": 0, "translation": [1.0, 0.0, 0.0] }));
    document.add("nodes", json!({ "mesh": 0, "scale": [1.0, 1.0, -1.0], "name": "mirrored" }));
    // Not in the scene.
    document.add("nodes", json!({ "mesh": 0 }));
    let found = loaded(&document);
    let place = |shape: usize| Mat4::from_cols_array(&found.file.shapes[shape].to_world).transpose();
    assert_eq!(place(0), matrix * Mat4::from_translation(Vec3::X));
    assert_eq!(place(1), matrix * Mat4::from_scale(Vec3::new(1.0, 1.0, -1.0)));
    assert_eq!((found.file.shapes.len(), found.meshes.len(), found.file.shapes[1].name.as_str()), (2, 1, "mirrored"));
    // Copies of the first.
    let moves = document.floats(3, &[0., 0., 1., 0., 0., 2.]);
    let scales = document.floats(3, &[1., 1., 1., 3., 3., 3.]);
    document.json["nodes"][1]["extensions"] =
        json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": moves, "SCALE": scales } } });
    let found = loaded(&document);
    let place = |shape: usize| Mat4::from_cols_array(&found.file.shapes[shape].to_world).transpose();
    let copy = Mat4::from_scale_rotation_translation(Vec3::splat(3.0), Quat::IDENTITY, Vec3::Z * 2.0);
    assert_eq!(place(1), matrix * Mat4::from_translation(Vec3::X) * copy);
    assert_eq!((found.file.shapes.len(), found.meshes.len()), (3, 1));
    // A node with two parents has the first; one inside itself is an error.
    document.json["nodes"][2]["children"] = json!([1]);
    assert!(warns(&loaded(&document), "several parents"));
    document.json["nodes"][2]["children"] = json!([0]);
    assert!(refused(&document, "a circle").contains("inside itself"));
    let mut deep = Document::new();
    deep.add_node(json!({ "children": [1] }));
    for child in 2..2000 {
        deep.add("nodes", json!({ "children": [child] }));
    }
    deep.add("nodes", json!({}));
    assert!(refused(&deep, "too deep").contains("1024"));
    // What is hidden is not there with all below it; what is flattened is thin.
    let mut document = Document::new();
    document.square(None);
    document.json["nodes"][0] =
        json!({ "children": [1], "extensions": { "KHR_node_visibility": { "visible": false } } });
    document.add("nodes", json!({ "mesh": 0 }));
    document.add_node(json!({ "mesh": 0, "scale": [2.0, 1.0, 0.0] }));
    document.json["extensionsRequired"] = json!(["KHR_node_visibility"]);
    document.json["extensionsUsed"] = json!(["KHR_node_visibility"]);
    let found = loaded(&document);
    assert_eq!(found.file.shapes.len(), 1);
    assert!((found.file.shapes[0].to_world[10] - 2e-4).abs() < 1e-9, "{:?}", found.file.shapes[0].to_world);
    // Without a scene, all that are no other's child.
    let mut document = Document::new();
    document.square(None);
    document.json.as_object_mut().unwrap().remove("scenes");
    document.json.as_object_mut().unwrap().remove("scene");
    assert_eq!(loaded(&document).file.shapes.len(), 1);
}

#[test]
fn cameras_are_chosen_or_made() {
    let mut document = Document::new();
    document.square(None);
    let without = loaded(&document);
    assert!(warns(&without, "shows everything"));
    // All corners are in the picture.
    let inside = |loaded: &LoadedScene| {
        let to_camera = Mat4::from_cols_array(&loaded.file.camera.to_world).transpose().inverse();
        let half = (loaded.file.camera.fov / 2.0).to_radians().tan();
        let aspect = loaded.file.film.width as f32 / loaded.file.film.height as f32;
        corners(loaded, 0).iter().flatten().all(|&corner| {
            let p = to_camera.transform_point3(corner);
            p.z > 0.0 && p.x.abs() < half * p.z && p.y.abs() < half * p.z / aspect
        })
    };
    assert!(inside(&without));
    for (aspect, size) in [(Some(2.0), [1440, 720]), (Some(0.5), [360, 720]), (None, [1280, 720])] {
        let mut lens = json!({ "yfov": 1.0, "znear": 0.1 });
        if let Some(aspect) = aspect {
            lens["aspectRatio"] = json!(aspect);
        }
        let camera = document.add("cameras", json!({ "type": "perspective", "perspective": lens, "name": "b" }));
        let mut alone = Document { json: document.json.clone(), buffer: document.buffer.clone() };
        alone.add_node(json!({ "camera": camera }));
        let found = loaded(&alone);
        assert_eq!([found.file.film.width, found.file.film.height], size);
        let aspect = size[0] as f32 / size[1] as f32;
        assert!(near((found.file.camera.fov / 2.0).to_radians().tan(), aspect * 0.5f32.tan()));
    }
    document.add_node(json!({ "camera": 1 }));
    document.json["cameras"][1]["perspective"]["yfov"] = json!(4.0);
    assert!(refused(&document, "no angle").contains("cameras[1]"));
}

#[test]
fn lights_by_kind() {
    let mut document = Document::new();
    document.square(None);
    let without = loaded(&document);
    assert_eq!(without.file.lights, [LightFile::Constant { radiance: [1.0; 3] }]);
    assert!(warns(&without, "white environment"));
    document.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [
        { "type": "point", "color": [1.0, 0.5, 0.0], "intensity": 4.0, "range": 3.0 },
        { "type": "directional", "intensity": 3.0 },
        { "type": "spot", "intensity": 2.0, "spot": { "innerConeAngle": 0.25, "outerConeAngle": 0.5 } }
    ] } });
    document.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    document.json["extensionsRequired"] = json!(["KHR_lights_punctual"]);
    for light in 0..3 {
        document.add_node(json!({
            "extensions": { "KHR_lights_punctual": { "light": light } },
            "translation": [1.0, 2.0, 3.0], "rotation": [0.0, 1.0, 0.0, 0.0], "scale": [5.0, 5.0, 5.0]
        }));
    }
    let found = loaded(&document);
    assert!(warns(&found, "range"));
    let [point, sun, spot] = &found.file.lights[..] else { panic!("{:?}", found.file.lights) };
    assert_eq!(*point, LightFile::Point { position: [1.0, 2.0, 3.0], intensity: [4.0, 2.0, 0.0] });
    let LightFile::Directional { direction, irradiance } = sun else { panic!("{sun:?}") };
    // Half a turn about y from −z.
    assert!(near(direction[2], 1.0) && *irradiance == [3.0; 3]);
    let LightFile::Spot { to_world, intensity, cutoff_angle, beam_width } = spot else { panic!("{spot:?}") };
    let to_world = Mat4::from_cols_array(to_world).transpose();
    assert!(to_world.transform_vector3(Vec3::Z).distance(Vec3::Z) < 1e-6);
    assert_eq!(to_world.transform_point3(Vec3::ZERO), Vec3::new(1.0, 2.0, 3.0));
    assert!(near(*cutoff_angle, 0.5f32.to_degrees()) && near(*beam_width, 0.25f32.to_degrees()));
    assert_eq!(*intensity, [2.0; 3]);
    Scene::build(&found, [4, 4]).unwrap();
    document.json["extensions"]["KHR_lights_punctual"]["lights"][0]["type"] = json!("laser");
    assert!(refused(&document, "no such light").contains("spot"));
}

/// Morph targets by their weights, then joints where the nodes are.
#[test]
fn poses() {
    let mut document = Document::new();
    document.square(None);
    let moves = document.floats(3, &[0., 0., 4., 0., 0., 0., 0., 0., 0., 0., 0., 0.]);
    document.json["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": moves }]);
    document.json["meshes"][0]["weights"] = json!([0.5]);
    document.add("animations", json!({ "channels": [], "samplers": [] }));
    let found = loaded(&document);
    assert!(warns(&found, "animations are left out"));
    assert_eq!(corners(&found, 0)[0][0], Vec3::new(-1.0, -1.0, 2.0));
    // Half of the second joint moves the first vertex; the node's own place does not count.
    let joints = document.view(&[0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    let joints =
        document.add("accessors", json!({ "bufferView": joints, "componentType": U8, "count": 4, "type": "VEC4" }));
    let weights = document.floats(4, &[0.5, 0.5, 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0.]);
    document.json["meshes"][0]["primitives"][0]["attributes"]["JOINTS_0"] = json!(joints);
    document.json["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] = json!(weights);
    let inverse = Mat4::from_translation(Vec3::X * -10.0);
    let inverses = document.floats(16, &[inverse.to_cols_array(), inverse.to_cols_array()].concat());
    document.json["accessors"][inverses]["type"] = json!("MAT4");
    let first = document.add_node(json!({ "translation": [10.0, 0.0, 0.0], "children": [2] }));
    document.add("nodes", json!({ "translation": [0.0, 6.0, 0.0] }));
    document.add("skins", json!({ "joints": [first, 2], "inverseBindMatrices": inverses }));
    document.json["nodes"][0]["skin"] = json!(0);
    document.json["nodes"][0]["translation"] = json!([100.0, 0.0, 0.0]);
    let found = loaded(&document);
    let [a, b, _] = corners(&found, 0)[0];
    assert!(a.distance(Vec3::new(-1.0, 2.0, 2.0)) < 1e-5 && b.distance(Vec3::new(1.0, -1.0, 0.0)) < 1e-5, "{a} {b}");
    document.json["skins"][0]["joints"] = json!([first, 77]);
    assert!(refused(&document, "no such joint").contains("skins[0]"));
}

/// Buffers and pictures beside the document, which may be missing.
#[test]
fn files_beside_the_document() {
    let folder = folder();
    let mut document = Document::new();
    let picture = document.add("images", json!({ "uri": "a%20picture.png" }));
    let texture = document.add("textures", json!({ "source": picture }));
    let material =
        document.add("materials", json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": texture } } }));
    document.square(Some(material));
    let mut json = document.json.clone();
    json["buffers"] = json!([{ "byteLength": document.buffer.len(), "uri": "its%20data.bin" }]);
    let path = folder.path().join("tested.gltf");
    std::fs::write(&path, json.to_string()).unwrap();
    let Err(Error::Missing { files, .. }) = load(&path) else { panic!("both files are missing") };
    let mut names: Vec<_> = files.into_iter().map(|(file, _)| file).collect();
    names.sort();
    assert_eq!(names, ["a picture.png", "its data.bin"]);
    let without = load_lacking(&path, &[], Missing::Skip).unwrap();
    assert!(without.file.shapes.is_empty() && without.missing.len() == 2, "{:?}", without.missing);
    assert!(warns(&without, "its buffer \"its data.bin\" is missing"));
    std::fs::write(folder.path().join("its data.bin"), &document.buffer).unwrap();
    let grey = load_lacking(&path, &[], Missing::Skip).unwrap();
    assert!(warns(&grey, "constant 0.5") && grey.file.shapes.len() == 1, "{:?}", grey.warnings);
    std::fs::write(folder.path().join("a picture.png"), png(1, &[[255, 0, 0, 255]])).unwrap();
    let whole = load(&path).unwrap();
    assert_eq!((whole.images.len(), whole.missing.len()), (1, 0));
    std::fs::write(folder.path().join("a picture.png"), "GIF89a......").unwrap();
    let message = load(&path).unwrap_err().to_string();
    assert!(message.contains("images[0]") && message.contains("PNG, JPEG and WebP"), "{message}");
    std::fs::write(folder.path().join("a picture.png"), "RIFF....WEBP").unwrap();
    let message = load(&path).unwrap_err().to_string();
    assert!(message.contains("images[0]") && message.contains("not a readable picture"), "{message}");
    json["buffers"][0]["uri"] = json!("../outside.bin");
    std::fs::write(&path, json.to_string()).unwrap();
    assert!(load(&path).unwrap_err().to_string().contains("buffers[0]"));
    // A folder that holds the document.
    std::fs::write(folder.path().join("scene.gltf"), in_gltf().text()).unwrap();
    let _: SceneFile = load(folder.path()).unwrap().file;
}

/// What exporters write beside the specification, in parts that are not read: none of it keeps a scene from being read.
#[test]
fn careless_documents() {
    let mut document = Document::new();
    document.square(None);
    document.json["animations"] = json!([{ "channels": [{ "sampler": 0, "target": { "path": "pointer" } }],
        "samplers": [{ "input": 0, "output": 0 }] }]);
    document.json["extras"] = json!("made by hand");
    document.json["nodes"][0]["extras"] = json!(["any", 1]);
    document.json["materials"] = json!([{ "extensions": { "KHR_materials_volume": {
        "thicknessFactor": 0.0, "attenuationDistance": null } } }]);
    document.json["scenes"] = json!([document.json["scenes"][0], {}]);
    let found = loaded(&document);
    assert_eq!(found.file.shapes.len(), 1);
    assert!(warns(&found, "animations are left out"));
    // What is wrong elsewhere is told with its line.
    document.json["nodes"][0]["mesh"] = json!("first");
    assert!(refused(&document, "a mesh by name").contains("not a readable glTF document"));
}

/// A primitive without positions draws nothing.
#[test]
fn primitives_of_nothing() {
    let mut document = Document::new();
    document.square(None);
    let colors = document.floats(3, &[1.0; 9]);
    let primitives = document.json["meshes"][0]["primitives"].as_array_mut().unwrap();
    primitives.push(json!({ "attributes": { "COLOR_0": colors } }));
    let found = loaded(&document);
    assert_eq!(found.meshes.len(), 1);
}
