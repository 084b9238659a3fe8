//! Mitsuba scenes in XML (3.x, and 0.4 to 0.6), the part that [`SceneFile`] can express. Nothing is ignored in silence: an unknown
//! object becomes a near relation or is left out, a property that its object has no use for is left out, and anything else may be done in
//! another way, each with a warning that names file and line. What looks like a slip of the pen is an error, and so is what leaves no
//! picture to make.

mod approximate;
mod color;
mod daylight;
mod document;
mod element;
mod emitter;
mod everything;
mod material;
mod medium;
mod object;
mod of_faces;
mod principled;
mod sensor;
mod shape;
mod solar;
mod spectrum_file;
mod sunlight;
mod texture;
mod thin;
mod transform;
mod unused;
mod upgrade;
mod volume;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::base::{Place, Result};
use crate::scene::file::{CameraFile, IDENTITY, SceneFile};

use super::Read;
use super::definitions::Definition;
use super::held::Held;
use super::missing::{Absent, is_absent};
use super::path;
use super::places::Places;
use element::Element;
use object::{Ids, kind};
use sensor::DEFAULT_FILM;

/// Depth of integrators without limit (-1): light that has bounced this often is long gone.
const UNLIMITED_DEPTH: u32 = 1024;

/// Translates the scene at `path`, in which names stand for what `definitions` say.
///
/// # Errors
/// [`Error::Io`](crate::base::Error::Io), `Malformed`, `Unsupported`, `Limit`, each with file and line.
pub(super) fn read(path: &Path, definitions: &[Definition]) -> Result<Read> {
    let (scene, warnings) = document::read(path, definitions)?;
    let mut ids = Ids::default();
    collect_ids(&scene, &mut ids)?;
    let mut reader = Reader { warnings, ..Reader::new(path, ids) };
    for child in &scene.children {
        reader.top_level(child)?;
    }
    reader.finish(&scene)
}

/// Collects elements by id. Every id names one element, wherever it stands.
fn collect_ids<'a>(element: &'a Element, ids: &mut Ids<'a>) -> Result<()> {
    for child in element.children.iter().filter(|child| child.tag != "ref") {
        if child.tag != "alias"
            && let Some(id) = child.attribute("id")
            && let Some(first) = ids.insert(id, child)
        {
            return Err(child.malformed(format!("the id \"{id}\" is already used at {}", first.place)));
        }
        collect_ids(child, ids)?;
        if child.tag == "alias" {
            let target = child.required("id")?;
            let found =
                ids.get(target).ok_or_else(|| child.malformed(format!("nothing before has the id \"{target}\"")))?;
            ids.insert(child.required("as")?, found);
        }
    }
    Ok(())
}

/// What is read where it is used, if it is: objects, and the settings of Mitsuba itself.
const USED_ELSEWHERE: [&str; 20] = [
    "texture",
    "rgb",
    "srgb",
    "spectrum",
    "blackbody",
    "film",
    "sampler",
    "transform",
    "medium",
    "rfilter",
    "phase",
    "volume",
    "subsurface",
    "field",
    "float",
    "integer",
    "boolean",
    "string",
    "point",
    "vector",
];

struct Reader<'a> {
    /// The scene's folder.
    folder: PathBuf,
    ids: Ids<'a>,
    file: SceneFile,
    places: Places,
    warnings: Vec<String>,
    /// Pictures that were found to be missing.
    absent: Vec<Absent>,
    /// Meshes that no file has.
    held: Held,
    /// Sensors read so far.
    sensors: usize,
    /// Folders in which files are looked for beside the scene's own.
    search: Vec<String>,
    has_integrator: bool,
    /// Names given to materials without an id, by their element.
    unnamed: BTreeMap<*const Element, String>,
    /// Materials of the faces of OBJ files, by file.
    names_of_faces: BTreeMap<String, Vec<String>>,
    /// Number of objects around the one of their kind that is being read.
    depth: u32,
    /// Number of materials read so far.
    materials: u64,
    /// Number of shapes met so far, those that are left out too.
    met: usize,
}

impl<'a> Reader<'a> {
    fn new(path: &Path, ids: Ids<'a>) -> Self {
        let file = SceneFile::empty(String::new(), CameraFile::pinhole(IDENTITY, 90.0), DEFAULT_FILM);
        Self {
            folder: path.parent().unwrap_or(Path::new("")).to_owned(),
            ids,
            file,
            places: Places::new(path),
            warnings: Vec::new(),
            absent: Vec::new(),
            held: Held::default(),
            sensors: 0,
            search: Vec::new(),
            has_integrator: false,
            unnamed: BTreeMap::new(),
            names_of_faces: BTreeMap::new(),
            depth: 0,
            materials: 0,
            met: 0,
        }
    }

    fn top_level(&mut self, element: &'a Element) -> Result<()> {
        match element.tag.as_str() {
            "integrator" => self.integrator(element),
            "sensor" => self.sensor(element),
            "bsdf" => self.named_material(element),
            // Read where it is used, if it is.
            "emitter" if element.attribute("id").is_some() && kind(element)? == "area" => Ok(()),
            tag if USED_ELSEWHERE.contains(&tag) => {
                if element.attribute("id").is_none() {
                    self.ids.unused.note(element, format!("the <{tag}> inside <scene> is not used"));
                }
                Ok(())
            }
            "alias" => element.only_attributes(&["id", "as"]),
            "path" => {
                element.only_attributes(&["id", "value"])?;
                self.search.push(element.required("value")?.to_owned());
                Ok(())
            }
            "shape" => self.shape(element),
            "emitter" => self.emitter(element),
            other => {
                let known =
                    ["default", "include", "integrator", "sensor", "bsdf", "texture", "medium", "shape", "emitter"];
                Err(element.unsupported(format!("<{other}> inside <scene>"), &known))
            }
        }
    }

    /// A file's name from the scene's folder: where it is not there, the first `<path>` that has it goes before.
    fn located(&self, file: &str) -> String {
        // Scenes that were written on Windows.
        let slashed =
            if file.contains('\\') && is_absent(&self.folder, file) { file.replace('\\', "/") } else { String::new() };
        let file = if slashed.is_empty() { file } else { &slashed };
        let found = self
            .search
            .iter()
            .map(|path| format!("{path}/{file}"))
            .find(|found| path::resolve(&self.folder, found, &Place::file(&self.folder)).is_ok());
        found.filter(|_| is_absent(&self.folder, file)).unwrap_or_else(|| file.to_owned())
    }

    /// Warns that something at `element` is done in another way.
    fn warn(&mut self, element: &Element, message: impl std::fmt::Display) {
        self.warnings.push(format!("{}: {message}", element.place));
    }

    fn integrator(&mut self, element: &'a Element) -> Result<()> {
        if std::mem::replace(&mut self.has_integrator, true) {
            self.warn(element, "only the first integrator counts");
            return Ok(());
        }
        let kind = kind(element)?;
        // How paths end early and how they are sampled does not belong to a scene's radiance.
        let object = object::Object::lenient(element, &self.ids, &["max_depth", "hide_emitters"])?;
        // Integrators that measure other quantities beside radiance hold the one that computes it.
        if let Some(inner) = object.nested.iter().find(|inner| inner.tag == "integrator") {
            self.warn(element, format_args!("the integrator \"{kind}\" is left out, the one inside is kept"));
            self.has_integrator = false;
            return self.nested(inner, |reader| reader.integrator(inner));
        }
        self.file.render.hide_emitters = object.boolean("hide_emitters")?.unwrap_or(false);
        if !["path", "volpath", "volpathmis", "direct", "ptracer", "bdpt", "volpath_simple"].contains(&kind) {
            self.warn(element, format_args!("paths are traced instead of the integrator \"{kind}\""));
        }
        self.file.render.max_depth = match (object.integer("max_depth")?, kind) {
            (None, "direct") => 2,
            (None | Some(-1), _) => {
                self.warn(element, format_args!("unlimited depth: paths end at {UNLIMITED_DEPTH}"));
                UNLIMITED_DEPTH
            }
            (Some(depth), _) => u32::try_from(depth)
                .map_err(|_| element.malformed(format!("max_depth is {depth}, expected -1 or more")))?,
        };
        self.places.set("render.max_depth", element.place.clone());
        Ok(())
    }

    fn finish(mut self, scene: &Element) -> Result<Read> {
        if self.sensors == 0 {
            if self.file.shapes.is_empty() {
                return Err(scene.malformed("the scene has neither sensor nor shapes"));
            }
            self.warn(scene, "the scene has no sensor: one that shows everything is used");
            self.frame_everything();
        }
        let Self { file, places, mut warnings, absent, held, ids, .. } = self;
        warnings.extend(ids.unused.into_warnings());
        Ok(Read { file, places, warnings, absent, held })
    }
}
