//! The models that are compiled into the program: `models/default`, and `models/zhu`, whose networks are for ranges of sample counts.

use std::path::Path;

use crate::base::{Error, Result};
use crate::network::weights::Model;

/// Name of the model in messages, in place of a folder's.
#[cfg(feature = "onnx")]
pub const NAME: &str = "built-in";

/// Name, configuration and weights of a network of `models/zhu`.
macro_rules! network {
    ($name:literal) => {
        (
            $name,
            include_bytes!(concat!("../../models/zhu/", $name, "/config.json")),
            include_bytes!(concat!("../../models/zhu/", $name, "/weights.safetensors")),
        )
    };
}

const CONFIG: &[u8] = include_bytes!("../../models/default/config.json");
const WEIGHTS: &[u8] = include_bytes!("../../models/default/weights.safetensors");
/// Encoder of the model for onnxruntime.
#[cfg(feature = "onnx")]
pub const ENCODE: &[u8] = include_bytes!("../../models/default/encode_step.onnx");
/// Decoder of the model for onnxruntime.
#[cfg(feature = "onnx")]
pub const DECODE: &[u8] = include_bytes!("../../models/default/decode_step.onnx");

/// Configuration and weights of the model.
///
/// # Errors
/// [`Error::Model`](crate::base::Error::Model) where the model is of another version than the program.
pub fn model() -> Result<Model> {
    Model::from_bytes(CONFIG, WEIGHTS)
}

/// Which networks there are of Zhu 2021.
pub const ZHU_LIST: &[u8] = include_bytes!("../../models/zhu/networks.json");
/// Names of the folders of these networks, configurations and weights.
const ZHU_NETWORKS: [(&str, &[u8], &[u8]); 5] =
    [network!("0"), network!("100"), network!("500"), network!("1000"), network!("5000")];

/// Configuration and weights of the network of Zhu 2021 in this folder of `models/zhu`.
///
/// # Errors
/// As [`model`]; also where there is none.
pub fn zhu(folder: &Path) -> Result<Model> {
    let found = ZHU_NETWORKS.into_iter().find(|(name, ..)| Path::new(name) == folder);
    let missing = || Error::Model { path: folder.into(), message: "it is not in the program".into() };
    let (_, config, weights) = found.ok_or_else(missing)?;
    Model::from_bytes(config, weights)
}

#[cfg(all(test, feature = "onnx"))]
mod tests {
    use super::*;
    use crate::network::seal;
    use std::path::Path;

    /// A model that was trained again must be exported again. onnxruntime is not needed to see that.
    #[test]
    fn onnx_files_are_of_the_weights() {
        let weights = format!("{:08x}", model().unwrap().weights.checksum());
        // An entry of the metadata: the key with its tag and length, then the value with its own.
        let entry = [b"\x0A\x07weights\x12\x08", weights.as_bytes()].concat();
        for file in [ENCODE, DECODE] {
            assert!(file.windows(entry.len()).any(|part| part == entry), "export models/default again");
            seal::check(Path::new(NAME), file).unwrap();
        }
    }
}
