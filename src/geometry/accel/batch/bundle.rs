//! Bundles of sixteen rays that walk through the hierarchy together. Where few of them go on, they leave the bundle and fly alone.

use super::super::Hit;
use super::super::node::{Child, Kind, LANES, WIDTH};
use super::super::query::Query;
use super::super::traverse::{Hierarchy, Others};
use super::flight::{Ahead, Flight, SLOTS};
use super::lanes::{farthest, meeting, reaching};
use super::sixteen::{Bounds, Lanes, RAYS};
use super::triangles::{Found, GROUP};
use super::wide::{Goal, Job, Wide};
use crate::geometry::Ray;

/// Rays that leave the bundle rather than visit a node together.
const FEW: u32 = 3;

/// A child that the rays of a mask, one bit each, have to visit.
#[derive(Debug, Clone, Copy)]
struct Entry {
    child: Child,
    mask: u16,
    /// At most the distance of any of them to the child's box.
    distance: f32,
}

/// Rays that walk together, with their stack.
pub struct Bundle {
    lanes: Lanes,
    best: [Hit; RAYS],
    /// Numbers of the rays in their batch.
    rays: [u32; RAYS],
    count: usize,
    stack: Vec<Entry>,
}

impl Default for Bundle {
    fn default() -> Self {
        Self { lanes: Lanes::EMPTY, best: [Hit::NONE; RAYS], rays: [0; RAYS], count: 0, stack: Vec::new() }
    }
}

/// What a bundle walks through, and what for.
pub struct Walk<'a, T, G, O> {
    pub tests: T,
    pub goal: G,
    pub tree: &'a Hierarchy,
    pub others: &'a O,
}

impl Bundle {
    /// Adds a ray of the same octant and main axis as those before, with a maximum distance. There are fewer than [`RAYS`].
    #[inline(always)]
    pub fn add(&mut self, number: u32, ray: &Ray, t_max: f32) {
        let lane = self.count % RAYS;
        self.rays[lane] = number;
        self.best[lane] = Hit { distance: t_max, ..Hit::NONE };
        self.lanes.set(lane, ray, t_max);
        self.count = lane + 1;
    }

    fn query(&self, lane: usize) -> Query {
        let Ray { origin, direction } = self.lanes.ray(lane);
        Query::new(origin, direction)
    }

    /// Walks the rays through the hierarchy, and calls `answer` with the number and best hit of each that did not leave. The bundle
    /// is empty then.
    #[inline(always)]
    pub fn walk<T: Wide, G: Goal, O: Others>(
        &mut self,
        walk: &Walk<T, G, O>,
        flight: &mut Flight,
        answer: &mut impl FnMut(u32, &Hit),
    ) {
        let bounds = self.lanes.prepare(walk.tests, self.count, &self.query(0));
        let mut staying = ((1u32 << self.count) - 1) as u16;
        self.count = 0;
        let mut t_max = farthest(walk.tests, &self.lanes);
        let mut current = Entry { child: walk.tree.root, mask: staying, distance: 0.0 };
        self.stack.clear();
        loop {
            match current.child.kind() {
                Kind::Node(_) if current.mask.count_ones() <= FEW => {
                    self.leave(walk, current, flight, answer);
                    staying &= !current.mask;
                }
                Kind::Node(index) => self.node(walk, index, &bounds, current.mask, t_max),
                Kind::Packet(index) => {
                    if self.packet(walk, index, current.mask) {
                        t_max = farthest(walk.tests, &self.lanes);
                    }
                }
                Kind::Other(index) => {
                    if self.other(walk, index, current.mask) {
                        t_max = farthest(walk.tests, &self.lanes);
                    }
                }
            }
            let Some(next) = self.pop(walk.tests) else { break };
            current = next;
        }
        for lane in lanes_of(staying) {
            answer(self.rays[lane], &self.best[lane]);
        }
    }

    /// The next entry that a ray still has to visit.
    #[inline(always)]
    fn pop(&mut self, tests: impl Wide) -> Option<Entry> {
        loop {
            let entry = self.stack.pop()?;
            let mask = entry.mask & reaching(tests, &self.lanes, entry.distance);
            if mask != 0 {
                return Some(Entry { mask, ..entry });
            }
        }
    }

    /// Stacks the children of a node that rays of `mask` meet, the one to visit first last.
    #[inline(always)]
    fn node<T: Wide, G: Goal, O>(
        &mut self,
        walk: &Walk<T, G, O>,
        index: usize,
        bounds: &Bounds,
        mask: u16,
        t_max: f32,
    ) {
        let node = &walk.tree.nodes[index];
        let (mut distances, mut met) = ([0.0; WIDTH], [0; WIDTH]);
        let mut children = bounds.boxes(walk.tests, node, t_max, &mut distances);
        bounds.rays(walk.tests, &self.lanes, node, children, &mut met);
        let begin = self.stack.len();
        while children != 0 {
            let lane = children.trailing_zeros() as usize % WIDTH;
            children &= children - 1;
            let entry = Entry { child: node.children[lane], mask: met[lane] & mask, distance: distances[lane] };
            if entry.mask == 0 {
                continue;
            }
            Ahead::of(walk.tree).fetch(entry.child);
            let mut at = self.stack.len();
            self.stack.push(entry);
            while G::NEAREST && at > begin && self.stack[at - 1].distance < entry.distance {
                self.stack[at] = self.stack[at - 1];
                at -= 1;
            }
            self.stack[at] = entry;
        }
    }

    /// Tests the triangles of a packet against the rays of `mask`. Returns whether one looks less far now.
    #[inline(always)]
    fn packet<T: Wide, G: Goal, O>(&mut self, walk: &Walk<T, G, O>, index: usize, mut mask: u16) -> bool {
        let packet = &walk.tree.packets[index];
        let mut found = Found::NOTHING;
        let mut shorter = false;
        while mask != 0 {
            let mut group = [mask.trailing_zeros() as usize % RAYS; GROUP];
            let number = (mask.count_ones() as usize).min(GROUP);
            for lane in &mut group[..number] {
                *lane = mask.trailing_zeros() as usize % RAYS;
                mask &= mask - 1;
            }
            if G::NEAREST {
                walk.tests.bundle::<true>(packet, &self.lanes, group, &mut found);
            } else {
                walk.tests.bundle::<false>(packet, &self.lanes, group, &mut found);
            }
            let mut met = (found.mask | found.on_edge) & ((1 << (LANES * number)) - 1);
            while met != 0 {
                let i = met.trailing_zeros() as usize / LANES % GROUP;
                met &= !(0xF << (LANES * i));
                let lane = group[i];
                let mut best = self.best[lane];
                if walk.goal.take(&found, i, packet, || self.query(lane).shear, &mut best) {
                    self.lanes.t_max[lane] = walk.goal.reach(&best);
                    shorter = true;
                }
                self.best[lane] = best;
            }
        }
        shorter
    }

    /// Tests a primitive that is no triangle against the rays of `mask`. Returns whether one looks less far now.
    #[inline(always)]
    fn other<T: Wide, G: Goal, O: Others>(&mut self, walk: &Walk<T, G, O>, index: usize, mask: u16) -> bool {
        // Of a sphere most miss it, or end before it: those that are on their way to a light.
        let mut mask = mask;
        if let Some(sphere) = walk.others.sphere(index) {
            mask &= meeting(walk.tests, &self.lanes, sphere);
        }
        mask != 0 && self.other_by_ray(walk, index, mask)
    }

    /// Tests a primitive against one ray after the other.
    #[inline(never)]
    fn other_by_ray<T: Wide, G: Goal, O: Others>(&mut self, walk: &Walk<T, G, O>, index: usize, mask: u16) -> bool {
        let mut shorter = false;
        for lane in lanes_of(mask) {
            let query = self.query(lane);
            if walk.goal.other(walk.others, index, &query, &mut self.best[lane]) {
                self.lanes.t_max[lane] = walk.goal.reach(&self.best[lane]);
                shorter = true;
            }
        }
        shorter
    }

    /// Lets the rays of an entry fly alone, with all that each still has to visit.
    #[inline(always)]
    fn leave<T: Wide, G: Goal, O: Others>(
        &mut self,
        walk: &Walk<T, G, O>,
        current: Entry,
        flight: &mut Flight,
        answer: &mut impl FnMut(u32, &Hit),
    ) {
        for lane in lanes_of(current.mask) {
            land(walk, flight, SLOTS - 1, answer);
            let waiting = self.stack.iter().chain([&current]).filter(|entry| entry.mask >> lane & 1 == 1);
            let entries = waiting.map(|entry| u64::from(entry.distance.to_bits()) << 32 | u64::from(entry.child.0));
            flight.adopt(walk.tree, self.rays[lane], &self.query(lane), self.best[lane], entries);
            self.lanes.t_max[lane] = -1.0;
        }
    }
}

/// Goes on with the rays in flight until at most `most` are left.
#[inline(always)]
fn land<T: Wide, G: Goal, O: Others>(
    walk: &Walk<T, G, O>,
    flight: &mut Flight,
    most: usize,
    answer: &mut impl FnMut(u32, &Hit),
) {
    if flight.len() > most {
        walk.tests.apart(Land { walk, flight, most, answer });
    }
}

/// See [`land`].
struct Land<'a, T, G, O, A> {
    walk: &'a Walk<'a, T, G, O>,
    flight: &'a mut Flight,
    most: usize,
    answer: &'a mut A,
}

impl<T: Wide, G: Goal, O: Others, A: FnMut(u32, &Hit)> Job for Land<'_, T, G, O, A> {
    #[inline(always)]
    fn run(self) {
        let Walk { tests, goal, tree, others } = *self.walk;
        while self.flight.len() > self.most {
            self.flight.round(tests, goal, tree, others, self.answer);
        }
    }
}

fn lanes_of(mask: u16) -> impl Iterator<Item = usize> {
    (0..RAYS).filter(move |lane| mask >> lane & 1 == 1)
}
