//! A render or a comparison that is interrupted.

use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};

use fanal::base::Progress;

/// Wishes to stop after so many steps forward, each of any size.
pub struct StopAfter {
    left: AtomicI64,
    pub now: AtomicBool,
}

impl StopAfter {
    pub fn new(steps: i64) -> Self {
        Self { left: AtomicI64::new(steps), now: AtomicBool::new(false) }
    }
}

impl Progress for StopAfter {
    fn start(&self, _: u64, _: &str) {}
    fn advance(&self, _: u64) {
        if self.left.fetch_sub(1, Ordering::Relaxed) == 1 {
            self.now.store(true, Ordering::Relaxed);
        }
    }
    fn message(&self, _: &str) {}
    fn finish(&self) {}
}
