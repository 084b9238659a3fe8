//! Cryptomatte (Friedman and Jones 2015, specification 1.1.0): of each pixel the things that are seen in it, by name, with the part of
//! the pixel that each covers, in channels and header of an EXR file. Compositing programs make mattes of them.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::write_exr::{Attribute, Channel};

/// Things of a pixel that are kept, those which cover most; the specification proposes as many.
pub const RANKS: usize = 6;

/// The things of a pixel by their ids, each with the part of the pixel that it covers, largest first, then zeros.
pub type Ranked = [(f32, f32); RANKS];

/// The id of a thing, by its name: MurmurHash3 (Appleby 2011) of its bytes in UTF-8, 32 bits taken for those of a normal number: the
/// exponent is brought into 1 to 254. Things of one name have one id. No id is 0, which stands for nothing.
pub fn id(name: &str) -> f32 {
    let hash = hash(name);
    let exponent = (hash >> 23 & 0xff).clamp(1, 254);
    f32::from_bits(hash & !(0xff << 23) | exponent << 23)
}

fn hash(text: &str) -> u32 {
    // Reading from memory does not fail.
    murmur3::murmur3_32(&mut text.as_bytes(), 0).unwrap_or_default()
}

/// Ranks the things that `samples` samples of a pixel saw, by their ids; what saw nothing is not among `seen`, whose order it changes.
/// Of things that cover as much, that with the lower bits of its id is first.
pub fn ranked(seen: &mut [f32], samples: u32) -> Ranked {
    seen.sort_unstable_by_key(|id| id.to_bits());
    let mut counted: Vec<(f32, usize)> = seen.chunk_by(|a, b| a == b).map(|same| (same[0], same.len())).collect();
    counted.sort_by_key(|&(_, count)| std::cmp::Reverse(count));
    let mut ranks = Ranked::default();
    for (rank, (id, count)) in ranks.iter_mut().zip(counted) {
        *rank = (id, count as f32 / samples as f32);
    }
    ranks
}

/// The channels of the mattes called `matte`, pixel by pixel: two things in each layer of four channels.
pub fn channels(matte: &str, pixels: impl Iterator<Item = Ranked> + Clone) -> Vec<Channel> {
    let channel = |(number, name): (usize, String)| {
        let value = |ranked: Ranked| if number % 2 == 0 { ranked[number / 2].0 } else { ranked[number / 2].1 };
        Channel { name, values: pixels.clone().map(value).collect() }
    };
    names(matte).into_iter().enumerate().map(channel).collect()
}

/// The names of the channels of the mattes called `matte`.
pub fn names(matte: &str) -> Vec<String> {
    (0..2 * RANKS).map(|number| format!("{matte}{:02}.{}", number / 4, ["r", "g", "b", "a"][number % 4])).collect()
}

/// The header's entries for the mattes called `matte` of a picture with these `channels`, which may hold others too. The manifest
/// lists what is seen in the picture, of things with these names.
pub fn attributes<'a>(matte: &str, channels: &[Channel], things: impl IntoIterator<Item = &'a str>) -> [Attribute; 4] {
    let ids: Vec<String> = names(matte).into_iter().step_by(2).collect();
    let mut seen: Vec<u32> = Vec::new();
    for channel in channels.iter().filter(|channel| ids.contains(&channel.name)) {
        // Neighbours mostly see the same.
        seen.extend(channel.values.chunk_by(|a, b| a == b).map(|same| same[0].to_bits()));
        seen.sort_unstable();
        seen.dedup();
    }
    let of = |name: &'a str| (name, id(name).to_bits());
    let things = things.into_iter().map(of).filter(|(_, id)| seen.binary_search(id).is_ok());
    let manifest = manifest(things.collect());
    let key = format!("{:08x}", hash(matte));
    [("name", matte), ("hash", "MurmurHash3_32"), ("conversion", "uint32_to_float32"), ("manifest", &manifest)]
        .map(|(entry, value)| (format!("cryptomatte/{}/{entry}", &key[..7]), value.to_owned()))
}

/// The manifest of what one of two pictures shows, given those of both; the first where they are none.
pub fn united(one: &str, other: &str) -> String {
    let parsed = |text| serde_json::from_str::<BTreeMap<String, String>>(text).ok();
    let (Some(mut all), Some(more)) = (parsed(one), parsed(other)) else { return one.to_owned() };
    all.extend(more);
    let bits = |(name, bits): (&'_ String, &String)| Some((name.clone(), u32::from_str_radix(bits, 16).ok()?));
    let all: BTreeMap<String, u32> = all.iter().filter_map(bits).collect();
    manifest(all.iter().map(|(name, bits)| (name.as_str(), *bits)).collect())
}

/// Names with the bits of their ids as JSON. A header's texts hold no more than Latin-1, so characters beyond ASCII are escaped.
fn manifest(things: BTreeMap<&str, u32>) -> String {
    let entry = |(name, id): (&str, u32)| format!("{}:\"{id:08x}\"", serde_json::Value::from(name));
    let entries: Vec<String> = things.into_iter().map(entry).collect();
    let mut ascii = String::from("{");
    for c in entries.join(",").chars() {
        match c.is_ascii() {
            true => ascii.push(c),
            false => c.encode_utf16(&mut [0; 2]).iter().for_each(|unit| {
                // Writing to a string does not fail.
                let _ = write!(ascii, "\\u{unit:04x}");
            }),
        }
    }
    ascii + "}"
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first three are in the specification, the others by mmh3 of Python (5.3.1).
    #[test]
    fn ids_are_those_of_the_specification() {
        for (name, bits) in [
            ("bunny", 0x13851a76),
            ("default", 0x42c9679f),
            ("bunny_porcelain_mat", 0xb24b26d4),
            ("灯台", 0x9fa48326),
            // Exponents 0 and 255, which are those of 0 and infinity.
            ("shape 274", 0x807feca9 + (1 << 23)),
            ("shape 404", 0xffbed3d6 - (1 << 23)),
            // The hash is 0.
            ("", 1 << 23),
        ] {
            assert_eq!(id(name).to_bits(), bits, "{name:?}");
            assert!(id(name).is_normal());
        }
    }

    #[test]
    fn what_covers_most_comes_first() {
        let [a, b, c] = ["bunny", "default", "c"].map(id);
        let ranks = ranked(&mut [b, a, c, a, b, c, c, a], 16);
        // Three times a and three times c: the lower bits are first.
        let [first, second] = if a.to_bits() < c.to_bits() { [a, c] } else { [c, a] };
        let none = (0.0, 0.0);
        assert_eq!(ranks, [(first, 3.0 / 16.0), (second, 3.0 / 16.0), (b, 2.0 / 16.0), none, none, none]);
        assert_eq!(ranked(&mut [], 16), Ranked::default());
        let mut many: Vec<f32> = (0..9).flat_map(|i| vec![id(&format!("{i}")); 9 - i]).collect();
        let ranks = ranked(&mut many, 64);
        assert_eq!(ranks.map(|(_, part)| part * 64.0), [9.0, 8.0, 7.0, 6.0, 5.0, 4.0]);
    }

    #[test]
    fn channels_come_with_a_manifest_of_what_is_seen() {
        let pixels = [Ranked::default(), ranked(&mut [id("bunny"), id("say \"灯\" 🗼\n")], 4)];
        let channels = channels("crypto_object", pixels.into_iter());
        assert_eq!(channels.len(), 12);
        let of = |name: &str| &channels.iter().find(|c| c.name == name).unwrap().values;
        let first = of("crypto_object00.r")[1];
        assert!([id("bunny"), id("say \"灯\" 🗼\n")].contains(&first) && of("crypto_object00.b")[1] != first);
        assert_eq!((of("crypto_object00.g"), of("crypto_object00.a")), (&vec![0.0, 0.25], &vec![0.0, 0.25]));
        assert_eq!(of("crypto_object02.b"), &[0.0; 2]);
        let attributes = attributes("crypto_object", &channels, ["say \"灯\" 🗼\n", "hidden", "bunny", "bunny"]);
        let [name, hash, conversion, manifest] = &attributes;
        assert_eq!(*name, ("cryptomatte/f834d0a/name".into(), "crypto_object".into()));
        assert_eq!(*hash, ("cryptomatte/f834d0a/hash".into(), "MurmurHash3_32".into()));
        assert_eq!(*conversion, ("cryptomatte/f834d0a/conversion".into(), "uint32_to_float32".into()));
        assert_eq!(manifest.0, "cryptomatte/f834d0a/manifest");
        assert!(manifest.1.is_ascii(), "{}", manifest.1);
        let read: BTreeMap<String, String> = serde_json::from_str(&manifest.1).unwrap();
        let expected =
            ["bunny", "say \"灯\" 🗼\n"].map(|name| (name.to_owned(), format!("{:08x}", id(name).to_bits())));
        assert_eq!(read, BTreeMap::from(expected));
        assert_eq!(united(&manifest.1, &manifest.1), manifest.1);
        assert_eq!(
            united("{\"b\":\"0000000b\"}", "{\"ä\":\"0000000c\",\"a\":\"0000000a\"}"),
            "{\"a\":\"0000000a\",\"b\":\"0000000b\",\"\\u00e4\":\"0000000c\"}"
        );
    }
}
