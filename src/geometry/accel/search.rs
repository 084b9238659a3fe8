//! Occlusion queries that record hits and costs below each child, from which [`super::order`] learns.
//!
//! A node's children are tried in random order, so that each is tried first now and then, and what is found there does not
//! depend on what the others would have hidden from it.

use super::node::{Child, Kind, WIDTH};
use super::query::Query;
use super::traverse::{Hierarchy, Kernel, Portable, Tests};
use super::{Accel, Primitive, to_local};
use crate::base::random::Random;
use crate::geometry::Ray;

/// Costs in halves of that of a packet: a node costs three, as in [`super::cut`].
const NODE_COST: u32 = 3;
const LEAF_COST: u32 = 2;

/// Visits at which a query ends: a ray past very many triangles in one place would visit all of them.
const MOST_VISITS: usize = 1 << 12;

/// Seed that makes the choice of children differ from other random numbers.
const SEED: u64 = 0x0CC1_0DE5;

/// A visit to a child of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Visit {
    /// Number of the hierarchy: 0 for that of the scene, then those of instanced meshes.
    pub tree: u32,
    /// Index of the node.
    pub node: u32,
    /// Index of the child in its node.
    pub lane: u8,
    /// Whether the visit found an occluder.
    pub found: bool,
    /// Cost of the visit, in halves of that of a packet.
    pub cost: u32,
}

/// Runs occlusion queries and records their visits.
pub struct Search<'a> {
    accel: &'a Accel,
    random: Random,
    /// Nodes on the path from the root, through both levels of hierarchies.
    way: Vec<Waiting>,
    /// Cost of the query so far.
    cost: u32,
    visits: Vec<Visit>,
    /// Number of visits at which the query ends; nodes on the path add theirs.
    end: usize,
}

/// A node on the path from the root, whose child `visit.lane` is being searched.
struct Waiting {
    visit: Visit,
    /// The children still to be tried, one bit each.
    mask: u32,
    /// Cost of the query before that child.
    before: u32,
}

impl<'a> Search<'a> {
    /// A search over `accel`; `block` makes its random numbers differ from those of other searches.
    pub fn new(accel: &'a Accel, block: u64) -> Self {
        Self { accel, random: Random::new(SEED, block, 0), way: Vec::new(), cost: 0, visits: Vec::new(), end: 0 }
    }

    /// Runs the queries `samples`, each a ray and its maximum distance, and returns their visits: all of each, or
    /// [`MOST_VISITS`].
    pub fn run(mut self, samples: &[(Ray, f32)]) -> Vec<Visit> {
        for (ray, t_max) in samples {
            self.cost = 0;
            self.end = self.visits.len() + MOST_VISITS;
            Query::with(ray, |query| match self.accel.hierarchy.kernel {
                Kernel::Portable => self.search(Portable, 0, query, *t_max),
                #[cfg(target_arch = "x86_64")]
                Kernel::Avx2(tests) => self.search(tests, 0, query, *t_max),
                #[cfg(target_arch = "x86_64")]
                Kernel::Avx512(tests) => self.search(tests.avx2(), 0, query, *t_max),
            });
        }
        self.visits
    }

    /// Whether there is an occluder in the hierarchy `number`.
    fn search<T: Tests>(&mut self, tests: T, number: u32, query: &Query, t_max: f32) -> bool {
        let accel = self.accel;
        let tree = number.checked_sub(1).map_or(&accel.hierarchy, |mesh| &accel.others.meshes[mesh as usize]);
        let begin = self.way.len();
        let mut current = tree.root;
        let mut distances = [0.0; WIDTH];
        loop {
            if let Kind::Node(node) = current.kind() {
                self.cost += NODE_COST;
                let mask = tests.boxes(&tree.nodes[node], &query.slabs, t_max, &mut distances);
                let visit = Visit { tree: number, node: node as u32, lane: 0, found: false, cost: 0 };
                self.way.push(Waiting { visit, mask, before: 0 });
            } else {
                let found = self.leaf(tests, tree, current, query, t_max);
                self.end_child(begin, found);
                if found {
                    return true;
                }
            }
            if self.visits.len() >= self.end {
                self.way.truncate(begin);
                return false;
            }
            let Some(child) = self.next_child(tree, begin) else { return false };
            current = child;
        }
    }

    fn leaf<T: Tests>(&mut self, tests: T, tree: &Hierarchy, leaf: Child, query: &Query, t_max: f32) -> bool {
        self.cost += LEAF_COST;
        match leaf.kind() {
            Kind::Packet(packet) => tests.occluded(&tree.packets[packet], &query.shear, t_max),
            Kind::Other(other) => match self.accel.others.primitives.get(other) {
                Some(Primitive::Sphere { sphere, .. }) => {
                    sphere.intersect(query.origin, query.direction, t_max).is_some()
                }
                Some(Primitive::Instance { mesh, to_mesh, .. }) => {
                    let ray = to_local(to_mesh, query);
                    Query::with(&ray, |local| self.search(tests, mesh + 1, local, t_max)).unwrap_or(false)
                }
                None => false,
            },
            Kind::Node(_) => false,
        }
    }

    /// Records the visit to a child that has been searched, and where an occluder was `found`, to all children that contain it.
    fn end_child(&mut self, begin: usize, found: bool) {
        let all = if found { begin } else { begin.max(self.way.len().saturating_sub(1)) };
        for Waiting { visit, before, .. } in &self.way[all..] {
            self.visits.push(Visit { found, cost: self.cost - before, ..*visit });
        }
        if found {
            self.way.truncate(begin);
        }
    }

    /// The next child to try, of the deepest node on the path that has one left.
    fn next_child(&mut self, tree: &Hierarchy, begin: usize) -> Option<Child> {
        while self.way.len() > begin {
            let Waiting { visit, mask, before } = self.way.last_mut()?;
            if *mask != 0 {
                let mut lanes = *mask;
                for _ in 0..self.random.below(mask.count_ones()) {
                    lanes &= lanes - 1;
                }
                visit.lane = lanes.trailing_zeros() as u8;
                *mask &= !(1 << visit.lane);
                *before = self.cost;
                return Some(tree.nodes[visit.node as usize].children[usize::from(visit.lane)]);
            }
            self.way.pop();
            self.end_child(begin, false);
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{Affine3A, Vec3};

    use super::super::tests::in_one_place;
    use super::*;
    use crate::geometry::Shape;

    /// A ray past many triangles in one place, all of which it has to be tested against, leaves no more visits than it
    /// may, also where they are those of instances.
    #[test]
    #[cfg_attr(miri, ignore = "of the few triangles that Miri has time for a query visits all")]
    fn visits_are_bounded() {
        let mesh = Arc::new(in_one_place(5 * MOST_VISITS));
        let shape = |y: f32| Shape::mesh(mesh.clone(), Affine3A::from_translation(y * Vec3::Y), false);
        for shapes in [vec![shape(0.0)], vec![shape(0.0), shape(1e-3)]] {
            let accel = Accel::new(&shapes);
            let past = Ray { origin: Vec3::new(0.9, 0.9, 1.0), direction: Vec3::NEG_Z };
            let visits = Search::new(&accel, 0).run(&[(past, f32::INFINITY); 3]);
            assert!((3 * MOST_VISITS..3 * (MOST_VISITS + 100)).contains(&visits.len()), "{} visits", visits.len());
            assert!(visits.iter().all(|visit| !visit.found));
        }
    }
}
