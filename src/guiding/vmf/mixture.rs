//! The frozen mixture of a voxel, which is sampled.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use super::MOST;
use super::columns::{Aimed, Asked, Block, aimed, density};
use super::lobe::{COSINE_KAPPA, LEAST_KAPPA, Lobe, MOST_KAPPA, around_pole};
use crate::math::lanes::{LANES, vector};
use crate::math::{Frame, cylindrical};

/// Part of the uniform sphere, which keeps every density positive.
pub const UNIFORM: f64 = 0.05;

/// Largest number below 1.
const BELOW_ONE: f64 = 1.0 - f64::EPSILON / 2.0;

/// A place where directions are asked for.
#[derive(Debug, Clone, Copy)]
pub struct Spot {
    /// World position.
    pub point: Vec3,
    /// Normal of a surface that reflects light alone, on the side that is looked at; zero for others, and where directions are wanted by
    /// the light alone.
    pub normal: Vec3,
}

/// A mixture of lobes, with a uniform part.
#[derive(Debug, Clone, PartialEq)]
pub struct VmfMixture {
    blocks: Box<[Block]>,
    count: usize,
    pivot: Vec3,
    /// Whether the lobes are of radiance, which is multiplied with the cosine where it is sampled.
    of_radiance: bool,
}

impl VmfMixture {
    /// A mixture of one to [`MOST`] lobes around `pivot`, whose weights have the sum 1 to a thousandth. Where they are of radiance they
    /// are multiplied with the cosine at the surface that is sampled.
    ///
    /// # Errors
    /// A sentence saying what is no such lobe.
    pub fn new(lobes: &[Lobe], pivot: Vec3, of_radiance: bool) -> Result<Self, String> {
        if lobes.is_empty() || lobes.len() > MOST {
            return Err(format!("{} lobes, expected 1 to {MOST}", lobes.len()));
        }
        if let Some(bad) = lobes.iter().position(|lobe| !is_sound(lobe)) {
            return Err(format!("lobe {bad} has numbers out of range: {:?}", lobes[bad]));
        }
        let total: f64 = lobes.iter().map(|lobe| f64::from(lobe.weight)).sum();
        if (total - 1.0).abs() > 1e-3 {
            return Err(format!("weights with the sum {total} instead of 1"));
        }
        if !pivot.is_finite() {
            return Err(format!("the pivot {pivot} is not finite"));
        }
        Ok(Self { blocks: Block::of(lobes), count: lobes.len(), pivot, of_radiance })
    }

    /// The lobes.
    pub fn lobes(&self) -> impl ExactSizeIterator<Item = Lobe> {
        (0..self.count).map(|k| self.blocks[k / LANES].lobe(k % LANES))
    }

    /// The point that mean directions are seen from.
    pub fn pivot(&self) -> Vec3 {
        self.pivot
    }

    /// Whether the lobes are of radiance.
    pub fn is_of_radiance(&self) -> bool {
        self.of_radiance
    }

    /// The pivot, without a surface.
    pub fn at_pivot(&self) -> Spot {
        Spot { point: self.pivot, normal: Vec3::ZERO }
    }

    fn asked(&self, spot: &Spot) -> Asked {
        let normal = if self.of_radiance { spot.normal } else { Vec3::ZERO };
        Asked { offset: self.pivot - spot.point, normal }
    }

    /// Direction at `spot` that a point of the unit square maps to, and its density w.r.t. solid angle. Points that are evenly spread
    /// stay so within each lobe.
    pub fn sample(&self, [u, v]: [f64; 2], spot: &Spot) -> (Vec3, f32) {
        let asked = self.asked(spot);
        let aimed = aimed(&self.blocks, asked);
        let direction = if u < UNIFORM {
            cylindrical::to_direction([u / UNIFORM, v])
        } else {
            self.drawn([((u - UNIFORM) / (1.0 - UNIFORM)).min(BELOW_ONE), v], &aimed, asked.normal)
        };
        (direction, self.mixed(&aimed, asked, direction))
    }

    /// Density of [`VmfMixture::sample`] at `spot`, w.r.t. solid angle. Never zero.
    pub fn pdf(&self, direction: Vec3, spot: &Spot) -> f32 {
        let asked = self.asked(spot);
        self.mixed(&aimed(&self.blocks, asked), asked, direction)
    }

    fn mixed(&self, aimed: &Aimed, asked: Asked, direction: Vec3) -> f32 {
        (UNIFORM / (4.0 * PI)) as f32 + (1.0 - UNIFORM) as f32 * density(&self.blocks, aimed, asked, direction)
    }

    /// The direction of a point of the unit square under the lobes alone.
    fn drawn(&self, [u, v]: [f64; 2], aimed: &Aimed, normal: Vec3) -> Vec3 {
        let share = |k: usize| f64::from(aimed.shares[k / LANES][k % LANES]);
        let total: f64 = (0..self.count).map(share).sum();
        let (mut left, mut chosen) = (u * total, 0);
        for k in (0..self.count).filter(|&k| share(k) > 0.0) {
            chosen = k;
            if left < share(k) {
                break;
            }
            left -= share(k);
        }
        let within = (left / share(chosen)).clamp(0.0, BELOW_ONE);
        let mean = vector(&aimed.means[chosen / LANES], chosen % LANES);
        let kappa = f64::from(self.blocks[chosen / LANES].lobe(chosen % LANES).kappa);
        let both = kappa * mean.as_dvec3() + COSINE_KAPPA * normal.as_dvec3();
        let (axis, kappa) = if normal == Vec3::ZERO { (mean, kappa) } else { axis(both, mean) };
        let around = around_pole(kappa.max(LEAST_KAPPA), [within, v]);
        let frame = Frame::new(axis);
        let [s, t, n] = [frame.s, frame.t, frame.n].map(|of| of.as_dvec3());
        (s * around.x + t * around.y + n * around.z).normalize_or(n).as_vec3()
    }

    /// Bytes in use.
    pub fn bytes(&self) -> usize {
        size_of::<Self>() + size_of_val(&*self.blocks)
    }

    /// Number of lobes.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there are none, which is never.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Bytes of a mixture of so many lobes.
    pub(super) fn bytes_of(lobes: usize) -> usize {
        size_of::<Self>() + lobes.div_ceil(LANES) * size_of::<Block>()
    }
}

/// Direction and length of a vector; that of `other` where it has none.
fn axis(of: DVec3, other: Vec3) -> (Vec3, f64) {
    let length = of.length();
    if length > LEAST_KAPPA { ((of / length).as_vec3(), length) } else { (other, LEAST_KAPPA) }
}

/// Whether a lobe has a density.
fn is_sound(lobe: &Lobe) -> bool {
    let within = (0.5 * LEAST_KAPPA as f32..=1.001 * MOST_KAPPA as f32).contains(&lobe.kappa);
    (lobe.mean.length_squared() - 1.0).abs() < 1e-4
        && within
        && (0.0..=1.001).contains(&lobe.weight)
        && lobe.nearness >= 0.0
        && lobe.nearness.is_finite()
}
