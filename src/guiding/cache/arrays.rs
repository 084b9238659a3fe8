//! Caches and spheres as arrays of a file, shared by guide files and checkpoints. [`file`](crate::guiding::sample::file) lists the
//! names.

use glam::Vec3;

use super::parallax::Parallax;
use super::{CacheParts, SpatialCache};
use crate::base::Result;
use crate::base::tensors::{Arrays, Dtype, Tensor, Tensors, vector};

/// The arrays of a cache.
pub(in crate::guiding) fn cache_arrays<'a>(cache: &SpatialCache) -> Vec<Tensor<'a>> {
    let CacheParts { origin, cell, faces, keys, roots, nodes } = cache.parts();
    let grid = [origin.x, origin.y, origin.z, cell, f32::from(u8::from(faces))];
    let cells: Vec<u8> = keys.iter().flat_map(|k| k.0).flat_map(i32::to_le_bytes).collect();
    vec![
        vector("cell_facing", Dtype::U8, keys.iter().map(|k| [k.1])),
        ("cell_keys".into(), Dtype::I32, vec![keys.len(), 3], cells.into()),
        vector("cell_roots", Dtype::U32, roots.iter().map(|r| r.to_le_bytes())),
        vector("grid", Dtype::F32, grid.map(f32::to_le_bytes).into_iter()),
        vector("node_axis", Dtype::U8, nodes.iter().map(|n| [n.0])),
        vector("node_child", Dtype::U32, nodes.iter().map(|n| n.2.to_le_bytes())),
        vector("node_position", Dtype::F32, nodes.iter().map(|n| n.1.to_le_bytes())),
    ]
}

/// Reads the cache that [`cache_arrays`] wrote.
///
/// # Errors
/// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
pub(in crate::guiding) fn read_cache(file: &Tensors) -> Result<SpatialCache> {
    let grid = file.read("grid", Dtype::F32, Some(5), 1, f32::from_le_bytes)?;
    let cells = file.read("cell_keys", Dtype::I32, None, 3, i32::from_le_bytes)?;
    let count = cells.len() / 3;
    let facing = file.read("cell_facing", Dtype::U8, Some(count), 1, |[b]| b)?;
    let axis = file.read("node_axis", Dtype::U8, None, 1, |[b]| b)?;
    let position = file.read("node_position", Dtype::F32, Some(axis.len()), 1, f32::from_le_bytes)?;
    let child = file.read("node_child", Dtype::U32, Some(axis.len()), 1, u32::from_le_bytes)?;
    let parts = CacheParts {
        origin: Vec3::new(grid[0], grid[1], grid[2]),
        cell: grid[3],
        faces: grid[4] != 0.0,
        keys: cells.as_chunks::<3>().0.iter().copied().zip(facing).collect(),
        roots: file.read("cell_roots", Dtype::U32, Some(count), 1, u32::from_le_bytes)?,
        nodes: axis.into_iter().zip(position).zip(child).map(|((axis, at), child)| (axis, at, child)).collect(),
    };
    SpatialCache::from_parts(&parts).or_else(|e| file.fail("cells", e))
}

/// Reads one [`Parallax`] for each of `count` voxels.
///
/// # Errors
/// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
pub(in crate::guiding) fn read_parallax(file: &Tensors, name: &str, count: usize) -> Result<Vec<Parallax>> {
    let spheres = file.read(name, Dtype::F32, Some(count), 4, f32::from_le_bytes)?;
    if let Some(bad) = spheres.iter().find(|x| !x.is_finite()) {
        return file.fail(name, format!("{bad} is not finite"));
    }
    let parallax = |&[x, y, z, curvature]: &[f32; 4]| Parallax { centre: Vec3::new(x, y, z), curvature };
    Ok(spheres.as_chunks::<4>().0.iter().map(parallax).collect())
}
