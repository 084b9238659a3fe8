//! Batches with the vector instructions of this processor.

use super::super::query::Query;
use super::super::traverse::{Kernel, Others};
use super::super::{Accel, Hit, Met};
use super::bundle::Walk;
use super::flight::{Flight, SLOTS};
use super::sixteen::RAYS;
use super::walls::Walls;
use super::wide::{Any, Goal, Job, Nearest, Wide};
use super::{Scratch, Way};
use crate::geometry::Ray;

impl Accel {
    pub(super) fn intersect_wide(&self, rays: &[Ray], way: Way, scratch: &mut Scratch, hits: &mut [Option<Hit>]) {
        let asked = |i: usize| (rays[i], f32::MAX);
        self.run_wide(Nearest, rays.len(), asked, way, scratch, |i, hit| hits[i] = hit.found());
    }

    pub(super) fn occluded_wide(&self, rays: &[(Ray, f32)], way: Way, scratch: &mut Scratch, occluded: &mut [bool]) {
        self.run_wide(Any, rays.len(), |i| rays[i], way, scratch, |i, hit| occluded[i] = hit.found().is_some());
    }

    pub(super) fn meets_wide(
        &self,
        rays: &[(Ray, f32)],
        solid: &[bool],
        way: Way,
        scratch: &mut Scratch,
        met: &mut [Met],
    ) {
        let walls = Walls { solid };
        self.run_wide(walls, rays.len(), |i| rays[i], way, scratch, |i, hit| met[i] = Walls::met(hit));
    }

    /// Asks for `count` rays with their maximum distances and tells each one's best hit.
    fn run_wide(
        &self,
        goal: impl Goal,
        count: usize,
        asked: impl Fn(usize) -> (Ray, f32),
        way: Way,
        scratch: &mut Scratch,
        mut answer: impl FnMut(usize, &Hit),
    ) {
        let Self { hierarchy: tree, others, .. } = self;
        let answer = |ray: u32, hit: &Hit| answer(ray as usize, hit);
        match tree.kernel {
            Kernel::Portable => unreachable!("plain Rust has no batches"),
            Kernel::Avx2(tests) => {
                tests.apart(Batch { walk: Walk { tests, goal, tree, others }, count, asked, way, scratch, answer });
            }
            Kernel::Avx512(tests) => {
                tests.apart(Batch { walk: Walk { tests, goal, tree, others }, count, asked, way, scratch, answer });
            }
        }
    }
}

/// A batch of queries. It owns all that it can: what lies behind references would be read again after each answer.
struct Batch<'a, T, G, O, Q, A> {
    walk: Walk<'a, T, G, O>,
    count: usize,
    asked: Q,
    way: Way,
    scratch: &'a mut Scratch,
    answer: A,
}

impl<T, G, O, Q, A> Job for Batch<'_, T, G, O, Q, A>
where
    T: Wide,
    G: Goal,
    O: Others,
    Q: Fn(usize) -> (Ray, f32),
    A: FnMut(u32, &Hit),
{
    #[inline(always)]
    fn run(self) {
        let Self { walk, count, asked, way, scratch, mut answer } = self;
        let Scratch { flight, bundle, classes, sorted } = scratch;
        flight.prepare(walk.tree);
        sorted.clear();
        let mut next = 0;
        if way == Way::Bundles {
            for end in sort(count, |i| asked(i).0, classes, sorted) {
                for group in sorted[next..end].chunks(RAYS) {
                    for &number in group {
                        let (ray, t_max) = asked(number as usize);
                        bundle.add(number, &ray, t_max);
                    }
                    bundle.walk(&walk, flight, &mut answer);
                }
                next = end;
            }
        }
        // All rays where none are sorted, and those of no class where all are.
        let number = |i: usize| sorted.get(i).map_or(i as u32, |number| *number);
        fly(&walk, (next..count).map(number), asked, flight, answer);
    }
}

/// Answers rays of a batch as single ones in flight, and those that are in flight already.
#[inline(always)]
fn fly<T: Wide, G: Goal, O: Others>(
    walk: &Walk<T, G, O>,
    mut numbers: impl Iterator<Item = u32>,
    asked: impl Fn(usize) -> (Ray, f32),
    flight: &mut Flight,
    mut answer: impl FnMut(u32, &Hit),
) {
    let Walk { tests, goal, tree, others } = *walk;
    loop {
        while flight.len() < SLOTS
            && let Some(number) = numbers.next()
        {
            let (ray, t_max) = asked(number as usize);
            let unknown = Hit { distance: t_max, ..Hit::NONE };
            if Query::with(&ray, |query| flight.start(tree, number, query, unknown)).is_none() {
                answer(number, &unknown);
            }
        }
        if flight.len() == 0 {
            return;
        }
        flight.round(tests, goal, tree, others, &mut answer);
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
