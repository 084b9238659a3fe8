//! Names of buffers and pictures: data inside the document, or files beside it (RFC 2397 and RFC 3986, as far as glTF uses them).

use base64::engine::DecodePaddingMode;
use base64::engine::general_purpose::{GeneralPurpose, GeneralPurposeConfig};
use base64::{Engine, alphabet};

use crate::base::{Error, Place, Result};

/// The target of a name.
#[derive(Debug, PartialEq, Eq)]
pub enum Target {
    /// The bytes themselves.
    Data(Vec<u8>),
    /// A path relative to the document.
    File(String),
}

/// Some writers leave out the padding.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// Finds out what `uri`, which is at `place`, names.
///
/// # Errors
/// [`Error::Malformed`] for data that is not base64; [`Error::Unsupported`] for an address elsewhere.
pub fn target(uri: &str, place: &Place) -> Result<Target> {
    if let Some(rest) = uri.strip_prefix("data:") {
        return data(rest, place).map(Target::Data);
    }
    // A letter alone before a colon would be a drive, which the path's own check refuses.
    let scheme = uri.split_once(':').map(|(scheme, _)| scheme);
    let is_scheme = |name: &str| name.len() > 1 && name.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c));
    if let Some(scheme) = scheme.filter(|name| is_scheme(name)) {
        return Err(Error::Unsupported {
            place: place.clone(),
            what: format!("an address with \"{scheme}:\""),
            supported: "data and files beside the document".into(),
        });
    }
    Ok(Target::File(decoded(uri)))
}

fn data(rest: &str, place: &Place) -> Result<Vec<u8>> {
    let fail = |why: String| Error::malformed(place.clone(), format!("not readable data: {why}"));
    let (kind, text) = rest.split_once(',').ok_or_else(|| fail("there is no comma".into()))?;
    if !kind.ends_with(";base64") {
        return Err(fail("expected \"data:KIND;base64,\"".into()));
    }
    BASE64.decode(text.trim()).map_err(|error| fail(error.to_string()))
}

/// `text` with `%20` and the like replaced; as it is where that gives no text.
fn decoded(text: &str) -> String {
    let mut out = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let Some((&first, after)) = rest.split_first() {
        let hex = |byte: u8| char::from(byte).to_digit(16);
        match (first, after) {
            (b'%', [high, low, ..]) if hex(*high).is_some() && hex(*low).is_some() => {
                out.push((hex(*high).unwrap_or(0) * 16 + hex(*low).unwrap_or(0)) as u8);
                rest = &after[2..];
            }
            _ => {
                out.push(first);
                rest = after;
            }
        }
    }
    String::from_utf8(out).unwrap_or_else(|_| text.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_and_files() {
        let place = Place::file("a.gltf");
        for (uri, expected) in [
            ("data:application/octet-stream;base64,AQID", Target::Data(vec![1, 2, 3])),
            ("data:;base64,AQ", Target::Data(vec![1])),
            ("my%20model.bin", Target::File("my model.bin".into())),
            ("100%.bin", Target::File("100%.bin".into())),
            ("a/b.bin", Target::File("a/b.bin".into())),
        ] {
            assert_eq!(target(uri, &place).unwrap(), expected, "{uri}");
        }
        for bad in ["data:AQID", "data:;base64,A*", "data:text/plain,abc", "https://example.org/a.bin"] {
            target(bad, &place).unwrap_err();
        }
    }
}
