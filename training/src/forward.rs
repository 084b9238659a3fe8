//! The network over a whole batch: the encoder from the deepest level up, the decoder down the structure that training needs.

use burn::tensor::Tensor;
use fanal::base::random::Random;
use fanal::guiding::tree::features::FEATURES;
use fanal::guiding::tree::topology::MAX_LEVEL;
use fanal::network::batch::{Batch, NONE};
use fanal::network::config::Config;
use fanal::network::growing::DecodeLevel;
use fanal::network::program::GEOMETRY;
use fanal::reconstruct::neural::expected_shares;

use crate::batch::{Aligned, HostBatch};
use crate::loss::NEVER;
use crate::model::{Net, index, rows, to_vec, with_zero_row};

/// All decoded rows of a batch, levels 1, 2, … one after the other, with the values that the loss compares them to.
pub struct DecodedRows {
    /// [R, 1] logit of the share among four siblings.
    pub share_logit: Tensor<2>,
    /// [R, 1] logit of being a leaf.
    pub leaf_logit: Tensor<2>,
    /// [R] index of the parent's row, plus 1; 0 where the parent is a root.
    pub parent: Vec<u32>,
    /// [R] index of the tree.
    pub tree: Vec<u32>,
    /// [R] converged mass of the cell.
    pub mass: Vec<f32>,
    /// [R] mass of the cell under BSDF sampling.
    pub bsdf: Vec<f32>,
    /// [R] converged mass of the parent's cell.
    pub parent_mass: Vec<f32>,
    /// [R] whether the converged tree has a leaf there, or ends above.
    pub is_leaf: Vec<bool>,
    /// [R] whether children were decoded.
    pub split: Vec<bool>,
    /// [R] level.
    pub level: Vec<u8>,
    /// Number of trees.
    pub trees: usize,
}

/// Probability of dividing rows that both the network and the truth call leaves: eq. 15 gives the class a gradient only where
/// children were decoded, and dividing all of them would quadruple the work.
const EXTRA_LEVEL: f32 = 0.2;

/// Greatest number of levels below a converged leaf to which a mistaken split is followed.
const MAX_BELOW: u8 = 2;

/// The encoder's outputs [N, C] per level, from the root down.
pub fn encode(net: &Net, config: &Config, batch: &HostBatch) -> Vec<Tensor<2>> {
    let levels = batch.input.levels.len();
    let mut encoded: Vec<Tensor<2>> = Vec::with_capacity(levels);
    for level in (0..levels).rev() {
        let rows_here = &batch.input.levels[level].rows;
        let features = rows(batch.features[level].clone(), FEATURES, net.device());
        let pooled = match encoded.last() {
            Some(below) => pool(below.clone(), &rows_here.first_child),
            None => Tensor::zeros([rows_here.len(), config.width], net.device()),
        };
        encoded.push(net.encode(level, features, pooled, index(&rows_here.neighbours, net.device())));
    }
    encoded.reverse();
    encoded
}

/// 2×2 mean pooling: the mean of each group of four rows goes to the row that is their parent, others get zero.
fn pool(below: Tensor<2>, first_child: &[u32]) -> Tensor<2> {
    let [n, c] = below.dims();
    let device = below.device();
    let means = below.reshape([n / 4, 4, c]).mean_dim(1).reshape([n / 4, c]);
    let groups = (n / 4) as u32;
    let source: Vec<u32> = first_child.iter().map(|&first| if first == NONE { groups } else { first / 4 }).collect();
    with_zero_row(means).select(0, index(&source, &device))
}

/// Decodes every level; `random` decides which common leaves are divided.
pub fn decode(
    net: &Net,
    config: &Config,
    batch: &HostBatch,
    encoded: &[Tensor<2>],
    random: &mut Random,
) -> DecodedRows {
    let mut walk = Walk::new(batch, encoded);
    while walk.level.level < MAX_LEVEL {
        let below = walk.level.grow(&batch.input, &walk.split);
        if below.rows.is_empty() {
            break;
        }
        walk.enter(net, config, batch, encoded, below, random);
    }
    walk.finish()
}

/// State of the decoder, level by level from the root.
struct Walk {
    level: DecodeLevel,
    split: Vec<bool>,
    aligned: Aligned,
    features: Tensor<2>,
    /// Predicted mass per row of the level.
    predicted: Vec<f32>,
    /// Predicted probability per row of being a leaf, 0 for roots.
    leaf: Vec<f32>,
    /// Index of the level's first row in the output, plus 1.
    start: usize,
    share_logits: Vec<Tensor<2>>,
    leaf_logits: Vec<Tensor<2>>,
    out: DecodedRows,
}

impl Walk {
    fn new(batch: &HostBatch, encoded: &[Tensor<2>]) -> Self {
        let trees = batch.trees();
        let nothing = || Tensor::zeros([1, 1], &encoded[0].device());
        let out = DecodedRows {
            share_logit: nothing(),
            leaf_logit: nothing(),
            parent: vec![],
            tree: vec![],
            mass: vec![],
            bsdf: vec![],
            parent_mass: vec![],
            is_leaf: vec![],
            split: vec![],
            level: vec![],
            trees,
        };
        Self {
            level: DecodeLevel::roots(&batch.input),
            split: vec![true; trees],
            aligned: Aligned::roots(&batch.target),
            features: encoded[0].clone(),
            predicted: vec![1.0; trees],
            leaf: vec![0.0; trees],
            start: 0,
            share_logits: vec![],
            leaf_logits: vec![],
            out,
        }
    }

    fn enter(
        &mut self,
        net: &Net,
        config: &Config,
        batch: &HostBatch,
        encoded: &[Tensor<2>],
        level: DecodeLevel,
        random: &mut Random,
    ) {
        let device = net.device();
        let decoded = net.decode(
            level.level,
            self.features.clone(),
            index(&level.rows.parent, device),
            skip(encoded.get(level.level), &level, &batch.input, config.width, net),
            [rows(level.geometry(&batch.log_shares), GEOMETRY, device), rows(level.base(&batch.base), 1, device)],
            index(&level.rows.neighbours, device),
        );
        let (share, leaf) = (to_vec(decoded.share.inner()), to_vec(decoded.leaf.inner()));
        let aligned = self.aligned.children(&batch.target, &level.rows.parent);
        let (above, share) = (&self.predicted, expected_shares(&level.rows.parent, &self.leaf, &share));
        let predicted: Vec<f32> = level.rows.parent.iter().zip(share).map(|(&p, s)| above[p as usize] * s).collect();
        let split: Vec<bool> = (0..level.rows.len())
            .map(|row| {
                let extra = random.next_f32() < EXTRA_LEVEL;
                if config.image.is_some() {
                    return config.splits(level.level, leaf[row], predicted[row]);
                }
                let by_network = config.splits(level.level, leaf[row], predicted[row]);
                let by_chance = extra && aligned.mass[row] > config.min_split_share && aligned.below[row] == 0;
                let known = aligned.below[row] < MAX_BELOW;
                aligned.has_children(&batch.target, row) || known && (by_network || by_chance)
            })
            .map(|wanted| wanted && level.level < MAX_LEVEL)
            .collect();
        self.record(&level, &aligned, batch, &split);
        self.share_logits.push(decoded.share_logit);
        // An image has no leaves above its last level: its cells' classes are not used.
        let never = |_| Tensor::full([level.rows.len(), 1], NEVER, device);
        self.leaf_logits.push(config.image.map_or(decoded.leaf_logit, never));
        self.features = decoded.features;
        self.leaf = if config.image.is_some() { vec![0.0; leaf.len()] } else { leaf };
        (self.level, self.split, self.aligned, self.predicted) = (level, split, aligned, predicted);
    }

    fn record(&mut self, level: &DecodeLevel, aligned: &Aligned, batch: &HostBatch, split: &[bool]) {
        let out = &mut self.out;
        let parent_start = self.start;
        self.start = out.parent.len() + 1;
        for (row, &parent) in level.rows.parent.iter().enumerate() {
            out.parent.push(if level.level == 1 { 0 } else { parent_start as u32 + parent });
            out.parent_mass.push(self.aligned.mass[parent as usize]);
            out.is_leaf.push(!aligned.has_children(&batch.target, row));
        }
        out.tree.extend(&level.rows.tree);
        out.mass.extend(&aligned.mass);
        out.bsdf.extend(&aligned.bsdf);
        out.split.extend(split);
        out.level.extend(std::iter::repeat_n(level.level as u8, level.rows.len()));
    }

    fn finish(mut self) -> DecodedRows {
        // Roots are always divided, so there is at least level 1.
        self.out.share_logit = Tensor::cat(self.share_logits, 0);
        self.out.leaf_logit = Tensor::cat(self.leaf_logits, 0);
        self.out
    }
}

/// The encoder's rows where Q_h has the cell, zeros elsewhere.
fn skip(encoded: Option<&Tensor<2>>, level: &DecodeLevel, input: &Batch, width: usize, net: &Net) -> Tensor<2> {
    let absent = input.len(level.level) as u32;
    match encoded {
        Some(encoded) => {
            let source: Vec<u32> = level.skip.iter().map(|&s| if s == NONE { absent } else { s }).collect();
            with_zero_row(encoded.clone()).select(0, index(&source, net.device()))
        }
        None => Tensor::zeros([level.rows.len(), width], net.device()),
    }
}
