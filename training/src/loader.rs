//! The pairs of each step, and a background thread that prepares them.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};

use fanal::base::random::Random;
use fanal::generate::shard::TreeSample;
use fanal::network::config::Config;

use crate::augment::augment;
use crate::batch::HostBatch;

/// Number of batches prepared ahead.
const AHEAD: usize = 3;

/// The order of training: a pure function of the step, so that a resumed run goes on as if it had not stopped.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Seed of order and augmentation.
    pub seed: u64,
    /// Pairs per step.
    pub batch: usize,
    /// Pairs in the data.
    pub samples: usize,
    /// Parts of a step that are computed in parallel.
    pub parts: usize,
    /// Configuration of the network that batches are laid out for.
    pub config: Config,
}

impl Plan {
    /// Number of steps that meet every pair once.
    pub fn steps_per_epoch(&self) -> u64 {
        self.samples.div_ceil(self.batch.max(1)).max(1) as u64
    }

    /// The order of pairs in an epoch.
    fn order(&self, epoch: u64) -> Vec<u32> {
        let mut order: Vec<u32> = (0..self.samples as u32).collect();
        let mut random = Random::new(self.seed, 1, epoch);
        for i in (1..order.len()).rev() {
            order.swap(i, random.below(i as u32 + 1) as usize);
        }
        order
    }
}

/// Starts preparing steps from `first` on, without end; the thread stops when the receiver is dropped.
pub fn start(data: Arc<Vec<TreeSample>>, plan: Plan, first: u64) -> Receiver<Result<Vec<HostBatch>, String>> {
    let (sender, receiver) = sync_channel(AHEAD);
    std::thread::spawn(move || {
        let mut order = (u64::MAX, vec![]);
        for step in first.. {
            let (epoch, part) = (step / plan.steps_per_epoch(), step % plan.steps_per_epoch());
            if order.0 != epoch {
                order = (epoch, plan.order(epoch));
            }
            let from = part as usize * plan.batch;
            let chosen = &order.1[from..(from + plan.batch).min(order.1.len())];
            if sender.send(prepare(&data, chosen, &plan, epoch)).is_err() {
                return;
            }
        }
    });
    receiver
}

fn prepare(data: &[TreeSample], chosen: &[u32], plan: &Plan, epoch: u64) -> Result<Vec<HostBatch>, String> {
    use rayon::prelude::*;
    let one = |&i: &u32| augment(&data[i as usize], &mut Random::new(plan.seed, 2 + epoch, u64::from(i)));
    let samples: Vec<TreeSample> = chosen.par_iter().map(one).collect::<Result<_, _>>()?;
    samples
        .chunks(samples.len().div_ceil(plan.parts.max(1)).max(1))
        .map(|part| HostBatch::new(part, &plan.config))
        .collect()
}
