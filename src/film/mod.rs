//! Film: samples become passes and pictures; errors of a picture against a reference.

pub mod accumulator;
pub mod adaptive;
pub mod cascade;
pub mod denoise;
pub mod error;
pub mod expected;
pub mod filter;
pub mod fireflies;
pub mod spread;

pub use accumulator::{
    BLOCK, Block, FinishedPass, Pass, Pixel, Sum, Summed, VarianceRatio, check_sheet, check_size, combine,
    combine_sheet, combine_weighted,
};
pub use adaptive::densities;
pub use cascade::Cascade;
pub use denoise::{Denoiser, Features};
pub use error::{Measures, mean_and_variance, measure, measure_noisy, outliers, pixel_error, relative_variance};
pub use expected::{expected_values, over_mean, steady_values};
pub use filter::PixelFilter;
pub use fireflies::{Judge, taken_from_passes, taken_from_sum, without};
pub use spread::{PixelSpread, pixel_spread, spread_of_sum};
