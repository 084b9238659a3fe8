//! Full disks, damaged and hostile files, missing libraries, scenes and budgets at the edge, and long-lived processes: a typed error
//! or a defined result, no panic, no memory beyond what the input is worth.

#[path = "support/files.rs"]
#[allow(dead_code, reason = "shared with tests of readers")]
mod files;
#[path = "support/memory.rs"]
mod memory;
#[path = "support/network.rs"]
#[allow(dead_code, reason = "shared with tests of the network")]
mod network;
#[path = "support/scenes.rs"]
#[allow(dead_code, reason = "shared with other tests of light transport")]
mod scenes;
#[path = "support/seeds.rs"]
mod seeds;
#[path = "support/stop.rs"]
mod stop;

use std::collections::HashMap;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use fanal::base::progress::Silent;
use fanal::base::{Error, Result};
use fanal::generate::build::Builder;
use fanal::generate::dataset::DatasetIndex;
use fanal::generate::recipe::Recipe;
use fanal::generate::shard::{read_shard, write_shard};
use fanal::guiding::sample::{field::Evidence, file};
use fanal::guiding::tree::CountedTree;
use fanal::guiding::tree::proposal::Proposal;
use fanal::network::config::VERSION;
use fanal::network::weights::{Model, Weights};
use fanal::picture::{read_exr_channels, read_image};
use fanal::reconstruct::{AsCounted, Reconstructor};
use fanal::render::{Control, GuideMode, RenderSettings, StopRule, render, render_watched};
use fanal::scene::Scene;
use fanal::scene::file::LightFile;
use fanal::scene::readers::{load, resolve};
use glam::Vec3;
use safetensors::SafeTensors;
use safetensors::tensor::TensorView;
use scenes::{GUIDES, ZHU, built, committed, mean, picture, reconstructor, room, settings};

use memory::{held, peak};
use seeds::{kept, tree};

use files::{FILES, JSON, MATERIALS, XML, folder, load_xml, refused, scene_using, xml_with};

/// Tests of this file run one after the other: they count the memory of the whole process.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What reading a small file may take, however it is damaged: a picture format's tables and buffers, threads' stacks of tasks.
const MOST_MEMORY: usize = 64 << 20;

/// Reads `bytes`, which a panic or too much memory would fail; returns the error, which must name the file.
fn read(path: &Path, bytes: &[u8], reader: &dyn Fn(&Path) -> Result<()>, what: &str) -> Option<Error> {
    std::fs::write(path, bytes).unwrap();
    let (result, peak) = peak(|| reader(path));
    assert!(peak < MOST_MEMORY, "{what}: {peak} bytes for a file of {}", bytes.len());
    let error = result.err()?;
    let name = path.file_name().unwrap().to_string_lossy();
    assert!(error.to_string().contains(&*name), "{what}: {error}");
    Some(error)
}

/// The same of a safetensors file with a checksum: every damaged byte of its arrays must be refused.
fn damage_sealed(path: &Path, good: &[u8], reader: &dyn Fn(&Path) -> Result<()>) {
    damage(path, good, true, reader);
    let arrays = header_of(good);
    for at in (arrays..good.len()).step_by((good.len() - arrays).div_ceil(200).max(1)) {
        let mut bytes = good.to_vec();
        bytes[at] ^= 1 << (at % 8);
        assert!(read(path, &bytes, reader, "sealed").is_some(), "{}: damage at {at} went unnoticed", path.display());
    }
}

/// Bytes of a safetensors file before its arrays.
fn header_of(file: &[u8]) -> usize {
    8 + u64::from_le_bytes(file[..8].try_into().unwrap()) as usize
}

/// Reads every beginning of `good` at up to 200 lengths, and `good` with one byte damaged in up to 400 places and three ways.
/// Where `whole` says so, a beginning must be refused.
fn damage(path: &Path, good: &[u8], whole: bool, reader: &dyn Fn(&Path) -> Result<()>) {
    let name = path.display();
    assert!(read(path, good, reader, "good").is_none(), "{name}: the good file must be read");
    for end in (0..good.len()).step_by(good.len().div_ceil(200).max(1)) {
        let error = read(path, &good[..end], reader, &format!("{name} cut at {end}"));
        assert!(error.is_some() || !whole, "{name}: {end} of {} bytes are enough", good.len());
    }
    for at in (0..good.len()).step_by(good.len().div_ceil(400).max(1)) {
        for flip in [0xFF, 0x01, 0x80] {
            let mut bytes = good.to_vec();
            bytes[at] ^= flip;
            read(path, &bytes, reader, &format!("{name} damaged at {at} by {flip:#x}"));
        }
    }
}

/// The safetensors file with one byte of its arrays damaged, and the checksum that then is right: not an accident, but an attack.
fn forged(good: &[u8], flip: impl Fn(usize) -> Option<u8>) -> Vec<u8> {
    let (_, header) = SafeTensors::read_metadata(good).unwrap();
    let file = SafeTensors::deserialize(good).unwrap();
    let mut tensors: Vec<_> = file.tensors();
    tensors.sort_by(|a, b| a.0.cmp(&b.0));
    let mut at = 0;
    let mut change = |byte: &u8| {
        at += 1;
        flip(at - 1).map_or(*byte, |flip| byte ^ flip)
    };
    let data: Vec<Vec<u8>> = tensors.iter().map(|(_, t)| t.data().iter().map(&mut change).collect()).collect();
    let mut crc = flate2::Crc::new();
    data.iter().for_each(|data| crc.update(data));
    let mut metadata: HashMap<String, String> = header.metadata().clone().unwrap();
    metadata.insert("crc32".into(), crc.sum().to_string());
    let view = |((name, t), data): (&(String, TensorView), &'_ Vec<u8>)| {
        // Shapes are those of the good file.
        (name.clone(), t.dtype(), t.shape().to_vec(), data.clone())
    };
    let parts: Vec<_> = tensors.iter().zip(&data).map(view).collect();
    let views =
        parts.iter().map(|(name, dtype, shape, data)| (name, TensorView::new(*dtype, shape.clone(), data).unwrap()));
    safetensors::serialize(views, Some(metadata)).unwrap()
}

/// Forges `good` in up to `most` places; what is read must do no harm.
fn forge(path: &Path, good: &[u8], most: usize, reader: &dyn Fn(&Path) -> Result<()>) {
    let header = header_of(good);
    let data = good.len() - header;
    for at in (0..data).step_by(data.div_ceil(most).max(1)) {
        for flip in [0xFF, 0x01, 0x80] {
            let bytes = forged(good, |place| (place == at).then_some(flip));
            read(path, &bytes, reader, &format!("{} forged at {at} by {flip:#x}", path.display()));
        }
    }
}

#[test]
fn f03_damaged_meshes_and_pictures() {
    let _alone = alone();
    let folder = folder();
    let path = folder.path().join("damaged");
    for name in FILES {
        let good = std::fs::read(folder.path().join(name)).unwrap();
        let scene = scene_using(name, "damaged");
        // A text that ends between two lines may still be a mesh, and after all of its pixels a PNG file only says that it ends.
        damage(&path, &good, !["tetrahedron.obj", "grey.png"].contains(&name), &|_| {
            resolve(scene.clone(), folder.path(), Path::new("scene")).map(drop)
        });
    }
    let good = std::fs::read(folder.path().join("sky.exr")).unwrap();
    damage(&path, &good, true, &|path| read_exr_channels(path).map(drop));
}

#[test]
fn f03_damaged_scenes() {
    let _alone = alone();
    let folder = folder();
    std::fs::write(folder.path().join("materials.xml"), MATERIALS).unwrap();
    for (name, text) in [("scene.json", JSON), ("scene.xml", XML)] {
        // A damaged name may be that of another file, which the message then names.
        let inside = folder.path().display().to_string();
        let reader = |path: &Path| match load(path).map_err(|error| error.to_string()) {
            Err(error) if error.contains(&inside) => Err(Error::Options(format!("{name}: {error}"))),
            other => other.map(drop).map_err(Error::Options),
        };
        damage(&folder.path().join(name), text.as_bytes(), true, &reader);
    }
}

#[test]
fn f03_damaged_models() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let model = network::model(network::config(8, 1, false), 3);
    model.save(folder.path()).unwrap();
    let weights = folder.path().join("weights.safetensors");
    let good = std::fs::read(&weights).unwrap();
    let reader = |path: &Path| Weights::from_bytes(&model.config, &std::fs::read(path).unwrap(), path).map(drop);
    damage_sealed(&weights, &good, &reader);
    std::fs::write(&weights, &good).unwrap();
    let config = folder.path().join("config.json");
    let good = std::fs::read(&config).unwrap();
    damage(&config, &good, true, &|path| match Model::load(path.parent().unwrap()) {
        // Weights do not fit a damaged configuration.
        Err(error) => Err(Error::Options(format!("config.json: {error}"))),
        Ok(_) => Ok(()),
    });
}

#[test]
fn f03_damaged_data() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let shard = folder.path().join("a.safetensors");
    write_shard(&shard, &[tree(1), tree(2)]).unwrap();
    let good = std::fs::read(&shard).unwrap();
    damage_sealed(&shard, &good, &|path| read_shard(path).map(drop));
    forge(&shard, &good, 400, &|path| read_shard(path).map(drop));
    let index = folder.path().join("index.jsonl");
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets/test/index.jsonl");
    let good = std::fs::read(committed).unwrap();
    damage(&index, &good, false, &|path| DatasetIndex::read(path.parent().unwrap()).map(drop));
    let recipe = folder.path().join("recipe.toml");
    let good = std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets/small.toml")).unwrap();
    damage(&recipe, &good, false, &|path| Recipe::read(path).map(drop));
}

#[test]
fn f03_damaged_checkpoints_and_guides() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let scene = committed("door-ajar", [8, 6]);
    for guide in [GUIDES[0], GUIDES[1], GUIDES[6], GUIDES[8], GUIDES[9], GUIDES[10], ZHU] {
        let path = folder.path().join("a.part");
        let settings = settings(guide, 16, 1);
        let checkpoint = kept(&scene, &settings, &path);
        let reconstructor = reconstructor(settings.guide);
        // What is read is gone on with to the end.
        let reader = |_: &Path| {
            let stop = AtomicBool::new(false);
            let control = Control { checkpoint: Some(&checkpoint), ..Control::new(&Silent, &stop) };
            render_watched(&scene, &settings, reconstructor.as_ref(), &control).map(drop)
        };
        let good = std::fs::read(&path).unwrap();
        damage_sealed(&path, &good, &reader);
        forge(&path, &good, 150, &reader);
    }
    let path = folder.path().join("a.guide");
    let settings = settings(GUIDES[1], 16, 1);
    let outcome = render(&scene, &settings, reconstructor(settings.guide).as_ref(), &Silent, &AtomicBool::new(false));
    file::save(&path, &outcome.unwrap().field, &Evidence::default()).unwrap();
    let good = std::fs::read(&path).unwrap();
    damage_sealed(&path, &good, &|path| file::load(path).map(drop));
    forge(&path, &good, 200, &|path| file::load(path).map(drop));
}

/// Counts of gigabytes in files of a few hundred bytes: refused before anything is allocated for them.
#[test]
fn f04_gigabyte_counts_are_refused() {
    let _alone = alone();
    let folder = folder();
    let path = folder.path().join("huge");
    let refused = |name: &str, bytes: &[u8]| {
        let scene = scene_using(name, "huge");
        let reader = |_: &Path| resolve(scene.clone(), folder.path(), Path::new("scene")).map(drop);
        assert!(read(&path, bytes, &reader, name).is_some(), "{name} was read");
    };
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\n\
                  property float z\nelement face 4000000000\nproperty list uchar uint vertex_indices\nend_header\n";
    refused("triangle.ply", header.as_bytes());
    refused("triangle.ply", header.replace("binary_little_endian", "ascii").as_bytes());
    let mut list = header.replace("4000000000", "1").replace("list uchar", "list uint").into_bytes();
    list.extend([0; 12]);
    list.extend([0xFF; 8]);
    refused("triangle.ply", &list);
    let good = std::fs::read(folder.path().join("grey.png")).unwrap();
    let mut huge = good.clone();
    // Width and height in IHDR, and the checksum that then is right.
    huge[16..24].copy_from_slice(&[0, 0, 0x7F, 0xFF, 0, 0, 0x7F, 0xFF]);
    let mut crc = flate2::Crc::new();
    crc.update(&huge[12..29]);
    huge[29..33].copy_from_slice(&crc.sum().to_be_bytes());
    refused("grey.png", &huge);
    let exr = std::fs::read(folder.path().join("sky.exr")).unwrap();
    let mut huge = exr.clone();
    let windows = |at: &usize| exr[*at..].starts_with(&[0, 0, 0, 0, 0, 0, 0, 0, 7, 0, 0, 0, 3, 0, 0, 0]);
    for window in (0..exr.len()).filter(windows) {
        huge[window + 8..window + 16].copy_from_slice(&[0xFF, 0x7F, 0, 0, 0xFF, 0x7F, 0, 0]);
    }
    assert!(huge != exr);
    refused("sky.exr", &huge);
    let serialized = std::fs::read(folder.path().join("two.serialized")).unwrap();
    let mut huge = serialized.clone();
    let end = huge.len();
    huge[end - 4..].copy_from_slice(&[0xFF; 4]);
    refused("two.serialized", &huge);
    let shard = folder.path().join("huge");
    let text = "{\"ids\":{\"dtype\":\"U32\",\"shape\":[4000000000,5],\"data_offsets\":[0,80000000000]}}";
    let mut bytes = (text.len() as u64).to_le_bytes().to_vec();
    bytes.extend(text.as_bytes());
    assert!(read(&shard, &bytes, &|path| read_shard(path).map(drop), "shard").is_some());
    let length = [0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x7F, b'{', b'}'];
    assert!(read(&shard, &length, &|path| read_shard(path).map(drop), "header").is_some());
}

/// Entities, defaults, nesting and includes that grow without end.
#[test]
fn f04_bombs_are_refused() {
    let _alone = alone();
    let folder = folder();
    let entities: String =
        (1..10).map(|i| format!("<!ENTITY e{i} \"{}\">", format!("&e{};", i - 1).repeat(10))).collect();
    let bomb = format!("<!DOCTYPE scene [<!ENTITY e0 \"ha\">{entities}]><scene version=\"&e9;\"/>");
    refused(load_xml(&folder, &bomb), "entities");
    let mut defaults = "<default name='d0x' value='0123456789'/>".to_owned();
    for i in 1..30 {
        defaults += &format!("<default name='d{i}x' value='{}'/>", format!("$d{}x", i - 1).repeat(10));
    }
    assert!(matches!(refused(load_xml(&folder, &xml_with(&defaults)), "defaults"), Error::Limit { .. }));
    let deep = format!("{}{}", "<shape type='cube'>".repeat(5000), "</shape>".repeat(5000));
    refused(load_xml(&folder, &xml_with(&deep)), "nesting");
    // Each file includes the next one twice.
    for i in 0..40 {
        let text = xml_with(&format!("<include filename='i{}.xml'/>", i + 1).repeat(2));
        std::fs::write(folder.path().join(format!("i{i}.xml")), text).unwrap();
    }
    refused(load(&folder.path().join("i0.xml")), "includes");
    for i in 0..2 {
        let text = xml_with(&format!("<include filename='loop{}.xml'/>", 1 - i));
        std::fs::write(folder.path().join(format!("loop{i}.xml")), text).unwrap();
    }
    let error = refused(load(&folder.path().join("loop0.xml")), "recursive include");
    assert!(error.to_string().contains("includes itself"), "{error}");
}

/// Files outside of the scene's folder, whichever way they are named.
#[test]
fn f04_paths_stay_inside() {
    let _alone = alone();
    let outside = tempfile::tempdir().unwrap();
    std::fs::write(outside.path().join("secret.xml"), xml_with("")).unwrap();
    std::fs::write(outside.path().join("secret.ply"), std::fs::read(folder().path().join("triangle.ply")).unwrap())
        .unwrap();
    let scene = outside.path().join("scene");
    std::fs::create_dir(&scene).unwrap();
    let absolute = outside.path().display().to_string();
    for climbing in ["../secret", "a/../../secret", "./../secret", &format!("{absolute}/secret")] {
        let include = xml_with(&format!("<include filename='{climbing}.xml'/>"));
        std::fs::write(scene.join("scene.xml"), include).unwrap();
        let loaded = load(&scene).unwrap_or_else(|error| panic!("{error}"));
        let told = loaded.warnings.iter().filter(|warning| warning.contains("the include is left out")).count();
        assert_eq!((told, loaded.file.shapes.len()), (1, 0), "{climbing}: {:?}", loaded.warnings);
        let mesh = format!("<shape type='ply'><string name='filename' value='{climbing}.ply'/></shape>");
        std::fs::write(scene.join("scene.xml"), xml_with(&mesh)).unwrap();
        refused(load(&scene), climbing);
        let used = scene_using("triangle.ply", &format!("{climbing}.ply"));
        assert!(resolve(used, &scene, Path::new("scene")).is_err(), "{climbing}");
    }
}

/// All modes of all seeds must give pixels that are finite and not negative.
fn sane(scene: &Scene) -> Vec<f64> {
    GUIDES
        .into_iter()
        .flat_map(|guide| [true, false].map(|nee| (guide, nee)))
        .map(|(guide, nee)| {
            let mut settings = settings(guide, 16, 1);
            settings.transport.light_sampling = nee;
            let image = picture(scene, &settings);
            assert_eq!(image.pixels.len(), (scene.size[0] * scene.size[1]) as usize);
            assert!(image.pixels.iter().all(|p| p.is_finite() && p.min_element() >= 0.0), "{guide:?}, nee {nee}");
            mean(&image)
        })
        .collect()
}

#[test]
fn f06_nothing_to_see_is_black() {
    let _alone = alone();
    let empty = Builder::new("empty", [8, 6]);
    assert!(sane(&built(empty.finish())).iter().all(|&m| m == 0.0));
    let mut dark = room([8, 6], 0.0);
    dark.render(20, 16);
    assert!(sane(&built(dark.finish())).iter().all(|&m| m == 0.0));
}

/// An empty scene under a sky shows the sky.
#[test]
fn f06_a_sky_without_ground() {
    let _alone = alone();
    let mut b = Builder::new("sky", [8, 6]);
    b.add_light(LightFile::Constant { radiance: [0.25; 3] });
    assert!(sane(&built(b.finish())).iter().all(|m| (m - 0.25).abs() < 1e-6));
}

/// In the middle of a solid wall that lets no light in; and exactly on a surface, which may show either side.
#[test]
fn f06_a_camera_inside_a_wall() {
    let _alone = alone();
    let mut b = room([8, 6], 10.0);
    b.look_at(Vec3::new(-0.25, -0.5, -0.25), Vec3::ZERO, Vec3::Y, 70.0);
    assert!(sane(&built(b.finish())).iter().all(|&m| m == 0.0));
    let mut b = room([8, 6], 10.0);
    b.look_at(Vec3::new(-0.25, 0.0, -0.25), Vec3::new(1.0, 0.0, 1.0), Vec3::Y, 70.0);
    sane(&built(b.finish()));
}

#[test]
fn f06_one_pixel() {
    let _alone = alone();
    // Without light sampling, every other one, sixteen paths may all miss the lamp.
    assert!(sane(&built(room([1, 1], 10.0).finish())).iter().step_by(2).all(|&m| m > 0.0));
}

#[test]
fn f06_budgets_without_samples_are_refused() {
    let _alone = alone();
    let scene = built(room([4, 4], 1.0).finish());
    let refused = |settings: &RenderSettings| {
        let outcome = render(&scene, settings, &AsCounted::default(), &Silent, &AtomicBool::new(false));
        matches!(outcome, Err(Error::Options(_)))
    };
    for stop in [StopRule::Spp(0), StopRule::Time(0.0), StopRule::Time(-1.0), StopRule::Time(f64::NAN)] {
        assert!(refused(&RenderSettings::new(GuideMode::Hybrid, stop)), "{stop:?}");
    }
    let mut settings = RenderSettings::new(GuideMode::None, StopRule::Spp(1));
    settings.transport.max_depth = 0;
    assert!(refused(&settings));
}

/// More threads than pixels, and one thread, give the picture of any other number.
#[test]
fn f06_threads_and_pixels() {
    let _alone = alone();
    let scene = built(room([3, 1], 10.0).finish());
    for guide in [GUIDES[0], GUIDES[6]] {
        let settings = settings(guide, 16, 1);
        let image = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| picture(&scene, &settings))
        };
        assert_eq!(image(1), image(64), "{guide:?}");
    }
}

fn fanal(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_fanal")).args(arguments).output().expect("the program was built for this test")
}

/// What a command that failed says, in one paragraph without panic.
fn told(output: &Output) -> String {
    let text = String::from_utf8_lossy(&output.stderr).trim_end().to_owned();
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(!text.contains("panicked") && text.lines().count() == 1, "{text}");
    text
}

#[test]
fn f06_empty_pictures_are_refused() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.exr").display().to_string();
    let cornell = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell").display().to_string();
    for size in ["0x0", "0x7", "7x0", "40000x2", "32768x32768"] {
        let text = told(&fanal(&["render", &cornell, "-o", &out, "--size", size, "--spp", "1"]));
        assert!(text.contains("pixels"), "{text}");
    }
    for crop in ["0,0,0,0", "8,0,1,1", "0,0,9,1"] {
        let text = told(&fanal(&["render", &cornell, "-o", &out, "--size", "8x6", "--crop", crop, "--spp", "1"]));
        assert!(text.contains("window"), "{text}");
    }
    assert!(!Path::new(&out).exists());
}

/// Folders that take no files are told of before the work: with this budget it would take days.
#[test]
fn f02_bad_outputs_are_told_before_the_work() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let good = folder.path().join("out.exr").display().to_string();
    let missing = folder.path().join("missing/out").display().to_string();
    let cornell = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell").display().to_string();
    let base = ["render", &cornell, "--spp", "16777216", "--guide", "hybrid", "-o"];
    // Nobody may write to /proc, not even the administrator whom permissions do not hold.
    for bad in
        [missing.as_str(), "/proc/out"].into_iter().filter(|bad| !bad.starts_with("/proc") || cfg!(target_os = "linux"))
    {
        let picture = format!("{bad}.exr");
        let options = [
            vec![picture.as_str()],
            vec![&good, "--stats", bad],
            vec![&good, "--save-guide", bad],
            vec![&good, "--checkpoint", bad],
        ];
        for options in options {
            let text = told(&fanal(&[&base[..], &options].concat()));
            assert!(text.contains(Path::new(bad).parent().unwrap().to_str().unwrap()), "{text}");
        }
    }
    if cfg!(target_os = "linux") {
        let recipe = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets/default.toml").display().to_string();
        assert!(told(&fanal(&["dataset", &recipe, "-o", "/proc/data"])).contains("/proc/data"));
        assert!(told(&fanal(&["compare", &cornell, "--spp", "65536", "-o", "/proc/page"])).contains("/proc/page"));
    }
    assert!(!Path::new(&good).exists());
}

/// Runs the program in a shell after `before`, where the picture is to go to `out`; `fallback` is the folder for temporary files.
#[cfg(unix)]
fn in_shell(before: &str, options: &[&str], out: &Path, fallback: &Path) -> Output {
    let cornell = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell").display().to_string();
    let script = format!("{before}; exec \"$0\" \"$@\"");
    let mut command = Command::new("sh");
    command.env("TMPDIR", fallback).args([
        "-c",
        &script,
        env!("CARGO_BIN_EXE_fanal"),
        "render",
        &cornell,
        "--guide",
        "none",
    ]);
    command.args(["--quiet", "-o"]).arg(out).args(options).output().expect("there is a shell")
}

/// Files may not grow beyond 32 KiB, which looks like a full disk: a picture of before stays as it is, nothing is left behind, and a
/// checkpoint that finds no room does not end the render.
#[cfg(unix)]
#[test]
fn f02_full_disks() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.exr");
    std::fs::write(&out, "an older picture").unwrap();
    let limit = "trap '' XFSZ; ulimit -f 64";
    let output = in_shell(limit, &["--spp", "2", "--size", "128x128"], &out, folder.path());
    let text = told(&output);
    assert!(text.contains("out.exr") && text.contains("nor could it be saved"), "{text}");
    assert_eq!(std::fs::read(&out).unwrap(), b"an older picture");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "half a file is left behind");
    let checkpoint = folder.path().join("a.part");
    let options = ["--spp", "4096", "--size", "32x24", "--every", "0.01", "--checkpoint", checkpoint.to_str().unwrap()];
    let output = in_shell(limit, &options, &out, folder.path());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(read_image(&out, false).is_ok() && !checkpoint.exists());
}

/// What a checkpoint holds is not lost by giving the command that began it once more.
#[test]
fn f02_checkpoints_are_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let [out, checkpoint] = ["out.exr", "a.part"].map(|name| folder.path().join(name).display().to_string());
    let cornell = format!("{}/scenes/cornell", env!("CARGO_MANIFEST_DIR"));
    let plain = [
        "render", &cornell, "-o", &out, "--spp", "2", "--size", "8x6", "--guide", "none", "--quiet", "--every", "1e-9",
    ];
    let run = |more: &[&str]| fanal(&[&plain[..], more].concat());
    assert!(run(&["--checkpoint", &checkpoint]).status.success());
    let held = std::fs::read(&checkpoint).unwrap();
    let again = run(&["--checkpoint", &checkpoint]);
    assert!(!again.status.success() && told(&again).contains("--resume"), "{}", told(&again));
    assert_eq!(std::fs::read(&checkpoint).unwrap(), held);
    assert!(run(&["--resume", &checkpoint]).status.success());
    assert!(run(&["--resume", &checkpoint, "--checkpoint", &checkpoint]).status.success());
}

/// A folder that disappears while the picture is rendered: the picture is kept, and the message says where.
#[cfg(unix)]
#[test]
fn f02_lost_folders_do_not_lose_the_picture() {
    let _alone = alone();
    let (folder, fallback) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let lost = folder.path().join("lost");
    std::fs::create_dir(&lost).unwrap();
    // Away as soon as the first picture was shown there.
    let out = lost.join("out.exr");
    let gone = format!("(until [ -e '{}' ]; do sleep 0.1; done; rm -r '{}') & true", out.display(), lost.display());
    // Statistics that cannot be written either must not hide where the picture is.
    let statistics = lost.join("stats.json").display().to_string();
    let output = in_shell(&gone, &["--time", "6", "--size", "64x48", "--stats", &statistics], &out, fallback.path());
    saved_in(fallback.path(), &told(&output));
}

/// The message names the only file of the folder, which is the picture.
#[cfg(unix)]
fn saved_in(fallback: &Path, text: &str) {
    let saved: Vec<_> = std::fs::read_dir(fallback).unwrap().map(|e| e.unwrap().path()).collect();
    assert_eq!(saved.len(), 1, "{text}");
    assert!(text.contains(&*saved[0].to_string_lossy()), "{text}");
    assert_eq!(read_image(&saved[0], false).unwrap().width, 64);
}

/// A disk of 16 KiB that another disk helps out. Where processes may not mount one of their own, nothing is tested.
#[cfg(target_os = "linux")]
#[test]
fn f02_a_full_disk_does_not_lose_the_picture() {
    let _alone = alone();
    let (disk, fallback) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let mount = format!("mount -t tmpfs -o size=16k none '{}'", disk.path().display());
    let apart = ["--map-root-user", "--mount", "sh", "-c"];
    if !Command::new("unshare").args(apart).arg(&mount).status().is_ok_and(|status| status.success()) {
        eprintln!("skipped: no process may mount a disk here");
        return;
    }
    let cornell = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell");
    let output = Command::new("unshare")
        .args(apart)
        .args([&format!("{mount}; exec \"$0\" \"$@\""), env!("CARGO_BIN_EXE_fanal"), "render"])
        .arg(cornell)
        .args(["--guide", "none", "--spp", "4", "--size", "64x48", "-o"])
        .arg(disk.path().join("out.exr"))
        .env("TMPDIR", fallback.path())
        .output();
    saved_in(fallback.path(), &told(&output.unwrap()));
}

/// A model that cannot be used ends the command with an error that names it, and no picture is made by other means; told to do
/// without it, the same command succeeds.
#[test]
fn a18_nothing_is_made_without_the_model_unless_told() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.exr");
    let cornell = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell").display().to_string();
    let model = network::model(network::config(8, 1, false), 10);
    let place = |name: &str| folder.path().join(name);
    let mut broken = model.clone();
    broken.weights.layers.get_mut("decode.leaf").unwrap().bias[0] = f32::NAN;
    assert!(broken.save(&place("not-numbers")).is_err(), "such weights are not written");
    model.save(&place("not-numbers")).unwrap();
    std::fs::write(place("not-numbers/weights.safetensors"), broken.weights.to_bytes().unwrap()).unwrap();
    let mut other = model.clone();
    other.config.mode.split_share *= 2.0;
    other.save(&place("other-mode")).unwrap();
    model.save(&place("older")).unwrap();
    let config = std::fs::read_to_string(place("older/config.json")).unwrap();
    std::fs::write(place("older/config.json"), config.replace(&format!("\"version\": {VERSION}"), "\"version\": 2"))
        .unwrap();
    let out_text = out.display().to_string();
    let base = ["render", &cornell, "-o", &out_text, "--size", "8x6", "--spp", "8", "--quiet"];
    for (name, says) in
        [("missing", "missing"), ("not-numbers", "decode.leaf"), ("other-mode", "trained"), ("older", "version 2")]
    {
        let model = place(name).display().to_string();
        let text = told(&fanal(&[&base[..], &["--model", &model]].concat()));
        assert!(text.contains(says) && !out.exists(), "{text}");
        for instead in [["--guide", "gaussian"], ["--reconstruct", "gaussian"], ["--guide", "none"]] {
            let output = fanal(&[&base[..], &["--model", &model], &instead].concat());
            assert!(output.status.success() && out.exists(), "{}", String::from_utf8_lossy(&output.stderr));
            std::fs::remove_file(&out).unwrap();
        }
    }
}

/// Fails from its second call on.
struct Failing(AtomicBool);

impl Reconstructor for Failing {
    fn name(&self) -> &'static str {
        "failing"
    }

    fn rays_per_node(&self) -> f64 {
        0.0
    }

    fn reconstruct(&self, trees: &[CountedTree]) -> Result<Vec<Proposal>> {
        if self.0.swap(true, Ordering::Relaxed) {
            return Err(Error::Backend { backend: "failing", message: "out of order".into() });
        }
        AsCounted::default().reconstruct(trees)
    }
}

/// Neither does one that fails in the midst of a render.
#[test]
fn a18_a_model_that_fails_later_ends_the_render() {
    let _alone = alone();
    let scene = committed("door-ajar", [8, 6]);
    let failing = Failing(AtomicBool::new(false));
    let outcome = render(&scene, &settings(GUIDES[6], 64, 1), &failing, &Silent, &AtomicBool::new(false));
    assert!(failing.0.load(Ordering::Relaxed), "it was never asked");
    assert!(matches!(outcome, Err(Error::Backend { backend: "failing", .. })));
}

/// A library that says that it is onnxruntime 1.10, made by the compiler that made this test.
#[cfg(feature = "onnx")]
fn old_onnxruntime(folder: &Path) -> std::path::PathBuf {
    const SOURCE: &str = r#"
        #[repr(C)]
        pub struct Base { api: extern "C" fn(u32) -> *const u8, version: extern "C" fn() -> *const u8 }
        extern "C" fn api(_: u32) -> *const u8 { std::ptr::null() }
        extern "C" fn version() -> *const u8 { b"1.10.0\0".as_ptr() }
        static BASE: Base = Base { api, version };
        #[unsafe(no_mangle)]
        pub extern "C" fn OrtGetApiBase() -> *const Base { &BASE }
    "#;
    let (source, library) = (folder.join("old.rs"), folder.join("old.so"));
    std::fs::write(&source, SOURCE).unwrap();
    let compiler = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let mut command = Command::new(compiler);
    command.args(["--edition", "2024", "--crate-type", "cdylib", "-o"]).arg(&library).arg(&source);
    assert!(command.status().expect("what compiled this test is there").success());
    library
}

/// No library, a text, a folder, a library of something else, and an old one: a typed error that says what to install, and of the old
/// one its version; the embedded backend goes on working in the same process.
#[cfg(feature = "onnx")]
#[test]
fn f05_missing_or_wrong_onnxruntime() {
    use fanal::reconstruct::Neural;
    use fanal::reconstruct::onnx::OnnxBackend;
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let model = network::model(network::config(8, 1, false), 10);
    model.save(folder.path()).unwrap();
    let text = folder.path().join("libonnxruntime.so");
    std::fs::write(&text, "not a library").unwrap();
    let other = std::fs::read_to_string("/proc/self/maps").unwrap_or_default();
    let other = other.split_whitespace().find(|word| word.contains("/libm.so") || word.contains("/libc.so"));
    let old = old_onnxruntime(folder.path());
    let wrong = [folder.path().join("missing.so"), folder.path().to_owned(), text, old.clone()];
    for library in wrong.into_iter().chain(other.map(Into::into)) {
        match OnnxBackend::load_with(folder.path(), &library) {
            Err(Error::Backend { backend: "onnx", message }) => {
                assert!(message.contains("onnxruntime") && message.contains("ORT_DYLIB_PATH"), "{message}");
                assert!(library != old || message.contains("1.10.0"), "{message}");
            }
            other => panic!("{}: {:?}", library.display(), other.err()),
        }
    }
    let neural: Box<dyn Reconstructor> = Box::new(Neural::embedded(folder.path()).unwrap());
    let scene = committed("door-ajar", [8, 6]);
    let settings = settings(GUIDES[6], 16, 1);
    assert!(render(&scene, &settings, neural.as_ref(), &Silent, &AtomicBool::new(false)).is_ok());
}

/// Bytes of memory that the process has.
fn resident() -> Option<usize> {
    let text = std::fs::read_to_string("/proc/self/statm").ok()?;
    text.split_whitespace().nth(1)?.parse::<usize>().ok().map(|pages| pages * 4096)
}

/// A thousand renders by all guides: after the first hundred not a megabyte more is held, and the process has at most 16 MiB more,
/// which leaves room for what the allocator keeps.
#[test]
fn f07_a_thousand_renders() {
    let _alone = alone();
    let scene = committed("door-ajar", [8, 6]);
    let reconstructors: Vec<_> = GUIDES.iter().map(|guide| reconstructor(guide.0)).collect();
    let once = |i: usize| {
        let guide = i % GUIDES.len();
        let settings = settings(GUIDES[guide], 16, i as u64);
        let outcome = render(&scene, &settings, reconstructors[guide].as_ref(), &Silent, &AtomicBool::new(false));
        assert!(outcome.unwrap().image.pixels.iter().all(|pixel| pixel.is_finite()));
    };
    (0..104).for_each(once);
    let (before, had) = (held(), resident());
    (104..1104).for_each(once);
    let more = held() as i64 - before as i64;
    assert!(more < 1 << 20, "{more} bytes more are held");
    if let (Some(had), Some(has)) = (had, resident()) {
        let more = has as i64 - had as i64;
        println!("{} KiB, then {more} bytes more", had >> 10);
        assert!(more < 16 << 20, "the process has {more} bytes more");
    }
}
