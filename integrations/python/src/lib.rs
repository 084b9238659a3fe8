//! The part of the Python package `fanal` that is written in Rust: the module `fanal._fanal`.
//!
//! It takes what the package's Python files have checked and made: words of the command line, and contiguous arrays of `float32`.
//! Arguments become settings where those of the command line do (`fanal::cli::resolve`), so there is one set of names, defaults and limits.

mod errors;
mod guide;
mod pictures;
mod rendering;
mod scene;
mod watch;
mod words;

use std::ffi::OsString;
use std::io::Write;

use fanal::base::pages::LargePages;
use pyo3::prelude::*;

#[global_allocator]
static MEMORY: LargePages = LargePages;

/// Runs the command line `words`, which begins with the program's name, and returns its exit code.
#[pyfunction]
fn main(py: Python<'_>, words: Vec<OsString>) -> u8 {
    py.detach(|| {
        let code = fanal::cli::run(words);
        // Nothing flushes Rust's output when Python ends. With stdout closed there is nobody left to tell.
        let _ = std::io::stdout().flush();
        code
    })
}

#[pymodule]
mod _fanal {
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::guide::{Guide, load_guide};
    #[pymodule_export]
    use super::main;
    #[pymodule_export]
    use super::pictures::{error, read_image, write_image};
    #[pymodule_export]
    use super::rendering::render;
    #[pymodule_export]
    use super::scene::{Scene, load};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
