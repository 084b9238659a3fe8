//! Readers: from files on disk to a [`SceneFile`] with its meshes and pictures in memory.
//!
//! Every reader translates to the same [`SceneFile`], which is checked in one place. Sizes are compared with the file's own
//! size or a stated limit before memory is asked for.

mod attributes;
mod builtin;
mod cameras;
mod cie;
mod curves;
mod conductors;
mod definitions;
pub(super) mod extent;
mod frames;
mod gltf;
mod grids;
mod gzip;
mod held;
mod json;
mod left_out;
mod lines;
mod mean;
mod measured;
mod mesh;
mod missing;
mod mitsuba;
mod mixable;
mod normals;
mod notes;
mod obj;
mod paint;
mod path;
mod pbrt;
mod places;
mod ply;
mod revolved;
mod serialized;
mod sheets;
pub(super) mod slips;
mod spectrum;
mod textures;
mod validate;
mod vol;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use crate::base::files::crc32;
use crate::base::{Error, Place, Result};
use crate::geometry::mesh::Mesh;
use crate::picture::{Image, Texels, read_texels};
use crate::scene::effects::Needs;
use crate::scene::file::{LightFile, MaterialFile, MeshFile, SceneFile, TextureFile};
use crate::scene::overrides::{self, Override};

pub use attributes::Attributes;
pub use definitions::Definition;
pub use grids::{Grids, PlacedGrid, grid_key};
pub use json::save;
pub use missing::Missing;
pub use paint::{painted, painted_corners};
pub use textures::image_key;
pub use vol::Vol;

use held::Held;
use left_out::Reasons;
use mesh::Cleaned;
use missing::Absent;
use places::Places;

/// Largest coordinate in units of the scene: squares of areas still are normal singles.
pub const LARGEST: f32 = 1e9;
/// Largest mesh file, bytes. Meshes may be large, but a scene must not exhaust memory before anything is known about it.
const LARGEST_MESH_FILE: u64 = 4 << 30;
/// Most vertices, and most triangles, of one mesh.
const MOST_ELEMENTS: u64 = 1 << 28;
/// Fewest bytes of a triangle in a text: another corner of a face, and the space before it.
const BYTES_PER_TRIANGLE: u64 = 2;

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
    /// What textures take from the corners of each triangle, by the names of mesh and attribute.
    pub attributes: Attributes,
    /// Grids of media, by [`grid_key`].
    pub grids: Grids,
    /// Triangles left out because they have no area or use a vertex twice.
    pub skipped_triangles: usize,
    /// Meshes and pictures that were not there, as the scene names them; substitutes replace them.
    pub missing: Vec<String>,
    /// Warnings about anything that was understood in another way than it may have been meant.
    pub warnings: Vec<String>,
    /// Effects that were switched on although nothing in the file calls for them.
    pub needs: Needs,
}

impl LoadedScene {
    /// The corners of the box around the boxes of all shapes; infinite the wrong way round where there is none.
    pub fn bounds(&self) -> [DVec3; 2] {
        extent::around(&self.file.shapes, &self.meshes)
    }

    /// CRC-32 of everything that the picture depends on: the scene file, and the content of the files that it names.
    pub fn crc32(&self) -> u32 {
        let file = serde_json::to_vec(&self.file).unwrap_or_default();
        let needs = format!("{:?}", self.needs);
        let sizes: Vec<[usize; 2]> = self.images.values().map(Texels::size).collect();
        let boxes: Vec<_> = self.grids.values().map(|placed| (placed.to_world, placed.grid.size())).collect();
        let around = format!("{sizes:?} {boxes:?}");
        let meshes = self.meshes.values().flat_map(|mesh| {
            let (positions, normals) = (bytemuck::cast_slice(&mesh.positions), bytemuck::cast_slice(&mesh.normals));
            [positions, normals, bytemuck::cast_slice(&mesh.uvs), bytemuck::cast_slice(&mesh.triangles)]
        });
        let images = self.images.values().map(Texels::bytes);
        let attributes = self.attributes.values().map(|corners| bytemuck::cast_slice(corners));
        let grids = self.grids.values().map(|placed| placed.grid.bytes());
        let parts = [file.as_slice(), needs.as_bytes(), around.as_bytes()].into_iter().chain(meshes).chain(images);
        crc32(parts.chain(attributes).chain(grids))
    }
}

/// Loads a scene: a `.json` file in our own format, a Mitsuba `.xml` file, a `.pbrt` file (also `.pbrt.gz`), a glTF `.gltf` or `.glb`
/// file, or a folder that holds one of them called `scene`.
///
/// # Errors
/// [`Error::Io`], [`Error::Malformed`], [`Error::Unsupported`], [`Error::Limit`] and [`Error::Missing`], naming file and place.
pub fn load(path: &Path) -> Result<LoadedScene> {
    load_with(path, &[])
}

/// As [`load`], with effects switched on or off. Files to which only switched-off effects refer are not read.
///
/// # Errors
/// As [`load`].
pub fn load_with(path: &Path, overrides: &[Override]) -> Result<LoadedScene> {
    load_lacking(path, overrides, Missing::Refuse)
}

/// As [`load_with`], for a scene that may lack meshes and pictures. Files to which only switched-off effects refer are not missed.
///
/// # Errors
/// As [`load`]; no [`Error::Missing`] where they are skipped.
pub fn load_lacking(path: &Path, overrides: &[Override], missing: Missing) -> Result<LoadedScene> {
    load_by(path, &How { overrides, missing, ..How::default() })
}

/// As [`load`], as `how` says.
///
/// # Errors
/// As [`load_lacking`]; [`Error::Options`] for a definition of what no scene of this format names, and [`Error::Malformed`] for one of
/// what this scene does not.
pub fn load_by(path: &Path, how: &How) -> Result<LoadedScene> {
    let path = document(path)?;
    let directory = path.parent().unwrap_or(Path::new("")).to_owned();
    let kind = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    if let Some(definition) = how.definitions.first().filter(|_| kind.as_deref() != Some("xml")) {
        let Definition { name, value } = definition;
        let message =
            format!("-D {name}={value}: only Mitsuba's scenes have names to define, {} is none", path.display());
        return Err(Error::Options(message));
    }
    match kind.as_deref() {
        Some("json") => resolve_at(Read::plain(json::read(&path)?, &path), &directory, how),
        Some("xml") => resolve_at(mitsuba::read(&path, how.definitions)?, &directory, how),
        Some("pbrt") => resolve_at(pbrt::read(&path)?, &directory, how),
        Some("gz") if path.file_stem().is_some_and(|stem| Path::new(stem).extension() == Some("pbrt".as_ref())) => {
            resolve_at(pbrt::read(&path)?, &directory, how)
        }
        Some("gltf" | "glb") => resolve_at(gltf::read(&path)?, &directory, how),
        _ => Err(Error::Unsupported {
            place: Place::file(&path),
            what: "this kind of scene file".into(),
            supported: format!(
                ".json (fanal), .xml (Mitsuba), .pbrt (pbrt), .gltf and .glb (glTF), or a folder with {}",
                DOCUMENTS.join(", ")
            ),
        }),
    }
}

/// A document that was read, unchecked, without the files that it names.
struct Read {
    file: SceneFile,
    /// Places of the document's parts.
    places: Places,
    /// Warnings about anything that is done in another way than the document says.
    warnings: Vec<String>,
    /// Files that were found to be missing already.
    absent: Vec<Absent>,
    /// What the document itself holds.
    held: Held,
}

impl Read {
    /// A document whose parts are named by their key paths.
    fn plain(file: SceneFile, source: &Path) -> Self {
        Self { file, places: Places::new(source), warnings: Vec::new(), absent: Vec::new(), held: Held::default() }
    }
}

/// How to load a scene.
#[derive(Debug, Clone, Copy, Default)]
pub struct How<'a> {
    /// Effects switched on or off. Files to which only switched-off effects refer are not read.
    pub overrides: &'a [Override],
    /// Values for names in the document.
    pub definitions: &'a [Definition],
    /// What to do about files that are not there.
    pub missing: Missing,
}

/// Names of a folder's scene document, the first that is there.
const DOCUMENTS: [&str; 5] = ["scene.json", "scene.xml", "scene.pbrt", "scene.gltf", "scene.glb"];

/// The scene document at `path`, or in the folder `path`.
fn document(path: &Path) -> Result<PathBuf> {
    if path.is_dir() { document_in(path).ok_or_else(|| none_in(path)) } else { Ok(path.to_owned()) }
}

fn document_in(folder: &Path) -> Option<PathBuf> {
    DOCUMENTS.iter().map(|name| folder.join(name)).find(|candidate| candidate.is_file())
}

fn none_in(folder: &Path) -> Error {
    Error::malformed(Place::file(folder), format!("the folder holds none of {}", DOCUMENTS.join(", ")))
}

/// The scene documents in a folder: its own, called `scene`, or else those of the folders in it, in the order of their names.
///
/// # Errors
/// [`Error::Io`]; [`Error::Malformed`] where there is none.
pub fn documents(folder: &Path) -> Result<Vec<PathBuf>> {
    if let Some(own) = document_in(folder) {
        return Ok(vec![own]);
    }
    let io = |e| Error::io(folder, e);
    let entries: Vec<_> = std::fs::read_dir(folder).map_err(io)?.collect::<std::io::Result<_>>().map_err(io)?;
    let mut found: Vec<PathBuf> = entries.iter().filter_map(|entry| document_in(&entry.path())).collect();
    found.sort();
    if found.is_empty() { Err(none_in(folder)) } else { Ok(found) }
}

/// Checks a scene file and loads its meshes and pictures. `source` only names it in messages; a scene that was made up, with
/// all its meshes written out, needs no folder.
///
/// # Errors
/// As [`load`]; places are key paths such as `shapes[3].material`.
pub fn resolve(file: SceneFile, directory: &Path, source: &Path) -> Result<LoadedScene> {
    resolve_at(Read::plain(file, source), directory, &How::default())
}

/// As [`resolve`], of a scene that was made up with all its meshes written out; `pictures` are those that it names, by the names of
/// their files.
///
/// # Errors
/// As [`resolve`].
pub fn resolve_with(file: SceneFile, pictures: &BTreeMap<String, Arc<Image>>, source: &Path) -> Result<LoadedScene> {
    let mut read = Read::plain(file, source);
    let keys = pictures.iter().flat_map(|(name, image)| [false, true].map(|raw| (image_key(name, raw), image)));
    read.held.pictures = keys.map(|(key, image)| (key, Texels::Float(Arc::clone(image)))).collect();
    resolve_at(read, Path::new(""), &How::default())
}

fn resolve_at(read: Read, directory: &Path, how: &How) -> Result<LoadedScene> {
    let Read { mut file, places, mut warnings, absent, held } = read;
    validate::validate(&file, &places)?;
    extent::bring_focus(&mut file, &places, &mut warnings);
    let needs = overrides::apply(&mut file, how.overrides);
    let (mut reasons, missing) =
        missing::settle(&mut file, directory, &places, &held, absent, how.missing, &mut warnings)?;
    let Held { meshes, pictures } = held;
    let (loaded, pictures) = rayon::join(
        || load_meshes(&file.meshes, meshes, directory, &places, &mut reasons),
        || read_pictures(&file, pictures, directory, &places),
    );
    let (meshes, skipped_triangles) = loaded?;
    extent::check(&file, &meshes, &places)?;
    if skipped_triangles > 0 {
        warnings.push(format!("{skipped_triangles} triangles without area were left out"));
    }
    let images = load_images(&file, pictures, &places, &mut warnings)?;
    check_reflectances(&file, &images, &places, &mut warnings);
    let attributes = attributes::load(&file, &meshes, directory, &places, &mut warnings)?;
    let grids = grids::load(&file, directory, &places, &mut warnings)?;
    for (index, shape) in file.shapes.iter().enumerate().filter(|(_, shape)| shape.shines()) {
        if file.materials.get(&shape.material).is_some_and(MaterialFile::is_masked) {
            let place = places.at(&format!("shapes[{index}]"));
            warnings.push(format!("{place}: a shape that shines has no holes: its mask is left out"));
        }
    }
    left_out::take_out(&mut file, &meshes, &reasons, &places, &mut warnings)?;
    let directory = directory.to_owned();
    Ok(LoadedScene { file, directory, meshes, images, attributes, grids, skipped_triangles, missing, warnings, needs })
}

/// Name of a mesh, where it comes from, and the mesh where it is held already.
type Source<'a> = (&'a String, &'a MeshFile, Option<Mesh>);

/// Loads all meshes, some of which are `held`, but those that are missing for one of the `reasons`; returns them with the number of
/// triangles left out. A mesh that has none left adds a reason. In parallel; of several errors the first by name is reported, whatever
/// the scheduling.
fn load_meshes(
    files: &BTreeMap<String, MeshFile>,
    mut held: BTreeMap<String, Mesh>,
    directory: &Path,
    places: &Places,
    reasons: &mut Reasons,
) -> Result<(BTreeMap<String, Arc<Mesh>>, usize)> {
    let present = files.iter().filter(|(name, _)| !reasons.contains_key(*name));
    // Parts of one file, by material, are taken from it one after another: each reads all of it.
    let mut sources: BTreeMap<&str, Vec<Source>> = BTreeMap::new();
    for (name, file) in present {
        let source = if let MeshFile::Obj { file, .. } = file { file } else { name };
        sources.entry(source).or_default().push((name, file, held.remove(name)));
    }
    let sources: Vec<Vec<Source>> = sources.into_values().collect();
    let load = |(name, file, held): (_, _, _)| {
        let place = places.at(&format!("meshes.{name}"));
        (name, mesh::load(file, held, directory, &place))
    };
    let loaded: BTreeMap<&String, Result<Cleaned>> =
        sources.into_par_iter().flat_map_iter(|parts| parts.into_iter().map(load)).collect();
    let (mut meshes, mut skipped) = (BTreeMap::new(), 0);
    for (name, cleaned) in loaded {
        let cleaned = cleaned?;
        skipped += cleaned.skipped;
        match cleaned.emptiness() {
            Some(why) => drop(reasons.insert(name.clone(), why)),
            None => drop(meshes.insert(name.clone(), Arc::new(cleaned.mesh))),
        }
    }
    Ok((meshes, skipped))
}

/// Pictures that were read, or their errors, by [`image_key`].
type Pictures = BTreeMap<String, Result<Texels>>;

/// Reads all pictures of a scene that are not `held` in parallel, each once per way of reading it.
fn read_pictures(scene: &SceneFile, held: BTreeMap<String, Texels>, directory: &Path, places: &Places) -> Pictures {
    let mut files: BTreeMap<String, (&str, bool, Place)> = BTreeMap::new();
    for (name, material) in &scene.materials {
        for (_, texture) in material.textures() {
            if let TextureFile::Bitmap { file, raw, .. } = texture {
                let place = || places.of_picture(file, &format!("materials.{name}"));
                files.entry(image_key(file, *raw)).or_insert_with(|| (file, *raw, place()));
            }
        }
    }
    for (index, shape) in scene.shapes.iter().enumerate() {
        if let Some(TextureFile::Bitmap { file, raw, .. }) = &shape.emission_texture {
            let place = || places.of_picture(file, &format!("shapes[{index}]"));
            files.entry(image_key(file, *raw)).or_insert_with(|| (file, *raw, place()));
        }
    }
    for (index, light) in scene.lights.iter().enumerate() {
        let place = || places.at(&format!("lights[{index}]"));
        if let LightFile::Envmap { file, .. } = light {
            files.entry(image_key(file, false)).or_insert_with(|| (file, false, place()));
        }
        if let Some(TextureFile::Bitmap { file, raw, .. }) = light.texture() {
            files.entry(image_key(file, *raw)).or_insert_with(|| (file, *raw, place()));
        }
    }
    let read = |(key, (file, raw, place)): (String, (&str, bool, Place))| {
        let path = path::resolve(directory, file, &place);
        (key, path.and_then(|path| read_texels(&path, raw)))
    };
    files.retain(|key, _| !held.contains_key(key));
    let mut pictures: Pictures = files.into_par_iter().map(read).collect();
    pictures.extend(held.into_iter().map(|(key, texels)| (key, Ok(texels))));
    pictures
}

/// Picks a scene's pictures from those read; of several errors the first in the order of materials and lights is reported.
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
    for shape in &scene.shapes {
        if let Some(TextureFile::Bitmap { file, raw, .. }) = &shape.emission_texture {
            add(file, *raw)?;
        }
    }
    for (index, light) in scene.lights.iter().enumerate() {
        if let LightFile::Envmap { file, .. } = light
            && let Some(image) = add(file, false)?
        {
            check_envmap(&image, file, places.at(&format!("lights[{index}]")), warnings)?;
        }
        if let Some(TextureFile::Bitmap { file, raw, .. }) = light.texture() {
            add(file, *raw)?;
        }
    }
    Ok(images)
}

/// Textures by which light is multiplied where a material sends it on.
const FACTORS: [&str; 6] = [
    "reflectance",
    "transmittance",
    "diffuse_reflectance",
    "specular_reflectance",
    "specular_transmittance",
    "base_color",
];

/// Warns of materials whose pictures are brighter than 1, as no surface is that emits nothing. They stay as they are.
fn check_reflectances(
    scene: &SceneFile,
    images: &BTreeMap<String, Texels>,
    places: &Places,
    warnings: &mut Vec<String>,
) {
    let mut brightest: BTreeMap<String, f32> = BTreeMap::new();
    for (name, material) in &scene.materials {
        for (what, texture) in material.textures() {
            let TextureFile::Bitmap { file, raw, scale, .. } = texture else { continue };
            let key = image_key(file, *raw);
            let Some(image) = images.get(&key).filter(|_| FACTORS.contains(&what)) else { continue };
            // Whole numbers stand for at most 1.
            let most = match image {
                Texels::Words(_) | Texels::Bytes(_) if *scale <= 1.0 => continue,
                _ => scale * *brightest.entry(key).or_insert_with(|| largest(image)),
            };
            if most > 1.001 {
                let place = places.at(&format!("materials.{name}"));
                warnings.push(format!(
                    "{place}: the {what} of \"{name}\" reaches {most} in its picture, more light than arrives"
                ));
            }
        }
    }
}

/// Largest channel of all pixels.
fn largest(image: &Texels) -> f32 {
    let [width, height] = image.size();
    (0..width * height).into_par_iter().map(|index| image.pixels([index])[0].max_element()).reduce(|| 0.0, f32::max)
}

fn check_envmap(image: &Texels, file: &str, place: Place, warnings: &mut Vec<String>) -> Result<()> {
    // Rows are interpolated from pole to pole and columns around: fewer do not span the sphere.
    let [width, height] = image.size();
    if width < 2 || height < 3 {
        let message = format!("\"{file}\" has {width}×{height} pixels, an environment needs at least 2×3");
        return Err(Error::malformed(place, message));
    }
    let negative = match image {
        Texels::Float(_) | Texels::Half(_) => {
            image.to_image().pixels.iter().filter(|pixel| pixel.min_element() < 0.0).count()
        }
        Texels::Words(_) | Texels::Bytes(_) => 0,
    };
    if negative > 0 {
        warnings.push(format!("{file}: {negative} pixels are negative"));
    }
    Ok(())
}
