//! Ablations: evaluation of the network with something taken away, to see that it uses it.

use anyhow::Result;
use fanal::base::random::Random;
use fanal::guiding::tree::distribution::Distribution;
use fanal::guiding::tree::leaves::{COUNTS, NETWORK_CHANNELS, SQUARES, VALUES};
use fanal::network::backend::{Backend, DecodeInputs, DecodeOutput, EncodeInputs};
use fanal::network::batch::{CENTRE, SLOTS};
use fanal::network::embedded::Embedded;
use fanal::network::weights::Model;
use fanal::reconstruct::gaussian::Gaussian;

use crate::cases::{Case, reconstruct};

/// What to take away.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Ablation {
    /// Convolutions see only their own cell.
    Neighbours,
    /// Nothing of what the voxel's own samples brought but what the counted distribution has of it; the BSDF at them and their number stay.
    Own,
    /// Nothing taken away, but mixed with as much of the smoothed tree.
    Half,
    /// The input of another tree.
    Shuffle,
    /// The weights of the decoder's first convolution in another order.
    Layer,
}

impl Ablation {
    /// Name of the ablation's row in the table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Neighbours => "network, no neighbours",
            Self::Own => "network, no own samples",
            Self::Half => "network and Gaussian, halves",
            Self::Shuffle => "network, other tree's input",
            Self::Layer => "network, one layer shuffled",
        }
    }

    /// Distributions that the ablated network reconstructs for the cases.
    ///
    /// # Errors
    /// Those of [`reconstruct`].
    pub fn reconstruct(self, model: &Model, backend: &dyn Backend, cases: &[Case]) -> Result<Vec<Distribution>> {
        match self {
            Self::Neighbours => reconstruct(model, &Alone(backend), cases),
            Self::Own => reconstruct(model, backend, &without_own(cases)),
            Self::Half => {
                let smooth = |c: &Case| Gaussian::default().smooth_tree(&c.input());
                let network = reconstruct(model, backend, cases)?;
                Ok(network
                    .iter()
                    .zip(cases)
                    .map(|(network, c)| Distribution::blend(network, &smooth(c), 0.5))
                    .collect())
            }
            Self::Shuffle => reconstruct(model, backend, &shuffled(cases)),
            Self::Layer => {
                let model = with_shuffled_layer(model);
                reconstruct(&model, &Embedded::new(&model)?, cases)
            }
        }
    }
}

/// A Fisher-Yates shuffle of one layer's weights, with a fixed seed: their distribution stays, their learned order is lost.
fn with_shuffled_layer(model: &Model) -> Model {
    let mut model = model.clone();
    let mut random = Random::new(1, 0, 0);
    for (_, layer) in
        model.weights.layers.iter_mut().filter(|(name, _)| name.starts_with("decode") && name.ends_with("conv0"))
    {
        for i in (1..layer.weight.len()).rev() {
            layer.weight.swap(i, random.below(i as u32 + 1) as usize);
        }
    }
    model
}

fn without_own(cases: &[Case]) -> Vec<Case> {
    let mut cases = cases.to_vec();
    for row in cases.iter_mut().flat_map(|case| case.own_sums.chunks_exact_mut(NETWORK_CHANNELS)) {
        [VALUES, COUNTS, SQUARES].iter().flatten().for_each(|&channel| row[channel] = 0.0);
    }
    cases
}

/// Every case with the input of the case half the list away.
fn shuffled(cases: &[Case]) -> Vec<Case> {
    let mut inputs = cases.to_vec();
    inputs.rotate_left(cases.len() / 2);
    inputs
}

/// A backend whose convolutions see only their own cell.
struct Alone<'a>(&'a dyn Backend);

impl Alone<'_> {
    fn neighbours(neighbours: &[u32], rows: usize) -> Vec<u32> {
        let own = |(i, &row): (usize, &u32)| if i % SLOTS == CENTRE { row } else { rows as u32 };
        neighbours.iter().enumerate().map(own).collect()
    }
}

impl Backend for Alone<'_> {
    fn name(&self) -> &'static str {
        self.0.name()
    }

    fn encode(&self, level: usize, inputs: &EncodeInputs) -> fanal::base::Result<Vec<f32>> {
        let neighbours = Self::neighbours(inputs.neighbours, inputs.rows);
        self.0.encode(level, &EncodeInputs { neighbours: &neighbours, ..*inputs })
    }

    fn decode(&self, level: usize, inputs: &DecodeInputs) -> fanal::base::Result<DecodeOutput> {
        let neighbours = Self::neighbours(inputs.neighbours, inputs.rows);
        self.0.decode(level, &DecodeInputs { neighbours: &neighbours, ..*inputs })
    }
}
