//! Every effect of the plan, switched on and off on every scene: what is on without need changes nothing, what only seeks light
//! changes no mean, and what is part of the scene is gone as if the scene file had never had it.

use crate::support::{blocks, scenes, statistics};

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use fanal::base::progress::Silent;
use fanal::picture::Image;
use fanal::render::{GuideMode, Reconstruction, RenderSettings, render};
use fanal::scene::Scene;
use fanal::scene::file::{LightFile, SceneFile};
use fanal::scene::overrides::{Override, decide};
use fanal::scene::plan::{EffectKind, EffectPlan, plan};
use fanal::scene::readers::{LoadedScene, load_with, resolve};
use rayon::prelude::*;
use scenes::{GUIDES, Guide, coarse, reconstructor, settings};
use serde_json::{Value, json};
use statistics::{Summary, sidak};

/// Six blocks.
const SIZE: [u32; 2] = [48, 32];
/// Where pictures are compared bit by bit: what differs does so in most of some hundred pixels.
const SMALL: [u32; 2] = [24, 16];
/// Independent pictures per mean.
const SEEDS: u64 = 5;
/// Samples per pixel of each.
const SPP: u32 = 20;
/// Largest relative error of a mean that is tested.
const MOST_ERROR: f64 = 0.2;
/// Probability that some test of means raises a false alarm.
const FALSE_ALARM: f64 = 0.01;

const NONE: Guide = GUIDES[0];
const HYBRID: Guide = GUIDES[1];
const NEURAL: Guide = GUIDES[6];

/// Effects that decide how light is sought, not what there is.
const SEEKING: [EffectKind; 4] =
    [EffectKind::DirectLight, EffectKind::Photons, EffectKind::Guiding, EffectKind::Reconstruction];

/// The folders of all committed scenes, and of one made to have every effect.
fn folders() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let entries = std::fs::read_dir(root.join("scenes")).expect("the scenes are committed");
    let folders = entries.map(|entry| entry.expect("a readable folder").path());
    let mut folders: Vec<PathBuf> = folders.filter(|path| path.join("scene.json").exists()).collect();
    folders.sort();
    folders.push(root.join("tests/support/museum"));
    assert!(folders.len() > 8);
    folders
}

/// A scene with some effects switched, and its plan.
struct Switched {
    scene: Scene,
    plan: EffectPlan,
    max_depth: u32,
}

impl Switched {
    fn new(folder: &Path, overrides: &[Override], size: [u32; 2]) -> Self {
        let loaded = load_with(folder, overrides).unwrap_or_else(|e| panic!("{overrides:?}: {e}"));
        let mut plan = plan(&loaded.file);
        decide(&mut plan, overrides);
        Self { plan, ..Self::of(&loaded, size) }
    }

    fn of(loaded: &LoadedScene, size: [u32; 2]) -> Self {
        let scene = Scene::build(loaded, size).unwrap_or_else(|e| panic!("{}: {e}", loaded.file.name));
        Self { scene, plan: plan(&loaded.file), max_depth: loaded.file.render.max_depth }
    }

    fn picture(&self, guide: Guide, spp: u32, seed: u64) -> Image {
        self.picture_with(coarse(guide, spp, seed).following(&self.plan))
    }

    fn picture_with(&self, mut settings: RenderSettings) -> Image {
        settings.transport.max_depth = self.max_depth;
        let guide = if settings.reconstruction == Reconstruction::None { GuideMode::Hybrid } else { settings.guide };
        let reconstructor = reconstructor(guide);
        let outcome = render(&self.scene, &settings, reconstructor.as_ref(), &Silent, &AtomicBool::new(false));
        let image = outcome.expect("the settings are sound").image;
        assert!(image.pixels.iter().all(|pixel| pixel.is_finite()), "{}: a pixel is not finite", guide.name());
        image
    }

    /// Means of blocks over pictures with seeds of their own.
    fn means(&self, guide: Guide, spp: u32, first_seed: u64) -> Vec<Summary> {
        let seeds = (first_seed..first_seed + SEEDS).into_par_iter();
        let pictures: Vec<Image> = seeds.map(|seed| self.picture(guide, spp, seed)).collect();
        blocks::summaries(&pictures)
    }
}

fn bits(image: &Image) -> Vec<[u32; 3]> {
    image.pixels.iter().map(|p| p.to_array().map(f32::to_bits)).collect()
}

fn lit(image: &Image) -> usize {
    image.pixels.iter().filter(|p| p.max_element() > 0.0).count()
}

/// The loop that is compiled with an effect does to the last bit what the loop without it does, wherever there is nothing for the
/// effect to do; in `none`, and where a guide learns from camera and light paths.
#[test]
fn what_is_on_without_need_changes_nothing() {
    for folder in folders() {
        let whole = Switched::new(&folder, &[], SMALL);
        let guided = whole.picture(HYBRID, SPP, 1);
        let plain = whole.picture(NONE, SPP, 1);
        for effect in whole.plan.effects.iter().filter(|effect| !effect.on) {
            let more = Switched::new(&folder, &[Override { kind: effect.name, on: true }], SMALL);
            let place = format!("{} with {}", folder.display(), effect.name.name());
            assert!(bits(&more.picture(NONE, SPP, 1)) == bits(&plain), "{place}");
            if !SEEKING.contains(&effect.name) {
                assert!(bits(&more.picture(HYBRID, SPP, 1)) == bits(&guided), "{place}, guided");
            }
        }
        assert!(lit(&guided) > 5, "{}: {} pixels are lit", folder.display(), lit(&guided));
    }
}

/// Whether every light can be run into, so that paths find it that do not look for it.
fn is_reachable(file: &SceneFile) -> bool {
    let apart = |light: &LightFile| {
        matches!(light, LightFile::Point { .. } | LightFile::Spot { .. } | LightFile::Directional { .. })
    };
    !file.lights.iter().any(apart)
}

/// The pairs that can be tested: where few samples have found light, means are not normal, and their errors say nothing.
fn known(means: &[Summary], others: &[Summary]) -> Vec<(Summary, Summary)> {
    let known = |mean: &Summary| mean.error() < MOST_ERROR * mean.mean;
    means.iter().copied().zip(others.iter().copied()).filter(|(a, b)| known(a) && known(b)).collect()
}

/// On the scenes that `s05_guided_pictures_agree_with_none` leaves out, whose light is harder to find: every pixel of every mode is
/// finite, and the means of blocks are those of `none`, where there is enough light to tell: in one block at least of every scene
/// and mode, but for `spot`, where five plain pictures of so few samples know of no block (the bench `blocks` has more of them).
#[test]
fn s05_every_mode_on_the_other_scenes() {
    let mut tests = Vec::new();
    let tested = ["cornell", "door-ajar", "glass-caustic", "lamp-room", "pinhole"];
    for folder in folders().into_iter().filter(|folder| !tested.iter().any(|name| folder.ends_with(name))) {
        let whole = Switched::new(&folder, &[], SIZE);
        // Whatever the plan would say.
        let means = |guide: Guide, first: u64| {
            let seeds = (first..first + SEEDS).into_par_iter();
            let pictures: Vec<Image> = seeds.map(|seed| whole.picture_with(settings(guide, SPP, seed))).collect();
            blocks::summaries(&pictures)
        };
        let none = means(NONE, 300);
        for (guide, first) in GUIDES[1..].iter().zip((400..).step_by(100)) {
            let name = format!("{}, {guide:?}", folder.display());
            tests.push((name, known(&none, &means(*guide, first))));
        }
    }
    let blind = tests.iter().filter(|(name, pairs)| pairs.is_empty() && !name.contains("spot"));
    let blind: Vec<&str> = blind.map(|(name, _)| name.as_str()).collect();
    assert!(blind.is_empty(), "no block is known well enough to be compared: {blind:?}");
    let compared: usize = tests.iter().map(|(_, pairs)| pairs.len()).sum();
    println!("{compared} blocks compared");
    assert!(compared > 80, "{compared} blocks only");
    let tail = sidak(FALSE_ALARM, compared);
    for (name, pairs) in &tests {
        for (a, b) in pairs {
            let test = a.welch(b, tail);
            assert!(test <= 1.0, "{name}: {test:.2} of the limit: {a:?} and {b:?}");
        }
    }
}

/// The means of blocks stay the same with each way of seeking light the other way round than the plan has it.
#[test]
fn seeking_light_in_another_way_changes_no_mean() {
    let mut tests = Vec::new();
    for folder in folders() {
        let whole = Switched::new(&folder, &[], SIZE);
        // The network costs more than all else here, so it is used where it is what is compared.
        let planned = [HYBRID, NEURAL].map(|guide| whole.means(guide, SPP, 100));
        let reachable = is_reachable(&load_with(&folder, &[]).expect("it was just read").file);
        for (index, kind) in (0..).zip(SEEKING) {
            if kind == EffectKind::DirectLight && !reachable {
                continue;
            }
            let other = Switched::new(&folder, &[Override { kind, on: !whole.plan.is_on(kind) }], SIZE);
            let neural = kind == EffectKind::Reconstruction;
            let others = other.means(if neural { NEURAL } else { HYBRID }, SPP, 1000 + 100 * index);
            tests.push((folder.display().to_string(), kind, planned[usize::from(neural)].clone(), others));
        }
    }
    let tests = tests.into_iter().map(|(name, kind, means, others)| (name, kind, known(&means, &others)));
    let tests: Vec<_> = tests.collect();
    for kind in SEEKING {
        let scenes = tests.iter().filter(|(_, of, pairs)| *of == kind && !pairs.is_empty()).count();
        assert!(scenes >= 3, "{}: tested on {scenes} scenes only", kind.name());
    }
    let tail = sidak(FALSE_ALARM, tests.iter().map(|(.., pairs)| pairs.len()).sum());
    for (name, kind, pairs) in &tests {
        for (a, b) in pairs {
            let test = a.welch(b, tail);
            assert!(test <= 1.0, "{name} and {}: {test:.2} of the limit: {a:?} and {b:?}", kind.name());
        }
    }
    // The same test sees a lamp that is a fifth brighter: one block would be enough, here most of them tell.
    let folder = &folders()[1];
    let mut loaded = load_with(folder, &[]).expect("it was just read");
    loaded.file.shapes.iter_mut().filter_map(|s| s.emission.as_mut()).for_each(|e| *e = e.map(|x| 1.2 * x));
    let brighter = Switched::of(&loaded, SIZE).means(HYBRID, SPP, 5000);
    let means = Switched::new(folder, &[], SIZE).means(HYBRID, SPP, 100);
    let seen = means.iter().zip(&brighter).filter(|(a, b)| a.welch(b, tail) > 1.0).count();
    assert!(2 * seen > means.len(), "{seen} blocks tell: {means:?} {brighter:?}");
}

/// An effect that is switched off is gone as if the file had never had it: the picture of the file with it taken out by hand.
#[test]
fn what_is_off_is_as_if_it_had_never_been() {
    let mut seen = Vec::new();
    for folder in folders() {
        let whole = Switched::new(&folder, &[], SMALL);
        let pictures = [NONE, HYBRID].map(|guide| bits(&whole.picture(guide, 16, 1)));
        for effect in whole.plan.effects.iter().filter(|effect| effect.on && !SEEKING.contains(&effect.name)) {
            let kind = effect.name;
            let place = format!("{} without {}", folder.display(), kind.name());
            let text = std::fs::read_to_string(folder.join("scene.json")).expect("it was just read");
            let mut file: Value = serde_json::from_str(&text).expect("it was just read");
            take_out(&mut file, kind);
            let file = serde_json::from_value(file).unwrap_or_else(|e| panic!("{place}: {e}"));
            let less = Switched::of(&resolve(file, &folder, &folder).unwrap_or_else(|e| panic!("{place}: {e}")), SMALL);
            let off = Switched::new(&folder, &[Override { kind, on: false }], SMALL);
            let without = [NONE, HYBRID].map(|guide| bits(&off.picture(guide, 16, 1)));
            assert!(without == [NONE, HYBRID].map(|guide| bits(&less.picture(guide, 16, 1))), "{place}");
            assert!(without != pictures, "{place}: nothing changed");
            seen.push(kind);
        }
    }
    for kind in EffectKind::ALL {
        assert!(seen.contains(&kind) || SEEKING.contains(&kind), "no scene has {}", kind.name());
    }
}

/// Takes an effect out of a scene file.
fn take_out(file: &mut Value, kind: EffectKind) {
    use EffectKind as K;
    let lights = |file: &mut Value, kind: &str| {
        file["lights"].as_array_mut().expect("there are lights").retain(|light| light["type"] != kind);
    };
    match kind {
        K::AreaLights => each_shape(file, &["emission"]),
        K::PointLights => lights(file, "point"),
        K::SpotLights => lights(file, "spot"),
        K::DirectionalLights => lights(file, "directional"),
        K::Environment => lights(file, "constant"),
        K::DepthOfField => drop(file["camera"].as_object_mut().map(|camera| camera.remove("aperture_radius"))),
        K::Medium => media(file, "homogeneous"),
        K::Volumes => media(file, "grid"),
        K::Masks => replace(file, "mask", &|mask| mask["material"].clone()),
        K::BumpMaps => replace(file, "bump_map", &|bumps| bumps["material"].clone()),
        K::Textures => {
            replace(file, "bitmap", &|_| json!({"type": "rgb", "value": [0.5, 0.5, 0.5]}));
            replace(file, "checkerboard", &|board| {
                let colour = |key: &str, c: usize| board[key][c].as_f64().expect("a colour") as f32;
                let mean = [0, 1, 2].map(|c| 0.5 * (colour("color0", c) + colour("color1", c)));
                json!({"type": "rgb", "value": mean})
            });
        }
        K::Mirrors => replace(file, "conductor", &plain),
        K::Transmission => replace(file, "dielectric", &plain),
        K::ThinTransmission => replace(file, "thin_dielectric", &plain),
        K::Glossy => {
            // A diffuse surface has no grain.
            take_out(file, K::Anisotropy);
            ["rough_conductor", "principled"].iter().for_each(|kind| replace(file, kind, &plain));
        }
        K::Anisotropy => replace(file, "anisotropic", &|brushed| brushed["material"].clone()),
        K::Coats => {
            replace(file, "principled", &|material| {
                let mut bare = material.clone();
                bare["clearcoat"] = json!(0.0);
                bare
            });
            replace(file, "plastic", &plain);
        }
        K::DirectLight | K::Photons | K::Guiding | K::Reconstruction => {}
    }
}

/// Takes media of this type out.
fn media(file: &mut Value, kind: &str) {
    let Some(all) = file.get_mut("media").and_then(Value::as_object_mut) else { return };
    let of_kind = all.iter().filter(|(_, medium)| medium["type"] == kind).map(|(name, _)| name.clone());
    for name in of_kind.collect::<Vec<_>>() {
        file["media"].as_object_mut().expect("it was just there").remove(&name);
        let forget = |holder: &mut Value, key: &str| {
            if holder.get(key).is_some_and(|medium| *medium == name) {
                holder.as_object_mut().expect("it has keys").remove(key);
            }
        };
        forget(&mut file["camera"], "medium");
        for shape in file["shapes"].as_array_mut().expect("there are shapes") {
            ["interior", "exterior"].iter().for_each(|side| forget(shape, side));
        }
    }
}

fn each_shape(file: &mut Value, without: &[&str]) {
    let shapes = file["shapes"].as_array_mut().expect("there are shapes");
    for shape in shapes.iter_mut().filter_map(Value::as_object_mut) {
        without.iter().for_each(|key| drop(shape.remove(*key)));
    }
}

/// A matt surface of the colour that the material names first.
fn plain(material: &Value) -> Value {
    let mut colours =
        ["base_color", "diffuse_reflectance", "specular_reflectance"].iter().filter_map(|key| material.get(key));
    let default = if material.get("eta").is_some() { 1.0 } else { 0.5 };
    let grey = json!({"type": "rgb", "value": [default, default, default]});
    let colour = colours.next().cloned().unwrap_or(grey);
    json!({"type": "two_sided", "material": {"type": "diffuse", "reflectance": colour}})
}

/// Replaces every part of the materials with this `type`, inner parts first.
fn replace(value: &mut Value, kind: &str, by: &dyn Fn(&Value) -> Value) {
    fn inside(value: &mut Value, kind: &str, by: &dyn Fn(&Value) -> Value) {
        match value {
            Value::Array(items) => items.iter_mut().for_each(|item| inside(item, kind, by)),
            Value::Object(items) => items.values_mut().for_each(|item| inside(item, kind, by)),
            _ => {}
        }
        if value.get("type").is_some_and(|found| found == kind) {
            *value = by(value);
        }
    }
    inside(&mut value["materials"], kind, by);
    value["materials"].as_object_mut().expect("there are materials").values_mut().for_each(once_two_sided);
}

/// Two sides of something two-sided are its own.
fn once_two_sided(material: &mut Value) {
    while material["type"] == "two_sided" && material["material"]["type"] == "two_sided" {
        *material = material["material"].take();
    }
}
