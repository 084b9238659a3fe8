//! Values that are given from outside for names in a scene document.

use std::str::FromStr;

/// A value for `$name` in a Mitsuba scene, written `name=value`; it goes before what the scene has as its default.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Definition {
    /// The name, without the dollar sign.
    pub name: String,
    /// What stands in its place.
    pub value: String,
}

impl FromStr for Definition {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once('=') {
            Some((name, value)) if !name.is_empty() && !name.contains(char::is_whitespace) => {
                Ok(Self { name: name.to_owned(), value: value.to_owned() })
            }
            _ => Err(format!("\"{text}\" is not a name and a value, as in spp=64")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_values() {
        let read = |text: &str| text.parse::<Definition>().map(|Definition { name, value }| (name, value));
        for (text, name, value) in
            [("spp=64", "spp", "64"), ("x=-1", "x", "-1"), ("a=b=c", "a", "b=c"), ("a=", "a", "")]
        {
            assert_eq!(read(text), Ok((name.to_owned(), value.to_owned())));
        }
        for wrong in ["", "spp", "=64", "s pp=1"] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }
}
