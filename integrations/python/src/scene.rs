//! Scenes in memory.

use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::Arc;

use fanal::cli::args::{Command, PlanArgs};
use fanal::cli::commands::in_pool;
use fanal::scene::overrides::decide;
use fanal::scene::plan::plan;
use fanal::scene::readers::{LoadedScene, load_by};
use pyo3::prelude::*;

use crate::watch::{Interrupted, Watched, watched};
use crate::words::{json, other_command, parsed};

/// A scene that was read, with the options that it was read with.
#[pyclass(frozen, module = "fanal._fanal")]
pub struct Scene {
    pub loaded: Arc<LoadedScene>,
    args: PlanArgs,
}

/// Reads a scene. `words` are options of `fanal plan`.
#[pyfunction]
pub fn load(py: Python<'_>, path: PathBuf, words: Vec<OsString>) -> PyResult<Scene> {
    let Command::Plan(args) = parsed("plan", words, path)? else {
        return Err(other_command());
    };
    let given = args.clone();
    let read = move |_: &Watched| in_pool(&given.common, || load_by(&given.scene, &given.how()));
    let loaded = watched(py, &Arc::default(), None, Interrupted::IsLeft, read)?;
    Ok(Scene { loaded: Arc::new(loaded), args })
}

impl Scene {
    /// The path that it was read from, as given.
    pub fn path_given(&self) -> PathBuf {
        self.args.scene.clone()
    }
}

#[pymethods]
impl Scene {
    #[getter]
    fn path(&self) -> PathBuf {
        self.path_given()
    }

    #[getter]
    fn name(&self) -> &str {
        &self.loaded.file.name
    }

    #[getter]
    fn size(&self) -> (u32, u32) {
        let film = &self.loaded.file.film;
        (film.width, film.height)
    }

    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.loaded.warnings.clone()
    }

    #[getter]
    fn missing_files(&self) -> Vec<String> {
        self.loaded.missing.clone()
    }

    #[getter]
    fn skipped_triangles(&self) -> usize {
        self.loaded.skipped_triangles
    }

    /// The effect plan as JSON.
    fn plan(&self) -> PyResult<String> {
        let mut plan = plan(&self.loaded.file);
        decide(&mut plan, &self.args.effects);
        json(&plan)
    }
}
