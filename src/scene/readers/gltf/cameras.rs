//! Cameras (specification, §3.10), and one that shows everything where there is none.

use ::gltf::json::camera::{Camera, Perspective};
use glam::{DMat3, DMat4, DVec3};

use crate::base::Result;
use crate::scene::file::{CameraFile, FilmFile, FilterFile};
use crate::scene::readers::frames::rounded;

use super::document::Document;
use super::nodes::Placed;
use super::warnings::Warnings;

/// Rows of the picture.
const HEIGHT: u32 = 720;
/// Width over height where nothing is said.
const ASPECT: f64 = 16.0 / 9.0;
/// Vertical field of view of the camera that shows everything, degrees.
const FIELD: f64 = 35.0;
/// Direction from which it looks: models face +z.
const FROM: DVec3 = DVec3::new(0.55, 0.4, 1.0);

/// Size of that camera's picture over that of what it shows.
const ROOM: f64 = 1.1;

/// Corners of the box around everything that is to be seen.
pub type Bounds = [DVec3; 2];

/// The document's camera and the picture's size: the first perspective camera in the order of the nodes. Others are warned of.
///
/// # Errors
/// [`Error::Malformed`](crate::base::Error::Malformed) for a camera that is not there or whose angles make no picture.
pub fn camera(
    document: &Document,
    nodes: &[Placed],
    bounds: Bounds,
    warnings: &mut Warnings,
) -> Result<(CameraFile, FilmFile, String)> {
    let mut found: Option<(&Placed, &Perspective, String)> = None;
    let mut orthographic = None;
    for placed in nodes {
        let Some(index) = placed.node.camera else { continue };
        let camera: &Camera = document.item(&document.root.cameras, "cameras", index, &placed.part())?;
        let part = format!("cameras[{}]", index.value());
        let name = camera.name.as_ref().or(placed.node.name.as_ref()).map_or(String::new(), |n| format!(" \"{n}\""));
        match (&camera.perspective, &found) {
            (Some(perspective), None) => found = Some((placed, perspective, part)),
            (Some(_), Some((_, _, first))) => {
                let message = format!("the camera{name} is left out: {first} is used");
                warnings.add(placed.part(), message);
            }
            (None, _) => {
                warnings.add(&part, format_args!("the camera{name} is left out: only perspective cameras are read"));
                orthographic.get_or_insert(placed.to_world);
            }
        }
    }
    match found {
        Some((placed, perspective, part)) => {
            let (fov, film) = lens(document, perspective, &part)?;
            Ok((camera_at(rigid(placed.to_world), fov), film, placed.part()))
        }
        None => {
            warnings.add("cameras", "there is no perspective camera: one that shows everything is used");
            let (camera, film) = framing(bounds, orthographic);
            Ok((camera, film, "cameras".to_owned()))
        }
    }
}

/// Horizontal field of view in degrees, and the picture.
fn lens(document: &Document, perspective: &Perspective, part: &str) -> Result<(f64, FilmFile)> {
    let aspect = perspective.aspect_ratio.map_or(ASPECT, f64::from);
    let field = f64::from(perspective.yfov);
    if !(aspect > 1e-3 && aspect < 1e3) {
        return Err(document.malformed(part, format!("aspectRatio is {aspect}, expected 0.001 to 1000")));
    }
    if !(field > 0.0 && field < std::f64::consts::PI) {
        return Err(document.malformed(part, format!("yfov is {field}, expected an angle from 0 to π")));
    }
    // No side longer than that of a tall picture of moderate width.
    let height = f64::from(HEIGHT).min(4.0 * f64::from(HEIGHT) / aspect).max(1.0);
    let film = film((height * aspect).round().max(1.0) as u32, height.round() as u32);
    Ok((2.0 * ((field / 2.0).tan() * aspect).atan().to_degrees(), film))
}

fn film(width: u32, height: u32) -> FilmFile {
    FilmFile { width, height, filter: FilterFile::default() }
}

/// The rotation and translation of a matrix: a camera's scale does not count.
fn rigid(matrix: DMat4) -> DMat4 {
    let z = matrix.z_axis.truncate().try_normalize().unwrap_or(DVec3::Z);
    let y = matrix.y_axis.truncate();
    let y = (y - z * z.dot(y)).try_normalize().unwrap_or(z.any_orthonormal_vector());
    let rotation = DMat3::from_cols(y.cross(z), y, z);
    DMat4::from_translation(matrix.w_axis.truncate()) * DMat4::from_mat3(rotation)
}

/// A camera that looks along −z of `to_world`, +y up, as those of glTF do; ours look along +z with +x to the left.
fn camera_at(to_world: DMat4, fov: f64) -> CameraFile {
    let turned = to_world * DMat4::from_diagonal(DVec3::new(-1.0, 1.0, -1.0).extend(1.0));
    CameraFile::pinhole(rounded(turned).map(|value| value + 0.0), fov as f32)
}

/// A camera that shows all of `bounds`, with some room around it, from where the one at `like` looks, if there is one.
pub fn framing([low, high]: Bounds, like: Option<DMat4>) -> (CameraFile, FilmFile) {
    let rotation = match like {
        Some(matrix) => DMat3::from_mat4(rigid(matrix)),
        None => {
            let z = FROM.normalize();
            let x = DVec3::Y.cross(z).normalize();
            DMat3::from_cols(x, z.cross(x), z)
        }
    };
    let (center, half) = (0.5 * (low + high), 0.5 * (high - low));
    let tangent = (FIELD.to_radians() / 2.0).tan();
    let mut distance = 0.0f64;
    for corner in 0..8 {
        let sign = |axis: usize| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
        let seen = rotation.transpose() * (half * DVec3::new(sign(0), sign(1), sign(2)));
        distance = distance.max(seen.z + ROOM * (seen.x.abs() / (tangent * ASPECT)).max(seen.y.abs() / tangent));
    }
    let eye = center + rotation.z_axis * if distance > 0.0 { distance } else { 1.0 };
    let fov = 2.0 * (tangent * ASPECT).atan().to_degrees();
    let to_world = DMat4::from_translation(eye) * DMat4::from_mat3(rotation);
    (camera_at(to_world, fov), film((f64::from(HEIGHT) * ASPECT).round() as u32, HEIGHT))
}
