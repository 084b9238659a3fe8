//! What Open PGL 0.6 learns of samples whose truth is known, beside our own mixture of the same samples. `open_pgl/make.py` asked Open PGL
//! and says what lies in the file.

use fanal::guiding::vmf::fit::{Arrived, LearnedMixture};
use fanal::guiding::vmf::mixture::VmfMixture;
use glam::Vec3;

/// One kind of light.
pub struct Kind {
    /// Our mixture of its samples.
    pub mixture: VmfMixture,
    /// Places in the voxel from which it is looked at.
    pub places: Vec<Place>,
}

/// A place of the voxel.
pub struct Place {
    pub point: Vec3,
    /// Directions that were drawn by the true density.
    pub directions: Vec<Vec3>,
    /// The true density in each, and Open PGL's.
    pub expected: Vec<f32>,
    pub theirs: Vec<f32>,
}

/// Light that starts nearer than this is taken to start there: the half of the voxel's side is 0.1.
const LEAST: f32 = 0.26;

/// All kinds of light in the file.
pub fn kinds() -> Vec<Kind> {
    let mut file = Numbers(include_bytes!("open_pgl/fixture.bin"));
    let [kinds, updates, batch, places, directions] = [0; 5].map(|_| file.bits() as usize);
    let kind = |_| {
        let mut learned = LearnedMixture::default();
        for _ in 0..updates {
            let samples: Vec<Arrived> = (0..batch).map(|_| file.sample()).collect();
            learned.learn(samples.into_iter(), Vec3::ZERO, LEAST);
        }
        let place = |_| Place {
            point: file.vector(),
            directions: (0..directions).map(|_| file.vector()).collect(),
            expected: (0..directions).map(|_| file.number()).collect(),
            theirs: (0..directions).map(|_| file.number()).collect(),
        };
        let places = (0..places).map(place).collect();
        Kind { mixture: learned.frozen(true).expect("light has arrived"), places }
    };
    let all = (0..kinds).map(kind).collect();
    assert!(file.0.is_empty(), "the file has more than it says");
    all
}

/// Numbers of the file, one after the other.
struct Numbers(&'static [u8]);

impl Numbers {
    fn bits(&mut self) -> u32 {
        let (number, rest) = self.0.split_first_chunk().expect("the file is whole");
        self.0 = rest;
        u32::from_le_bytes(*number)
    }

    fn number(&mut self) -> f32 {
        f32::from_bits(self.bits())
    }

    fn vector(&mut self) -> Vec3 {
        Vec3::new(self.number(), self.number(), self.number())
    }

    fn sample(&mut self) -> Arrived {
        let [point, direction] = [self.vector(), self.vector()];
        let [value, pdf, distance] = [self.number(), self.number(), self.number()];
        Arrived { point, direction, distance, value: f64::from(value), pdf }
    }
}
