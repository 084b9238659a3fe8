//! Film: from samples to pictures, pictures to files, and how far a picture is from a reference.

pub mod accumulator;
pub mod error;
pub mod expected;
pub mod exr;
pub mod filter;
pub mod output;
pub mod png;
pub mod spread;
pub mod window;

pub use accumulator::{FinishedPass, Pass, Pixel, check_size, combine, combine_weighted};
pub use error::{Measures, mean_and_variance, measure, measure_noisy, outliers, pixel_error, relative_variance};
pub use expected::expected_values;
pub use exr::{Channel, Picture};
pub use filter::PixelFilter;
pub use output::{check_folder, check_writable, write, write_or_rescue, write_picture};
pub use spread::{PixelSpread, pixel_spread};
pub use window::{Placed, Window, matched, window_of};
