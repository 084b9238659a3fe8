//! The spatial cache: a hash grid of cubic cells, each refined by a kd-tree (Zhu 2021 §7).
//!
//! A cell is divided by facing as well: surfaces that look along different axes, or away from each other like the two sides of
//! a wall, receive different light and have voxels of their own. Without this the brighter side of a thin wall decides where
//! the darker one looks for light.

use glam::Vec3;
use hashbrown::HashMap;

/// Index of a voxel.
pub type VoxelId = u32;

#[derive(Debug, Clone, Copy)]
enum Node {
    Leaf(VoxelId),
    Split { axis: u8, position: f32, low: u32 },
}

/// Axis direction that a normal is nearest to: +x, −x, +y, −y, +z, −z are 0 to 5.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Facing(u8);

impl Facing {
    /// Points of a medium have no normal.
    const NONE: Self = Self(6);

    fn of(normal: Vec3) -> Self {
        if normal == Vec3::ZERO {
            return Self::NONE;
        }
        let axis = normal.abs().max_position();
        Self(2 * axis as u8 + u8::from(normal[axis] < 0.0))
    }
}

/// Position and facing of a cell.
type Key = ([i32; 3], Facing);

/// A [`Key`] in two numbers, which take half of the time to hash.
type Packed = (u64, u64);

#[inline(always)]
fn packed(([x, y, z], Facing(facing)): Key) -> Packed {
    let [x, y, z] = [x, y, z].map(|k| u64::from(k.cast_unsigned()));
    (x << 32 | y, z << 32 | u64::from(facing))
}

/// A voxel's box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Smallest corner.
    pub low: Vec3,
    /// Largest corner.
    pub high: Vec3,
    /// Number of times that the cell was halved to reach this voxel.
    pub depth: u32,
}

impl Bounds {
    /// Longest side.
    pub fn size(&self) -> f32 {
        (self.high - self.low).max_element()
    }

    /// Position inside the box as fractions in [0, 1]³.
    pub fn local(&self, point: Vec3) -> Vec3 {
        ((point - self.low) / (self.high - self.low)).clamp(Vec3::ZERO, Vec3::ONE)
    }
}

/// Groups that voxels belong to, from the finest to the coarsest: the cell, blocks of 2³ cells, blocks of 4³ cells, all of one
/// facing. Members of level 0 are voxels, those of a later level the groups of the level before.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Ancestry {
    /// Group of each member, per level.
    pub parents: Vec<Vec<u32>>,
    /// Number of groups per level.
    pub sizes: Vec<usize>,
}

impl Ancestry {
    /// The block of 2³ cells that a voxel belongs to.
    pub fn block(&self, voxel: usize) -> usize {
        self.parents[1][self.parents[0][voxel] as usize] as usize
    }

    /// Sums that `merge` makes over the voxels of each block of 2³ cells.
    pub(in crate::guiding) fn pooled<V, M: Default + Clone>(&self, voxels: &[V], merge: impl Fn(&mut M, &V)) -> Vec<M> {
        let mut blocks = vec![M::default(); self.sizes[1]];
        for (v, voxel) in voxels.iter().enumerate() {
            merge(&mut blocks[self.block(v)], voxel);
        }
        blocks
    }
}

/// Parts of a [`SpatialCache`], as files hold them.
pub(in crate::guiding) struct CacheParts {
    pub origin: Vec3,
    pub cell: f32,
    pub faces: bool,
    /// Position and facing of every cell, and its root among the nodes.
    pub keys: Vec<([i32; 3], u8)>,
    pub roots: Vec<u32>,
    /// Axis, position and first child of a divided node; [`LEAF`], 0 and the voxel of a leaf.
    pub nodes: Vec<(u8, f32, u32)>,
}

/// Bytes that a voxel takes at most in a [`SpatialCache`]: its bounds and cell, two nodes, its key and its share of a hash map that
/// has just grown.
pub(in crate::guiding) const CELL_BYTES: usize = 160;

/// Value in place of the axis for a node that is not divided.
pub(in crate::guiding) const LEAF: u8 = 3;

/// A partition of the visited part of space into voxels.
#[derive(Debug, Clone)]
pub struct SpatialCache {
    origin: Vec3,
    cell: f32,
    /// Whether surfaces that face differently have voxels of their own.
    faces: bool,
    cells: HashMap<Packed, u32>,
    nodes: Vec<Node>,
    bounds: Vec<Bounds>,
    /// Cell of each voxel.
    cell_of: Vec<u32>,
    /// Keys of the cells in the order in which they were made.
    keys: Vec<Key>,
}

impl SpatialCache {
    /// Cubic cells of side `cell` aligned to `origin`; no voxel yet.
    pub fn new(origin: Vec3, cell: f32) -> Self {
        let cell = if cell.is_finite() && cell > 0.0 { cell } else { 1.0 };
        Self {
            origin,
            cell,
            faces: true,
            cells: HashMap::new(),
            nodes: Vec::new(),
            bounds: Vec::new(),
            cell_of: Vec::new(),
            keys: Vec::new(),
        }
    }

    /// Makes voxels hold surfaces of all facings (Müller 2017).
    pub fn without_facing(mut self) -> Self {
        self.faces = false;
        self
    }

    /// Cells of 1/`resolution` of the diagonal of the box around `points` (Zhu 2021 §7). One point in two hundred is left
    /// out at each end of each axis: a few far hits on a ground plane must not set the scale.
    pub fn fit(points: &[Vec3], resolution: f32) -> Self {
        let mut low = Vec3::ZERO;
        let mut high = Vec3::ZERO;
        let mut sorted: Vec<f32> = Vec::with_capacity(points.len());
        for axis in 0..3 {
            sorted.clear();
            sorted.extend(points.iter().map(|p| p[axis]).filter(|x| x.is_finite()));
            if sorted.is_empty() {
                continue;
            }
            let skip = sorted.len() / 200;
            let last = sorted.len() - 1;
            low[axis] = *sorted.select_nth_unstable_by(skip, f32::total_cmp).1;
            high[axis] = *sorted.select_nth_unstable_by(last - skip, f32::total_cmp).1;
        }
        Self::new(low, (high - low).length() / resolution)
    }

    /// Number of voxels.
    pub fn len(&self) -> usize {
        self.bounds.len()
    }

    /// Whether there are no voxels.
    pub fn is_empty(&self) -> bool {
        self.bounds.is_empty()
    }

    /// A voxel's box.
    pub fn bounds(&self, voxel: VoxelId) -> Bounds {
        self.bounds[voxel as usize]
    }

    #[inline(always)]
    fn key(&self, point: Vec3, normal: Vec3) -> Key {
        // Casting saturates, so a point at infinity has a key like any other.
        let cell = ((point - self.origin) / self.cell).floor().to_array().map(|x| x as i32);
        (cell, if self.faces { Facing::of(normal) } else { Facing(0) })
    }

    /// The groups that voxels belong to.
    pub fn ancestry(&self) -> Ancestry {
        let mut ancestry = Ancestry { parents: vec![self.cell_of.clone()], sizes: vec![self.keys.len()] };
        let mut keys = self.keys.clone();
        for _ in 0..2 {
            let mut known = HashMap::new();
            let mut blocks = Vec::new();
            let block = keys.iter().map(|&(cell, facing)| {
                let key = (cell.map(|k| k >> 1), facing);
                *known.entry(key).or_insert_with(|| {
                    blocks.push(key);
                    blocks.len() as u32 - 1
                })
            });
            ancestry.parents.push(block.collect());
            ancestry.sizes.push(blocks.len());
            keys = blocks;
        }
        ancestry
    }

    /// The voxel that holds `point` of a surface with this normal, on the side that the normal points to.
    #[inline(always)]
    pub fn find(&self, point: Vec3, normal: Vec3) -> Option<VoxelId> {
        let mut node = *self.cells.get(&packed(self.key(point, normal)))?;
        loop {
            match self.nodes[node as usize] {
                Node::Leaf(voxel) => return Some(voxel),
                Node::Split { axis, position, low } => node = low + u32::from(point[axis as usize] >= position),
            }
        }
    }

    /// The voxel that [`SpatialCache::find`] would find, made if there is none.
    pub fn find_or_insert(&mut self, point: Vec3, normal: Vec3) -> VoxelId {
        if let Some(voxel) = self.find(point, normal) {
            return voxel;
        }
        let key = self.key(point, normal);
        let voxel = self.bounds.len() as VoxelId;
        let low = self.corner(key.0);
        self.bounds.push(Bounds { low, high: low + Vec3::splat(self.cell), depth: 0 });
        self.cell_of.push(self.keys.len() as u32);
        self.keys.push(key);
        self.cells.insert(packed(key), self.nodes.len() as u32);
        self.nodes.push(Node::Leaf(voxel));
        voxel
    }

    /// Halves every voxel for which `choose` says so, along alternating axes. The lower half keeps the voxel's number; the
    /// upper half gets the next free one. Returns the pairs (old, new) in order.
    pub fn split(&mut self, mut choose: impl FnMut(VoxelId) -> bool) -> Vec<(VoxelId, VoxelId)> {
        let mut pairs = Vec::new();
        for node in 0..self.nodes.len() {
            let Node::Leaf(voxel) = self.nodes[node] else { continue };
            if !choose(voxel) {
                continue;
            }
            let bounds = self.bounds[voxel as usize];
            let axis = (bounds.depth % 3) as usize;
            let middle = 0.5 * (bounds.low[axis] + bounds.high[axis]);
            if !(middle > bounds.low[axis] && middle < bounds.high[axis]) {
                continue;
            }
            let upper = self.bounds.len() as VoxelId;
            let (mut low, mut high) = (bounds, bounds);
            low.high[axis] = middle;
            high.low[axis] = middle;
            low.depth += 1;
            high.depth += 1;
            self.bounds[voxel as usize] = low;
            self.bounds.push(high);
            self.cell_of.push(self.cell_of[voxel as usize]);
            let first = self.nodes.len() as u32;
            self.nodes.extend([Node::Leaf(voxel), Node::Leaf(upper)]);
            self.nodes[node] = Node::Split { axis: axis as u8, position: middle, low: first };
            pairs.push((voxel, upper));
        }
        pairs
    }

    /// Parts of the cache, for files.
    pub(in crate::guiding) fn parts(&self) -> CacheParts {
        let roots = self.keys.iter().filter_map(|key| self.cells.get(&packed(*key)).copied()).collect();
        let node = |node: &Node| match *node {
            Node::Leaf(voxel) => (LEAF, 0.0, voxel),
            Node::Split { axis, position, low } => (axis, position, low),
        };
        CacheParts {
            origin: self.origin,
            cell: self.cell,
            faces: self.faces,
            keys: self.keys.iter().map(|&(cell, facing)| (cell, facing.0)).collect(),
            roots,
            nodes: self.nodes.iter().map(node).collect(),
        }
    }

    /// Builds a cache from its parts, with as many voxels as there are leaves.
    ///
    /// # Errors
    /// A sentence saying what is inconsistent.
    pub(in crate::guiding) fn from_parts(parts: &CacheParts) -> Result<Self, String> {
        let sound = parts.origin.is_finite() && parts.cell.is_finite() && parts.cell > 0.0;
        if !sound || parts.roots.len() != parts.keys.len() {
            return Err("a grid that is not finite, or cells without a root".into());
        }
        let mut cache = Self::new(parts.origin, parts.cell);
        cache.faces = parts.faces;
        let leaves = parts.nodes.iter().filter(|node| node.0 == LEAF).count();
        let nowhere = Bounds { low: Vec3::ZERO, high: Vec3::ZERO, depth: u32::MAX };
        cache.bounds = vec![nowhere; leaves];
        cache.cell_of = vec![0; leaves];
        let mut visited = 0;
        for (i, (&(cell, facing), &root)) in parts.keys.iter().zip(&parts.roots).enumerate() {
            if facing > Facing::NONE.0 {
                return Err(format!("cell {i} faces in direction {facing}, expected 0 to 6"));
            }
            let key = (cell, Facing(facing));
            cache.keys.push(key);
            if cache.cells.insert(packed(key), root).is_some() {
                return Err(format!("cell {i} is there twice"));
            }
            let low = cache.corner(cell);
            let mut open = vec![(root, Bounds { low, high: low + Vec3::splat(cache.cell), depth: 0 })];
            while let Some((node, bounds)) = open.pop() {
                visited += 1;
                // More visits than nodes: some node has two parents.
                let node = parts.nodes.get(node as usize).filter(|_| visited <= parts.nodes.len());
                match node {
                    Some(&(LEAF, _, voxel)) if cache.bounds.get(voxel as usize) == Some(&nowhere) => {
                        cache.bounds[voxel as usize] = bounds;
                        cache.cell_of[voxel as usize] = i as u32;
                    }
                    Some(&(axis @ 0..=2, position, first)) if position.is_finite() => {
                        let (mut below, mut above) = (bounds, bounds);
                        below.high[axis as usize] = position;
                        above.low[axis as usize] = position;
                        (below.depth, above.depth) = (bounds.depth + 1, bounds.depth + 1);
                        open.extend([(first, below), (first.saturating_add(1), above)]);
                    }
                    _ => return Err(format!("the nodes of cell {i} are no tree with voxels of its own")),
                }
            }
        }
        if visited != parts.nodes.len() {
            return Err(format!("{} nodes, but {visited} belong to a cell", parts.nodes.len()));
        }
        let node = |&(axis, position, at): &(u8, f32, u32)| match axis {
            LEAF => Node::Leaf(at),
            axis => Node::Split { axis, position, low: at },
        };
        cache.nodes = parts.nodes.iter().map(node).collect();
        Ok(cache)
    }

    fn corner(&self, cell: [i32; 3]) -> Vec3 {
        self.origin + Vec3::from_array(cell.map(|k| k as f32)) * self.cell
    }

    /// The voxels around a point, whatever they face.
    pub fn find_all(&self, point: Vec3) -> Vec<VoxelId> {
        let axes = [Vec3::X, Vec3::Y, Vec3::Z];
        let normals = axes.iter().flat_map(|&axis| [axis, -axis]).chain([Vec3::ZERO]);
        let mut found: Vec<VoxelId> = normals.filter_map(|normal| self.find(point, normal)).collect();
        found.dedup();
        found
    }

    /// The axis direction that the surfaces of a voxel face; none where voxels hold surfaces of all facings.
    pub fn facing(&self, voxel: VoxelId) -> Option<&'static str> {
        let (_, facing) = self.keys[self.cell_of[voxel as usize] as usize];
        self.faces.then(|| ["+x", "-x", "+y", "-y", "+z", "-z", "a medium"][facing.0 as usize])
    }

    /// Bytes in use.
    pub fn bytes(&self) -> usize {
        self.nodes.len() * size_of::<Node>()
            + self.bounds.len() * (size_of::<Bounds>() + size_of::<u32>())
            + self.keys.len() * size_of::<([i32; 3], Facing)>()
            + self.cells.capacity() * (size_of::<(Packed, u32)>() + 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    const UP: Vec3 = Vec3::Y;

    #[test]
    fn two_sides_of_a_wall_are_apart() {
        let mut cache = SpatialCache::new(Vec3::ZERO, 1.0);
        let voxels = [1.0, -1.0]
            .map(|x| Vec3::new(x, 0.2, 0.0).normalize())
            .map(|side| cache.find_or_insert(Vec3::splat(0.5), side));
        assert_ne!(voxels[0], voxels[1]);
        assert_eq!(cache.bounds(voxels[0]), cache.bounds(voxels[1]));
        assert_eq!(cache.find(Vec3::splat(0.5), UP), None);
    }

    #[test]
    fn voxels_partition_space_and_survive_splitting() {
        let mut random = Random::new(1, 0, 0);
        let mut cache = SpatialCache::new(Vec3::splat(-0.3), 0.25);
        let points: Vec<Vec3> =
            (0..2000).map(|_| Vec3::new(random.next_f32(), random.next_f32(), random.next_f32())).collect();
        points.iter().for_each(|&p| _ = cache.find_or_insert(p, UP));
        for round in 0..4 {
            let pairs = cache.split(|v| v % 2 == round % 2);
            assert!(!pairs.is_empty());
            for &p in &points {
                let b = cache.bounds(cache.find(p, UP).unwrap());
                assert!(p.cmpge(b.low - 1e-6).all() && p.cmple(b.high + 1e-6).all(), "{p} in {b:?}");
            }
        }
        assert_eq!(cache.find(Vec3::splat(50.0), UP), None);
    }

    #[test]
    fn ancestors_are_the_cells_around() {
        let mut cache = SpatialCache::new(Vec3::ZERO, 1.0);
        let at = |cache: &mut SpatialCache, x: f32, n: Vec3| cache.find_or_insert(Vec3::new(x, 0.5, 0.5), n);
        let [a, b, c, d] = [(0.5, UP), (1.5, UP), (2.5, UP), (0.5, -UP)].map(|(x, n)| at(&mut cache, x, n) as usize);
        let (_, half) = cache.split(|v| v as usize == a)[0];
        let ancestry = cache.ancestry();
        let cells = &ancestry.parents[0];
        assert_eq!(cells[a], cells[half as usize], "halves of one cell");
        let block = |v: usize| ancestry.parents[1][cells[v] as usize];
        assert!(block(a) == block(b) && block(a) != block(c) && block(a) != block(d));
        let large = |v: usize| ancestry.parents[2][block(v) as usize];
        assert!(large(a) == large(c) && large(a) != large(d));
        assert_eq!(ancestry.sizes, [4, 3, 2]);
    }

    #[test]
    fn a06_extreme_points_have_a_voxel() {
        let mut cache = SpatialCache::fit(&[Vec3::splat(1e6), Vec3::splat(1e6 + 1.0)], 20.0);
        for p in [Vec3::INFINITY, Vec3::NEG_INFINITY, Vec3::splat(1e30), Vec3::splat(1e6)] {
            let voxel = cache.find_or_insert(p, UP);
            assert_eq!(cache.find(p, UP), Some(voxel));
        }
        assert!(SpatialCache::fit(&[], 20.0).find(Vec3::ZERO, UP).is_none());
        assert!(SpatialCache::fit(&[Vec3::ONE; 5], 20.0).find(Vec3::ONE, UP).is_none());
    }

    /// A few hits on a ground plane that reaches to the horizon, and points that are none, leave the cells as small as
    /// what else is seen wants them. Cells as large as the way to the farthest hit would make one voxel of everything.
    #[test]
    fn a06_far_hits_do_not_set_the_scale() {
        let mut random = Random::new(2, 0, 0);
        let near: Vec<Vec3> =
            (0..1000).map(|_| Vec3::new(random.next_f32(), random.next_f32(), random.next_f32())).collect();
        let far = [[Vec3::splat(1e8); 3].as_slice(), &[Vec3::INFINITY; 10], &[Vec3::NAN; 10]].concat();
        let (alone, all) = (SpatialCache::fit(&near, 24.0), SpatialCache::fit(&[near, far].concat(), 24.0));
        assert_eq!(all.origin, alone.origin);
        // Of the upper end three points more are kept.
        assert!((all.cell / alone.cell - 1.0).abs() < 0.02, "{} {}", all.cell, alone.cell);
        assert!((all.cell - 3f32.sqrt() / 24.0).abs() < 2e-3, "{}", all.cell);
    }
}
