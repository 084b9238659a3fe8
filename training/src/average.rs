//! The mean of models that were trained on from the same weights: it often knows what each of them has learned, and forgets less of what
//! came before (Wortsman et al. 2022).

use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};
use fanal::network::config::Config;
use fanal::network::weights::Model;

/// Writes the mean of the weights of the models in `folders` to `output`, with the configuration of the first.
///
/// # Errors
/// When a model cannot be read, is of another kind than the first, or the mean cannot be written.
pub fn average(folders: &[PathBuf], output: &Path) -> Result<()> {
    let models = folders.iter().map(|folder| Ok(Model::load(folder)?)).collect::<Result<Vec<_>>>()?;
    let [first, others @ ..] = &models[..] else { bail!("a mean needs models") };
    ensure!(!others.is_empty(), "a mean needs at least two models");
    let name = output.file_name().and_then(|name| name.to_str()).unwrap_or("model").to_owned();
    let kind = |config: &Config| Config { name: name.clone(), uniform: first.config.uniform, ..config.clone() };
    for (model, folder) in others.iter().zip(&folders[1..]) {
        ensure!(kind(&model.config) == kind(&first.config), "{}: a model of another kind", folder.display());
    }
    let mut mean = Model { config: kind(&first.config), ..first.clone() };
    for (layer, found) in &mut mean.weights.layers {
        let all = models.iter().filter_map(|model| model.weights.layers.get(layer));
        let (weights, biases): (Vec<_>, Vec<_>) = all.map(|of| (&of.weight[..], &of.bias[..])).unzip();
        set_mean(&mut found.weight, &weights);
        set_mean(&mut found.bias, &biases);
    }
    Ok(mean.save(output)?)
}

fn set_mean(numbers: &mut [f32], all: &[&[f32]]) {
    for (i, number) in numbers.iter_mut().enumerate() {
        *number = (all.iter().map(|of| f64::from(of[i])).sum::<f64>() / all.len() as f64) as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fanal::network::weights::Weights;

    /// Of weights that are known the mean is known; the configuration is the first's under the folder's name; networks of other shapes have
    /// none in common.
    #[test]
    fn means() {
        let folder = tempfile::tempdir().unwrap();
        let shipped = Model::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/default")).unwrap();
        let saved = |name: &str, config: &Config, seed: u64| {
            let model = Model { config: config.clone(), weights: Weights::random(config, seed) };
            model.save(&folder.path().join(name)).unwrap();
            model
        };
        let other = Config { uniform: 0.3, ..shipped.config.clone() };
        let [a, b] = [saved("a", &shipped.config, 1), saved("b", &other, 2)];
        let wider = Config { width: 2 * shipped.config.width, ..shipped.config.clone() };
        saved("wide", &wider, 3);
        let path = |name: &str| folder.path().join(name);
        average(&[path("a"), path("b")], &path("mean")).unwrap();
        let mean = Model::load(&path("mean")).unwrap();
        assert_eq!(mean.config, Config { name: "mean".into(), ..a.config.clone() });
        for (name, layer) in &mean.weights.layers {
            let [a, b] = [&a, &b].map(|model| &model.weights.layers[name]);
            let numbers = |of: &fanal::network::weights::LayerWeights| [&of.weight[..], &of.bias[..]].concat();
            for (mean, (a, b)) in numbers(layer).iter().zip(numbers(a).iter().zip(numbers(b))) {
                assert_eq!(*mean, 0.5 * a + 0.5 * b);
            }
        }
        let refused = |names: &[&str]| {
            let folders: Vec<_> = names.iter().map(|name| path(name)).collect();
            average(&folders, &path("none")).unwrap_err().to_string()
        };
        assert!(refused(&["a", "wide"]).contains("another kind"));
        assert!(refused(&["a"]).contains("at least two"));
    }
}
