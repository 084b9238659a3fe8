//! Control of a running render: progress, early stop, previews of the picture, checkpoints.

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::checkpoint::Checkpointing;
use super::statistics::ErrorPoint;
use crate::base::{Progress, Result};
use crate::picture::Image;

/// Hooks into a running render: progress, early stop, previews, checkpoints. None changes the picture that it ends with.
pub struct Control<'a> {
    /// Receives the progress, counted in samples.
    pub progress: &'a dyn Progress,
    /// Flag that the caller sets to end the render early with the picture so far.
    pub stop: &'a AtomicBool,
    /// Receives previews of the picture; none for no previews.
    pub refresh: Option<Refresh<'a>>,
    /// Checkpoints to write and to resume from; none for no checkpoints.
    pub checkpoint: Option<&'a Checkpointing>,
}

impl<'a> Control<'a> {
    /// Control by progress and stop flag alone.
    pub fn new(progress: &'a dyn Progress, stop: &'a AtomicBool) -> Self {
        Self { progress, stop, refresh: None, checkpoint: None }
    }
}

/// Previews of the picture while it is rendered.
pub struct Refresh<'a> {
    /// Least time between two pictures; more where making and showing one takes more than a twentieth of it.
    pub every: Duration,
    /// Takes the picture and returns its error against the reference, if there is one.
    pub show: &'a dyn Fn(Snapshot) -> Option<ErrorPoint>,
}

/// An unfinished picture and its cost so far.
pub struct Snapshot {
    /// Linear RGB.
    pub image: Image,
    /// Samples per pixel so far, camera and light paths together.
    pub spp: u32,
    /// Wall time so far, seconds.
    pub seconds: f64,
}

/// [`Control`] as the render uses it, with its clock and time budget.
pub(super) struct Watcher<'a> {
    pub control: &'a Control<'a>,
    started: Instant,
    /// Seconds rendered by earlier processes, according to the checkpoint.
    pub before: f64,
    /// Seconds after which no chunk may begin that would end later.
    pub deadline: Option<f64>,
    /// Seconds that the render may take in all, where it ends by time.
    pub budget: Option<f64>,
    /// Errors of the pictures shown.
    pub errors: Vec<ErrorPoint>,
    /// Why the last checkpoint could not be written; none where it could.
    pub unkept: Option<String>,
    /// Whether samples may have been left out because of an early stop: then no checkpoint of what follows is of use.
    cut_short: Cell<bool>,
    chunk_began: Instant,
    shown: Rhythm,
    kept: Rhythm,
}

/// Time when a repeated job (preview or checkpoint) was last done, and how long it took.
struct Rhythm {
    last: Instant,
    took: Duration,
}

impl Rhythm {
    fn new() -> Self {
        Self { last: Instant::now(), took: Duration::ZERO }
    }

    /// Whether the job is due: after `every`, but not before 20 times what it took, so that it takes a twentieth of all time.
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

    /// Whether the stop flag is set; remembers it if so.
    pub fn stopped(&self) -> bool {
        let stopped = self.control.stop.load(Ordering::Relaxed);
        self.cut_short.set(self.cut_short.get() || stopped);
        stopped
    }

    /// [`Watcher::stopped`] between two passes. A checkpoint holds the state after a chunk, so where one is to be written, the
    /// render ends after the next chunk instead of here.
    pub fn stopped_between(&self) -> bool {
        let keeps = self.control.checkpoint.is_some_and(|checkpoint| checkpoint.write.is_some());
        if keeps && !self.cut_short.get() { false } else { self.stopped() }
    }

    /// Starts the clock of the next chunk.
    pub fn begin_chunk(&mut self) {
        self.chunk_began = Instant::now();
    }

    /// Whether less than `every` is left before the deadline: that time is worth more as samples.
    fn is_late(&self, every: Duration) -> bool {
        self.deadline.is_some_and(|end| end - self.elapsed() < every.as_secs_f64())
    }

    /// Reports the progress `seconds` after the beginning: share of the time budget, samples per pixel, latest relMSE.
    fn tell(&self, spp: u32, seconds: f64) {
        let error = self.errors.last().map_or(String::new(), |error| format!(", relMSE {:.3e}", error.relmse));
        self.control.progress.reached(self.budget.map(|budget| seconds / budget), &format!("{spp} spp{error}"));
    }

    /// After a chunk of `samples`: shows the picture and writes a checkpoint where they are due, and returns whether there is time
    /// for another chunk. `keep` writes a checkpoint, given the seconds so far and the errors of the pictures shown.
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
        if let Some(refresh) = refresh {
            let show = || picture().and_then(|image| (refresh.show)(Snapshot { image, spp, seconds }));
            self.errors.extend(self.shown.time(show));
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
            // A failed write is no reason to stop: a later one may succeed, and the outcome tells of the last.
            self.unkept = kept.err().map(|error| error.to_string());
        }
        let chunk = self.chunk_began.elapsed().as_secs_f64();
        self.begin_chunk();
        // Stopping half a chunk early on average ends as often before as after the deadline.
        !stopped && self.deadline.is_none_or(|end| self.elapsed() + 0.5 * chunk < end)
    }
}
