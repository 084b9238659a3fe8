//! Missing files that a scene names: all of them in one error, or substitutes.

use std::collections::{BTreeMap, BTreeSet};
use std::io::ErrorKind;
use std::path::Path;

use crate::base::{At, Error, Place, Result};
use crate::scene::file::{GridFile, LightFile, MaterialFile, MeshFile, SceneFile, TextureFile};

use super::held::Held;
use super::left_out::Reasons;
use super::path;
use super::places::Places;

/// Treatment of a scene that names meshes and pictures which are not there.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Missing {
    /// Refuses the scene.
    #[default]
    Refuse,
    /// Leaves out shapes without mesh, and replaces pictures by grey.
    Skip,
}

impl Missing {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Refuse => "refuse",
            Self::Skip => "skip",
        }
    }
}

/// Value that replaces a missing picture.
pub(super) const GREY: f32 = 0.5;
/// Colour that replaces a missing normal map: the surface's own normal.
const STRAIGHT: [f32; 3] = [0.5, 0.5, 1.0];

/// A missing file.
#[derive(Debug, Clone)]
pub(super) struct Absent {
    /// File name as in the scene.
    pub file: String,
    /// The place that names it.
    pub place: Place,
    /// Description of the substitute for a picture; none for a mesh, whose shapes are warned of.
    pub instead: Option<String>,
}

impl Absent {
    /// A missing volume of a medium, which is 1 everywhere instead.
    pub fn volume(file: &str, place: Place) -> Self {
        Self { file: file.to_owned(), place, instead: Some("the constant 1 is used instead".to_owned()) }
    }

    /// A missing picture that a colour replaces.
    pub fn picture(file: &str, place: Place, color: [f32; 3]) -> Self {
        let [r, g, b] = color;
        let told = if r == g && g == b { r.to_string() } else { format!("{r}, {g}, {b}") };
        Self { file: file.to_owned(), place, instead: Some(format!("the constant {told} is used instead")) }
    }
}

/// Whether there is nothing at the path that the scene in `folder` calls `file`.
pub(super) fn is_absent(folder: &Path, file: &str) -> bool {
    match path::resolve(folder, file, &Place::file(folder)) {
        Err(Error::Io { source, .. }) => matches!(source.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory),
        _ => false,
    }
}

/// Finds the files that the scene in `folder` lacks, beside those `found` before and but for what is `held`, and replaces pictures by
/// colours, each with a warning. Returns why meshes are missing, whose shapes remain to be removed, and the names of all missing files.
///
/// # Errors
/// [`Error::Missing`] with all absent files unless they are to be skipped.
pub(super) fn settle(
    scene: &mut SceneFile,
    folder: &Path,
    places: &Places,
    held: &Held,
    mut found: Vec<Absent>,
    missing: Missing,
    warnings: &mut Vec<String>,
) -> Result<(Reasons, Vec<String>)> {
    let reasons = absent_meshes(scene, folder, places, &mut found);
    replace_pictures(scene, folder, places, held, &mut found);
    replace_grids(scene, folder, places, &mut found);
    found.sort_by_key(|absent| (absent.place.path.clone(), line(&absent.place)));
    let mut files: Vec<(String, Place)> = Vec::new();
    let (mut seen, mut told) = (BTreeSet::new(), BTreeSet::new());
    for Absent { file, place, instead } in found {
        if let Some(instead) = instead {
            let kind = if file.ends_with(".vol") { "volume" } else { "picture" };
            let text = format!("{place}: the {kind} \"{file}\" is missing: {instead}");
            if told.insert(text.clone()) {
                warnings.push(text);
            }
        }
        if seen.insert(file.clone()) {
            files.push((file, place));
        }
    }
    if missing == Missing::Refuse && !files.is_empty() {
        return Err(Error::Missing { scene: places.source().to_owned(), files });
    }
    Ok((reasons, files.into_iter().map(|(file, _)| file).collect()))
}

fn line(place: &Place) -> u32 {
    if let Some(At::Line(line)) = place.at { line } else { u32::MAX }
}

/// Finds missing meshes; returns the reasons by name.
fn absent_meshes(scene: &SceneFile, folder: &Path, places: &Places, found: &mut Vec<Absent>) -> Reasons {
    let mut reasons = Reasons::new();
    for (name, mesh) in &scene.meshes {
        let (MeshFile::Obj { file, .. }
        | MeshFile::Ply { file, .. }
        | MeshFile::Serialized { file, .. }
        | MeshFile::Curves { file, .. }) = mesh
        else {
            continue;
        };
        if is_absent(folder, file) {
            let place = places.at(&format!("meshes.{name}"));
            found.push(Absent { file: file.clone(), place, instead: None });
            reasons.insert(name.clone(), format!("its mesh \"{file}\" is missing"));
        }
    }
    reasons
}

/// Replaces missing pictures by colours.
fn replace_pictures(scene: &mut SceneFile, folder: &Path, places: &Places, held: &Held, found: &mut Vec<Absent>) {
    let mut known = BTreeMap::new();
    let mut absent = |file: &str| {
        *known.entry(file.to_owned()).or_insert_with(|| !held.has_picture(file) && is_absent(folder, file))
    };
    for (name, material) in &mut scene.materials {
        let mut replace = |texture: &mut TextureFile, color: Option<[f32; 3]>| {
            let TextureFile::Bitmap { file, scale, .. } = texture else { return };
            if absent(file) {
                let color = color.unwrap_or([(GREY * *scale).clamp(0.0, 1.0); 3]);
                let place = places.of_picture(file, &format!("materials.{name}"));
                found.push(Absent::picture(file, place, color));
                *texture = TextureFile::rgb(color);
            }
        };
        straighten(material, &mut |texture| replace(texture, Some(STRAIGHT)));
        material.textures_mut().into_iter().for_each(|(_, texture)| replace(texture, None));
    }
    for (index, shape) in scene.shapes.iter_mut().enumerate() {
        let Some(TextureFile::Bitmap { file, scale, .. }) = &shape.emission_texture else { continue };
        if absent(file) {
            let color = [GREY * *scale; 3];
            found.push(Absent::picture(file, places.of_picture(file, &format!("shapes[{index}]")), color));
            shape.emission_texture = Some(TextureFile::rgb(color));
        }
    }
    for (index, light) in scene.lights.iter_mut().enumerate() {
        let place = || places.at(&format!("lights[{index}]"));
        if let Some(texture) = light.texture_mut() {
            if let TextureFile::Bitmap { file, scale, .. } = texture
                && absent(file)
            {
                let color = [GREY * *scale; 3];
                found.push(Absent::picture(file, place(), color));
                *texture = TextureFile::rgb(color);
            }
            continue;
        }
        let LightFile::Envmap { file, scale, .. } = light else { continue };
        if absent(file) {
            let radiance = [GREY * *scale; 3];
            found.push(Absent::picture(file, place(), radiance));
            *light = LightFile::Constant { radiance };
        }
    }
}

/// Replaces missing grids of media by a cell of value 1.
fn replace_grids(scene: &mut SceneFile, folder: &Path, places: &Places, found: &mut Vec<Absent>) {
    for (name, medium) in &mut scene.media {
        for (key, grid) in medium.grids_mut() {
            let GridFile::Vol { file, to_world, .. } = grid else { continue };
            if is_absent(folder, file) {
                found.push(Absent::volume(file, places.at(&format!("media.{name}.{key}"))));
                *grid = GridFile::Inline { size: [1; 3], values: vec![1.0], to_world: *to_world, fades: false };
            }
        }
    }
}

/// Calls `replace` on the texture of every normal map, wherever it is in the material.
fn straighten(material: &mut MaterialFile, replace: &mut impl FnMut(&mut TextureFile)) {
    if let MaterialFile::NormalMap { texture, .. } = material {
        replace(texture);
    }
    if let MaterialFile::Blend { materials, .. } = material {
        materials.iter_mut().for_each(|part| straighten(part, replace));
    } else if let Some(inside) = material.inside_mut() {
        straighten(inside, replace);
    }
}
