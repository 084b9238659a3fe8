//! Checks of a [`SceneFile`]'s values and references. Later code relies on them.

mod lights;
mod materials;
mod number;

use glam::DMat3;

use crate::base::{Error, Place, Result};
use crate::scene::file::{
    CameraFile, FilmFile, FilterFile, GeometryFile, GridFile, LightFile, MaterialFile, Matrix, MediumFile, MeshFile,
    RenderFile, SceneFile, ShapeFile, VERSION,
};
use crate::scene::plan::is_environment;

use super::LARGEST;
use super::places::Places;
use number::Checker;

pub use lights::LEAST_ANGLE;
pub use number::{FLATTENS, has_inverse, linear};

/// Longest side of a picture in pixels.
const LARGEST_SIDE: u32 = 16384;
/// Most pixels of a picture.
const MOST_PIXELS: u64 = 1 << 26;

/// Error for a scene file of another version.
pub(super) fn unsupported_version(place: Place, version: u32) -> Error {
    Error::Unsupported { place, what: format!("format version {version}"), supported: VERSION.to_string() }
}

/// Checks everything that can be known without opening another file.
///
/// # Errors
/// [`Error::Malformed`], [`Error::Unsupported`] or [`Error::Limit`] at the offending key's place.
pub fn validate(file: &SceneFile, places: &Places) -> Result<()> {
    let check = Checker::new(places);
    if file.version != VERSION {
        return Err(unsupported_version(places.at("version"), file.version));
    }
    cameras(&check, file)?;
    film(&check, &file.film)?;
    render(&check, &file.render)?;
    for (name, material) in &file.materials {
        materials::material(&check, &format!("materials.{name}"), material)?;
    }
    for (name, medium) in &file.media {
        self::medium(&check, &format!("media.{name}"), medium)?;
    }
    for (name, mesh) in &file.meshes {
        mesh_file(&check, &format!("meshes.{name}"), mesh)?;
    }
    for (index, shape_file) in file.shapes.iter().enumerate() {
        shape(&check, &format!("shapes[{index}]"), shape_file, file)?;
    }
    lights::count(&check, &file.lights)?;
    for (index, light) in file.lights.iter().enumerate() {
        lights::light(&check, &format!("lights[{index}]"), light)?;
    }
    one_environment(&check, &file.lights)
}

fn cameras(check: &Checker, file: &SceneFile) -> Result<()> {
    camera(check, "camera", &file.camera, file)?;
    if file.camera.size.is_some() {
        return check.fail("camera.size", "the picture of this camera is as large as film says");
    }
    if file.cameras.contains_key(&file.camera_name) {
        let message = format!("there is another camera \"{}\" in cameras", file.camera_name);
        return check.fail("camera_name", message);
    }
    for (name, further) in &file.cameras {
        camera(check, &format!("cameras.{name}"), further, file)?;
    }
    match file.views().any(|(name, _)| name.is_empty()) {
        true => check.fail("cameras", "a camera has an empty name"),
        false => Ok(()),
    }
}

fn camera(check: &Checker, key: &str, camera: &CameraFile, file: &SceneFile) -> Result<()> {
    let of = |part: &str| format!("{key}.{part}");
    check.transform(&of("to_world"), &camera.to_world)?;
    if let Some(width) = camera.orthographic_width {
        check.positive(&of("orthographic_width"), width)?;
        if camera.aperture_radius != 0.0 {
            return check.fail(&of("aperture_radius"), "an orthographic camera has no lens");
        }
    } else if !(camera.fov > 0.0 && camera.fov < 180.0) {
        return check
            .fail(&of("fov"), format!("the field of view is {}°, expected one between 0° and 180°", camera.fov));
    }
    for (name, length) in [("aperture_radius", camera.aperture_radius), ("near_clip", camera.near_clip)] {
        check.at_least(&of(name), length, 0.0)?;
        if length > LARGEST {
            return check.fail(&of(name), format!("{name} is {length:e} units, the limit is {LARGEST:e}"));
        }
    }
    check.finite(&of("principal_point_offset"), &camera.principal_point_offset)?;
    if let Some([width, height]) = camera.size {
        picture(check, &of("size"), [("columns", width), ("rows", height)])?;
    }
    known_medium(check, &of("medium"), camera.medium.as_ref(), file)?;
    match camera.focus_distance {
        Some(distance) => check.positive(&of("focus_distance"), distance),
        None if camera.aperture_radius > 0.0 => check.fail(key, "a lens needs a focus_distance"),
        None => Ok(()),
    }
}

fn medium(check: &Checker, key: &str, medium: &MediumFile) -> Result<()> {
    let (sigma_t, albedo, g) = match medium {
        MediumFile::Homogeneous { sigma_t, albedo, g } => (sigma_t, albedo, *g),
        MediumFile::Grid(file) => {
            check.color(&format!("{key}.emission"), &file.emission)?;
            (&file.sigma_t, &file.albedo, file.g)
        }
    };
    check.color(&format!("{key}.sigma_t"), sigma_t)?;
    check.albedo(&format!("{key}.albedo"), albedo)?;
    if !(g > -1.0 && g < 1.0) {
        return check.fail(&format!("{key}.g"), format!("g is {g}, expected a number between -1 and 1"));
    }
    for (name, grid) in medium.grids() {
        check.transform(&format!("{key}.{name}.to_world"), grid.to_world())?;
        if let GridFile::Inline { values, .. } = grid {
            check.finite(&format!("{key}.{name}.values"), values)?;
        }
    }
    Ok(())
}

fn known_medium(check: &Checker, key: &str, name: Option<&String>, file: &SceneFile) -> Result<()> {
    match name.filter(|name| !file.media.contains_key(*name)) {
        Some(name) => check.fail(key, format!("there is no medium \"{name}\"")),
        None => Ok(()),
    }
}

fn film(check: &Checker, film: &FilmFile) -> Result<()> {
    picture(check, "film", [("width", film.width), ("height", film.height)])?;
    filter(check, &film.filter)
}

/// Checks the sides of a picture, each with its name below `key`.
fn picture(check: &Checker, key: &str, sides: [(&str, u32); 2]) -> Result<()> {
    for (name, side) in sides {
        let key = format!("{key}.{name}");
        if side == 0 {
            return check.fail(&key, format!("{key} is 0, expected at least one pixel"));
        }
        check.limit(&key, u64::from(side), u64::from(LARGEST_SIDE))?;
    }
    check.limit(key, sides.iter().map(|(_, side)| u64::from(*side)).product(), MOST_PIXELS)
}

fn filter(check: &Checker, filter: &FilterFile) -> Result<()> {
    let width = |name: &str, value: f32| {
        let key = format!("film.filter.{name}");
        check.positive(&key, value)?;
        if value > FilterFile::MOST {
            return check.fail(&key, format!("{name} is {value} pixels, expected at most {}", FilterFile::MOST));
        }
        Ok(())
    };
    if let FilterFile::Gaussian { stddev, .. } = filter {
        width("stddev", *stddev)?;
    }
    width("radius", filter.radius())
}

fn render(check: &Checker, render: &RenderFile) -> Result<()> {
    for (key, value) in [("render.max_depth", render.max_depth), ("render.spp", render.spp)] {
        if value == 0 {
            return check.fail(key, format!("{key} is 0, expected at least 1"));
        }
    }
    Ok(())
}

fn mesh_file(check: &Checker, key: &str, mesh: &MeshFile) -> Result<()> {
    if let MeshFile::Curves { wider, .. } = mesh {
        return check.positive(&format!("{key}.wider"), *wider);
    }
    let MeshFile::Inline { positions, normals, uvs, .. } = mesh else { return Ok(()) };
    for (what, count) in [("normals", normals.len()), ("uvs", uvs.len())] {
        if count != 0 && count != positions.len() {
            let vertices = positions.len();
            return check.fail(
                &format!("{key}.{what}"),
                format!("{count} {what} for {vertices} vertices; expected as many, or none"),
            );
        }
    }
    Ok(())
}

fn shape(check: &Checker, key: &str, shape: &ShapeFile, file: &SceneFile) -> Result<()> {
    // One that flattens space may leave nothing to be seen, which is known once the mesh is read.
    check.affine(&format!("{key}.to_world"), &shape.to_world)?;
    if !file.materials.contains_key(&shape.material) {
        return check.fail(&format!("{key}.material"), format!("there is no material \"{}\"", shape.material));
    }
    for (side, name) in [("interior", &shape.interior), ("exterior", &shape.exterior)] {
        known_medium(check, &format!("{key}.{side}"), name.as_ref(), file)?;
    }
    if let Some(emission) = &shape.emission {
        check.color(&format!("{key}.emission"), emission)?;
        if matches!(file.materials[&shape.material].innermost(), MaterialFile::Null {}) {
            return check.fail(&format!("{key}.emission"), "what is no surface cannot emit; give it a black material");
        }
    }
    if let Some(texture) = &shape.emission_texture {
        let key = format!("{key}.emission_texture");
        if shape.emission.is_none() {
            return check.fail(&key, "a factor on an emission that there is not");
        }
        materials::emission(check, &key, texture)?;
    }
    match &shape.geometry {
        GeometryFile::Mesh { mesh } if !file.meshes.contains_key(mesh) => {
            check.fail(&format!("{key}.geometry.mesh"), format!("there is no mesh \"{mesh}\""))
        }
        GeometryFile::Mesh { .. } => Ok(()),
        GeometryFile::Sphere { center, radius } => {
            check.finite(&format!("{key}.geometry.center"), center)?;
            check.at_least(&format!("{key}.geometry.radius"), *radius, 0.0)?;
            uniform_scale(check, &format!("{key}.to_world"), &shape.to_world)
        }
    }
}

/// Checks that a sphere stays one: columns of equal length at right angles, up to the rounding of a matrix written with six digits.
fn uniform_scale(check: &Checker, key: &str, matrix: &Matrix) -> Result<()> {
    let linear = number::linear(matrix);
    let gram = linear.transpose() * linear;
    let mean = (gram.x_axis.x + gram.y_axis.y + gram.z_axis.z) / 3.0;
    let off = gram - DMat3::from_diagonal(glam::DVec3::splat(mean));
    if off.to_cols_array().iter().any(|x| x.abs() > 1e-4 * mean) {
        return check.fail(key, "a sphere's transform may scale only uniformly");
    }
    Ok(())
}

fn one_environment(check: &Checker, lights: &[LightFile]) -> Result<()> {
    match lights.iter().enumerate().filter(|(_, light)| is_environment(light)).nth(1) {
        Some((index, _)) => {
            check.fail(&format!("lights[{index}]"), "a scene may have only one constant, envmap or sky light")
        }
        None => Ok(()),
    }
}

/// Error for a quantity beyond its limit.
fn beyond(check: &Checker, key: &str, value: u64, limit: u64) -> Error {
    Error::Limit { place: check.place(key), what: key.to_owned(), value, limit }
}
