//! Steps of a ray through the hierarchy without branches that depend on the ray: which children it meets, in which order, and
//! which stacked children a nearer hit rules out.
//!
//! A stack entry holds the bits of the distance to a child's box above those of the [`Child`](super::super::node::Child). Distances
//! are not negative, so entries are ordered like them.

use std::arch::x86_64::*;

use super::super::node::{Node, WIDTH};
use super::super::query::Slabs;
use super::sixteen::{Bounds, Lane};

/// Room for the entries of a node's children.
pub type Room = [u64; WIDTH];

/// Defines the steps of a ray for one instruction set. All of it is one function, since a call costs as much as the step.
macro_rules! steps {
    ($set:ident, $features:literal) => {
        /// Writes the entries of the children that the ray meets to `room`, the nearest last, and returns their number. Entries
        /// have rounded distances, which are never too large, so that no child is ruled out wrongly.
        #[inline]
        #[target_feature(enable = $features)]
        pub fn nearest_last(node: &Node, slabs: &Slabs, t_max: f32, room: &mut Room) -> usize {
            let (near, mask) = meet(node, slabs, t_max);
            let keys = compress(mask, keys(near));
            if mask.count_ones() > 4 {
                write_many(keys, node, room);
                return mask.count_ones() as usize;
            }
            // Sorts them to fall. A zero may be the key of lane 0 at distance 0 or belong to no lane: their order makes no difference.
            let keys = _mm256_castsi256_si128(keys);
            let keys = sort_step4::<0xB1, 0b1010>(keys);
            let keys = sort_step4::<0x4E, 0b1100>(keys);
            let keys = sort_step4::<0xD8, 0b1100>(keys);
            let lanes = _mm256_castsi128_si256(keys);
            let children = _mm256_castsi256_si128(_mm256_permutevar8x32_epi32(children(node), lanes));
            let distances = _mm_andnot_si128(_mm_set1_epi32(7), keys);
            let low: [u64; 2] = bytemuck::cast(_mm_unpacklo_epi32(children, distances));
            let high: [u64; 2] = bytemuck::cast(_mm_unpackhi_epi32(children, distances));
            room[..2].copy_from_slice(&low);
            room[2..4].copy_from_slice(&high);
            mask.count_ones() as usize
        }

        /// Writes the entries of the children that the ray meets to `room`, in their order and without their distances, and
        /// returns their number.
        #[inline]
        #[target_feature(enable = $features)]
        pub fn in_order(node: &Node, slabs: &Slabs, t_max: f32, room: &mut Room) -> usize {
            let (_, mask) = meet(node, slabs, t_max);
            let children = compress(mask, children(node));
            let low: [u64; 4] = bytemuck::cast(_mm256_cvtepu32_epi64(_mm256_castsi256_si128(children)));
            let high: [u64; 4] = bytemuck::cast(_mm256_cvtepu32_epi64(_mm256_extracti128_si256::<1>(children)));
            room[..4].copy_from_slice(&low);
            room[4..].copy_from_slice(&high);
            mask.count_ones() as usize
        }

        /// Tests the triangles of a packet against four rays of a bundle, which are in the lanes `group`.
        #[inline]
        #[target_feature(enable = $features)]
        pub fn bundle<const INCLUSIVE: bool>(
            tests: $set,
            packet: &Packet,
            lanes: &Lanes,
            group: [usize; GROUP],
            found: &mut Found,
        ) {
            let [kx, ky, kz] = lanes.axes;
            let row = |v: usize, axis: usize| tests.load(&side_by_side([&packet.vertices[v][axis]; GROUP]));
            let of = |values: &Lane| tests.load(&pick(values, group));
            let vertex = |v: usize| [row(v, kx), row(v, ky), row(v, kz)];
            let operands = Operands {
                vertices: [vertex(0), vertex(1), vertex(2)],
                origin: [of(&lanes.origin[kx]), of(&lanes.origin[ky]), of(&lanes.origin[kz])],
                shear: [of(&lanes.shear[0]), of(&lanes.shear[1]), of(&lanes.shear[2])],
                t_max: of(&lanes.t_max),
            };
            triangles::test::<_, INCLUSIVE, true>(tests, operands, found);
        }
    };
}

pub mod avx2;
pub mod avx512;

/// See [`super::super::avx2::meet`], whose arithmetic it has. Planes are chosen by a blend instead of an address, which is known
/// late where each step is for another ray.
#[inline]
#[target_feature(enable = "avx2")]
fn meet(node: &Node, slabs: &Slabs, t_max: f32) -> (__m256, u32) {
    let [mut near, mut far] = [_mm256_setzero_ps(), _mm256_set1_ps(t_max)];
    for axis in 0..3 {
        let origin = _mm256_set1_ps(slabs.origin[axis]);
        let (to_nearer, to_farther) = (_mm256_set1_ps(slabs.nearer[axis]), _mm256_set1_ps(slabs.farther[axis]));
        let low: __m256 = bytemuck::cast(node.planes[axis]);
        let high: __m256 = bytemuck::cast(node.planes[3 + axis]);
        // The factor, minus the reciprocal of the direction, is negative where the ray meets the lower plane first.
        let nearer = _mm256_sub_ps(origin, _mm256_blendv_ps(high, low, to_nearer));
        let farther = _mm256_sub_ps(origin, _mm256_blendv_ps(low, high, to_nearer));
        near = _mm256_max_ps(_mm256_mul_ps(nearer, to_nearer), near);
        far = _mm256_min_ps(_mm256_mul_ps(farther, to_farther), far);
    }
    (near, _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(near, far)) as u32)
}

/// See [`Bounds::boxes`].
#[inline]
#[target_feature(enable = "avx2")]
pub fn boxes(bounds: &Bounds, node: &Node, t_max: f32, distances: &mut [f32; WIDTH]) -> u32 {
    let [mut near, mut far] = [_mm256_setzero_ps(), _mm256_set1_ps(t_max)];
    for axis in 0..3 {
        let [low, high] = bounds.nearer[axis].map(|v| _mm256_set1_ps(v));
        let plane: __m256 = bytemuck::cast(node.planes[bounds.nearer_plane[axis]]);
        let nearer = _mm256_sub_ps(_mm256_set1_ps(bounds.near_origin[axis]), plane);
        let distance = _mm256_min_ps(_mm256_mul_ps(nearer, low), _mm256_mul_ps(nearer, high));
        near = _mm256_max_ps(distance, near);
        let [low, high] = bounds.farther[axis].map(|v| _mm256_set1_ps(v));
        let plane: __m256 = bytemuck::cast(node.planes[bounds.farther_plane[axis]]);
        let farther = _mm256_sub_ps(_mm256_set1_ps(bounds.far_origin[axis]), plane);
        let distance = _mm256_max_ps(_mm256_mul_ps(farther, low), _mm256_mul_ps(farther, high));
        far = _mm256_min_ps(distance, far);
    }
    *distances = bytemuck::cast(near);
    _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(near, far)) as u32
}

/// The least and the largest of a bundle's numbers.
#[inline]
#[target_feature(enable = "avx2")]
pub fn range(values: &Lane) -> [f32; 2] {
    let [low, high]: [__m256; 2] = bytemuck::cast(*values);
    let halves = |v: __m256| [_mm256_castps256_ps128(v), _mm256_extractf128_ps::<1>(v)];
    let ([a, b], [c, d]) = (halves(_mm256_min_ps(low, high)), halves(_mm256_max_ps(low, high)));
    let (least, largest) = (_mm_min_ps(a, b), _mm_max_ps(c, d));
    let least = _mm_min_ps(least, _mm_movehl_ps(least, least));
    let largest = _mm_max_ps(largest, _mm_movehl_ps(largest, largest));
    let least = _mm_min_ss(least, _mm_movehdup_ps(least));
    let largest = _mm_max_ss(largest, _mm_movehdup_ps(largest));
    [_mm_cvtss_f32(least), _mm_cvtss_f32(largest)]
}

#[inline]
#[target_feature(enable = "avx2")]
fn children(node: &Node) -> __m256i {
    bytemuck::cast(node.children.map(|child| child.0))
}

/// A distance whose three lowest bits are replaced by its lane.
#[inline]
#[target_feature(enable = "avx2")]
fn keys(near: __m256) -> __m256i {
    let rounded = _mm256_and_si256(_mm256_castps_si256(near), _mm256_set1_epi32(!7));
    _mm256_or_si256(rounded, _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7))
}

/// Sorts up to eight keys to fall and writes their entries. Few nodes have more than four children that a ray meets.
#[cold]
#[inline(never)]
#[target_feature(enable = "avx2")]
fn write_many(keys: __m256i, node: &Node, room: &mut Room) {
    let keys = sort_step8::<0xB1, 0b1010_1010>(keys);
    let keys = sort_step8::<0x1B, 0b1100_1100>(keys);
    let keys = sort_step8::<0xB1, 0b1010_1010>(keys);
    let turned = _mm256_permutevar8x32_epi32(keys, _mm256_setr_epi32(7, 6, 5, 4, 3, 2, 1, 0));
    let (least, most) = (_mm256_min_epu32(keys, turned), _mm256_max_epu32(keys, turned));
    let keys = _mm256_blend_epi32::<0b1111_0000>(most, least);
    let keys = sort_step8::<0x4E, 0b1100_1100>(keys);
    let keys = sort_step8::<0xB1, 0b1010_1010>(keys);
    let children: [u32; WIDTH] = bytemuck::cast(_mm256_permutevar8x32_epi32(children(node), keys));
    let distances: [u32; WIDTH] = bytemuck::cast(_mm256_andnot_si256(_mm256_set1_epi32(7), keys));
    for lane in 0..WIDTH {
        room[lane] = u64::from(distances[lane]) << 32 | u64::from(children[lane]);
    }
}

/// Compares each key with that of the lane in `SHUFFLE`: lanes in `LEAST` take the lesser of both, the others the greater.
#[inline]
#[target_feature(enable = "avx2")]
fn sort_step4<const SHUFFLE: i32, const LEAST: i32>(keys: __m128i) -> __m128i {
    let other = _mm_shuffle_epi32::<SHUFFLE>(keys);
    _mm_blend_epi32::<LEAST>(_mm_max_epu32(keys, other), _mm_min_epu32(keys, other))
}

/// The same in each half.
#[inline]
#[target_feature(enable = "avx2")]
fn sort_step8<const SHUFFLE: i32, const LEAST: i32>(keys: __m256i) -> __m256i {
    let other = _mm256_shuffle_epi32::<SHUFFLE>(keys);
    _mm256_blend_epi32::<LEAST>(_mm256_max_epu32(keys, other), _mm256_min_epu32(keys, other))
}

/// The least entry that a finite `limit`, not negative, rules out.
fn above(limit: f32) -> u64 {
    (u64::from(limit.to_bits()) + 1) << 32
}
