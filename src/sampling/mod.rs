//! Sampling of simple domains. Every `square_to_x` stands beside its `square_to_x_pdf`; the measure is in the function's docs.

pub mod cutpoints;
pub mod discrete;
pub mod grid;
pub mod mis;
pub mod tiles;
pub mod warp;
