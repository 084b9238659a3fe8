//! What can only be settled once the whole document is read: the camera, mixtures, holes, light on what is no surface, exposure.

use std::path::Path;

use crate::base::{Error, Place, Result};
use crate::scene::file::{LightFile, MaterialFile, SceneFile, TextureFile};
use crate::scene::readers::Read;
use crate::scene::readers::mixable::mixable;

use super::{DEFAULT_MATERIAL, Reader};

/// Deepest nesting of mixtures.
const MOST_NESTED: usize = 8;
/// Most parts of all mixtures together: mixtures of mixtures must not grow without bound.
const MOST_PARTS: usize = 1 << 17;

/// Two materials by their names in the scene file.
#[derive(Debug, Clone)]
pub struct Mix {
    /// Their names.
    pub materials: [String; 2],
    /// Weight of the second.
    pub amount: TextureFile,
}

/// A material with the holes that a shape has.
#[derive(Debug)]
pub struct Masked {
    /// Its name.
    pub name: String,
    /// Name of the material where there is no hole.
    pub base: String,
    /// Where it is.
    pub opacity: TextureFile,
    /// The shape's place.
    pub place: Place,
}

impl Reader {
    /// Settles what is left, and returns the scene.
    pub(super) fn finish(mut self, path: &Path) -> Result<Read> {
        if !self.world[0] {
            return Err(Error::malformed(Place::file(path), "the scene has no WorldBegin"));
        }
        if let Some((block, _)) = self.blocks.last() {
            let message = format!("a block that {}Begin began has no end", block.name());
            self.warn(&Place::file(path), message);
        }
        self.finish_camera()?;
        self.add_strands()?;
        self.resolve_mixes()?;
        self.add_default();
        self.add_masks();
        self.replace_unknown();
        self.darken_borders();
        self.join_environments();
        self.expose_lights();
        let Self { file, places, mut warnings, notes, unused, absent, held, .. } = self;
        warnings.extend(notes.into_warnings("and"));
        warnings.extend(unused.into_warnings("nor are"));
        Ok(Read { file, places, warnings, absent, held })
    }

    fn resolve_mixes(&mut self) -> Result<()> {
        let (names, mut parts): (Vec<String>, usize) = (self.mixes.keys().cloned().collect(), 0);
        for name in names {
            let material = self.resolved(&name, 0)?;
            parts += material.parts().len();
            if parts > MOST_PARTS {
                let (place, what) =
                    (self.places.at(&format!("materials.{name}")), "number of mixed materials".to_owned());
                return Err(Error::Limit { place, what, value: parts as u64, limit: MOST_PARTS as u64 });
            }
            self.file.materials.insert(name, material);
        }
        Ok(())
    }

    /// The material of this name, mixed if need be.
    fn resolved(&mut self, name: &str, depth: usize) -> Result<MaterialFile> {
        if let Some(material) = self.file.materials.get(name) {
            return Ok(material.clone());
        }
        let place = self.places.at(&format!("materials.{name}"));
        let Some(mix) = self.mixes.get(name).cloned() else {
            return Err(Error::malformed(place, format!("there is no material \"{name}\"")));
        };
        if depth == MOST_NESTED {
            let message = format!("materials mixed of one another, more than {MOST_NESTED} deep");
            return Err(Error::malformed(place, message));
        }
        let mut parts = Vec::with_capacity(2);
        for part in &mix.materials {
            let is_known = self.file.materials.contains_key(part) || self.mixes.contains_key(part);
            let message = || format!("there is no material \"{part}\" to be mixed");
            let material = match (is_known, self.old) {
                (true, _) => self.resolved(part, depth + 1)?,
                (false, true) => {
                    self.warn(&place, format!("{}: the default one is used", message()));
                    default_material()
                }
                (false, false) => return Err(Error::malformed(place, message())),
            };
            parts.push(mixable(material, &mut |what| self.warn(&place, what)));
        }
        let (Some(second), Some(first)) = (parts.pop(), parts.pop()) else {
            return Err(Error::malformed(place, "a mix needs two materials"));
        };
        self.mixed([first, second], mix.amount, &place)
    }

    /// Two materials mixed; one that is no surface leaves holes.
    fn mixed(&mut self, parts: [MaterialFile; 2], amount: TextureFile, place: &Place) -> Result<MaterialFile> {
        let [first, second] = parts;
        Ok(match (first, second) {
            (MaterialFile::Null {}, MaterialFile::Null {}) => MaterialFile::Null {},
            (MaterialFile::Null {}, material) => MaterialFile::Mask { opacity: amount, material: Box::new(material) },
            (material, MaterialFile::Null {}) => {
                let ends = [1.0, 0.0].map(|value| TextureFile::rgb([value; 3]));
                MaterialFile::Mask { opacity: self.mixture(ends, amount, place)?, material: Box::new(material) }
            }
            (first, second) => MaterialFile::Blend { weight: amount, materials: Box::new([first, second]) },
        })
    }

    /// Adds pbrt's material of shapes without one.
    fn add_default(&mut self) {
        let used = self.file.shapes.iter().any(|shape| shape.material == DEFAULT_MATERIAL)
            || self.masked.iter().any(|masked| masked.base == DEFAULT_MATERIAL);
        if used {
            self.file.materials.entry(DEFAULT_MATERIAL.to_owned()).or_insert_with(default_material);
        }
    }

    fn add_masks(&mut self) {
        for Masked { name, base, opacity, place } in std::mem::take(&mut self.masked) {
            // Missing ones are told of where shapes are checked.
            let Some(material) = self.file.materials.get(&base).cloned() else { continue };
            let material = if matches!(material.innermost(), MaterialFile::Null {}) {
                material
            } else {
                if material.is_masked() {
                    self.warn(&place, "holes in holes: those of the shape are used");
                }
                MaterialFile::Mask { opacity, material: Box::new(unmasked(material)) }
            };
            self.places.set(format!("materials.{name}"), place);
            self.file.materials.insert(name, material);
        }
    }

    /// Gives shapes of a v3 scene whose material is nowhere the default one, as v3 does.
    fn replace_unknown(&mut self) {
        let unknown = |reader: &Self, shape: usize| {
            let material = &reader.file.shapes[shape].material;
            (reader.old && !reader.file.materials.contains_key(material)).then(|| material.clone())
        };
        for index in 0..self.file.shapes.len() {
            let Some(name) = unknown(self, index) else { continue };
            let place = self.places.at(&format!("shapes[{index}]"));
            self.warn(&place, format!("there is no material \"{name}\": the default one is used"));
            self.file.shapes[index].material = DEFAULT_MATERIAL.to_owned();
        }
        self.add_default();
    }

    /// Takes the light from shapes that are no surface, as pbrt-v4 does. In v3 they shine; they are black then, since a border has no light.
    fn darken_borders(&mut self) {
        let old = self.old;
        let black = self.free_name("black lamp", |reader, name| reader.file.materials.contains_key(name));
        let SceneFile { shapes, materials, .. } = &mut self.file;
        let mut any = false;
        for (index, shape) in shapes.iter_mut().enumerate().filter(|(_, shape)| shape.emission.is_some()) {
            let border = |material: &MaterialFile| {
                !material.is_masked() && matches!(material.innermost(), MaterialFile::Null {})
            };
            if old && materials.get(&shape.material).is_some_and(border) {
                (shape.material, any) = (black.clone(), true);
                let place = self.places.at(&format!("shapes[{index}]"));
                self.notes.add(&place, "a lamp without a surface is read as a black one".to_owned());
                continue;
            }
            if materials
                .get(&shape.material)
                .is_some_and(|material| matches!(material.innermost(), MaterialFile::Null {}))
            {
                (shape.emission, shape.emission_texture) = (None, None);
                let place = self.places.at(&format!("shapes[{index}]"));
                self.notes.add(&place, "what is no surface does not shine: its light is left out".to_owned());
            }
        }
        if any {
            materials.insert(black, MaterialFile::Diffuse { reflectance: TextureFile::rgb([0.0; 3]) });
        }
    }

    /// Multiplies all light by what the camera makes of it.
    fn expose_lights(&mut self) {
        let factor = self.exposure as f32;
        if factor == 1.0 {
            return;
        }
        let place = self.places.at("film");
        self.warn(&place, format!("all light is multiplied by {factor}, which is what the camera's exposure does"));
        let times = |color: &mut [f32; 3]| color.iter_mut().for_each(|channel| *channel *= factor);
        self.file.shapes.iter_mut().filter_map(|shape| shape.emission.as_mut()).for_each(times);
        for light in &mut self.file.lights {
            match light {
                LightFile::Point { intensity: color, .. }
                | LightFile::Spot { intensity: color, .. }
                | LightFile::Projector { intensity: color, .. }
                | LightFile::Directional { irradiance: color, .. }
                | LightFile::Sun { irradiance: color, .. }
                | LightFile::Constant { radiance: color } => times(color),
                LightFile::Sky { scale, .. } | LightFile::Envmap { scale, .. } => *scale *= factor,
            }
        }
    }
}

/// pbrt's material of shapes without one.
fn default_material() -> MaterialFile {
    let diffuse = MaterialFile::Diffuse { reflectance: TextureFile::rgb([0.5; 3]) };
    MaterialFile::TwoSided { material: Box::new(diffuse) }
}

/// The material without its holes.
fn unmasked(material: MaterialFile) -> MaterialFile {
    match material {
        MaterialFile::Mask { material, .. } => unmasked(*material),
        MaterialFile::TwoSided { material } => MaterialFile::TwoSided { material: Box::new(unmasked(*material)) },
        MaterialFile::BumpMap { texture, scale, material } => {
            MaterialFile::BumpMap { texture, scale, material: Box::new(unmasked(*material)) }
        }
        MaterialFile::NormalMap { texture, material } => {
            MaterialFile::NormalMap { texture, material: Box::new(unmasked(*material)) }
        }
        other => other,
    }
}
