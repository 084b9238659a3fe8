//! The tests with vector instructions. Every lane does what [`Shear::intersect`] and [`super::portable`] do, operation by
//! operation; products and sums are rounded apart, never fused, so that hits are the same to the last bit.

use std::arch::x86_64::*;

use super::Hit;
use super::node::{Node, Packet, WIDTH};
use super::query::Slabs;
use crate::geometry::triangle::{ERROR_EDGE, ERROR_XY, ERROR_Z, Shear};

type Array = [f32; WIDTH];

#[inline]
#[target_feature(enable = "avx2,fma")]
fn load(values: &Array) -> __m256 {
    // SAFETY: an array of eight floats is 32 readable bytes, and the load needs no alignment.
    unsafe { _mm256_loadu_ps(values.as_ptr()) }
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn store(values: &mut Array, vector: __m256) {
    // SAFETY: an array of eight floats is 32 writable bytes, and the store needs no alignment.
    unsafe { _mm256_storeu_ps(values.as_mut_ptr(), vector) }
}

/// See [`super::portable::boxes`]. Of maximum and minimum the second operand remains where the first is not a number.
#[inline]
#[target_feature(enable = "avx2,fma")]
pub fn boxes(node: &Node, slabs: &Slabs, t_max: f32, distances: &mut Array) -> u32 {
    let [mut near, mut far] = [_mm256_setzero_ps(), _mm256_set1_ps(t_max)];
    for axis in 0..3 {
        let origin = _mm256_set1_ps(slabs.origin[axis]);
        let nearer = _mm256_sub_ps(origin, load(&node.planes[slabs.nearer_plane[axis]]));
        let farther = _mm256_sub_ps(origin, load(&node.planes[slabs.farther_plane[axis]]));
        near = _mm256_max_ps(_mm256_mul_ps(nearer, _mm256_set1_ps(slabs.nearer[axis])), near);
        far = _mm256_min_ps(_mm256_mul_ps(farther, _mm256_set1_ps(slabs.farther[axis])), far);
    }
    store(distances, near);
    _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(near, far)) as u32
}

/// Eight triangles in the sheared coordinates of the ray, up to the edge functions.
struct Sheared {
    x: [__m256; 3],
    y: [__m256; 3],
    z: [__m256; 3],
    edges: [__m256; 3],
    /// Lanes that the ray may pass through.
    inside: __m256,
    /// Lanes with an edge function of zero, to be tested in double precision.
    on_edge: u32,
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn shear_packet(packet: &Packet, shear: &Shear) -> Sheared {
    let [kx, ky, kz] = shear.axes;
    let origin = |axis: usize| _mm256_set1_ps(shear.origin[axis]);
    let (ox, oy, oz) = (origin(kx), origin(ky), origin(kz));
    let (sx, sy) = (_mm256_set1_ps(shear.shear.x), _mm256_set1_ps(shear.shear.y));
    let zero = _mm256_setzero_ps();
    let (mut x, mut y, mut z) = ([zero; 3], [zero; 3], [zero; 3]);
    for (i, vertex) in packet.vertices.iter().enumerate() {
        z[i] = _mm256_sub_ps(load(&vertex[kz]), oz);
        x[i] = _mm256_sub_ps(_mm256_sub_ps(load(&vertex[kx]), ox), _mm256_mul_ps(sx, z[i]));
        y[i] = _mm256_sub_ps(_mm256_sub_ps(load(&vertex[ky]), oy), _mm256_mul_ps(sy, z[i]));
    }
    let ([ax, bx, cx], [ay, by, cy]) = (x, y);
    let u = _mm256_sub_ps(_mm256_mul_ps(cx, by), _mm256_mul_ps(cy, bx));
    let v = _mm256_sub_ps(_mm256_mul_ps(ax, cy), _mm256_mul_ps(ay, cx));
    let w = _mm256_sub_ps(_mm256_mul_ps(bx, ay), _mm256_mul_ps(by, ax));
    let is_zero = |edge: __m256| _mm256_cmp_ps::<_CMP_EQ_OQ>(edge, zero);
    let on_edge = _mm256_or_ps(_mm256_or_ps(is_zero(u), is_zero(v)), is_zero(w));
    let least = _mm256_min_ps(u, _mm256_min_ps(v, w));
    let largest = _mm256_max_ps(u, _mm256_max_ps(v, w));
    let outside = _mm256_and_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(least, zero), _mm256_cmp_ps::<_CMP_GT_OQ>(largest, zero));
    let ordered = _mm256_cmp_ps::<_CMP_ORD_Q>(least, largest);
    let inside = _mm256_andnot_ps(_mm256_or_ps(outside, on_edge), ordered);
    Sheared { x, y, z, edges: [u, v, w], inside, on_edge: _mm256_movemask_ps(on_edge) as u32 }
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn largest_of([a, b, c]: [__m256; 3]) -> __m256 {
    let magnitude = |v: __m256| _mm256_andnot_ps(_mm256_set1_ps(-0.0), v);
    _mm256_max_ps(_mm256_max_ps(magnitude(a), magnitude(b)), magnitude(c))
}

/// Lanes in which the ray meets a triangle, except those on an edge, with distances and inverse determinants.
/// `inclusive` counts hits at `t_max` as well.
#[inline]
#[target_feature(enable = "avx2,fma")]
fn hits<const INCLUSIVE: bool>(sheared: &Sheared, shear_z: f32, t_max: f32) -> (u32, __m256, __m256) {
    let [u, v, w] = sheared.edges;
    let zero = _mm256_setzero_ps();
    let det = _mm256_add_ps(_mm256_add_ps(u, v), w);
    let inverse = _mm256_div_ps(_mm256_set1_ps(1.0), det);
    let z = sheared.z.map(|z| _mm256_mul_ps(z, _mm256_set1_ps(shear_z)));
    let sum = _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(u, z[0]), _mm256_mul_ps(v, z[1])), _mm256_mul_ps(w, z[2]));
    let t = _mm256_mul_ps(sum, inverse);
    let before = if INCLUSIVE {
        _mm256_cmp_ps::<_CMP_LE_OQ>(t, _mm256_set1_ps(t_max))
    } else {
        _mm256_cmp_ps::<_CMP_LT_OQ>(t, _mm256_set1_ps(t_max))
    };
    let valid = _mm256_and_ps(_mm256_and_ps(sheared.inside, before), _mm256_cmp_ps::<_CMP_GT_OQ>(t, zero));
    let behind = _mm256_cmp_ps::<_CMP_NGT_UQ>(_mm256_min_ps(z[0], _mm256_min_ps(z[1], z[2])), zero);
    if _mm256_movemask_ps(_mm256_and_ps(valid, behind)) == 0 {
        return (_mm256_movemask_ps(valid) as u32, t, inverse);
    }
    let error = distance_error([largest_of(sheared.x), largest_of(sheared.y), largest_of(z)], largest_of([u, v, w]));
    let magnitude = _mm256_andnot_ps(_mm256_set1_ps(-0.0), inverse);
    let within_error = _mm256_cmp_ps::<_CMP_NGT_UQ>(t, _mm256_mul_ps(error, magnitude));
    let doubtful = _mm256_and_ps(behind, within_error);
    (_mm256_movemask_ps(_mm256_andnot_ps(doubtful, valid)) as u32, t, inverse)
}

/// See [`crate::geometry::triangle::distance_error`].
#[inline]
#[target_feature(enable = "avx2,fma")]
fn distance_error([x, y, z]: [__m256; 3], edge: __m256) -> __m256 {
    let times = |factor: f32, v: __m256| _mm256_mul_ps(_mm256_set1_ps(factor), v);
    let dx = times(ERROR_XY, _mm256_add_ps(x, z));
    let dy = times(ERROR_XY, _mm256_add_ps(y, z));
    let dz = times(ERROR_Z, z);
    let products = _mm256_add_ps(_mm256_mul_ps(times(ERROR_EDGE, x), y), _mm256_mul_ps(dy, x));
    let edge_error = times(2.0, _mm256_add_ps(products, _mm256_mul_ps(dx, y)));
    let sum = _mm256_add_ps(_mm256_mul_ps(times(ERROR_Z, edge), z), _mm256_mul_ps(edge_error, z));
    times(3.0, _mm256_add_ps(sum, _mm256_mul_ps(dz, edge)))
}

/// See [`super::portable::closest`].
#[inline]
#[target_feature(enable = "avx2,fma")]
pub fn closest(packet: &Packet, shear: &Shear, best: &mut Hit) {
    let sheared = shear_packet(packet, shear);
    if sheared.on_edge != 0 {
        closest_on_edge(packet, shear, sheared.on_edge, best);
    }
    if _mm256_movemask_ps(sheared.inside) == 0 {
        return;
    }
    let (mut mask, t, inverse) = hits::<true>(&sheared, shear.shear.z, best.distance);
    if mask == 0 {
        return;
    }
    let mut distances = [0.0; WIDTH];
    let mut barycentric = [[0.0; WIDTH]; 2];
    store(&mut distances, t);
    store(&mut barycentric[0], _mm256_mul_ps(sheared.edges[1], inverse));
    store(&mut barycentric[1], _mm256_mul_ps(sheared.edges[2], inverse));
    while mask != 0 {
        let lane = mask.trailing_zeros() as usize % WIDTH;
        mask &= mask - 1;
        best.replace(Hit {
            distance: distances[lane],
            shape: packet.shapes[lane],
            triangle: packet.triangles[lane],
            barycentric: barycentric.map(|b| b[lane]),
        });
    }
}

/// See [`super::portable::occluded`].
#[inline]
#[target_feature(enable = "avx2,fma")]
pub fn occluded(packet: &Packet, shear: &Shear, t_max: f32) -> bool {
    let sheared = shear_packet(packet, shear);
    if sheared.on_edge != 0 && occluded_on_edge(packet, shear, sheared.on_edge, t_max) {
        return true;
    }
    _mm256_movemask_ps(sheared.inside) != 0 && hits::<false>(&sheared, shear.shear.z, t_max).0 != 0
}

fn lanes(mask: u32) -> impl Iterator<Item = usize> {
    (0..WIDTH).filter(move |lane| mask >> lane & 1 == 1)
}

#[cold]
fn closest_on_edge(packet: &Packet, shear: &Shear, mask: u32, best: &mut Hit) {
    for lane in lanes(mask) {
        if let Some((distance, barycentric)) = shear.intersect(&packet.triangle(lane), best.distance.next_up()) {
            best.replace(Hit { distance, shape: packet.shapes[lane], triangle: packet.triangles[lane], barycentric });
        }
    }
}

#[cold]
fn occluded_on_edge(packet: &Packet, shear: &Shear, mask: u32, t_max: f32) -> bool {
    lanes(mask).any(|lane| shear.intersect(&packet.triangle(lane), t_max).is_some())
}
