//! The burn network behind the renderer's own interface, so that both can be held against each other.

use burn::tensor::{Device, Tensor};
use fanal::base::Result;
use fanal::guiding::tree::features::FEATURES;
use fanal::network::backend::{Backend, DecodeInputs, DecodeOutput, EncodeInputs};
use fanal::network::program::GEOMETRY;
use fanal::network::weights::Model;

use crate::model::{Net, index, rows, to_vec};

/// Runs a model's steps in burn.
pub struct Burn {
    net: Net,
    width: usize,
}

impl Burn {
    /// The network of `model` on `device`.
    ///
    /// # Errors
    /// [`fanal::base::Error::Model`] if the weights do not fit the configuration.
    pub fn new(model: &Model, device: &Device) -> Result<Self> {
        Ok(Self { net: Net::new(&model.config, &model.weights, device)?, width: model.config.width })
    }

    fn rows(&self, values: &[f32], columns: usize) -> Tensor<2> {
        rows(values.to_vec(), columns, self.net.device())
    }
}

impl Backend for Burn {
    fn name(&self) -> &'static str {
        "burn"
    }

    fn encode(&self, level: usize, inputs: &EncodeInputs) -> Result<Vec<f32>> {
        if inputs.rows == 0 {
            return Ok(vec![]);
        }
        let neighbours = index(inputs.neighbours, self.net.device());
        let (features, pooled) = (self.rows(inputs.features, FEATURES), self.rows(inputs.pooled, self.width));
        Ok(to_vec(self.net.encode(level, features, pooled, neighbours)))
    }

    fn decode(&self, level: usize, inputs: &DecodeInputs) -> Result<DecodeOutput> {
        if inputs.rows == 0 {
            return Ok(DecodeOutput::default());
        }
        let decoded = self.net.decode(
            level,
            self.rows(inputs.parents, self.width),
            index(inputs.parent_index, self.net.device()),
            self.rows(inputs.skip, self.width),
            [self.rows(inputs.geometry, GEOMETRY), self.rows(inputs.base, 1)],
            index(inputs.neighbours, self.net.device()),
        );
        Ok(DecodeOutput {
            decoded: to_vec(decoded.features),
            share_logit: to_vec(decoded.share_logit),
            share: to_vec(decoded.share),
            leaf_logit: to_vec(decoded.leaf_logit),
            leaf: to_vec(decoded.leaf),
        })
    }
}
