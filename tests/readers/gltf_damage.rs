//! glTF: damaged, hostile and foreign documents give typed errors that name the file and its part.

use fanal::scene::readers::load;
use serde_json::{Value, json};

use crate::gltf::{folder, refused};
use crate::support::files;
use crate::support::gltf::rich;

#[test]
fn cut_off_anywhere() {
    let folder = folder();
    let [text, binary] = [rich().text().into_bytes(), rich().binary()];
    for (name, bytes) in [("tested.gltf", text), ("tested.glb", binary)] {
        let path = folder.path().join(name);
        std::fs::write(&path, &bytes).unwrap();
        load(&path).unwrap();
        for length in (0..bytes.len()).step_by(13).chain([bytes.len() - 1]) {
            std::fs::write(&path, &bytes[..length]).unwrap();
            let message = files::refused(load(&path), name).to_string();
            assert!(message.contains(name), "{length}: {message}");
        }
    }
}

/// Every number of the document, one by one, is set to what breaks most readers; every value to another type.
#[test]
fn wrong_values_anywhere() {
    let folder = folder();
    let path = folder.path().join("tested.gltf");
    let good: Value = serde_json::from_str(&rich().text()).unwrap();
    let mut pointers = vec![];
    collect(&good, String::new(), &mut pointers);
    let mut errors = 0;
    for pointer in pointers {
        for bad in [
            json!(-1),
            json!(77),
            json!(4294967295u64),
            json!(18446744073709551615u64),
            json!(1e30),
            json!("x"),
            json!([]),
            json!({}),
            Value::Null,
        ] {
            let mut document = good.clone();
            *document.pointer_mut(&pointer).unwrap() = bad.clone();
            std::fs::write(&path, document.to_string()).unwrap();
            match load(&path) {
                Ok(_) => {}
                Err(error) => {
                    errors += 1;
                    let message = files::refused(Err(error), &pointer).to_string();
                    assert!(message.contains("tested.gltf"), "{pointer} = {bad}: {message}");
                }
            }
        }
    }
    assert!(errors > 300, "{errors}");
}

fn collect(value: &Value, at: String, pointers: &mut Vec<String>) {
    if !at.is_empty() {
        pointers.push(at.clone());
    }
    match value {
        Value::Array(items) => {
            items.iter().enumerate().for_each(|(i, item)| collect(item, format!("{at}/{i}"), pointers))
        }
        Value::Object(items) => items.iter().for_each(|(key, item)| collect(item, format!("{at}/{key}"), pointers)),
        _ => {}
    }
}

#[test]
fn what_is_said_of_common_faults() {
    let change = |pointer: &str, value: Value| {
        let mut document = rich();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        let parent = document.json.pointer_mut(parent).unwrap();
        match parent {
            Value::Array(items) => items[key.parse::<usize>().unwrap()] = value,
            other => other[key] = value,
        }
        refused(&document, pointer)
    };
    for (pointer, value, words) in [
        ("/asset/version", json!("1.0"), "version \"1.0\" of glTF"),
        ("/asset/minVersion", json!("2.1"), "version \"2.1\" of glTF"),
        ("/scene", json!(3), "there is no scenes[3]"),
        ("/nodes/0/mesh", json!(9), "there is no meshes[9]: there are 1 meshes"),
        ("/nodes/1/camera", json!(9), "there is no cameras[9]"),
        ("/meshes/0/primitives/0/mode", json!(9), "4 (triangles)"),
        ("/meshes/0/primitives/0/material", json!(9), "there is no materials[9]"),
        ("/meshes/0/primitives/0/indices", json!(0), "expected [Scalar]"),
        ("/accessors/0/count", json!(1u64 << 20), "do not fit into a view of 48 bytes"),
        ("/accessors/2/count", json!(1u64 << 40), "number of triangles' corners"),
        ("/accessors/0/byteOffset", json!(u64::MAX), "do not fit"),
        ("/accessors/1/count", json!(3), "has 3 elements, POSITION has 4"),
        ("/accessors/2/componentType", json!(5120), "not unsigned"),
        ("/bufferViews/1/byteLength", json!(1u64 << 50), "its buffer has"),
        ("/bufferViews/1/buffer", json!(5), "there is no buffers[5]"),
        ("/materials/0/normalTexture/index", json!(4), "there is no textures[4]"),
        ("/textures/0/source", json!(4), "there is no images[4]"),
        ("/images/0/bufferView", json!(2), "images[0]"),
        ("/extensionsRequired", json!(["EXT_meshopt_compression"]), "the required extension EXT_meshopt_compression"),
    ] {
        let message = change(pointer, value);
        assert!(message.contains(words), "{pointer}: {message}");
    }
    // Zeros that no byte stands for.
    let mut empty = rich();
    empty.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    empty.json["accessors"][0]["count"] = json!(1u64 << 20);
    empty.json["meshes"][0]["primitives"][0]["attributes"] = json!({ "POSITION": 0 });
    assert!(refused(&empty, "made of nothing").contains("without bytes"));
    // Copies that no byte stands for, at two nodes.
    let mut copies = rich();
    let places = copies.add("accessors", json!({ "componentType": 5126, "count": 1 << 16, "type": "VEC3" }));
    let instancing = json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": places } } });
    for _ in 0..2 {
        copies.add_node(json!({ "mesh": 0, "extensions": instancing }));
    }
    assert!(refused(&copies, "copies of nothing").contains("number of shapes"));
}

#[test]
fn containers() {
    let folder = folder();
    let path = folder.path().join("tested.glb");
    let good = rich().binary();
    let refused = |change: &dyn Fn(&mut Vec<u8>), words: &str| {
        let mut bytes = good.clone();
        change(&mut bytes);
        std::fs::write(&path, &bytes).unwrap();
        let message = files::refused(load(&path), words).to_string();
        assert!(message.contains("tested.glb") && message.contains(words), "{message}");
    };
    refused(&|bytes| bytes[4] = 1, "version 1");
    refused(&|bytes| bytes[16] = b'X', "first chunk");
    refused(&|bytes| bytes[12..16].copy_from_slice(&[255; 4]), "midst of a chunk");
    refused(&|bytes| bytes[8..12].copy_from_slice(&[255; 4]), "should have");
    refused(&|bytes| bytes.truncate(11), "midst");
    refused(&|bytes| bytes[20] = b'}', "glTF document");
    // A chunk that is none of ours, and a text document by another name.
    let mut bytes = rich().binary();
    bytes.extend(8u32.to_le_bytes());
    bytes.extend(b"MOREabcdefgh");
    let length = bytes.len() as u32;
    bytes[8..12].copy_from_slice(&length.to_le_bytes());
    std::fs::write(&path, &bytes).unwrap();
    load(&path).unwrap();
    std::fs::write(&path, rich().text()).unwrap();
    load(&path).unwrap();
}
