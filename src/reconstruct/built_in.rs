//! The model that is compiled into the program: `models/default`.

use crate::base::Result;
use crate::network::weights::Model;

/// Name of the model in messages, in place of a folder's.
#[cfg(feature = "onnx")]
pub const NAME: &str = "built-in";

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
