//! From primitives with their materials to meshes and materials of the scene.

use std::collections::BTreeMap;
use std::sync::Arc;

use ::gltf::json::material::{AlphaMode, Material};
use ::gltf::json::validation::Checked;
use glam::Vec3;

use crate::base::Result;
use crate::geometry::mesh::Mesh;
use crate::materials::texture::Texture;
use crate::scene::file::{Filter, MaterialFile, MediumFile, TextureFile, Wrap, identity3};
use crate::scene::readers::held::Held;
use crate::scene::readers::sheets::{is_open, sheets};
use crate::scene::readers::{image_key, painted};

use super::base::{Base, Paint};
use super::glow;
use super::grain;
use super::handedness;
use super::materials::{Emission, Surface, surface};
use super::meshes::{Read, material};
use super::primitive::Drawn;
use super::slots::{Slots, references};
use super::textures::Textures;

/// Colours of vertices that differ less are the same.
const SAME: f32 = 1.0 / 512.0;

/// A mesh of the scene with its material.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// Name of the mesh.
    pub mesh: String,
    /// Name of the material, and of that for placements that mirror the mesh.
    pub materials: [String; 2],
    /// Name of the medium inside.
    pub interior: Option<String>,
    /// Radiance that it emits.
    pub emission: Option<[f32; 3]>,
    /// Factor on that.
    pub emission_texture: Option<TextureFile>,
}

/// What was made so far.
#[derive(Default)]
pub struct Wardrobe {
    surfaces: BTreeMap<String, Surface>,
    /// Meshes and painted pictures.
    pub held: Held,
}

impl Wardrobe {
    /// Materials by name.
    pub fn materials(&self) -> BTreeMap<String, MaterialFile> {
        self.surfaces.iter().map(|(name, surface)| (name.clone(), surface.material.clone())).collect()
    }

    /// Media by the names of the materials that they are in.
    pub fn media(&self) -> BTreeMap<String, MediumFile> {
        let media = self.surfaces.iter().map(|(name, surface)| (name.clone(), surface.medium.clone()));
        media.filter_map(|(name, medium)| medium.map(|medium| (name, medium))).collect()
    }

    /// The meshes and materials that the primitive called `part` becomes: usually one.
    ///
    /// # Errors
    /// Those of [`surface`].
    pub fn dress(&mut self, textures: &mut Textures, part: &str, read: Read) -> Result<Vec<Part>> {
        let given = material(textures.document, read.material, part)?;
        let owner = read.material.map_or("default".to_owned(), |index| format!("materials[{index}]"));
        let used = references(&given);
        if read.drawn.lacks_uvs && !used.is_empty() {
            textures.warnings.add(part, format_args!("it lacks the texture coordinates that {owner} asks for"));
        }
        let mut drawn = read.drawn;
        if drawn.fades && given.alpha_mode != Checked::Valid(AlphaMode::Opaque) {
            textures.warnings.add(part, "the alpha of COLOR_0 is left out: surfaces are as opaque as their material");
        }
        // Colours that are painted replace the texture coordinates, by which a grain is measured too.
        let paintable = used.is_empty() && !grain::is_asked(&given);
        let paint = self.paint(textures, part, &given, paintable, &mut drawn);
        let name = match &paint {
            Paint::Plain(Vec3::ONE) => owner.clone(),
            Paint::Plain(Vec3 { x, y, z }) => format!("{owner} times {x} {y} {z}"),
            Paint::Picture(_) => format!("{owner} painted as {part}"),
        };
        let set = used.first().map_or(0, |reference| reference.set);
        let surface_of = |textures: &mut Textures, mirrored| {
            surface(&mut Slots { textures, part: &owner, set, mirrored }, &given, &paint)
        };
        if !self.surfaces.contains_key(&name) {
            let surface = surface_of(textures, false)?;
            self.surfaces.insert(name.clone(), surface);
        }
        let surface = self.surfaces[&name].clone();
        let pieces = match &surface.emission {
            None => vec![(part.to_owned(), drawn.mesh, None)],
            Some(emission) => shining(textures, part, emission, drawn.mesh, given.double_sided)?,
        };
        let mut parts = Vec::new();
        for piece in pieces {
            self.keep(&name, &surface, piece, &mut parts);
        }
        for other in parts.iter().flat_map(|part| &part.materials) {
            if !self.surfaces.contains_key(other) {
                let surface = surface_of(textures, true)?;
                self.surfaces.insert(other.clone(), surface);
            }
        }
        Ok(parts)
    }

    /// Keeps a piece whose material is called `name`; one with a normal map or a grain by how its triangles show
    /// pictures.
    fn keep(&mut self, name: &str, surface: &Surface, (mesh, piece, emission): Piece, parts: &mut Vec<Part>) {
        let (emission, emission_texture) =
            emission.map_or((None, None), |(radiance, texture)| (Some(radiance.to_array()), texture));
        let interior = surface.medium.as_ref().map(|_| name.to_owned());
        let mut keep = |mesh: String, piece: Mesh, materials: [&str; 2]| {
            self.held.meshes.insert(mesh.clone(), piece);
            let materials = materials.map(str::to_owned);
            let (interior, emission_texture) = (interior.clone(), emission_texture.clone());
            parts.push(Part { mesh, materials, interior, emission, emission_texture });
        };
        if !surface.material.is_bumped() && !surface.material.has_grain() {
            return keep(mesh, piece, [name, name]);
        }
        let other = format!("{name} mirrored");
        let [straight, mirrored] = handedness::split(piece);
        let all_straight = mirrored.triangles.is_empty();
        if !all_straight {
            keep(format!("{mesh} mirrored"), mirrored, [&other, name]);
        }
        if all_straight || !straight.triangles.is_empty() {
            keep(mesh, straight, [name, &other]);
        }
    }

    /// What the colours of the vertices do to the base colour: where `paintable`, they are a texture themselves.
    fn paint(
        &mut self,
        textures: &mut Textures,
        part: &str,
        given: &Material,
        paintable: bool,
        drawn: &mut Drawn,
    ) -> Paint {
        let Some(first) = drawn.colors.first().copied() else { return Paint::Plain(Vec3::ONE) };
        if drawn.colors.iter().all(|color| color.abs_diff_eq(first, SAME)) {
            return Paint::Plain(first);
        }
        let factor = Vec3::from_array(Base::factor(given)).clamp(Vec3::ZERO, Vec3::ONE);
        if paintable && let Some((mesh, image)) = painted(&drawn.mesh, &drawn.colors, factor) {
            let file = format!("{part} COLOR_0");
            self.held.pictures.insert(image_key(&file, true), Arc::new(image).into());
            drawn.mesh = mesh;
            let (wrap, filter) = (Wrap::Clamp, Filter::Bilinear);
            return Paint::Picture(TextureFile::Bitmap {
                file,
                to_uv: identity3(),
                raw: true,
                scale: 1.0,
                wrap,
                filter,
            });
        }
        textures.warnings.add(part, "COLOR_0 beside textures or a grain: the mean of the vertices' colours is used");
        Paint::Plain(drawn.colors.iter().sum::<Vec3>() / drawn.colors.len() as f32)
    }
}

/// A piece of a mesh, its name, and what it emits.
type Piece = (String, Mesh, Option<(Vec3, Option<TextureFile>)>);

/// The pieces of a mesh that emits light, from both sides where these are meant and seen.
fn shining(
    textures: &mut Textures,
    part: &str,
    emission: &Emission,
    mesh: Mesh,
    double_sided: bool,
) -> Result<Vec<Piece>> {
    let Emission { radiance, texture } = emission;
    let both = double_sided && is_open(&mesh);
    if both {
        textures.warnings.add(part, "it shines from both sides: it is made of two sheets, back to back");
    }
    let shown = |mesh: Mesh| if both { sheets(&mesh) } else { mesh };
    let Some(file) = texture else { return Ok(vec![(part.to_owned(), shown(mesh), Some((*radiance, None)))]) };
    let split = glow::split(&mesh, &Texture::new(file, textures.pictures.made())?);
    let emitted = match split.is_even {
        true => (*radiance * split.mean, None),
        false => (*radiance, Some(file.clone())),
    };
    let emitted = (split.mean != Vec3::ZERO).then_some(emitted);
    if emitted.is_none() || split.lit.is_empty() {
        return Ok(vec![(part.to_owned(), mesh, None)]);
    }
    if split.dark.is_empty() {
        return Ok(vec![(part.to_owned(), shown(mesh), emitted)]);
    }
    let lit = Mesh { triangles: split.lit, ..mesh.clone() };
    let dark = Mesh { triangles: split.dark, ..mesh };
    Ok(vec![(format!("{part} lit"), shown(lit), emitted), (part.to_owned(), dark, None)])
}
