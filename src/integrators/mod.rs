//! Light transport: the path tracer, the photon tracer, paths that follow kept ones, the sites where their paths scatter, and the mixture of BSDF and guide.

mod alike;
pub mod block;
pub mod guided;
mod kept;
pub mod mixture;
pub mod path;
pub mod photon;
pub mod site;

use crate::guiding::sample::field::GuideField;

/// Settings of light transport that the path tracer and the photon tracer share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TransportSettings {
    /// Largest depth of a path: 1 = emission only, 2 = direct light, n = n-1 bounces.
    pub max_depth: u32,
    /// Whether lights are sampled (next event estimation).
    pub light_sampling: bool,
    /// Russian roulette.
    pub roulette: Roulette,
    /// Whether paths collide with media where the guide expects light.
    pub guided_distances: bool,
}

/// Rules of Russian roulette.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Roulette {
    /// No roulette: paths end only where nothing is left of them.
    Off,
    /// By the path's throughput; without a guide over the pixel's value, where that is known.
    Throughput,
    /// By the expected contribution of the path, light sampling too; where no voxel tells, by its throughput times what vertices usually send
    /// back over the pixel's value.
    Window,
}

impl Roulette {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Throughput => "throughput",
            Self::Window => "window",
        }
    }

    /// Whether it is played at vertex number `depth` by what paths carry.
    fn plays(self, depth: u32) -> bool {
        self != Self::Off && depth >= ROULETTE_START
    }

    /// Radiance that vertices usually send back, if it goes by that and `field` knows it.
    fn usual(self, field: Option<&GuideField>) -> Option<f32> {
        field.filter(|_| self == Self::Window).and_then(GuideField::usual_radiance)
    }
}

/// First vertex, counted from the camera's, at which what a path carries may end it.
const ROULETTE_START: u32 = 4;

/// Highest probability of surviving roulette by what a path carries: even one without loss must end.
const ROULETTE_MOST: f32 = 0.95;
