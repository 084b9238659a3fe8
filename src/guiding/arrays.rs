//! What guides consist of as arrays of a file, shared by guide files and checkpoints. [`super::file`] lists the names.

use glam::Vec3;

use super::cache::{CacheParts, SpatialCache};
use super::parallax::Parallax;
use super::sampler::{Node, SamplingTree};
use crate::base::Result;
use crate::base::tensors::{Dtype, Tensor, Tensors, vector};

/// The arrays of a cache.
pub(super) fn cache_arrays<'a>(cache: &SpatialCache) -> Vec<Tensor<'a>> {
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

/// The arrays `kind_offset`, `kind_shares` and `kind_uniform` of trees, some of which may be missing.
pub(super) fn tree_arrays<'a>(kind: &str, trees: &[Option<&SamplingTree>]) -> [Tensor<'a>; 3] {
    let (mut offsets, mut nodes, mut uniforms) = (vec![0u64], Vec::new(), Vec::new());
    for tree in trees {
        let (inner, part) = tree.map_or((&[][..], 0.0), SamplingTree::nodes);
        nodes.extend(inner.iter().flat_map(|n| [n.begin[0], n.begin[1], n.begin[2], n.inner]));
        uniforms.push(part);
        offsets.push(nodes.len() as u64 / 4);
    }
    let bytes: Vec<u8> = nodes.iter().flat_map(|x: &u16| x.to_le_bytes()).collect();
    [
        vector(format!("{kind}_offset"), Dtype::U64, offsets.iter().map(|o| o.to_le_bytes())),
        (format!("{kind}_shares").into(), Dtype::U16, vec![nodes.len() / 4, 4], bytes.into()),
        vector(format!("{kind}_uniform"), Dtype::F32, uniforms.iter().map(|u: &f32| u.to_le_bytes())),
    ]
}

/// What [`cache_arrays`] made.
///
/// # Errors
/// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
pub(super) fn read_cache(file: &Tensors) -> Result<SpatialCache> {
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

/// The `count` trees that [`tree_arrays`] made.
///
/// # Errors
/// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
pub(super) fn read_trees(file: &Tensors, kind: &str, count: usize) -> Result<Vec<Option<SamplingTree>>> {
    let [offset, shares, uniform] = ["offset", "shares", "uniform"].map(|part| format!("{kind}_{part}"));
    let offsets = read_offsets(file, &offset, count)?;
    let values = file.read(&shares, Dtype::U16, None, 4, u16::from_le_bytes)?;
    let uniforms = file.read(&uniform, Dtype::F32, Some(count), 1, f32::from_le_bytes)?;
    let nodes = values.as_chunks::<4>().0;
    if offsets[count] != nodes.len() {
        return file.fail(offset, format!("offsets do not divide {} nodes into trees", nodes.len()));
    }
    let tree = |v: usize| {
        let own = &nodes[offsets[v]..offsets[v + 1]];
        if uniforms[v] == 0.0 && own.is_empty() {
            return Ok(None);
        }
        let mut first = 1;
        let unpack = |&[a, b, c, inner]: &[u16; 4]| {
            let node = Node { begin: [a, b, c], inner, first };
            first += (inner & 15).count_ones();
            node
        };
        let nodes = own.iter().map(unpack).collect();
        SamplingTree::from_nodes(nodes, uniforms[v])
            .map(Some)
            .or_else(|e| file.fail(format!("{shares} of tree {v}"), e))
    };
    (0..count).map(tree).collect()
}

/// Where each of `count` things begins, and where the last ends: rising from 0.
///
/// # Errors
/// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
pub(super) fn read_offsets(file: &Tensors, name: &str, count: usize) -> Result<Vec<usize>> {
    let offsets = file.read(name, Dtype::U64, Some(count + 1), 1, u64::from_le_bytes)?;
    if offsets[0] != 0 || !offsets.is_sorted() {
        return file.fail(name, "offsets do not rise from 0");
    }
    Ok(offsets.into_iter().map(|o| usize::try_from(o).unwrap_or(usize::MAX)).collect())
}

/// One [`Parallax`] for each of `count` voxels.
///
/// # Errors
/// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
pub(super) fn read_parallax(file: &Tensors, name: &str, count: usize) -> Result<Vec<Parallax>> {
    let spheres = file.read(name, Dtype::F32, Some(count), 4, f32::from_le_bytes)?;
    if let Some(bad) = spheres.iter().find(|x| !x.is_finite()) {
        return file.fail(name, format!("{bad} is not finite"));
    }
    let parallax = |&[x, y, z, curvature]: &[f32; 4]| Parallax { centre: Vec3::new(x, y, z), curvature };
    Ok(spheres.as_chunks::<4>().0.iter().map(parallax).collect())
}
