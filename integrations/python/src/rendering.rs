//! Rendering.

use std::ffi::OsString;
use std::sync::Arc;
use std::time::{Duration, Instant};

use fanal::base::{Error, Result};
use fanal::cli::args::{Command, RenderArgs};
use fanal::cli::commands::in_pool;
use fanal::cli::commands::render::{Prepared, check_files};
use fanal::cli::resolve::resolve;
use fanal::cli::views;
use fanal::picture::{Channel, Window};
use fanal::render::Outcome;
use fanal::scene::readers::LoadedScene;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::guide::Guide;
use crate::pictures::array;
use crate::scene::Scene;
use crate::watch::{Interrupted, Watched, watched};
use crate::words::{json, other_command, parsed};

/// What a render leaves.
struct Rendered {
    outcome: Outcome,
    channels: Vec<Channel>,
    /// Columns and rows of the whole picture.
    size: [u32; 2],
    window: Window,
}

/// Renders a scene, which took `reading` seconds to read, with options `words` of `fanal render`. Evidence for guide files is kept where
/// `keeps_guide`.
///
/// Returns a dictionary: `image`; `channels`, each with its name; `statistics` as JSON; `guide`; `interrupted`; `unkept`; `size`; `window`.
#[pyfunction]
pub fn render<'py>(
    py: Python<'py>,
    scene: &Scene,
    words: Vec<OsString>,
    progress: Option<Py<PyAny>>,
    keeps_guide: bool,
    reading: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let words = [OsString::from("--output=none.exr")].into_iter().chain(words).collect();
    let Command::Render(args) = parsed("render", words, scene.path_given())? else {
        return Err(other_command());
    };
    let loaded = LoadedScene::clone(&scene.loaded);
    let shared = Arc::new(Watched::default());
    let started = Duration::try_from_secs_f64(reading).ok().and_then(|reading| Instant::now().checked_sub(reading));
    let job = Job { loaded, started: started.unwrap_or_else(Instant::now), keeps_guide };
    let work = move |watched: &Watched| in_pool(&args.common, || rendered(&args, job, watched));
    let Rendered { mut outcome, channels, size, window } = watched(py, &shared, progress, Interrupted::Stops, work)?;
    outcome.statistics.seconds.load = reading;
    let made = PyDict::new(py);
    let shape = [outcome.image.height, outcome.image.width];
    let channel = |Channel { name, values }| Ok((name, PyArray1::from_vec(py, values).reshape(shape)?));
    made.set_item("channels", channels.into_iter().map(channel).collect::<PyResult<Vec<_>>>()?)?;
    made.set_item("image", array(py, &outcome.image)?)?;
    made.set_item("statistics", json(&outcome.statistics)?)?;
    made.set_item("interrupted", outcome.interrupted)?;
    made.set_item("unkept", outcome.unkept)?;
    made.set_item("size", (size[0], size[1]))?;
    made.set_item("window", (window.x, window.y, window.width, window.height))?;
    made.set_item("guide", Guide::of(outcome.field, outcome.evidence))?;
    Ok(made)
}

/// What is rendered, beside the options.
struct Job {
    loaded: LoadedScene,
    /// Moment from which `--time` is counted.
    started: Instant,
    keeps_guide: bool,
}

/// Renders on the threads of the current pool, as `fanal render` does.
fn rendered(args: &RenderArgs, job: Job, watched: &Watched) -> Result<Rendered> {
    check_files(args)?;
    let Job { mut loaded, started, keeps_guide } = job;
    views::select(&args.of, &mut loaded)?;
    let mut request = resolve(args, &loaded.file)?;
    if request.views.len() > 1 {
        return Err(Error::Options("one picture at a time: choose a camera".into()));
    }
    request.settings.learner.keeps_evidence |= keeps_guide;
    loaded.file.render.max_depth = request.settings.transport.max_depth;
    let mut prepared = Prepared::new(&request, &loaded)?;
    prepared.end_in_time(&request, started, None, false)?;
    let window = prepared.settings.window(request.size);
    let (outcome, channels) = prepared.render(&request, &loaded, watched, &watched.stop, None)?;
    Ok(Rendered { outcome, channels, size: request.size, window })
}
