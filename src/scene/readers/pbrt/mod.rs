//! pbrt's scenes (v4, and most of v3), the part that [`SceneFile`] can express. What is there but cannot be expressed is read by a near
//! relation, or left out, with a warning; what no reader could make sense of is an error with file, line and what could stand there.
//!
//! pbrt's space is left-handed only by its camera, whose x points to the right: coordinates are taken over as they are, and the camera's
//! x is turned around. Surfaces of pbrt reflect on both sides; normals follow the winding in object space, so that a
//! transform that mirrors keeps the front, and ReverseOrientation alone turns it.

mod bake;
mod camera;
mod classic;
mod coated;
mod colors;
mod curves;
mod directives;
mod film;
mod finish;
mod infinite;
mod lights;
mod materials;
mod medium;
mod meshes;
mod octahedral;
mod parameters;
mod projection;
mod round;
mod roughness;
mod shapes;
mod source;
mod spaces;
mod state;
mod textures;
mod tokens;
mod transforms;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::DMat4;

use crate::base::{Place, Result};
use crate::picture::Window;
use crate::scene::file::{CameraFile, FilmFile, IDENTITY, SceneFile, TextureFile};

use super::Read;
use super::held::Held;
use super::missing::Absent;
use super::notes::Notes;
use super::places::Places;
use colors::Palette;
use curves::Strands;
use finish::{Masked, Mix};
use parameters::{Parameter, Parameters};
use shapes::Piece;
use source::Sources;
use state::{Block, State};

/// Name of the material of shapes without one.
const DEFAULT_MATERIAL: &str = "default";

/// Translates the scene at `path`.
///
/// # Errors
/// [`Error::Io`](crate::base::Error::Io), `Malformed`, `Unsupported`, `Limit`, each with file and line.
pub(super) fn read(path: &Path) -> Result<Read> {
    let mut reader = Reader::new(path);
    match reader.document(path, &Place::file(path)) {
        // v4 makes textures once all is read, so that they may be named before they are there.
        Err(_) if reader.lacks_textures && !reader.ahead => {
            let mut ahead = Reader { ahead: true, ..Reader::new(path) };
            ahead.document(path, &Place::file(path))?;
            let Reader { float_textures, color_textures, held, baked, .. } = ahead;
            reader = Reader { float_textures, color_textures, held, baked, ..Reader::new(path) };
            reader.document(path, &Place::file(path))?;
        }
        read => read?,
    }
    reader.finish(path)
}

struct Reader {
    /// The scene's folder.
    folder: PathBuf,
    /// Folder of the file that is being read, relative to the scene's.
    inner: PathBuf,
    sources: Sources,
    file: SceneFile,
    places: Places,
    warnings: Vec<String>,
    /// Parameters that nothing uses.
    unused: Notes,
    /// Whatever else is done in another way, wherever it holds.
    notes: Notes,
    absent: Vec<Absent>,
    /// Meshes of the document, and pictures that were made of others.
    held: Held,
    /// Pixels of pictures that were made of others.
    baked: usize,
    state: State,
    blocks: Vec<(Block, State)>,
    /// Coordinate systems by name, to world.
    systems: BTreeMap<String, DMat4>,
    float_textures: BTreeMap<String, TextureFile>,
    color_textures: BTreeMap<String, TextureFile>,
    /// Whether only textures are read.
    ahead: bool,
    /// Whether a texture was asked for that was not there.
    lacks_textures: bool,
    /// Parameters behind the name of an included file.
    trailing: Vec<Parameter>,
    /// The pixel filter before there is a film.
    pixel_filter: Option<(String, Parameters)>,
    has_film: bool,
    /// Names of materials in the scene file by those in the document.
    materials: BTreeMap<String, String>,
    mixes: BTreeMap<String, Mix>,
    masked: Vec<Masked>,
    /// The shapes of objects by name.
    objects: BTreeMap<String, Vec<Piece>>,
    /// The object that is being defined.
    object: Option<String>,
    /// Curves that are to become meshes.
    strands: Strands,
    /// The camera's type, parameters, world to camera and medium.
    camera: Option<(String, Parameters, DMat4, String)>,
    /// The window of the film that is to be rendered; none for all of it.
    crop: Option<Window>,
    /// Factor on all light: what the film's sensitivity and the shutter make of it.
    exposure: f64,
    /// Whether the document is of pbrt-v3.
    old: bool,
    /// Whether WorldBegin has been read, and WorldEnd.
    world: [bool; 2],
    /// Number of meshes and materials that were named so far.
    named: usize,
}

impl Reader {
    fn new(path: &Path) -> Self {
        let film = FilmFile { width: 1280, height: 720, filter: film::DEFAULT_FILTER };
        let mut file = SceneFile::empty(String::new(), CameraFile::pinhole(IDENTITY, 90.0), film);
        file.render.max_depth = 6;
        Self {
            folder: path.parent().unwrap_or(Path::new("")).to_owned(),
            inner: PathBuf::new(),
            sources: Sources::default(),
            file,
            places: Places::new(path),
            warnings: Vec::new(),
            unused: Notes::default(),
            notes: Notes::default(),
            absent: Vec::new(),
            held: Held::default(),
            baked: 0,
            state: State::new(DEFAULT_MATERIAL),
            blocks: Vec::new(),
            systems: BTreeMap::new(),
            float_textures: BTreeMap::new(),
            color_textures: BTreeMap::new(),
            ahead: false,
            lacks_textures: false,
            trailing: Vec::new(),
            pixel_filter: None,
            has_film: false,
            materials: BTreeMap::new(),
            mixes: BTreeMap::new(),
            masked: Vec::new(),
            objects: BTreeMap::new(),
            object: None,
            strands: Strands::default(),
            camera: None,
            crop: None,
            exposure: 1.0,
            old: false,
            world: [false; 2],
            named: 0,
        }
    }

    /// Warns, once for all places, that something is done in another way.
    fn warn(&mut self, place: &Place, message: impl Into<String>) {
        self.notes.add(place, message.into());
    }

    /// Notes the parameters that nothing asked for.
    fn note_unused(&mut self, parameters: &Parameters) {
        parameters.unused().for_each(|(place, text)| self.unused.add(place, text));
    }

    /// What the colours of `parameters` are read by.
    fn palette(&self, parameters: &Parameters) -> Palette<'_> {
        Palette { folder: &self.folder, space: parameters.space, as_is: self.old }
    }

    /// A name that nothing in `taken` has.
    fn free_name(&mut self, wanted: &str, taken: impl Fn(&Self, &str) -> bool) -> String {
        loop {
            self.named += 1;
            let name = format!("{wanted} {}", self.named);
            if !taken(self, &name) {
                return name;
            }
        }
    }

    /// The path, relative to the scene's folder, of a file that the document calls `name`: pbrt looks for it in the scene's folder;
    /// else it may be beside the file that names it.
    fn locate(&self, name: &str) -> String {
        let found = |file: &str| super::path::resolve(&self.folder, file, &Place::file(&self.folder)).is_ok();
        let name = if name.contains('\\') && !found(name) { name.replace('\\', "/") } else { name.to_owned() };
        let beside = self.inner.join(&name).to_string_lossy().into_owned();
        if !found(&name) && !name.starts_with('/') && found(&beside) { beside } else { name }
    }
}
