//! Many single rays in flight: each round takes every ray one step, so that the processor works on some while it waits for the
//! nodes of others, and no branch depends on a single ray.

use glam::Vec3;

use super::super::Hit;
use super::super::node::{Child, Kind, LANES, Node, Packet, WIDTH};
use super::super::query::Query;
use super::super::traverse::{Hierarchy, Others};
use super::triangles::{Found, GROUP, RayBlock};
use super::wide::{Goal, Wide};
use crate::base::processor::prefetch_line;

/// Rays in flight.
pub const SLOTS: usize = 32;

/// A ray in flight.
#[derive(Clone, Copy)]
struct Slot {
    block: RayBlock,
    query: Query,
    best: Hit,
    /// What to visit next; [`Child::EMPTY`] when the ray is done.
    current: Child,
    /// Where the slot's stack begins among all stacks, with an entry of no child, and where it ends.
    begin: u32,
    end: u32,
    /// Number of the ray in its batch.
    ray: u32,
}

/// Rays in flight with their stacks.
pub struct Flight {
    slots: Box<[Slot; SLOTS]>,
    stacks: Vec<u64>,
    /// Entries of one stack.
    stride: usize,
    waiting: Waiting,
    /// Slots without a ray.
    free: u32,
}

/// Slots by what they visit next, one bit each: nodes, packets, or something else. A slot is in one set at a time.
///
/// Sets stay in registers. With lists of slots in memory every step would write to a place that depends on what it found, and until that is
/// known Intel's processors hold the reads of the steps behind it back: rays would wait for one another.
#[derive(Clone, Copy, Default)]
struct Waiting {
    nodes: u32,
    packets: u32,
    others: u32,
}

impl Waiting {
    /// Adds a slot whose next child is `child`, which is fetched; see [`Child::kind`].
    #[inline(always)]
    fn add(&mut self, ahead: Ahead, slot: usize, child: Child) {
        ahead.fetch(child);
        let kind = child.0 >> 30;
        self.nodes |= u32::from(kind < 2) << slot;
        self.packets |= u32::from(kind == 2) << slot;
        self.others |= u32::from(kind == 3) << slot;
    }
}

/// Takes the first slot out of a set that is not empty.
#[inline(always)]
fn take(set: &mut u32) -> usize {
    let slot = set.trailing_zeros() as usize % SLOTS;
    *set &= *set - 1;
    slot
}

impl Default for Flight {
    fn default() -> Self {
        let query = Query::new(Vec3::ZERO, Vec3::Z);
        let block = RayBlock::new(&query.shear, 0.0);
        let slot = Slot { block, query, best: Hit::NONE, current: Child::EMPTY, begin: 0, end: 0, ray: 0 };
        Self {
            slots: Box::new([slot; SLOTS]),
            stacks: Vec::new(),
            stride: 0,
            waiting: Waiting::default(),
            free: u32::MAX,
        }
    }
}

impl Flight {
    /// Makes room for rays through `tree`.
    pub fn prepare(&mut self, tree: &Hierarchy) {
        // The first entry, and the room that steps write to beyond the entries they make.
        let least = tree.stack() + 1 + WIDTH;
        // An odd number of cache lines: the beginnings of stacks fall into different sets.
        let stride = (least.div_ceil(8) | 1) * 8;
        if self.stride < stride {
            self.stride = stride;
            self.stacks = vec![0; SLOTS * stride];
            // Below all entries lies one of no child, at distance 0, which nothing rules out.
            for (slot, begin) in self.slots.iter_mut().zip((0..).step_by(stride)) {
                self.stacks[begin] = u64::from(Child::EMPTY.0);
                slot.begin = begin as u32;
            }
        }
    }

    /// Number of rays in flight.
    #[inline(always)]
    pub fn len(&self) -> usize {
        SLOTS - self.free.count_ones() as usize
    }

    /// Lets a ray start at the root, with what it knows of its best hit. There is a free slot.
    #[inline(always)]
    pub fn start(&mut self, tree: &Hierarchy, ray: u32, query: &Query, best: Hit) {
        self.adopt(tree, ray, query, best, [u64::from(tree.root.0)].into_iter());
    }

    /// Lets a ray go on with stack entries, the last first. There is a free slot.
    #[inline(always)]
    pub fn adopt(&mut self, tree: &Hierarchy, ray: u32, query: &Query, best: Hit, entries: impl Iterator<Item = u64>) {
        if self.free == 0 {
            return;
        }
        let slot = take(&mut self.free);
        let begin = self.slots[slot].begin;
        let mut end = begin as usize;
        for entry in entries {
            end += 1;
            self.stacks[end] = entry;
        }
        let (block, current) = (RayBlock::new(&query.shear, best.distance), Child(self.stacks[end] as u32));
        self.slots[slot] = Slot { block, query: *query, best, current, begin, end: end as u32, ray };
        self.waiting.add(Ahead::of(tree), slot, current);
    }

    /// Takes every ray a step, and calls `answer` with the number and best hit of each that is done.
    #[inline(always)]
    pub fn round<T: Wide, G: Goal>(
        &mut self,
        tests: T,
        goal: G,
        tree: &Hierarchy,
        others: &impl Others,
        answer: &mut impl FnMut(u32, &Hit),
    ) {
        let ahead = Ahead::of(tree);
        let Waiting { mut nodes, packets, others: mut rest } = std::mem::take(&mut self.waiting);
        let mut next = Waiting { packets, ..Waiting::default() };
        while nodes != 0 {
            let slot = take(&mut nodes);
            let child = self.node(tests, goal, tree, slot);
            next.add(ahead, slot, child);
        }
        self.packets(tests, goal, tree, ahead, &mut next);
        rest |= std::mem::take(&mut next.others);
        while rest != 0 {
            let slot = take(&mut rest);
            let Slot { current, ray, best, .. } = &self.slots[slot];
            match current.kind() {
                Kind::Other(index) if *current != Child::EMPTY => {
                    let child = self.other(tests, goal, others, slot, index);
                    next.add(ahead, slot, child);
                }
                _ => {
                    answer(*ray, best);
                    self.free |= 1 << slot;
                }
            }
        }
        self.waiting = next;
    }

    /// Takes the ray of a slot to the children of a node, and returns what it visits next.
    #[inline(always)]
    fn node<T: Wide, G: Goal>(&mut self, tests: T, goal: G, tree: &Hierarchy, slot: usize) -> Child {
        let state = &mut self.slots[slot];
        let node = &tree.nodes[state.current.0 as usize];
        // The top of the stack, and the room above.
        let top = state.end as usize - 1;
        let Some(window) = self.stacks[top..].first_chunk_mut::<{ 1 + WIDTH }>() else {
            unreachable!("a stack has room")
        };
        let [_, room @ ..] = window;
        let count = goal.stack(tests, node, &state.query.slabs, state.best.distance, room);
        let child = Child(window[count] as u32);
        state.current = child;
        state.end = (top + count) as u32;
        child
    }

    /// Tests the packets of `next` in groups; what is left waits for the next round, unless no ray is at a node.
    #[inline(always)]
    fn packets<T: Wide, G: Goal>(&mut self, tests: T, goal: G, tree: &Hierarchy, ahead: Ahead, next: &mut Waiting) {
        let mut waiting = std::mem::take(&mut next.packets);
        if T::GROUPS {
            let mut found = Found::NOTHING;
            while waiting.count_ones() as usize >= GROUP || waiting != 0 && next.nodes == 0 {
                let number = GROUP.min(waiting.count_ones() as usize);
                let mut slots = [0; GROUP];
                for i in 0..GROUP {
                    slots[i] = if i < number { take(&mut waiting) } else { slots[i - 1] };
                }
                self.group(tests, goal, tree, slots, number, &mut found);
                for &slot in &slots[..number] {
                    let child = self.pop(tests, goal, slot, false);
                    next.add(ahead, slot, child);
                }
            }
            next.packets |= waiting;
        } else {
            while waiting != 0 {
                let slot = take(&mut waiting);
                let state = &mut self.slots[slot];
                let packet = &tree.packets[packet_of(state.current)];
                let nearer = goal.packet(tests, packet, &state.query, &mut state.best);
                let child = self.pop(tests, goal, slot, nearer);
                next.add(ahead, slot, child);
            }
        }
    }

    /// Tests the packets of `slots`, of which the first `number` count.
    #[inline(always)]
    fn group<T: Wide, G: Goal>(
        &mut self,
        tests: T,
        goal: G,
        tree: &Hierarchy,
        at: [usize; GROUP],
        number: usize,
        found: &mut Found,
    ) {
        let packets = at.map(|at| &tree.packets[packet_of(self.slots[at].current)]);
        let rays = at.map(|at| &self.slots[at].block);
        if G::NEAREST {
            tests.test_each::<true>(packets, rays, found);
        } else {
            tests.test_each::<false>(packets, rays, found);
        }
        let mut met = (found.mask | found.on_edge) & ((1 << (LANES * number)) - 1);
        while met != 0 {
            let i = met.trailing_zeros() as usize / LANES % GROUP;
            met &= !(0xF << (LANES * i));
            let state = &mut self.slots[at[i]];
            if goal.take(found, i, packets[i], || state.query.shear, &mut state.best) {
                state.block.values[RayBlock::T_MAX] = state.best.distance;
                let stack = &mut self.stacks[state.begin as usize..];
                state.end =
                    state.begin + goal.cut(tests, stack, (state.end - state.begin) as usize, &state.best) as u32;
            }
        }
    }

    #[cold]
    #[inline(never)]
    fn other<T: Wide, G: Goal>(&mut self, tests: T, goal: G, others: &impl Others, slot: usize, index: usize) -> Child {
        let state = &mut self.slots[slot];
        let nearer = goal.other(others, index, &state.query, &mut state.best);
        state.block.values[RayBlock::T_MAX] = state.best.distance;
        self.pop(tests, goal, slot, nearer)
    }

    /// Goes on with the top of the stack, from which a hit that is `nearer` than before removes entries, and returns it.
    #[inline(always)]
    fn pop<T: Wide, G: Goal>(&mut self, tests: T, goal: G, slot: usize, nearer: bool) -> Child {
        let state = &mut self.slots[slot];
        if nearer {
            let stack = &mut self.stacks[state.begin as usize..];
            state.end = state.begin + goal.cut(tests, stack, (state.end - state.begin) as usize, &state.best) as u32;
        }
        state.end -= 1;
        let child = Child(self.stacks[state.end as usize] as u32);
        state.current = child;
        child
    }
}

/// Index of the packet that `child` refers to.
#[inline(always)]
fn packet_of(child: Child) -> usize {
    (child.0 << 2 >> 2) as usize
}

/// Where what children refer to lies, known once for many steps: read from the hierarchy it would be read again after every store.
#[derive(Clone, Copy)]
pub struct Ahead {
    nodes: *const Node,
    packets: *const Packet,
}

impl Ahead {
    #[inline(always)]
    pub fn of(tree: &Hierarchy) -> Self {
        Self { nodes: tree.nodes.as_ptr(), packets: tree.packets.as_ptr() }
    }

    /// Fetches what `child` refers to into the cache; an address that nothing lies at does no harm.
    #[inline(always)]
    pub fn fetch(self, child: Child) {
        let index = (child.0 << 2 >> 2) as usize;
        let (base, size) = match child.kind() {
            Kind::Node(_) => (self.nodes.cast::<u8>(), size_of::<Node>()),
            _ => (self.packets.cast::<u8>(), size_of::<Packet>()),
        };
        let start = base.wrapping_add(index * size);
        for offset in [0, 64, 128, size - 1] {
            prefetch_line(start.wrapping_add(offset));
        }
    }
}
