//! Pictures of a document (specification, §3.8.3), decoded once, and what textures make of them: channels by themselves and products
//! with factors, which the scene knows only as pictures of their own.

use std::collections::{BTreeMap, BTreeSet};

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use crate::base::files::read_bytes;
use crate::base::{Error, Result};
use crate::picture::{LARGEST_FILE, Samples, Texels, read_samples};
use crate::scene::readers::image_key;
use crate::scene::readers::missing::{self, Absent};
use crate::scene::readers::path;

use super::buffers::Buffers;
use super::document::Document;
use super::uri::{self, Target};

/// What a texture makes of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Use {
    /// Its sRGB colours times a factor.
    Color([f32; 3]),
    /// One channel's data: 0 to 2 are red, green and blue, 3 is alpha.
    Channel(usize),
    /// One minus a channel's data.
    Inverse(usize),
    /// Alpha, which is 1 where alpha times the first number is at least the second, otherwise 0.
    Cut([f32; 2]),
    /// Normals whose x and y count along these directions.
    Normals([[f32; 2]; 2]),
}

impl Use {
    /// Words that tell it from other uses of the same picture.
    fn name(self) -> String {
        match self {
            Self::Color([r, g, b]) if r == 1.0 && g == 1.0 && b == 1.0 => String::new(),
            Self::Color([r, g, b]) => format!(" times {r} {g} {b}"),
            Self::Channel(channel) => format!(" {}", CHANNELS[channel.min(3)]),
            Self::Inverse(channel) => format!(" inverse {}", CHANNELS[channel.min(3)]),
            Self::Cut([factor, least]) => format!(" alpha {factor} from {least}"),
            Self::Normals(AS_STORED) => String::new(),
            Self::Normals([[a, b], [c, d]]) => format!(" normals {a} {b} {c} {d}"),
        }
    }

    /// Whether its values are data, not colours.
    pub fn is_raw(self) -> bool {
        !matches!(self, Self::Color(_))
    }

    fn of(self, samples: &Samples) -> Texels {
        match self {
            Self::Color(factor) if factor == [1.0; 3] => samples.texels(false),
            Self::Color(factor) => samples.mapped(false, |color| color * Vec3::from_array(factor)),
            Self::Channel(channel) => samples.channel(channel, |value| value),
            Self::Inverse(channel) => samples.channel(channel, |value| 1.0 - value),
            Self::Cut([factor, least]) => samples.channel(3, |alpha| if alpha * factor >= least { 1.0 } else { 0.0 }),
            Self::Normals(AS_STORED) => samples.texels(true),
            Self::Normals([[a, b], [c, d]]) => {
                let turn = Mat3::from_cols(Vec3::new(a, b, 0.0), Vec3::new(c, d, 0.0), Vec3::Z);
                samples.mapped(true, |n| (turn * (n * 2.0 - 1.0)).normalize_or(Vec3::Z) * 0.5 + 0.5)
            }
        }
    }
}

/// Directions of normals that are taken as they are.
const AS_STORED: [[f32; 2]; 2] = [[1.0, 0.0], [0.0, 1.0]];

const CHANNELS: [&str; 4] = ["red", "green", "blue", "alpha"];

/// The pictures that materials use.
#[derive(Debug)]
pub struct Pictures {
    /// Decoded pictures by their index; none where the file is missing.
    decoded: BTreeMap<usize, Option<Samples>>,
    names: BTreeMap<usize, String>,
    /// What was made of them, by [`image_key`].
    made: BTreeMap<String, Texels>,
}

impl Pictures {
    /// Decodes the `wanted` pictures in parallel; files that are not there are added to `absent`.
    ///
    /// # Errors
    /// Those of [`read_samples`], of buffers and of names, for the first picture that has one.
    pub fn decode(
        document: &Document,
        buffers: &Buffers<'_>,
        wanted: &BTreeSet<usize>,
        absent: &mut Vec<Absent>,
    ) -> Result<Self> {
        let wanted: Vec<usize> = wanted.iter().copied().collect();
        let decoded: Vec<Result<Found>> = wanted.par_iter().map(|&index| find(document, buffers, index)).collect();
        let mut all = Self { decoded: BTreeMap::new(), names: BTreeMap::new(), made: BTreeMap::new() };
        for (index, found) in wanted.into_iter().zip(decoded) {
            let (samples, name) = match found? {
                Found::Samples(samples, name) => (Some(samples), name),
                Found::Absent(file) => {
                    let place = document.place(format!("images[{index}]"));
                    absent.push(Absent::picture(&file, place, [missing::GREY; 3]));
                    (None, file)
                }
            };
            all.decoded.insert(index, samples);
            all.names.insert(index, name);
        }
        Ok(all)
    }

    /// The decoded picture; none where its file is missing.
    pub fn samples(&self, index: usize) -> Option<&Samples> {
        self.decoded.get(&index)?.as_ref()
    }

    /// Makes the picture for one use, unless it is made already, and returns the name that textures call it by; none where its file
    /// is missing.
    pub fn make(&mut self, index: usize, purpose: Use) -> Option<String> {
        let samples = self.decoded.get(&index)?.as_ref()?;
        let file = format!("{}{}", self.names.get(&index)?, purpose.name());
        self.made.entry(image_key(&file, purpose.is_raw())).or_insert_with(|| purpose.of(samples));
        Some(file)
    }

    /// The pictures that were made, by [`image_key`].
    pub fn made(&self) -> &BTreeMap<String, Texels> {
        &self.made
    }

    /// As [`Pictures::made`], without the decoded ones.
    pub fn into_made(self) -> BTreeMap<String, Texels> {
        self.made
    }
}

enum Found {
    /// With its name.
    Samples(Samples, String),
    /// The file that is not there.
    Absent(String),
}

fn find(document: &Document, buffers: &Buffers<'_>, index: usize) -> Result<Found> {
    let part = format!("images[{index}]");
    let image = document.at(&document.root.images, "images", index, "textures")?;
    let place = document.place(&part);
    let file = document.path().file_name().unwrap_or_default().to_string_lossy();
    let inside = format!("{file} {part}");
    if let Some(uri) = &image.uri {
        return match uri::target(uri, &place)? {
            Target::Data(bytes) => Ok(Found::Samples(read_samples(&place, &bytes)?, inside)),
            Target::File(file) if missing::is_absent(document.folder(), &file) => Ok(Found::Absent(file)),
            Target::File(file) => {
                let bytes = read_bytes(&path::resolve(document.folder(), &file, &place)?, LARGEST_FILE)?;
                Ok(Found::Samples(read_samples(&place, &bytes)?, format!("{part} {file}")))
            }
        };
    }
    let Some(view) = image.buffer_view else {
        return Err(document.malformed(part, "it has neither a uri nor a bufferView"));
    };
    match buffers.view(view, &part) {
        Ok(slice) => Ok(Found::Samples(read_samples(&place, slice.bytes)?, inside)),
        // The buffer's file is missing, which is known already.
        Err(Error::Missing { .. }) => Ok(Found::Absent(inside)),
        Err(error) => Err(error),
    }
}
