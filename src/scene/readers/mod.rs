//! Readers: from files on disk to a [`SceneFile`] with its meshes and pictures in memory.
//!
//! Every reader translates to the same [`SceneFile`], which is checked in one place. Sizes are compared with the file's own
//! size or a stated limit before memory is asked for.

mod builtin;
mod exr;
mod extent;
mod image;
mod json;
mod lines;
mod mesh;
mod mitsuba;
mod normals;
mod obj;
mod path;
mod places;
mod ply;
mod serialized;
mod textures;
mod validate;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;

use crate::base::files::crc32;
use crate::base::{Error, Place, Result};
use crate::geometry::mesh::Mesh;
use crate::materials::texels::Texels;
use crate::scene::effects::Needs;
use crate::scene::file::{LightFile, MaterialFile, MeshFile, SceneFile, TextureFile};
use crate::scene::overrides::{self, Override};

pub use exr::{Channels, read_exr_channels};
pub use image::{read_image, read_texels};
pub use json::save;
pub use textures::image_key;

use places::Places;

/// A scene file with everything that it refers to.
#[derive(Debug, Clone)]
pub struct LoadedScene {
    /// The checked scene file.
    pub file: SceneFile,
    /// The folder that its paths are relative to.
    pub directory: PathBuf,
    /// Meshes by their name in the scene file.
    pub meshes: BTreeMap<String, Arc<Mesh>>,
    /// Pictures by [`image_key`]: the `file` string of the scene file, with a mark where it is read as raw data.
    pub images: BTreeMap<String, Texels>,
    /// Triangles left out because they have no area or use a vertex twice.
    pub skipped_triangles: usize,
    /// What was understood in another way than it may have been meant.
    pub warnings: Vec<String>,
    /// Effects that were switched on although nothing in the file calls for them.
    pub needs: Needs,
}

impl LoadedScene {
    /// CRC-32 of everything that the picture depends on: the scene file, and what the files hold that it names.
    pub fn crc32(&self) -> u32 {
        let file = serde_json::to_vec(&self.file).unwrap_or_default();
        let needs = format!("{:?}", self.needs);
        let meshes = self.meshes.values().flat_map(|mesh| {
            let (positions, normals) = (bytemuck::cast_slice(&mesh.positions), bytemuck::cast_slice(&mesh.normals));
            [positions, normals, bytemuck::cast_slice(&mesh.uvs), bytemuck::cast_slice(&mesh.triangles)]
        });
        let images = self.images.values().map(Texels::bytes);
        crc32([file.as_slice(), needs.as_bytes()].into_iter().chain(meshes).chain(images))
    }
}

/// Loads a scene: a `.json` file in our own format, a Mitsuba `.xml` file, or a folder that holds `scene.json` or `scene.xml`.
///
/// # Errors
/// [`Error::Io`], [`Error::Malformed`], [`Error::Unsupported`] and [`Error::Limit`], naming file and place.
pub fn load(path: &Path) -> Result<LoadedScene> {
    load_with(path, &[])
}

/// [`load`] with effects switched on or off. Nothing is read that only an effect refers to which is off.
///
/// # Errors
/// As [`load`].
pub fn load_with(path: &Path, overrides: &[Override]) -> Result<LoadedScene> {
    let path = document(path)?;
    let directory = path.parent().unwrap_or(Path::new("")).to_owned();
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("json") => resolve_at(json::read(&path)?, &directory, &Places::new(&path), Vec::new(), overrides),
        Some("xml") => {
            let mitsuba::Translation { file, places, warnings } = mitsuba::read(&path)?;
            resolve_at(file, &directory, &places, warnings, overrides)
        }
        _ => Err(Error::Unsupported {
            place: Place::file(&path),
            what: "this kind of scene file".into(),
            supported: ".json (fanal), .xml (Mitsuba), or a folder with scene.json or scene.xml".into(),
        }),
    }
}

/// The scene document that `path` means.
fn document(path: &Path) -> Result<PathBuf> {
    if !path.is_dir() {
        return Ok(path.to_owned());
    }
    let candidates = ["scene.json", "scene.xml"].map(|name| path.join(name));
    candidates
        .into_iter()
        .find(|candidate| candidate.is_file())
        .ok_or_else(|| Error::malformed(Place::file(path), "the folder holds neither scene.json nor scene.xml"))
}

/// Checks a scene file and loads its meshes and pictures. `source` only names it in messages; a scene that was made up, with
/// all its meshes written out, needs no folder.
///
/// # Errors
/// As [`load`]; places are key paths such as `shapes[3].material`.
pub fn resolve(file: SceneFile, directory: &Path, source: &Path) -> Result<LoadedScene> {
    resolve_at(file, directory, &Places::new(source), Vec::new(), &[])
}

fn resolve_at(
    mut file: SceneFile,
    directory: &Path,
    places: &Places,
    mut warnings: Vec<String>,
    overrides: &[Override],
) -> Result<LoadedScene> {
    validate::validate(&file, places)?;
    let needs = overrides::apply(&mut file, overrides);
    let mut skipped_triangles = 0;
    let mut meshes = BTreeMap::new();
    let (loaded, pictures) =
        rayon::join(|| load_meshes(&file.meshes, directory, places), || read_pictures(&file, directory, places));
    for (name, (mesh, skipped)) in loaded? {
        skipped_triangles += skipped;
        meshes.insert(name, Arc::new(mesh));
    }
    extent::check(&file, &meshes, places)?;
    if skipped_triangles > 0 {
        warnings.push(format!("{skipped_triangles} triangles without area were left out"));
    }
    let images = load_images(&file, pictures, places, &mut warnings)?;
    for (index, shape) in file.shapes.iter().enumerate().filter(|(_, shape)| shape.emission.is_some()) {
        if file.materials.get(&shape.material).is_some_and(MaterialFile::is_masked) {
            let place = places.at(&format!("shapes[{index}]"));
            warnings.push(format!("{place}: a shape that shines has no holes: its mask is left out"));
        }
    }
    Ok(LoadedScene { file, directory: directory.to_owned(), meshes, images, skipped_triangles, warnings, needs })
}

type Cleaned = (Mesh, usize);

/// In parallel; of several errors the first by name is reported, whatever the scheduling.
fn load_meshes(
    files: &BTreeMap<String, MeshFile>,
    directory: &Path,
    places: &Places,
) -> Result<Vec<(String, Cleaned)>> {
    let loaded: Vec<Result<(String, Cleaned)>> = files
        .par_iter()
        .map(|(name, file)| {
            let place = places.at(&format!("meshes.{name}"));
            mesh::load(file, directory, &place).map(|cleaned| (name.clone(), cleaned))
        })
        .collect();
    loaded.into_iter().collect()
}

/// By [`image_key`].
type Pictures = BTreeMap<String, Result<Texels>>;

/// Reads all pictures of a scene in parallel, each once per way of reading it.
fn read_pictures(scene: &SceneFile, directory: &Path, places: &Places) -> Pictures {
    let mut files: BTreeMap<String, (&str, bool, String)> = BTreeMap::new();
    for (name, material) in &scene.materials {
        for (_, texture) in material.textures() {
            if let TextureFile::Bitmap { file, raw, .. } = texture {
                files.entry(image_key(file, *raw)).or_insert_with(|| (file, *raw, format!("materials.{name}")));
            }
        }
    }
    for (index, light) in scene.lights.iter().enumerate() {
        if let LightFile::Envmap { file, .. } = light {
            files.entry(image_key(file, false)).or_insert_with(|| (file, false, format!("lights[{index}]")));
        }
    }
    let read = |(key, (file, raw, part)): (String, (&str, bool, String))| {
        let path = path::resolve(directory, file, &places.at(&part));
        (key, path.and_then(|path| read_texels(&path, raw)))
    };
    files.into_par_iter().map(read).collect()
}

/// What was read of the pictures of a scene; of several errors the first in the order of materials and lights is reported.
fn load_images(
    scene: &SceneFile,
    mut pictures: Pictures,
    places: &Places,
    warnings: &mut Vec<String>,
) -> Result<BTreeMap<String, Texels>> {
    let mut images = BTreeMap::new();
    let mut add = |file: &str, raw: bool| -> Result<Option<Texels>> {
        let key = image_key(file, raw);
        if let Some(image) = pictures.remove(&key) {
            images.insert(key.clone(), image?);
        }
        Ok(images.get(&key).cloned())
    };
    for material in scene.materials.values() {
        for (_, texture) in material.textures() {
            if let TextureFile::Bitmap { file, raw, .. } = texture {
                add(file, *raw)?;
            }
        }
    }
    for (index, light) in scene.lights.iter().enumerate() {
        if let LightFile::Envmap { file, .. } = light
            && let Some(image) = add(file, false)?
        {
            check_envmap(&image, file, places.at(&format!("lights[{index}]")), warnings)?;
        }
    }
    Ok(images)
}

fn check_envmap(image: &Texels, file: &str, place: Place, warnings: &mut Vec<String>) -> Result<()> {
    // Rows are interpolated from pole to pole and columns around: fewer do not span the sphere.
    let [width, height] = image.size();
    if width < 2 || height < 3 {
        let message = format!("\"{file}\" has {width}×{height} pixels, an environment needs at least 2×3");
        return Err(Error::malformed(place, message));
    }
    let negative = match image {
        Texels::Float(image) => image.pixels.iter().filter(|pixel| pixel.min_element() < 0.0).count(),
        Texels::Bytes(_) => 0,
    };
    if negative > 0 {
        warnings.push(format!("{file}: {negative} pixels are negative"));
    }
    Ok(())
}
