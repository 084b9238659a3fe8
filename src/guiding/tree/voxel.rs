//! A voxel's quadtree while it learns, with the trees and second moments by which the last iteration's distributions are judged.

use glam::Vec3;

use super::TreeSettings;
use super::context::Counted;
use super::features::VoxelFeatures;
use super::leaves::Layout;
use super::past::{Past, joined};
use super::proposal::{Judged, ShareMoments};
use super::quadtree::{Place, Placed, Quadtree};
use super::sampler::SamplingTree;
use super::topology::Topology;
use crate::guiding::cache::Bounds;
use crate::guiding::cache::parallax::Parallax;
use crate::guiding::moments::{Moments, PATH_SHARES};
use crate::guiding::record::{PathRecord, PhotonRecord};
use crate::guiding::samples::Spheres;
use crate::guiding::target::{DirectLight, Learned, Target};

/// Part of the uniform distribution that stands for the BSDF where path samples and photons are weighed against each other.
const KIND_UNIFORM: f32 = 0.3;
/// Largest number of samples that the moments of a voxel's surroundings count as.
const PRIOR_SAMPLES: f64 = 256.0;
/// Largest share of path samples where there are photons: path samples do not know of the light that they have not found.
const MOST_PATH_SHARE: f64 = 0.9;

/// The tree of a voxel while it learns.
#[derive(Debug, Clone)]
pub(super) struct TreeVoxel {
    pub tree: Quadtree,
    /// Whether the tree got its shape in the current pass.
    pub shaped: bool,
    /// Sum of the normals of the deposited samples, where the network needs them.
    pub normals: Vec3,
    /// Share of path samples in the counted distribution, the rest being photons.
    pub path_share: f64,
    /// Second moments under other mixtures of the last trees of path samples and of photons.
    pub kind_moments: Moments<{ PATH_SHARES.len() }>,
    /// Trees of path samples and of photons of the last iteration, with directions carried as those of the guide.
    pub kind_trees: Option<Box<[SamplingTree; 2]>>,
    /// Second moments under other mixtures of the last proposals.
    pub proposal_moments: ShareMoments,
    /// The last proposals, with directions carried as those of the guide.
    pub last_proposals: Option<Box<Judged>>,
    /// Q_h of the last iteration, where evidence is kept.
    pub counted: Option<SamplingTree>,
    /// Distribution that earlier iterations left.
    pub past: Option<Past>,
    /// Past for the next iteration, once this one was counted.
    pub next_past: Option<Past>,
}

impl TreeVoxel {
    pub fn new(layout: Layout, target: Target) -> Self {
        Self {
            tree: Quadtree::new(Topology::root(), layout, target),
            shaped: false,
            normals: Vec3::ZERO,
            path_share: 0.5,
            kind_moments: Moments::default(),
            kind_trees: None,
            proposal_moments: ShareMoments::default(),
            last_proposals: None,
            counted: None,
            past: None,
            next_past: None,
        }
    }

    /// Adds the samples of a voxel whose tree has the same shape; returns whether it has.
    pub fn add(&mut self, other: &Self) -> bool {
        self.normals += other.normals;
        self.kind_moments.merge(&other.kind_moments);
        self.proposal_moments.merge(&other.proposal_moments);
        self.shaped |= other.shaped;
        self.tree.add_samples_of(&other.tree)
    }

    /// Judges the trees and proposals of the last iteration by a path sample that was drawn with their guide.
    pub fn judge(&mut self, record: &PathRecord, guide: &Parallax) {
        // Most paths bring nothing that tells them apart.
        let tells = record.brought.onward != 0.0;
        if tells && (self.kind_trees.is_some() || self.last_proposals.is_some()) {
            let seen = guide.to_centre(record.point, record.direction);
            self.weigh_kinds(record, seen.direction, f64::from(seen.density));
            self.weigh_proposals(record, seen.direction);
        }
    }

    /// Adds samples to the tree. The first of a pass also give the tree its shape, unless it `keeps` the one that it has.
    pub fn deposit<'a>(
        &mut self,
        paths: impl Iterator<Item = &'a PathRecord>,
        photons: impl Iterator<Item = &'a PhotonRecord>,
        (spheres, learned): (&Spheres, Learned),
        settings: &TreeSettings,
        keeps: bool,
    ) {
        let place = Place { parallax: spheres.learned, direct: learned.direct, filtered: settings.filtered };
        let samples = Placed::new(&place, self.tree.target(), paths, photons);
        if samples.is_empty() {
            return;
        }
        if settings.layout == Layout::Network {
            self.normals += samples.normals();
        }
        self.tree.deposit(&samples);
        // A tree that is only a root first becomes equal leaves; the second round gives it direction.
        let first = !self.shaped && !keeps;
        let (rounds, least) = match self.tree.topology().len() {
            _ if !first => (0, 0),
            1 => (2, settings.first_least),
            _ => (1, 0),
        };
        for _ in 0..rounds {
            self.tree = self.tree.refined(settings.split_share, least);
            self.tree.deposit(&samples);
        }
        self.shaped = true;
    }

    /// Distribution of this iteration's samples and of the past, whose samples count as `part` of their number. Path samples and
    /// photons are mixed in the share that measured best, here and in the surroundings (`around`, which includes the voxel).
    pub fn count(&mut self, around: &Moments<{ PATH_SHARES.len() }>, part: f64) -> Counted {
        let mut shares = self.kind_moments;
        shares.add_prior(&around.without(&self.kind_moments), PRIOR_SAMPLES);
        self.path_share = shares.best().map_or(0.5, |best| PATH_SHARES[best].min(MOST_PATH_SHARE));
        let samples: u32 = self.tree.counts().iter().sum();
        let own = self.tree.has_energy().then(|| (self.tree.leaves().hybrid(self.path_share), f64::from(samples)));
        let own = joined(own, self.past.as_ref(), part);
        self.next_past = own.as_ref().filter(|_| part > 0.0).map(|(of, samples)| Past::new(of, *samples));
        own
    }

    /// Second moments under mixtures of proposals, with those of the surroundings (`around`, which includes the voxel) as a prior.
    pub fn proposal_moments_with(&self, around: &ShareMoments) -> ShareMoments {
        let mut own = self.proposal_moments;
        own.add_prior(&around.without(&self.proposal_moments), PRIOR_SAMPLES);
        own
    }

    pub fn voxel_features(&self, bounds: Bounds, spheres: &Spheres, past: f64) -> VoxelFeatures {
        let samples = self.tree.counts();
        let count = samples.iter().sum::<u32>().max(1);
        let half = 0.5 * (bounds.high - bounds.low).length();
        VoxelFeatures {
            samples,
            past: self.past.as_ref().map_or(0.0, |of| past * of.samples()) as f32,
            path_share: self.path_share as f32,
            normal: self.normals / count as f32,
            nearness: spheres.learned.curvature * half,
        }
    }

    /// Distributions of path samples and photons apart, where there are both.
    pub fn separated(&self) -> Option<Box<[SamplingTree; 2]>> {
        if self.tree.counts()[1] == 0 {
            return None;
        }
        let leaves = self.tree.leaves();
        let both = leaves.has(0) && leaves.has(1);
        both.then(|| {
            Box::new([0, 1].map(|kind| SamplingTree::new(&leaves.distribution(kind), KIND_UNIFORM, usize::MAX)))
        })
    }

    /// Forgets the samples of the iteration.
    pub fn clear(&mut self) {
        self.tree.clear();
        (self.kind_moments, self.proposal_moments) = (Moments::default(), Moments::default());
        (self.shaped, self.normals, self.next_past) = (false, Vec3::ZERO, None);
    }

    /// Judges the last iteration's trees of path samples and photons, and mixtures of them, by a path sample of this iteration: its
    /// V over the density q estimates ∫f²/q. V is that of the light which photons may show too: by light that they never show, path
    /// samples would always be better. q is the density of the direction `seen` from the centre, times `carried`, dω/dω' of the
    /// [`Parallax`]: near a lamp that factor differs between the points of a voxel by far more than the candidates do.
    fn weigh_kinds(&mut self, record: &PathRecord, seen: Vec3, carried: f64) {
        let Some(kinds) = &self.kind_trees else { return };
        let target = self.tree.target();
        // Photons straight from lights that light sampling finds are left out where they are traced.
        let shown = f64::from(Learned { target, direct: DirectLight::Nothing }.value(record));
        if target == Target::Radiance || shown <= 0.0 {
            return;
        }
        let [path, photon] = SamplingTree::pdfs(kinds, seen).map(f64::from);
        let square = shown.powi(2) / carried;
        self.kind_moments.add(PATH_SHARES.map(|share| square / (share * path + (1.0 - share) * photon)));
    }

    /// Judges mixtures of the last proposals by the light that a path brought back along its sampled direction. Light that light
    /// sampling finds too is left out: it says little about guides.
    fn weigh_proposals(&mut self, record: &PathRecord, seen: Vec3) {
        let Some(judged) = &self.last_proposals else { return };
        let [onward, ..] = record.estimates();
        if onward.square > 0.0 {
            self.proposal_moments.add(judged.ratios(seen).map(|ratio| onward.with_guide(ratio)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use crate::guiding::record::Radiance;
    use crate::guiding::tree::distribution::Distribution;
    use crate::math::cylindrical;

    /// A voxel of which path samples and photons have known everything to be uniform.
    fn uniform() -> TreeVoxel {
        let uniform = SamplingTree::new(&Distribution::uniform(), 1.0, usize::MAX);
        TreeVoxel {
            kind_trees: Some(Box::new([uniform.clone(), uniform])),
            ..TreeVoxel::new(Layout::Values, Target::Variance)
        }
    }

    /// Directions as seen from the centre of the unit sphere.
    const SPHERE: Parallax = Parallax { centre: Vec3::ZERO, curvature: 1.0 };

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
            let integrand = SPHERE.to_centre(point, direction).density / sphere;
            let value = integrand * sphere.sqrt();
            let brought = Radiance { emitted: 0.0, onward: value };
            let record = PathRecord { direction, pdf: 1.0, brought, ..PathRecord::absorbed(point, Vec3::Y) };
            voxel.judge(&record, &SPHERE);
        }
        let means = voxel.kind_moments.means().expect("20,000 samples");
        assert!(means.iter().all(|mean| (mean - 1.0).abs() < 0.02), "{means:?}");
    }

    /// A path brought back 1 from surfaces and 2 from a lamp that it hit, a quarter of the lamp's light since light sampling had three
    /// times its density. Of the 9 that trees learn, photons may show 1.
    #[test]
    fn kinds_are_weighed_by_what_photons_may_show() {
        let lamp = PathRecord {
            direction: Vec3::Y,
            pdf: 1.0,
            brought: Radiance { emitted: 2.0, onward: 1.0 },
            light_ratio: 3.0,
            ..PathRecord::absorbed(Vec3::ZERO, Vec3::Y)
        };
        let learned = [DirectLight::Nothing, DirectLight::Weighted, DirectLight::All]
            .map(|direct| Learned { target: Target::Variance, direct }.value(&lamp));
        assert_eq!(learned, [1.0, 3.0, 9.0]);
        let seen = |brought| {
            let mut voxel = uniform();
            voxel.judge(&PathRecord { brought, ..lamp }, &SPHERE);
            voxel.kind_moments.sums()[0]
        };
        assert!(seen(lamp.brought) > 0.0);
        assert_eq!(seen(lamp.brought), seen(Radiance { emitted: 0.0, ..lamp.brought }));
        assert_eq!(seen(Radiance { onward: 0.0, ..lamp.brought }), 0.0, "nothing but the lamp");
    }
}
