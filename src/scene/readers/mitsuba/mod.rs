//! Mitsuba 3 scenes in XML, the part that [`SceneFile`] can express. Nothing is ignored in silence: what is unknown is an
//! error with file, line and what could stand there; what is done in another way is a warning.

mod conductors;
mod element;
mod emitter;
mod material;
mod medium;
mod object;
mod sensor;
mod shape;
mod transform;

use std::path::Path;

use crate::base::Result;
use crate::scene::file::{CameraFile, FilmFile, FilterFile, IDENTITY, RenderFile, SceneFile, VERSION};

use super::places::Places;
use element::Element;
use object::Ids;

/// A translated scene, with the lines that its parts come from.
pub struct Translation {
    /// The scene file, unchecked.
    pub file: SceneFile,
    /// Places of its parts.
    pub places: Places,
    /// What is done in another way than the document says.
    pub warnings: Vec<String>,
}

/// Integrators count -1 as no limit; light that has bounced this often is long gone.
const UNLIMITED_DEPTH: u32 = 1024;

/// Translates the scene at `path`.
///
/// # Errors
/// [`Error::Io`](crate::base::Error::Io), `Malformed`, `Unsupported`, `Limit`, each with file and line.
pub fn read(path: &Path) -> Result<Translation> {
    let scene = element::read(path)?;
    check_version(&scene)?;
    let mut ids = Ids::new();
    collect_ids(&scene, &mut ids)?;
    let mut reader = Reader::new(path, ids);
    for child in &scene.children {
        reader.top_level(child)?;
    }
    reader.finish(&scene)
}

fn check_version(scene: &Element) -> Result<()> {
    scene.only_attributes(&["version"])?;
    let version = scene.required("version")?;
    match version.split('.').next() {
        Some("3") => Ok(()),
        _ => Err(scene.unsupported(format!("scene version {version}"), &["3.x"])),
    }
}

/// Every id names one element, wherever it stands.
fn collect_ids<'a>(element: &'a Element, ids: &mut Ids<'a>) -> Result<()> {
    for child in element.children.iter().filter(|child| child.tag != "ref") {
        if let Some(id) = child.attribute("id")
            && let Some(first) = ids.insert(id, child)
        {
            return Err(child.malformed(format!("the id \"{id}\" is already used at {}", first.place)));
        }
        collect_ids(child, ids)?;
    }
    Ok(())
}

struct Reader<'a> {
    ids: Ids<'a>,
    file: SceneFile,
    places: Places,
    warnings: Vec<String>,
    has_sensor: bool,
    has_integrator: bool,
    /// Materials around the one that is being read.
    depth: u32,
}

impl<'a> Reader<'a> {
    fn new(path: &Path, ids: Ids<'a>) -> Self {
        let file = SceneFile {
            version: VERSION,
            name: String::new(),
            camera: CameraFile {
                to_world: IDENTITY,
                fov: 90.0,
                aperture_radius: 0.0,
                focus_distance: None,
                medium: None,
            },
            film: FilmFile { width: 768, height: 576, filter: FilterFile::GAUSSIAN },
            render: RenderFile::default(),
            materials: Default::default(),
            media: Default::default(),
            meshes: Default::default(),
            shapes: Vec::new(),
            lights: Vec::new(),
        };
        Self {
            ids,
            file,
            places: Places::new(path),
            warnings: Vec::new(),
            has_sensor: false,
            has_integrator: false,
            depth: 0,
        }
    }

    fn top_level(&mut self, element: &'a Element) -> Result<()> {
        match element.tag.as_str() {
            "integrator" => self.integrator(element),
            "sensor" => self.sensor(element),
            "bsdf" => self.named_material(element),
            // Read where it is used.
            "texture" if element.attribute("id").is_some() => Ok(()),
            "medium" if element.attribute("id").is_some() => Ok(()),
            "shape" => self.shape(element),
            "emitter" => self.emitter(element),
            other => {
                let known = [
                    "default",
                    "include",
                    "integrator",
                    "sensor",
                    "bsdf",
                    "texture with an id",
                    "medium with an id",
                    "shape",
                    "emitter",
                ];
                Err(element.unsupported(format!("<{other}> inside <scene>"), &known))
            }
        }
    }

    fn integrator(&mut self, element: &'a Element) -> Result<()> {
        if std::mem::replace(&mut self.has_integrator, true) {
            return Err(element.malformed("a second integrator"));
        }
        match object::kind(element)? {
            "path" | "volpath" => {}
            other => return Err(element.unsupported(format!("integrator \"{other}\""), &["path", "volpath"])),
        }
        // How paths end early and what is shown where nothing is hit do not belong to a scene's radiance.
        let object = object::Object::new(element, &self.ids, &["max_depth", "rr_depth", "hide_emitters"], &[])?;
        object.integer("rr_depth")?;
        if object.boolean("hide_emitters")? == Some(true) {
            return Err(element.unsupported("hide_emitters", &["false"]));
        }
        self.file.render.max_depth = match object.integer("max_depth")?.unwrap_or(-1) {
            -1 => {
                self.warnings.push(format!("{}: unlimited depth: paths end at {UNLIMITED_DEPTH}", element.place));
                UNLIMITED_DEPTH
            }
            depth => u32::try_from(depth)
                .map_err(|_| element.malformed(format!("max_depth is {depth}, expected -1 or more")))?,
        };
        self.places.set("render.max_depth", element.place.clone());
        Ok(())
    }

    fn finish(self, scene: &Element) -> Result<Translation> {
        if !self.has_sensor {
            return Err(scene.malformed("the scene has no sensor"));
        }
        Ok(Translation { file: self.file, places: self.places, warnings: self.warnings })
    }
}
