//! Pictures in memory, on disk and in viewers, shared by films, textures, environments and reports.

mod address;
pub mod cryptomatte;
mod image;
mod live;
mod output;
mod read;
mod read_exr;
mod read_pfm;
mod samples;
mod texels;
pub mod texture;
mod view;
mod window;
mod write_exr;
pub mod write_png;

pub use address::Address;
pub use image::Image;
pub use live::{Canvas, LiveView, Viewer};
pub use output::{check_folder, check_writable, is_png, write, write_or_rescue, write_picture};
pub use read::{read_image, read_samples, read_texels};
pub use read_exr::{Channels, read_exr_channels};
pub use samples::{Samples, Values};
pub use texels::{ByteImage, HalfImage, Texels, WordImage};
pub use view::{Display, View};
pub use window::{Placed, Window, matched, window_of};
pub use write_exr::{Attribute, Channel, Layers, Picture, is_name};

/// Largest picture file in bytes.
pub const LARGEST_FILE: u64 = 2 << 30;
/// Most pixels of a picture.
const MOST_PIXELS: u64 = 1 << 27;
