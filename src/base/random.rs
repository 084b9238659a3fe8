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
    /// Hash of seed, stream and index: the start of the sequence.
    key: u64,
    /// Path vertex that numbers are drawn for, counted from 1; 0 is the camera.
    vertex: u32,
    state: u64,
    /// The Sobol' sequences that the next numbers come from; none where all are independent.
    sequence: Option<Sequence>,
}

/// The purpose of a random number at a path vertex. Drawing for one purpose, or not drawing, changes nothing for the others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Dimension(u32);

impl Dimension {
    /// At the camera: the place on the film.
    pub const FILM: Self = Self(0);
    /// At the camera: the place on the lens.
    pub const LENS: Self = Self(1);
    /// On the segment that leads to the vertex: opacity tests at holes, and the free flight in a medium.
    pub const SEGMENT: Self = Self(0);
    /// The decision whether to sample a light; the numbers behind the first are of collisions on the way to it ([`Random::behind`]).
    pub const CONNECTION: Self = Self(1);
    /// The light that is sampled.
    pub const LIGHT: Self = Self(2);
    /// The point on the light.
    pub const LIGHT_POINT: Self = Self(3);
    /// Whether the BSDF or the guide chooses the direction, and the guide's direction.
    pub const GUIDE: Self = Self(4);
    /// The lobe of a BSDF.
    pub const LOBE: Self = Self(5);
    /// The direction within the lobe.
    pub const DIRECTION: Self = Self(6);
    /// Russian roulette: whether the path goes on.
    pub const ROULETTE: Self = Self(7);
}

/// Number of dimensions of each vertex.
const PER_VERTEX: u32 = 8;
/// Vertices whose first numbers are points of sequences. Light scattered more often is so mixed that sequences gain nothing.
const VERTICES: u32 = 6;
/// Base-2 logarithm of the counters from one dimension to the next: more than are ever drawn for one purpose.
const APART: u32 = 24;

/// A position in a family of sequences, one per dimension.
#[derive(Debug, Clone, Copy)]
struct Sequence {
    /// Hash that identifies the family.
    key: u64,
    /// Index of the point.
    index: u32,
    /// The dimension to be read next.
    dimension: u32,
    /// First dimension not to be read: a purpose that draws more, like a ray through many holes, goes on with independent numbers.
    end: u32,
}

const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;

#[inline(always)]
fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Hashes of a seed, streams and indices. Loops over all, which the compiler turns into vectors.
#[inline(always)]
pub fn keys<const N: usize>(seed: u64, streams: &[u64; N], indices: &[u64; N]) -> [u64; N] {
    let seed = mix(seed.wrapping_add(GOLDEN));
    let mut keys = [0; N];
    for ((key, stream), index) in keys.iter_mut().zip(streams).zip(indices) {
        let stream = mix(seed ^ stream.wrapping_mul(0xD134_2543_DE82_EF95).wrapping_add(GOLDEN));
        *key = mix(stream ^ index.wrapping_mul(0xAF25_1AF3_B0F0_25B5).wrapping_add(GOLDEN));
    }
    keys
}

impl Random {
    /// The generator of sample `index` in `stream` (for a camera path: the pixel) under `seed`.
    pub fn new(seed: u64, stream: u64, index: u64) -> Self {
        let [random] = Self::many(seed, &[stream], &[index]);
        random
    }

    /// [`Random::new`] for many samples.
    #[inline(always)]
    pub fn many<const N: usize>(seed: u64, streams: &[u64; N], indices: &[u64; N]) -> [Self; N] {
        keys(seed, streams, indices).map(|key| Self { key, vertex: 0, state: key, sequence: None })
    }

    /// The same generator, with the first numbers from point `point` of the sequences of `family`.
    pub fn in_sequences(self, family: u64, point: u32) -> Self {
        let [random] = Self::all_in_sequences([self], &[family], &[point]);
        random
    }

    /// [`Random::in_sequences`] for many generators.
    #[inline(always)]
    pub fn all_in_sequences<const N: usize>(all: [Self; N], families: &[u64; N], points: &[u32; N]) -> [Self; N] {
        let mut hashes = [0; N];
        for (hash, family) in hashes.iter_mut().zip(families) {
            *hash = mix(family.wrapping_add(GOLDEN));
        }
        let mut all = all;
        for ((random, key), index) in all.iter_mut().zip(hashes).zip(points) {
            random.sequence = Some(Sequence { key, index: *index, dimension: 0, end: PER_VERTEX });
        }
        all
    }

    /// Begins vertex `depth` of a path, counted from 1.
    pub fn begin_vertex(&mut self, depth: u32) {
        self.vertex = depth;
        if depth > VERTICES {
            self.sequence = None;
        }
    }

    /// The generator of one dimension of this vertex: its numbers are the same whatever else was drawn. The first is a point of a
    /// sequence where there are any, the others are independent.
    #[inline(always)]
    pub fn at(&self, dimension: Dimension) -> Self {
        let number = self.vertex * PER_VERTEX + dimension.0;
        let sequence = self.sequence.map(|of| Sequence { dimension: number, end: number + 1, ..of });
        let state = self.key.wrapping_add(GOLDEN.wrapping_mul(u64::from(number) << APART));
        Self { state, sequence, ..*self }
    }

    /// The generator of one dimension of this vertex without its first number, all independent: for what is drawn once it is known
    /// what the first one decided.
    pub fn behind(&self, dimension: Dimension) -> Self {
        let mut random = self.at(dimension);
        random.sequence = None;
        random.next_u64();
        random
    }

    /// The next 2D point of the sequences, if there are any left. Where one coordinate is enough, the compiler leaves the other
    /// out.
    #[inline(always)]
    fn next_point(&mut self) -> Option<[u32; 2]> {
        let sequence = self.sequence.as_mut().filter(|sequence| sequence.dimension < sequence.end)?;
        let seed = mix(sequence.key.wrapping_add(GOLDEN.wrapping_mul(u64::from(sequence.dimension))));
        sequence.dimension += 1;
        Some(sobol::point(sequence.index, seed))
    }

    /// Hash of seed, stream and index, which identifies this generator.
    pub fn key(&self) -> u64 {
        self.key
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

    /// Two uniform numbers in [0, 1): independent, or a 2D point of a sequence.
    #[inline(always)]
    pub fn next_2d(&mut self) -> [f32; 2] {
        if let Some(point) = self.next_point() {
            return point.map(unit);
        }
        let bits = self.next_u64();
        [(bits >> 40) as f32, ((bits >> 8) & 0xFF_FFFF) as f32].map(|x| x * (1.0 / 16_777_216.0))
    }

    /// Two uniform numbers in [0, 1), multiples of 2⁻⁵³: independent, or a 2D point of a sequence with random lower bits.
    #[inline(always)]
    pub fn next_2d_f64(&mut self) -> [f64; 2] {
        if let Some(point) = self.next_point() {
            return fine(point, self.next_u64());
        }
        [0; 2].map(|_| (self.next_u64() >> 11) as f64 * FINE)
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

/// The first numbers that many generators draw for one purpose, those of [`Random::at`], without a branch for each:
/// made by [`Generators::draw`].
#[derive(Debug, Clone, Copy)]
pub struct Draws<const N: usize> {
    /// 64 bits each: a 2D point of a sequence, or independent.
    bits: [u64; N],
    in_sequences: bool,
}

/// Generators at the same vertex, side by side.
#[derive(Debug, Clone, Copy)]
pub struct Generators<const N: usize> {
    /// Those of the sequences where there are any.
    keys: [u64; N],
    indices: [u32; N],
    vertex: u32,
    in_sequences: bool,
}

impl<const N: usize> Generators<N> {
    /// Of generators at the same vertex, which `of` tells.
    #[inline(always)]
    pub fn new<'a>(of: impl Fn(usize) -> &'a Random) -> Self {
        let (mut keys, mut indices) = ([0; N], [0; N]);
        let in_sequences = of(0).sequence.is_some();
        for lane in 0..N {
            let random = of(lane);
            match &random.sequence {
                Some(sequence) if in_sequences => (keys[lane], indices[lane]) = (sequence.key, sequence.index),
                _ => keys[lane] = random.key,
            }
        }
        Self { keys, indices, vertex: of(0).vertex, in_sequences }
    }

    /// What each, which `of` tells again, draws for `dimension` by [`Random::next_2d_f64`].
    #[inline(always)]
    pub fn fine_points<'a>(&self, of: impl Fn(usize) -> &'a Random, dimension: Dimension) -> [[f64; 2]; N] {
        let (Draws { bits, .. }, mut points) = (self.draw(dimension), [[0.0; 2]; N]);
        let skipped = GOLDEN.wrapping_mul((u64::from(self.vertex * PER_VERTEX + dimension.0) << APART) + 1);
        for lane in 0..N {
            let first = of(lane).key.wrapping_add(skipped);
            points[lane] = if self.in_sequences {
                fine([(bits[lane] >> 32) as u32, bits[lane] as u32], mix(first))
            } else {
                [first, first.wrapping_add(GOLDEN)].map(|state| (mix(state) >> 11) as f64 * FINE)
            };
        }
        points
    }

    /// What each draws for `dimension`. Loops over all, which the compiler turns into vectors.
    #[inline(always)]
    pub fn draw(&self, dimension: Dimension) -> Draws<N> {
        let Self { keys, indices, vertex, in_sequences } = self;
        let (mut bits, number) = (*keys, u64::from(vertex * PER_VERTEX + dimension.0));
        if *in_sequences {
            let turn = GOLDEN.wrapping_mul(number);
            for (bits, index) in bits.iter_mut().zip(indices) {
                let [x, y] = sobol::point(*index, mix(bits.wrapping_add(turn)));
                *bits = u64::from(x) << 32 | u64::from(y);
            }
        } else {
            let skipped = GOLDEN.wrapping_mul((number << APART) + 1);
            for bits in &mut bits {
                *bits = mix(bits.wrapping_add(skipped));
            }
        }
        Draws { bits, in_sequences: *in_sequences }
    }
}

impl<const N: usize> Draws<N> {
    /// As by [`Random::next_2d`].
    #[inline(always)]
    pub fn points(&self) -> [[f32; 2]; N] {
        let mut points = [[0.0; 2]; N];
        for (point, bits) in points.iter_mut().zip(&self.bits) {
            *point = [unit((bits >> 32) as u32), unit(*bits as u32)];
        }
        points
    }

    /// As by [`Random::next_f32`].
    #[inline(always)]
    pub fn numbers(&self) -> [f32; N] {
        let mut numbers = [0.0; N];
        for (number, bits) in numbers.iter_mut().zip(&self.bits) {
            *number = unit((bits >> 32) as u32);
        }
        numbers
    }

    /// As by [`Random::next_f64`].
    #[inline(always)]
    pub fn doubles(&self) -> [f64; N] {
        let mut numbers = [0.0; N];
        for (number, &bits) in numbers.iter_mut().zip(&self.bits) {
            *number = if self.in_sequences {
                (bits >> 32) as f64 * (1.0 / 4_294_967_296.0)
            } else {
                (bits >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
            };
        }
        numbers
    }
}

/// Distance of numbers of 53 bits in [0, 1).
const FINE: f64 = 1.0 / 9_007_199_254_740_992.0;

/// A point of a sequence in [0, 1)², with lower bits of others.
#[inline(always)]
fn fine([x, y]: [u32; 2], bits: u64) -> [f64; 2] {
    let [low, high] = [bits >> 43, (bits >> 22) & 0x1F_FFFF];
    [(x, low), (y, high)].map(|(upper, lower)| (u64::from(upper) << 21 | lower) as f64 * FINE)
}

/// The upper 24 bits as a number in [0, 1).
#[inline(always)]
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

    /// Each dimension of a vertex has numbers of its own, whatever was drawn before.
    #[test]
    fn dimensions_have_numbers_of_their_own() {
        let independent = Random::new(1, 2, 3);
        let within = independent.clone().in_sequences(4, 5);
        for start in [independent, within] {
            let mut seen = std::collections::BTreeSet::new();
            let (mut one, mut other) = (start.clone(), start);
            for depth in 1..2 * VERTICES {
                one.begin_vertex(depth);
                other.begin_vertex(depth);
                for dimension in (0..PER_VERTEX).map(Dimension) {
                    let mut numbers = one.at(dimension);
                    let first = numbers.next_2d();
                    let drawn = [first, numbers.next_2d()].map(|u| u.map(f32::to_bits));
                    assert_eq!(first, other.at(dimension).next_2d());
                    assert!(drawn.into_iter().all(|u| seen.insert(u)));
                    other.next_u64();
                }
            }
        }
    }

    /// Many generators at once draw what each draws alone.
    #[test]
    fn draws_are_those_of_each() {
        for sequences in [false, true] {
            for depth in 1..2 * VERTICES {
                let generators: [Random; 16] = std::array::from_fn(|lane| {
                    let random = Random::new(9, lane as u64, 3);
                    let mut random =
                        if sequences { random.in_sequences(lane as u64 / 3, 7 + lane as u32) } else { random };
                    random.begin_vertex(depth);
                    random
                });
                for dimension in (0..PER_VERTEX).map(Dimension) {
                    let all = Generators::<16>::new(|lane| &generators[lane]);
                    let draws = all.draw(dimension);
                    let at = |lane: usize| generators[lane].at(dimension);
                    assert_eq!(draws.points(), std::array::from_fn(|lane| at(lane).next_2d()));
                    assert_eq!(draws.numbers(), std::array::from_fn(|lane| at(lane).next_f32()));
                    assert_eq!(draws.doubles(), std::array::from_fn(|lane| at(lane).next_f64()));
                    let fine = all.fine_points(|lane| &generators[lane], dimension);
                    assert_eq!(fine, std::array::from_fn(|lane| at(lane).next_2d_f64()));
                }
            }
        }
    }

    #[test]
    fn keys_are_not_interchangeable() {
        assert_ne!(Random::new(1, 2, 3).next_u64(), Random::new(1, 3, 2).next_u64());
        assert_ne!(Random::new(2, 1, 3).next_u64(), Random::new(1, 2, 3).next_u64());
    }
}
