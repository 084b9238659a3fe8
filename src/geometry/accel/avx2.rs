//! Ray-box and ray-triangle tests with vector instructions. Every lane does what [`Shear::intersect`] and [`super::portable`] do,
//! operation by operation; products and sums are rounded apart, never fused, so that hits are the same to the last bit.

use std::arch::x86_64::*;

use super::Hit;
use super::node::{LANES, Node, Packet, WIDTH};
use super::query::Slabs;
use crate::geometry::triangle::{ERROR_EDGE, ERROR_XY, ERROR_Z, Shear};

type Array = [f32; WIDTH];

#[inline]
#[target_feature(enable = "avx2,fma")]
fn load(values: &Array) -> __m256 {
    bytemuck::cast(*values)
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn store(values: &mut Array, vector: __m256) {
    *values = bytemuck::cast(vector);
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn load4(values: &[f32; LANES]) -> __m128 {
    bytemuck::cast(*values)
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn store4(values: &mut [f32; LANES], vector: __m128) {
    *values = bytemuck::cast(vector);
}

/// See [`super::portable::boxes`].
#[inline]
#[target_feature(enable = "avx2,fma")]
pub fn boxes(node: &Node, slabs: &Slabs, t_max: f32, distances: &mut Array) -> u32 {
    let (near, mask) = meet(node, slabs, t_max);
    store(distances, near);
    mask
}

/// Distances to the boxes of the children, and the children that the ray meets, one bit each. Maximum and minimum return the
/// second operand where the first is NaN.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub fn meet(node: &Node, slabs: &Slabs, t_max: f32) -> (__m256, u32) {
    let [mut near, mut far] = [_mm256_setzero_ps(), _mm256_set1_ps(t_max)];
    for axis in 0..3 {
        let origin = _mm256_set1_ps(slabs.origin[axis]);
        let nearer = _mm256_sub_ps(origin, load(&node.planes[slabs.nearer_plane[axis]]));
        let farther = _mm256_sub_ps(origin, load(&node.planes[slabs.farther_plane[axis]]));
        near = _mm256_max_ps(_mm256_mul_ps(nearer, _mm256_set1_ps(slabs.nearer[axis])), near);
        far = _mm256_min_ps(_mm256_mul_ps(farther, _mm256_set1_ps(slabs.farther[axis])), far);
    }
    (near, _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(near, far)) as u32)
}

/// Result of testing the triangles of a packet.
struct Found {
    /// Lanes whose triangle the ray meets, one bit each.
    mask: u32,
    /// Lanes with an edge function of zero, to be tested in double precision.
    on_edge: u32,
    distances: __m128,
    inverse: __m128,
    v: __m128,
    w: __m128,
}

/// The test of [`Shear::intersect`]. `INCLUSIVE` counts hits at `t_max` as well.
#[inline]
#[target_feature(enable = "avx2,fma")]
fn test<const INCLUSIVE: bool>(packet: &Packet, shear: &Shear, t_max: f32) -> Found {
    let zero = _mm_setzero_ps();
    let [kx, ky, kz] = shear.axes;
    let origin = [shear.origin.x, shear.origin.y, shear.origin.z];
    let [ox, oy, oz] = [kx, ky, kz].map(|axis| _mm_set1_ps(origin[axis]));
    let [sx, sy, sz] = [shear.shear.x, shear.shear.y, shear.shear.z].map(|s| _mm_set1_ps(s));
    let [a, b, c] = &packet.vertices;
    let az = _mm_sub_ps(load4(&a[kz]), oz);
    let bz = _mm_sub_ps(load4(&b[kz]), oz);
    let cz = _mm_sub_ps(load4(&c[kz]), oz);
    let ax = _mm_sub_ps(_mm_sub_ps(load4(&a[kx]), ox), _mm_mul_ps(sx, az));
    let ay = _mm_sub_ps(_mm_sub_ps(load4(&a[ky]), oy), _mm_mul_ps(sy, az));
    let bx = _mm_sub_ps(_mm_sub_ps(load4(&b[kx]), ox), _mm_mul_ps(sx, bz));
    let by = _mm_sub_ps(_mm_sub_ps(load4(&b[ky]), oy), _mm_mul_ps(sy, bz));
    let cx = _mm_sub_ps(_mm_sub_ps(load4(&c[kx]), ox), _mm_mul_ps(sx, cz));
    let cy = _mm_sub_ps(_mm_sub_ps(load4(&c[ky]), oy), _mm_mul_ps(sy, cz));
    let u = _mm_sub_ps(_mm_mul_ps(cx, by), _mm_mul_ps(cy, bx));
    let v = _mm_sub_ps(_mm_mul_ps(ax, cy), _mm_mul_ps(ay, cx));
    let w = _mm_sub_ps(_mm_mul_ps(bx, ay), _mm_mul_ps(by, ax));
    let is_zero = |edge: __m128| _mm_cmp_ps::<_CMP_EQ_OQ>(edge, zero);
    let on_edge = _mm_or_ps(_mm_or_ps(is_zero(u), is_zero(v)), is_zero(w));
    // All of one sign: the least is not negative or the largest is not positive. Neither holds for NaN.
    let least = _mm_min_ps(u, _mm_min_ps(v, w));
    let largest = _mm_max_ps(u, _mm_max_ps(v, w));
    let one_sign = _mm_or_ps(_mm_cmp_ps::<_CMP_GE_OQ>(least, zero), _mm_cmp_ps::<_CMP_LE_OQ>(largest, zero));
    let inside = _mm_andnot_ps(on_edge, one_sign);
    let mut found = Found { mask: 0, on_edge: _mm_movemask_ps(on_edge) as u32, distances: zero, inverse: zero, v, w };
    if _mm_movemask_ps(inside) == 0 {
        return found;
    }
    let inverse = _mm_div_ps(_mm_set1_ps(1.0), _mm_add_ps(_mm_add_ps(u, v), w));
    let depths = [az, bz, cz];
    let [az, bz, cz] = [_mm_mul_ps(az, sz), _mm_mul_ps(bz, sz), _mm_mul_ps(cz, sz)];
    let sum = _mm_add_ps(_mm_add_ps(_mm_mul_ps(u, az), _mm_mul_ps(v, bz)), _mm_mul_ps(w, cz));
    let t = _mm_mul_ps(sum, inverse);
    let before = match INCLUSIVE {
        true => _mm_cmp_ps::<_CMP_LE_OQ>(t, _mm_set1_ps(t_max)),
        false => _mm_cmp_ps::<_CMP_LT_OQ>(t, _mm_set1_ps(t_max)),
    };
    let mut valid = _mm_and_ps(_mm_and_ps(inside, before), _mm_cmp_ps::<_CMP_GT_OQ>(t, zero));
    let not_in_front = _mm_cmp_ps::<_CMP_NGT_UQ>(_mm_min_ps(az, _mm_min_ps(bz, cz)), zero);
    let doubtful = _mm_and_ps(valid, not_in_front);
    if _mm_movemask_ps(doubtful) != 0 {
        let extent = [largest_of([ax, bx, cx]), largest_of([ay, by, cy]), largest_of(depths)];
        let error = distance_error(extent, magnitude(sz), largest_of([u, v, w]));
        let within = _mm_cmp_ps::<_CMP_NGT_UQ>(t, _mm_mul_ps(error, magnitude(inverse)));
        valid = _mm_andnot_ps(_mm_and_ps(doubtful, within), valid);
    }
    found.mask = _mm_movemask_ps(valid) as u32;
    found.distances = t;
    found.inverse = inverse;
    found
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn magnitude(v: __m128) -> __m128 {
    _mm_andnot_ps(_mm_set1_ps(-0.0), v)
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn largest_of([a, b, c]: [__m128; 3]) -> __m128 {
    _mm_max_ps(_mm_max_ps(magnitude(a), magnitude(b)), magnitude(c))
}

/// See [`crate::geometry::triangle::distance_error`].
#[inline]
#[target_feature(enable = "avx2,fma")]
fn distance_error([x, y, z]: [__m128; 3], scale: __m128, edge: __m128) -> __m128 {
    let times = |factor: f32, v: __m128| _mm_mul_ps(_mm_set1_ps(factor), v);
    let dx = times(ERROR_XY, _mm_add_ps(x, z));
    let dy = times(ERROR_XY, _mm_add_ps(y, z));
    let z = _mm_mul_ps(z, scale);
    let dz = times(ERROR_Z, z);
    let products = _mm_add_ps(_mm_mul_ps(times(ERROR_EDGE, x), y), _mm_mul_ps(dy, x));
    let edge_error = times(2.0, _mm_add_ps(products, _mm_mul_ps(dx, y)));
    let sum = _mm_add_ps(_mm_mul_ps(times(ERROR_Z, edge), z), _mm_mul_ps(edge_error, z));
    times(3.0, _mm_add_ps(sum, _mm_mul_ps(dz, edge)))
}

/// See [`super::portable::closest`].
#[inline]
#[target_feature(enable = "avx2,fma")]
pub fn closest(packet: &Packet, shear: &Shear, best: &mut Hit) {
    let Found { mut mask, on_edge, distances, inverse, v, w } = test::<true>(packet, shear, best.distance);
    if mask | on_edge == 0 {
        return;
    }
    if on_edge != 0 {
        closest_on_edge(packet, shear, on_edge, best);
    }
    let mut found = [[0.0; LANES]; 3];
    store4(&mut found[0], distances);
    store4(&mut found[1], _mm_mul_ps(v, inverse));
    store4(&mut found[2], _mm_mul_ps(w, inverse));
    while mask != 0 {
        let lane = mask.trailing_zeros() as usize % LANES;
        mask &= mask - 1;
        let [distance, b1, b2] = found.map(|values| values[lane]);
        let (shape, triangle) = (packet.shapes[lane], packet.triangles[lane]);
        best.replace(Hit { distance, shape, triangle, barycentric: [b1, b2] });
    }
}

/// See [`super::portable::occluded`].
#[inline]
#[target_feature(enable = "avx2,fma")]
pub fn occluded(packet: &Packet, shear: &Shear, t_max: f32) -> bool {
    let Found { mask, on_edge, .. } = test::<false>(packet, shear, t_max);
    mask != 0 || on_edge != 0 && occluders_on_edge(packet, shear, on_edge, t_max) != 0
}

/// See [`super::portable::occluders`].
#[inline]
#[target_feature(enable = "avx2,fma")]
pub fn occluders(packet: &Packet, shear: &Shear, t_max: f32) -> u32 {
    let Found { mask, on_edge, .. } = test::<false>(packet, shear, t_max);
    if on_edge == 0 { mask } else { mask | occluders_on_edge(packet, shear, on_edge, t_max) }
}

/// Prefetches all cache lines of `value`.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub fn prefetch<T>(value: *const T) {
    for line in (0..size_of::<T>()).step_by(64) {
        _mm_prefetch::<_MM_HINT_T0>(value.cast::<i8>().wrapping_add(line));
    }
}

fn lanes(mask: u32) -> impl Iterator<Item = usize> {
    (0..LANES).filter(move |lane| mask >> lane & 1 == 1)
}

/// Replaces `best` by the nearest hit among the triangles in `mask` that precedes it, by the test in double precision.
#[cold]
pub fn closest_on_edge(packet: &Packet, shear: &Shear, mask: u32, best: &mut Hit) {
    for lane in lanes(mask) {
        if let Some((distance, barycentric)) = shear.intersect(&packet.triangle(lane), best.distance.next_up()) {
            best.replace(Hit { distance, shape: packet.shapes[lane], triangle: packet.triangles[lane], barycentric });
        }
    }
}

/// The triangles among those in `mask` that the ray meets before `t_max`, by the test in double precision.
#[cold]
pub fn occluders_on_edge(packet: &Packet, shear: &Shear, mask: u32, t_max: f32) -> u32 {
    let meets = |lane: &usize| shear.intersect(&packet.triangle(*lane), t_max).is_some();
    lanes(mask).filter(meets).fold(0, |mask, lane| mask | 1 << lane)
}
