//! What textures take from a mesh: colours of its vertices or faces. They are read from the mesh's file once more, and only where a
//! material asks for them.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;
use std::sync::Arc;

use glam::Vec3;

use crate::base::files::read_bytes;
use crate::base::{Place, Result};
use crate::geometry::mesh::Mesh;
use crate::scene::file::{GeometryFile, MaterialFile, MeshFile, SceneFile, ShapeFile, TextureFile};

use super::lines::{lines, number, words};
use super::mesh::has_area;
use super::places::Places;
use super::ply::extra::{Extra, extra};
use super::{LARGEST_MESH_FILE, path};

/// Values at the corners of each triangle of a mesh, by the names of mesh and attribute.
pub type Attributes = BTreeMap<(String, String), Vec<[Vec3; 3]>>;

/// Names of the attributes that the textures of a shape take from its mesh.
fn asked(shape: &ShapeFile, materials: &BTreeMap<String, MaterialFile>) -> BTreeSet<String> {
    let textures = materials.get(&shape.material).map(MaterialFile::textures).unwrap_or_default();
    let textures = textures.into_iter().map(|(_, texture)| texture).chain(&shape.emission_texture);
    let name = |texture: &TextureFile| match texture {
        TextureFile::Attribute { name, .. } => Some(name.clone()),
        _ => None,
    };
    textures.filter_map(name).collect()
}

/// Reads the attributes that the materials of `file` ask for. What a mesh lacks is warned of.
///
/// # Errors
/// Those of reading meshes.
pub fn load(
    file: &SceneFile,
    meshes: &BTreeMap<String, Arc<Mesh>>,
    directory: &Path,
    places: &Places,
    warnings: &mut Vec<String>,
) -> Result<Attributes> {
    let mut found = Attributes::new();
    let mut sources: BTreeMap<&str, Source> = BTreeMap::new();
    let mut lacking: BTreeSet<(&str, String)> = BTreeSet::new();
    for (index, shape) in file.shapes.iter().enumerate() {
        for name in asked(shape, &file.materials) {
            let place = places.at(&format!("shapes[{index}]"));
            let GeometryFile::Mesh { mesh } = &shape.geometry else {
                warnings.push(format!("{place}: a sphere has no \"{name}\": 0.5 is used instead"));
                continue;
            };
            let (Some(loaded), Some(source)) = (meshes.get(mesh), file.meshes.get(mesh)) else { continue };
            if found.contains_key(&(mesh.clone(), name.clone())) {
                continue;
            }
            if !sources.contains_key(mesh.as_str()) {
                sources.insert(mesh, Source::open(source, directory, &place)?);
            }
            match sources[mesh.as_str()].corners(loaded, &name) {
                Some(corners) => drop(found.insert((mesh.clone(), name), corners)),
                None => {
                    if lacking.insert((mesh, name.clone())) {
                        warnings.push(format!("{place}: the mesh has no \"{name}\": 0.5 is used instead"));
                    }
                }
            }
        }
    }
    Ok(found)
}

/// A mesh's file, with what it has beside places.
enum Source {
    Ply(Extra),
    /// Colours of an OBJ file's vertices, by the bits of their positions: vertices have other numbers there.
    Obj(HashMap<[u32; 3], Vec3>),
    None,
}

impl Source {
    fn open(mesh: &MeshFile, directory: &Path, place: &Place) -> Result<Self> {
        Ok(match mesh {
            MeshFile::Ply { file, .. } => Self::Ply(extra(&path::resolve(directory, file, place)?)?),
            MeshFile::Obj { file, .. } => {
                Self::Obj(colors(&read_bytes(&path::resolve(directory, file, place)?, LARGEST_MESH_FILE)?))
            }
            _ => Self::None,
        })
    }

    /// The values at the corners of the triangles of `mesh`, which was made of this file.
    fn corners(&self, mesh: &Mesh, name: &str) -> Option<Vec<[Vec3; 3]>> {
        match self {
            Self::None => None,
            Self::Obj(colors) => {
                let color = |vertex: u32| colors.get(&key(mesh.positions[vertex as usize])).copied();
                let corners = mesh.triangles.iter().map(|triangle| {
                    let [a, b, c] = triangle.map(color);
                    Some([a?, b?, c?])
                });
                (name == "vertex_color").then(|| corners.collect())?
            }
            Self::Ply(extra) => {
                let (values, of_faces) = extra.values(name)?;
                if !of_faces {
                    let value = |vertex: u32| values.get(vertex as usize).copied();
                    let corners = mesh.triangles.iter().map(|triangle| {
                        let [a, b, c] = triangle.map(value);
                        Some([a?, b?, c?])
                    });
                    return corners.collect();
                }
                // Triangles without area were left out of the mesh.
                let position = |vertex: u32| mesh.positions.get(vertex as usize).copied();
                let kept = extra.fans().filter(|(_, triangle)| {
                    let [a, b, c] = triangle.map(position);
                    a.zip(b).zip(c).is_some_and(|((a, b), c)| has_area([a, b, c]))
                });
                let corners: Vec<[Vec3; 3]> = kept.map(|(face, _)| [values[face]; 3]).collect();
                (corners.len() == mesh.triangles.len()).then_some(corners)
            }
        }
    }
}

fn key(position: Vec3) -> [u32; 3] {
    // 0 and −0 are the same place.
    (position + 0.0).to_array().map(f32::to_bits)
}

/// Colours of vertices of an OBJ file: three more numbers after the position, as many programs write.
fn colors(bytes: &[u8]) -> HashMap<[u32; 3], Vec3> {
    let mut colors = HashMap::new();
    for line in lines(bytes) {
        let mut words = words(line);
        if words.next() != Some(b"v") {
            continue;
        }
        let numbers: Vec<f32> = words.map_while(number).take(7).collect();
        if let [x, y, z, r, g, b] = numbers[..] {
            let color = Vec3::new(r, g, b);
            if color.is_finite() {
                colors.insert(key(Vec3::new(x, y, z)), color);
            }
        }
    }
    colors
}
