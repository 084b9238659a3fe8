//! Sixteen rays against the boxes of a node. All go to the same side along each axis, so the nearer plane of a box is the same
//! for all. Arithmetic is that of [`super::super::portable::boxes`].

use std::arch::x86_64::*;

use glam::Vec3;

use super::super::node::{Node, WIDTH};
use super::super::query::{Query, Slabs};
use crate::geometry::Ray;

/// Rays of a bundle.
pub const RAYS: usize = 16;

type Lane = [f32; RAYS];

/// Rays with the constants of their tests against boxes and triangles, by axis.
#[repr(C, align(64))]
pub struct Lanes {
    pub origin: [Lane; 3],
    direction: [Lane; 3],
    /// See [`Slabs::nearer`].
    nearer: [Lane; 3],
    /// See [`Slabs::farther`].
    farther: [Lane; 3],
    /// See [`Shear`](crate::geometry::triangle::Shear), whose axes are the same for all.
    pub shear: [Lane; 3],
    pub axes: [usize; 3],
    /// The farthest that each ray still looks; a negative distance where it has ended.
    pub t_max: Lane,
}

/// Bounds of the constants of all rays of a bundle, by axis.
pub struct Bounds {
    /// The origin from which the nearer planes are nearest.
    near_origin: [f32; 3],
    /// The origin from which the farther planes are farthest.
    far_origin: [f32; 3],
    /// Least and largest of [`Slabs::nearer`].
    nearer: [[f32; 2]; 3],
    /// Least and largest of [`Slabs::farther`].
    farther: [[f32; 2]; 3],
    nearer_plane: [usize; 3],
    farther_plane: [usize; 3],
}

impl Lanes {
    pub const EMPTY: Self = {
        let zeros = [[0.0; RAYS]; 3];
        let (origin, direction, nearer, farther, shear) = (zeros, zeros, zeros, zeros, zeros);
        Self { origin, direction, nearer, farther, shear, axes: [0; 3], t_max: [-1.0; RAYS] }
    };

    /// Puts a ray with its maximum distance into a lane.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, ray: &Ray, t_max: f32) {
        for axis in 0..3 {
            self.origin[axis][lane] = ray.origin[axis];
            self.direction[axis][lane] = ray.direction[axis];
        }
        self.t_max[lane] = t_max;
    }

    /// The ray in a lane.
    pub fn ray(&self, lane: usize) -> Ray {
        let at = |values: &[Lane; 3]| Vec3::from_array(values.map(|values| values[lane]));
        Ray { origin: at(&self.origin), direction: at(&self.direction) }
    }

    /// Computes the constants of the first `count` rays, which have the octant and main axis of `first`, and returns their bounds.
    /// The lanes behind them get the same ray and end.
    #[target_feature(enable = "avx2,fma,popcnt,avx512f,avx512vl,avx512bw,avx512dq")]
    pub fn prepare(&mut self, count: usize, first: &Query) -> Bounds {
        let ray = Ray { origin: first.origin, direction: first.direction };
        for lane in count..RAYS {
            self.set(lane, &ray, -1.0);
        }
        let inverse = self.direction.map(|lane| _mm512_div_ps(_mm512_set1_ps(1.0), bytemuck::cast(lane)));
        let scaled =
            |by: f32| inverse.map(|inverse| bytemuck::cast(_mm512_mul_ps(negative(inverse), _mm512_set1_ps(by))));
        self.nearer = scaled(1.0 - Slabs::SLACK);
        self.farther = scaled(1.0 + Slabs::SLACK);
        self.axes = first.shear.axes;
        let [kx, ky, kz] = self.axes;
        let times = |axis: usize| bytemuck::cast(_mm512_mul_ps(bytemuck::cast(self.direction[axis]), inverse[kz]));
        self.shear = [times(kx), times(ky), bytemuck::cast(inverse[kz])];
        let range =
            |lane: &Lane| [_mm512_reduce_min_ps(bytemuck::cast(*lane)), _mm512_reduce_max_ps(bytemuck::cast(*lane))];
        let ranges = |values: &[Lane; 3]| [range(&values[0]), range(&values[1]), range(&values[2])];
        let origin = ranges(&self.origin);
        let forward = first.slabs.nearer.map(|nearer| nearer < 0.0);
        let choose = |far: bool| [0, 1, 2].map(|axis: usize| origin[axis][usize::from(forward[axis] != far)]);
        let Slabs { nearer_plane, farther_plane, .. } = first.slabs;
        let (nearer, farther) = (ranges(&self.nearer), ranges(&self.farther));
        Bounds { near_origin: choose(false), far_origin: choose(true), nearer, farther, nearer_plane, farther_plane }
    }
}

#[inline]
#[target_feature(enable = "avx512f,avx512dq")]
fn negative(values: __m512) -> __m512 {
    _mm512_xor_ps(values, _mm512_set1_ps(-0.0))
}

impl Bounds {
    /// The children whose boxes a ray of the bundle may meet before `t_max`, one bit each; `distances` gets distances that no ray's
    /// is below. Rounded sums and products rise with their operands, so bounds hold for rounded distances.
    #[inline]
    #[target_feature(enable = "avx2,fma,popcnt,avx512f,avx512vl,avx512bw,avx512dq")]
    pub fn boxes(&self, node: &Node, t_max: f32, distances: &mut [f32; WIDTH]) -> u32 {
        let [mut near, mut far] = [_mm256_setzero_ps(), _mm256_set1_ps(t_max)];
        for axis in 0..3 {
            let [low, high] = self.nearer[axis].map(|v| _mm256_set1_ps(v));
            let plane: __m256 = bytemuck::cast(node.planes[self.nearer_plane[axis]]);
            let nearer = _mm256_sub_ps(_mm256_set1_ps(self.near_origin[axis]), plane);
            let distance = _mm256_min_ps(_mm256_mul_ps(nearer, low), _mm256_mul_ps(nearer, high));
            near = _mm256_max_ps(distance, near);
            let [low, high] = self.farther[axis].map(|v| _mm256_set1_ps(v));
            let plane: __m256 = bytemuck::cast(node.planes[self.farther_plane[axis]]);
            let farther = _mm256_sub_ps(_mm256_set1_ps(self.far_origin[axis]), plane);
            let distance = _mm256_max_ps(_mm256_mul_ps(farther, low), _mm256_mul_ps(farther, high));
            far = _mm256_min_ps(distance, far);
        }
        *distances = bytemuck::cast(near);
        _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(near, far)) as u32
    }

    /// The rays, one bit each, that meet each child in `children`.
    #[inline]
    #[target_feature(enable = "avx2,fma,popcnt,avx512f,avx512vl,avx512bw,avx512dq")]
    pub fn rays(&self, lanes: &Lanes, node: &Node, mut children: u32, met: &mut [u16; WIDTH]) {
        let planes = [self.nearer_plane, self.farther_plane].map(|planes| planes.map(|plane| &node.planes[plane]));
        let load = |values: &[Lane; 3]| -> [__m512; 3] { values.map(bytemuck::cast) };
        let [origin, nearer, farther] = [&lanes.origin, &lanes.nearer, &lanes.farther].map(load);
        let t_max: __m512 = bytemuck::cast(lanes.t_max);
        while children != 0 {
            let child = children.trailing_zeros() as usize % WIDTH;
            children &= children - 1;
            let [mut near, mut far] = [_mm512_setzero_ps(), t_max];
            for axis in 0..3 {
                let [low, high] = [planes[0][axis][child], planes[1][axis][child]].map(|plane| _mm512_set1_ps(plane));
                near = _mm512_max_ps(_mm512_mul_ps(_mm512_sub_ps(origin[axis], low), nearer[axis]), near);
                far = _mm512_min_ps(_mm512_mul_ps(_mm512_sub_ps(origin[axis], high), farther[axis]), far);
            }
            met[child] = _mm512_cmp_ps_mask::<_CMP_LE_OQ>(near, far);
        }
    }
}

/// The rays that look as far as `distance`, one bit each.
#[inline]
#[target_feature(enable = "avx512f")]
pub fn reaching(lanes: &Lanes, distance: f32) -> u16 {
    _mm512_cmp_ps_mask::<_CMP_LE_OQ>(_mm512_set1_ps(distance), bytemuck::cast(lanes.t_max))
}

/// The farthest that any ray looks.
#[inline]
#[target_feature(enable = "avx512f")]
pub fn farthest(lanes: &Lanes) -> f32 {
    let t_max = bytemuck::cast(lanes.t_max);
    // A ray that looks as far as no number meets nothing.
    let looks = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(t_max, _mm512_setzero_ps());
    _mm512_mask_reduce_max_ps(looks, t_max)
}
