//! How long work tells its watcher where it stands, without knowing whether that is a terminal, a file or nobody.

/// A watcher of counted work. Methods take `&self`, so that one watcher can be shared by all threads.
pub trait Progress: Sync {
    /// Work of `total` units begins; 0 where the total is not known. `unit` names one of them ("samples").
    fn start(&self, total: u64, unit: &str);
    /// `n` more units are done.
    fn advance(&self, n: u64);
    /// What is being done now.
    fn message(&self, text: &str);
    /// How far the work is: its part that is done, 0 to 1, where counting units does not tell, and what there is so far ("37 spp").
    fn reached(&self, _part: Option<f64>, _what: &str) {}
    /// The work begun by the last [`Progress::start`] has ended.
    fn finish(&self);
}

/// Tells nobody.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn start(&self, _: u64, _: &str) {}
    fn advance(&self, _: u64) {}
    fn message(&self, _: &str) {}
    fn finish(&self) {}
}
