//! The triangles of four packets, each against its own ray, or of one packet against four rays, in one go. Every lane does what
//! [`super::super::avx2`] does, operation by operation.

use std::arch::x86_64::*;

use super::super::node::{LANES, Packet};
use super::lanes::{Lanes, RAYS};
use crate::geometry::triangle::{ERROR_EDGE, ERROR_XY, ERROR_Z, Shear};

/// Packets that are tested at a time, each against its own ray.
pub const GROUP: usize = 4;

/// Constants of a ray's tests against triangles, as [`each`] loads them.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(32))]
pub struct RayBlock {
    /// The origin and the shear by permuted axis, the maximum distance, and nothing.
    pub values: [f32; 8],
    /// The permuted axes.
    pub axes: [u8; 3],
}

impl RayBlock {
    /// Index of the maximum distance.
    pub const T_MAX: usize = 6;

    #[inline(always)]
    pub fn new(shear: &Shear, t_max: f32) -> Self {
        let [kx, ky, kz] = shear.axes;
        let [o, s] = [shear.origin, shear.shear];
        Self { values: [o[kx], o[ky], o[kz], s.x, s.y, s.z, t_max, 0.0], axes: [kx as u8, ky as u8, kz as u8] }
    }
}

/// Result of testing a group of packets: lane `LANES · i + j` is for triangle j of packet i.
pub struct Found {
    /// Lanes whose triangle the ray meets, one bit each.
    pub mask: u32,
    /// Lanes with an edge function of zero, to be tested in double precision.
    pub on_edge: u32,
    pub distances: [f32; GROUP * LANES],
    pub b1: [f32; GROUP * LANES],
    pub b2: [f32; GROUP * LANES],
}

impl Found {
    pub const NOTHING: Self = Self {
        mask: 0,
        on_edge: 0,
        distances: [0.0; GROUP * LANES],
        b1: [0.0; GROUP * LANES],
        b2: [0.0; GROUP * LANES],
    };
}

/// The vertices of the packets by vertex and permuted axis, and the constants of the rays: origin and shear by permuted axis and the
/// maximum distance.
struct Operands {
    vertices: [[__m512; 3]; 3],
    ray: [__m512; 7],
}

/// A row of each packet's vertices, side by side.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq")]
fn rows(packets: [&Packet; GROUP], vertex: usize, axis: [usize; GROUP]) -> __m512 {
    let row = |i: usize| -> __m128 { bytemuck::cast::<[f32; LANES], _>(packets[i].vertices[vertex][axis[i]]) };
    let all = _mm512_castps128_ps512(row(0));
    let all = _mm512_insertf32x4::<1>(all, row(1));
    let all = _mm512_insertf32x4::<2>(all, row(2));
    _mm512_insertf32x4::<3>(all, row(3))
}

/// Tests each packet against its ray. `INCLUSIVE` counts hits at the maximum distance as well.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq")]
pub fn each<const INCLUSIVE: bool>(packets: [&Packet; GROUP], rays: [&RayBlock; GROUP], found: &mut Found) {
    let axes: [[usize; GROUP]; 3] = [0, 1, 2].map(|i| rays.map(|ray| usize::from(ray.axes[i])));
    let pair = |i: usize| {
        let (low, high): (__m256, __m256) = (bytemuck::cast(rays[i].values), bytemuck::cast(rays[i + 1].values));
        _mm512_insertf32x8::<1>(_mm512_castps256_ps512(low), high)
    };
    let [first, second] = [pair(0), pair(2)];
    let lanes = _mm512_setr_epi32(0, 0, 0, 0, 8, 8, 8, 8, 16, 16, 16, 16, 24, 24, 24, 24);
    let value = |i: i32| _mm512_permutex2var_ps(first, _mm512_add_epi32(lanes, _mm512_set1_epi32(i)), second);
    let [kx, ky, kz] = axes;
    let vertices = [
        [rows(packets, 0, kx), rows(packets, 0, ky), rows(packets, 0, kz)],
        [rows(packets, 1, kx), rows(packets, 1, ky), rows(packets, 1, kz)],
        [rows(packets, 2, kx), rows(packets, 2, ky), rows(packets, 2, kz)],
    ];
    let ray = [value(0), value(1), value(2), value(3), value(4), value(5), value(6)];
    // An early way out would seldom be taken with four rays that have nothing in common.
    test::<INCLUSIVE, false>(&Operands { vertices, ray }, found);
}

/// Tests the triangles of a packet against four rays of a bundle, which are in the lanes `group`.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq")]
pub fn bundle<const INCLUSIVE: bool>(packet: &Packet, lanes: &Lanes, group: [usize; GROUP], found: &mut Found) {
    let row = |vertex: usize, axis: usize| {
        _mm512_broadcast_f32x4(bytemuck::cast::<[f32; LANES], _>(packet.vertices[vertex][axis]))
    };
    let from = bytemuck::cast(group.map(|lane| [lane as i32; LANES]));
    let value = |values: &[f32; RAYS]| _mm512_permutexvar_ps(from, bytemuck::cast(*values));
    let [kx, ky, kz] = lanes.axes;
    let vertex = |v: usize| [row(v, kx), row(v, ky), row(v, kz)];
    let vertices = [vertex(0), vertex(1), vertex(2)];
    let [ox, oy, oz] = [kx, ky, kz].map(|axis| &lanes.origin[axis]);
    let [sx, sy, sz] = &lanes.shear;
    let ray = [value(ox), value(oy), value(oz), value(sx), value(sy), value(sz), value(&lanes.t_max)];
    test::<INCLUSIVE, true>(&Operands { vertices, ray }, found);
}

/// With `EARLY` it ends where no ray is inside of a triangle.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq")]
fn test<const INCLUSIVE: bool, const EARLY: bool>(operands: &Operands, found: &mut Found) {
    let zero = _mm512_setzero_ps();
    let [ox, oy, oz, sx, sy, sz, t_max] = operands.ray;
    let [a, b, c] = &operands.vertices;
    let [az, bz, cz] = [_mm512_sub_ps(a[2], oz), _mm512_sub_ps(b[2], oz), _mm512_sub_ps(c[2], oz)];
    let ax = _mm512_sub_ps(_mm512_sub_ps(a[0], ox), _mm512_mul_ps(sx, az));
    let ay = _mm512_sub_ps(_mm512_sub_ps(a[1], oy), _mm512_mul_ps(sy, az));
    let bx = _mm512_sub_ps(_mm512_sub_ps(b[0], ox), _mm512_mul_ps(sx, bz));
    let by = _mm512_sub_ps(_mm512_sub_ps(b[1], oy), _mm512_mul_ps(sy, bz));
    let cx = _mm512_sub_ps(_mm512_sub_ps(c[0], ox), _mm512_mul_ps(sx, cz));
    let cy = _mm512_sub_ps(_mm512_sub_ps(c[1], oy), _mm512_mul_ps(sy, cz));
    let u = _mm512_sub_ps(_mm512_mul_ps(cx, by), _mm512_mul_ps(cy, bx));
    let v = _mm512_sub_ps(_mm512_mul_ps(ax, cy), _mm512_mul_ps(ay, cx));
    let w = _mm512_sub_ps(_mm512_mul_ps(bx, ay), _mm512_mul_ps(by, ax));
    let is_zero = |edge: __m512| _mm512_cmp_ps_mask::<_CMP_EQ_OQ>(edge, zero);
    let on_edge = is_zero(u) | is_zero(v) | is_zero(w);
    // All of one sign: the least is not negative or the largest is not positive. Neither holds for NaN.
    let least = _mm512_min_ps(u, _mm512_min_ps(v, w));
    let largest = _mm512_max_ps(u, _mm512_max_ps(v, w));
    let one_sign = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(least, zero) | _mm512_cmp_ps_mask::<_CMP_LE_OQ>(largest, zero);
    let inside = one_sign & !on_edge;
    if EARLY && inside == 0 {
        (found.mask, found.on_edge) = (0, u32::from(on_edge));
        return;
    }
    let inverse = _mm512_div_ps(_mm512_set1_ps(1.0), _mm512_add_ps(_mm512_add_ps(u, v), w));
    let [az, bz, cz] = [_mm512_mul_ps(az, sz), _mm512_mul_ps(bz, sz), _mm512_mul_ps(cz, sz)];
    let sum = _mm512_add_ps(_mm512_add_ps(_mm512_mul_ps(u, az), _mm512_mul_ps(v, bz)), _mm512_mul_ps(w, cz));
    let t = _mm512_mul_ps(sum, inverse);
    let before = match INCLUSIVE {
        true => _mm512_mask_cmp_ps_mask::<_CMP_LE_OQ>(inside, t, t_max),
        false => _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(inside, t, t_max),
    };
    let mut valid = _mm512_mask_cmp_ps_mask::<_CMP_GT_OQ>(before, t, zero);
    let nearest = _mm512_min_ps(az, _mm512_min_ps(bz, cz));
    let doubtful = _mm512_mask_cmp_ps_mask::<_CMP_NGT_UQ>(valid, nearest, zero);
    if doubtful != 0 {
        let extent = [largest_of([ax, bx, cx]), largest_of([ay, by, cy]), largest_of([az, bz, cz])];
        let error = distance_error(extent, largest_of([u, v, w]));
        valid &= !_mm512_mask_cmp_ps_mask::<_CMP_NGT_UQ>(doubtful, t, _mm512_mul_ps(error, _mm512_abs_ps(inverse)));
    }
    found.mask = u32::from(valid);
    found.on_edge = u32::from(on_edge);
    found.distances = bytemuck::cast(t);
    found.b1 = bytemuck::cast(_mm512_mul_ps(v, inverse));
    found.b2 = bytemuck::cast(_mm512_mul_ps(w, inverse));
}

#[inline]
#[target_feature(enable = "avx512f,avx512dq")]
fn largest_of([a, b, c]: [__m512; 3]) -> __m512 {
    _mm512_max_ps(_mm512_max_ps(_mm512_abs_ps(a), _mm512_abs_ps(b)), _mm512_abs_ps(c))
}

/// See [`crate::geometry::triangle::distance_error`].
#[inline]
#[target_feature(enable = "avx512f")]
fn distance_error([x, y, z]: [__m512; 3], edge: __m512) -> __m512 {
    let times = |factor: f32, v: __m512| _mm512_mul_ps(_mm512_set1_ps(factor), v);
    let dx = times(ERROR_XY, _mm512_add_ps(x, z));
    let dy = times(ERROR_XY, _mm512_add_ps(y, z));
    let dz = times(ERROR_Z, z);
    let products = _mm512_add_ps(_mm512_mul_ps(times(ERROR_EDGE, x), y), _mm512_mul_ps(dy, x));
    let edge_error = times(2.0, _mm512_add_ps(products, _mm512_mul_ps(dx, y)));
    let sum = _mm512_add_ps(_mm512_mul_ps(times(ERROR_Z, edge), z), _mm512_mul_ps(edge_error, z));
    times(3.0, _mm512_add_ps(sum, _mm512_mul_ps(dz, edge)))
}
