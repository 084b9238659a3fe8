//! Light transport: the path tracer, the photon tracer, and the mixture that guides both decisions of where to go.

pub mod mixture;
#[allow(unsafe_code, reason = "calls of functions for instructions that were found on this processor")]
pub mod path;
pub mod photon;

use crate::guiding::effort::Roulette;

/// What both tracers need to know.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TransportSettings {
    /// 1 = emission only, 2 = direct light, n = n-1 bounces.
    pub max_depth: u32,
    /// Next event estimation.
    pub nee: bool,
    /// Russian roulette.
    pub roulette: Roulette,
}

/// Bounces before roulette may end a path.
const ROULETTE_START: u32 = 4;

/// Highest probability of surviving roulette: even a path without loss must end.
const ROULETTE_MOST: f32 = 0.95;
