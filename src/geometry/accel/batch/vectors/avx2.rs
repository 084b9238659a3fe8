//! What takes other instructions with AVX2 than with longer vectors.

use std::arch::x86_64::*;

use super::super::super::node::{LANES, Node, Packet, WIDTH};
use super::super::super::query::Slabs;
use super::super::sixteen::{Lane, Lanes};
use super::super::triangles::{self, Found, GROUP, Operands};
use super::{Room, above, children, keys, meet, sort_step4, write_many};
use crate::base::processor::Avx2;
use crate::math::lanes::Wide;

steps!(Avx2, "avx2,popcnt");

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
#[target_feature(enable = "avx2,popcnt")]
fn compress(mask: u32, values: __m256i) -> __m256i {
    let order = i64::from_le_bytes(LANES_OF[mask as usize % 256]);
    let moved = _mm256_permutevar8x32_epi32(values, _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(order)));
    let count = _mm256_set1_epi32(mask.count_ones() as i32);
    _mm256_and_si256(moved, _mm256_cmpgt_epi32(count, _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7)))
}

/// Keeps those of the first `count` entries whose distance is at most `limit`, and returns their number. The stack has room for a
/// whole block behind them.
#[inline]
#[target_feature(enable = "avx2,popcnt")]
pub fn keep(stack: &mut [u64], count: usize, limit: f32) -> usize {
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
        let moved: [u64; BLOCK] = bytemuck::cast(compress(doubled, entries));
        let Some(room) = stack[kept..].first_chunk_mut() else { break };
        *room = moved;
        kept += mask.count_ones() as usize;
        from += BLOCK;
    }
    kept
}

/// The rows, side by side.
#[inline]
#[target_feature(enable = "avx2")]
fn side_by_side(rows: [&[f32; LANES]; GROUP]) -> Lane {
    let half = |i: usize| pair(rows[i], rows[i + 1]);
    bytemuck::cast([half(0), half(2)])
}

#[inline]
#[target_feature(enable = "avx2")]
fn pair(low: &[f32; LANES], high: &[f32; LANES]) -> __m256 {
    _mm256_insertf128_ps::<1>(_mm256_castps128_ps256(bytemuck::cast(*low)), bytemuck::cast(*high))
}

/// The values in `lanes`, each [`LANES`] times.
#[inline]
#[target_feature(enable = "avx2")]
fn pick(values: &Lane, lanes: [usize; GROUP]) -> Lane {
    let number = |i: usize| _mm256_set1_ps(values[lanes[i] % values.len()]);
    let half = |i: usize| _mm256_blend_ps::<0b1111_0000>(number(i), number(i + 1));
    bytemuck::cast([half(0), half(2)])
}
