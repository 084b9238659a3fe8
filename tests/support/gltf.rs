//! glTF documents that are put together part by part.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

/// A document with one buffer.
pub struct Document {
    /// What is not numbers.
    pub json: Value,
    /// The buffer.
    pub buffer: Vec<u8>,
}

/// Types of numbers.
pub const FLOAT: u32 = 5126;
pub const U8: u32 = 5121;
pub const I8: u32 = 5120;
pub const U16: u32 = 5123;
pub const U32: u32 = 5125;

impl Document {
    /// One scene without nodes.
    pub fn new() -> Self {
        let json = json!({
            "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [] }],
            "nodes": [], "meshes": [], "materials": [], "accessors": [], "bufferViews": [], "buffers": []
        });
        Self { json, buffer: Vec::new() }
    }

    /// Appends to a list of the document; returns the index.
    pub fn add(&mut self, list: &str, item: Value) -> usize {
        if self.json.get(list).is_none() {
            self.json[list] = json!([]);
        }
        let list = self.json[list].as_array_mut().unwrap();
        list.push(item);
        list.len() - 1
    }

    /// A node at the top of the scene.
    pub fn add_node(&mut self, node: Value) -> usize {
        let index = self.add("nodes", node);
        self.json["scenes"][0]["nodes"].as_array_mut().unwrap().push(index.into());
        index
    }

    /// A view of bytes that are appended to the buffer.
    pub fn view(&mut self, bytes: &[u8]) -> usize {
        while !self.buffer.len().is_multiple_of(4) {
            self.buffer.push(0);
        }
        let start = self.buffer.len();
        self.buffer.extend(bytes);
        self.add("bufferViews", json!({ "buffer": 0, "byteOffset": start, "byteLength": bytes.len() }))
    }

    /// An accessor of floats, `width` in each element.
    pub fn floats(&mut self, width: usize, numbers: &[f32]) -> usize {
        let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes);
        let kind = ["", "SCALAR", "VEC2", "VEC3", "VEC4"].get(width).copied().unwrap_or("MAT4");
        let count = numbers.len() / width;
        self.add("accessors", json!({ "bufferView": view, "componentType": FLOAT, "count": count, "type": kind }))
    }

    /// An accessor of indices.
    pub fn indices(&mut self, component: u32, numbers: &[u32]) -> usize {
        let width = match component {
            U8 => 1,
            U16 => 2,
            _ => 4,
        };
        let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()[..width].to_vec()).collect();
        let view = self.view(&bytes);
        let count = numbers.len();
        self.add(
            "accessors",
            json!({ "bufferView": view, "componentType": component, "count": count, "type": "SCALAR" }),
        )
    }

    /// A mesh of one primitive.
    pub fn mesh(&mut self, primitive: Value) -> usize {
        self.add("meshes", json!({ "primitives": [primitive] }))
    }

    /// A square [-1, 1]² in z = 0 that faces +z, with texture coordinates whose v points down, at the top of the scene.
    pub fn square(&mut self, material: Option<usize>) -> usize {
        let positions = self.floats(3, &[-1., -1., 0., 1., -1., 0., 1., 1., 0., -1., 1., 0.]);
        let uvs = self.floats(2, &[0., 1., 1., 1., 1., 0., 0., 0.]);
        let indices = self.indices(U16, &[0, 1, 2, 0, 2, 3]);
        let mut primitive = json!({ "attributes": { "POSITION": positions, "TEXCOORD_0": uvs }, "indices": indices });
        if let Some(material) = material {
            primitive["material"] = material.into();
        }
        let mesh = self.mesh(primitive);
        self.add_node(json!({ "mesh": mesh }))
    }

    /// A texture of this picture.
    pub fn texture(&mut self, picture: &[u8]) -> usize {
        let view = self.view(picture);
        let image = self.add("images", json!({ "bufferView": view, "mimeType": "image/png" }));
        self.add("textures", json!({ "source": image }))
    }

    /// As text, with the buffer inside.
    pub fn text(&self) -> String {
        let mut json = self.json.clone();
        let uri = format!("data:application/octet-stream;base64,{}", STANDARD.encode(&self.buffer));
        json["buffers"] = json!([{ "byteLength": self.buffer.len(), "uri": uri }]);
        json.to_string()
    }

    /// As a binary file.
    pub fn binary(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"] = json!([{ "byteLength": self.buffer.len() }]);
        binary(json.to_string().as_bytes(), &self.buffer)
    }
}

/// A binary file with these chunks.
pub fn binary(json: &[u8], buffer: &[u8]) -> Vec<u8> {
    let padded = |bytes: &[u8], with: u8| {
        let mut bytes = bytes.to_vec();
        bytes.resize(bytes.len().next_multiple_of(4), with);
        bytes
    };
    let (json, buffer) = (padded(json, b' '), padded(buffer, 0));
    let length = 12 + 8 + json.len() + 8 + buffer.len();
    let mut out = b"glTF".to_vec();
    out.extend(2u32.to_le_bytes());
    out.extend((length as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &buffer)] {
        out.extend((chunk.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(chunk);
    }
    out
}

/// A PNG picture of these pixels, four bytes each.
pub fn png(width: u32, pixels: &[[u8; 4]]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, width, pixels.len() as u32 / width);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header().unwrap().write_image_data(pixels.as_flattened()).unwrap();
    out
}

/// A document with something of nearly everything.
pub fn rich() -> Document {
    let mut document = Document::new();
    let texture = document.texture(&png(2, &[[9, 99, 199, 255], [255, 128, 0, 51]]));
    let material = document.add(
        "materials",
        json!({
            "pbrMetallicRoughness": {
                "baseColorTexture": { "index": texture }, "metallicRoughnessTexture": { "index": texture }
            },
            "normalTexture": { "index": texture }, "alphaMode": "BLEND", "emissiveFactor": [1.0, 0.5, 0.25]
        }),
    );
    document.square(Some(material));
    document.add("cameras", json!({ "type": "perspective", "perspective": { "yfov": 0.7, "znear": 0.1 } }));
    document.add_node(json!({ "camera": 0, "translation": [0.0, 0.0, 4.0] }));
    document
}
