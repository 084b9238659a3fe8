//! Extent of a scene, and its limit: beyond it, products of lengths would leave single precision.

use std::borrow::Borrow;
use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DMat3, DVec3};

use crate::base::{Error, Result};
use crate::geometry::mesh::Mesh;
use crate::scene::file::{GeometryFile, LightFile, Matrix, SceneFile, ShapeFile};

use super::LARGEST;
use super::places::Places;
use super::validate::linear;

/// Refuses shapes, lights and cameras beyond the limit.
///
/// # Errors
/// [`Error::Malformed`] at the shape's, light's or camera's place.
pub fn check(file: &SceneFile, meshes: &BTreeMap<String, Arc<Mesh>>, places: &Places) -> Result<()> {
    let fail = |key: &str, reach: f64| {
        let message = format!("it reaches {reach:e} units from the origin, the limit is {LARGEST:e}");
        Err(Error::malformed(places.at(key), message))
    };
    let within = |key: &str, reach: f64| if reach <= f64::from(LARGEST) { Ok(()) } else { fail(key, reach) };
    within("camera.to_world", offset(&file.camera.to_world).abs().max_element())?;
    for (name, camera) in &file.cameras {
        within(&format!("cameras.{name}.to_world"), offset(&camera.to_world).abs().max_element())?;
    }
    for (index, corners) in boxes(&file.shapes, meshes).enumerate() {
        let reach = corners.map_or(0.0, |[low, high]| low.abs().max(high.abs()).max_element());
        within(&format!("shapes[{index}]"), reach)?;
    }
    for (index, light) in file.lights.iter().enumerate() {
        let place = match light {
            LightFile::Point { position, .. } => DVec3::from_array(position.map(f64::from)),
            LightFile::Spot { to_world, .. } | LightFile::Projector { to_world, .. } => offset(to_world),
            LightFile::Directional { .. } | LightFile::Sun { .. } => DVec3::ZERO,
            LightFile::Constant { .. } | LightFile::Envmap { .. } | LightFile::Sky { .. } => DVec3::ZERO,
        };
        within(&format!("lights[{index}]"), place.abs().max_element())?;
    }
    Ok(())
}

/// Brings the focus of lenses to the limit where it is farther away, with a warning: what is in focus there is so at any
/// distance.
pub fn bring_focus(file: &mut SceneFile, places: &Places, warnings: &mut Vec<String>) {
    let further = file.cameras.iter_mut().map(|(name, camera)| (format!("cameras.{name}"), camera));
    for (key, camera) in std::iter::once(("camera".to_owned(), &mut file.camera)).chain(further) {
        let has_lens = camera.aperture_radius > 0.0;
        if let Some(distance) = camera.focus_distance.as_mut().filter(|distance| has_lens && **distance > LARGEST) {
            let place = places.at(&format!("{key}.focus_distance"));
            warnings.push(format!("{place}: the lens is focused {LARGEST:e} units away, not {distance:e}"));
            *distance = LARGEST;
        }
    }
}

/// Lowest and highest corner of the box around a mesh; infinite the wrong way round for one without vertices.
pub fn bounds(mesh: &Mesh) -> [DVec3; 2] {
    let fold = |[low, high]: [DVec3; 2], p: &glam::Vec3| [low.min(p.as_dvec3()), high.max(p.as_dvec3())];
    mesh.positions.iter().fold([DVec3::INFINITY, DVec3::NEG_INFINITY], fold)
}

/// Lowest and highest corner of the box around the boxes of all shapes; infinite the wrong way round where there is none.
pub fn around<M: Borrow<Mesh>>(shapes: &[ShapeFile], meshes: &BTreeMap<String, M>) -> [DVec3; 2] {
    let nothing = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    boxes(shapes, meshes).flatten().fold(nothing, |[low, high], [from, to]| [low.min(from), high.max(to)])
}

/// The box around the placed box of each shape; none for one without vertices.
fn boxes<'a, M: Borrow<Mesh>>(
    shapes: &'a [ShapeFile],
    meshes: &'a BTreeMap<String, M>,
) -> impl Iterator<Item = Option<[DVec3; 2]>> + 'a {
    let own: BTreeMap<&str, [DVec3; 2]> =
        meshes.iter().map(|(name, mesh)| (name.as_str(), bounds(mesh.borrow()))).collect();
    shapes.iter().map(move |shape| {
        let corners = match &shape.geometry {
            GeometryFile::Mesh { mesh } => own.get(mesh.as_str()).copied()?,
            GeometryFile::Sphere { center, radius } => {
                let (center, radius) = (DVec3::from_array(center.map(f64::from)), f64::from(*radius));
                [center - radius, center + radius]
            }
        };
        corners.iter().all(|corner| corner.is_finite()).then(|| placed(&shape.to_world, corners))
    })
}

fn offset(matrix: &Matrix) -> DVec3 {
    DVec3::new(f64::from(matrix[3]), f64::from(matrix[7]), f64::from(matrix[11]))
}

/// The box around a box once it is placed.
fn placed(matrix: &Matrix, [low, high]: [DVec3; 2]) -> [DVec3; 2] {
    let linear = linear(matrix);
    let size = DMat3::from_cols(linear.x_axis.abs(), linear.y_axis.abs(), linear.z_axis.abs());
    let (centre, half) = (linear * (0.5 * (low + high)) + offset(matrix), size * (0.5 * (high - low)));
    [centre - half, centre + half]
}
