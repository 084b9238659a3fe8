//! A learner between two chunks as arrays of a file, so that an interrupted render can go on.
//!
//! For V voxels and O outliers, beside the arrays of the cache and of the guides, which guide files have too, and those of the
//! model:
//!
//! | name | type | shape | |
//! |---|---|---|---|
//! | `learner` | u64 | [4] | whether there is a cache, iterations, chunks, whether spheres are kept |
//! | `outliers` | f64 | [O, 12] | voxel, squares, estimates |
//! | `outlier_least` | f64 | [1] | |
//! | `found` | f64 | [V, 2] | light that BSDF and guide have found, where the fraction of BSDF samples goes by it |
//! | `voxel` | f64 | [V, ..] | all other numbers of a voxel, in the order of [`Voxel::numbers`] |

use glam::Vec3;

use super::adam::Adam;
use super::adjoint::Adjoint;
use super::fraction::{Found, FractionRule};
use super::learner::{Learner, LearnerSettings};
use super::outliers::{Outlier, Outliers};
use super::voxel::Voxel;
use crate::base::Result;
use crate::base::tensors::{Arrays, Dtype, Tensor, Tensors, doubles, vector};
use crate::guiding::cache::SpatialCache;
use crate::guiding::cache::arrays::{cache_arrays, read_cache};
use crate::guiding::cache::parallax::Parallax;
use crate::guiding::model::{Directions, Model};
use crate::guiding::moments::{Estimate, Moments};
use crate::guiding::samples::Spheres;

impl Learner {
    /// State of the learner, as arrays of a file.
    pub fn arrays<'a>(&self) -> Vec<Tensor<'a>> {
        let flags = [self.cache.is_some(), self.keeps_spheres].map(u64::from);
        let state = [flags[0], self.iterations.into(), self.chunks, flags[1]];
        let empty = SpatialCache::new(Vec3::ZERO, 1.0);
        let numbers: Vec<f64> = self.voxels.iter().flat_map(Voxel::numbers).collect();
        let columns = numbers.len() / self.voxels.len().max(1);
        let bytes: Vec<u8> = numbers.into_iter().flat_map(f64::to_le_bytes).collect();
        let mut all = cache_arrays(self.cache.as_ref().unwrap_or(&empty));
        all.extend(Directions::arrays("guide", &self.voxels.iter().map(|v| v.guide.as_ref()).collect::<Vec<_>>()));
        all.extend(self.model.arrays());
        all.extend([
            vector("learner", Dtype::U64, state.into_iter().map(u64::to_le_bytes)),
            doubles("outliers", self.outliers.found.iter().map(Outlier::numbers)),
            vector("outlier_least", Dtype::F64, std::iter::once(self.outliers.least.to_le_bytes())),
            ("voxel".into(), Dtype::F64, vec![self.voxels.len(), columns], bytes.into()),
        ]);
        if self.settings.fraction == FractionRule::Found {
            all.push(doubles("found", self.voxels.iter().map(|voxel| voxel.found.light)));
        }
        all
    }

    /// Reads the learner with these settings that [`Learner::arrays`] wrote.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
    pub fn from_arrays(settings: LearnerSettings, file: &Tensors) -> Result<Self> {
        let state = file.read("learner", Dtype::U64, Some(4), 1, u64::from_le_bytes)?;
        let cache = read_cache(file)?;
        let mut learner = Self::new(settings);
        (learner.iterations, learner.chunks) = (state[1].min(1 << 20) as u32, state[2]);
        learner.keeps_spheres = state[3] != 0;
        learner.voxels = read_voxels(file, cache.len())?;
        if learner.settings.fraction == FractionRule::Found {
            read_found(file, &mut learner.voxels)?;
        }
        let LearnerSettings { model, tree, .. } = &learner.settings;
        learner.model = Model::from_arrays(*model, tree, learner.target(), cache.len(), file)?;
        learner.cache = (state[0] != 0).then_some(cache);
        let outliers = file.read("outliers", Dtype::F64, None, 12, f64::from_le_bytes)?;
        let found = outliers.as_chunks::<12>().0.iter().map(Outlier::from_numbers).collect();
        let least = file.read("outlier_least", Dtype::F64, Some(1), 1, f64::from_le_bytes)?[0];
        learner.outliers = Outliers { found, least };
        Ok(learner)
    }
}

fn read_voxels(file: &Tensors, count: usize) -> Result<Vec<Voxel>> {
    let columns = if count > 0 { Voxel::default().numbers().len() } else { 0 };
    let numbers = file.read("voxel", Dtype::F64, Some(count), columns, f64::from_le_bytes)?;
    let guides = Directions::read(file, "guide", count)?;
    let mut voxels = Vec::with_capacity(count);
    for (v, guide) in guides.into_iter().enumerate() {
        let mut voxel = Voxel { guide, ..Voxel::default() };
        if !voxel.set_numbers(&numbers[v * columns..][..columns]) {
            return file.fail("voxel", format!("the numbers of voxel {v} are out of range"));
        }
        voxels.push(voxel);
    }
    Ok(voxels)
}

fn read_found(file: &Tensors, voxels: &mut [Voxel]) -> Result<()> {
    let rows = file.read("found", Dtype::F64, Some(voxels.len()), 2, f64::from_le_bytes)?;
    if rows.iter().any(|light| !(*light >= 0.0 && light.is_finite())) {
        return file.fail("found", "light that is negative or not finite");
    }
    voxels.iter_mut().zip(rows.as_chunks::<2>().0).for_each(|(voxel, &light)| voxel.found = Found { light });
    Ok(())
}

impl Voxel {
    /// All numbers of the voxel beside its guide. All are exact in double precision.
    fn numbers(&self) -> Vec<f64> {
        let mut all: Vec<f64> = Vec::with_capacity(64);
        let Spheres { learned, guide } = self.spheres;
        all.extend(learned.to_array().into_iter().chain(guide.to_array()).map(f64::from));
        all.extend([self.bsdf_fraction, self.drawn_fraction, self.gain].map(f64::from));
        all.extend(self.eighths.into_iter().chain([self.photons]).map(f64::from));
        all.extend([self.begun, self.lit, self.told].map(|flag| f64::from(u8::from(flag))));
        all.extend([self.power, self.importance, self.contribution, self.all_squares]);
        self.squares.push_to(&mut all);
        self.fractions.push_to(&mut all);
        self.adjoint.push_to(&mut all);
        self.known_adjoint.push_to(&mut all);
        all.extend(self.adam.numbers());
        all
    }

    /// Sets the numbers that [`Voxel::numbers`] lists; returns whether they are in range.
    fn set_numbers(&mut self, numbers: &[f64]) -> bool {
        let mut rest = numbers.iter().copied();
        let mut next = || rest.next().unwrap_or(f64::NAN);
        let mut sphere = || {
            let [x, y, z, curvature] = [0; 4].map(|_| next() as f32);
            Parallax { centre: Vec3::new(x, y, z), curvature }
        };
        let spheres = [sphere(), sphere()];
        self.spheres = Spheres { learned: spheres[0], guide: spheres[1] };
        [self.bsdf_fraction, self.drawn_fraction, self.gain] = [0; 3].map(|_| next() as f32);
        self.eighths = [0; 8].map(|_| (next() as u32).min(1 << 26));
        self.photons = (next() as u32).min(1 << 30);
        [self.begun, self.lit, self.told] = [0; 3].map(|_| next() != 0.0);
        [self.power, self.importance, self.contribution, self.all_squares] = [0; 4].map(|_| next());
        self.squares = Moments::pull_from(&mut next);
        self.fractions = Moments::pull_from(&mut next);
        self.adjoint = Adjoint::pull_from(&mut next);
        self.known_adjoint = Adjoint::pull_from(&mut next);
        self.adam = Adam::from_numbers([0; 4].map(|_| next()));
        spheres.iter().all(|s| s.to_array().iter().all(|x| x.is_finite()))
            && [self.bsdf_fraction, self.drawn_fraction].iter().all(|&fraction| fraction > 0.0 && fraction <= 1.0)
    }
}

impl Outlier {
    fn numbers(&self) -> [f64; 12] {
        let [a, b] = self.squares;
        let of = |i: usize| {
            let Estimate { square, bsdf_share, light_ratio } = self.estimates[i];
            [square, bsdf_share.into(), light_ratio.into()]
        };
        let [[c, d, e], [f, g, h], [i, j, k]] = [of(0), of(1), of(2)];
        [self.voxel.into(), a, b, c, d, e, f, g, h, i, j, k]
    }

    fn from_numbers(&[voxel, a, b, c, d, e, f, g, h, i, j, k]: &[f64; 12]) -> Self {
        let estimate =
            |[square, share, ratio]: [f64; 3]| Estimate { square, bsdf_share: share as f32, light_ratio: ratio as f32 };
        let estimates = [[c, d, e], [f, g, h], [i, j, k]].map(estimate);
        Self { voxel: voxel as u32, squares: [a, b], estimates }
    }
}
