//! Cryptomatte in the files that `fanal render` writes.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

use exr::prelude::{ReadChannels, ReadLayers, read};
use fanal::picture::cryptomatte::id;

/// Channels by name, and texts of the header that belong to mattes.
type File = (BTreeMap<String, Vec<f32>>, BTreeMap<String, String>);

fn render(output: &Path, options: &[&str]) -> File {
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell");
    let mut command = Command::new(env!("CARGO_BIN_EXE_fanal"));
    command.arg("render").arg(scene).arg("-o").arg(output).args(["--quiet", "--size", "32x32", "--spp", "24"]);
    assert!(command.args(options).status().expect("the program was built for this test").success());
    let layers = read().no_deep_data().largest_resolution_level().all_channels().all_layers().all_attributes();
    let image = layers.from_file(output).expect("it is an EXR file");
    let [layer] = &image.layer_data[..] else { panic!("one part was asked for") };
    let channel = |channel: &exr::image::AnyChannel<exr::image::FlatSamples>| match &channel.sample_data {
        exr::image::FlatSamples::F32(values) => (channel.name.to_string(), values.clone()),
        _ => panic!("ids need 32 bits"),
    };
    let text = |(name, value): (&exr::prelude::Text, &exr::prelude::AttributeValue)| match value {
        exr::prelude::AttributeValue::Text(text) if name.to_string().starts_with("cryptomatte/") => {
            Some((name.to_string(), text.to_string()))
        }
        _ => None,
    };
    let texts = layer.attributes.other.iter().filter_map(text).collect();
    (layer.channel_data.list.iter().map(channel).collect(), texts)
}

/// The manifest lists what is in the picture and nothing else, under the names of the scene file.
#[test]
fn files_name_what_they_show() {
    let folder = tempfile::tempdir().unwrap();
    let wanted = ["--aov", "crypto-object,crypto-material", "--threads"];
    let [one, three] =
        ["1", "3"].map(|n| render(&folder.path().join(n).with_extension("exr"), &[&wanted[..], &[n]].concat()));
    assert!(one == three, "mattes depend on the number of threads");
    let (channels, texts) = one;
    assert_eq!(texts.len(), 8);
    for (key, matte, known) in [("f834d0a", "crypto_object", "low block"), ("bda530a", "crypto_material", "white")] {
        let text = |entry: &str| texts[&format!("cryptomatte/{key}/{entry}")].as_str();
        assert_eq!([text("name"), text("hash"), text("conversion")], [matte, "MurmurHash3_32", "uint32_to_float32"]);
        let manifest: BTreeMap<String, String> = serde_json::from_str(text("manifest")).unwrap();
        assert!(manifest.contains_key(known), "{manifest:?}");
        assert!(manifest.iter().all(|(name, bits)| *bits == format!("{:08x}", id(name).to_bits())));
        let layer = |channel: &str| (0..3).map(|n| format!("{matte}{n:02}.{channel}")).collect::<Vec<_>>();
        let ids = layer("r").into_iter().chain(layer("b")).flat_map(|name| channels[&name].clone());
        let seen: BTreeSet<String> = ids.filter(|id| *id != 0.0).map(|id| format!("{:08x}", id.to_bits())).collect();
        assert_eq!(seen, manifest.into_values().collect());
        // Away from the picture's border the camera sees nothing but the box.
        let parts: Vec<Vec<f32>> =
            layer("g").into_iter().chain(layer("a")).map(|name| channels[&name].clone()).collect();
        for (i, sum) in (0..32 * 32).map(|i| (i, parts.iter().map(|part| part[i]).sum::<f32>())) {
            let inside = [i % 32, i / 32].iter().all(|at| (3..29).contains(at));
            assert!(sum < 1.0 + 1e-6 && (!inside || sum > 1.0 - 1e-6), "{i}: {sum}");
        }
    }
}
