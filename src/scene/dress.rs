//! Materials that take colours from a mesh: for each of their meshes they become materials of their own, with a picture of the colours
//! in which every triangle has a place. So no other material knows of such colours, and no ray pays for them.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::Vec3;

use super::file::{Filter, GeometryFile, MaterialFile, ShapeFile, TextureFile, Wrap, identity3};
use super::readers::{LoadedScene, image_key, painted_corners};
use crate::geometry::mesh::Mesh;
use crate::picture::Texels;

/// What a shape is made of in place of what its file says.
pub struct Dressed {
    /// Number of others that were made before.
    pub number: u32,
    /// The mesh with texture coordinates of its own.
    pub mesh: Option<Arc<Mesh>>,
    /// The material without colours of a mesh.
    pub material: MaterialFile,
    /// The emission's texture, likewise.
    pub emission_texture: Option<TextureFile>,
    /// Pictures of both, those of the scene among them.
    pub images: BTreeMap<String, Texels>,
}

/// What was made so far: shapes that are alike share it.
pub struct Wardrobe<'a> {
    loaded: &'a LoadedScene,
    /// Names of the materials that take colours from meshes.
    materials: BTreeSet<&'a str>,
    made: BTreeMap<(&'a str, &'a str, String), Option<Dressed>>,
}

fn is_attribute(texture: &TextureFile) -> bool {
    matches!(texture, TextureFile::Attribute { .. })
}

impl<'a> Wardrobe<'a> {
    /// Nothing made yet.
    pub fn new(loaded: &'a LoadedScene) -> Self {
        let takes = |material: &MaterialFile| material.textures().iter().any(|(_, texture)| is_attribute(texture));
        let materials = loaded.file.materials.iter().filter(|(_, material)| takes(material));
        Self { loaded, materials: materials.map(|(name, _)| name.as_str()).collect(), made: BTreeMap::new() }
    }

    /// Dresses a shape that takes colours from its mesh; none for other shapes, which are nearly all.
    pub fn dress(&mut self, shape: &'a ShapeFile) -> Option<&Dressed> {
        let GeometryFile::Mesh { mesh } = &shape.geometry else { return None };
        let glows = shape.emission_texture.as_ref().is_some_and(is_attribute);
        if !glows && !self.materials.contains(shape.material.as_str()) {
            return None;
        }
        let emission = shape.emission_texture.as_ref().map_or(String::new(), |texture| format!("{texture:?}"));
        let number = self.made.len() as u32;
        let key = (shape.material.as_str(), mesh.as_str(), emission);
        self.made.entry(key).or_insert_with(|| dress(shape, self.loaded, number)).as_ref()
    }
}

fn dress(shape: &ShapeFile, loaded: &LoadedScene, number: u32) -> Option<Dressed> {
    let GeometryFile::Mesh { mesh } = &shape.geometry else { return None };
    let mut material = loaded.file.materials.get(&shape.material)?.clone();
    let mut emission_texture = shape.emission_texture.clone();
    let is_placed = |texture: &TextureFile| !is_attribute(texture) && !matches!(texture, TextureFile::Rgb { .. });
    let all = || material.textures().into_iter().map(|(_, texture)| texture).chain(&emission_texture);
    // Pictures and grains need the texture coordinates that the mesh has; the mean of its colours must do then.
    let paintable = !all().any(is_placed) && !material.has_grain();
    let mut images: BTreeMap<String, Texels> = loaded.images.clone();
    let mut painted_mesh = None;
    let mut replace = |texture: &mut TextureFile, most: f32| {
        let TextureFile::Attribute { name, scale } = texture else { return };
        let Some(corners) = loaded.attributes.get(&(mesh.clone(), name.clone())) else { return };
        let clamped: Vec<[Vec3; 3]> = corners
            .iter()
            .map(|corners| corners.map(|color| (color * *scale).clamp(Vec3::ZERO, Vec3::splat(most))))
            .collect();
        let made = loaded.meshes.get(mesh).filter(|_| paintable).and_then(|mesh| painted_corners(mesh, &clamped));
        *texture = match made {
            Some((mesh, image)) => {
                let file = format!("{name} times {scale} up to {most}");
                images.insert(image_key(&file, true), Arc::new(image).into());
                painted_mesh.get_or_insert_with(|| Arc::new(mesh));
                let (wrap, filter) = (Wrap::Clamp, Filter::Bilinear);
                TextureFile::Bitmap { file, to_uv: identity3(), raw: true, scale: 1.0, wrap, filter }
            }
            None => {
                let sum: Vec3 = clamped.iter().flatten().sum();
                TextureFile::rgb((sum / (3 * clamped.len()).max(1) as f32).to_array())
            }
        };
    };
    material.textures_mut().into_iter().for_each(|(_, texture)| replace(texture, 1.0));
    emission_texture.iter_mut().for_each(|texture| replace(texture, f32::MAX));
    Some(Dressed { number, mesh: painted_mesh, material, emission_texture, images })
}
