//! Many copies of a node's mesh (EXT_mesh_gpu_instancing).

use std::collections::BTreeMap;

use ::gltf::json::Index;
use ::gltf::json::accessor::Type;
use glam::{DMat4, DQuat, DVec3};
use serde::Deserialize;

use crate::base::Result;

use super::accessor::Column;
use super::buffers::Buffers;
use super::document::Document;
use super::nodes::Placed;

const NAME: &str = "EXT_mesh_gpu_instancing";

#[derive(Deserialize)]
struct Instancing {
    attributes: BTreeMap<String, u32>,
}

/// Where the copies of a node's mesh are, relative to the node; the identity alone where the node says nothing of copies.
///
/// # Errors
/// [`Error::Malformed`](crate::base::Error::Malformed) for columns that do not fit; those of
/// [`Buffers::view`].
pub fn instances(document: &Document, buffers: &Buffers<'_>, placed: &Placed) -> Result<Vec<DMat4>> {
    let value = placed.node.extensions.as_ref().and_then(|extensions| extensions.others.get(NAME));
    let Some(value) = value else { return Ok(vec![DMat4::IDENTITY]) };
    let part = format!("nodes[{}].extensions.{NAME}", placed.index);
    let read = Instancing::deserialize(value).map_err(|error| document.malformed(&part, error.to_string()))?;
    let open = |name: &str, kind: Type| -> Result<Option<Column<'_>>> {
        let index = read.attributes.get(name);
        index.map(|&index| Column::new(document, buffers, Index::new(index), &part, &[kind])).transpose()
    };
    let moves = open("TRANSLATION", Type::Vec3)?;
    let turns = open("ROTATION", Type::Vec4)?;
    let scales = open("SCALE", Type::Vec3)?;
    let counts: Vec<usize> = [&moves, &turns, &scales].into_iter().flatten().map(|column| column.count).collect();
    let Some(&count) = counts.first() else { return Ok(vec![DMat4::IDENTITY]) };
    if counts.iter().any(|&other| other != count) {
        return Err(document.malformed(part, format!("its attributes have {counts:?} elements, expected as many each")));
    }
    for column in [&moves, &turns, &scales].into_iter().flatten() {
        column.check_bytes(document, &part)?;
    }
    let vector = |column: &Option<Column>, index, default| {
        column.as_ref().map_or(default, |column| DVec3::from_array(column.get(index).map(f64::from)))
    };
    let rotation = |index| {
        let given = turns.as_ref().map(|column| DQuat::from_array(column.get(index).map(f64::from)));
        given.filter(|turn| turn.length_squared() > 0.0).map_or(DQuat::IDENTITY, DQuat::normalize)
    };
    let one = |index| {
        let (scale, offset) = (vector(&scales, index, DVec3::ONE), vector(&moves, index, DVec3::ZERO));
        DMat4::from_scale_rotation_translation(scale, rotation(index), offset)
    };
    Ok((0..count).map(one).collect())
}
