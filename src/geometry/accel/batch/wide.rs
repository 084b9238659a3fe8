//! What a batch of rays needs of the processor.

use super::super::node::{LANES, Node, Packet, WIDTH};
use super::super::query::{Query, Slabs};
use super::super::traverse::{Others, Tests};
use super::super::{Hit, avx2};
use super::sixteen::{Bounds, Lane, Lanes};
use super::triangles::{Found, GROUP, RayBlock};
use super::vectors;
use crate::base::processor::{Avx2, Avx512};
use crate::geometry::triangle::Shear;
use crate::math::lanes;

/// Numbers in sixteen lanes, and what takes other instructions on other processors; see [`vectors`].
pub trait Wide: lanes::Wide {
    /// Runs `job` as a function of its own that is compiled for the instruction set.
    fn apart(self, job: impl Job);
    fn nearest_last(self, node: &Node, slabs: &Slabs, t_max: f32, room: &mut [u64; WIDTH]) -> usize;
    fn in_order(self, node: &Node, slabs: &Slabs, t_max: f32, room: &mut [u64; WIDTH]) -> usize;
    fn keep(self, stack: &mut [u64], count: usize, limit: f32) -> usize;
    fn boxes(self, bounds: &Bounds, node: &Node, t_max: f32, distances: &mut [f32; WIDTH]) -> u32;
    fn range(self, values: &Lane) -> [f32; 2];
    fn bundle<const INCLUSIVE: bool>(self, packet: &Packet, lanes: &Lanes, group: [usize; GROUP], found: &mut Found);
    /// The tests of single rays.
    fn single(self) -> Avx2;
    /// Whether single rays in flight test their packets in groups, with [`Wide::each`]. With AVX2 a group is gathered as slowly as it
    /// is tested.
    const GROUPS: bool;
    /// Tests each packet against its ray; `INCLUSIVE` counts hits at the maximum distance as well.
    fn test_each<const INCLUSIVE: bool>(self, packets: [&Packet; GROUP], rays: [&RayBlock; GROUP], found: &mut Found);
}

/// Work that [`Wide::apart`] runs.
pub trait Job {
    /// The work. Marked `#[inline(always)]`, like all that it calls for a [`Wide`]: what is not inlined is compiled for the oldest
    /// processor.
    fn run(self);
}

macro_rules! wide {
    ($set:ident, $module:ident, $features:literal, $($items:item)*) => {
        impl Wide for $set {
            #[inline(always)]
            fn apart(self, job: impl Job) {
                #[inline(never)]
                #[target_feature(enable = $features)]
                fn compiled(job: impl Job) {
                    job.run();
                }
                // SAFETY: `self` proves that the processor has the features.
                unsafe { compiled(job) }
            }

            #[inline(always)]
            fn nearest_last(self, node: &Node, slabs: &Slabs, t_max: f32, room: &mut [u64; WIDTH]) -> usize {
                // SAFETY: `self` proves that the processor has the features.
                unsafe { vectors::$module::nearest_last(node, slabs, t_max, room) }
            }

            #[inline(always)]
            fn in_order(self, node: &Node, slabs: &Slabs, t_max: f32, room: &mut [u64; WIDTH]) -> usize {
                // SAFETY: `self` proves that the processor has the features.
                unsafe { vectors::$module::in_order(node, slabs, t_max, room) }
            }

            #[inline(always)]
            fn keep(self, stack: &mut [u64], count: usize, limit: f32) -> usize {
                // SAFETY: `self` proves that the processor has the features.
                unsafe { vectors::$module::keep(stack, count, limit) }
            }

            #[inline(always)]
            fn boxes(self, bounds: &Bounds, node: &Node, t_max: f32, distances: &mut [f32; WIDTH]) -> u32 {
                // SAFETY: `self` proves that the processor has the features.
                unsafe { vectors::boxes(bounds, node, t_max, distances) }
            }

            #[inline(always)]
            fn range(self, values: &Lane) -> [f32; 2] {
                // SAFETY: `self` proves that the processor has the features.
                unsafe { vectors::range(values) }
            }

            #[inline(always)]
            fn bundle<const INCLUSIVE: bool>(
                self,
                packet: &Packet,
                lanes: &Lanes,
                group: [usize; GROUP],
                found: &mut Found,
            ) {
                // SAFETY: `self` proves that the processor has the features.
                unsafe { vectors::$module::bundle::<INCLUSIVE>(self, packet, lanes, group, found) }
            }

            $($items)*
        }
    };
}

wide! {
    Avx2, avx2, "avx2,fma,bmi1,bmi2,lzcnt,popcnt",

    #[inline(always)]
    fn single(self) -> Avx2 {
        self
    }

    const GROUPS: bool = false;

    #[inline(always)]
    fn test_each<const INCLUSIVE: bool>(self, _: [&Packet; GROUP], _: [&RayBlock; GROUP], _: &mut Found) {}
}

wide! {
    Avx512, avx512, "avx2,fma,bmi1,bmi2,lzcnt,popcnt,avx512f,avx512vl,avx512bw,avx512dq",

    #[inline(always)]
    fn single(self) -> Avx2 {
        self.avx2()
    }

    const GROUPS: bool = true;

    #[inline(always)]
    fn test_each<const INCLUSIVE: bool>(
        self,
        packets: [&Packet; GROUP],
        rays: [&RayBlock; GROUP],
        found: &mut Found,
    ) {
        // SAFETY: `self` proves that the processor has the features.
        unsafe { vectors::avx512::each::<INCLUSIVE>(self, packets, rays, found) }
    }
}

/// What a batch looks for.
pub trait Goal: Copy {
    /// Whether children are visited by distance, and a hit at the maximum distance counts, since it may be of an earlier primitive.
    const NEAREST: bool;
    /// Stacks the children of a node, the one to visit first last, and returns their number.
    fn stack<T: Wide>(self, tests: T, node: &Node, slabs: &Slabs, t_max: f32, room: &mut [u64; WIDTH]) -> usize;
    /// Tests the triangles of a packet. Returns whether the best hit is nearer now.
    fn packet<T: Wide>(self, tests: T, packet: &Packet, query: &Query, best: &mut Hit) -> bool;
    /// Takes the hits that a group's test found for the ray of packet `number`. Returns whether the best hit is nearer now.
    fn take(self, found: &Found, number: usize, packet: &Packet, shear: impl Fn() -> Shear, best: &mut Hit) -> bool;
    /// Tests a primitive that is not a triangle. Returns whether the best hit is nearer now.
    fn other(self, others: &impl Others, index: usize, query: &Query, best: &mut Hit) -> bool;
    /// How far a ray looks that has found its best hit so far: a negative distance where it has ended.
    fn reach(self, best: &Hit) -> f32;
    /// Removes what a nearer hit rules out from the stack, whose first entry stays. Returns the new length.
    fn cut<T: Wide>(self, tests: T, stack: &mut [u64], length: usize, best: &Hit) -> usize;
}

/// The nearest hit.
#[derive(Clone, Copy)]
pub struct Nearest;

impl Goal for Nearest {
    #[inline(always)]
    fn reach(self, best: &Hit) -> f32 {
        best.distance
    }

    const NEAREST: bool = true;

    #[inline(always)]
    fn take(self, found: &Found, number: usize, packet: &Packet, shear: impl Fn() -> Shear, best: &mut Hit) -> bool {
        let before = best.distance;
        let [mut mask, on_edge] = [found.mask, found.on_edge].map(|mask| mask >> (LANES * number) & 0xF);
        if on_edge != 0 {
            avx2::closest_on_edge(packet, &shear(), on_edge, best);
        }
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize % LANES;
            mask &= mask - 1;
            let at = (LANES * number + lane) % (GROUP * LANES);
            let (shape, triangle) = (packet.shapes[lane], packet.triangles[lane]);
            best.replace(Hit {
                distance: found.distances[at],
                shape,
                triangle,
                barycentric: [found.b1[at], found.b2[at]],
            });
        }
        best.distance < before
    }

    #[inline(always)]
    fn stack<T: Wide>(self, tests: T, node: &Node, slabs: &Slabs, t_max: f32, room: &mut [u64; WIDTH]) -> usize {
        tests.nearest_last(node, slabs, t_max, room)
    }

    #[inline(always)]
    fn packet<T: Wide>(self, tests: T, packet: &Packet, query: &Query, best: &mut Hit) -> bool {
        let before = best.distance;
        tests.single().closest(packet, &query.shear, best);
        best.distance < before
    }

    #[inline(always)]
    fn other(self, others: &impl Others, index: usize, query: &Query, best: &mut Hit) -> bool {
        let before = best.distance;
        others.closest(index, query, best);
        best.distance < before
    }

    #[inline(always)]
    fn cut<T: Wide>(self, tests: T, stack: &mut [u64], length: usize, best: &Hit) -> usize {
        tests.keep(stack, length, best.distance)
    }
}

/// Any hit before the distance of a best hit of no shape, which shape 0 then takes the place of.
#[derive(Clone, Copy)]
pub struct Any;

impl Goal for Any {
    #[inline(always)]
    fn reach(self, best: &Hit) -> f32 {
        if best.shape == u32::MAX { best.distance } else { -1.0 }
    }

    const NEAREST: bool = false;

    #[inline(always)]
    fn take(self, found: &Found, number: usize, packet: &Packet, shear: impl Fn() -> Shear, best: &mut Hit) -> bool {
        let [mask, on_edge] = [found.mask, found.on_edge].map(|mask| mask >> (LANES * number) & 0xF);
        let met = mask != 0 || on_edge != 0 && avx2::occluders_on_edge(packet, &shear(), on_edge, best.distance) != 0;
        best.shape = if met { 0 } else { best.shape };
        met
    }

    #[inline(always)]
    fn stack<T: Wide>(self, tests: T, node: &Node, slabs: &Slabs, t_max: f32, room: &mut [u64; WIDTH]) -> usize {
        tests.in_order(node, slabs, t_max, room)
    }

    #[inline(always)]
    fn packet<T: Wide>(self, tests: T, packet: &Packet, query: &Query, best: &mut Hit) -> bool {
        let found = tests.single().occluded(packet, &query.shear, best.distance);
        best.shape = if found { 0 } else { best.shape };
        found
    }

    #[inline(always)]
    fn other(self, others: &impl Others, index: usize, query: &Query, best: &mut Hit) -> bool {
        let found = others.occluded(index, query, best.distance);
        best.shape = if found { 0 } else { best.shape };
        found
    }

    #[inline(always)]
    fn cut<T: Wide>(self, _: T, _: &mut [u64], _: usize, _: &Hit) -> usize {
        1
    }
}
