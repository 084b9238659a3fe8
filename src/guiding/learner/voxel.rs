//! A voxel while it learns: what it is told, and what it makes of that.

use glam::Vec3;

use super::super::cache::Bounds;
use super::super::effort::Returns;
use super::super::features::Traits;
use super::super::fraction::{Adam, FractionRule};
use super::super::leaves::{DirectLight, Layout, Target};
use super::super::moments::{FRACTIONS, Moments, PATH_SHARES};
use super::super::parallax::Parallax;
use super::super::past::Past;
use super::super::proposal::{Judged, ShareMoments};
use super::super::quadtree::{Place, Quadtree};
use super::super::record::{PathRecord, PhotonRecord};
use super::super::sampler::SamplingTree;
use super::super::topology::Topology;
use super::{Kept, LEARNING_FRACTION, LearnerSettings};
use crate::math::cylindrical;

/// Part of the uniform distribution that stands for the BSDF where path samples and photons are weighed against each other.
const SHARE_UNIFORM: f32 = 0.3;

/// A voxel while it learns.
#[derive(Debug, Clone)]
pub(super) struct Voxel {
    pub tree: Quadtree,
    /// What the tree's directions refer to.
    pub parallax: Parallax,
    /// Path samples of this iteration in each eighth of the voxel, bit `axis` of its number being set in the upper half.
    pub eighths: [u32; 8],
    /// Q_r of the last iteration with energy.
    pub guide: Option<SamplingTree>,
    /// What its directions refer to.
    pub guide_parallax: Parallax,
    /// Fraction of BSDF samples once learning is over, and whether path samples or photons have told that a guide is worth having.
    pub bsdf_fraction: f32,
    pub told: bool,
    /// Part of path samples in what is counted, the rest being photons.
    pub path_share: f64,
    /// Σ of what the samples brought to the picture, and of its squares; of the latter with light sampling.
    pub contribution: f64,
    pub squares: Moments<1>,
    pub all_squares: f64,
    /// What mixing BSDF and guide in other ways would have cost.
    pub fractions: Moments<{ FRACTIONS.len() }>,
    /// What its vertices sent back, and the same of the last iteration with what its surroundings know.
    pub returns: Returns,
    pub known_returns: Returns,
    pub adam: Adam,
    /// What mixing the trees of path samples and photons in other ways would have cost.
    pub shares: Moments<{ PATH_SHARES.len() }>,
    /// The trees of path samples and of photons in the last iteration, with [`Voxel::guide_parallax`].
    pub kinds: Option<Box<[SamplingTree; 2]>>,
    /// What mixing the last proposals in other ways would have cost, and these, with [`Voxel::guide_parallax`].
    pub merits: ShareMoments,
    pub judged: Option<Box<Judged>>,
    /// Whether the tree got its shape in the current pass.
    pub shaped: bool,
    /// Sum of the normals of what was deposited, where the network wants them.
    pub normals: Vec3,
    /// See [`Evidence`](super::super::field::Evidence).
    pub counted: Option<SamplingTree>,
    pub gain: f32,
    /// What earlier iterations left.
    pub past: Option<Past>,
    /// The past of the iteration to come, once this one was counted.
    pub next_past: Option<Past>,
}

impl Voxel {
    pub fn new(layout: Layout, target: Target) -> Self {
        Self {
            tree: Quadtree::new(Topology::root(), layout, target),
            parallax: Parallax::NONE,
            eighths: [0; 8],
            guide: None,
            guide_parallax: Parallax::NONE,
            bsdf_fraction: 0.5,
            told: false,
            path_share: 0.5,
            contribution: 0.0,
            squares: Moments::default(),
            all_squares: 0.0,
            fractions: Moments::default(),
            returns: Returns::default(),
            known_returns: Returns::default(),
            adam: Adam::default(),
            shares: Moments::default(),
            kinds: None,
            merits: ShareMoments::default(),
            judged: None,
            shaped: false,
            normals: Vec3::ZERO,
            counted: None,
            gain: f32::NAN,
            past: None,
            next_past: None,
        }
    }

    /// Learns from a path sample what it says about the guide that drew it.
    pub fn judge(&mut self, record: &PathRecord, rule: FractionRule) {
        let brought = f64::from(record.importance) * f64::from(record.estimate());
        self.contribution += brought;
        let [onward, all] = record.squares();
        self.squares.add([onward]);
        self.all_squares += all;
        self.returns.add([record.direct, record.estimate()].map(f64::from));
        if record.is_directed() && (self.kinds.is_some() || self.judged.is_some()) {
            let seen = self.guide_parallax.to_centre(record.point, record.direction);
            let cell = cylindrical::to_cell(seen.direction);
            self.weigh_kinds(record, cell, f64::from(seen.density));
            self.weigh_proposals(record, cell);
        }
        if self.guide.is_some() {
            self.fractions.add_estimates(&record.estimates(), LEARNING_FRACTION);
            if record.is_directed() && rule == FractionRule::Adam {
                self.adam.step(f64::from(record.estimate()), f64::from(record.bsdf_share), LEARNING_FRACTION);
            }
        }
    }

    /// Adds samples to the tree. The first of a pass also give it its shape, and the sphere that it refers to, unless shapes are
    /// kept.
    pub fn deposit<'a>(
        &mut self,
        bounds: &Bounds,
        paths: impl Iterator<Item = &'a PathRecord> + Clone,
        photons: impl Iterator<Item = &'a PhotonRecord> + Clone,
        settings: &LearnerSettings,
        kept: Kept,
    ) {
        if paths.clone().next().is_none() && photons.clone().next().is_none() {
            return;
        }
        let first = !self.shaped && !kept.shapes;
        if settings.parallax && !self.shaped && !kept.spheres {
            self.parallax = self.fit_parallax(bounds, settings.direct, paths.clone(), photons.clone());
        }
        let place = Place { parallax: self.parallax, direct: settings.direct, filtered: settings.filtered };
        if settings.layout == Layout::Network {
            let normals = paths.clone().map(|r| r.normal).chain(photons.clone().map(|r| r.normal));
            self.normals += normals.sum::<Vec3>();
        }
        let deposit = |tree: &mut Quadtree| {
            tree.deposit_paths(&place, paths.clone());
            tree.deposit_photons(&place, photons.clone());
        };
        deposit(&mut self.tree);
        let middle = 0.5 * (bounds.low + bounds.high);
        paths.clone().for_each(|r| self.eighths[r.point.cmpge(middle).bitmask() as usize] += 1);
        // A tree that is only a root first becomes equal leaves; the second round gives it direction.
        let rounds = if first { 1 + usize::from(self.tree.topology().len() == 1) } else { 0 };
        for _ in 0..rounds {
            self.tree = self.tree.refined(settings.split_share);
            deposit(&mut self.tree);
        }
        self.shaped = true;
    }

    /// What one half along `axis` starts with, the lower (0) or the upper (1).
    pub fn half(&self, axis: u32, half: usize) -> Self {
        let mut part = self.clone();
        let others = part.eighths.iter_mut().enumerate().filter(|(eighth, _)| (eighth >> axis) & 1 != half);
        others.for_each(|(_, samples)| *samples = 0);
        let [own, all] = [&part, self].map(|voxel| f64::from(voxel.eighths.iter().sum::<u32>()));
        part.past = self.past.as_ref().map(|past| past.of_part(own / all));
        part
    }

    pub fn traits(&self, bounds: Bounds, past: f64) -> Traits {
        let samples = self.tree.counts();
        let count = samples.iter().sum::<u32>().max(1);
        let half = 0.5 * (bounds.high - bounds.low).length();
        Traits {
            samples,
            past: self.past.as_ref().map_or(0.0, |of| past * of.samples()) as f32,
            path_share: self.path_share as f32,
            normal: self.normals / count as f32,
            nearness: self.parallax.curvature * half,
        }
    }

    /// The sphere that fits what these samples brought. Where the last guide was dense, an error of direction costs most: what it
    /// knew to be a narrow peak decides.
    fn fit_parallax<'a>(
        &self,
        bounds: &Bounds,
        direct: DirectLight,
        paths: impl Iterator<Item = &'a PathRecord> + Clone,
        photons: impl Iterator<Item = &'a PhotonRecord> + Clone,
    ) -> Parallax {
        let value = |r: &PathRecord| r.value(self.tree.target(), direct);
        let total = [paths.clone().map(value).sum::<f32>(), photons.clone().map(|r| r.power).sum()];
        let share = [self.path_share as f32, 1.0 - self.path_share as f32];
        let start = |kind: usize, value: f32, point: Vec3, direction: Vec3, distance: f32| {
            let density = self.guide.as_ref().map_or(1.0, |guide| {
                let seen = self.guide_parallax.to_centre(point, direction);
                guide.pdf(seen.direction) * seen.density
            });
            let weight = if total[kind] > 0.0 { share[kind] * value / total[kind] * density } else { 0.0 };
            (point + direction * distance, weight)
        };
        let paths = paths.map(|r| start(0, value(r), r.point, r.direction, r.distance));
        let photons = photons.map(|r| start(1, r.power, r.point, r.direction, r.distance));
        Parallax::fit(bounds, paths.chain(photons))
    }

    /// Distributions of path samples and photons apart, where there are both.
    pub fn kinds(&self) -> Option<Box<[SamplingTree; 2]>> {
        if self.tree.counts()[1] == 0 {
            return None;
        }
        let leaves = self.tree.leaves();
        let both = leaves.has(0) && leaves.has(1);
        both.then(|| {
            Box::new([0, 1].map(|kind| SamplingTree::new(&leaves.distribution(kind), SHARE_UNIFORM, usize::MAX)))
        })
    }

    /// Judges the last iteration's trees of path samples and photons, and mixtures of them, by a path sample of this iteration:
    /// its V over the density q estimates ∫f²/q. Of V that is what photons may show too: by light that they never show, path samples
    /// would always be better. q is that of its cell of level 20 as seen from the centre, times `carried`, dω/dω' of the
    /// [`Parallax`]: near a lamp that differs between the points of a voxel by far more than the candidates do.
    fn weigh_kinds(&mut self, record: &PathRecord, cell: [u32; 2], carried: f64) {
        let Some(kinds) = &self.kinds else { return };
        // Photons straight from lights that light sampling finds are left out where they are traced.
        let shown = f64::from(record.value(self.tree.target(), DirectLight::Nothing));
        if self.tree.target() == Target::Radiance || shown <= 0.0 {
            return;
        }
        let [path, photon] = [0, 1].map(|kind| f64::from(kinds[kind].pdf_at(cell)));
        let square = shown.powi(2) / carried;
        self.shares.add(PATH_SHARES.map(|share| square / (share * path + (1.0 - share) * photon)));
    }

    /// Judges mixtures of the last proposals by what the path brought back from a direction that one of them was sampled for. Light
    /// that light sampling finds too says little about guides.
    fn weigh_proposals(&mut self, record: &PathRecord, cell: [u32; 2]) {
        let Some(judged) = &self.judged else { return };
        let [onward, ..] = record.estimates();
        if onward.square > 0.0 {
            self.merits.add(judged.ratios(cell).map(|ratio| onward.with_guide(ratio)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::record::Kinds;
    use super::*;
    use crate::base::random::Random;
    use crate::guiding::distribution::Distribution;

    /// A voxel of which path samples and photons have known everything to be uniform, as seen from the centre of the unit sphere.
    fn uniform() -> Voxel {
        let mut voxel = Voxel::new(Layout::Values, Target::Variance);
        voxel.guide_parallax = Parallax { centre: Vec3::ZERO, curvature: 1.0 };
        let uniform = SamplingTree::new(&Distribution::uniform(), 1.0, usize::MAX);
        voxel.kinds = Some(Box::new([uniform.clone(), uniform]));
        voxel
    }

    /// Whatever is sampled by itself has the second moment 1, wherever in the voxel: samples of an integrand that both kinds' trees
    /// know exactly must say so of every mixture. Half a radius off the centre, light of one direction would else be counted up to
    /// twice, other light a quarter. Five standard errors of 20,000 samples are 0.02.
    #[test]
    fn kinds_are_weighed_where_their_samples_are() {
        let mut voxel = uniform();
        let (mut random, sphere) = (Random::new(1, 0, 0), 4.0 * std::f32::consts::PI);
        for _ in 0..20_000 {
            let direction = cylindrical::to_direction([random.next_f64(), random.next_f64()]);
            let point = Vec3::new(0.5, 0.0, 0.1);
            // The density of the trees there is the integrand; what drew the direction is uniform.
            let integrand = voxel.guide_parallax.to_centre(point, direction).density / sphere;
            let value = integrand * sphere.sqrt();
            let brought = Kinds { emitted: 0.0, onward: value };
            let record = PathRecord { direction, pdf: 1.0, brought, ..PathRecord::absorbed(point, Vec3::Y) };
            voxel.judge(&record, FractionRule::Half);
        }
        let means = voxel.shares.means().expect("20,000 samples");
        assert!(means.iter().all(|mean| (mean - 1.0).abs() < 0.02), "{means:?}");
    }

    /// A path brought back 1 from surfaces and 2 from a lamp that it hit, a quarter of the lamp's light since light sampling had three
    /// times its density. Of the 9 that trees learn, photons may show 1.
    #[test]
    fn kinds_are_weighed_by_what_photons_may_show() {
        let lamp = PathRecord {
            direction: Vec3::Y,
            pdf: 1.0,
            brought: Kinds { emitted: 2.0, onward: 1.0 },
            light_ratio: 3.0,
            ..PathRecord::absorbed(Vec3::ZERO, Vec3::Y)
        };
        let learned = [DirectLight::Nothing, DirectLight::Weighted, DirectLight::All];
        assert_eq!(learned.map(|direct| lamp.value(Target::Variance, direct)), [1.0, 3.0, 9.0]);
        let seen = |brought| {
            let mut voxel = uniform();
            voxel.judge(&PathRecord { brought, ..lamp }, FractionRule::Half);
            voxel.shares.sums()[0]
        };
        assert!(seen(lamp.brought) > 0.0);
        assert_eq!(seen(lamp.brought), seen(Kinds { emitted: 0.0, ..lamp.brought }));
        assert_eq!(seen(Kinds { onward: 0.0, ..lamp.brought }), 0.0, "nothing but the lamp");
    }
}
