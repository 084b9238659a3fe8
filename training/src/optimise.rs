//! One step of AdamW on every parameter, with the gradient's norm limited.

use std::collections::BTreeMap;

use burn::optim::{AdamW, AdamWConfig, AdamWState, AdaptiveMomentumState, Optimizer};
use burn::tensor::{Gradients as Graph, Tensor};

use crate::model::{Net, Parameter, to_vec};

/// Gradients of each layer's weight and bias.
pub type Gradients = BTreeMap<String, (Tensor<2>, Tensor<1>)>;

/// Collects the gradients of `net`'s parameters from a backward pass, times `scale`.
pub fn collect(net: &Net, graph: &Graph, scale: f32) -> Gradients {
    let of = |p: &Parameter| Some((p.weight.grad(graph)?.mul_scalar(scale), p.bias.grad(graph)?.mul_scalar(scale)));
    net.parameters().iter().filter_map(|(name, p)| Some((name.clone(), of(p)?))).collect()
}

/// Adds up gradients, in the given order.
pub fn sum(parts: Vec<Gradients>) -> Gradients {
    let mut total = Gradients::new();
    for (name, (weight, bias)) in parts.into_iter().flatten() {
        let sum = match total.remove(&name) {
            Some((w, b)) => (w + weight, b + bias),
            None => (weight, bias),
        };
        total.insert(name, sum);
    }
    total
}

/// Largest norm of the gradient over all parameters together.
const MAX_NORM: f32 = 1.0;

/// AdamW (Loshchilov and Hutter 2019) and its moments per layer.
#[derive(Clone)]
pub struct Optimiser {
    adamw: AdamW,
    /// Moments of each layer's weight and bias.
    pub moments: BTreeMap<String, Moments>,
}

/// First and second moments of a layer's weight and bias, after `time` steps.
#[derive(Debug, Clone)]
pub struct Moments {
    /// Steps taken.
    pub time: usize,
    /// Moments of the weight.
    pub weight: [Tensor<2>; 2],
    /// Moments of the bias.
    pub bias: [Tensor<1>; 2],
}

impl Default for Optimiser {
    fn default() -> Self {
        Self { adamw: AdamWConfig::new().with_weight_decay(1e-4).build(), moments: BTreeMap::new() }
    }
}

impl Optimiser {
    /// Applies the gradients to `net` at learning rate `rate`; returns their norm before limiting. If it is not finite,
    /// nothing changes.
    pub fn step(&mut self, net: &mut Net, gradients: Gradients, rate: f64) -> f32 {
        let square = |values: Vec<f32>| values.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>();
        let norm = gradients.values().map(|(w, b)| square(to_vec(w.clone())) + square(to_vec(b.clone()))).sum::<f64>();
        let norm = norm.sqrt() as f32;
        if !norm.is_finite() {
            return norm;
        }
        let scale = (MAX_NORM / norm.max(1e-12)).min(1.0);
        for (name, (weight_gradient, bias_gradient)) in gradients {
            let moments = self.moments.get(&name);
            let time = moments.map_or(0, |m| m.time);
            let state = moments.map(|m| AdamWState::new(momentum(time, &m.weight)));
            let bias_state = moments.map(|m| AdamWState::new(momentum(time, &m.bias)));
            let Parameter { weight, bias } = net.parameters()[&name].clone();
            let (weight, weight_moments) = self.one(rate, weight.inner(), weight_gradient.mul_scalar(scale), state);
            let (bias, bias_moments) = self.one(rate, bias.inner(), bias_gradient.mul_scalar(scale), bias_state);
            self.moments.insert(name.clone(), Moments { time: time + 1, weight: weight_moments, bias: bias_moments });
            net.set(&name, Parameter { weight, bias });
        }
        norm
    }

    fn one<const D: usize>(
        &self,
        rate: f64,
        tensor: Tensor<D>,
        gradient: Tensor<D>,
        state: Option<AdamWState<D>>,
    ) -> (Tensor<D>, [Tensor<D>; 2]) {
        let zeros = gradient.zeros_like();
        let (tensor, state) = self.adamw.step(rate, tensor, gradient, state);
        // AdamW always returns a state; zeros would only restart its averages.
        let moments = state.map_or([zeros.clone(), zeros], |s| [s.momentum.moment_1, s.momentum.moment_2]);
        (tensor, moments)
    }
}

fn momentum<const D: usize>(time: usize, moments: &[Tensor<D>; 2]) -> AdaptiveMomentumState<D> {
    AdaptiveMomentumState::new(time, moments[0].clone(), moments[1].clone())
}

/// Learning rate at `progress` in [0, 1] after `step` steps: linear warm-up over 100 steps, then a half cosine to 1 %.
pub fn rate(peak: f64, progress: f64, step: u64) -> f64 {
    let warm = ((step + 1) as f64 / 100.0).min(1.0);
    let cosine = 0.5 * (1.0 + (std::f64::consts::PI * progress.clamp(0.0, 1.0)).cos());
    peak * warm * (0.01 + 0.99 * cosine)
}

/// Weight β of the classification at `progress` (Zhu 2021 eq. 17): from 1 down to a small floor at half time.
pub fn beta(progress: f64) -> f64 {
    (1.0 - 2.0 * progress).max(0.05)
}
