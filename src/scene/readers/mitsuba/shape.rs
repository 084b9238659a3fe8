//! Shapes and the meshes that they share.

use glam::{DMat4, DVec3};

use crate::base::Result;
use crate::scene::file::{GeometryFile, MaterialFile, Matrix, MeshFile, ShapeFile, TextureFile};
use crate::scene::readers::builtin::SEGMENTS;

use super::Reader;
use super::element::Element;
use super::object::{Object, kind};
use super::transform;

const KINDS: [&str; 8] = ["obj", "ply", "serialized", "rectangle", "cube", "sphere", "disk", "cylinder"];

impl<'a> Reader<'a> {
    pub(super) fn shape(&mut self, element: &'a Element) -> Result<()> {
        let mut known = vec!["to_world", "flip_normals"];
        known.extend(match kind(element)? {
            "obj" | "ply" => &["filename", "face_normals", "flip_tex_coords"][..],
            "serialized" => &["filename", "face_normals", "shape_index"],
            "cube" => &["face_normals"],
            "rectangle" | "disk" => &[],
            "cylinder" => &["p0", "p1", "radius"],
            "sphere" => &["center", "radius"],
            other => return Err(element.unsupported(format!("shape \"{other}\""), &KINDS)),
        });
        let object = Object::new(element, &self.ids, &known, &["bsdf", "emitter", "medium"])?;
        let index = self.file.shapes.len();
        let emission = object.single("emitter")?.map(|emitter| self.area_light(emitter)).transpose()?;
        let [interior, exterior] = self.media(element, &format!("shape {index}"), ["interior", "exterior"])?;
        let shape = ShapeFile {
            interior,
            exterior,
            name: element.attribute("id").unwrap_or_default().to_owned(),
            geometry: self.geometry(&object)?,
            to_world: placement(&object)?,
            flip_normals: object.boolean("flip_normals")?.unwrap_or(false) != mirrored_sphere(&object)?,
            material: self.material_of(&object, emission.is_some(), index)?,
            emission,
        };
        self.places.set(format!("shapes[{index}]"), element.place.clone());
        self.file.shapes.push(shape);
        Ok(())
    }

    fn geometry(&mut self, object: &Object<'a>) -> Result<GeometryFile> {
        let face_normals = object.boolean("face_normals")?.unwrap_or(false);
        let file = || object.required_string("filename").map(str::to_owned);
        let mesh = match kind(object.element)? {
            "sphere" => {
                let center = object.vector("center")?.unwrap_or([0.0; 3]).map(|x| x as f32);
                let radius = object.float("radius")?.unwrap_or(1.0) as f32;
                return Ok(GeometryFile::Sphere { center, radius });
            }
            "obj" => {
                flip_tex_coords(object, true)?;
                MeshFile::Obj { file: file()?, face_normals }
            }
            "ply" => {
                flip_tex_coords(object, false)?;
                MeshFile::Ply { file: file()?, face_normals }
            }
            "serialized" => {
                let index = object.integer("shape_index")?.unwrap_or(0);
                let invalid = |_| object.element.malformed(format!("shape_index is {index}"));
                MeshFile::Serialized { file: file()?, index: u32::try_from(index).map_err(invalid)?, face_normals }
            }
            "rectangle" => MeshFile::Rectangle,
            round @ ("disk" | "cylinder") => {
                let place = &object.element.place;
                self.warnings.push(format!("{place}: the {round} is made of {SEGMENTS} flat parts"));
                if round == "disk" { MeshFile::Disk } else { MeshFile::Cylinder }
            }
            _ => MeshFile::Cube,
        };
        let name = mesh_name(&mesh);
        // The name says all about the mesh, so shapes with the same file and options share it.
        if !self.file.meshes.contains_key(&name) {
            self.places.set(format!("meshes.{name}"), object.element.place.clone());
            self.file.meshes.insert(name.clone(), mesh);
        }
        Ok(GeometryFile::Mesh { mesh: name })
    }

    /// The name of the shape's material. Without one, Mitsuba's default: grey, or black on an emitter.
    fn material_of(&mut self, object: &Object<'a>, emits: bool, index: usize) -> Result<String> {
        let Some(element) = object.single("bsdf")? else {
            let (name, grey) = if emits { ("default emitter", 0.0) } else { ("default", 0.5) };
            let name = self.free_name(name);
            let reflectance = TextureFile::rgb([grey; 3]);
            self.file.materials.entry(name.clone()).or_insert(MaterialFile::Diffuse { reflectance });
            return Ok(name);
        };
        let name = match element.attribute("id") {
            Some(id) => id.to_owned(),
            None => self.free_name(&format!("shape {index}")),
        };
        self.add_material(name.clone(), element)?;
        Ok(name)
    }

    /// A name that no id of the document takes.
    fn free_name(&self, wanted: &str) -> String {
        let mut name = wanted.to_owned();
        while self.ids.contains_key(name.as_str()) {
            name.push('_');
        }
        name
    }
}

/// `to_world`; for a cylinder also what takes the unit one to its axis and radius.
fn placement(object: &Object) -> Result<Matrix> {
    if kind(object.element)? != "cylinder" {
        return object.to_world();
    }
    let end = |name: &str, default| Ok(DVec3::from_array(object.vector(name)?.unwrap_or(default)));
    let (p0, p1) = (end("p0", [0.0; 3])?, end("p1", [0.0, 0.0, 1.0])?);
    let radius = object.float("radius")?.unwrap_or(1.0);
    let axis = p1 - p0;
    if !(radius > 0.0 && axis.length() > 0.0) {
        return Err(object.element.malformed("a cylinder needs a length and a radius above 0"));
    }
    let (s, t) = axis.normalize().any_orthonormal_pair();
    let local = DMat4::from_cols((s * radius).extend(0.0), (t * radius).extend(0.0), axis.extend(0.0), p0.extend(1.0));
    Ok(transform::rounded(object.transform("to_world")?.unwrap_or(DMat4::IDENTITY) * local))
}

/// Mitsuba turns a sphere inside out where its transform mirrors; here the front stays the front.
fn mirrored_sphere(object: &Object) -> Result<bool> {
    let mirrors = object.transform("to_world")?.is_some_and(|matrix| matrix.determinant() < 0.0);
    Ok(mirrors && kind(object.element)? == "sphere")
}

/// Only Mitsuba's default is supported: OBJ counts v from the bottom, the others from the top.
fn flip_tex_coords(object: &Object, default: bool) -> Result<()> {
    match object.boolean("flip_tex_coords")? {
        Some(flip) if flip != default => Err(object
            .element
            .unsupported(format!("flip_tex_coords {flip}"), &[if default { "true" } else { "false" }])),
        _ => Ok(()),
    }
}

fn mesh_name(mesh: &MeshFile) -> String {
    let (base, flat) = match mesh {
        MeshFile::Obj { file, face_normals } | MeshFile::Ply { file, face_normals } => (file.clone(), *face_normals),
        MeshFile::Serialized { file, index, face_normals } => (format!("{file} {index}"), *face_normals),
        MeshFile::Rectangle => ("rectangle".to_owned(), false),
        MeshFile::Disk => ("disk".to_owned(), false),
        MeshFile::Cylinder => ("cylinder".to_owned(), false),
        _ => ("cube".to_owned(), false),
    };
    if flat { format!("{base} (face normals)") } else { base }
}
