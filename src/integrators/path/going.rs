//! Which paths go on from the vertices at which they were shaded, and what they take along: roulette, for sixteen at once, or for one.

use std::marker::PhantomData;

use glam::Vec3;

use super::shaded::Shaded;
use super::{Arrival, PathState};
use crate::integrators::kept::{All, Column, First, Keep, Rows, row};
use crate::integrators::mixture::Mixed;
use crate::integrators::{ROULETTE_MOST, Roulette};
use crate::math::lanes::{self, Kernel, LANES, Mask, Real, V3, Wide};
use crate::scene::effects::Effects;

/// What becomes of paths, lane by lane.
#[derive(Default)]
pub(super) struct Gone {
    /// Where the direction that was drawn may bring something, where a path survives roulette, and where it goes on, one bit each.
    pub brings: u32,
    pub survives: u32,
    pub goes_on: u32,
    /// f·|cos θ| / p, and the probability of surviving roulette.
    pub weights: Rows,
    /// Throughput and pixel; these and the following count only where paths go on.
    pub throughput: Rows,
    /// See [`PathState::reflected`] and [`PathState::squeezed`]; only where these are kept.
    pub reflected: Rows,
    /// Rays: the origin, and the direction's x.
    pub begun: Rows,
    /// The direction's y and z, its density, and the BSDF's part of that.
    pub towards: Rows,
}

/// Paths that are taken on from their vertices.
pub(super) struct Going<'g, E> {
    pub shaded: &'g Shaded,
    pub vertices: &'g [&'g Arrival; LANES],
    pub paths: &'g [&'g PathState; LANES],
    /// Whether roulette is played by what paths carry.
    pub plays: bool,
    /// See [`usual_radiance`](crate::guiding::sample::field::GuideField::usual_radiance).
    pub usual: Option<f32>,
    pub gone: &'g mut Gone,
    pub effects: PhantomData<E>,
}

impl<E: Effects> Kernel for Going<'_, E> {
    type Output = ();

    #[inline(always)]
    fn run<W: Wide>(self, wide: W) {
        self.go_on(All(wide));
    }
}

impl<E: Effects> Going<'_, E> {
    /// Takes the paths on, in lanes or the first alone.
    #[inline(always)]
    pub fn take(self, together: bool) {
        if together {
            // There are lanes, or the vertices would have been shaded one by one.
            let _ = lanes::run(self);
        } else {
            self.go_on(First);
        }
    }

    /// Probability that a path goes on in the direction that was drawn, by which its throughput is multiplied. Where a guide chose
    /// the direction, f·cos/p is small because p is large, that is because much light is expected there: ending such paths early
    /// would undo what guiding gains. So what counts is the share that the surfaces reflect, as if their BSDFs had chosen the
    /// directions, or the throughput where that is larger. And what glass divides by η² on the way in it multiplies on the way out:
    /// inside of it paths are worth as much as outside. And a path is worth what it carries times the radiance that vertices usually send
    /// back, over the value of its pixel, where that is known: seen in a dark corner more than beside a lamp.
    #[inline(always)]
    fn go_on<K: Keep>(self, to: K) {
        let onward = self.shaded.onward(to);
        let mixed = Mixed::new(&onward, if E::GUIDING { self.shaded.guides(to) } else { None });
        let [x, y, z, pixel] = to.columns(|lane| {
            let PathState { throughput, pixel, .. } = self.paths[lane];
            [throughput.x, throughput.y, throughput.z, *pixel]
        });
        let throughput = V3::new(x, y, z) * mixed.weight;
        let one = pixel.all(1.0);
        let (mut reflected, mut squeezed) = (throughput, one);
        if E::GUIDING || E::MATERIALS {
            let [x, y, z, before] = to.columns(|lane| {
                let PathState { reflected, squeezed, .. } = self.paths[lane];
                [reflected.x, reflected.y, reflected.z, *squeezed]
            });
            reflected = V3::new(x, y, z) * mixed.bsdf_weight;
            squeezed = onward.squeeze.map_or(before, |squeeze| before * squeeze);
        }
        let mut survival = one;
        if self.plays {
            let judged = if E::GUIDING { throughput.max(reflected) } else { throughput };
            let carried = if E::MATERIALS { judged * squeezed } else { judged };
            let most = carried.max_element();
            survival = survival_by(if E::GUIDING {
                let [usual, pixel, ..] = to.columns(|lane| {
                    let PathState { judged, pixel, .. } = self.paths[lane];
                    let [usual, pixel] = usual_and_pixel(self.usual, judged.then_some(*pixel));
                    [usual, pixel, 0.0, 0.0]
                });
                most * usual / pixel
            } else {
                most / pixel
            });
        }
        if E::GUIDING {
            let (known, expected) = self.expected(to);
            // What a mirror shows has nothing to do with what the voxel's other directions send back.
            survival = (known & !onward.delta).choose(expected, survival);
        }
        let survives = survival.ge(one) | to.kept(&self.shaded.roulette).lt(survival);
        let gone = self.gone;
        gone.brings = mixed.any.answers();
        gone.survives = survives.answers();
        gone.goes_on = (mixed.any & survives & !throughput.is_zero()).answers();
        to.keep_rows(row(mixed.weight, survival), &mut gone.weights);
        to.keep_rows(row(throughput / survival, pixel), &mut gone.throughput);
        if E::GUIDING || E::MATERIALS {
            to.keep_rows(row(reflected / survival, squeezed), &mut gone.reflected);
        }
        let V3 { x, y, z } = onward.direction;
        to.keep_rows(row(onward.origin, x), &mut gone.begun);
        to.keep_rows([y, z, mixed.pdf, mixed.bsdf_share], &mut gone.towards);
    }

    /// Probabilities of going on by the light that is expected, and where they are known.
    #[inline(always)]
    fn expected<K: Keep>(&self, to: K) -> (<K::Real as Real>::Mask, K::Real) {
        let (mut known, mut expected): (u32, Column) = (0, [1.0; LANES]);
        for (lane, at) in self.vertices.iter().enumerate() {
            if let Some(onward) = at.worth.onward {
                known |= 1 << lane;
                expected[lane] = onward;
            }
        }
        (to.mask(known), to.kept(&expected))
    }
}

/// Probability that paths go on by what they carry.
#[inline(always)]
fn survival_by<R: Real>(carried: R) -> R {
    carried.between(0.05, ROULETTE_MOST)
}

/// What vertices usually send back and what a path's pixel is worth, where both are known.
#[inline(always)]
fn usual_and_pixel(usual: Option<f32>, pixel: Option<f32>) -> [f32; 2] {
    usual.zip(pixel).map_or([1.0; 2], |(usual, pixel)| [usual, pixel])
}

/// Probability with which a path goes on from its vertex number `depth` where no voxel tells. It has `carried` its throughput, or the larger
/// of that and what it would be if BSDFs had chosen all directions, times the product of squared indices, to a `pixel` of this value;
/// vertices send back what is `usual` by [`GuideField::usual_radiance`].
///
/// [`GuideField::usual_radiance`]: crate::guiding::sample::field::GuideField::usual_radiance
pub(in crate::integrators) fn blind_survival(
    roulette: Roulette,
    depth: u32,
    carried: Vec3,
    [usual, pixel]: [Option<f32>; 2],
) -> f32 {
    if !roulette.plays(depth) {
        return 1.0;
    }
    let [usual, pixel] = usual_and_pixel(usual, pixel);
    survival_by(carried.max_element() * usual / pixel)
}
