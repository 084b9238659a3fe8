//! A checksum at the end of an ONNX file, which has none of its own: an entry of the model's metadata (field 14 of `ModelProto`, which
//! may stand anywhere), so that other programs read the file as before.

use std::path::Path;

use crate::base::files::crc32;
use crate::base::{Error, Place, Result};

/// The entry's tag and length, its key, and the tag and length of its value: eight hexadecimal digits.
const HEAD: [u8; 11] = [0x72, 17, 0x0A, 5, b'c', b'r', b'c', b'3', b'2', 0x12, 8];

fn digits(content: &[u8]) -> String {
    format!("{:08x}", crc32([content]))
}

/// The model with the checksum of all its bytes behind them.
pub fn sealed(mut model: Vec<u8>) -> Vec<u8> {
    let digits = digits(&model);
    model.extend(HEAD);
    model.extend(digits.into_bytes());
    model
}

/// Refuses a model whose checksum is not that of its bytes. One without a checksum passes: other programs write none.
///
/// # Errors
/// [`Error::Malformed`] naming `path`.
pub fn check(path: &Path, model: &[u8]) -> Result<()> {
    let Some((content, found)) = model.split_last_chunk::<8>() else { return Ok(()) };
    let Some(content) = content.strip_suffix(&HEAD) else { return Ok(()) };
    let expected = digits(content);
    if expected.as_bytes() == found {
        return Ok(());
    }
    let found = String::from_utf8_lossy(found);
    let message =
        format!("the content's checksum is {expected}, the file says {found}: it is damaged, export it again");
    Err(Error::malformed(Place::part(path, "crc32"), message))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_flipped_bit_is_found() {
        let path = Path::new("a.onnx");
        let good = sealed(b"a model".to_vec());
        assert!(check(path, &good).is_ok() && check(path, b"a model").is_ok() && check(path, b"").is_ok());
        // In the entry's own head a flip only takes the checksum away.
        let head = good.len() - 8 - HEAD.len()..good.len() - 8;
        for bit in (0..8 * good.len()).filter(|bit| !head.contains(&(bit / 8))) {
            let mut bytes = good.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert!(check(path, &bytes).is_err(), "bit {bit}");
        }
    }
}
