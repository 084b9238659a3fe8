//! Shapes that nothing can be seen of, as exporters leave them behind: taken out of the scene, with a word of which and why.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::base::{Error, Result};
use crate::geometry::mesh::Mesh;
use crate::scene::file::{GeometryFile, Matrix, SceneFile, ShapeFile};

use super::places::Places;
use super::validate::{FLATTENS, has_inverse, linear};

/// Why meshes are not there, by their names.
pub type Reasons = BTreeMap<String, String>;

/// Takes the shapes out of `file` whose mesh is none of `meshes` for one of the `reasons`, and those that have no area where they
/// are placed; each is warned of. The meshes without a file or area go, too. After this, numbers of shapes are no longer those of
/// `places`.
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

/// How a shape is spoken of.
fn called(shape: &ShapeFile) -> String {
    let name = if shape.name.is_empty() { String::new() } else { format!(" \"{}\"", shape.name) };
    match shape.emission {
        Some(_) => format!("the shape{name}, which emits light,"),
        None => format!("the shape{name}"),
    }
}

/// Why nothing can be seen of a shape whose transform is `key`.
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
