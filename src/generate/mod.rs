//! Procedural scenes, our own scenes, and training data: recipes, and the shards in which pairs of noisy and converged
//! quadtrees are stored.
//!
//! A scene is a pure function of its family and seed: it needs no file and is the same everywhere.

pub mod build;
pub mod caustics;
pub mod collect;
pub mod corridors;
pub mod dataset;
pub mod draw;
pub mod finishes;
pub mod foliage;
pub mod furnishings;
pub mod furniture;
pub mod glazed;
pub mod interiors;
pub mod lamps;
pub mod outdoors;
pub mod own;
pub mod parts;
pub mod pictures;
pub mod primitives;
pub mod recipe;
pub mod revolve;
pub mod rooms;
pub mod shard;
pub mod smoke;
mod solids;
pub mod soup;
pub mod surfaces;
pub mod text;
pub mod walls;
pub mod windows;

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::base::Result;
use crate::base::files::write_bytes;
use crate::picture;
use crate::scene::file::SceneFile;
use crate::scene::readers::{LoadedScene, resolve_with};
use build::{Builder, Pictures};
use draw::Draw;

/// Picture size of generated scenes unless asked otherwise.
pub const DEFAULT_SIZE: [u32; 2] = [64, 64];

/// A family of random scenes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Family {
    /// Random primitives under area lights.
    Primitives,
    /// Rooms lit through openings.
    Rooms,
    /// Glass and metal near small lights.
    Caustics,
    /// Closed rooms with many small lamps.
    Lamps,
    /// Corridors with light from far away or round the corner.
    Corridors,
    /// Houses, plants and walls under sun and sky.
    Outdoors,
    /// Closed rooms lit by a few narrow spots.
    Beams,
    /// Furnished rooms by daylight through windows, or by lamps in shades, with pictures as textures and surroundings.
    Interiors,
    /// Things in cases of glass and lamps in globes.
    Glazed,
}

impl Family {
    /// All families.
    pub const ALL: [Self; 9] = [
        Self::Primitives,
        Self::Rooms,
        Self::Caustics,
        Self::Lamps,
        Self::Corridors,
        Self::Outdoors,
        Self::Beams,
        Self::Interiors,
        Self::Glazed,
    ];

    /// Its name in recipes.
    pub fn name(self) -> &'static str {
        match self {
            Self::Primitives => "primitives",
            Self::Rooms => "rooms",
            Self::Caustics => "caustics",
            Self::Lamps => "lamps",
            Self::Corridors => "corridors",
            Self::Outdoors => "outdoors",
            Self::Beams => "beams",
            Self::Interiors => "interiors",
            Self::Glazed => "glazed",
        }
    }

    /// Its stream of random numbers; fixed for good, since data depends on it.
    pub fn id(self) -> u64 {
        match self {
            Self::Primitives => 1,
            Self::Rooms => 2,
            Self::Caustics => 3,
            Self::Lamps => 4,
            Self::Corridors => 5,
            Self::Outdoors => 6,
            Self::Beams => 7,
            Self::Interiors => 8,
            Self::Glazed => 9,
        }
    }

    /// Function that builds its scenes before they are scattered.
    fn build(self) -> fn(&mut Draw, &mut Builder) {
        match self {
            Self::Primitives => primitives::build,
            Self::Rooms => rooms::build,
            Self::Caustics => caustics::build,
            Self::Lamps => lamps::build,
            Self::Corridors => corridors::build,
            Self::Outdoors => outdoors::build,
            Self::Beams => lamps::build_beams,
            Self::Interiors => interiors::build,
            Self::Glazed => glazed::build,
        }
    }
}

/// The scene of a family and seed, with a picture of `size` (columns, rows).
pub fn scene(family: Family, seed: u64, size: [u32; 2]) -> SceneFile {
    scene_with_pictures(family, seed, size).0
}

/// As [`scene`], with the pictures that it names.
pub fn scene_with_pictures(family: Family, seed: u64, size: [u32; 2]) -> (SceneFile, Pictures) {
    let mut draw = Draw::new(family.id(), seed);
    let mut builder = Builder::new(format!("{}-{seed:016x}", family.name()), size);
    family.build()(&mut draw, &mut builder);
    builder.render(draw.integer(8, 12), 64);
    draw.scatter_world(&mut builder);
    builder.finish_with_pictures()
}

/// The scene of a family and seed, checked, with its pictures in memory.
///
/// # Errors
/// Those of [`resolve_with`]; a generated scene has none.
pub fn load(family: Family, seed: u64, size: [u32; 2]) -> Result<LoadedScene> {
    let (file, pictures) = scene_with_pictures(family, seed, size);
    let name = file.name.clone();
    resolve_with(file, &pictures, Path::new(&name))
}

/// Writes the scene of a family and seed into a folder that is there: `scene.json` and the pictures that it names.
///
/// # Errors
/// Those of writing.
pub fn write(family: Family, seed: u64, size: [u32; 2], folder: &Path) -> Result<()> {
    let (file, pictures) = scene_with_pictures(family, seed, size);
    // A folder with a scene file has all that it names.
    pictures.iter().try_for_each(|(name, image)| picture::write(&folder.join(name), image, &[]))?;
    write_bytes(&folder.join("scene.json"), text::json(&file)?.as_bytes())
}

#[cfg(test)]
mod tests;
