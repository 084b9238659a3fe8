//! What the things of a scene are called.

use std::path::Path;

use super::file::{GeometryFile, MeshFile, SceneFile, ShapeFile};

/// Names of a scene's shapes and materials, none of them empty. Several shapes may have one name.
#[derive(Debug, Clone, Default)]
pub struct Names {
    /// One for each shape, in the order of the scene file.
    pub shapes: Vec<Box<str>>,
    /// One for each material, in the order of the names in the scene file.
    pub materials: Vec<Box<str>>,
}

impl Names {
    /// The names in a scene file. A shape without one is called as its mesh's file without folders and ending, as its mesh where that
    /// has no file, or else by its number: `shape 12`.
    pub fn of(file: &SceneFile) -> Self {
        let materials = file.materials.keys().enumerate();
        Self {
            shapes: file.shapes.iter().enumerate().map(|(index, shape)| name_of(index, shape, file).into()).collect(),
            materials: materials.map(|(index, name)| or_else(name, || format!("material {index}")).into()).collect(),
        }
    }
}

fn or_else(name: &str, made: impl FnOnce() -> String) -> String {
    if name.is_empty() { made() } else { name.to_owned() }
}

fn name_of(index: usize, shape: &ShapeFile, file: &SceneFile) -> String {
    let of_mesh = || {
        let GeometryFile::Mesh { mesh: name } = &shape.geometry else { return String::new() };
        let stem = |file: &str| Path::new(file).file_stem().unwrap_or_default().to_string_lossy().into_owned();
        match file.meshes.get(name) {
            Some(MeshFile::Obj { file, .. } | MeshFile::Ply { file, .. } | MeshFile::Curves { file, .. }) => stem(file),
            Some(MeshFile::Serialized { file, index, .. }) => format!("{} {index}", stem(file)),
            Some(MeshFile::Inline { .. } | MeshFile::Held { .. }) => name.clone(),
            // Every floor and wall may be one of these.
            Some(MeshFile::Rectangle {} | MeshFile::Cube {} | MeshFile::Disk {} | MeshFile::Cylinder {}) | None => {
                String::new()
            }
        }
    };
    or_else(&shape.name, || or_else(&of_mesh(), || format!("shape {index}")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::file::{CameraFile, FilmFile, FilterFile, IDENTITY};

    #[test]
    fn every_thing_has_a_name() {
        let film = FilmFile { width: 1, height: 1, filter: FilterFile::default() };
        let mut file = SceneFile::empty(String::new(), CameraFile::pinhole(IDENTITY, 40.0), film);
        let options =
            |file: &str| MeshFile::Ply { file: file.into(), face_normals: false, flip_v: false, as_given: true };
        file.meshes = [
            ("chair with options".to_owned(), options("models/chair.0.ply")),
            ("part".to_owned(), MeshFile::Held { part: "meshes[3]".into() }),
            ("square".to_owned(), MeshFile::Rectangle {}),
            ("all".to_owned(), MeshFile::Serialized { file: "m/all.serialized".into(), index: 3, face_normals: false }),
        ]
        .into();
        let shape = |name: &str, mesh: Option<&str>| ShapeFile {
            name: name.into(),
            geometry: match mesh {
                Some(mesh) => GeometryFile::Mesh { mesh: mesh.into() },
                None => GeometryFile::Sphere { center: [0.0; 3], radius: 1.0 },
            },
            to_world: IDENTITY,
            flip_normals: false,
            material: "red".into(),
            interior: None,
            exterior: None,
            emission: None,
            emission_texture: None,
            unseen: false,
        };
        file.shapes = vec![
            shape("floor", Some("square")),
            shape("", Some("chair with options")),
            shape("", Some("part")),
            shape("", Some("square")),
            shape("", Some("all")),
            shape("", None),
            shape("floor", None),
        ];
        let names = Names::of(&file);
        let shapes: Vec<&str> = names.shapes.iter().map(|name| &**name).collect();
        assert_eq!(shapes, ["floor", "chair.0", "part", "shape 3", "all 3", "shape 5", "floor"]);
    }
}
