//! Random damage to bytes and texts: flips, extreme numbers, blocks moved about, words of the format.

use fanal::base::random::Random;

/// Longer inputs are cut.
const LONGEST: usize = 1 << 20;

/// Integers at the edge of a type, or of what a size may be.
const INTEGERS: [u64; 12] =
    [0, 1, 2, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFF_FFFF, 0x8000_0000, 0xFFFF_FFFF, u64::MAX];

const FLOATS: [f32; 10] =
    [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, 1e-38, 1e-45, -1.0, 0.0, 1e20];

const NUMBERS: [&str; 24] = [
    "0",
    "-0",
    "1",
    "-1",
    "2",
    "0.5",
    "1e400",
    "-1e400",
    "1e38",
    "3.5e38",
    "-1e38",
    "1e20",
    "1e-46",
    "1e-30",
    "1e-7",
    "NaN",
    "inf",
    "-inf",
    "2147483647",
    "2147483648",
    "4294967295",
    "4294967296",
    "9223372036854775808",
    "18446744073709551616",
];

/// A number below `n`, of which there is at least one.
fn below(random: &mut Random, n: usize) -> usize {
    random.below(n.max(1) as u32) as usize
}

/// A stretch of `bytes`, most often a short one.
fn block(random: &mut Random, bytes: &[u8]) -> (usize, usize) {
    let longest = [4, 16, 64, bytes.len()][below(random, 4)].min(bytes.len());
    let length = 1 + below(random, longest);
    let start = below(random, bytes.len() - length.min(bytes.len()) + 1);
    (start, (start + length).min(bytes.len()))
}

/// Where the numbers of a text are.
fn numbers(text: &[u8]) -> Vec<(usize, usize)> {
    runs(text, |byte| byte.is_ascii_digit() || matches!(byte, b'.' | b'-' | b'+' | b'e' | b'E'))
        .into_iter()
        .filter(|&(start, end)| text[start..end].iter().any(u8::is_ascii_digit))
        .collect()
}

/// Where the words of a text are.
pub fn words(text: &[u8]) -> Vec<(usize, usize)> {
    runs(text, |byte| byte.is_ascii_alphabetic() || byte == b'_')
}

fn runs(text: &[u8], inside: impl Fn(u8) -> bool) -> Vec<(usize, usize)> {
    let mut found = vec![];
    let mut start = None;
    for at in 0..=text.len() {
        match (start, at < text.len() && inside(text[at])) {
            (None, true) => start = Some(at),
            (Some(begin), false) => {
                found.push((begin, at));
                start = None;
            }
            _ => {}
        }
    }
    found
}

fn replace(bytes: &mut Vec<u8>, (start, end): (usize, usize), with: &[u8]) {
    bytes.splice(start..end, with.iter().copied());
}

/// Damages `bytes` in one to eight ways. `tokens` are words of the format, `other` is another good file.
pub fn mutate(random: &mut Random, bytes: &mut Vec<u8>, tokens: &[Vec<u8>], other: &[u8]) {
    for _ in 0..1 << random.below(4) {
        // Texts bear half of the damage as texts.
        let is_text = !bytes.is_empty() && random.below(8) > 0 && std::str::from_utf8(bytes).is_ok();
        if bytes.is_empty() {
            bytes.push(random.below(256) as u8);
        } else if is_text {
            damage_text(random, bytes, tokens);
        } else {
            damage_bytes(random, bytes, tokens, other);
        }
        bytes.truncate(LONGEST);
    }
}

fn damage_bytes(random: &mut Random, bytes: &mut Vec<u8>, tokens: &[Vec<u8>], other: &[u8]) {
    let at = below(random, bytes.len());
    match random.below(12) {
        0 | 1 => bytes[at] ^= 1 << random.below(8),
        2 => bytes[at] = random.below(256) as u8,
        3 | 4 => {
            let value =
                INTEGERS[below(random, INTEGERS.len())].wrapping_add(u64::from(random.below(3))).wrapping_sub(1);
            let width = 1 << random.below(4);
            let mut part = value.to_le_bytes()[..width].to_vec();
            if random.below(4) == 0 {
                part.reverse();
            }
            part.truncate(bytes.len() - at);
            bytes[at..at + part.len()].copy_from_slice(&part);
        }
        5 => {
            let value = FLOATS[below(random, FLOATS.len())];
            let mut part = value.to_le_bytes().to_vec();
            if random.below(3) == 0 {
                part = f64::from(value).to_le_bytes().to_vec();
            }
            let at = at & !3;
            part.truncate(bytes.len() - at);
            bytes[at..at + part.len()].copy_from_slice(&part);
        }
        6 => {
            let (start, end) = block(random, bytes);
            bytes.drain(start..end);
        }
        7 => {
            let (start, end) = block(random, bytes);
            let copy = bytes[start..end].to_vec();
            replace(bytes, (at, at), &copy);
        }
        8 => {
            let (start, end) = block(random, bytes);
            let copy = bytes[start..end].to_vec();
            let length = copy.len().min(bytes.len() - at);
            bytes[at..at + length].copy_from_slice(&copy[..length]);
        }
        9 => {
            let many = vec![random.below(256) as u8; 1 + below(random, 64)];
            replace(bytes, (at, at), &many);
        }
        10 => {
            // The beginning of one and the end of the other.
            bytes.truncate(at);
            bytes.extend(&other[below(random, other.len())..]);
        }
        _ => match tokens.get(below(random, tokens.len())) {
            Some(token) => replace(bytes, (at, at), token),
            None => bytes.truncate(at),
        },
    }
}

fn damage_text(random: &mut Random, bytes: &mut Vec<u8>, tokens: &[Vec<u8>]) {
    let mut token = || tokens.get(below(random, tokens.len())).cloned().unwrap_or_default();
    let (one, two) = (token(), token());
    match random.below(8) {
        0..3 => {
            let places = numbers(bytes);
            if let Some(&place) = places.get(below(random, places.len())) {
                replace(bytes, place, NUMBERS[below(random, NUMBERS.len())].as_bytes());
            }
        }
        3 | 4 => {
            let places = words(bytes);
            if let Some(&place) = places.get(below(random, places.len())) {
                replace(bytes, place, &one);
            }
        }
        5 => {
            let at = below(random, bytes.len());
            replace(bytes, (at, at), &[one, b" ".to_vec(), two].concat());
        }
        6 => {
            // A line twice, somewhere else, or not at all.
            let mut lines: Vec<Vec<u8>> = bytes.split_inclusive(|&byte| byte == b'\n').map(<[u8]>::to_vec).collect();
            let from = below(random, lines.len());
            let line = if random.below(3) == 0 { lines.remove(from) } else { lines[from].clone() };
            if random.below(2) == 0 {
                lines.insert(below(random, lines.len() + 1), line);
            }
            *bytes = lines.concat();
        }
        _ => {
            let (start, end) = block(random, bytes);
            if random.below(2) == 0 {
                bytes.drain(start..end);
            } else {
                let copy = bytes[start..end].to_vec();
                let at = below(random, bytes.len());
                replace(bytes, (at, at), &copy);
            }
        }
    }
}
