//! From scenes to a picture with a model of one's own, through the public commands and interfaces only.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use fanal::base::progress::Silent;
use fanal::generate::collect::generate;
use fanal::generate::dataset::{DatasetIndex, check};
use fanal::generate::recipe::Recipe;
use fanal::generate::{Family, scene};
use fanal::guiding::target::Target;
use fanal::picture::Image;
use fanal::reconstruct::Neural;
use fanal::render::{GuideMode, RenderSettings, StopRule, render};
use fanal::scene::{Scene, readers};

/// A path below the repository's root.
fn root(path: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

fn training(arguments: &[&str]) {
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_fanal-training")).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

fn picture(neural: &Neural) -> Image {
    let file = scene(Family::Rooms, 3, [24, 24]);
    let loaded = readers::resolve(file, Path::new("."), Path::new("room")).unwrap();
    let scene = Scene::build(&loaded, [24, 24]).unwrap();
    let settings = RenderSettings::new(GuideMode::Neural, StopRule::Spp(16));
    neural.check_mode(&settings.mode()).unwrap();
    render(&scene, &settings, neural, &Silent, &AtomicBool::new(false)).unwrap().image
}

#[test]
fn data_of_a_recipe_is_sound_and_made_once() {
    let folder = tempfile::tempdir().unwrap();
    let mut recipe = Recipe::read(&root("datasets/test.toml")).unwrap();
    recipe.family.iter_mut().for_each(|f| f.scenes = 1);
    generate(&recipe, folder.path(), &Silent, &AtomicBool::new(false)).unwrap();
    let made = check(folder.path()).unwrap();
    assert_eq!((made.shards, made.families), (3, 3));
    // Interrupted and started again, nothing is made twice, and what is missing is made.
    let shard = folder.path().join(&DatasetIndex::read(folder.path()).unwrap().shards[1].file);
    let bytes = std::fs::read(&shard).unwrap();
    std::fs::remove_file(&shard).unwrap();
    generate(&recipe, folder.path(), &Silent, &AtomicBool::new(false)).unwrap();
    assert_eq!(check(folder.path()).unwrap(), made);
    assert!(std::fs::read(&shard).unwrap() == bytes);
    // A recipe that looks at its scenes in another way is for another folder.
    let others = [
        Recipe { target_spp: recipe.target_spp + 1, ..recipe.clone() },
        Recipe { grids: vec![9], ..recipe.clone() },
        Recipe { target: Target::Radiance, ..recipe.clone() },
    ];
    for other in others {
        let error = generate(&other, folder.path(), &Silent, &AtomicBool::new(false)).unwrap_err().to_string();
        assert!(error.contains("recipe.json") && error.contains("another folder"), "{error}");
    }
    // So is one whose families are dealt otherwise: its scenes would be there twice, under other numbers.
    let mut fewer = recipe.clone();
    fewer.family.remove(0);
    let error = generate(&fewer, folder.path(), &Silent, &AtomicBool::new(false)).unwrap_err().to_string();
    assert!(error.contains("no scene of this recipe"), "{error}");
    // The same of a folder that has lost its note, which it does not get from a recipe that it refuses.
    let note = folder.path().join("recipe.json");
    let own = std::fs::read(&note).unwrap();
    std::fs::remove_file(&note).unwrap();
    let other = Recipe { seed: recipe.seed + 1, target_spp: recipe.target_spp + 1, ..recipe.clone() };
    let error = generate(&other, folder.path(), &Silent, &AtomicBool::new(false)).unwrap_err().to_string();
    assert!(error.contains("another recipe") && !note.exists(), "{error}");
    generate(&recipe, folder.path(), &Silent, &AtomicBool::new(false)).unwrap();
    assert!(std::fs::read(&note).unwrap() == own);
    // So is one of a program that collects in another mode.
    let mut index = DatasetIndex::read(folder.path()).unwrap();
    index.shards.iter_mut().for_each(|shard| shard.mode.past += 0.25);
    index.write(folder.path()).unwrap();
    let error = generate(&recipe, folder.path(), &Silent, &AtomicBool::new(false)).unwrap_err().to_string();
    assert!(error.contains("mode") && error.contains("another folder"), "{error}");
}

#[test]
fn trains_on_the_committed_shard_with_ndarray_and_renders() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("model");
    let (data, model_arg) = (root("datasets/test"), model.to_str().unwrap());
    let data = data.to_str().unwrap();
    training(&[
        "train",
        "--data",
        data,
        "-o",
        model_arg,
        "--epochs",
        "2",
        "--device",
        "ndarray",
        "--width",
        "8",
        "--convolutions",
        "1",
        "--quiet",
    ]);
    training(&["eval", "--data", data, "--model", model_arg]);
    training(&["export", "--model", model_arg]);
    let embedded = picture(&Neural::embedded(&model).unwrap());
    assert!(embedded.pixels.iter().all(|p| p.is_finite()));
    assert!(embedded.pixels.iter().any(|p| p.length() > 0.0));
    if std::env::var_os("ORT_DYLIB_PATH").is_none() {
        println!("skipped: the onnxruntime part needs ORT_DYLIB_PATH; tests/run sets it");
        return;
    }
    let onnx = picture(&Neural::onnx(&model).unwrap());
    // Distributions differ by rounding, so a few samples fall elsewhere; the means must not.
    let mean = |image: &Image| image.pixels.iter().map(|p| f64::from(p.element_sum())).sum::<f64>();
    assert!((mean(&onnx) / mean(&embedded) - 1.0).abs() < 0.05);
}

/// SIGTERM ends training as Ctrl-C does: with a checkpoint that was not due yet, from which it goes on, and an exit code of its own.
#[cfg(unix)]
#[test]
fn f08_training() {
    use std::process::{Command, Stdio};
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("model");
    let (data, output) = (root("datasets/test").display().to_string(), model.display().to_string());
    let arguments = ["train", "--data", &data, "-o", &output, "--width", "8", "--every", "100000"];
    let mut command = Command::new(env!("CARGO_BIN_EXE_fanal-training"));
    let command = command.args(arguments).args(["--minutes", "1000", "--quiet"]);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // The folder is made when training begins.
    while !model.exists() {
        assert!(child.try_wait().unwrap().is_none(), "it ended before it could be interrupted");
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    assert!(Command::new("sh").args(["-c", &format!("kill -TERM {}", child.id())]).status().unwrap().success());
    let ended = child.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(75), "{}", String::from_utf8_lossy(&ended.stderr));
    assert!(String::from_utf8_lossy(&ended.stdout).contains("steps, best validation"));
    assert!(model.join("checkpoint.safetensors").exists());
    training(&[&arguments[..], &["--epochs", "1", "--resume", "--quiet"]].concat());
    assert!(model.join("report.json").exists());
}
