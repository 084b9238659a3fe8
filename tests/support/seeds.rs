//! Good data and checkpoints, to be damaged.

use std::path::Path;
use std::time::Duration;

use fanal::generate::shard::TreeSample;
use fanal::guiding::tree::leaves::NETWORK_CHANNELS;
use fanal::render::checkpoint::made_for;
use fanal::render::{Checkpointing, Control, RenderSettings, render_watched};
use fanal::scene::Scene;

use crate::scenes::reconstructor;
use crate::stop::StopAfter;

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

/// A render interrupted after a few chunks, in `path`.
pub fn kept(scene: &Scene, settings: &RenderSettings, path: &Path) -> Checkpointing {
    // When there is something to remember of earlier iterations.
    kept_after(3, scene, settings, path)
}

/// The same after so many.
pub fn kept_after(chunks: i64, scene: &Scene, settings: &RenderSettings, path: &Path) -> Checkpointing {
    let checkpoint = Checkpointing {
        made_for: made_for(settings, scene.size, "scene", "guide"),
        write: Some((path.to_owned(), Duration::ZERO)),
        resume: None,
    };
    let stop = StopAfter::new(chunks);
    let control = Control { checkpoint: Some(&checkpoint), ..Control::new(&stop, &stop.now) };
    render_watched(scene, settings, reconstructor(settings.guide).as_ref(), &control).unwrap();
    Checkpointing { write: None, resume: Some(path.to_owned()), ..checkpoint }
}
