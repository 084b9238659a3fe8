//! Long work on a thread of its own, while the calling thread looks after Python: signals and the progress callback.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use fanal::base::{Error, Progress, Result};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyBool;

use crate::errors::{broken, raised};

/// Time between two looks at signals.
const LOOK: Duration = Duration::from_millis(50);
/// Least time between two calls of the callback.
const TELL: Duration = Duration::from_millis(250);

/// What the working and the watching thread have in common.
#[derive(Default)]
pub struct Watched {
    /// Asks the work to end early.
    pub stop: AtomicBool,
    done: AtomicU64,
    told: Mutex<Told>,
}

/// State of the work, apart from the count.
#[derive(Debug, Default, Clone)]
struct Told {
    total: u64,
    part: Option<f64>,
    message: String,
    reached: String,
}

impl Watched {
    fn told(&self) -> Told {
        // Whatever a thread left there when it panicked can be told.
        self.told.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn tell(&self, change: impl FnOnce(&mut Told)) {
        change(&mut self.told.lock().unwrap_or_else(PoisonError::into_inner));
    }
}

impl Progress for Watched {
    fn start(&self, total: u64, _: &str) {
        self.done.store(0, Ordering::Relaxed);
        self.tell(|told| *told = Told { total, ..Told::default() });
    }

    fn advance(&self, n: u64) {
        self.done.fetch_add(n, Ordering::Relaxed);
    }

    fn message(&self, text: &str) {
        self.tell(|told| text.clone_into(&mut told.message));
    }

    fn reached(&self, part: Option<f64>, what: &str) {
        self.tell(|told| {
            told.part = part;
            what.clone_into(&mut told.reached);
        });
    }

    fn finish(&self) {}
}

/// The callback, with the moments that it is called at.
struct Callback {
    function: Py<PyAny>,
    begun: Instant,
    last: Option<Instant>,
}

impl Callback {
    fn is_due(&self) -> bool {
        self.last.is_none_or(|last| last.elapsed() >= TELL)
    }

    /// Calls it with fraction, samples, seconds, what is being done and what is reached; `False` asks the work to end early.
    fn call(&mut self, py: Python<'_>, watched: &Watched, ended: bool) -> PyResult<()> {
        self.last = Some(Instant::now());
        let Told { total, part, message, reached } = watched.told();
        let done = watched.done.load(Ordering::Relaxed);
        let counted = (total > 0).then(|| done as f64 / total as f64);
        let fraction = if ended { Some(1.0) } else { part.or(counted).map(|part| part.clamp(0.0, 1.0)) };
        let seconds = self.begun.elapsed().as_secs_f64();
        let answer = self.function.call1(py, (fraction, done, seconds, message, reached))?;
        let answer = answer.bind(py);
        if (answer.is_exact_instance_of::<PyBool>() || is_numpy_bool(answer)) && !answer.is_truthy()? {
            watched.stop.store(true, Ordering::Relaxed);
        }
        Ok(())
    }
}

/// Whether it is a truth value of NumPy, which comparisons of its numbers give.
fn is_numpy_bool(answer: &Bound<'_, PyAny>) -> bool {
    let name = answer.get_type().fully_qualified_name();
    name.is_ok_and(|name| matches!(&*name.to_string(), "numpy.bool" | "numpy.bool_"))
}

/// What becomes of work whose caller was interrupted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interrupted {
    /// It heeds the stop flag: its end is waited for, unless there is another interruption.
    Stops,
    /// Nothing stops it: its result is dropped when it is there.
    IsLeft,
}

/// Does `work` without Python's lock. Meanwhile signals are handled and `progress` is called about four times per second, and once at the
/// end; an exception of either asks the work to stop, and is raised.
pub fn watched<T: Send + 'static>(
    py: Python<'_>,
    shared: &Arc<Watched>,
    progress: Option<Py<PyAny>>,
    interrupted: Interrupted,
    work: impl FnOnce(&Watched) -> Result<T> + Send + 'static,
) -> PyResult<T> {
    let begun = Instant::now();
    let mut callback = progress.map(|function| Callback { function, begun, last: None });
    let (send, receive) = channel();
    let given = Arc::clone(shared);
    let worker = move || {
        // The receiver is gone where the caller was interrupted.
        let _ = send.send(work(&given));
    };
    thread::Builder::new()
        .name("fanal".into())
        .spawn(worker)
        .map_err(|error| PyRuntimeError::new_err(format!("no thread could be started: {error}")))?;
    let look = move || {
        let mut failed = None;
        let result = loop {
            match receive.recv_timeout(LOOK) {
                Ok(result) => break result.map_err(|error: Error| raised(&error)),
                Err(RecvTimeoutError::Disconnected) => break Err(broken()),
                Err(RecvTimeoutError::Timeout) => {}
            }
            if failed.is_none() {
                failed = Python::attach(|py| look(py, callback.as_mut(), shared)).err();
                if failed.is_some() {
                    shared.stop.store(true, Ordering::Relaxed);
                }
            } else if Python::attach(|py| py.check_signals()).is_err()
                && let Some(error) = failed
            {
                // Asked again: who waits no longer leaves the work to itself.
                return Err(error);
            }
            if interrupted == Interrupted::IsLeft
                && let Some(error) = failed
            {
                return Err(error);
            }
        };
        if let Some(error) = failed {
            return Err(error);
        }
        let result = result?;
        Python::attach(|py| {
            py.check_signals()?;
            let ended = !shared.stop.load(Ordering::Relaxed);
            callback.map_or(Ok(()), |mut callback| callback.call(py, shared, ended))
        })?;
        Ok(result)
    };
    py.detach(look)
}

/// Handles signals, and calls the callback where that is due.
fn look(py: Python<'_>, callback: Option<&mut Callback>, shared: &Watched) -> PyResult<()> {
    py.check_signals()?;
    callback.filter(|callback| callback.is_due()).map_or(Ok(()), |callback| callback.call(py, shared, false))
}
