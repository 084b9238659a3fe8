//! The work behind each command.

pub mod compare;
pub mod dataset;
mod denoised;
pub mod error;
pub mod inspect;
pub mod learn;
pub mod merge;
pub mod part;
pub mod plan;
pub mod render;
pub mod replay;

use super::args::Common;
use super::print;
use crate::base::{Error, Result};
use crate::scene::readers::{How, LoadedScene, load_by};

/// Loads a scene and passes its warnings on.
fn load_scene(path: &std::path::Path, how: &How, common: &Common) -> Result<LoadedScene> {
    let loaded = load_by(path, how)?;
    print::warnings(&loaded.warnings, common.quiet);
    Ok(loaded)
}

/// Does work on as many threads as asked for.
///
/// # Errors
/// [`Error::Options`] where the system gives no threads, and those of the work.
pub fn in_pool<T: Send>(common: &Common, work: impl FnOnce() -> Result<T> + Send) -> Result<T> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(common.threads.map_or(0, usize::from))
        .build()
        .map_err(|e| Error::Options(format!("threads cannot be started: {e}")))?;
    pool.install(work)
}
