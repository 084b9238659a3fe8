//! Cameras (specification, §3.10), and one that shows everything where there is none.

use ::gltf::json::camera::{Camera, Orthographic, Perspective};
use glam::{DMat3, DMat4, DVec3};

use crate::base::Result;
use crate::scene::file::{CameraFile, FilmFile, FilterFile, SceneFile};
use crate::scene::readers::cameras::add;
use crate::scene::readers::frames::rounded;
use crate::scene::readers::places::Places;

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

/// Puts the document's cameras, in the order of the nodes, and the picture's size into `file`. The first is the default one.
///
/// # Errors
/// [`Error::Malformed`](crate::base::Error::Malformed) for a camera that is not there or that makes no picture.
pub fn cameras(
    document: &Document,
    nodes: &[Placed],
    bounds: Bounds,
    file: &mut SceneFile,
    places: &mut Places,
    warnings: &mut Warnings,
) -> Result<()> {
    let placed = nodes.iter().filter_map(|placed| Some((placed, placed.node.camera?)));
    let mut count = 0;
    for (placed, index) in placed {
        let camera: &Camera = document.item(&document.root.cameras, "cameras", index, &placed.part())?;
        let (mut seen, film) = view(document, camera, placed.to_world, &format!("cameras[{}]", index.value()))?;
        let place = document.place(placed.part());
        if count == 0 {
            file.film = film;
            places.set("film", place.clone());
        } else {
            seen.size = Some([film.width, film.height]).filter(|size| *size != [file.film.width, file.film.height]);
        }
        // One camera may stand at several nodes.
        let name = placed.node.name.as_ref().or(camera.name.as_ref());
        add(file, places, count, name.map(String::as_str), seen, place);
        count += 1;
    }
    if count == 0 {
        warnings.add("cameras", "there is no camera: one that shows everything is used");
        (file.camera, file.film) = framing(bounds);
        ["camera", "film"].into_iter().for_each(|key| places.set(key, document.place("cameras")));
    }
    Ok(())
}

/// A camera at a node, and its picture.
fn view(document: &Document, camera: &Camera, to_world: DMat4, part: &str) -> Result<(CameraFile, FilmFile)> {
    let to_world = rigid(to_world);
    match (&camera.perspective, &camera.orthographic) {
        (Some(perspective), _) => {
            let (fov, film) = lens(document, perspective, part)?;
            Ok((camera_at(to_world, fov), film))
        }
        (None, Some(Orthographic { xmag, ymag, .. })) => {
            let [width, height] = [xmag, ymag].map(|half| 2.0 * f64::from(*half));
            if !(width > 0.0 && height > 0.0) {
                return Err(
                    document.malformed(part, format!("xmag is {xmag} and ymag {ymag}, expected numbers above 0"))
                );
            }
            let film = picture(document, part, "xmag over ymag", width / height)?;
            let flat = CameraFile { fov: 0.0, orthographic_width: Some(width as f32), ..camera_at(to_world, 90.0) };
            Ok((flat, film))
        }
        (None, None) => Err(document.malformed(part, "a camera is neither perspective nor orthographic")),
    }
}

/// Horizontal field of view in degrees, and the picture.
fn lens(document: &Document, perspective: &Perspective, part: &str) -> Result<(f64, FilmFile)> {
    let aspect = perspective.aspect_ratio.map_or(ASPECT, f64::from);
    let field = f64::from(perspective.yfov);
    let film = picture(document, part, "aspectRatio", aspect)?;
    if !(field > 0.0 && field < std::f64::consts::PI) {
        return Err(document.malformed(part, format!("yfov is {field}, expected an angle from 0 to π")));
    }
    Ok((2.0 * ((field / 2.0).tan() * aspect).atan().to_degrees(), film))
}

/// The picture of a camera by its width over height, which the document calls `name`.
fn picture(document: &Document, part: &str, name: &str, aspect: f64) -> Result<FilmFile> {
    if !(aspect > 1e-3 && aspect < 1e3) {
        return Err(document.malformed(part, format!("{name} is {aspect}, expected 0.001 to 1000")));
    }
    // No side longer than that of a tall picture of moderate width.
    let height = f64::from(HEIGHT).min(4.0 * f64::from(HEIGHT) / aspect).max(1.0);
    Ok(film((height * aspect).round().max(1.0) as u32, height.round() as u32))
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

/// A camera that shows all of `bounds`, with some room around it; two units around the origin where there is nothing.
pub fn framing(bounds: Bounds) -> (CameraFile, FilmFile) {
    let is_empty = bounds.iter().any(|corner| !corner.is_finite());
    let [low, high] = if is_empty { [DVec3::NEG_ONE, DVec3::ONE] } else { bounds };
    let z = FROM.normalize();
    let x = DVec3::Y.cross(z).normalize();
    let rotation = DMat3::from_cols(x, z.cross(x), z);
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
