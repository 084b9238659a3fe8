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
    queues: Queues,
    free: Vec<u8>,
}

/// Slots by what they visit next: a node, a packet, or something else. A slot is in one queue at a time.
#[derive(Default)]
struct Queues {
    slots: [[u8; SLOTS]; 3],
    lengths: [usize; 3],
}

const NODE: usize = 0;
const PACKET: usize = 1;
const OTHER: usize = 2;

impl Queues {
    /// Queues a slot whose next child is `child`; see [`Child::kind`].
    #[inline(always)]
    fn push(&mut self, slot: u8, child: Child) {
        let queue = ((child.0 >> 30).max(1) - 1) as usize;
        let length = &mut self.lengths[queue];
        self.slots[queue][*length % SLOTS] = slot;
        *length += 1;
    }

    /// Empties a queue and returns its length. Its slots stay readable as long as no more are pushed than have been read.
    #[inline(always)]
    fn take(&mut self, queue: usize) -> usize {
        std::mem::take(&mut self.lengths[queue])
    }
}

impl Default for Flight {
    fn default() -> Self {
        let query = Query::new(Vec3::ZERO, Vec3::Z);
        let block = RayBlock::new(&query.shear, 0.0);
        let slot = Slot { block, query, best: Hit::NONE, current: Child::EMPTY, begin: 0, end: 0, ray: 0 };
        let free = (0..SLOTS as u8).collect();
        Self { slots: Box::new([slot; SLOTS]), stacks: Vec::new(), stride: 0, queues: Queues::default(), free }
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
        SLOTS - self.free.len()
    }

    /// Lets a ray start at the root, with what it knows of its best hit. There is a free slot.
    #[inline(always)]
    pub fn start(&mut self, tree: &Hierarchy, ray: u32, query: &Query, best: Hit) {
        self.adopt(tree, ray, query, best, [u64::from(tree.root.0)].into_iter());
    }

    /// Lets a ray go on with stack entries, the last first. There is a free slot.
    #[inline(always)]
    pub fn adopt(&mut self, tree: &Hierarchy, ray: u32, query: &Query, best: Hit, entries: impl Iterator<Item = u64>) {
        let Some(slot) = self.free.pop() else { return };
        let at = usize::from(slot) % SLOTS;
        let begin = self.slots[at].begin;
        let mut end = begin as usize;
        for entry in entries {
            end += 1;
            self.stacks[end] = entry;
        }
        let (block, current) = (RayBlock::new(&query.shear, best.distance), Child(self.stacks[end] as u32));
        self.slots[at] = Slot { block, query: *query, best, current, begin, end: end as u32, ray };
        self.proceed(tree, slot, current);
    }

    /// Queues a slot for `child`, which is fetched.
    #[inline(always)]
    fn proceed(&mut self, tree: &Hierarchy, slot: u8, child: Child) {
        fetch(tree, child);
        self.queues.push(slot, child);
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
        for i in 0..self.queues.take(NODE) {
            let slot = self.queues.slots[NODE][i % SLOTS];
            self.node(tests, goal, tree, slot);
        }
        self.packets(tests, goal, tree);
        for i in 0..self.queues.take(OTHER) {
            let slot = self.queues.slots[OTHER][i % SLOTS];
            let Slot { current, ray, best, .. } = &self.slots[usize::from(slot) % SLOTS];
            match current.kind() {
                Kind::Other(index) if *current != Child::EMPTY => self.other(tests, goal, tree, others, slot, index),
                _ => {
                    answer(*ray, best);
                    self.free.push(slot);
                }
            }
        }
    }

    #[inline(always)]
    fn node<T: Wide, G: Goal>(&mut self, tests: T, goal: G, tree: &Hierarchy, slot: u8) {
        let at = usize::from(slot) % SLOTS;
        let state = &mut self.slots[at];
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
        self.proceed(tree, slot, child);
    }

    /// Tests the packets of the queue in groups; what is left waits for the next round, unless no ray is at a node.
    #[inline(always)]
    fn packets<T: Wide, G: Goal>(&mut self, tests: T, goal: G, tree: &Hierarchy) {
        let count = self.queues.take(PACKET);
        let mut from = 0;
        if T::GROUPS {
            let mut found = Found::NOTHING;
            while from + GROUP <= count || from < count && self.queues.lengths[NODE] == 0 {
                let number = GROUP.min(count - from);
                let slots = std::array::from_fn(|i| self.queues.slots[PACKET][(from + i.min(number - 1)) % SLOTS]);
                self.group(tests, goal, tree, slots, number, &mut found);
                from += number;
            }
            for i in from..count {
                let slot = self.queues.slots[PACKET][i % SLOTS];
                self.queues.push(slot, Child::packet(0));
            }
        } else {
            for i in 0..count {
                let slot = self.queues.slots[PACKET][i % SLOTS];
                let state = &mut self.slots[usize::from(slot) % SLOTS];
                let packet = &tree.packets[packet_of(state.current)];
                let nearer = goal.packet(tests, packet, &state.query, &mut state.best);
                self.pop(tests, goal, tree, slot, nearer);
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
        slots: [u8; GROUP],
        number: usize,
        found: &mut Found,
    ) {
        let at = slots.map(|slot| usize::from(slot) % SLOTS);
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
        for &slot in &slots[..number] {
            self.pop(tests, goal, tree, slot, false);
        }
    }

    #[cold]
    #[inline(never)]
    fn other<T: Wide, G: Goal>(
        &mut self,
        tests: T,
        goal: G,
        tree: &Hierarchy,
        others: &impl Others,
        slot: u8,
        index: usize,
    ) {
        let state = &mut self.slots[usize::from(slot) % SLOTS];
        let nearer = goal.other(others, index, &state.query, &mut state.best);
        state.block.values[RayBlock::T_MAX] = state.best.distance;
        self.pop(tests, goal, tree, slot, nearer);
    }

    /// Goes on with the top of the stack, from which a hit that is `nearer` than before removes entries.
    #[inline(always)]
    fn pop<T: Wide, G: Goal>(&mut self, tests: T, goal: G, tree: &Hierarchy, slot: u8, nearer: bool) {
        let at = usize::from(slot) % SLOTS;
        let state = &mut self.slots[at];
        if nearer {
            let stack = &mut self.stacks[state.begin as usize..];
            state.end = state.begin + goal.cut(tests, stack, (state.end - state.begin) as usize, &state.best) as u32;
        }
        state.end -= 1;
        let child = Child(self.stacks[state.end as usize] as u32);
        state.current = child;
        self.proceed(tree, slot, child);
    }
}

/// Index of the packet that `child` refers to.
#[inline(always)]
fn packet_of(child: Child) -> usize {
    (child.0 << 2 >> 2) as usize
}

/// Fetches what `child` refers to into the cache; an address that nothing lies at does no harm.
#[inline(always)]
pub fn fetch(tree: &Hierarchy, child: Child) {
    let index = (child.0 << 2 >> 2) as usize;
    let (base, size) = match child.kind() {
        Kind::Node(_) => (tree.nodes.as_ptr().cast::<u8>(), size_of::<Node>()),
        _ => (tree.packets.as_ptr().cast::<u8>(), size_of::<Packet>()),
    };
    let start = base.wrapping_add(index * size);
    for offset in [0, 64, 128, size - 1] {
        prefetch_line(start.wrapping_add(offset));
    }
}
