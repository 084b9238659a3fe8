//! Model files: what is written is read, and everything else is a typed error that names the place.

use crate::support::network as support;

use std::path::Path;

use fanal::base::Error;
use fanal::network::config::{Config, VERSION};
use fanal::network::weights::{Model, WEIGHTS_FILE, Weights};
use safetensors::SafeTensors;
use support::{config, model};

type Change<T> = fn(&mut T);

fn json(config: &Config) -> Vec<u8> {
    serde_json::to_vec(config).unwrap()
}

fn read(config: &Config, weights: &Weights) -> Result<Model, Error> {
    Model::from_bytes(&json(config), &weights.to_bytes().unwrap())
}

#[test]
fn saved_models_are_loaded() {
    let folder = tempfile::tempdir().unwrap();
    for (i, config) in [config(16, 2, false), config(8, 1, true)].into_iter().enumerate() {
        let model = model(config, 1);
        let folder = folder.path().join(i.to_string());
        model.save(&folder).unwrap();
        assert_eq!(Model::load(&folder).unwrap(), model);
    }
}

#[test]
fn a18_damaged_weights_name_the_tensor() {
    let config = config(16, 1, false);
    let good = model(config.clone(), 2).weights;
    let damage: [(&str, Change<Weights>); 6] = [
        ("encode.in.weight", |w| w.layers.get_mut("encode.in").unwrap().weight[3] = f32::NAN),
        ("decode.leaf.bias", |w| w.layers.get_mut("decode.leaf").unwrap().bias[0] = f32::INFINITY),
        ("decode.share.weight", |w| drop(w.layers.remove("decode.share"))),
        ("encode.conv0.weight", |w| {
            let layer = w.layers.get_mut("encode.conv0").unwrap();
            (layer.rows, layer.columns) = (layer.columns, layer.rows);
            layer.bias.resize(layer.columns, 0.0);
        }),
        ("encode.conv1", |w| drop(w.layers.insert("encode.conv1".into(), w.layers["encode.conv0"].clone()))),
        ("encode.in.weight", |w| {
            let layer = w.layers.get_mut("encode.in").unwrap();
            layer.rows -= 1;
            layer.weight.truncate(layer.rows * layer.columns);
        }),
    ];
    assert!(read(&config, &good).is_ok());
    for (place, damage) in damage {
        let mut weights = good.clone();
        damage(&mut weights);
        match read(&config, &weights) {
            Err(e @ Error::Malformed { .. }) => assert!(e.to_string().contains(place), "{e}"),
            other => panic!("{place}: {other:?}"),
        }
    }
}

#[test]
fn truncated_and_flipped_files_do_not_panic() {
    let config = config(8, 1, false);
    let bytes = model(config.clone(), 3).weights.to_bytes().unwrap();
    let header = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    for end in (0..header + 40).chain([bytes.len() - 1]) {
        let result = Weights::from_bytes(&config, &bytes[..end], Path::new(WEIGHTS_FILE));
        assert!(matches!(result, Err(Error::Malformed { .. })), "{end} bytes");
    }
    for bit in 0..8 * header {
        let mut flipped = bytes.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        // A flip inside white space or padding may be harmless.
        let _ = Weights::from_bytes(&config, &flipped, Path::new(WEIGHTS_FILE));
    }
}

/// The checksum tells every damaged weight; files of other programs have none.
#[test]
fn f03_every_damaged_weight_is_found() {
    let config = config(8, 1, false);
    let bytes = model(config.clone(), 5).weights.to_bytes().unwrap();
    let header = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    for at in (header..bytes.len()).step_by(7) {
        let mut flipped = bytes.clone();
        flipped[at] ^= 1 << (at % 8);
        match Weights::from_bytes(&config, &flipped, Path::new(WEIGHTS_FILE)) {
            Err(e @ Error::Malformed { .. }) => assert!(e.to_string().contains("crc32"), "{e}"),
            other => panic!("byte {at}: {other:?}"),
        }
    }
    let other = SafeTensors::deserialize(&bytes).unwrap();
    let without = safetensors::serialize(other.tensors(), None).unwrap();
    assert!(Weights::from_bytes(&config, &without, Path::new(WEIGHTS_FILE)).is_ok());
}

#[test]
fn a18_models_of_other_versions_and_features_are_refused() {
    let good = config(16, 1, false);
    let weights = model(good.clone(), 4).weights;
    let changes: [(&str, Change<Config>); 7] = [
        ("version 3", |c| c.version = 3),
        ("55 features", |c| c.features = 55),
        ("width 17", |c| c.width = 17),
        ("0 convolutions", |c| c.convolutions = 0),
        ("image must be", |c| c.image = Some(7)),
        ("leaf_threshold", |c| c.leaf_threshold = 1.5),
        ("split_share", |c| c.mode.split_share = -0.1),
    ];
    for (text, change) in changes {
        let mut config = good.clone();
        change(&mut config);
        match read(&config, &weights) {
            Err(e @ Error::Model { .. }) => assert!(e.to_string().contains(text), "{e}"),
            other => panic!("{text}: {:?}", other.map(|model| model.config)),
        }
    }
    let this = format!("\"version\":{VERSION}");
    let newer = String::from_utf8(json(&good)).unwrap().replace(&this, "\"version\":9,\"heads\":4");
    let error = Model::from_bytes(newer.as_bytes(), &weights.to_bytes().unwrap()).unwrap_err();
    assert!(matches!(&error, Error::Model { message, .. } if message.contains('9')), "{error}");
    assert!(matches!(Model::from_bytes(b"{", &[]), Err(Error::Malformed { .. })));
    assert!(matches!(Model::load(Path::new("does/not/exist")), Err(Error::Io { .. })));
}
