//! What a batch of rays needs of the processor.

use super::super::node::{LANES, Node, Packet, WIDTH};
use super::super::query::{Query, Slabs};
use super::super::traverse::{Others, Tests};
use super::super::{Hit, avx2};
use super::triangles::{self, Found, GROUP, RayBlock};
use super::vectors;
use crate::base::processor::{Avx2, Avx512};
use crate::geometry::triangle::Shear;

/// The steps of many rays in flight; see [`vectors`].
pub trait Wide: Copy {
    /// The tests of single rays.
    type Single: Tests;
    fn single(self) -> Self::Single;
    fn nearest_last(self, node: &Node, slabs: &Slabs, t_max: f32, room: &mut [u64; WIDTH]) -> usize;
    fn in_order(self, node: &Node, slabs: &Slabs, t_max: f32, room: &mut [u64; WIDTH]) -> usize;
    fn keep(self, stack: &mut [u64], count: usize, limit: f32) -> usize;
    /// Whether packets are tested in groups.
    const GROUPS: bool;
    /// Tests each packet against its ray; `INCLUSIVE` counts hits at the maximum distance as well.
    fn group<const INCLUSIVE: bool>(self, packets: [&Packet; GROUP], rays: [&RayBlock; GROUP], found: &mut Found);
}

impl Wide for Avx2 {
    type Single = Self;

    #[inline(always)]
    fn single(self) -> Self {
        self
    }

    #[inline(always)]
    fn nearest_last(self, node: &Node, slabs: &Slabs, t_max: f32, room: &mut [u64; WIDTH]) -> usize {
        // SAFETY: `self` proves that the processor has the features.
        unsafe { vectors::nearest_last_avx2(node, slabs, t_max, room) }
    }

    #[inline(always)]
    fn in_order(self, node: &Node, slabs: &Slabs, t_max: f32, room: &mut [u64; WIDTH]) -> usize {
        // SAFETY: `self` proves that the processor has the features.
        unsafe { vectors::in_order_avx2(node, slabs, t_max, room) }
    }

    #[inline(always)]
    fn keep(self, stack: &mut [u64], count: usize, limit: f32) -> usize {
        // SAFETY: `self` proves that the processor has the features.
        unsafe { vectors::keep_avx2(stack, count, limit) }
    }

    const GROUPS: bool = false;

    #[inline(always)]
    fn group<const INCLUSIVE: bool>(self, _: [&Packet; GROUP], _: [&RayBlock; GROUP], _: &mut Found) {}
}

impl Wide for Avx512 {
    type Single = Avx2;

    #[inline(always)]
    fn single(self) -> Avx2 {
        self.avx2()
    }

    #[inline(always)]
    fn nearest_last(self, node: &Node, slabs: &Slabs, t_max: f32, room: &mut [u64; WIDTH]) -> usize {
        // SAFETY: `self` proves that the processor has the features.
        unsafe { vectors::nearest_last_avx512(node, slabs, t_max, room) }
    }

    #[inline(always)]
    fn in_order(self, node: &Node, slabs: &Slabs, t_max: f32, room: &mut [u64; WIDTH]) -> usize {
        // SAFETY: `self` proves that the processor has the features.
        unsafe { vectors::in_order_avx512(node, slabs, t_max, room) }
    }

    #[inline(always)]
    fn keep(self, stack: &mut [u64], count: usize, limit: f32) -> usize {
        // SAFETY: `self` proves that the processor has the features.
        unsafe { vectors::keep_avx512(stack, count, limit) }
    }

    const GROUPS: bool = true;

    #[inline(always)]
    fn group<const INCLUSIVE: bool>(self, packets: [&Packet; GROUP], rays: [&RayBlock; GROUP], found: &mut Found) {
        // SAFETY: `self` proves that the processor has the features.
        unsafe { triangles::each::<INCLUSIVE>(packets, rays, found) }
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
