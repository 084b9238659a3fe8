//! Scenes in glTF 2.0, binary or not, with their buffers and pictures inside or beside them.
//!
//! What is in a document is known by its part, such as `nodes[3].mesh`, and that is what messages name. A glTF scene is +y up and in
//! metres, as ours may be; its cameras look along −z. What the document holds, meshes and pictures, stays in memory.

mod accessor;
mod base;
mod buffers;
mod cameras;
mod corners;
mod document;
mod dress;
mod extensions;
mod glass;
mod glb;
mod glow;
mod grain;
mod handedness;
mod instances;
mod lights;
mod lobes;
mod materials;
mod meshes;
mod nodes;
mod pictures;
mod pose;
mod primitive;
mod slots;
mod textures;
mod uri;
mod warnings;

pub(super) use cameras::framing;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use glam::{DVec3, Vec3};

use crate::base::Result;
use crate::geometry::mesh::Mesh;
use crate::materials::texture::Texture;
use crate::picture::Texels;
use crate::scene::file::{GeometryFile, LightFile, MeshFile, SceneFile, ShapeFile};

use super::frames::rounded;
use super::missing::Absent;
use super::places::Places;
use super::{Read, extent};
use buffers::Buffers;
use document::Document;
use dress::{Part, Wardrobe};
use meshes::{Key, Meshes, Shown};
use nodes::Placed;
use pictures::Pictures;
use textures::Textures;
use warnings::Warnings;

/// Mean radiance of what shines over the box around the scene below which more light is added.
const DIM: f64 = 0.02;

/// Translates the document at `path`.
///
/// # Errors
/// [`Error::Io`](crate::base::Error::Io), `Malformed`, `Unsupported`, `Limit`, each with the part of the document.
pub(super) fn read(path: &Path) -> Result<Read> {
    let document = Document::open(path)?;
    let (mut warnings, mut absent) = (Warnings::new(path), Vec::new());
    extensions::check(&document, &mut warnings)?;
    if document.moves {
        warnings.add("animations", "animations are left out: everything is where the nodes are");
    }
    let buffers = Buffers::read(&document, &mut absent)?;
    let nodes = nodes::placed(&document, &mut warnings)?;
    let Meshes { shown, read, materials } = meshes::read(&document, &buffers, &nodes, &mut warnings)?;
    let pictures = Pictures::decode(&document, &buffers, &wanted(&document, &materials)?, &mut absent)?;
    let mut textures = Textures { document: &document, pictures, warnings: &mut warnings };
    let (mut wardrobe, mut parts) = (Wardrobe::default(), BTreeMap::new());
    for (key, read) in read {
        parts.insert(key, wardrobe.dress(&mut textures, &key.part(), read)?);
    }
    let Textures { pictures, .. } = textures;
    let mut file = empty(&document, &wardrobe);
    let mut places = Places::new(path);
    for name in file.materials.keys() {
        places.set(format!("materials.{name}"), document.place(name));
    }
    for name in file.meshes.keys() {
        places.set(format!("meshes.{name}"), document.place(name));
    }
    file.shapes = shapes(&shown, &parts, &document, &mut places);
    let bounds = extent::around(&file.shapes, &wardrobe.held.meshes);
    file.lights = lights(&document, &nodes, &mut places, &mut warnings)?;
    if file.lights.is_empty() {
        let glow = glow(&file.shapes, &wardrobe.held.meshes, pictures.made(), bounds)?;
        file.lights.extend(surroundings(glow, &mut warnings));
    }
    cameras::cameras(&document, &nodes, bounds, &mut file, &mut places, &mut warnings)?;
    let mut held = wardrobe.held;
    held.pictures.extend(pictures.into_made());
    Ok(Read { file, places, warnings: warnings.into_lines(), absent: once(absent), held })
}

/// Each missing file once.
fn once(mut absent: Vec<Absent>) -> Vec<Absent> {
    let mut seen = BTreeSet::new();
    absent.retain(|absent| seen.insert(absent.file.clone()));
    absent
}

/// The pictures that these materials use.
fn wanted(document: &Document, materials: &BTreeSet<Option<usize>>) -> Result<BTreeSet<usize>> {
    let mut wanted = BTreeSet::new();
    for &index in materials {
        let user = index.map_or(String::new(), |index| format!("materials[{index}]"));
        for reference in slots::references(&meshes::material(document, index, &user)?) {
            wanted.extend(textures::picture(document, &reference, &user)?);
        }
    }
    Ok(wanted)
}

/// The scene with its materials and meshes, and nothing else yet.
fn empty(document: &Document, wardrobe: &Wardrobe) -> SceneFile {
    let scene = document.root.scene.and_then(|index| document.root.scenes.get(index.value()));
    let stem = document.path().file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let (camera, film) = cameras::framing([DVec3::NEG_ONE, DVec3::ONE]);
    let name = scene.and_then(|scene| scene.name.clone()).unwrap_or(stem);
    let held = |name: &String| (name.clone(), MeshFile::Held { part: name.clone() });
    SceneFile {
        materials: wardrobe.materials(),
        media: wardrobe.media(),
        meshes: wardrobe.held.meshes.keys().map(held).collect(),
        ..SceneFile::empty(name, camera, film)
    }
}

fn shapes(
    shown: &[Shown],
    parts: &BTreeMap<Key, Vec<Part>>,
    document: &Document,
    places: &mut Places,
) -> Vec<ShapeFile> {
    let mut shapes = Vec::new();
    for Shown { node, key, to_world } in shown {
        let mirrors = to_world.determinant() < 0.0;
        for Part { mesh, materials, interior, emission, emission_texture } in parts.get(key).into_iter().flatten() {
            places.set(format!("shapes[{}]", shapes.len()), document.place(node.part()));
            shapes.push(ShapeFile {
                name: node.node.name.clone().unwrap_or_default(),
                geometry: GeometryFile::Mesh { mesh: mesh.clone() },
                to_world: rounded(*to_world),
                flip_normals: false,
                material: materials[usize::from(mirrors)].clone(),
                interior: interior.clone(),
                exterior: None,
                emission: *emission,
                emission_texture: emission_texture.clone(),
                unseen: false,
            });
        }
    }
    shapes
}

/// The lights of the nodes.
fn lights(
    document: &Document,
    nodes: &[Placed],
    places: &mut Places,
    warnings: &mut Warnings,
) -> Result<Vec<LightFile>> {
    let mut lights = Vec::new();
    for node in nodes {
        if let Some(light) = lights::light(document, node, warnings)? {
            places.set(format!("lights[{}]", lights.len()), document.place(node.part()));
            lights.push(light);
        }
    }
    Ok(lights)
}

/// Mean radiance of what shines over the box around all shapes, `bounds`, as if the box had it all.
fn glow(
    shapes: &[ShapeFile],
    meshes: &BTreeMap<String, Mesh>,
    pictures: &BTreeMap<String, Texels>,
    [low, high]: [DVec3; 2],
) -> Result<f64> {
    let mut sum = 0.0;
    for shape in shapes {
        let GeometryFile::Mesh { mesh } = &shape.geometry else { continue };
        if let (Some(radiance), Some(mesh)) = (shape.emission, meshes.get(mesh)) {
            let texture = shape.emission_texture.as_ref().map(|file| Texture::new(file, pictures)).transpose()?;
            let of_white = glow::lit_area(mesh, &shape.to_world, texture.as_ref());
            sum += (of_white * Vec3::from_array(radiance).as_dvec3()).element_sum() / 3.0;
        }
    }
    let DVec3 { x, y, z } = (high - low).max(DVec3::ZERO);
    let area = 2.0 * (x * y + y * z + z * x);
    Ok(if area > 0.0 { sum / area } else { 0.0 })
}

/// A white environment where nothing shines, or nothing but a display or a pilot lamp, which viewers of such models light by surroundings.
fn surroundings(glow: f64, warnings: &mut Warnings) -> Option<LightFile> {
    if glow >= DIM {
        return None;
    }
    let why = if glow > 0.0 { "what shines would hardly be seen by its light" } else { "nothing shines" };
    warnings.add("scenes", format_args!("{why}: a white environment of radiance 1 is added"));
    Some(LightFile::Constant { radiance: [1.0; 3] })
}
