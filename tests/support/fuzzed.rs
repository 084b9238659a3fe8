//! The readers that damaged files are given to: good files of each, words of its format, and what is done with what was read.

use std::io::Cursor;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use fanal::base::progress::Silent;
use fanal::base::random::Random;
use fanal::base::{Error, Result};
use fanal::generate::dataset::{DatasetIndex, INDEX_FILE};
use fanal::generate::parts::{self, Merging, PartIndex};
use fanal::generate::recipe::Recipe;
use fanal::generate::shard::{VERSION, read_shard, write_shard};
use fanal::guiding::sample::field::{Evidence, GuideField};
use fanal::guiding::sample::file;
use fanal::materials::grid::Values;
use fanal::network::embedded::Embedded;
use fanal::network::weights::{Model, Weights};
use fanal::picture::{Display, Layers, Picture, read_exr_channels, read_image, write_picture};
use fanal::reconstruct::Neural;
use fanal::reconstruct::neural::reconstruct_batch;
use fanal::render::guide_part::{self, LearnedHead, merge_guides};
use fanal::render::merge::{Merged, merge, merge_first};
use fanal::render::part_file::{self, PartHead, Totals};
use fanal::render::{Aov, Control, Fireflies, PartOf, RenderSettings, aov, learn_part, render, render_watched};
use fanal::report::{Budget, Experiment, Method, Results, page};
use fanal::scene::Scene;
use fanal::scene::readers::{LoadedScene, Missing, Vol, load, load_lacking, resolve};
use glam::Vec3;
use image::{DynamicImage, ImageFormat, RgbImage};

use crate::containers::Container;
use crate::documents;
use crate::files::{self, scene_using};
use crate::mutate::words;
use crate::network;
use crate::scenes::{GUIDES, committed, reconstructor, settings};
use crate::seeds::{kept, kept_after, tree};

/// Reads a file.
type Read = Box<dyn Fn(&Path) -> Result<()>>;

/// A reader and what it is given.
pub struct Reader {
    pub name: &'static str,
    /// Where it looks for its file.
    pub file: &'static str,
    pub seeds: Vec<Vec<u8>>,
    pub tokens: Vec<Vec<u8>>,
    pub container: Container,
    /// Mutants in a usual run.
    pub inputs: usize,
    pub read: Read,
}

impl Reader {
    fn new(name: &'static str, file: &'static str, seeds: Vec<Vec<u8>>, inputs: usize, read: Read) -> Self {
        let mut tokens: Vec<Vec<u8>> = vec![];
        for seed in seeds.iter().filter(|seed| std::str::from_utf8(seed).is_ok()) {
            tokens.extend(words(seed).into_iter().map(|(start, end)| seed[start..end].to_vec()));
        }
        tokens.sort();
        tokens.dedup();
        Self { name, file, seeds, tokens, container: Container::Plain, inputs, read }
    }

    fn with(mut self, container: Container, tokens: &str) -> Self {
        self.container = container;
        self.tokens.extend(tokens.split_whitespace().map(|token| token.as_bytes().to_vec()));
        self
    }
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Few pixels of a scene with and without guiding: all finite.
fn picture(loaded: &LoadedScene) {
    let Ok(scene) = Scene::build(loaded, [3, 2]) else { return };
    for guide in [GUIDES[0], GUIDES[1]] {
        let mut settings = settings(guide, 4, 1);
        settings.transport.max_depth = 6;
        let outcome = render(&scene, &settings, reconstructor(guide.0).as_ref(), &Silent, &AtomicBool::new(false));
        if let Ok(outcome) = outcome {
            assert!(outcome.image.pixels.iter().all(|pixel| pixel.is_finite()), "{guide:?}: a pixel is not finite");
        }
    }
}

/// A scene that lacks files is rendered without them.
fn scene(path: &Path) -> Result<()> {
    let loaded = match load(path) {
        Err(Error::Missing { .. }) => load_lacking(path, &[], Missing::Skip),
        other => other,
    };
    loaded.map(|loaded| picture(&loaded))
}

/// A scene of what was read as the good file `name` is.
fn used(name: &'static str) -> Read {
    Box::new(move |path| {
        let file = path.file_name().unwrap_or_default().to_string_lossy();
        resolve(scene_using(name, &file), path.parent().unwrap_or(path), Path::new("scene"))
            .map(|loaded| picture(&loaded))
    })
}

/// The mesh seen by the camera of the scene.
fn mesh(name: &'static str) -> Read {
    Box::new(move |path| {
        let file = path.file_name().unwrap_or_default().to_string_lossy();
        let mut scene = scene_using(name, &file);
        let good: fanal::scene::file::SceneFile = serde_json::from_str(files::JSON).expect("it is a scene");
        scene.materials.insert("default".into(), good.materials["default"].clone());
        let mut shape = good.shapes[0].clone();
        shape.geometry = serde_json::from_str("{\"type\":\"mesh\",\"mesh\":\"m\"}").expect("it is a geometry");
        shape.material = "default".into();
        scene.shapes.push(shape);
        scene.lights.extend(good.lights.into_iter().take(3));
        resolve(scene, path.parent().unwrap_or(path), Path::new("scene")).map(|loaded| picture(&loaded))
    })
}

/// A medium in a ball that varies as the file says, and shines so.
fn volume(path: &Path) -> Result<()> {
    let file = path.file_name().unwrap_or_default().to_string_lossy();
    let grid = format!(r#"{{"type": "vol", "file": "{file}", "own_box": true}}"#);
    let medium = format!(
        r#"{{"type": "grid", "density": {grid}, "sigma_t": [1, 2, 3], "albedo": [0.9, 0.9, 0.9], "albedo_grid": {grid},
            "emission": [1, 1, 1], "emission_grid": {grid}}}"#
    );
    let mut scene: fanal::scene::file::SceneFile = serde_json::from_str(files::JSON).expect("it is a scene");
    scene.lights.pop();
    scene.shapes.retain(|shape| shape.name == "lamp");
    scene.meshes.clear();
    scene.media.insert("cloud".into(), serde_json::from_str(&medium).expect("it is a medium"));
    scene.camera.medium = Some("cloud".into());
    resolve(scene, path.parent().unwrap_or(path), Path::new("scene")).map(|loaded| picture(&loaded))
}

/// The reader of this name; `folder` gets the good files that it needs.
pub fn reader(name: &str, folder: &Path) -> Reader {
    let good = files::folder();
    for entry in std::fs::read_dir(good.path()).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, folder.join(path.file_name().unwrap())).unwrap();
    }
    std::fs::write(folder.join("materials.xml"), files::MATERIALS).unwrap();
    let file = |name: &str| std::fs::read(folder.join(name)).unwrap();
    match name {
        "scene_json" => json(folder),
        "scene_xml" => {
            let (seeds, tokens) = documents::xml();
            Reader::new("scene_xml", "scene.xml", seeds, 2_500, Box::new(scene)).with(Container::Plain, tokens)
        }
        "scene_pbrt" => {
            let (seeds, tokens) = documents::pbrt();
            Reader::new("scene_pbrt", "scene.pbrt", seeds, 1_500, Box::new(scene)).with(Container::Plain, tokens)
        }
        "scene_gltf" => {
            let (seeds, tokens) = documents::gltf(false);
            Reader::new("scene_gltf", "scene.gltf", seeds, 2_500, Box::new(scene)).with(Container::Plain, tokens)
        }
        "scene_glb" => {
            let (seeds, tokens) = documents::gltf(true);
            Reader::new("scene_glb", "scene.glb", seeds, 2_500, Box::new(scene)).with(Container::Glb, tokens)
        }
        "mesh_obj" => {
            let quads = b"mtllib a.mtl\no a\ng b\nusemtl c\ns 1\nv 0 0 0 1\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nvt 0.5 0.5\n\
                          f 1/1/1 2/1/1 3/1/1 4/1/1\nf -4/-1/-1 -3/-1/-1 -2/-1/-1\n";
            let seeds = vec![file("tetrahedron.obj"), quads.to_vec()];
            Reader::new("mesh_obj", "mesh.obj", seeds, 20_000, mesh("tetrahedron.obj"))
                .with(Container::Plain, "// / 1/1/1 -1 0/0/0 # \\ 1e9 vp curv")
        }
        "mesh_ply" => Reader::new("mesh_ply", "mesh.ply", plys(), 30_000, mesh("triangle.ply")).with(
            Container::Plain,
            "char uchar short ushort int uint float double int8 uint8 int32 float64 list property element vertex face comment \
             obj_info nx ny nz u v s t red ascii binary_little_endian binary_big_endian end_header vertex_indices",
        ),
        "mesh_curves" => {
            let seeds = vec![b"0 0 0 .1\n1 0 .5 .1\n1 1 0 .2\n0 1 1 .1\n0 2 0 0\n\n0 0 1 1\n1 1 1 .5\n2 0 0 .5\n3 3 3 3\n".to_vec()];
            Reader::new("mesh_curves", "mesh.txt", seeds, 10_000, mesh("hair.txt"))
                .with(Container::Plain, "1e38 -1 nan inf 1e-38 \n\n 0 .")
        }
        "mesh_serialized" => {
            let seeds = vec![files::serialized()];
            Reader::new("mesh_serialized", "mesh.serialized", seeds, 10_000, mesh("two.serialized"))
                .with(Container::Serialized, "")
        }
        "volume" => {
            let bytes = Vol { size: [4, 3, 2], channels: 1, corners: [[0.0; 3], [1.0; 3]], values: Values::Bytes(vec![90; 24]) };
            let floats = Values::Floats((0..24).map(|i| i as f32 * 0.1).collect());
            let colours = Vol { size: [2, 2, 2], channels: 3, corners: [[-1.0; 3], [2.0; 3]], values: floats };
            let seeds = vec![bytes.encode(), colours.encode()];
            Reader::new("volume", "grid.vol", seeds, 600, Box::new(volume)).with(Container::Plain, "VOL")
        }
        "image_exr" => Reader::new("image_exr", "image.exr", exrs(folder), 50_000, Box::new(both_ways))
            .with(Container::Plain, "R G B A Y compression dataWindow displayWindow chlist box2i tiles chunkCount lineOrder"),
        "image_png" => {
            Reader::new("image_png", "image.png", pngs(&file("grey.png")), 20_000, used("grey.png"))
                .with(Container::Png, "IHDR PLTE IDAT IEND tRNS gAMA acTL fcTL fdAT cHRM iCCP sRGB eXIf")
        }
        "image_other" => Reader::new("image_other", "image.tga", pictures(), 20_000, used("grey.png"))
            .with(Container::Plain, "#?RADIANCE FORMAT=32-bit_rle_rgbe EXPOSURE= -Y +X BM TRUEVISION-XFILE."),
        "shard" => {
            let path = folder.join("good");
            write_shard(&path, &[tree(1), tree(2)]).unwrap();
            let seeds = vec![file("good")];
            Reader::new("shard", "a.safetensors", seeds, 60_000, Box::new(|path| read_shard(path).map(drop)))
                .with(Container::Tensors, TENSORS)
        }
        "index" => {
            let seeds = vec![std::fs::read(root().join("datasets/test/index.jsonl")).unwrap()];
            let read = |path: &Path| DatasetIndex::read(path.parent().unwrap_or(path)).map(drop);
            Reader::new("index", "index.jsonl", seeds, 60_000, Box::new(read)).with(Container::Plain, JSON)
        }
        "recipe" => {
            let recipes = ["small", "default", "test"].map(|name| root().join("datasets").join(format!("{name}.toml")));
            let seeds = recipes.map(|path| std::fs::read(path).unwrap()).to_vec();
            let read = |path: &Path| Recipe::read(path).map(|recipe| drop(recipe.jobs()));
            Reader::new("recipe", "recipe.toml", seeds, 60_000, Box::new(read)).with(Container::Plain, "[[ ]] = # \"\"\" ''' { }")
        }
        "model_config" | "model_weights" => model(name == "model_weights", folder),
        "checkpoint" => checkpoint(folder),
        "guide" => guide(folder),
        "part" => part(folder),
        "part_index" => part_index(folder),
        "guide_part" => guide_part(folder),
        "comparison_run" => comparison(folder),
        "results" => {
            compared(folder).unwrap();
            let read = |path: &Path| Results::read(path).map(drop);
            Reader::new("results", "results.json", vec![file("results.json")], 20_000, Box::new(read))
                .with(Container::Plain, JSON)
        }
        _ => panic!("there is no reader {name}"),
    }
}

const TENSORS: &str =
    "dtype shape data_offsets __metadata__ F32 F64 F16 U8 U32 U64 I64 BOOL crc32 version [0] [] [0,0]";
const JSON: &str = "{ } [ ] , : \"\" null true false \\u0000 \\ud800 {} [] [[[[[[[[[[[[[[[[[[[[[[[[";

fn json(folder: &Path) -> Reader {
    let mut seeds = vec![files::JSON.as_bytes().to_vec()];
    for entry in std::fs::read_dir(root().join("scenes")).unwrap() {
        let path = entry.unwrap().path();
        for beside in ["ring.obj", "shade.obj", "smoke.vol"].iter().filter(|name| path.join(name).is_file()) {
            std::fs::copy(path.join(beside), folder.join(beside)).unwrap();
        }
        if path.is_dir() {
            seeds.push(std::fs::read(path.join("scene.json")).unwrap());
        }
    }
    seeds.sort();
    let museum = root().join("tests/support/museum");
    std::fs::copy(museum.join("bumps.tga"), folder.join("bumps.tga")).unwrap();
    seeds.push(std::fs::read(museum.join("scene.json")).unwrap());
    Reader::new("scene_json", "scene.json", seeds, 8_000, Box::new(scene)).with(Container::Plain, JSON)
}

fn plys() -> Vec<Vec<u8>> {
    let rich = "ply\nformat ascii 1.0\ncomment a\nelement vertex 4\nproperty double x\nproperty double y\nproperty float z\n\
        property float nx\nproperty float ny\nproperty float nz\nproperty float u\nproperty float v\nproperty uchar red\n\
        element other 1\nproperty list uchar int what\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 0 0 1 0 0 1\n1 0 0 0 0 1 1 0 2\n1 1 0 0 0 1 1 1 3\n0 1 0 0 0 1 0 1 4\n2 5 6\n4 0 1 2 3\n";
    let mut big =
        b"ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        property float s\nproperty float t\nelement face 1\nproperty list uint ushort vertex_index\nend_header\n"
            .to_vec();
    [0f32, 0., 0., 0., 0., 1., 0., 0., 1., 0., 0., 1., 0., 0., 1.].iter().for_each(|x| big.extend(x.to_be_bytes()));
    big.extend(3u32.to_be_bytes());
    [0u16, 1, 2].iter().for_each(|i| big.extend(i.to_be_bytes()));
    vec![files::ply(), rich.into(), big]
}

/// Pictures by every compression, one in tiles, one of half precision with layers.
fn exrs(folder: &Path) -> Vec<Vec<u8>> {
    use exr::prelude::*;
    let mut seeds = vec![std::fs::read(folder.join("sky.exr")).unwrap()];
    let pixel = |at: Vec2<usize>| (at.x() as f32 * 0.1, f16::from_f32(at.y() as f32), 0.5f32);
    let compressions = [
        Compression::Uncompressed,
        Compression::RLE,
        Compression::ZIP1,
        Compression::ZIP16,
        Compression::PIZ,
        Compression::PXR24,
        Compression::B44,
    ];
    for (i, compression) in compressions.into_iter().enumerate() {
        let blocks = if i % 2 == 0 { Blocks::ScanLines } else { Blocks::Tiles(Vec2(8, 8)) };
        let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
        let channels = SpecificChannels::rgb(pixel);
        let layer = Layer::new((20, 10), LayerAttributes::named("a"), encoding, channels);
        let mut bytes = Cursor::new(vec![]);
        Image::from_layer(layer).write().to_buffered(&mut bytes).unwrap();
        seeds.push(bytes.into_inner());
    }
    seeds
}

fn both_ways(path: &Path) -> Result<()> {
    let channels = read_exr_channels(path);
    read_image(path, false)?;
    channels.map(drop)
}

fn pngs(rgb: &[u8]) -> Vec<Vec<u8>> {
    let encode = |color: png::ColorType, depth: png::BitDepth, bytes: usize| {
        let mut out = vec![];
        let mut encoder = png::Encoder::new(&mut out, 8, 8);
        encoder.set_color(color);
        encoder.set_depth(depth);
        if color == png::ColorType::Indexed {
            encoder.set_palette(vec![0, 64, 128, 255, 0, 9, 8, 7, 6, 5, 4, 3]);
        }
        let pixels: Vec<u8> = (0..bytes).map(|i| (i * 37 % 256) as u8).collect();
        encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
        out
    };
    vec![
        rgb.to_vec(),
        encode(png::ColorType::Grayscale, png::BitDepth::Sixteen, 128),
        encode(png::ColorType::Rgba, png::BitDepth::Sixteen, 512),
        encode(png::ColorType::Indexed, png::BitDepth::Two, 16),
        encode(png::ColorType::GrayscaleAlpha, png::BitDepth::Eight, 128),
    ]
}

fn pictures() -> Vec<Vec<u8>> {
    let rgb = RgbImage::from_fn(16, 12, |x, y| image::Rgb([(x * 16) as u8, (y * 16) as u8, 128]));
    let encode = |picture: DynamicImage, format| {
        let mut bytes = Cursor::new(vec![]);
        picture.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    };
    let grey = DynamicImage::ImageRgb8(rgb.clone()).to_luma8();
    let mut seeds: Vec<_> = [ImageFormat::Jpeg, ImageFormat::Bmp, ImageFormat::Tga, ImageFormat::WebP]
        .into_iter()
        .flat_map(|format| [encode(rgb.clone().into(), format), encode(grey.clone().into(), format)])
        .collect();
    seeds.push(encode(rgb.clone().into(), ImageFormat::Qoi));
    seeds.push(encode(DynamicImage::ImageRgb8(rgb).to_rgb32f().into(), ImageFormat::Hdr));
    seeds.push(std::fs::read(root().join("tests/support/museum/bumps.tga")).unwrap());
    let numbers = (0..3 * 16 * 12).flat_map(|i| (i as f32 / 64.0).to_le_bytes());
    seeds.push(b"PF\n16 12\n-1.0\n".iter().copied().chain(numbers).collect());
    seeds
}

/// Mutants of the configuration beside good weights, or the other way round; what is read reconstructs a tree.
fn model(weights: bool, folder: &Path) -> Reader {
    let models = [network::model(network::config(8, 1, false), 3), network::model(network::config(8, 1, true), 4)];
    let (name, file) = if weights { ("model_weights", "weights.safetensors") } else { ("model_config", "config.json") };
    let tree = network::filled(network::random_topology(3, 60, 4, 0.6), 3);
    let run = move |model: &Model| {
        let reconstructed = reconstruct_batch(model, &Embedded::new(model)?, &[tree.input()])?;
        let sound =
            |shares: &[f32]| shares.iter().all(|&s| s >= 0.0) && (shares.iter().sum::<f32>() - 1.0).abs() < 1e-3;
        assert!(reconstructed[0].node_share[1..].chunks(4).all(sound), "shares that are no distribution");
        Ok::<(), Error>(())
    };
    models[0].save(folder).unwrap();
    let config = models[0].config.clone();
    let seeds = vec![std::fs::read(folder.join(file)).unwrap()];
    let read: Read = if weights {
        Box::new(move |path| {
            let weights = Weights::from_bytes(&config, &std::fs::read(path).unwrap(), path)?;
            run(&Model { config: config.clone(), weights })
        })
    } else {
        Box::new(move |path| Model::load(path.parent().unwrap_or(path)).and_then(|model| run(&model)))
    };
    let container = if weights { Container::Tensors } else { Container::Plain };
    Reader::new(name, file, seeds, 30_000, read).with(container, if weights { TENSORS } else { JSON })
}

/// What is read is gone on with to the end.
fn checkpoint(folder: &Path) -> Reader {
    let (scene, easy) = (committed("door-ajar", [8, 6]), committed("cornell", [8, 6]));
    let path = folder.join("a.part");
    let mut seeds = vec![];
    let mut modes = vec![];
    for guide in [GUIDES[0], GUIDES[1], GUIDES[6], GUIDES[8], GUIDES[9]] {
        // Of the first two the samples by brightness too.
        let fireflies = if modes.len() < 2 { Fireflies::Reweight { kappa: 2.0 } } else { Fireflies::Keep };
        let settings = RenderSettings { fireflies, ..settings(guide, 16, 1) };
        modes.push((kept(&scene, &settings, &path), settings));
        seeds.push(std::fs::read(&path).unwrap());
    }
    // The second chunk is the one of samples that follow noise.
    let adaptive = RenderSettings { adaptive: true, ..settings(GUIDES[0], 16, 1) };
    let noise = (kept_after(2, &easy, &adaptive, &path), adaptive);
    seeds.push(std::fs::read(&path).unwrap());
    let read = move |_: &Path| {
        let mut errors = vec![];
        let all = modes.iter().map(|mode| (&scene, mode)).chain([(&easy, &noise)]);
        for (scene, (checkpoint, settings)) in all {
            let stop = AtomicBool::new(false);
            let control = Control { checkpoint: Some(checkpoint), ..Control::new(&Silent, &stop) };
            match render_watched(scene, settings, reconstructor(settings.guide).as_ref(), &control) {
                Ok(outcome) => {
                    assert!(outcome.image.pixels.iter().all(|pixel| pixel.is_finite()), "a pixel is not finite");
                    return Ok(());
                }
                Err(error) => errors.push(error.to_string()),
            }
        }
        Err(Error::Options(errors.join("; ")))
    };
    Reader::new("checkpoint", "a.part", seeds, 6_000, Box::new(read)).with(Container::Tensors, TENSORS)
}

/// Parts with and without layers and variances, and the sum of one, which are put together with what is there, to a picture that can be read.
fn part(folder: &Path) -> Reader {
    let scene = committed("cornell", [8, 6]);
    let (path, sum) = (folder.join("a.part"), folder.join("a.sum"));
    let seeds = [(1, false), (1, true), (2, true)].map(|(index, detailed)| {
        let part = PartOf::new(index, 2).unwrap();
        let fireflies = if detailed { Fireflies::Keep } else { Fireflies::Reweight { kappa: 2.0 } };
        let settings =
            RenderSettings { part: Some(part), keeps_spread: detailed, fireflies, ..settings(GUIDES[0], 150, 1) };
        let stop = AtomicBool::new(false);
        let outcome = render(&scene, &settings, reconstructor(settings.guide).as_ref(), &Silent, &stop).unwrap();
        let layers = aov::channels(&scene, &settings, &outcome, &[Aov::Depth]).unwrap();
        let head = PartHead {
            part,
            merged: 0,
            in_common: "a scene\nsettings".into(),
            size: [8, 6],
            window: [0, 0, 8, 6],
            samples: 150,
            spp: 150,
            detailed,
            film_layers: [detailed; 2],
            fireflies: fireflies.kappa(),
            channels: vec!["depth.Z".into()],
            attributes: vec![("software".into(), "fanal".into())],
            layer_attributes: Vec::new(),
            totals: Totals::of(&outcome.statistics),
        };
        let own = if index == 1 { &layers[..] } else { &[] };
        part_file::write(&path, &head, &outcome.blocks, outcome.cascade.as_ref(), own).unwrap();
        if head.part.index() == 1 {
            merge_first(std::slice::from_ref(&path), &sum, &Silent).unwrap();
        }
        std::fs::read(&path).unwrap()
    });
    let seeds = [&seeds[..], &[std::fs::read(&sum).unwrap()]].concat();
    let read = |path: &Path| {
        let Merged { image, layers, attributes, placed, .. } = merge(&[path.to_owned()], true, &Silent)?;
        assert!(image.pixels.iter().all(|pixel| pixel.is_finite()), "a pixel is not finite");
        let output = path.with_extension("exr");
        let picture = Picture { image: &image, channels: &layers, window: placed, attributes: &attributes };
        write_picture(&output, &picture, Display::default())?;
        let (.., channels) = read_exr_channels(&output).expect("what was written can be read");
        assert_eq!(channels.len(), 3 + layers.names().len());
        Ok(())
    };
    let tokens = "part merged in_common window samples detailed film_layers channels totals block0.means block1.counts sum.squares layer0";
    Reader::new("part", "a.part", seeds, 30_000, Box::new(read))
        .with(Container::Tensors, &format!("{TENSORS} {tokens}"))
}

/// The index of the only part of data, which is put together.
fn part_index(folder: &Path) -> Reader {
    let mut shards = DatasetIndex::read(&root().join("datasets/test")).unwrap().shards;
    shards.truncate(2);
    for (shard, file) in shards.iter_mut().zip(["a.safetensors", "b.safetensors"]) {
        shard.file = file.into();
        std::fs::write(folder.join(file), "").unwrap();
    }
    let part = PartOf::new(1, 1).unwrap();
    PartIndex { version: VERSION, part, recipe: "0123abcd".into(), jobs: 2, shards }.write(folder).unwrap();
    let name = "index.1-1.json";
    let read = |path: &Path| {
        let folder = path.parent().unwrap_or(path);
        let _ = std::fs::remove_file(folder.join(INDEX_FILE));
        assert_eq!(parts::merge(folder)?, Merging::Done(1));
        DatasetIndex::read(folder).expect("what was written can be read");
        Ok(())
    };
    let seeds = vec![std::fs::read(folder.join(name)).unwrap()];
    Reader::new("part_index", name, seeds, 30_000, Box::new(read)).with(Container::Plain, JSON)
}

/// What is read is sampled everywhere.
fn guide(folder: &Path) -> Reader {
    let scene = committed("door-ajar", [8, 6]);
    let path = folder.join("a.guide");
    let seeds = [GUIDES[1], GUIDES[3], GUIDES[8], GUIDES[9]].map(|guide| {
        let settings = settings(guide, 16, 1);
        let outcome = render(&scene, &settings, reconstructor(guide.0).as_ref(), &Silent, &AtomicBool::new(false));
        file::save(&path, &outcome.unwrap().field, &Evidence::default()).unwrap();
        std::fs::read(&path).unwrap()
    });
    let read = |path: &Path| file::load(path).map(|(field, _)| sampled(&field));
    Reader::new("guide", "a.guide", seeds.to_vec(), 40_000, Box::new(read)).with(Container::Tensors, TENSORS)
}

fn sampled(field: &GuideField) {
    let mut random = Random::new(1, 2, 3);
    for i in 0..64 {
        let point = Vec3::new(random.range(-5.0, 5.0), random.range(-5.0, 5.0), random.range(-5.0, 5.0));
        let Some(directions) = field.at(point, Vec3::Y).and_then(|voxel| voxel.at(point)) else { continue };
        let (direction, pdf) = directions.sample(random.next_2d_f64());
        let again = directions.pdf(direction);
        let sound = direction.is_finite() && pdf.is_finite() && pdf >= 0.0 && again.is_finite() && again >= 0.0;
        assert!(sound, "sample {i}: {direction} with density {pdf}, then {again}");
    }
}

/// What one process has learned becomes a guide, which is sampled everywhere.
fn guide_part(folder: &Path) -> Reader {
    let scene = committed("door-ajar", [8, 6]);
    let path = folder.join("a.guide");
    let seeds = [GUIDES[1], GUIDES[5]].map(|guide| {
        let part = PartOf::new(1, 1).unwrap();
        let settings = RenderSettings { part: Some(part), ..settings(guide, 16, 1) };
        let stop = AtomicBool::new(false);
        let control = Control::new(&Silent, &stop);
        let learned = learn_part(&scene, &settings, reconstructor(guide.0).as_ref(), &control).unwrap();
        let head = LearnedHead {
            part,
            in_common: "a scene".into(),
            voxels: learned.voxels,
            rays: learned.rays,
            settings: settings.learner.clone(),
            reconstruction: settings.reconstruction,
            mode: settings.mode(),
        };
        guide_part::write(&path, &head, &learned.learner, None).unwrap();
        std::fs::read(&path).unwrap()
    });
    let read = |path: &Path| {
        let none = || Err(Error::Options("there is no network".into()));
        let (field, _) = merge_guides(&[path.to_owned()], |reconstruction, _| reconstruction.reconstructor(none))?;
        sampled(&field);
        Ok(())
    };
    let tokens = "learned in_common voxels rays settings reconstruction mode tree voxel_samples resolution memory";
    Reader::new("guide_part", "a.guide", seeds.to_vec(), 6_000, Box::new(read))
        .with(Container::Tensors, &format!("{TENSORS} {tokens}"))
}

/// A comparison of two methods in this folder, with its page; runs that are there and sound are kept.
fn compared(folder: &Path) -> Result<()> {
    let loaded = load(&root().join("scenes/cornell"))?;
    let neural = Neural::built_in()?;
    let experiment = Experiment {
        denoiser: None,
        loaded: &loaded,
        path: "cornell".into(),
        load_seconds: 0.0,
        settings: settings(GUIDES[6], 1, 1),
        size: [8, 6],
        methods: [GUIDES[0], GUIDES[5]].map(|guide| Method::Guide(guide.0)).to_vec(),
        variants: &[],
        budgets: vec![Budget::Spp(1)],
        seeds: 1,
        reference: None,
        reference_spp: 1,
        oracle_spp: 1,
        neural: &neural,
        folder,
    };
    let comparison = experiment.run(&Silent, &AtomicBool::new(false))?;
    page::write(&comparison, folder)
}

/// The record of a run is damaged; the comparison that finds it goes on, and makes the run again where it has to.
fn comparison(folder: &Path) -> Reader {
    const RECORD: &str = "runs/gaussian-1spp-1.json";
    compared(folder).unwrap();
    let seeds = vec![std::fs::read(folder.join(RECORD)).unwrap()];
    let read = |path: &Path| {
        let folder = path.ancestors().nth(2).expect("it lies in a folder of the folder");
        compared(folder)?;
        Results::read(&folder.join("results.json")).map(drop)
    };
    Reader::new("comparison_run", RECORD, seeds, 1_000, Box::new(read)).with(Container::Plain, JSON)
}
