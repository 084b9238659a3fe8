//! Packed trees as arrays of a file, shared by guide files and checkpoints. [`file`](crate::guiding::sample::file) lists the names.

use super::sampler::{Node, SamplingTree};
use crate::base::Result;
use crate::base::tensors::{Arrays, Dtype, Tensor, Tensors, vector};

/// The arrays `kind_offset`, `kind_shares` and `kind_uniform` of trees, some of which may be missing.
pub(in crate::guiding) fn tree_arrays<'a>(kind: &str, trees: &[Option<&SamplingTree>]) -> [Tensor<'a>; 3] {
    let (mut offsets, mut nodes, mut uniforms) = (vec![0u64], Vec::new(), Vec::new());
    for tree in trees {
        let (inner, part) = tree.map_or((&[][..], 0.0), SamplingTree::parts);
        nodes.extend(inner.iter().flat_map(|node| {
            let [a, b, c] = node.begin();
            [a, b, c, node.inner()]
        }));
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

/// Reads the `count` trees that [`tree_arrays`] wrote.
///
/// # Errors
/// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
pub(in crate::guiding) fn read_trees(file: &Tensors, kind: &str, count: usize) -> Result<Vec<Option<SamplingTree>>> {
    let [offset, shares, uniform] = ["offset", "shares", "uniform"].map(|part| format!("{kind}_{part}"));
    let offsets = file.offsets(&offset, count)?;
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
            let node = Node::new([a, b, c], inner, first);
            first += u32::from(node.inner()).count_ones();
            node
        };
        let nodes = own.iter().map(unpack).collect();
        SamplingTree::from_nodes(nodes, uniforms[v])
            .map(Some)
            .or_else(|e| file.fail(format!("{shares} of tree {v}"), e))
    };
    (0..count).map(tree).collect()
}
