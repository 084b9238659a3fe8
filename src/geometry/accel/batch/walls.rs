//! What shadow rays meet where some shapes let light through.

use super::super::node::{LANES, Node, Packet, WIDTH};
use super::super::query::{Query, Slabs};
use super::super::traverse::{Others, Tests};
use super::super::{Hit, Met, avx2};
use super::triangles::Found;
use super::wide::{Goal, Wide};
use crate::geometry::triangle::Shear;

/// Walls before the distance of a best hit of no shape, which shape 0 then takes the place of. Its triangle is 0 where something that is
/// no wall was met.
#[derive(Clone, Copy)]
pub struct Walls<'a> {
    /// Whether each shape is a wall.
    pub solid: &'a [bool],
}

impl Walls<'_> {
    /// What a best hit says.
    pub fn met(best: &Hit) -> Met {
        if best.shape != u32::MAX {
            Met::Wall
        } else if best.triangle == 0 {
            Met::Veils
        } else {
            Met::Nothing
        }
    }

    /// Notes that the ray meets a shape. Returns whether that is a wall.
    #[inline(always)]
    fn note(self, shape: u32, best: &mut Hit) -> bool {
        let wall = Met::by(self.solid, shape) == Met::Wall;
        if wall {
            best.shape = 0;
        } else {
            best.triangle = 0;
        }
        wall
    }

    /// Notes the shapes of the triangles in the lanes of `mask`, until one is a wall. Returns whether one is.
    #[inline(always)]
    fn note_all(self, packet: &Packet, mask: u32, best: &mut Hit) -> bool {
        mask != 0 && (0..LANES).any(|lane| mask >> lane & 1 == 1 && self.note(packet.shapes[lane], best))
    }
}

impl Goal for Walls<'_> {
    const NEAREST: bool = false;

    #[inline(always)]
    fn reach(self, best: &Hit) -> f32 {
        if best.shape == u32::MAX { best.distance } else { -1.0 }
    }

    #[inline(always)]
    fn take(self, found: &Found, number: usize, packet: &Packet, shear: impl Fn() -> Shear, best: &mut Hit) -> bool {
        let [mut mask, on_edge] = [found.mask, found.on_edge].map(|mask| mask >> (LANES * number) & 0xF);
        if on_edge != 0 {
            mask |= avx2::occluders_on_edge(packet, &shear(), on_edge, best.distance);
        }
        self.note_all(packet, mask, best)
    }

    #[inline(always)]
    fn stack<T: Wide>(self, tests: T, node: &Node, slabs: &Slabs, t_max: f32, room: &mut [u64; WIDTH]) -> usize {
        tests.in_order(node, slabs, t_max, room)
    }

    #[inline(always)]
    fn packet<T: Wide>(self, tests: T, packet: &Packet, query: &Query, best: &mut Hit) -> bool {
        let mask = tests.single().occluders(packet, &query.shear, best.distance);
        self.note_all(packet, mask, best)
    }

    #[inline(always)]
    fn other(self, others: &impl Others, index: usize, query: &Query, best: &mut Hit) -> bool {
        others.occluded(index, query, best.distance) && self.note(others.shape(index), best)
    }

    #[inline(always)]
    fn cut<T: Wide>(self, _: T, _: &mut [u64], _: usize, _: &Hit) -> usize {
        1
    }
}
