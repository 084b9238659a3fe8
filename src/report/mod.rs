//! Comparisons of methods: error over time and samples, measured and shown on a page; and pictures of guiding fields (`inspect`).
//!
//! `experiment` renders and measures, `analysis` summarises, `results` is the file of results, `plot`, `guides` and `page` show it.

pub mod analysis;
mod denoising;
pub mod experiment;
pub mod guides;
pub mod inspect;
pub mod page;
pub mod plot;
pub mod results;

pub use experiment::{Comparison, Experiment, Method};
pub use results::{Budget, Results};
