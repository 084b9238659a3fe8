//! Interface of models of directions. A model is two types: one that learns for all voxels, and the frozen distribution of a voxel,
//! which is sampled. Code that samples or stores guides knows [`Directions`] alone, code that learns them [`Model`] too; a new model
//! is a file of its own, an arm in each `match` of this one, and its arrays in [`Directions::arrays`] and [`Directions::read`].
//!
//! Enums and not traits: which model guides is decided once per render, and asking it costs a branch that is always the same.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::gmm::learn::GaussianMixtures;
use super::gmm::mixture::GaussianMixture;
use super::gmm::stored::{gaussian_arrays, read_gaussians};
use super::jensen::{Histogram, Histograms, histogram_arrays, read_histograms};
use super::samples::{Around, Told};
use super::target::Target;
use super::tree::arrays::{read_trees, tree_arrays};
use super::tree::sampler::{self, Places, SamplingTree};
use super::tree::{CountedTree, Propose, TreeSettings, Trees};
use super::vmf::learn::VmfMixtures;
use super::vmf::mixture::VmfMixture;
use super::vmf::stored::{mixture_arrays, read_mixtures};
use crate::base::Result;
use crate::base::tensors::{Tensor, Tensors};
use crate::math::cylindrical::{self, to_directions, to_place};
use crate::math::lanes::{LANES, V3, Wide, set_vector, vector};

/// Kind of the model of directions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ModelKind {
    /// Directional quadtrees.
    Trees,
    /// Histograms of fixed cells (Jensen 1995).
    Histograms,
    /// Mixtures of von Mises-Fisher lobes (Ruppert 2020).
    Vmf,
    /// Mixtures of Gaussians (Vorba 2014).
    Gmm,
}

/// A frozen distribution of directions, which a voxel is sampled from. Densities are positive everywhere.
#[derive(Debug, Clone, PartialEq)]
pub enum Directions {
    /// On a quadtree.
    Tree(SamplingTree),
    /// On fixed cells.
    Histogram(Box<Histogram>),
    /// Lobes that are aimed from each point anew; without one, as seen from their pivot.
    Vmf(Box<VmfMixture>),
    /// Gaussians on the square of directions.
    Gmm(Box<GaussianMixture>),
}

impl From<SamplingTree> for Directions {
    fn from(tree: SamplingTree) -> Self {
        Self::Tree(tree)
    }
}

impl From<Histogram> for Directions {
    fn from(histogram: Histogram) -> Self {
        Self::Histogram(Box::new(histogram))
    }
}

impl From<VmfMixture> for Directions {
    fn from(mixture: VmfMixture) -> Self {
        Self::Vmf(Box::new(mixture))
    }
}

impl From<GaussianMixture> for Directions {
    fn from(mixture: GaussianMixture) -> Self {
        Self::Gmm(Box::new(mixture))
    }
}

impl Directions {
    /// Direction that a point of the unit square maps to, and its density w.r.t. solid angle. Evenly spread points stay so.
    #[inline]
    pub fn sample(&self, u: [f64; 2]) -> (Vec3, f32) {
        match self {
            Self::Tree(tree) => tree.sample(u),
            Self::Histogram(histogram) => histogram.sample(u),
            Self::Vmf(mixture) => mixture.sample(u, &mixture.at_pivot()),
            Self::Gmm(mixture) => mixture.sample(u),
        }
    }

    /// Density of [`Directions::sample`] w.r.t. solid angle.
    #[inline]
    pub fn pdf(&self, direction: Vec3) -> f32 {
        match self {
            Self::Tree(tree) => tree.pdf(direction),
            Self::Histogram(histogram) => histogram.pdf(direction),
            Self::Vmf(mixture) => mixture.pdf(direction, &mixture.at_pivot()),
            Self::Gmm(mixture) => mixture.pdf(direction),
        }
    }

    /// [`Directions::sample`] of several, which wait for memory together; a density of 0 where there are none.
    #[inline(always)]
    pub fn sample_lanes<W: Wide>(wide: W, draws: &[Option<(&Self, [f64; 2])>; LANES]) -> (V3<W::Real>, W::Real) {
        let mut trees = [None; LANES];
        let mut others = false;
        for (tree, draw) in trees.iter_mut().zip(draws) {
            *tree = draw.and_then(|(directions, u)| Some((directions.tree()?, u)));
            others |= draw.is_some() && tree.is_none();
        }
        let Places { steps: [x, y], mut pdf } = sampler::sample_lanes(&trees);
        let directions = to_directions([wide.load_bits(&x), wide.load_bits(&y)]);
        if !others {
            return (directions, wide.load(&pdf));
        }
        let mut columns = wide.store_vectors(directions);
        for (lane, (tree, draw)) in trees.iter().zip(draws).enumerate() {
            if let (None, Some((directions, u))) = (tree, draw) {
                let direction;
                (direction, pdf[lane]) = directions.sample(*u);
                set_vector(&mut columns, lane, direction);
            }
        }
        (wide.load_vectors(&columns), wide.load(&pdf))
    }

    /// [`Directions::pdf`] of several towards unit vectors, which wait for memory together; 0 where there are none.
    #[inline(always)]
    pub fn pdf_lanes<W: Wide>(wide: W, asked: &[Option<&Self>; LANES], towards: V3<W::Real>) -> W::Real {
        let mut trees = [None; LANES];
        let mut others = false;
        for (tree, asked) in trees.iter_mut().zip(asked) {
            *tree = asked.and_then(Self::tree);
            others |= asked.is_some() && tree.is_none();
        }
        let mut pdf = sampler::pdf_lanes(&trees, &to_place(towards).map(|steps| wide.store_bits(steps)));
        if others {
            let towards = wide.store_vectors(towards);
            for (lane, (tree, asked)) in trees.iter().zip(asked).enumerate() {
                if let (None, Some(directions)) = (tree, asked) {
                    pdf[lane] = directions.pdf(vector(&towards, lane));
                }
            }
        }
        wide.load(&pdf)
    }

    /// Brings near what will be read first.
    #[inline(always)]
    pub fn prefetch(&self) {
        if let Self::Tree(tree) = self {
            tree.prefetch();
        }
    }

    #[inline(always)]
    fn tree(&self) -> Option<&SamplingTree> {
        if let Self::Tree(tree) = self { Some(tree) } else { None }
    }

    /// The mixture, which is asked for directions at a place; none for models that know one distribution for all places.
    #[inline(always)]
    pub fn mixture(&self) -> Option<&VmfMixture> {
        if let Self::Vmf(mixture) = self { Some(mixture) } else { None }
    }

    /// Densities relative to the uniform one at the centres of `side`² cells of equal solid angle, rows of constant φ.
    pub fn map(&self, side: usize) -> Vec<f64> {
        let centre = |i: usize| (i as f64 + 0.5) / side as f64;
        let cells = (0..side * side).map(|i| cylindrical::to_direction([centre(i % side), centre(i / side)]));
        cells.map(|direction| f64::from(self.pdf(direction)) * 4.0 * std::f64::consts::PI).collect()
    }

    /// Bytes in use.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Tree(tree) => tree.bytes(),
            Self::Histogram(histogram) => size_of::<Self>() + histogram.bytes(),
            Self::Vmf(mixture) => size_of::<Self>() + mixture.bytes(),
            Self::Gmm(mixture) => size_of::<Self>() + mixture.bytes(),
        }
    }

    /// Number of nodes, cells, lobes or Gaussians.
    pub fn nodes(&self) -> usize {
        match self {
            Self::Tree(tree) => tree.len(),
            Self::Histogram(histogram) => histogram.cells(),
            Self::Vmf(mixture) => mixture.len(),
            Self::Gmm(mixture) => mixture.len(),
        }
    }

    /// Arrays of a file that hold the distribution of each voxel, or none. `kind` begins their names, which
    /// [`file`](super::sample::file) lists.
    pub(super) fn arrays<'a>(kind: &str, all: &[Option<&Self>]) -> Vec<Tensor<'a>> {
        let trees = all.iter().map(|of| of.and_then(Self::tree));
        let histograms = all.iter().map(|of| if let Some(Self::Histogram(of)) = of { Some(&**of) } else { None });
        let histograms: Vec<_> = histograms.collect();
        let mut arrays = tree_arrays(kind, &trees.collect::<Vec<_>>()).to_vec();
        if histograms.iter().any(Option::is_some) {
            arrays.push(histogram_arrays(kind, &histograms));
        }
        let mixtures: Vec<_> = all.iter().map(|of| of.and_then(Self::mixture)).collect();
        if mixtures.iter().any(Option::is_some) {
            arrays.extend(mixture_arrays(kind, &mixtures));
        }
        let gaussians = all.iter().map(|of| if let Some(Self::Gmm(of)) = of { Some(&**of) } else { None });
        let gaussians: Vec<_> = gaussians.collect();
        if gaussians.iter().any(Option::is_some) {
            arrays.extend(gaussian_arrays(kind, &gaussians));
        }
        arrays
    }

    /// Reads the distributions of `count` voxels that [`Directions::arrays`] wrote.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
    pub(super) fn read(file: &Tensors, kind: &str, count: usize) -> Result<Vec<Option<Self>>> {
        let mut all = boxed(read_trees(file, kind, count)?);
        if let Some(histograms) = read_histograms(file, kind, count)? {
            fill(&mut all, boxed(histograms));
        }
        if let Some(mixtures) = read_mixtures(file, kind, count)? {
            fill(&mut all, boxed(mixtures));
        }
        if let Some(gaussians) = read_gaussians(file, kind, count)? {
            fill(&mut all, boxed(gaussians));
        }
        Ok(all)
    }
}

/// A model of all voxels while they learn.
#[derive(Debug, Clone)]
pub enum Model {
    /// Directional quadtrees.
    Trees(Trees),
    /// Histograms of fixed cells.
    Histograms(Histograms),
    /// Mixtures of von Mises-Fisher lobes.
    Vmf(VmfMixtures),
    /// Mixtures of Gaussians.
    Gmm(GaussianMixtures),
}

impl Model {
    /// Empty model of `voxels` voxels, for samples of `target`.
    pub(super) fn new(kind: ModelKind, trees: &TreeSettings, target: Target, voxels: usize) -> Self {
        match kind {
            ModelKind::Trees => Self::Trees(Trees::new(trees.clone(), target, voxels)),
            ModelKind::Histograms => Self::Histograms(Histograms::new(target, voxels)),
            ModelKind::Vmf => Self::Vmf(VmfMixtures::new(target, voxels)),
            ModelKind::Gmm => Self::Gmm(GaussianMixtures::new(target, voxels)),
        }
    }

    /// The quadtrees; none for another model.
    pub fn trees(&self) -> Option<&Trees> {
        if let Self::Trees(trees) = self { Some(trees) } else { None }
    }

    /// The quadtrees, mutable; none for another model.
    pub fn trees_mut(&mut self) -> Option<&mut Trees> {
        if let Self::Trees(trees) = self { Some(trees) } else { None }
    }

    /// Adds empty voxels, up to `voxels` of them.
    pub(super) fn resize(&mut self, voxels: usize) {
        match self {
            Self::Trees(trees) => trees.resize(voxels),
            Self::Histograms(histograms) => histograms.resize(voxels),
            Self::Vmf(mixtures) => mixtures.resize(voxels),
            Self::Gmm(mixtures) => mixtures.resize(voxels),
        }
    }

    /// Judges by a chunk of samples the distributions that drew them, then learns from them.
    pub(super) fn observe(&mut self, told: &Told) {
        match self {
            Self::Trees(trees) => trees.observe(told),
            Self::Histograms(histograms) => histograms.observe(told),
            Self::Vmf(mixtures) => mixtures.observe(told),
            Self::Gmm(mixtures) => mixtures.observe(told),
        }
    }

    /// Share of path samples in a voxel's distribution, the rest being photons.
    pub(super) fn path_share(&self, voxel: usize) -> f64 {
        match self {
            Self::Trees(trees) => trees.path_share(voxel),
            Self::Histograms(_) | Self::Gmm(_) => 0.5,
            Self::Vmf(_) => 1.0,
        }
    }

    /// Quadtrees that reconstruction can make proposals of, one per voxel; empty for another model.
    pub(super) fn counted(&mut self, around: &Around) -> Vec<Option<CountedTree<'_>>> {
        match self {
            Self::Trees(trees) => trees.counted(around),
            Self::Histograms(_) | Self::Vmf(_) | Self::Gmm(_) => Vec::new(),
        }
    }

    /// Distributions to sample next, one per voxel; none where nothing is known. All together take at most about `memory` bytes.
    /// Those on quadtrees are made of the proposals of `propose`.
    ///
    /// # Errors
    /// Those of `propose`.
    pub(super) fn fit(
        &mut self,
        around: &Around,
        propose: &mut Propose,
        memory: usize,
    ) -> Result<Vec<Option<Directions>>> {
        match self {
            Self::Trees(trees) => Ok(boxed(trees.fit(around, propose, memory)?)),
            Self::Histograms(histograms) => Ok(boxed(histograms.fit(around, memory))),
            Self::Vmf(mixtures) => Ok(boxed(mixtures.fit(around, memory))),
            Self::Gmm(mixtures) => Ok(boxed(mixtures.fit(around, memory))),
        }
    }

    /// Whether a voxel of which nothing new is known keeps its guide, or has none from then on.
    pub(super) fn keeps_guides(&self) -> bool {
        matches!(self, Self::Trees(_))
    }

    /// Distributions as counted, before reconstruction, where evidence of them is kept.
    pub(super) fn evidence(&self) -> Vec<Option<Directions>> {
        match self {
            Self::Trees(trees) => boxed(trees.evidence()),
            Self::Histograms(_) | Self::Vmf(_) | Self::Gmm(_) => Vec::new(),
        }
    }

    /// Factor in (0, 1] by which photons lower the second moment of guided samples in a voxel; none where that is not measured.
    pub(super) fn photon_gain(&self, voxel: usize) -> Option<f64> {
        match self {
            Self::Trees(trees) => trees.photon_gain(voxel),
            Self::Histograms(_) | Self::Vmf(_) | Self::Gmm(_) => None,
        }
    }

    /// Ends an iteration whose distributions were made, before voxels are halved.
    pub(super) fn turn(&mut self) {
        match self {
            Self::Trees(trees) => trees.turn(),
            Self::Histograms(_) => {}
            Self::Vmf(mixtures) => mixtures.turn(),
            Self::Gmm(mixtures) => mixtures.turn(),
        }
    }

    /// Halves voxel `old` into `old` and `new`, which get the shares `parts` of its samples.
    pub(super) fn halve(&mut self, old: usize, new: usize, parts: [f64; 2]) {
        match self {
            Self::Trees(trees) => trees.halve(old, new, parts),
            // The sums are cleared next.
            Self::Histograms(_) => {}
            Self::Vmf(mixtures) => mixtures.halve(old, new, parts),
            Self::Gmm(mixtures) => mixtures.halve(old, new, parts),
        }
    }

    /// Forgets the samples of the iteration. From now on `target` is deposited.
    pub(super) fn clear(&mut self, target: Target) {
        match self {
            Self::Trees(trees) => trees.clear(target),
            Self::Histograms(histograms) => histograms.clear(target),
            Self::Vmf(mixtures) => mixtures.clear(target),
            Self::Gmm(mixtures) => mixtures.clear(target),
        }
    }

    /// Number of nodes or cells that samples are counted in, or of lobes or Gaussians.
    pub fn nodes(&self) -> usize {
        match self {
            Self::Trees(trees) => trees.quadtrees().map(|tree| tree.topology().len()).sum(),
            Self::Histograms(histograms) => histograms.cells(),
            Self::Vmf(mixtures) => mixtures.components(),
            Self::Gmm(mixtures) => mixtures.components(),
        }
    }

    /// State of the model, as arrays of a file.
    pub(super) fn arrays<'a>(&self) -> Vec<Tensor<'a>> {
        match self {
            Self::Trees(trees) => trees.arrays(),
            Self::Histograms(histograms) => histograms.arrays(),
            Self::Vmf(mixtures) => mixtures.arrays(),
            Self::Gmm(mixtures) => mixtures.arrays(),
        }
    }

    /// Reads the model of `voxels` voxels that [`Model::arrays`] wrote.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
    pub(super) fn from_arrays(
        kind: ModelKind,
        trees: &TreeSettings,
        target: Target,
        voxels: usize,
        file: &Tensors,
    ) -> Result<Self> {
        match kind {
            ModelKind::Trees => Trees::from_arrays(trees.clone(), target, voxels, file).map(Self::Trees),
            ModelKind::Histograms => Histograms::from_arrays(target, voxels, file).map(Self::Histograms),
            ModelKind::Vmf => VmfMixtures::from_arrays(target, voxels, file).map(Self::Vmf),
            ModelKind::Gmm => GaussianMixtures::from_arrays(target, voxels, file).map(Self::Gmm),
        }
    }
}

fn boxed<T: Into<Directions>>(all: Vec<Option<T>>) -> Vec<Option<Directions>> {
    all.into_iter().map(|of| of.map(T::into)).collect()
}

/// Fills the gaps of `all` with others.
fn fill(all: &mut [Option<Directions>], others: Vec<Option<Directions>>) {
    for (gap, other) in all.iter_mut().zip(others) {
        *gap = gap.take().or(other);
    }
}
