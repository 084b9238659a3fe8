//! Lobes of a mixture in columns of sixteen, and what is asked of all of them at once: densities, lobes aimed from a point, products with
//! the cosine. Formulas are written once and run in lanes, or one by one with the same bits.

use glam::Vec3;

use super::MOST;
use super::lobe::{COSINE_KAPPA, LEAST_KAPPA, Lobe, peak};
use crate::math::lanes::functions::exp;
use crate::math::lanes::{self, Kernel, LANES, Mask, Real, V3, Vectors, Wide};

/// Largest number of blocks.
pub const BLOCKS: usize = MOST / LANES;
/// A number for each lobe.
pub type Each = [[f32; LANES]; BLOCKS];

/// Sixteen lobes; those behind the last of a mixture have no weight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Block {
    mean: Vectors,
    kappa: [f32; LANES],
    weight: [f32; LANES],
    /// π·C(κ).
    scale: [f32; LANES],
    nearness: [f32; LANES],
}

impl Block {
    const NONE: Self = Self {
        mean: [[0.0; LANES], [0.0; LANES], [1.0; LANES]],
        kappa: [1.0; LANES],
        weight: [0.0; LANES],
        scale: [0.0; LANES],
        nearness: [0.0; LANES],
    };

    /// Up to sixteen lobes.
    fn new(lobes: &[Lobe]) -> Self {
        let mut block = Self::NONE;
        for (lane, lobe) in lobes.iter().enumerate().take(LANES) {
            [block.mean[0][lane], block.mean[1][lane], block.mean[2][lane]] = lobe.mean.to_array();
            block.kappa[lane] = lobe.kappa;
            block.weight[lane] = lobe.weight;
            block.scale[lane] = (f64::from(lobe.weight) * peak(f64::from(lobe.kappa).max(LEAST_KAPPA))) as f32;
            block.nearness[lane] = lobe.nearness;
        }
        block
    }

    /// Blocks of up to [`MOST`] lobes.
    pub fn of(lobes: &[Lobe]) -> Box<[Self]> {
        lobes.chunks(LANES).take(BLOCKS).map(Self::new).collect()
    }

    /// The lobe in a lane.
    pub fn lobe(&self, lane: usize) -> Lobe {
        Lobe {
            mean: lanes::vector(&self.mean, lane),
            kappa: self.kappa[lane],
            weight: self.weight[lane],
            nearness: self.nearness[lane],
        }
    }

    #[inline(always)]
    fn wide<W: Wide>(&self, wide: W) -> Lobes<W::Real> {
        Lobes {
            mean: wide.load_vectors(&self.mean),
            kappa: wide.load(&self.kappa),
            weight: wide.load(&self.weight),
            scale: wide.load(&self.scale),
            nearness: wide.load(&self.nearness),
        }
    }

    fn one(&self, lane: usize) -> Lobes<f32> {
        let Lobe { mean, kappa, weight, nearness } = self.lobe(lane);
        Lobes { mean: mean.into(), kappa, weight, scale: self.scale[lane], nearness }
    }
}

/// A lobe in each lane.
#[derive(Clone, Copy)]
struct Lobes<R> {
    mean: V3<R>,
    kappa: R,
    weight: R,
    scale: R,
    nearness: R,
}

/// Least squared length of a direction to where a lobe's light starts, in units of its distance.
const LEAST_SQUARED: f32 = 1e-2;

impl<R: Real> Lobes<R> {
    /// The lobes as seen from a point from which the pivot lies at `offset`: aimed at the places where their light starts (Ruppert 2020
    /// §4).
    #[inline(always)]
    fn aimed(self, offset: V3<R>) -> Self {
        let to = self.mean + offset * self.nearness;
        let squared = to.dot(to);
        let far = squared.above(LEAST_SQUARED) & squared.finite();
        let mean = V3::choose(far, to * squared.at_least(LEAST_SQUARED).sqrt().inverse(), self.mean);
        Self { mean, ..self }
    }

    /// π·v(ω). By the distance to the mean direction, which narrow lobes need more digits of than a cosine has.
    #[inline(always)]
    fn density(&self, direction: V3<R>) -> R {
        let off = direction - self.mean;
        self.scale * exp(off.dot(off) * self.kappa * -0.5)
    }

    /// π ∫ v·v_cos dω / (2π C(κ_cos)) for the lobe of the cosine around `normal`: products of lobes are lobes.
    #[inline(always)]
    fn product(&self, normal: V3<R>) -> R {
        const COSINE: f32 = COSINE_KAPPA as f32;
        let cosine = self.mean.dot(normal);
        let both = self.mean * self.kappa + normal * self.kappa.all(COSINE);
        let kappa = both.dot(both).sqrt();
        let more = (cosine * self.kappa * 2.0 + COSINE) * COSINE / (kappa + self.kappa);
        // (1 − exp(−2κ)) / κ
        let flat = kappa.below(0.05);
        let series = ((kappa * (-2.0 / 3.0) + 4.0 / 3.0) * kappa - 2.0) * kappa + 2.0;
        let shrunk = flat.choose(series, exp(kappa * -2.0).rest() / flat.choose(kappa.all(1.0), kappa));
        self.scale * exp(more - COSINE) * shrunk
    }
}

/// Where a mixture is asked for directions.
#[derive(Debug, Clone, Copy)]
pub struct Asked {
    /// From the point to the pivot.
    pub offset: Vec3,
    /// Normal of the surface whose cosine the mixture is multiplied with; zero for none.
    pub normal: Vec3,
}

impl Asked {
    fn has_normal(&self) -> bool {
        self.normal != Vec3::ZERO
    }
}

/// Sum of sixteen numbers.
#[inline(always)]
fn sum(of: &[f32; LANES]) -> f32 {
    let four = |i: usize| (of[i] + of[i + 4]) + (of[i + 8] + of[i + 12]);
    (four(0) + four(2)) + (four(1) + four(3))
}

/// Lobes as seen from a point.
pub struct Aimed {
    /// Mean directions.
    pub means: [Vectors; BLOCKS],
    /// Shares in the product with the cosine, on any scale; the weights where there is none.
    pub shares: Each,
}

/// All lobes seen from a point.
struct Aim<'a> {
    blocks: &'a [Block],
    asked: Asked,
}

impl Aim<'_> {
    fn one_by_one(self) -> Aimed {
        let mut all = Aimed { means: [[[0.0; LANES]; 3]; BLOCKS], shares: [[0.0; LANES]; BLOCKS] };
        for (number, block) in self.blocks.iter().enumerate() {
            for lane in 0..LANES {
                let lobe = block.one(lane).aimed(self.asked.offset.into());
                let share = if self.asked.has_normal() { lobe.product(self.asked.normal.into()) } else { lobe.weight };
                let V3 { x, y, z } = lobe.mean;
                all.shares[number][lane] = share;
                for (axis, value) in [x, y, z].into_iter().enumerate() {
                    all.means[number][axis][lane] = value;
                }
            }
        }
        all
    }
}

impl Kernel for Aim<'_> {
    type Output = Aimed;

    #[inline(always)]
    fn run<W: Wide>(self, wide: W) -> Aimed {
        let like = V3::splat(wide.load(&[0.0; LANES]));
        let (offset, normal) = (like.all(self.asked.offset), like.all(self.asked.normal));
        let mut all = Aimed { means: [[[0.0; LANES]; 3]; BLOCKS], shares: [[0.0; LANES]; BLOCKS] };
        for (number, block) in self.blocks.iter().enumerate() {
            let lobes = block.wide(wide).aimed(offset);
            all.means[number] = wide.store_vectors(lobes.mean);
            let shares = if self.asked.has_normal() { lobes.product(normal) } else { lobes.weight };
            all.shares[number] = wide.store(shares);
        }
        all
    }
}

/// All lobes as seen from a point, with their shares in the product with the cosine.
pub fn aimed(blocks: &[Block], asked: Asked) -> Aimed {
    lanes::run(Aim { blocks, asked }).unwrap_or_else(Aim::one_by_one)
}

/// Density of aimed lobes in a direction, the cosine's part included, w.r.t. solid angle.
pub fn density(blocks: &[Block], aimed: &Aimed, asked: Asked, direction: Vec3) -> f32 {
    let means = &aimed.means;
    let density = total(&Parts { blocks, means: Some(means), direction }.run_widest(), blocks);
    if !asked.has_normal() {
        return density;
    }
    let off = direction - asked.normal;
    let cosine = exp(off.dot(off) * (-0.5 * COSINE_KAPPA as f32));
    density * cosine / (std::f32::consts::TAU * total(&aimed.shares, blocks))
}

/// Sum over the lobes of these blocks.
fn total(of: &Each, blocks: &[Block]) -> f32 {
    of.iter().take(blocks.len()).map(sum).sum()
}

/// The part of each lobe in a density.
struct Parts<'a> {
    blocks: &'a [Block],
    /// Mean directions; none for those from the pivot.
    means: Option<&'a [Vectors; BLOCKS]>,
    direction: Vec3,
}

impl Parts<'_> {
    fn one_by_one(self) -> Each {
        let mut parts = [[0.0; LANES]; BLOCKS];
        for (number, (parts, block)) in parts.iter_mut().zip(self.blocks).enumerate() {
            for (lane, part) in parts.iter_mut().enumerate() {
                let own = block.one(lane);
                let mean = self.means.map_or(own.mean, |means| lanes::vector(&means[number], lane).into());
                *part = Lobes { mean, ..own }.density(self.direction.into());
            }
        }
        parts
    }

    #[inline]
    fn run_widest(self) -> Each {
        lanes::run(self).unwrap_or_else(Parts::one_by_one)
    }
}

impl Kernel for Parts<'_> {
    type Output = Each;

    #[inline(always)]
    fn run<W: Wide>(self, wide: W) -> Each {
        let direction = V3::splat(wide.load(&[0.0; LANES])).all(self.direction);
        let mut parts = [[0.0; LANES]; BLOCKS];
        for (number, block) in self.blocks.iter().enumerate() {
            let mut lobes = block.wide(wide);
            if let Some(means) = self.means {
                lobes.mean = wide.load_vectors(&means[number]);
            }
            parts[number] = wide.store(lobes.density(direction));
        }
        parts
    }
}

/// Weight times density of each lobe in a direction from the pivot, and their sum.
pub fn parts(blocks: &[Block], direction: Vec3) -> (Each, f32) {
    let parts = Parts { blocks, means: None, direction }.run_widest();
    let total = total(&parts, blocks);
    (parts, total)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use crate::math::cylindrical;

    /// Lanes have the bits of lobes one by one, with and without a surface.
    #[test]
    fn lanes_have_the_bits_of_single_lobes() {
        let mut random = Random::new(5, 0, 0);
        let mut direction = || cylindrical::to_direction([random.next_f64(), random.next_f64()]);
        for count in [1, 7, 16, 17, 32] {
            let lobe = |i: usize| Lobe {
                mean: direction(),
                kappa: 10f32.powf(i as f32 / 8.0 - 1.0),
                weight: 1.0 / count as f32,
                nearness: (i % 3) as f32 * 0.3,
            };
            let blocks = Block::of(&(0..count).map(lobe).collect::<Vec<_>>());
            for normal in [Vec3::ZERO, direction()] {
                let (asked, towards) = (Asked { offset: 0.7 * direction(), normal }, direction());
                let single = Aim { blocks: &blocks, asked }.one_by_one();
                let all = aimed(&blocks, asked);
                assert_eq!((all.means, all.shares), (single.means, single.shares));
                for means in [None, Some(&all.means)] {
                    let parts = || Parts { blocks: &blocks, means, direction: towards };
                    assert_eq!(parts().run_widest(), parts().one_by_one());
                }
            }
        }
    }
}
