//! Content that a document holds itself, in memory before the scene is checked.

use std::collections::BTreeMap;

use crate::geometry::mesh::Mesh;
use crate::picture::Texels;

use super::textures::image_key;

/// Meshes and pictures that a document holds beside its [`SceneFile`](crate::scene::file::SceneFile).
#[derive(Debug, Default)]
pub struct Held {
    /// Unchecked meshes by the names of their [`MeshFile::Held`](crate::scene::file::MeshFile::Held).
    pub meshes: BTreeMap<String, Mesh>,
    /// Pictures by [`image_key`].
    pub pictures: BTreeMap<String, Texels>,
}

impl Held {
    /// Whether the picture that textures call `file` is here.
    pub fn has_picture(&self, file: &str) -> bool {
        [false, true].iter().any(|&raw| self.pictures.contains_key(&image_key(file, raw)))
    }
}
