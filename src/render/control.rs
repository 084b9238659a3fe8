//! Who watches a render: progress, the wish to stop, the picture while it is made.

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::checkpoint::Checkpointing;
use super::statistics::ErrorPoint;
use crate::base::{Progress, Result};
use crate::picture::Image;

/// What a render tells and asks while it runs. Nothing here changes the picture that it ends with.
pub struct Control<'a> {
    /// Told about samples.
    pub progress: &'a dyn Progress,
    /// Set to end early with the picture so far.
    pub stop: &'a AtomicBool,
    /// Shown the picture from time to time.
    pub refresh: Option<Refresh<'a>>,
    /// How the render is kept on disk, if it is.
    pub checkpoint: Option<&'a Checkpointing>,
}

impl<'a> Control<'a> {
    /// Nothing but progress and the wish to stop.
    pub fn new(progress: &'a dyn Progress, stop: &'a AtomicBool) -> Self {
        Self { progress, stop, refresh: None, checkpoint: None }
    }
}

/// Shows the picture while it is made.
pub struct Refresh<'a> {
    /// Least time between two pictures; more where showing one takes more than a twentieth of it.
    pub every: Duration,
    /// Takes the picture, and says how far it is from a reference where there is one.
    pub show: &'a dyn Fn(Snapshot) -> Option<ErrorPoint>,
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
    started: Instant,
    /// Seconds that earlier processes rendered.
    pub before: f64,
    /// Seconds after which no chunk may begin that would end later.
    pub deadline: Option<f64>,
    /// Seconds that the render may take in all, where it ends by time.
    pub budget: Option<f64>,
    /// Errors of the pictures shown.
    pub errors: Vec<ErrorPoint>,
    /// Why the last checkpoint could not be written; none where it could.
    pub unkept: Option<String>,
    /// Whether anything may have been left out because of the wish to stop: then no checkpoint of what follows is of use.
    cut_short: Cell<bool>,
    chunk_began: Instant,
    shown: Rhythm,
    kept: Rhythm,
}

/// When something was done last, and how long that took.
struct Rhythm {
    last: Instant,
    took: Duration,
}

impl Rhythm {
    fn new() -> Self {
        Self { last: Instant::now(), took: Duration::ZERO }
    }

    /// Whether it is time again: it may take a twentieth of all time.
    fn due(&self, every: Duration) -> bool {
        self.last.elapsed() >= every.max(20 * self.took)
    }

    fn time<T>(&mut self, work: impl FnOnce() -> T) -> T {
        let begun = Instant::now();
        let result = work();
        (self.last, self.took) = (Instant::now(), begun.elapsed());
        result
    }
}

impl<'a> Watcher<'a> {
    pub fn new(control: &'a Control<'a>) -> Self {
        let now = Instant::now();
        Self {
            control,
            started: now,
            before: 0.0,
            deadline: None,
            budget: None,
            errors: Vec::new(),
            unkept: None,
            cut_short: Cell::new(false),
            chunk_began: now,
            shown: Rhythm::new(),
            kept: Rhythm::new(),
        }
    }

    pub fn elapsed(&self) -> f64 {
        self.before + self.started.elapsed().as_secs_f64()
    }

    /// Whether the render is to end early.
    pub fn stopped(&self) -> bool {
        let stopped = self.control.stop.load(Ordering::Relaxed);
        self.cut_short.set(self.cut_short.get() || stopped);
        stopped
    }

    /// The same between two passes. What checkpoints hold is a moment after a chunk, so where one is to be written, the next chunk is
    /// the last, and not the one before.
    pub fn stopped_between(&self) -> bool {
        let keeps = self.control.checkpoint.is_some_and(|checkpoint| checkpoint.write.is_some());
        if keeps && !self.cut_short.get() { false } else { self.stopped() }
    }

    /// The next chunk begins now.
    pub fn begin_chunk(&mut self) {
        self.chunk_began = Instant::now();
    }

    /// The last moments before a deadline are worth more as samples.
    fn is_late(&self, every: Duration) -> bool {
        self.deadline.is_some_and(|end| end - self.elapsed() < every.as_secs_f64())
    }

    /// Says how far the render is, `seconds` after its beginning.
    fn tell(&self, spp: u32, seconds: f64) {
        let error = self.errors.last().map_or(String::new(), |error| format!(", relMSE {:.3e}", error.relmse));
        self.control.progress.reached(self.budget.map(|budget| seconds / budget), &format!("{spp} spp{error}"));
    }

    /// After a chunk of `samples`: shows the picture and writes a checkpoint where it is time, and says whether there is time for
    /// another chunk. `keep` writes a checkpoint, given the seconds so far and the errors of the pictures shown.
    pub fn end_chunk(
        &mut self,
        samples: u64,
        spp: u32,
        picture: impl FnOnce() -> Option<Image>,
        keep: impl FnOnce(&Checkpointing, f64, &[ErrorPoint]) -> Result<()>,
    ) -> bool {
        self.control.progress.advance(samples);
        let seconds = self.elapsed();
        let refresh = self.control.refresh.as_ref().filter(|r| !self.is_late(r.every) && self.shown.due(r.every));
        if let Some((refresh, image)) = refresh.and_then(|r| Some((r, picture()?))) {
            self.errors.extend(self.shown.time(|| (refresh.show)(Snapshot { image, spp, seconds })));
        }
        self.tell(spp, seconds);
        let whole = !self.cut_short.get();
        let stopped = self.stopped();
        let checkpoint = self.control.checkpoint.filter(|c| {
            let due = |every| !self.is_late(every) && self.kept.due(every);
            whole && c.write.as_ref().is_some_and(|(_, every)| stopped || due(*every))
        });
        if let Some(checkpoint) = checkpoint {
            let kept = self.kept.time(|| keep(checkpoint, seconds, &self.errors));
            // What cannot be written now may be written later; the end says so if not.
            self.unkept = kept.err().map(|error| error.to_string());
        }
        let chunk = self.chunk_began.elapsed().as_secs_f64();
        self.begin_chunk();
        // Stopping half a chunk early on average ends as often before as after the deadline.
        !stopped && self.deadline.is_none_or(|end| self.elapsed() + 0.5 * chunk < end)
    }
}
