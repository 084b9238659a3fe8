//! The traversal of the hierarchy, written once for both kinds of tests.

use super::Hit;
use super::node::{Child, Kind, LANES, Node, Packet, WIDTH};
use super::portable;
use super::query::{Query, Slabs};
use crate::geometry::sphere::Sphere;
use crate::geometry::triangle::Shear;

#[cfg(target_arch = "x86_64")]
use super::avx2;
#[cfg(target_arch = "x86_64")]
use crate::base::processor::{Avx2, Avx512};

/// The tests that this processor can do. Chosen once, when a scene's hierarchy is built.
#[derive(Debug, Clone, Copy)]
pub enum Kernel {
    /// Plain Rust.
    Portable,
    /// Vector instructions.
    #[cfg(target_arch = "x86_64")]
    Avx2(Avx2),
    /// The same for single rays, to which longer vectors bring nothing, and longer ones for batches.
    #[cfg(target_arch = "x86_64")]
    Avx512(Avx512),
}

impl Kernel {
    /// The fastest kernel of this processor.
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if let Some(proof) = Avx512::detect() {
            return Self::Avx512(proof);
        } else if let Some(proof) = Avx2::detect() {
            return Self::Avx2(proof);
        }
        Self::Portable
    }
}

/// Token for plain Rust, which runs anywhere.
#[derive(Clone, Copy)]
pub struct Portable;

/// The intersection tests of one kernel; see [`portable`].
pub trait Tests: Copy {
    fn boxes(self, node: &Node, slabs: &Slabs, t_max: f32, distances: &mut [f32; WIDTH]) -> u32;
    fn closest(self, packet: &Packet, shear: &Shear, best: &mut Hit);
    fn occluded(self, packet: &Packet, shear: &Shear, t_max: f32) -> bool;
    fn occluders(self, packet: &Packet, shear: &Shear, t_max: f32) -> u32;
    fn prefetch<T>(self, value: *const T);
}

impl Tests for Portable {
    #[inline(always)]
    fn boxes(self, node: &Node, slabs: &Slabs, t_max: f32, distances: &mut [f32; WIDTH]) -> u32 {
        portable::boxes(node, slabs, t_max, distances)
    }

    #[inline(always)]
    fn closest(self, packet: &Packet, shear: &Shear, best: &mut Hit) {
        portable::closest(packet, shear, best);
    }

    #[inline(always)]
    fn occluded(self, packet: &Packet, shear: &Shear, t_max: f32) -> bool {
        portable::occluded(packet, shear, t_max)
    }

    #[inline(always)]
    fn occluders(self, packet: &Packet, shear: &Shear, t_max: f32) -> u32 {
        portable::occluders(packet, shear, t_max)
    }

    #[inline(always)]
    fn prefetch<T>(self, _: *const T) {}
}

#[cfg(target_arch = "x86_64")]
impl Tests for Avx2 {
    #[inline(always)]
    fn boxes(self, node: &Node, slabs: &Slabs, t_max: f32, distances: &mut [f32; WIDTH]) -> u32 {
        // SAFETY: `self` proves that the processor has the features.
        unsafe { avx2::boxes(node, slabs, t_max, distances) }
    }

    #[inline(always)]
    fn closest(self, packet: &Packet, shear: &Shear, best: &mut Hit) {
        // SAFETY: `self` proves that the processor has the features.
        unsafe { avx2::closest(packet, shear, best) }
    }

    #[inline(always)]
    fn occluded(self, packet: &Packet, shear: &Shear, t_max: f32) -> bool {
        // SAFETY: `self` proves that the processor has the features.
        unsafe { avx2::occluded(packet, shear, t_max) }
    }

    #[inline(always)]
    fn occluders(self, packet: &Packet, shear: &Shear, t_max: f32) -> u32 {
        // SAFETY: `self` proves that the processor has the features.
        unsafe { avx2::occluders(packet, shear, t_max) }
    }

    #[inline(always)]
    fn prefetch<T>(self, value: *const T) {
        // SAFETY: `self` proves that the processor has the features.
        unsafe { avx2::prefetch(value) }
    }
}

/// Access to the primitives that are not triangles.
pub trait Others {
    /// Replaces `best` by the nearest hit of primitive `index` that precedes it.
    fn closest(&self, index: usize, query: &Query, best: &mut Hit);
    /// Whether the ray meets primitive `index` before `t_max`.
    fn occluded(&self, index: usize, query: &Query, t_max: f32) -> bool;
    /// The shape of primitive `index`.
    fn shape(&self, index: usize) -> u32;
    /// Primitive `index`, if it is a sphere.
    fn sphere(&self, index: usize) -> Option<&Sphere>;
}

/// No further primitives: a mesh has triangles only.
pub struct NoOthers;

impl Others for NoOthers {
    fn closest(&self, _: usize, _: &Query, _: &mut Hit) {}

    fn occluded(&self, _: usize, _: &Query, _: f32) -> bool {
        false
    }

    fn shape(&self, _: usize) -> u32 {
        u32::MAX
    }

    fn sphere(&self, _: usize) -> Option<&Sphere> {
        None
    }
}

/// Decides at which hits an occlusion query stops.
pub trait Stop {
    /// Whether it stops at a triangle of the packet before `t_max`.
    fn at_packet<T: Tests>(&mut self, tests: T, packet: &Packet, shear: &Shear, t_max: f32) -> bool;
    /// Whether it stops at `shape`, which the ray meets.
    fn at_shape(&mut self, shape: u32) -> bool;
}

/// Stops at any hit.
pub struct Anything;

impl Stop for Anything {
    #[inline(always)]
    fn at_packet<T: Tests>(&mut self, tests: T, packet: &Packet, shear: &Shear, t_max: f32) -> bool {
        tests.occluded(packet, shear, t_max)
    }

    #[inline(always)]
    fn at_shape(&mut self, _: u32) -> bool {
        true
    }
}

/// Stops at the shapes for which the function is true.
pub struct Shapes<F>(pub F);

impl<F: FnMut(u32) -> bool> Stop for Shapes<F> {
    #[inline(always)]
    fn at_packet<T: Tests>(&mut self, tests: T, packet: &Packet, shear: &Shear, t_max: f32) -> bool {
        let mask = tests.occluders(packet, shear, t_max);
        mask != 0 && (0..LANES).any(|lane| mask >> lane & 1 == 1 && (self.0)(packet.shapes[lane]))
    }

    #[inline(always)]
    fn at_shape(&mut self, shape: u32) -> bool {
        (self.0)(shape)
    }
}

/// Nodes and packets of a hierarchy.
pub struct Hierarchy {
    pub(super) nodes: Vec<Node>,
    pub(super) packets: Vec<Packet>,
    pub(super) root: Child,
    depth: usize,
    pub(super) kernel: Kernel,
}

/// Stack size in children, for hierarchies of usual depth; deeper ones need memory from the heap.
pub(super) const USUAL_STACK: usize = 128;
/// Stack size for hierarchies of a few hundred triangles, where clearing a longer stack shows.
const SMALL_STACK: usize = 32;

impl Hierarchy {
    pub fn new(tree: super::build::Tree, kernel: Kernel) -> Self {
        let super::build::Tree { nodes, packets, root, depth } = tree;
        Self { nodes, packets, root, depth, kernel }
    }

    /// Size in memory, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.nodes.as_slice()) + size_of_val(self.packets.as_slice())
    }

    /// Most children on the stack at a time: all but one of each node on the path from the root, and one more before it is taken.
    pub(super) fn stack(&self) -> usize {
        self.depth * (WIDTH - 1) + 1
    }

    /// Replaces `best` by the nearest hit that precedes it.
    pub fn closest(&self, query: &Query, best: &mut Hit, others: &impl Others) {
        self.with_stack(0, |stack| self.closest_with(query, best, others, stack));
    }

    #[inline]
    fn closest_with(&self, query: &Query, best: &mut Hit, others: &impl Others, stack: &mut [u64]) {
        match self.kernel {
            Kernel::Portable => self.walk_closest(Portable, query, best, others, stack),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: an `Avx2` exists only where the processor has the features.
            Kernel::Avx2(tests) => unsafe { self.closest_avx2(tests, query, best, others, stack) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: as above.
            Kernel::Avx512(tests) => unsafe { self.closest_avx2(tests.avx2(), query, best, others, stack) },
        }
    }

    /// Whether the ray meets anything before `t_max` that makes the query stop.
    pub fn occluded(&self, query: &Query, t_max: f32, others: &impl Others, stop: &mut impl Stop) -> bool {
        self.with_stack(Child::EMPTY, |stack| self.occluded_with(query, t_max, others, stop, stack))
    }

    /// Calls `walk` with a stack that is deep enough, filled with `empty`: on the call stack where that is possible.
    #[inline(always)]
    fn with_stack<T: Copy, R>(&self, empty: T, walk: impl FnOnce(&mut [T]) -> R) -> R {
        let size = self.stack();
        if size <= SMALL_STACK {
            walk(&mut [empty; SMALL_STACK])
        } else if size <= USUAL_STACK {
            walk(&mut [empty; USUAL_STACK])
        } else {
            walk(&mut vec![empty; size])
        }
    }

    #[inline]
    fn occluded_with(
        &self,
        query: &Query,
        t_max: f32,
        others: &impl Others,
        stop: &mut impl Stop,
        stack: &mut [Child],
    ) -> bool {
        match self.kernel {
            Kernel::Portable => self.walk_occluded(Portable, query, t_max, others, stop, stack),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: an `Avx2` exists only where the processor has the features.
            Kernel::Avx2(tests) => unsafe { self.occluded_avx2(tests, query, t_max, others, stop, stack) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: as above.
            Kernel::Avx512(tests) => unsafe { self.occluded_avx2(tests.avx2(), query, t_max, others, stop, stack) },
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    fn closest_avx2(&self, tests: Avx2, query: &Query, best: &mut Hit, others: &impl Others, stack: &mut [u64]) {
        self.walk_closest(tests, query, best, others, stack);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    fn occluded_avx2(
        &self,
        tests: Avx2,
        query: &Query,
        t_max: f32,
        others: &impl Others,
        stop: &mut impl Stop,
        stack: &mut [Child],
    ) -> bool {
        self.walk_occluded(tests, query, t_max, others, stop, stack)
    }

    /// Prefetches the children of `mask`.
    #[inline(always)]
    fn prefetch<T: Tests>(&self, tests: T, node: &Node, mut mask: u32) {
        while mask != 0 {
            match node.children[mask.trailing_zeros() as usize % WIDTH].kind() {
                Kind::Node(index) => tests.prefetch(self.nodes.as_ptr().wrapping_add(index)),
                Kind::Packet(index) => tests.prefetch(self.packets.as_ptr().wrapping_add(index)),
                Kind::Other(_) => {}
            }
            mask &= mask - 1;
        }
    }

    /// Visits the nearest child first; the others are stacked with their distances, the nearest on top. Distances are not negative,
    /// so their bits are ordered like them.
    #[inline(always)]
    fn walk_closest<T: Tests>(&self, tests: T, query: &Query, best: &mut Hit, others: &impl Others, stack: &mut [u64]) {
        let mut waiting = 0;
        let mut current = self.root;
        let mut distances = [0.0; WIDTH];
        loop {
            match current.kind() {
                Kind::Node(index) => {
                    let node = &self.nodes[index];
                    let mask = tests.boxes(node, &query.slabs, best.distance, &mut distances);
                    if mask != 0 {
                        self.prefetch(tests, node, mask);
                        (current, waiting) = descend(node, mask, &distances, stack, waiting);
                        continue;
                    }
                }
                Kind::Packet(index) => tests.closest(&self.packets[index], &query.shear, best),
                Kind::Other(index) => others.closest(index, query, best),
            }
            loop {
                if waiting == 0 {
                    return;
                }
                waiting -= 1;
                let entry = stack[waiting];
                if f32::from_bits((entry >> 32) as u32) <= best.distance {
                    current = Child(entry as u32);
                    break;
                }
            }
        }
    }

    /// Visits the last child first, see [`super::order`].
    #[inline(always)]
    fn walk_occluded<T: Tests>(
        &self,
        tests: T,
        query: &Query,
        t_max: f32,
        others: &impl Others,
        stop: &mut impl Stop,
        stack: &mut [Child],
    ) -> bool {
        let mut waiting = 0;
        let mut current = self.root;
        let mut distances = [0.0; WIDTH];
        loop {
            let found = match current.kind() {
                Kind::Node(index) => {
                    let node = &self.nodes[index];
                    let mut mask = tests.boxes(node, &query.slabs, t_max, &mut distances);
                    self.prefetch(tests, node, mask);
                    while mask != 0 {
                        stack[waiting] = node.children[mask.trailing_zeros() as usize % WIDTH];
                        waiting += 1;
                        mask &= mask - 1;
                    }
                    false
                }
                Kind::Packet(index) => stop.at_packet(tests, &self.packets[index], &query.shear, t_max),
                Kind::Other(index) => others.occluded(index, query, t_max) && stop.at_shape(others.shape(index)),
            };
            if found {
                return true;
            }
            if waiting == 0 {
                return false;
            }
            waiting -= 1;
            current = stack[waiting];
        }
    }
}

/// The nearest child of `mask`, which is not 0, and the new length of the stack, on which the others go.
#[inline(always)]
fn descend(node: &Node, mask: u32, distances: &[f32; WIDTH], stack: &mut [u64], waiting: usize) -> (Child, usize) {
    let entry = |mask: u32| {
        let lane = mask.trailing_zeros() as usize % WIDTH;
        u64::from(distances[lane].to_bits()) << 32 | u64::from(node.children[lane].0)
    };
    let mut rest = mask & (mask - 1);
    let mut nearest = entry(mask);
    let mut end = waiting;
    while rest != 0 {
        let mut new = entry(rest);
        rest &= rest - 1;
        if new < nearest {
            std::mem::swap(&mut new, &mut nearest);
        }
        let mut at = end;
        while at > waiting && stack[at - 1] < new {
            stack[at] = stack[at - 1];
            at -= 1;
        }
        stack[at] = new;
        end += 1;
    }
    (Child(nearest as u32), end)
}
