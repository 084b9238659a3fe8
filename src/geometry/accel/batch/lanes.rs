//! Sixteen rays against the boxes of a node. All go to the same side along each axis, so the nearer plane of a box is the same
//! for all. Arithmetic is that of [`super::super::portable::boxes`].

use super::super::node::{Node, WIDTH};
use super::super::query::{Query, Slabs};
use super::sixteen::{Bounds, Lane, Lanes, RAYS};
use super::wide::Wide;
use crate::geometry::Ray;
use crate::geometry::sphere::{Sphere, Spheres};
use crate::math::lanes::{Bits, Mask, Real, V3};

impl Lanes {
    /// Computes the constants of the first `count` rays, which have the octant and main axis of `first`, and returns their bounds.
    /// The lanes behind them get the same ray and end.
    #[inline(always)]
    pub fn prepare<T: Wide>(&mut self, tests: T, count: usize, first: &Query) -> Bounds {
        let ray = Ray { origin: first.origin, direction: first.direction };
        for lane in count..RAYS {
            self.set(lane, &ray, -1.0);
        }
        for axis in 0..3 {
            let inverse = tests.load(&self.direction[axis]).inverse();
            self.nearer[axis] = tests.store(-inverse * inverse.all(1.0 - Slabs::SLACK));
            self.farther[axis] = tests.store(-inverse * inverse.all(1.0 + Slabs::SLACK));
        }
        self.axes = first.shear.axes;
        let [x, y, z] = load3(tests, &self.direction, self.axes);
        let inverse = z.inverse();
        self.shear = [tests.store(x * inverse), tests.store(y * inverse), tests.store(inverse)];
        let origin = ranges(tests, &self.origin);
        let forward = first.slabs.nearer.map(|nearer| nearer < 0.0);
        let choose = |far: bool| [0, 1, 2].map(|axis: usize| origin[axis][usize::from(forward[axis] != far)]);
        let Slabs { nearer_plane, farther_plane, .. } = first.slabs;
        let (nearer, farther) = (ranges(tests, &self.nearer), ranges(tests, &self.farther));
        Bounds { near_origin: choose(false), far_origin: choose(true), nearer, farther, nearer_plane, farther_plane }
    }
}

/// The numbers of three axes.
#[inline(always)]
fn load3<T: Wide>(tests: T, values: &[Lane; 3], [x, y, z]: [usize; 3]) -> [T::Real; 3] {
    [tests.load(&values[x]), tests.load(&values[y]), tests.load(&values[z])]
}

/// The rays that meet a sphere no farther than they look, one bit each.
#[inline(always)]
pub fn meeting<T: Wide>(tests: T, lanes: &Lanes, sphere: &Sphere) -> u16 {
    const AXES: [usize; 3] = [0, 1, 2];
    let ([x, y, z], [dx, dy, dz]) = (load3(tests, &lanes.origin, AXES), load3(tests, &lanes.direction, AXES));
    let spheres = Spheres { center: V3::splat(x).all(sphere.center), radius: x.all(sphere.radius) };
    // The next number is farther: what lies exactly there may be of an earlier shape. There is none behind infinity.
    let reach = tests.load(&lanes.t_max);
    let next = (reach.bits() + reach.bits().all(1)).real_bits();
    let beyond = reach.finite().choose(next, reach);
    let (_, met) = spheres.intersect(V3::new(x, y, z), V3::new(dx, dy, dz), beyond);
    met.answers() as u16
}

/// The least and the largest of each axis.
#[inline(always)]
fn ranges<T: Wide>(tests: T, [x, y, z]: &[Lane; 3]) -> [[f32; 2]; 3] {
    [tests.range(x), tests.range(y), tests.range(z)]
}

impl Bounds {
    /// The children whose boxes a ray of the bundle may meet before `t_max`, one bit each; `distances` gets distances that no ray's
    /// is below. Rounded sums and products rise with their operands, so bounds hold for rounded distances.
    #[inline(always)]
    pub fn boxes<T: Wide>(&self, tests: T, node: &Node, t_max: f32, distances: &mut [f32; WIDTH]) -> u32 {
        tests.boxes(self, node, t_max, distances)
    }

    /// The rays, one bit each, that meet each child in `children`.
    #[inline(always)]
    pub fn rays<T: Wide>(&self, tests: T, lanes: &Lanes, node: &Node, mut children: u32, met: &mut [u16; WIDTH]) {
        let planes = [self.nearer_plane, self.farther_plane].map(|planes| planes.map(|plane| &node.planes[plane]));
        let origin = load3(tests, &lanes.origin, [0, 1, 2]);
        let (nearer, farther) = (load3(tests, &lanes.nearer, [0, 1, 2]), load3(tests, &lanes.farther, [0, 1, 2]));
        let t_max = tests.load(&lanes.t_max);
        while children != 0 {
            let child = children.trailing_zeros() as usize % WIDTH;
            children &= children - 1;
            let [mut near, mut far] = [t_max.all(0.0), t_max];
            for axis in 0..3 {
                let (low, high) = (t_max.all(planes[0][axis][child]), t_max.all(planes[1][axis][child]));
                near = ((origin[axis] - low) * nearer[axis]).max(near);
                far = ((origin[axis] - high) * farther[axis]).min(far);
            }
            met[child] = near.le(far).answers() as u16;
        }
    }
}

/// The rays that look as far as `distance`, one bit each.
#[inline(always)]
pub fn reaching<T: Wide>(tests: T, lanes: &Lanes, distance: f32) -> u16 {
    let t_max = tests.load(&lanes.t_max);
    t_max.ge(t_max.all(distance)).answers() as u16
}

/// The farthest that any ray looks; a negative distance where all have ended.
#[inline(always)]
pub fn farthest<T: Wide>(tests: T, lanes: &Lanes) -> f32 {
    let t_max = tests.load(&lanes.t_max);
    // A ray that looks as far as no number meets nothing, and the maximum is the other operand then.
    let [_, farthest] = tests.range(&tests.store(t_max.max(t_max.all(-1.0))));
    farthest
}
