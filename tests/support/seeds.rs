//! Good data and checkpoints, to be damaged.

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

use fanal::base::progress::Progress;
use fanal::generate::shard::TreeSample;
use fanal::guiding::leaves::NETWORK_CHANNELS;
use fanal::render::checkpoint::made_for;
use fanal::render::{Checkpointing, Control, RenderSettings, render_watched};
use fanal::scene::Scene;

use crate::scenes::reconstructor;

/// A small tree of a shard.
pub fn tree(scene: u32) -> TreeSample {
    TreeSample {
        scene,
        own_split: vec![true, false, false, false, false],
        own_sums: (0..4 * NETWORK_CHANNELS).map(|i| i as f32).collect(),
        block_split: vec![true, false, false, false, false],
        block: vec![0.25; 4],
        block_samples: [40.0, 90.0],
        target_split: vec![true, false, true, false, false, false, false, false, false],
        target: vec![0.25, 0.25, 0.25, 0.1, 0.05, 0.05, 0.05],
        target_bsdf: vec![0.25, 0.25, 0.25, 0.1, 0.05, 0.05, 0.05],
        ..TreeSample::default()
    }
}

/// Wishes to stop after a few chunks, when there is something to remember of earlier iterations.
struct StopSoon<'a> {
    chunks: AtomicU32,
    stop: &'a AtomicBool,
}

impl Progress for StopSoon<'_> {
    fn start(&self, _: u64, _: &str) {}
    fn advance(&self, _: u64) {
        let enough = self.chunks.fetch_add(1, Ordering::Relaxed) + 1 >= 3;
        self.stop.store(enough, Ordering::Relaxed);
    }
    fn message(&self, _: &str) {}
    fn finish(&self) {}
}

/// A render interrupted after a few chunks, in `path`.
pub fn kept(scene: &Scene, settings: &RenderSettings, path: &Path) -> Checkpointing {
    let checkpoint = Checkpointing {
        made_for: made_for(settings, scene.size, "scene", "guide"),
        write: Some((path.to_owned(), Duration::ZERO)),
        resume: None,
    };
    let stop = AtomicBool::new(false);
    let watcher = StopSoon { chunks: AtomicU32::new(0), stop: &stop };
    let control = Control { checkpoint: Some(&checkpoint), ..Control::new(&watcher, &stop) };
    render_watched(scene, settings, reconstructor(settings.guide).as_ref(), &control).unwrap();
    Checkpointing { write: None, resume: Some(path.to_owned()), ..checkpoint }
}
