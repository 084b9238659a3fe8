//! Histograms of directions, the first model of directions for guiding (Jensen 1995, *Importance Driven Path Tracing using the
//! Photon Map*): the sphere in cells of equal solid angle, each as probable as the power of the photons that came through it.
//!
//! Jensen makes one for every hit point, of the nearest photons and of the half sphere above it, each photon weighted by the BSDF. Here
//! there is one for every voxel and for all of its BSDFs, and the BSDF is sampled beside it. It is the baseline that needs no
//! tree, no reconstruction and no context.

use glam::Vec3;
use rayon::prelude::*;

use super::cache::parallax::Carried;
use super::samples::{Around, Told};
use super::target::Target;
use crate::base::Result;
use crate::base::tensors::{Arrays, Dtype, Tensor, Tensors, floats};
use crate::math::cylindrical;
use crate::sampling::grid::Grid;

/// Columns (z) and rows (φ) of the cylindrical map.
const SIDES: [usize; 2] = [8, 16];
/// Number of cells.
const CELLS: usize = SIDES[0] * SIDES[1];
/// Solid angle of a cell, sr.
const SOLID_ANGLE: f64 = 4.0 * std::f64::consts::PI / CELLS as f64;
/// Part of the uniform distribution: no photon means only that none was traced there.
const UNIFORM: f64 = 0.1;
/// Share of path samples where there are photons too.
const PATH_SHARE: f64 = 0.5;

/// Bytes of one histogram, those of the cells in a [`Grid`] among them.
const BYTES: usize = size_of::<Histogram>() + 12 * CELLS;

/// A histogram of directions as it is sampled.
#[derive(Debug, Clone)]
pub struct Histogram {
    /// Mass per cell, the uniform part included; on no particular scale.
    mass: [f32; CELLS],
    grid: Grid,
}

impl PartialEq for Histogram {
    fn eq(&self, other: &Self) -> bool {
        self.mass == other.mass
    }
}

impl Histogram {
    /// Histogram of positive masses.
    fn new(mass: [f32; CELLS]) -> Self {
        let weigh = |y: usize, row: &mut [f64]| {
            row.iter_mut().zip(&mass[y * SIDES[0]..]).for_each(|(weight, &mass)| *weight = f64::from(mass));
        };
        Self { mass, grid: Grid::new(SIDES[0], SIDES[1], weigh) }
    }

    /// Direction that a point of the unit square maps to, and its density w.r.t. solid angle.
    pub fn sample(&self, u: [f64; 2]) -> (Vec3, f32) {
        let (place, relative) = self.grid.sample(u);
        (cylindrical::to_direction(place), density(relative))
    }

    /// Density of [`Histogram::sample`] w.r.t. solid angle. Never zero.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        density(self.grid.pdf(cylindrical::to_square(direction)))
    }

    /// Bytes in use.
    pub fn bytes(&self) -> usize {
        BYTES
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        CELLS
    }
}

/// Density w.r.t. solid angle, from one relative to the uniform density.
fn density(relative: f64) -> f32 {
    (relative / (4.0 * std::f64::consts::PI)) as f32
}

/// The array `kind_bins` of a file: a row of masses per voxel, zeros for none.
pub(super) fn histogram_arrays<'a>(kind: &str, histograms: &[Option<&Histogram>]) -> Tensor<'a> {
    let rows = histograms.iter().map(|of| of.map_or([0.0; CELLS], |of| of.mass));
    floats(format!("{kind}_bins"), rows)
}

/// Reads the `count` histograms that [`histogram_arrays`] wrote; none where the file has no array of them.
///
/// # Errors
/// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
pub(super) fn read_histograms(file: &Tensors, kind: &str, count: usize) -> Result<Option<Vec<Option<Histogram>>>> {
    let name = format!("{kind}_bins");
    if !file.has(&name) {
        return Ok(None);
    }
    let rows = file.read(&name, Dtype::F32, Some(count), CELLS, f32::from_le_bytes)?;
    let histogram = |(v, &row): (usize, &[f32; CELLS])| match row {
        _ if row.iter().all(|&mass| mass == 0.0) => Ok(None),
        _ if is_positive(&row) => Ok(Some(Histogram::new(row))),
        _ => file.fail(&name, format!("the masses of voxel {v} are no distribution that is positive everywhere")),
    };
    rows.as_chunks::<CELLS>().0.iter().enumerate().map(histogram).collect::<Result<_>>().map(Some)
}

/// Whether masses are finite, and each at least a millionth of their sum; our own are above one in two thousand.
fn is_positive(mass: &[f32; CELLS]) -> bool {
    let sum: f64 = mass.iter().map(|&mass| f64::from(mass)).sum();
    sum.is_finite() && mass.iter().all(|&mass| f64::from(mass) >= 1e-6 * sum)
}

/// Sums of one voxel: of path samples, and of photons.
type Sums = [[f64; CELLS]; 2];

fn is_empty(sums: &Sums) -> bool {
    sums.as_flattened().iter().all(|sum| *sum == 0.0)
}

/// The histograms of all voxels while they learn.
#[derive(Debug, Clone)]
pub struct Histograms {
    target: Target,
    /// Sums per voxel; none where no sample has arrived.
    sums: Vec<Option<Box<Sums>>>,
}

impl Histograms {
    /// Empty histograms of `voxels` voxels, for samples of `target`.
    pub(super) fn new(target: Target, voxels: usize) -> Self {
        Self { target, sums: vec![None; voxels] }
    }

    /// Adds empty voxels, up to `voxels` of them.
    pub(super) fn resize(&mut self, voxels: usize) {
        self.sums.resize(voxels, None);
    }

    /// Learns from the samples of a chunk.
    pub(super) fn observe(&mut self, told: &Told) {
        let squares = self.target != Target::Radiance;
        self.sums.par_iter_mut().enumerate().for_each(|(v, sums)| {
            let sphere = &told.spheres[v].learned;
            let mut add = |kind: usize, seen: Carried, value: f64| {
                let sums = sums.get_or_insert_with(|| Box::new([[0.0; CELLS]; 2]));
                sums[kind][cell(seen.direction)] += if value.is_finite() { value } else { 0.0 };
            };
            for record in told.samples.directed(v).filter(|_| told.paths) {
                let seen = sphere.to_centre(record.point, record.direction);
                let value = f64::from(told.learned.value(record));
                // A density g over ω' is g·dω'/dω over ω: (g·dω'/dω)²·dω = g²·dω'/dω·dω'.
                add(0, seen, if squares { value * value / f64::from(seen.density) } else { value });
            }
            for record in told.samples.photons(v) {
                add(1, sphere.to_centre(record.point, record.direction), f64::from(record.power));
            }
        });
    }

    /// Histograms to sample next, one per voxel; none for a voxel that no sample has reached, nor for those that contribute least
    /// where all together would exceed `memory` bytes.
    pub(super) fn fit(&self, around: &Around, memory: usize) -> Vec<Option<Histogram>> {
        let arrived = |v: &usize| self.sums[*v].as_ref().is_some_and(|sums| !is_empty(sums));
        let mut order: Vec<usize> = (0..self.sums.len()).filter(arrived).collect();
        order.sort_by(|&a, &b| around.contributions[b].total_cmp(&around.contributions[a]).then(a.cmp(&b)));
        let mut kept = vec![false; self.sums.len()];
        order.iter().take(memory / BYTES).for_each(|&v| kept[v] = true);
        let fit =
            |(sums, kept): (&Option<Box<Sums>>, bool)| sums.as_deref().filter(|_| kept).and_then(|s| self.made_of(s));
        self.sums.par_iter().zip(kept).map(fit).collect()
    }

    fn made_of(&self, [paths, photons]: &Sums) -> Option<Histogram> {
        let paths = normalised(paths.map(|sum| self.target.weight(sum, SOLID_ANGLE)));
        let mass = match (paths, normalised(*photons)) {
            (Some(a), Some(b)) => std::array::from_fn(|i| PATH_SHARE * a[i] + (1.0 - PATH_SHARE) * b[i]),
            (one, other) => one.or(other)?,
        };
        Some(Histogram::new(mass.map(|mass| ((1.0 - UNIFORM) * mass + UNIFORM / CELLS as f64) as f32)))
    }

    /// Number of cells that samples are counted in.
    pub(super) fn cells(&self) -> usize {
        CELLS * self.sums.iter().flatten().filter(|sums| !is_empty(sums)).count()
    }

    /// Forgets the samples of the iteration. From now on `target` is deposited.
    pub(super) fn clear(&mut self, target: Target) {
        self.target = target;
        self.sums.fill(None);
    }

    /// State of the histograms, as arrays of a file: `histogram_sums` [V, sums of path samples and of photons].
    pub(super) fn arrays<'a>(&self) -> Vec<Tensor<'a>> {
        let none = [[0.0; CELLS]; 2];
        let sums = self.sums.iter().flat_map(|sums| sums.as_deref().copied().unwrap_or(none)).flatten();
        let bytes: Vec<u8> = sums.flat_map(f64::to_le_bytes).collect();
        vec![("histogram_sums".into(), Dtype::F64, vec![self.sums.len(), 2 * CELLS], bytes.into())]
    }

    /// Reads the histograms of `count` voxels that [`Histograms::arrays`] wrote.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) naming the tensor.
    pub(super) fn from_arrays(target: Target, count: usize, file: &Tensors) -> Result<Self> {
        let rows = file.read("histogram_sums", Dtype::F64, Some(count), 2 * CELLS, f64::from_le_bytes)?;
        if rows.iter().any(|sum| !(*sum >= 0.0 && sum.is_finite())) {
            return file.fail("histogram_sums", "sums that are negative or not finite");
        }
        let sums = rows.as_chunks::<CELLS>().0.as_chunks::<2>().0.iter();
        Ok(Self { target, sums: sums.map(|sums| (!is_empty(sums)).then(|| Box::new(*sums))).collect() })
    }
}

/// The cell of a direction as seen from the centre.
fn cell(direction: Vec3) -> usize {
    let [x, y] = cylindrical::to_square(direction);
    let at = |place: f64, side: usize| ((place * side as f64) as usize).min(side - 1);
    at(y, SIDES[1]) * SIDES[0] + at(x, SIDES[0])
}

/// Masses with the sum 1, proportional to `sums`; none where the total is not positive and finite.
fn normalised(sums: [f64; CELLS]) -> Option<[f64; CELLS]> {
    let total: f64 = sums.iter().sum();
    (total > 0.0 && total.is_finite()).then(|| sums.map(|sum| sum / total))
}
