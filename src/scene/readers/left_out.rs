//! Removal of shapes of which nothing can be seen, as exporters leave them behind; a warning names each with the reason.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::base::{Error, Result};
use crate::geometry::mesh::Mesh;
use crate::scene::file::{GeometryFile, Matrix, SceneFile, ShapeFile};

use super::places::Places;
use super::validate::{FLATTENS, has_inverse, linear};

/// Reasons why meshes are missing or empty, by their names.
pub type Reasons = BTreeMap<String, String>;

/// Removes from `file` the shapes whose mesh is missing from `meshes` for one of the `reasons`, and those that have no area where
/// they are placed, each with a warning. The meshes without a file or area go, too. After this, indices of shapes are no longer
/// those of `places`.
///
/// # Errors
/// [`Error::Malformed`] where a transform without inverse leaves a shape an area.
pub fn take_out(
    file: &mut SceneFile,
    meshes: &BTreeMap<String, Arc<Mesh>>,
    reasons: &Reasons,
    places: &Places,
    warnings: &mut Vec<String>,
) -> Result<()> {
    let mut kept = Vec::with_capacity(file.shapes.len());
    for (index, shape) in std::mem::take(&mut file.shapes).into_iter().enumerate() {
        let key = format!("shapes[{index}]");
        match why(&shape, &format!("{key}.to_world"), meshes, reasons, places)? {
            None => kept.push(shape),
            Some(why) => warnings.push(format!("{}: {} is left out: {why}", places.at(&key), called(&shape))),
        }
    }
    file.shapes = kept;
    file.meshes.retain(|name, _| !reasons.contains_key(name));
    Ok(())
}

/// Description of a shape in messages.
fn called(shape: &ShapeFile) -> String {
    let name = if shape.name.is_empty() { String::new() } else { format!(" \"{}\"", shape.name) };
    if shape.shines() { format!("the shape{name}, which emits light,") } else { format!("the shape{name}") }
}

/// Reason why nothing can be seen of a shape whose transform is at `key`; none where something can.
fn why(
    shape: &ShapeFile,
    key: &str,
    meshes: &BTreeMap<String, Arc<Mesh>>,
    reasons: &Reasons,
    places: &Places,
) -> Result<Option<String>> {
    let has_area = match &shape.geometry {
        GeometryFile::Mesh { mesh } => {
            if let Some(why) = reasons.get(mesh) {
                return Ok(Some(why.clone()));
            }
            has_inverse(&shape.to_world) || meshes.get(mesh).is_some_and(|mesh| keeps_area(mesh, &shape.to_world))
        }
        // Its transform scales uniformly, so one without inverse leaves a point.
        GeometryFile::Sphere { radius, .. } => *radius > 0.0 && has_inverse(&shape.to_world),
    };
    match (has_area, has_inverse(&shape.to_world)) {
        (true, true) => Ok(None),
        (true, false) => Err(Error::malformed(places.at(key), FLATTENS)),
        (false, _) => Ok(Some("it has no area where it is placed".to_owned())),
    }
}

/// Whether a triangle of `mesh` has an area where a transform without inverse places it. Relative to its edges, since the entries
/// of the matrix are rounded.
fn keeps_area(mesh: &Mesh, to_world: &Matrix) -> bool {
    const LEAST: f64 = 1e-5;
    let linear = linear(to_world);
    mesh.triangles.iter().any(|triangle| {
        let [a, b, c] = triangle.map(|i| mesh.positions[i as usize].as_dvec3());
        let (to_b, to_c) = (linear * (b - a), linear * (c - a));
        to_b.cross(to_c).length() > LEAST * (to_b.length_squared() + to_c.length_squared())
    })
}
