//! Good data and checkpoints, to be damaged.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
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
        counted_split: vec![false],
        counted: vec![1.0],
        target_split: vec![true, false, true, false, false, false, false, false, false],
        target: vec![0.25, 0.25, 0.25, 0.1, 0.05, 0.05, 0.05],
        target_bsdf: vec![0.25, 0.25, 0.25, 0.1, 0.05, 0.05, 0.05],
        ..TreeSample::default()
    }
}

/// Wishes to stop after the first chunk.
struct StopAtOnce<'a>(&'a AtomicBool);

impl Progress for StopAtOnce<'_> {
    fn start(&self, _: u64, _: &str) {}
    fn advance(&self, _: u64) {
        self.0.store(true, Ordering::Relaxed);
    }
    fn message(&self, _: &str) {}
    fn finish(&self) {}
}

/// A render interrupted after its first chunk, in `path`.
pub fn kept(scene: &Scene, settings: &RenderSettings, path: &Path) -> Checkpointing {
    let checkpoint = Checkpointing {
        made_for: made_for(settings, scene.size, "scene", "guide"),
        write: Some((path.to_owned(), Duration::ZERO)),
        resume: None,
    };
    let stop = AtomicBool::new(false);
    let watcher = StopAtOnce(&stop);
    let control = Control { checkpoint: Some(&checkpoint), ..Control::new(&watcher, &stop) };
    render_watched(scene, settings, reconstructor(settings.guide).as_ref(), &control).unwrap();
    Checkpointing { write: None, resume: Some(path.to_owned()), ..checkpoint }
}
