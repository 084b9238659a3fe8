//! The network in burn: it learns, does the same on both backends and in the renderer, and goes on after an interruption.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use burn::tensor::Device;
use fanal::base::random::Random;
use fanal::generate::dataset::{DatasetIndex, ShardEntry};
use fanal::generate::shard::{TreeSample, VERSION, write_shard};
use fanal::guiding::tree::features::FEATURES;
use fanal::guiding::tree::topology::Topology;
use fanal::network::backend::Backend;
use fanal::network::config::{Config, Mode};
use fanal::network::embedded::Embedded;
use fanal::network::weights::Model;
use fanal::render::{GuideMode, RenderSettings, StopRule};
use fanal_training::backend::Burn;
use fanal_training::batch::HostBatch;
use fanal_training::cases::{Case, common, mean_kl, reconstruct, tune_uniform};
use fanal_training::forward::{decode, encode};
use fanal_training::journal::Journal;
use fanal_training::loss::{Loss, losses};
use fanal_training::model::{Net, initial_weights, to_vec};
use fanal_training::optimise::{Moments, Optimiser, collect};
use fanal_training::report::{Bin, Report};
use fanal_training::synthetic::{self, tree_samples};
use fanal_training::train::{self, train};
use fanal_training::tuning::tune_gaussian;
use fanal_training::view::View;

fn mode() -> Mode {
    RenderSettings::new(GuideMode::Neural, StopRule::Spp(1)).mode()
}

fn config() -> Config {
    Config {
        version: 1,
        name: "test".into(),
        width: 16,
        convolutions: 2,
        features: FEATURES,
        per_level: false,
        image: None,
        leaf_threshold: 0.5,
        min_split_share: 1e-3,
        uniform: 0.05,
        mode: mode(),
    }
}

fn quick() -> synthetic::Settings {
    synthetic::Settings { samples: [32, 300], target_samples: 4000, split_share: 0.02 }
}

#[allow(deprecated)]
fn ndarray() -> Device {
    Device::ndarray()
}

/// Some steps on one batch; returns the value losses.
fn steps(net: &mut Net, batch: &HostBatch, count: usize, rate: f64, beta: f64) -> Vec<f32> {
    steps_of(&config(), net, batch, count, rate, beta)
}

fn steps_of(config: &Config, net: &mut Net, batch: &HostBatch, count: usize, rate: f64, beta: f64) -> Vec<f32> {
    let mut optimiser = Optimiser::default();
    (0..count)
        .map(|step| {
            let encoded = encode(net, config, batch);
            let decoded = decode(net, config, batch, &encoded, &mut Random::new(1, 0, step as u64));
            let losses = losses(Loss::Kl, &decoded, beta);
            let gradients = collect(net, &losses.total.backward(), 1.0);
            let norm = optimiser.step(net, gradients, rate);
            assert!(norm.is_finite());
            to_vec(losses.value.inner())[0]
        })
        .collect()
}

#[test]
fn overfits_a_few_trees() {
    let samples = tree_samples(&quick(), 11, 0, 32);
    let batch = HostBatch::new(&samples, &config()).unwrap();
    let device = Device::flex().autodiff();
    let mut net = Net::new(&config(), &initial_weights(&config(), 1), &device).unwrap();
    let course = steps(&mut net, &batch, 300, 5e-3, 0.2);
    let cases: Vec<Case> = samples.iter().map(|s| Case::new(s).unwrap()).collect();
    let gaussian = tune_gaussian(&cases);
    let smooth: Vec<_> = cases.iter().map(|c| gaussian.smooth_tree(&c.input())).collect();
    let model = Model { config: config(), weights: net.weights() };
    let found = reconstruct(&model, &Embedded::new(&model).unwrap(), &cases).unwrap();
    let [baseline, network] = [smooth, found].map(|guides| {
        let cells = common(&cases, &guides);
        mean_kl(&cells, tune_uniform(&cells, mean_kl))
    });
    assert!(course[299] < 0.3 * course[0], "{} {}", course[0], course[299]);
    assert!(network < 0.5 * baseline, "network {network}, Gaussian {baseline}");
}

#[test]
fn an_image_network_learns_and_fills_its_image() {
    let config = Config { image: Some(4), ..config() };
    let samples = tree_samples(&quick(), 11, 0, 16);
    let batch = HostBatch::new(&samples, &config).unwrap();
    let mut net = Net::new(&config, &initial_weights(&config, 1), &Device::flex().autodiff()).unwrap();
    let course = steps_of(&config, &mut net, &batch, 100, 5e-3, 0.2);
    assert!(course[99] < 0.6 * course[0], "{} {}", course[0], course[99]);
    let mut model = Model { config, weights: net.weights() };
    let cases: Vec<Case> = samples.iter().map(|s| Case::new(s).unwrap()).collect();
    let trees = |model: &Model| reconstruct(model, &Embedded::new(model).unwrap(), &cases).unwrap();
    let found = trees(&model);
    for tree in &found {
        assert_eq!(*tree.topology(), Topology::complete(4));
    }
    // Training leaves out what its leaf classes say.
    model.weights.layers.get_mut("decode.leaf").unwrap().bias.fill(9.0);
    assert!(trees(&model) == found, "an image has no leaves above its last level");
}

/// A network that says the same everywhere is calibrated where that is the part of leaves, and off by the difference elsewhere.
#[test]
fn calibration_compares_what_is_said_with_what_is() {
    let config = Config { width: 8, convolutions: 1, ..config() };
    let mut weights = initial_weights(&config, 1);
    let leaf = weights.layers.get_mut("decode.leaf").unwrap();
    leaf.weight.fill(0.0);
    leaf.bias.fill(f32::ln(0.7 / 0.3));
    let samples = tree_samples(&synthetic::Settings::default(), 4, 0, 20);
    let report = Report::new(&Model { config, weights }, &samples.iter().collect::<Vec<_>>()).unwrap();
    let filled: Vec<&Bin> = report.calibration.iter().filter(|bin| bin.rows > 0).collect();
    let [bin] = filled.as_slice() else { panic!("{filled:?}") };
    assert!((bin.predicted - 0.7).abs() < 1e-6 && bin.observed > 0.0 && bin.observed < 1.0);
    assert!((report.calibration_error - (bin.predicted - bin.observed).abs()).abs() < 1e-9);
    assert!(report.levels.iter().all(|levels| levels.len() > 2));
    let folder = tempfile::tempdir().unwrap();
    report.write(folder.path()).unwrap();
    assert!(std::fs::read_to_string(folder.path().join("report.svg")).unwrap().contains("</svg>"));
}

#[test]
fn both_devices_agree_over_steps() {
    let batch = HostBatch::new(&tree_samples(&quick(), 12, 0, 8), &config()).unwrap();
    let [flex, other] = [Device::flex(), ndarray()].map(|device| {
        let mut net = Net::new(&config(), &initial_weights(&config(), 2), &device.autodiff()).unwrap();
        (steps(&mut net, &batch, 4, 1e-3, 1.0), net.weights())
    });
    for (a, b) in flex.0.iter().zip(&other.0) {
        assert!((a - b).abs() < 1e-4 * a.abs(), "{a} {b}");
    }
    for (name, layer) in &flex.1.layers {
        for (a, b) in layer.weight.iter().zip(&other.1.layers[name].weight) {
            assert!((a - b).abs() < 1e-3, "{name}: {a} {b}");
        }
    }
}

#[test]
fn burn_agrees_with_the_renderer() {
    for (per_level, image) in [(false, None), (true, None), (false, Some(4))] {
        let config = Config { per_level, image, ..config() };
        let model = Model { weights: initial_weights(&config, 3), config };
        let cases: Vec<Case> = tree_samples(&quick(), 13, 0, 6).iter().map(|s| Case::new(s).unwrap()).collect();
        let embedded = Embedded::new(&model).unwrap();
        for device in [Device::flex(), ndarray()] {
            let burn = Burn::new(&model, &device).unwrap();
            let [a, b] = [&embedded as &dyn Backend, &burn].map(|b| reconstruct(&model, b, &cases).unwrap());
            for (a, b) in a.iter().zip(&b) {
                assert_eq!(a.topology(), b.topology());
                for (x, y) in a.node_mass().iter().zip(b.node_mass()) {
                    assert!((x - y).abs() < 1e-4 * x.max(1e-3), "{x} {y}");
                }
            }
        }
    }
}

/// Degenerate batches: a tree that is only a root, without any sample, alone and beside others.
#[test]
fn roots_without_samples_train() {
    let empty = TreeSample::default();
    let mut mixed = tree_samples(&quick(), 14, 0, 2);
    mixed.push(empty.clone());
    for (samples, device) in [(vec![empty.clone()], Device::flex()), (vec![empty], ndarray()), (mixed, ndarray())] {
        let mut net = Net::new(&config(), &initial_weights(&config(), 4), &device.autodiff()).unwrap();
        let course = steps(&mut net, &HostBatch::new(&samples, &config()).unwrap(), 3, 1e-3, 1.0);
        assert!(course.iter().all(|l| l.is_finite()));
    }
}

fn data_folder(trees: u32) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut index = DatasetIndex::default();
    for (held_out, first, count) in [(false, 0, trees), (true, 10_000, 12)] {
        let file = format!("{first}.safetensors");
        let samples = tree_samples(&quick(), 5, first, count);
        write_shard(&folder.path().join(&file), &samples).unwrap();
        let (scene, family) = (file.clone(), "lobes".into());
        let samples = u64::from(count);
        index.shards.push(ShardEntry {
            version: VERSION,
            file,
            scene,
            family,
            seed: 5,
            held_out,
            samples,
            mode: mode(),
        });
    }
    index.write(folder.path()).unwrap();
    folder
}

/// A short run on the pairs of `data`, whose model goes to the folder `name` beside them.
fn short_run(data: &Path, name: &str) -> train::Settings {
    train::Settings {
        data: vec![data.to_owned()],
        output: data.join(name),
        minutes: None,
        epochs: Some(2),
        resume: false,
        from: None,
        patience: None,
        width: 8,
        convolutions: 1,
        loss: Loss::Kl,
        per_level: false,
        image: None,
        view: View::default(),
        device: Device::flex(),
        seed: 9,
        batch: 8,
        parts: 2,
        rate: 2e-3,
        every: std::time::Duration::from_secs(60),
        stop_after: None,
        quiet: true,
    }
}

#[test]
fn a_resumed_run_equals_an_uninterrupted_one() {
    let data = data_folder(40);
    let base = |name: &str| short_run(data.path(), name);
    let never = AtomicBool::new(false);
    let whole = train(&base("whole"), &never).unwrap();
    assert_eq!(whole.step, 10);
    let first = train(&train::Settings { stop_after: Some(4), ..base("parts") }, &never).unwrap();
    assert_eq!(first.step, 4);
    train(&train::Settings { resume: true, ..base("parts") }, &never).unwrap();
    let weights = |name: &str| {
        let path = data.path().join(name).join(fanal_training::checkpoint::CHECKPOINT_FILE);
        let (state, net, _) = fanal_training::checkpoint::load(&path, &Device::flex()).unwrap();
        (state.step, net.weights())
    };
    let ((a, whole), (b, parts)) = (weights("whole"), weights("parts"));
    assert_eq!(a, b);
    // The same command once more does not replace what there is.
    let again = train(&base("parts"), &never).unwrap_err().to_string();
    assert!(again.contains("--resume") && weights("parts").0 == b, "{again}");
    for (name, layer) in &whole.layers {
        for (x, y) in
            layer.weight.iter().chain(&layer.bias).zip(parts.layers[name].weight.iter().chain(&parts.layers[name].bias))
        {
            assert_eq!(x.to_bits(), y.to_bits(), "{name}: {x} {y}");
        }
    }
    // The last step is logged, whatever its number.
    let short = train(&train::Settings { epochs: Some(1), ..base("short") }, &never).unwrap();
    let log = Journal::read(&data.path().join("short"), u64::MAX);
    assert_eq!((short.step, log.entries.last().map(|entry| entry.step)), (5, Some(5)));
    let other = train::Settings { resume: true, seed: 10, ..base("parts") };
    assert!(train(&other, &never).is_err(), "another seed is another run");
    // As many pairs, of another scene.
    let renamed = data_folder(40);
    let mut index = DatasetIndex::read(renamed.path()).unwrap();
    index.shards[0].scene = "another".into();
    index.write(renamed.path()).unwrap();
    let other = train::Settings { resume: true, data: vec![renamed.path().to_owned()], ..base("parts") };
    assert!(train(&other, &never).is_err(), "other data are another run");
    // A rate of next to nothing improves nothing: the first validation is the best one.
    let every = std::time::Duration::ZERO;
    let stuck = train::Settings { patience: Some(2), rate: 1e-12, epochs: Some(1000), every, ..base("stuck") };
    let ended = train(&stuck, &never).unwrap();
    assert!(ended.step < 1000 && data.path().join("stuck/report.json").exists(), "{} steps", ended.step);
    // The validation that ends an interrupted run is none of those.
    let hour = std::time::Duration::from_secs(3600);
    for step in 1..5 {
        let resume = step > 1;
        let cut = train::Settings { every: hour, resume, stop_after: Some(step), ..stuck.clone() };
        let cut = train::Settings { output: data.path().join("cut"), ..cut };
        assert_eq!(train(&cut, &never).unwrap().step, step);
    }
    let path = data.path().join("cut").join(fanal_training::checkpoint::CHECKPOINT_FILE);
    assert_eq!(fanal_training::checkpoint::load(&path, &Device::flex()).unwrap().0.unimproved, 0);
}

#[test]
fn a_run_from_a_model_begins_with_its_weights() {
    let data = data_folder(40);
    let never = AtomicBool::new(false);
    let folder = |name: &str| data.path().join(name);
    let run = |name: &str| train::Settings { epochs: Some(4), ..short_run(data.path(), name) };
    train(&run("first"), &never).unwrap();
    // At a rate of next to nothing they stay as they were.
    let from = Some(folder("first"));
    let still = train::Settings { from: from.clone(), seed: 10, rate: 1e-30, ..run("still") };
    train(&still, &never).unwrap();
    let weights = |name: &str| Model::load(&folder(name)).unwrap().weights;
    assert_eq!(weights("still").checksum(), weights("first").checksum());
    // The schedule begins in its middle, resumed or not.
    let second = train::Settings { from: from.clone(), stop_after: Some(4), ..run("second") };
    train(&second, &never).unwrap();
    train(&train::Settings { from: None, resume: true, stop_after: None, ..second }, &never).unwrap();
    let highest =
        |name: &str| Journal::read(&folder(name), u64::MAX).entries.iter().map(|entry| entry.beta).fold(0.0, f64::max);
    assert_eq!(highest("second"), 0.05, "classes count least from the beginning");
    assert!(highest("first") > 0.05);
    // Weights of another network are no beginning.
    let wide = train::Settings { from, width: 16, ..run("wide") };
    let error = train(&wide, &never).unwrap_err().to_string();
    assert!(error.contains("--width 8"), "{error}");
}

/// A training checkpoint that is cut, has one bit of its arrays wrong, or moments that no training leaves, is refused by name.
#[test]
fn f03_damaged_training_checkpoints() {
    use fanal_training::checkpoint::{load, save};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.safetensors");
    let device = Device::flex();
    let config = Config { version: fanal::network::config::VERSION, ..config() };
    let net = Net::new(&config, &initial_weights(&config, 3), &device.clone().autodiff()).unwrap();
    let state = fanal_training::checkpoint::State {
        config,
        loss: Loss::Variance,
        view: View::default(),
        seed: 3,
        from: None,
        batch: 4,
        rate: 1e-3,
        parts: 1,
        data: fanal_training::checkpoint::Data { pairs: 9, crc32: 1 },
        step: 7,
        seconds: 1.5,
        best: None,
        unimproved: 0,
    };
    save(&path, &state, &net, &Optimiser::default()).unwrap();
    assert_eq!(load(&path, &device).unwrap().0, state);
    let good = std::fs::read(&path).unwrap();
    let refused = |bytes: &[u8], what: &str| {
        std::fs::write(&path, bytes).unwrap();
        let error = load(&path, &device).err().unwrap_or_else(|| panic!("{what} was read"));
        assert!(format!("{error:#}").contains("a.safetensors"), "{what}: {error:#}");
    };
    for end in (0..good.len()).step_by(good.len() / 100) {
        refused(&good[..end], &format!("a file cut at {end}"));
    }
    let arrays = 8 + u64::from_le_bytes(good[..8].try_into().unwrap()) as usize;
    for at in (arrays..good.len()).step_by((good.len() - arrays) / 200) {
        let mut bytes = good.clone();
        bytes[at] ^= 1 << (at % 8);
        refused(&bytes, &format!("a bit wrong at {at}"));
    }
    // Sealed anew with right checksums: moments of the first layer.
    let (name, layer) = net.parameters().iter().next().unwrap();
    let (weight, bias) = (layer.weight.clone().inner(), layer.bias.clone().inner());
    let forged = |time: usize, sign: f32, scale: f32| {
        let weight = [weight.zeros_like(), weight.ones_like() * (sign * scale)];
        let bias = [bias.zeros_like(), bias.ones_like() * scale];
        let moments = Moments { time, weight, bias };
        let mut optimiser = Optimiser::default();
        optimiser.moments.insert(name.clone(), moments);
        save(&path, &state, &net, &optimiser).unwrap();
        std::fs::read(&path).unwrap()
    };
    let sound = forged(7, 1.0, 1e-3);
    std::fs::write(&path, sound).unwrap();
    assert_eq!(load(&path, &device).unwrap().2.moments[name].time, 7);
    refused(&forged(7, -1.0, 1e-3), "a negative second moment");
    refused(&forged(7, 1.0, f32::NAN), "a moment that is not a number");
    refused(&forged(usize::MAX, 1.0, 1e-3), "more steps than were taken");
}

/// The program is killed at random moments, again and again, and makes the checkpoint that it makes in one go: the same weights and
/// the same moments of the optimiser, bit for bit.
#[test]
fn f01_killed_training_goes_on() {
    use std::time::{Duration, Instant};
    let data = data_folder(64);
    let folder = |name: &str| data.path().join(name);
    let start = |name: &str, resume: bool| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_fanal-training"));
        command.arg("train").arg("--data").arg(data.path()).arg("-o").arg(folder(name));
        command.args(["--epochs", "8", "--width", "8", "--batch", "4", "--threads", "2", "--every", "0.05", "--quiet"]);
        command.args(resume.then_some("--resume")).stdout(std::process::Stdio::null()).spawn().unwrap()
    };
    let checkpoint = |name: &str| folder(name).join(fanal_training::checkpoint::CHECKPOINT_FILE);
    let tensors = |name: &str| {
        let bytes = std::fs::read(checkpoint(name)).unwrap();
        let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
        // The state counts seconds, too.
        let all = file.tensors().into_iter().filter(|(name, _)| name != "state");
        let mut all: Vec<_> = all.map(|(name, t)| (name, t.data().to_vec())).collect();
        all.sort();
        all
    };
    let begun = Instant::now();
    assert!(start("whole", false).wait().unwrap().success());
    let seconds = begun.elapsed().as_secs_f32();
    let whole = tensors("whole");
    assert!(whole.len() > 10);
    let most: u32 = std::env::var("FANAL_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(3);
    let (mut random, mut kills, mut resumed) = (Random::new(1, 0, 0), 0, 0);
    while kills < most {
        let exists = checkpoint("parts").exists();
        let mut child = start("parts", exists);
        std::thread::sleep(Duration::from_secs_f32(random.range(0.1, 0.6) * seconds));
        if let Some(status) = child.try_wait().unwrap() {
            // It came to its end: the next one begins anew.
            assert!(status.success() && whole == tensors("parts"), "other weights or moments");
            std::fs::remove_dir_all(folder("parts")).unwrap();
            continue;
        }
        child.kill().unwrap();
        child.wait().unwrap();
        kills += 1;
        resumed += u32::from(exists);
    }
    println!("training: {kills} kills, {resumed} of runs that went on");
    assert!(start("parts", checkpoint("parts").exists()).wait().unwrap().success());
    assert!(whole == tensors("parts"), "other weights or moments");
}

#[test]
fn the_command_line_trains_evaluates_and_exports() {
    let data = data_folder(24);
    let model = data.path().join("model");
    let run = |arguments: &[&str]| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_fanal-training"));
        let output = command.args(arguments).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let (data_arg, model_arg) = (data.path().to_str().unwrap(), model.to_str().unwrap());
    run(&[
        "train", "--data", data_arg, "-o", model_arg, "--epochs", "2", "--device", "ndarray", "--width", "8",
        "--batch", "8",
    ]);
    for file in ["config.json", "weights.safetensors", "checkpoint.safetensors", "losses.jsonl"] {
        assert!(model.join(file).is_file(), "{file}");
    }
    let json = run(&[
        "eval",
        "--data",
        data_arg,
        "--model",
        model_arg,
        "--json",
        "--ablate",
        "neighbours",
        "--ablate",
        "shuffle",
    ]);
    let evaluation: serde_json::Value = serde_json::from_str(&json).unwrap();
    let rows = evaluation["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 13);
    assert!(rows.iter().all(|r| r["kl"].as_f64().is_some_and(|kl| kl.is_finite() && kl >= 0.0)));
    assert!(run(&["eval", "--data", data_arg, "--model", model_arg]).contains("Gaussian"));
    run(&["export", "--model", model_arg]);
    assert!(model.join("decode_step.onnx").is_file());
}
