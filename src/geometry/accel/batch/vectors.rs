//! Steps of a ray through the hierarchy without branches that depend on the ray: which children it meets, in which order, and
//! which stacked children a nearer hit rules out.
//!
//! A stack entry holds the bits of the distance to a child's box above those of the [`Child`](super::super::node::Child). Distances
//! are not negative, so entries are ordered like them.

use std::arch::x86_64::*;

use super::super::node::{Node, WIDTH};
use super::super::query::Slabs;

/// Room for the entries of a node's children.
pub type Room = [u64; WIDTH];

/// For each mask of lanes, the lanes that are in it, in order; then zeros.
static LANES_OF: [[u8; WIDTH]; 256] = {
    let mut table = [[0; WIDTH]; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut lane, mut count) = (0, 0);
        while lane < WIDTH {
            if mask >> lane & 1 == 1 {
                table[mask][count] = lane as u8;
                count += 1;
            }
            lane += 1;
        }
        mask += 1;
    }
    table
};

/// Moves the lanes of `mask` to the front, and zeros behind them.
#[inline]
#[target_feature(enable = "avx2,fma,popcnt")]
fn compress_avx2(mask: u32, values: __m256i) -> __m256i {
    let order = i64::from_le_bytes(LANES_OF[mask as usize % 256]);
    let moved = _mm256_permutevar8x32_epi32(values, _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(order)));
    let count = _mm256_set1_epi32(mask.count_ones() as i32);
    _mm256_and_si256(moved, _mm256_cmpgt_epi32(count, _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7)))
}

#[inline]
#[target_feature(enable = "avx2,fma,popcnt,avx512f,avx512vl,avx512bw,avx512dq")]
fn compress_avx512(mask: u32, values: __m256i) -> __m256i {
    _mm256_maskz_compress_epi32(mask as u8, values)
}

/// Defines the steps of a ray for one instruction set. All of it is one function, since a call costs as much as the step.
macro_rules! steps {
    ($features:literal, $compress:ident, $nearest_last:ident, $in_order:ident) => {
        /// Writes the entries of the children that the ray meets to `room`, the nearest last, and returns their number. Entries
        /// have rounded distances, which are never too large, so that no child is ruled out wrongly.
        #[inline]
        #[target_feature(enable = $features)]
        pub fn $nearest_last(node: &Node, slabs: &Slabs, t_max: f32, room: &mut Room) -> usize {
            let (near, mask) = meet(node, slabs, t_max);
            let keys = $compress(mask, keys(near));
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
        pub fn $in_order(node: &Node, slabs: &Slabs, t_max: f32, room: &mut Room) -> usize {
            let (_, mask) = meet(node, slabs, t_max);
            let children = $compress(mask, children(node));
            let low: [u64; 4] = bytemuck::cast(_mm256_cvtepu32_epi64(_mm256_castsi256_si128(children)));
            let high: [u64; 4] = bytemuck::cast(_mm256_cvtepu32_epi64(_mm256_extracti128_si256::<1>(children)));
            room[..4].copy_from_slice(&low);
            room[4..].copy_from_slice(&high);
            mask.count_ones() as usize
        }
    };
}

steps!("avx2,fma,popcnt", compress_avx2, nearest_last_avx2, in_order_avx2);
steps!("avx2,fma,popcnt,avx512f,avx512vl,avx512bw,avx512dq", compress_avx512, nearest_last_avx512, in_order_avx512);

/// See [`super::super::avx2::meet`], whose arithmetic it has. Planes are chosen by a blend instead of an address, which is known
/// late where each step is for another ray.
#[inline]
#[target_feature(enable = "avx2,fma")]
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
#[target_feature(enable = "avx2,fma")]
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

/// Keeps those of the first `count` entries whose distance is at most `limit`, and returns their number. The stack has room for a
/// whole block behind them.
#[inline]
#[target_feature(enable = "avx2,fma,popcnt")]
pub fn keep_avx2(stack: &mut [u64], count: usize, limit: f32) -> usize {
    const BLOCK: usize = 4;
    let limit = _mm256_set1_epi64x(above(limit) as i64);
    let (mut from, mut kept) = (0, 0);
    while from < count {
        let Some(block) = stack[from..].first_chunk::<BLOCK>() else { break };
        let entries: __m256i = bytemuck::cast(*block);
        let below = _mm256_castsi256_pd(_mm256_cmpgt_epi64(limit, entries));
        let mask = _mm256_movemask_pd(below) as u32 & ((1 << (count - from).min(BLOCK)) - 1);
        // Each entry is two lanes.
        let doubled = (0..BLOCK).fold(0, |doubled, lane| doubled | ((mask >> lane & 1) * 3) << (2 * lane));
        let moved: [u64; BLOCK] = bytemuck::cast(compress_avx2(doubled, entries));
        let Some(room) = stack[kept..].first_chunk_mut() else { break };
        *room = moved;
        kept += mask.count_ones() as usize;
        from += BLOCK;
    }
    kept
}

/// See [`keep_avx2`].
#[inline]
#[target_feature(enable = "avx2,fma,popcnt,avx512f,avx512vl,avx512bw,avx512dq")]
pub fn keep_avx512(stack: &mut [u64], count: usize, limit: f32) -> usize {
    const BLOCK: usize = 8;
    let limit = _mm512_set1_epi64(above(limit) as i64);
    let (mut from, mut kept) = (0, 0);
    while from < count {
        let Some(block) = stack[from..].first_chunk::<BLOCK>() else { break };
        let entries: __m512i = bytemuck::cast(*block);
        let used = ((1u32 << (count - from).min(BLOCK)) - 1) as u8;
        let mask = _mm512_mask_cmplt_epu64_mask(used, entries, limit);
        let moved: [u64; BLOCK] = bytemuck::cast(_mm512_maskz_compress_epi64(mask, entries));
        let Some(room) = stack[kept..].first_chunk_mut() else { break };
        *room = moved;
        kept += mask.count_ones() as usize;
        from += BLOCK;
    }
    kept
}

/// The least entry that a finite `limit`, not negative, rules out.
fn above(limit: f32) -> u64 {
    (u64::from(limit.to_bits()) + 1) << 32
}
