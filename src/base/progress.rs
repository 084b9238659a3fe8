//! Progress reports of long work; the reporter does not know whether a terminal, a file or nobody is watching.

/// A watcher of counted work. Methods take `&self`, so that one watcher can be shared by all threads.
pub trait Progress: Sync {
    /// Work of `total` units begins; 0 where the total is not known. `unit` names one of them ("samples").
    fn start(&self, total: u64, unit: &str);
    /// `n` more units are done.
    fn advance(&self, n: u64);
    /// Describes the current work.
    fn message(&self, text: &str);
    /// Reports the part of the work that is done, 0 to 1, where counting units does not tell it, and the result so far ("37 spp").
    fn reached(&self, _part: Option<f64>, _what: &str) {}
    /// The work begun by the last [`Progress::start`] has ended.
    fn finish(&self);
}

/// A watcher that ignores all reports.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn start(&self, _: u64, _: &str) {}
    fn advance(&self, _: u64) {}
    fn message(&self, _: &str) {}
    fn finish(&self) {}
}
