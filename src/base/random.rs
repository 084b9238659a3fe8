//! Random numbers keyed by (seed, stream, index, dimension), so that a picture does not depend on how work is scheduled.
//!
//! The first numbers of a camera path are points of scrambled Sobol' sequences, whose samples of a pixel spread more evenly than
//! independent ones; the others, and all of a light path, are independent.

use super::sobol;

/// A counter-based generator: the `d`-th number of a key is a pure function of both.
///
/// The output function is SplitMix64 (Steele, Lea, Flood 2014), whose state sequence is a counter times an odd constant; the
/// start of the sequence is a hash of the key, so distinct keys read distant parts of the period.
#[derive(Debug, Clone)]
pub struct Random {
    state: u64,
    /// Where there are any, the sequences that the next numbers come from.
    sequence: Option<Sequence>,
}

/// A place in a family of sequences, one per dimension.
#[derive(Debug, Clone, Copy)]
struct Sequence {
    /// Tells apart the families.
    key: u64,
    /// Number of the point.
    index: u32,
    /// The next dimension.
    dimension: u32,
    /// The first that this vertex may not use.
    end: u32,
}

/// Dimensions that each vertex of a path has to itself: lights, the choice of a lobe and a direction, roulette. What takes more,
/// like a ray through many holes, goes on with independent numbers.
const PER_VERTEX: u32 = 12;
/// Vertices with dimensions of their own. What is scattered more often is so mixed that sequences gain nothing.
const VERTICES: u32 = 6;

const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;

fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

impl Random {
    /// The generator of sample `index` in `stream` (for a camera path: the pixel) under `seed`.
    pub fn new(seed: u64, stream: u64, index: u64) -> Self {
        let a = mix(seed.wrapping_add(GOLDEN));
        let b = mix(a ^ stream.wrapping_mul(0xD134_2543_DE82_EF95).wrapping_add(GOLDEN));
        Self { state: mix(b ^ index.wrapping_mul(0xAF25_1AF3_B0F0_25B5).wrapping_add(GOLDEN)), sequence: None }
    }

    /// The same, with the first numbers from point `point` of the sequences of `family`.
    pub fn in_sequences(self, family: u64, point: u32) -> Self {
        let sequence = Sequence { key: mix(family.wrapping_add(GOLDEN)), index: point, dimension: 0, end: PER_VERTEX };
        Self { sequence: Some(sequence), ..self }
    }

    /// Begins vertex `depth` of a path, counted from 1: its numbers come from the same dimensions in every path, whatever the
    /// vertices before took.
    pub fn begin_vertex(&mut self, depth: u32) {
        if depth > VERTICES {
            self.sequence = None;
        } else if let Some(sequence) = &mut self.sequence {
            sequence.dimension = depth * PER_VERTEX;
            sequence.end = sequence.dimension + PER_VERTEX;
        }
    }

    /// Leaves out the next number.
    #[inline(always)]
    pub fn skip(&mut self) {
        match self.sequence.as_mut().filter(|sequence| sequence.dimension < sequence.end) {
            Some(sequence) => sequence.dimension += 1,
            None => self.state = self.state.wrapping_add(GOLDEN),
        }
    }

    /// The next point of the plane from the sequences, if there are any left. Where one coordinate is enough, the compiler leaves
    /// the other out.
    #[inline(always)]
    fn next_point(&mut self) -> Option<[u32; 2]> {
        let sequence = self.sequence.as_mut().filter(|sequence| sequence.dimension < sequence.end)?;
        let seed = mix(sequence.key.wrapping_add(GOLDEN.wrapping_mul(u64::from(sequence.dimension))));
        sequence.dimension += 1;
        Some(sobol::point(sequence.index, seed))
    }

    /// A number that tells this generator's key apart from others.
    pub fn key(&self) -> u64 {
        self.state
    }

    /// The next 64 uniform bits, independent of all others.
    pub fn next_u64(&mut self) -> u64 {
        self.state = self.state.wrapping_add(GOLDEN);
        mix(self.state)
    }

    /// Uniform in [0, 1), a multiple of 2⁻²⁴.
    #[inline(always)]
    pub fn next_f32(&mut self) -> f32 {
        if let Some([x, _]) = self.next_point() {
            return unit(x);
        }
        (self.next_u64() >> 40) as f32 * (1.0 / 16_777_216.0)
    }

    /// Uniform in [0, 1), a multiple of 2⁻⁵³, or of 2⁻³² where it comes from a sequence.
    #[inline(always)]
    pub fn next_f64(&mut self) -> f64 {
        if let Some([x, _]) = self.next_point() {
            return f64::from(x) * (1.0 / 4_294_967_296.0);
        }
        (self.next_u64() >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
    }

    /// Two uniform numbers in [0, 1), independent or a point of a sequence of the plane.
    #[inline(always)]
    pub fn next_2d(&mut self) -> [f32; 2] {
        if let Some(point) = self.next_point() {
            return point.map(unit);
        }
        let bits = self.next_u64();
        [(bits >> 40) as f32, ((bits >> 8) & 0xFF_FFFF) as f32].map(|x| x * (1.0 / 16_777_216.0))
    }

    /// Uniform integer in [0, n); `n` must not be 0.
    pub fn below(&mut self, n: u32) -> u32 {
        ((u128::from(self.next_u64()) * u128::from(n)) >> 64) as u32
    }

    /// Uniform in [low, high).
    pub fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.next_f32()
    }
}

/// The upper 24 bits as a number in [0, 1).
fn unit(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// χ² over 256 cells for consecutive numbers, consecutive streams and consecutive indices; false alarm 1e-4 each.
    #[test]
    fn uniform_along_every_key() {
        let n = 1 << 18;
        let sequences: [Box<dyn Fn(u64) -> f32>; 3] = [
            Box::new(|i| {
                let mut r = Random::new(1, 2, 3);
                r.state = r.state.wrapping_add(GOLDEN.wrapping_mul(i));
                r.next_f32()
            }),
            Box::new(|i| Random::new(1, i, 3).next_f32()),
            Box::new(|i| Random::new(1, 2, i).next_f32()),
        ];
        for draw in &sequences {
            let mut counts = [0u32; 256];
            (0..n).for_each(|i| counts[(draw(i) * 256.0) as usize] += 1);
            let expected = n as f64 / 256.0;
            let chi2: f64 = counts.iter().map(|&c| (f64::from(c) - expected).powi(2) / expected).sum();
            // 255 degrees of freedom: the 1 - 1e-4 quantile is 347.7.
            assert!(chi2 < 347.7, "{chi2}");
        }
    }

    #[test]
    fn skipping_leaves_one_out() {
        let independent = Random::new(1, 2, 3);
        let within = independent.clone().in_sequences(4, 5);
        for start in [independent, within] {
            let (mut drawn, mut skipped) = (start.clone(), start);
            for _ in 0..2 * PER_VERTEX {
                drawn.next_f64();
                skipped.skip();
                assert_eq!(drawn.next_2d(), skipped.next_2d());
            }
        }
    }

    #[test]
    fn keys_are_not_interchangeable() {
        assert_ne!(Random::new(1, 2, 3).next_u64(), Random::new(1, 3, 2).next_u64());
        assert_ne!(Random::new(2, 1, 3).next_u64(), Random::new(1, 2, 3).next_u64());
    }
}
