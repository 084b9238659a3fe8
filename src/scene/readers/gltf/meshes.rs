//! The meshes of the scene's nodes: each primitive is read once, however many nodes show it, unless they pose it.

use std::collections::{BTreeMap, BTreeSet};

use ::gltf::json::Index;
use ::gltf::json::material::Material;
use ::gltf::json::mesh::{Mesh, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use glam::DMat4;
use rayon::prelude::*;

use crate::base::{Error, Result};

use super::buffers::Buffers;
use super::document::Document;
use super::instances::instances;
use super::nodes::Placed;
use super::pose::{Pose, Poses};
use super::primitive::{self, Drawn};
use super::slots::references;
use super::warnings::Warnings;

/// Most primitives that all nodes together show; those that the nodes of any document may show, and bytes of it and of its
/// buffers for each one more. Nodes may share columns without bytes that say where copies are.
const MOST_SHAPES: u64 = 1 << 22;
const FEW_SHAPES: u64 = 1 << 16;
const BYTES_PER_SHAPE: u64 = 2;
/// Corners of triangles that any document may have, and those that it may have for each byte of its buffers. Primitives and poses may
/// share columns, so that little in a file could become much in memory.
const FEW_CORNERS: u64 = 1 << 22;
const CORNERS_PER_BYTE: u64 = 64;

/// A primitive of a mesh, and the node that poses it, if one does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Key {
    mesh: usize,
    primitive: usize,
    posed_by: Option<usize>,
}

impl Key {
    /// Its part of the document.
    pub fn part(&self) -> String {
        let part = format!("meshes[{}].primitives[{}]", self.mesh, self.primitive);
        match self.posed_by {
            Some(node) => format!("{part} of nodes[{node}]"),
            None => part,
        }
    }

    /// Whether its vertices are in the world already, by a skin.
    fn is_skinned(&self, document: &Document) -> bool {
        self.posed_by.and_then(|node| document.root.nodes.get(node)).is_some_and(|node| node.skin.is_some())
    }
}

/// A primitive that a node shows.
#[derive(Debug, Clone)]
pub struct Shown<'a, 'd> {
    /// The node.
    pub node: &'a Placed<'d>,
    /// The primitive.
    pub key: Key,
    /// Mesh to world.
    pub to_world: DMat4,
}

/// A primitive that was read.
#[derive(Debug, Clone)]
pub struct Read {
    /// Its mesh.
    pub drawn: Drawn,
    /// Index of its material; none for the default one.
    pub material: Option<usize>,
}

/// All that the nodes of a scene show.
pub struct Meshes<'a, 'd> {
    /// What each node shows.
    pub shown: Vec<Shown<'a, 'd>>,
    /// The primitives whose buffers are there.
    pub read: BTreeMap<Key, Read>,
    /// Indices of the materials of all primitives; none is the default one.
    pub materials: BTreeSet<Option<usize>>,
}

/// The material with this index; the default one where there is none.
///
/// # Errors
/// [`Error::Malformed`] for one that is not there.
pub fn material(document: &Document, index: Option<usize>, user: &str) -> Result<Material> {
    match index {
        Some(index) => document.at(&document.root.materials, "materials", index, user).cloned(),
        None => Ok(Material::default()),
    }
}

/// A primitive that is to be read.
struct Wanted<'d> {
    primitive: &'d Primitive,
    /// Number of its texture coordinates.
    set: u32,
    pose: Pose,
}

/// What nodes show, before it is read.
struct Gathering<'w, 'a, 'd> {
    document: &'d Document,
    warnings: &'w mut Warnings,
    shown: Vec<Shown<'a, 'd>>,
    most_shapes: u64,
    wanted: BTreeMap<Key, Wanted<'d>>,
    materials: BTreeSet<Option<usize>>,
    /// Number of the triangles' corners of all that is wanted.
    corners: u64,
    most_corners: u64,
}

impl<'a, 'd> Gathering<'_, 'a, 'd> {
    /// Adds copies of the mesh of a node in this pose.
    fn add(&mut self, placed: &'a Placed<'d>, mesh: Index<Mesh>, pose: &Pose, copies: &[DMat4]) -> Result<()> {
        let document = self.document;
        let primitives = &document.item(&document.root.meshes, "meshes", mesh, &placed.part())?.primitives;
        let posed_by = (!pose.is_plain()).then_some(placed.index);
        for (number, primitive) in primitives.iter().enumerate() {
            let key = Key { mesh: mesh.value(), primitive: number, posed_by };
            if !primitive::is_surface(primitive) {
                self.warnings.add(key.part(), "points and lines have no surface: they are left out");
                continue;
            }
            let outer = if key.is_skinned(document) { DMat4::IDENTITY } else { placed.to_world };
            self.limit("number of shapes", (self.shown.len() + copies.len()) as u64, self.most_shapes)?;
            self.shown.extend(copies.iter().map(|copy| Shown { node: placed, key, to_world: outer * *copy }));
            if !self.wanted.contains_key(&key) {
                self.want(key, primitive, pose)?;
            }
        }
        Ok(())
    }

    fn want(&mut self, key: Key, primitive: &'d Primitive, pose: &Pose) -> Result<()> {
        let index = primitive.material.map(|index| index.value());
        let material = material(self.document, index, &key.part())?;
        self.materials.insert(index);
        let set = references(&material).first().map_or(0, |reference| reference.set);
        let positions = primitive.attributes.get(&Checked::Valid(Semantic::Positions)).copied();
        let corners = primitive.indices.or(positions);
        let found = corners.and_then(|accessor| self.document.root.accessors.get(accessor.value()));
        self.corners = self.corners.saturating_add(found.map_or(0, |accessor| accessor.count.0));
        self.limit("number of triangles' corners", self.corners, self.most_corners)?;
        self.wanted.insert(key, Wanted { primitive, set, pose: pose.clone() });
        Ok(())
    }

    fn limit(&self, what: &str, value: u64, limit: u64) -> Result<()> {
        if value <= limit {
            return Ok(());
        }
        Err(Error::Limit { place: self.document.place("meshes"), what: what.to_owned(), value, limit })
    }
}

/// Reads all primitives that `nodes` show. Those whose buffer is missing are left out, with a warning.
///
/// # Errors
/// Those of [`primitive::read`] and [`Poses::of`], for the first primitive that has one.
pub fn read<'a, 'd>(
    document: &'d Document,
    buffers: &Buffers<'_>,
    nodes: &'a [Placed<'d>],
    warnings: &mut Warnings,
) -> Result<Meshes<'a, 'd>> {
    let mut poses = Poses::new(document, buffers, nodes);
    let (shown, wanted, materials) = (Vec::new(), BTreeMap::new(), BTreeSet::new());
    let size = buffers.size() as u64;
    let most_corners = FEW_CORNERS + CORNERS_PER_BYTE * size;
    let most_shapes = MOST_SHAPES.min(FEW_SHAPES + (document.size() as u64 + size) / BYTES_PER_SHAPE);
    let mut gathering =
        Gathering { document, warnings, shown, most_shapes, wanted, materials, corners: 0, most_corners };
    for placed in nodes {
        let Some(mesh) = placed.node.mesh else { continue };
        let pose = match poses.of(placed) {
            Err(Error::Missing { .. }) => Pose::default(),
            other => other?,
        };
        let copies = match instances(document, buffers, placed) {
            Err(Error::Missing { .. }) => Vec::new(),
            other => other?,
        };
        gathering.add(placed, mesh, &pose, &copies)?;
    }
    let Gathering { shown, wanted, materials, .. } = gathering;
    Ok(Meshes { shown, read: draw(document, buffers, wanted, warnings)?, materials })
}

/// Reads primitives in parallel.
fn draw(
    document: &Document,
    buffers: &Buffers<'_>,
    wanted: BTreeMap<Key, Wanted>,
    warnings: &mut Warnings,
) -> Result<BTreeMap<Key, Read>> {
    let keys: Vec<Key> = wanted.keys().copied().collect();
    let read = |(key, wanted): (Key, Wanted)| {
        let Wanted { primitive, set, pose } = wanted;
        let drawn = primitive::read(document, buffers, primitive, &key.part(), set, &pose)?;
        Ok(Read { drawn, material: primitive.material.map(|index| index.value()) })
    };
    let results: Vec<Result<Read>> = wanted.into_par_iter().map(read).collect();
    let mut found = BTreeMap::new();
    for (key, result) in keys.into_iter().zip(results) {
        match result {
            Err(Error::Missing { files, .. }) => {
                let file = files.first().map_or("", |(file, _)| file.as_str());
                warnings.add(key.part(), format_args!("left out: its buffer \"{file}\" is missing"));
            }
            other => drop(found.insert(key, other?)),
        }
    }
    Ok(found)
}
