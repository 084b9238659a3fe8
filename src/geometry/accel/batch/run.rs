//! Batches with the vector instructions of this processor.

use super::super::query::Query;
use super::super::traverse::{Hierarchy, Kernel, Others};
use super::super::{Accel, Hit};
use super::bundle::{Walk, land};
use super::flight::{Flight, SLOTS};
use super::lanes::RAYS;
use super::wide::{Any, Goal, Nearest, Wide};
use super::{Scratch, Way};
use crate::base::processor::{Avx2, Avx512};
use crate::geometry::Ray;

impl Accel {
    pub(super) fn intersect_wide(&self, rays: &[Ray], way: Way, scratch: &mut Scratch, hits: &mut [Option<Hit>]) {
        let batch = Batch { tree: &self.hierarchy, others: &self.others, goal: Nearest };
        let asked = |i: usize| (rays[i], f32::MAX);
        batch.run(rays.len(), asked, way, scratch, |i, hit| hits[i] = hit.found());
    }

    pub(super) fn occluded_wide(&self, rays: &[(Ray, f32)], way: Way, scratch: &mut Scratch, occluded: &mut [bool]) {
        let batch = Batch { tree: &self.hierarchy, others: &self.others, goal: Any };
        batch.run(rays.len(), |i| rays[i], way, scratch, |i, hit| occluded[i] = hit.found().is_some());
    }
}

/// A batch of queries with one goal.
#[derive(Clone, Copy)]
struct Batch<'a, G, O> {
    tree: &'a Hierarchy,
    others: &'a O,
    goal: G,
}

impl<G: Goal, O: Others> Batch<'_, G, O> {
    /// Asks for `count` rays with their maximum distances and tells each one's best hit.
    fn run(
        &self,
        count: usize,
        asked: impl Fn(usize) -> (Ray, f32),
        way: Way,
        scratch: &mut Scratch,
        answer: impl FnMut(usize, &Hit),
    ) {
        match self.tree.kernel {
            Kernel::Portable => unreachable!("plain Rust has no batches"),
            // SAFETY: an `Avx2` exists only where the processor has the features.
            Kernel::Avx2(tests) => unsafe { self.fly_avx2(tests, count, asked, &mut scratch.flight, answer) },
            // SAFETY: an `Avx512` exists only where the processor has the features.
            Kernel::Avx512(tests) if way == Way::Bundles => unsafe {
                self.walk(tests, count, asked, scratch, answer);
            },
            // SAFETY: as above.
            Kernel::Avx512(tests) => unsafe { self.fly_avx512(tests, count, asked, &mut scratch.flight, answer) },
        }
    }

    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    fn fly_avx2(
        &self,
        tests: Avx2,
        count: usize,
        asked: impl Fn(usize) -> (Ray, f32),
        flight: &mut Flight,
        answer: impl FnMut(usize, &Hit),
    ) {
        self.fly(tests, count, asked, flight, answer);
    }

    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt,avx512f,avx512vl,avx512bw,avx512dq")]
    fn fly_avx512(
        &self,
        tests: Avx512,
        count: usize,
        asked: impl Fn(usize) -> (Ray, f32),
        flight: &mut Flight,
        answer: impl FnMut(usize, &Hit),
    ) {
        self.fly(tests, count, asked, flight, answer);
    }

    /// All rays as single ones in flight.
    #[inline(always)]
    fn fly<T: Wide>(
        &self,
        tests: T,
        count: usize,
        asked: impl Fn(usize) -> (Ray, f32),
        flight: &mut Flight,
        mut answer: impl FnMut(usize, &Hit),
    ) {
        let Self { tree, others, goal } = *self;
        flight.prepare(tree);
        let mut answer = |ray: u32, hit: &Hit| answer(ray as usize, hit);
        let mut next = 0;
        loop {
            while next < count && flight.len() < SLOTS {
                let (ray, t_max) = asked(next);
                let unknown = Hit { distance: t_max, ..Hit::NONE };
                let start = |query: &Query| flight.start(tests, tree, next as u32, query, unknown);
                if Query::with(&ray, start).is_none() {
                    answer(next as u32, &unknown);
                }
                next += 1;
            }
            if flight.len() == 0 {
                return;
            }
            flight.round(tests, goal, tree, others, &mut answer);
        }
    }

    /// Rays in bundles of one class, and those that are left over as single ones.
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt,avx512f,avx512vl,avx512bw,avx512dq")]
    fn walk(
        &self,
        tests: Avx512,
        count: usize,
        asked: impl Fn(usize) -> (Ray, f32),
        scratch: &mut Scratch,
        mut answer: impl FnMut(usize, &Hit),
    ) {
        let Self { tree, others, goal } = *self;
        let walk = Walk { tests, goal, tree, others };
        let Scratch { flight, bundle, classes, sorted } = scratch;
        let mut answer = |ray: u32, hit: &Hit| answer(ray as usize, hit);
        flight.prepare(tree);
        let ends = sort(count, |i| asked(i).0, classes, sorted);
        let mut from = 0;
        for end in ends {
            for group in sorted[from..end].chunks(RAYS) {
                for &number in group {
                    let (ray, t_max) = asked(number as usize);
                    bundle.add(number, &ray, t_max);
                }
                bundle.walk(&walk, flight, &mut answer);
            }
            from = end;
        }
        for &number in &sorted[from..] {
            let (ray, t_max) = asked(number as usize);
            let unknown = Hit { distance: t_max, ..Hit::NONE };
            land(&walk, flight, SLOTS - 1, &mut answer);
            if Query::with(&ray, |query| flight.start(tests, tree, number, query, unknown)).is_none() {
                answer(number, &unknown);
            }
        }
        land(&walk, flight, 0, &mut answer);
    }
}

/// Classes of rays that may share a bundle: by octant and main axis.
const CLASSES: usize = 24;

/// Sorts the numbers of rays by class, those of a class in their order. Returns where each class ends; behind them are rays of none.
fn sort(count: usize, ray: impl Fn(usize) -> Ray, classes: &mut Vec<u8>, sorted: &mut Vec<u32>) -> [usize; CLASSES] {
    let mut places = [0; CLASSES + 2];
    classes.clear();
    classes.extend((0..count).map(|i| {
        let class = class(&ray(i));
        places[class + 1] += 1;
        class as u8
    }));
    for class in 0..=CLASSES {
        places[class + 1] += places[class];
    }
    sorted.resize(count, 0);
    for (number, class) in (0..).zip(&*classes) {
        let place = &mut places[usize::from(*class)];
        sorted[*place] = number;
        *place += 1;
    }
    // Each class's place has moved on to where it ends.
    std::array::from_fn(|class| places[class])
}

/// The class of a ray, [`CLASSES`] where it has none.
#[inline(always)]
fn class(ray: &Ray) -> usize {
    let Ray { origin, direction } = *ray;
    let size = direction.abs();
    // Bounds of a bundle need reciprocals that are neither infinite nor zero. No comparison is true of what is not a number.
    let has_bounds = size.min_element() > 1e-30 && size.max_element() < 1e30 && origin.is_finite();
    let octant = (direction.is_negative_bitmask() & 7) as usize;
    if has_bounds { octant * 3 + size.max_position() } else { CLASSES }
}
