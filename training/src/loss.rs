//! The loss that training minimises.
//!
//! The expected share of a node is E = p·¼ + (1 − p)·s, p its parent's probability of being a leaf and s the share that the
//! softmax gives it (Zhu 2021 eq. 15); a root is never a leaf. All in logarithms, so that saturated logits stay finite.

use burn::tensor::activation::{log_sigmoid, log_softmax};
use burn::tensor::{Device, Tensor};

use crate::forward::DecodedRows;
use crate::model::{index, rows, siblings};

/// Which measure of the value compares expectation and truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Loss {
    /// KL divergence of the whole distribution: node by node the cross-entropy of the shares, weighted by target mass.
    Kl,
    /// L1 of shares (Zhu 2021 eq. 16), weighted by target mass plus a floor.
    Zhu,
    /// What a picture feels (see [`relative_moment`](fanal::guiding::tree::distribution::relative_moment)): the logarithm of the second
    /// moment of the estimator that draws half from the BSDF, half from the tree, plus a part of KL.
    Variance,
}

/// Weight of nodes without target mass, in eq. 16 and in the classification.
const MASS_FLOOR: f32 = 1e-3;

/// Part of KL in [`Loss::Variance`]: the moment alone hardly depends on the values below the BSDF's half of the mixture.
const KL_PART: f64 = 0.3;

/// Logit of a parent that is never a leaf: p = 1e-13.
pub const NEVER: f32 = -30.0;

/// Smallest logarithm of an expected share; below it the gradient would only be noise.
const LOG_FLOOR: f32 = -40.0;

/// The loss, and its parts for the log.
pub struct Losses {
    /// [1] the loss that is minimised.
    pub total: Tensor<1>,
    /// [1] the value part.
    pub value: Tensor<1>,
    /// [1] the classification part, before β.
    pub class: Tensor<1>,
}

/// Value plus `beta` times class (Zhu 2021 eq. 17), the mean over trees.
pub fn losses(loss: Loss, decoded: &DecodedRows, beta: f64) -> Losses {
    let device = decoded.share_logit.device();
    let log_expected = log_expected(decoded, &device);
    let value = match loss {
        Loss::Kl => kl(decoded, log_expected, &device),
        Loss::Zhu => l1(decoded, log_expected, &device),
        Loss::Variance => {
            let kl = kl(decoded, log_expected.clone(), &device);
            log_moment(decoded, log_expected, &device) + kl.mul_scalar(KL_PART)
        }
    };
    let class = class(decoded, &device);
    Losses { total: value.clone() + class.clone().mul_scalar(beta), value, class }
}

/// ln E per row, [R, 1].
fn log_expected(decoded: &DecodedRows, device: &Device) -> Tensor<2> {
    let never = rows(vec![NEVER], 1, device);
    let parent = Tensor::cat(vec![never, decoded.leaf_logit.clone()], 0).select(0, index(&decoded.parent, device));
    let log_share = siblings(decoded.share_logit.clone(), |four| log_softmax(four, 1));
    let uniform = log_sigmoid(parent.clone()).add_scalar(0.25f32.ln());
    let divided = log_sigmoid(parent.neg()) + log_share;
    log_sum_exp(uniform, divided).clamp_min(LOG_FLOOR)
}

/// ln(eᵃ + eᵇ), elementwise; the maximum is a constant to the gradient.
fn log_sum_exp(a: Tensor<2>, b: Tensor<2>) -> Tensor<2> {
    let max = a.clone().detach().max_pair(b.clone().detach());
    ((a - max.clone()).exp() + (b - max.clone()).exp()).log() + max
}

/// KL of the target against the products of expected shares: by the chain rule the sum over nodes of target mass times
/// KL of the children's shares.
fn kl(decoded: &DecodedRows, log_expected: Tensor<2>, device: &Device) -> Tensor<1> {
    let pairs = decoded.mass.iter().zip(&decoded.parent_mass);
    let entropy: f64 = pairs.filter(|(m, _)| **m > 0.0).map(|(&m, &p)| f64::from(m) * f64::from(m / p).ln()).sum();
    let mass = rows(decoded.mass.clone(), 1, device);
    (log_expected * mass).sum().neg().add_scalar(entropy).div_scalar(decoded.trees as f64)
}

/// Eq. 16 with target shares (¼ where the target has ended), normalised per tree.
fn l1(decoded: &DecodedRows, log_expected: Tensor<2>, device: &Device) -> Tensor<1> {
    let share = |(&m, &p): (&f32, &f32)| if p > 0.0 { m / p } else { 0.25 };
    let shares: Vec<f32> = decoded.mass.iter().zip(&decoded.parent_mass).map(share).collect();
    let weights = per_tree(decoded, decoded.parent_mass.iter().map(|m| m + MASS_FLOOR));
    ((log_expected.exp() - rows(shares, 1, device)).abs() * rows(weights, 1, device)).sum()
}

/// Binary cross-entropy of the leaf flag from logits, weighted by target mass plus a floor, normalised per tree.
fn class(decoded: &DecodedRows, device: &Device) -> Tensor<1> {
    let weights = per_tree(decoded, decoded.mass.iter().map(|m| m + MASS_FLOOR));
    let signs: Vec<f32> = decoded.is_leaf.iter().map(|&leaf| if leaf { 1.0 } else { -1.0 }).collect();
    let log_likelihood = log_sigmoid(decoded.leaf_logit.clone() * rows(signs, 1, device));
    (log_likelihood * rows(weights, 1, device)).sum().neg()
}

/// Weights whose sum over each tree is 1 / trees.
fn per_tree(decoded: &DecodedRows, weights: impl Iterator<Item = f32>) -> Vec<f32> {
    let mut weights: Vec<f32> = weights.collect();
    let mut totals = vec![0.0; decoded.trees];
    weights.iter().zip(&decoded.tree).for_each(|(w, &tree)| totals[tree as usize] += w);
    let trees = decoded.trees as f32;
    weights.iter_mut().zip(&decoded.tree).for_each(|(w, &tree)| *w /= totals[tree as usize] * trees);
    weights
}

/// Uniform part of the tree in [`log_moment`]; about the value that `eval` finds.
const UNIFORM: f32 = 0.03;

/// Mean over trees of ln ∫ t² / (½·p_bsdf + ½·q).
fn log_moment(decoded: &DecodedRows, log_expected: Tensor<2>, device: &Device) -> Tensor<1> {
    let log_mass = accumulate(decoded, log_expected, device);
    let ends: Vec<u32> = (0..decoded.split.len() as u32).filter(|&r| !decoded.split[r as usize]).collect();
    let area = |r: usize| 0.25f32.powi(i32::from(decoded.level[r]));
    let others = ends.iter().map(|&r| 0.5 * decoded.bsdf[r as usize] + 0.5 * UNIFORM * area(r as usize));
    let others = rows(others.collect(), 1, device);
    let squares = rows(ends.iter().map(|&r| decoded.mass[r as usize].powi(2)).collect(), 1, device);
    let guide = log_mass.select(0, index(&ends, device)).exp().mul_scalar(0.5 * (1.0 - UNIFORM));
    let terms = squares / (guide + others);
    let trees: Vec<u32> = ends.iter().map(|&r| decoded.tree[r as usize]).collect();
    let sums = Tensor::<2>::zeros([decoded.trees, 1], device);
    let sums = sums.select_assign(0, index(&trees, device), terms, burn::tensor::IndexingUpdateOp::Add);
    sums.log().mean()
}

/// ln of every row's mass: the sum of ln E from level 1 down.
fn accumulate(decoded: &DecodedRows, log_expected: Tensor<2>, device: &Device) -> Tensor<2> {
    let mut start = 0;
    let mut levels: Vec<Tensor<2>> = vec![];
    let mut before = 0;
    while start < decoded.level.len() {
        let end = start + decoded.level[start..].iter().take_while(|&&l| l == decoded.level[start]).count();
        let mut here = log_expected.clone().narrow(0, start, end - start);
        if let Some(above) = levels.last() {
            let parents: Vec<u32> = decoded.parent[start..end].iter().map(|&p| p - 1 - before as u32).collect();
            here = here + above.clone().select(0, index(&parents, device));
        }
        levels.push(here);
        (before, start) = (start, end);
    }
    Tensor::cat(levels, 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::to_vec;

    /// One tree: level 1 of four nodes, and below its first node another four.
    fn decoded(share_logit: [f32; 8], leaf_logit: [f32; 8], device: &Device) -> DecodedRows {
        let column = |values: [f32; 8]| rows(values.to_vec(), 1, device).require_grad();
        DecodedRows {
            share_logit: column(share_logit),
            leaf_logit: column(leaf_logit),
            parent: vec![0, 0, 0, 0, 1, 1, 1, 1],
            tree: vec![0; 8],
            mass: vec![0.7, 0.1, 0.1, 0.1, 0.4, 0.3, 0.0, 0.0],
            bsdf: vec![0.1, 0.2, 0.2, 0.5, 0.1, 0.0, 0.0, 0.0],
            parent_mass: vec![1.0, 1.0, 1.0, 1.0, 0.7, 0.7, 0.7, 0.7],
            is_leaf: vec![false, true, true, true, true, true, true, true],
            split: vec![true, false, false, false, false, false, false, false],
            level: vec![1, 1, 1, 1, 2, 2, 2, 2],
            trees: 1,
        }
    }

    fn value(loss: Loss, decoded: &DecodedRows) -> f32 {
        to_vec(losses(loss, decoded, 0.0).value.inner())[0]
    }

    #[test]
    fn kl_is_zero_at_the_target_and_exact_elsewhere() {
        let device = Device::flex().autodiff();
        let logs = [0.7f32, 0.1, 0.1, 0.1, 4.0 / 7.0, 3.0 / 7.0, 1e-12, 1e-12].map(f32::ln);
        let exact = decoded(logs, [-60.0; 8], &device);
        assert!(value(Loss::Kl, &exact).abs() < 1e-5);
        assert!(value(Loss::Zhu, &exact).abs() < 1e-5);
        // A parent that is surely a leaf: its mass is spread evenly, whatever the children's shares.
        let leaf = decoded(logs, [60.0; 8], &device);
        let expected = 0.4 * (0.4f32 / 0.175).ln() + 0.3 * (0.3f32 / 0.175).ln();
        assert!((value(Loss::Kl, &leaf) - expected).abs() < 1e-4);
    }

    #[test]
    fn variance_matches_its_integral() {
        let device = Device::flex().autodiff();
        let logs = [0.7f32, 0.1, 0.1, 0.1, 4.0 / 7.0, 3.0 / 7.0, 1e-12, 1e-12].map(f32::ln);
        let decoded = decoded(logs, [-60.0; 8], &device);
        let log_expected = log_expected(&decoded, &device);
        let found = to_vec(log_moment(&decoded, log_expected, &device).inner())[0];
        let guide = |q: f32, area: f32| 0.5 * (0.97 * q + 0.03 * area);
        let expected = 0.1 * 0.1 / (0.5 * 0.2 + guide(0.1, 0.25)) * 2.0
            + 0.1 * 0.1 / (0.5 * 0.5 + guide(0.1, 0.25))
            + 0.4 * 0.4 / (0.5 * 0.1 + guide(0.4, 0.0625))
            + 0.3 * 0.3 / guide(0.3, 0.0625);
        assert!((found - expected.ln()).abs() < 1e-4, "{found} {expected}");
    }

    #[test]
    fn a17_saturated_logits_have_finite_losses_and_gradients() {
        let device = Device::flex().autodiff();
        for loss in [Loss::Kl, Loss::Zhu, Loss::Variance] {
            for (share, leaf) in [(1e4, 1e4), (1e4, -1e4), (-1e4, 1e4), (-1e4, -1e4), (0.0, 0.0)] {
                let mut shares = [0.0; 8];
                (shares[1], shares[6]) = (share, share);
                let decoded = decoded(shares, [leaf; 8], &device);
                let losses = losses(loss, &decoded, 1.0);
                let gradients = losses.total.backward();
                assert!(to_vec(losses.total.inner())[0].is_finite(), "{loss:?} {share} {leaf}");
                for column in [&decoded.share_logit, &decoded.leaf_logit] {
                    let gradient = to_vec(column.grad(&gradients).unwrap());
                    assert!(gradient.iter().all(|g| g.is_finite()), "{loss:?} {share} {leaf}: {gradient:?}");
                }
            }
        }
    }
}
