//! The order in which an occlusion query tries the children of a node, learned from sample queries.
//!
//! An occlusion query may stop at any hit, so children are best tried in the order of hits found below them over the cost of
//! looking there. Both are counted beforehand (Ogaki, Derouet-Jourdan 2016). No answer depends on the order, and neither
//! does the traversal of a nearest-hit query, which goes by distance.

use rayon::prelude::*;

use super::Accel;
use super::node::{Child, Node, WIDTH};
use super::search::{Search, Visit};
use crate::geometry::Ray;

/// Sample rays per unit of parallel work.
const BLOCK: usize = 128;

/// Least number of nodes for which an order is learned: fewer are soon searched in any.
const WORTHWHILE: usize = 16;

impl Accel {
    /// Whether [`Accel::learn_order`] can gain anything.
    pub fn is_worth_ordering(&self) -> bool {
        let instanced: usize = self.others.meshes.iter().map(|mesh| mesh.nodes.len()).sum();
        self.hierarchy.nodes.len() + instanced >= WORTHWHILE
    }

    /// Reorders children so that [`Accel::occluded`] first tries those below which the queries `samples`, each a ray and its
    /// maximum distance, find most hits for their cost. Answers stay the same. The order is the same for any number of threads.
    pub fn learn_order(&mut self, samples: &[(Ray, f32)]) {
        let blocks = samples.par_chunks(BLOCK).enumerate();
        let visits: Vec<Vec<Visit>> =
            blocks.map(|(block, samples)| Search::new(self, block as u64).run(samples)).collect();
        let trees = std::iter::once(&mut self.hierarchy).chain(&mut self.others.meshes);
        for (tree, number) in trees.zip(0..) {
            reorder(&mut tree.nodes, visits.iter().flatten().filter(|visit| visit.tree == number));
        }
    }
}

/// Number of hits found below each child of a node, and the cost of finding them.
#[derive(Debug, Clone, Copy, Default)]
struct Tally {
    found: [u32; WIDTH],
    cost: [u32; WIDTH],
}

/// Sorts the children of the visited nodes by the hits per cost of their visits.
fn reorder<'a>(nodes: &mut [Node], visits: impl Iterator<Item = &'a Visit>) {
    // Few nodes of a large scene are visited.
    let mut tally_of: Vec<u32> = Vec::new();
    let mut tallies: Vec<(usize, Tally)> = Vec::new();
    for &Visit { node, lane, found, cost, .. } in visits {
        tally_of.resize(nodes.len(), 0);
        let number = &mut tally_of[node as usize];
        if *number == 0 {
            tallies.push((node as usize, Tally::default()));
            *number = tallies.len() as u32;
        }
        let (_, tally) = &mut tallies[*number as usize - 1];
        tally.found[usize::from(lane)] += u32::from(found);
        tally.cost[usize::from(lane)] += cost;
    }
    for (node, tally) in tallies {
        nodes[node] = tally.order(&nodes[node]);
    }
}

impl Tally {
    /// The node with its children sorted by rising hits per cost: a query stacks them in this order and tries the last one first.
    fn order(&self, node: &Node) -> Node {
        let worth = |&lane: &usize| match node.children[lane] {
            Child::EMPTY => f64::INFINITY,
            _ => f64::from(self.found[lane]) / f64::from(self.cost[lane].max(1)),
        };
        let mut lanes: [usize; WIDTH] = std::array::from_fn(|lane| lane);
        lanes.sort_by(|a, b| worth(a).total_cmp(&worth(b)));
        node.permuted(lanes)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{Affine3A, Quat, Vec3};
    use rayon::ThreadPoolBuilder;

    use super::super::node::Kind;
    use super::super::portable;
    use super::super::query::Query;
    use super::super::tests::{closed_sphere, fewer, kernels, point, random_ray, soup};
    use super::*;
    use crate::base::random::Random;
    use crate::geometry::Shape;
    use crate::geometry::mesh::Mesh;

    fn in_world(mesh: Mesh) -> Shape {
        Shape::mesh(Arc::new(mesh), Affine3A::IDENTITY, false)
    }

    /// Loose triangles, spheres, and a mesh that is placed three times.
    fn shapes() -> Vec<Shape> {
        let mut random = Random::new(31, 0, 0);
        let shared = Arc::new(soup(&mut random, fewer(2000), 0.05));
        let placed = |x: f32| Affine3A::from_rotation_translation(Quat::from_rotation_y(x), Vec3::splat(0.3 * x));
        let mut shapes: Vec<Shape> = (0..3).map(|i| Shape::mesh(shared.clone(), placed(i as f32), false)).collect();
        shapes.push(in_world(soup(&mut random, fewer(5000), 0.05)));
        shapes.push(in_world(closed_sphere(40, 40, 0.2, Vec3::splat(0.5))));
        shapes.extend((0..40).map(|_| Shape::sphere(point(&mut random), 0.03, false)));
        shapes
    }

    fn samples(seed: u64, count: usize) -> Vec<(Ray, f32)> {
        let mut random = Random::new(seed, 0, 0);
        (0..fewer(count)).map(|i| (random_ray(&mut random, i), random.range(0.5, 3.0))).collect()
    }

    /// docs/stability.md, S7: nearest and any hits are the same to the last bit for every learned order.
    #[test]
    fn s07_no_answer_depends_on_the_order() {
        let shapes = shapes();
        for kernel in kernels() {
            let before = Accel::with_kernel(&shapes, kernel);
            let mut after = Accel::with_kernel(&shapes, kernel);
            after.learn_order(&samples(1, 5000));
            assert!(before.hierarchy.nodes != after.hierarchy.nodes || cfg!(miri));
            assert!(
                before.others.meshes[0].nodes != after.others.meshes[0].nodes || cfg!(miri),
                "the mesh that is placed"
            );
            for (ray, t_max) in samples(2, 100_000) {
                let hit = before.intersect(&ray);
                assert_eq!(after.intersect(&ray), hit, "{ray:?}");
                assert_eq!(after.occluded(&ray, t_max), hit.is_some_and(|hit| hit.distance < t_max), "{ray:?}");
            }
        }
    }

    #[test]
    fn an_order_depends_on_its_samples_alone() {
        let (shapes, samples) = (shapes(), samples(3, 3000));
        let learned = |kernel, threads| {
            let mut accel = Accel::with_kernel(&shapes, kernel);
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| accel.learn_order(&samples));
            accel
        };
        let first = learned(kernels()[0], 1);
        for kernel in kernels() {
            for threads in [1, 3] {
                let other = learned(kernel, threads);
                assert!(first.hierarchy.nodes == other.hierarchy.nodes, "{kernel:?}, {threads} threads");
                assert!(first.others.meshes[0].nodes == other.others.meshes[0].nodes, "{kernel:?}, {threads} threads");
            }
        }
    }

    /// Number of nodes and packets that an occlusion query visits.
    fn steps(accel: &Accel, (ray, t_max): &(Ray, f32)) -> usize {
        let tree = &accel.hierarchy;
        let search = |query: &Query| {
            let (mut waiting, mut steps) = (vec![tree.root], 0);
            while let Some(child) = waiting.pop() {
                steps += 1;
                match child.kind() {
                    Kind::Node(index) => {
                        let node = &tree.nodes[index];
                        let mask = portable::boxes(node, &query.slabs, *t_max, &mut [0.0; WIDTH]);
                        waiting.extend((0..WIDTH).filter(|lane| mask >> lane & 1 == 1).map(|lane| node.children[lane]));
                    }
                    Kind::Packet(index) if portable::occluded(&tree.packets[index], &query.shear, *t_max) => break,
                    _ => {}
                }
            }
            steps
        };
        Query::with(ray, search).unwrap_or(0)
    }

    /// For rays through scattered small triangles that all hit a wall, the wall, which takes few steps, is tried first.
    #[test]
    #[cfg_attr(miri, ignore = "of the few rays and triangles that Miri has time for nothing is learned")]
    fn what_hides_most_is_tried_first() {
        let mut random = Random::new(32, 0, 0);
        let corners = [[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]];
        let wall = Mesh {
            positions: corners.map(|[y, z]| Vec3::new(1.2, y, z)).to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        };
        let shapes = [in_world(soup(&mut random, 20_000, 0.004)), in_world(wall)];
        let rays = |seed| {
            let mut random = Random::new(seed, 0, 0);
            let mut ray = || Ray { origin: Vec3::new(-1.0, random.next_f32(), random.next_f32()), direction: Vec3::X };
            (0..2000).map(|_| (ray(), f32::INFINITY)).collect::<Vec<_>>()
        };
        let mut accel = Accel::new(&shapes);
        let all = |accel: &Accel| rays(5).iter().map(|ray| steps(accel, ray)).sum::<usize>();
        let before = all(&accel);
        accel.learn_order(&rays(4));
        let after = all(&accel);
        assert!(after < 2000 * 8 && after < before / 2, "{after} steps, {before} before");
    }
}
