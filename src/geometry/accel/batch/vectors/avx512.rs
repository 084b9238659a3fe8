//! What takes other instructions with AVX-512 than with shorter vectors.

use std::arch::x86_64::*;

use super::super::super::node::{LANES, Node, Packet};
use super::super::super::query::Slabs;
use super::super::sixteen::{Lane, Lanes};
use super::super::triangles::{self, Found, GROUP, Operands, RayBlock};
use super::{Room, above, children, keys, meet, sort_step4, write_many};
use crate::base::processor::Avx512;
use crate::math::lanes::Wide;

steps!(Avx512, "avx2,popcnt,avx512f,avx512vl,avx512bw,avx512dq");

/// Moves the lanes of `mask` to the front, and zeros behind them.
#[inline]
#[target_feature(enable = "avx512f,avx512vl")]
fn compress(mask: u32, values: __m256i) -> __m256i {
    _mm256_maskz_compress_epi32(mask as u8, values)
}

/// See [`super::avx2::keep`].
#[inline]
#[target_feature(enable = "popcnt,avx512f")]
pub fn keep(stack: &mut [u64], count: usize, limit: f32) -> usize {
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

/// Tests each packet against its ray. `INCLUSIVE` counts hits at the maximum distance as well.
#[inline]
#[target_feature(enable = "avx2,popcnt,avx512f,avx512vl,avx512bw,avx512dq")]
pub fn each<const INCLUSIVE: bool>(
    tests: Avx512,
    [p, q, r, s]: [&Packet; GROUP],
    rays: [&RayBlock; GROUP],
    found: &mut Found,
) {
    let [p, q, r, s] = [&p.vertices, &q.vertices, &r.vertices, &s.vertices];
    let axes = |axis: usize| rays.map(|ray| usize::from(ray.axes[axis]));
    let [kx, ky, kz] = [axes(0), axes(1), axes(2)];
    let row =
        |v: usize, [i, j, k, l]: [usize; GROUP]| tests.load(&side_by_side([&p[v][i], &q[v][j], &r[v][k], &s[v][l]]));
    let [ox, oy, oz, sx, sy, sz, t_max] = spread(rays);
    let operands = Operands {
        vertices: [
            [row(0, kx), row(0, ky), row(0, kz)],
            [row(1, kx), row(1, ky), row(1, kz)],
            [row(2, kx), row(2, ky), row(2, kz)],
        ],
        origin: [tests.load(&ox), tests.load(&oy), tests.load(&oz)],
        shear: [tests.load(&sx), tests.load(&sy), tests.load(&sz)],
        t_max: tests.load(&t_max),
    };
    // An early way out would seldom be taken with four rays that have nothing in common.
    triangles::test::<_, INCLUSIVE, false>(tests, operands, found);
}

/// See [`super::avx2::side_by_side`].
#[inline]
#[target_feature(enable = "avx512f")]
fn side_by_side(rows: [&[f32; LANES]; GROUP]) -> Lane {
    let row = |i: usize| -> __m128 { bytemuck::cast(*rows[i]) };
    let all = _mm512_castps128_ps512(row(0));
    let all = _mm512_insertf32x4::<1>(all, row(1));
    let all = _mm512_insertf32x4::<2>(all, row(2));
    bytemuck::cast(_mm512_insertf32x4::<3>(all, row(3)))
}

/// Each value of each ray in the lanes of the ray's packet.
#[inline]
#[target_feature(enable = "avx512f,avx512dq")]
fn spread(rays: [&RayBlock; GROUP]) -> [Lane; 7] {
    let pair = |i: usize| {
        let (low, high): (__m256, __m256) = (bytemuck::cast(rays[i].values), bytemuck::cast(rays[i + 1].values));
        _mm512_insertf32x8::<1>(_mm512_castps256_ps512(low), high)
    };
    let (first, second) = (pair(0), pair(2));
    let lanes = _mm512_setr_epi32(0, 0, 0, 0, 8, 8, 8, 8, 16, 16, 16, 16, 24, 24, 24, 24);
    let value = |i: i32| -> Lane {
        let from = _mm512_add_epi32(lanes, _mm512_set1_epi32(i));
        bytemuck::cast(_mm512_permutex2var_ps(first, from, second))
    };
    [value(0), value(1), value(2), value(3), value(4), value(5), value(6)]
}

/// See [`super::avx2::pick`].
#[inline]
#[target_feature(enable = "avx512f")]
fn pick(values: &Lane, lanes: [usize; GROUP]) -> Lane {
    let from = bytemuck::cast(lanes.map(|lane| [lane as i32; LANES]));
    bytemuck::cast(_mm512_permutexvar_ps(from, bytemuck::cast(*values)))
}
