//! Who watches a render: progress, the wish to stop, the picture while it is made.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::base::Progress;
use crate::materials::image::Image;

/// What a render tells and asks while it runs. Nothing here changes the picture that it ends with.
pub struct Control<'a> {
    /// Told about samples.
    pub progress: &'a dyn Progress,
    /// Set to end early with the picture so far.
    pub stop: &'a AtomicBool,
    /// Shown the picture from time to time.
    pub refresh: Option<Refresh<'a>>,
}

/// Shows the picture while it is made.
pub struct Refresh<'a> {
    /// Least time between two pictures; more where showing one takes more than a twentieth of it.
    pub every: Duration,
    /// Takes the picture.
    pub show: &'a dyn Fn(Snapshot),
}

/// A picture that is still being made.
pub struct Snapshot {
    /// Linear RGB.
    pub image: Image,
    /// Samples per pixel so far, camera and light paths together.
    pub spp: u32,
    /// Wall time so far.
    pub seconds: f64,
}

/// A render's side of [`Control`], with its clock.
pub(super) struct Watcher<'a> {
    pub control: &'a Control<'a>,
    pub started: Instant,
    /// Seconds after which no chunk may begin that would end later.
    pub deadline: Option<f64>,
    chunk_began: Instant,
    shown: Instant,
    /// Time that the last showing took.
    showing: Duration,
}

impl<'a> Watcher<'a> {
    pub fn new(control: &'a Control<'a>) -> Self {
        let now = Instant::now();
        Self { control, started: now, deadline: None, chunk_began: now, shown: now, showing: Duration::ZERO }
    }

    pub fn elapsed(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    pub fn stopped(&self) -> bool {
        self.control.stop.load(Ordering::Relaxed)
    }

    /// The next chunk begins now.
    pub fn begin_chunk(&mut self) {
        self.chunk_began = Instant::now();
    }

    /// After a chunk of `samples`: shows the picture where it is time, and says whether there is time for another chunk.
    pub fn end_chunk(&mut self, samples: u64, spp: u32, picture: impl FnOnce() -> Option<Image>) -> bool {
        self.control.progress.advance(samples);
        let due = self.control.refresh.as_ref().filter(|r| {
            // The last picture is not worth the time that is left for samples.
            let soon = self.deadline.is_some_and(|end| end - self.elapsed() < r.every.as_secs_f64());
            !soon && self.shown.elapsed() >= r.every.max(20 * self.showing)
        });
        let begun = Instant::now();
        if let Some((refresh, image)) = due.and_then(|r| Some((r, picture()?))) {
            (refresh.show)(Snapshot { image, spp, seconds: self.elapsed() });
            self.shown = Instant::now();
            self.showing = begun.elapsed();
        }
        let chunk = self.chunk_began.elapsed().as_secs_f64();
        self.begin_chunk();
        // Stopping half a chunk early on average ends as often before as after the deadline.
        !self.stopped() && self.deadline.is_none_or(|end| self.elapsed() + 0.5 * chunk < end)
    }
}
