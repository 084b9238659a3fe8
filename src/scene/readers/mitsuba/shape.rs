//! Shapes and the meshes that they share.

use glam::{DMat4, DVec3, Vec3};

use crate::base::{Error, Result};
use crate::geometry::mesh::Mesh;
use crate::scene::file::{GeometryFile, MaterialFile, MeshFile, ShapeFile, TextureFile};
use crate::scene::readers::builtin::SEGMENTS;
use crate::scene::readers::frames::rounded;
use crate::scene::readers::revolved::{is_uniform, sphere_mesh};

use super::Reader;
use super::element::Element;
use super::object::{Object, kind, refuse_slip_of_kind};
use super::of_faces::Faces;

const KINDS: [&str; 13] = [
    "obj",
    "ply",
    "serialized",
    "rectangle",
    "cube",
    "sphere",
    "disk",
    "cylinder",
    "linearcurve",
    "bsplinecurve",
    "shapegroup",
    "instance",
    "merge",
];

/// Most shapes of a scene: a short document with groups and instances must not grow without bound.
const MOST_SHAPES: usize = 1 << 20;

impl<'a> Reader<'a> {
    pub(super) fn shape(&mut self, element: &'a Element) -> Result<()> {
        self.met += 1;
        if self.met > MOST_SHAPES {
            return Err(too_many(element, self.met));
        }
        match kind(element)? {
            // Seen only through its instances.
            "shapegroup" => self.group(element).map(drop),
            "instance" => self.instance(element),
            // Shapes that Mitsuba may put into one mesh.
            "merge" => {
                let members = Object::new(element, &self.ids, &[], &["shape"])?.nested;
                members.into_iter().try_for_each(|member| self.nested(member, |reader| reader.shape(member)))
            }
            _ => self.place(element, None),
        }
    }

    /// The shapes of a group.
    fn group(&self, element: &'a Element) -> Result<Vec<&'a Element>> {
        let members = Object::new(element, &self.ids, &[], &["shape"])?.nested;
        for member in &members {
            if let "shapegroup" | "instance" = kind(member)? {
                return Err(member.unsupported(format!("a {} inside a shapegroup", kind(member)?), &KINDS[..10]));
            }
            let emits = |child: &Element| {
                let target = child.attribute("id").and_then(|id| self.ids.get(id)).unwrap_or(child);
                target.tag == "emitter"
            };
            if member.children.iter().any(emits) {
                return Err(member.unsupported("a shape that emits inside a shapegroup", &["shapes without emitter"]));
            }
        }
        Ok(members)
    }

    /// Adds every shape of a group once more: its own transform acts first.
    fn instance(&mut self, element: &'a Element) -> Result<()> {
        let object = Object::new(element, &self.ids, &["to_world"], &["shape"])?;
        let group = object.single("shape")?.filter(|group| kind(group).is_ok_and(|kind| kind == "shapegroup"));
        let group = group.ok_or_else(|| element.malformed("an instance needs a reference to a shapegroup"))?;
        let outer = object.transform("to_world")?.unwrap_or(DMat4::IDENTITY);
        self.group(group)?.into_iter().try_for_each(|member| self.place(member, Some((element, outer))))
    }

    /// Adds a shape, or one of an instance whose transform acts after its own.
    fn place(&mut self, element: &'a Element, instance: Option<(&'a Element, DMat4)>) -> Result<()> {
        let mut known = vec!["to_world", "flip_normals"];
        known.extend(match kind(element)? {
            "obj" | "ply" => &["filename", "face_normals", "flip_tex_coords", "max_smooth_angle"][..],
            "serialized" => &["filename", "face_normals", "shape_index"],
            "linearcurve" | "bsplinecurve" => &["filename"],
            "cube" => &["face_normals"],
            "rectangle" | "disk" => &[],
            "cylinder" => &["p0", "p1", "radius"],
            "sphere" => &["center", "radius"],
            other => {
                refuse_slip_of_kind(element, &KINDS)?;
                self.warn(element, format_args!("the shape \"{other}\" is not known: it is left out"));
                return Ok(());
            }
        });
        let object = Object::new(element, &self.ids, &known, &["bsdf", "emitter", "medium"])?;
        let index = self.file.shapes.len();
        if index >= MOST_SHAPES {
            return Err(too_many(element, index + 1));
        }
        if object.property("max_smooth_angle").is_some() {
            self.warn(element, "max_smooth_angle is left out: normals are smooth, or flat with face_normals");
        }
        let outer = instance.map_or(DMat4::IDENTITY, |(_, outer)| outer);
        let emission = object.single("emitter")?.map_or(Ok(None), |emitter| self.area_light(emitter))?;
        let [interior, exterior] = self.media(element, &format!("shape {index}"), ["interior", "exterior"])?;
        let placed = outer * placement(&object)?;
        let (to_world, name) = (rounded(placed), element.attribute("id").unwrap_or_default().to_owned());
        let is_sphere = kind(element)? == "sphere";
        let is_uneven = is_sphere && !is_uniform(&placed);
        // Mitsuba turns mirrored spheres inside out; here the front of a sphere stays the front, and that of its mesh does not.
        let is_mirrored = is_sphere && !is_uneven && placed.determinant() < 0.0;
        let flip_normals = object.boolean("flip_normals")?.unwrap_or(false) != is_mirrored;
        let place = instance.map_or(element, |(instance, _)| instance).place.clone();
        for Faces { of, material } in self.faces(&object)? {
            let index = self.file.shapes.len();
            if index >= MOST_SHAPES {
                return Err(too_many(element, index + 1));
            }
            let shape = ShapeFile {
                interior: interior.clone(),
                exterior: exterior.clone(),
                name: name.clone(),
                geometry: self.geometry(&object, of, is_uneven)?,
                to_world,
                flip_normals,
                material: self.material_of(&object, material, emission.is_some(), index)?,
                emission: emission.as_ref().map(|(radiance, _)| *radiance),
                emission_texture: emission.as_ref().and_then(|(_, texture)| texture.clone()),
                unseen: false,
            };
            self.places.set(format!("shapes[{index}]"), place.clone());
            self.file.shapes.push(shape);
        }
        Ok(())
    }

    /// The geometry of a shape; of an OBJ file the faces of some `materials`, or all; a sphere that is scaled unevenly as a mesh.
    fn geometry(&mut self, object: &Object<'a>, materials: Vec<String>, is_uneven: bool) -> Result<GeometryFile> {
        let face_normals = object.boolean("face_normals")?.unwrap_or(false);
        let file = || object.required_string("filename").map(|file| self.located(file));
        let mesh = match kind(object.element)? {
            "sphere" => {
                let center = object.vector("center")?.unwrap_or([0.0; 3]).map(|x| x as f32);
                let radius = object.float("radius")?.unwrap_or(1.0) as f32;
                if !is_uneven {
                    return Ok(GeometryFile::Sphere { center, radius });
                }
                self.warn(
                    object.element,
                    format_args!("a sphere that is scaled unevenly is made of {SEGMENTS} flat parts around"),
                );
                let part = format!("sphere of radius {radius} at {center:?}");
                let sphere = || placed_sphere(radius, center.into());
                self.held.meshes.entry(part.clone()).or_insert_with(sphere);
                MeshFile::Held { part }
            }
            "obj" => {
                let flip_v = !object.boolean("flip_tex_coords")?.unwrap_or(true);
                MeshFile::Obj { file: file()?, face_normals, flip_v, materials }
            }
            "ply" => {
                let flip_v = object.boolean("flip_tex_coords")?.unwrap_or(false);
                MeshFile::Ply { file: file()?, face_normals, flip_v, as_given: false }
            }
            "serialized" => {
                let index = object.integer("shape_index")?.unwrap_or(0);
                let invalid = |_| object.element.malformed(format!("shape_index is {index}"));
                MeshFile::Serialized { file: file()?, index: u32::try_from(index).map_err(invalid)?, face_normals }
            }
            curve @ ("linearcurve" | "bsplinecurve") => {
                let file = file()?;
                self.warnings.push(format!("{}: curves are tubes with flat sides", object.element.place));
                // Placing a curve does not change how thick it is.
                let placed = object.transform("to_world")?.unwrap_or(DMat4::IDENTITY);
                let scale = placed.determinant().abs().cbrt();
                let wider = if scale > 0.0 { scale.recip() as f32 } else { 1.0 };
                MeshFile::Curves { file, straight: curve == "linearcurve", wider }
            }
            "rectangle" => MeshFile::Rectangle {},
            round @ ("disk" | "cylinder") => {
                let place = &object.element.place;
                self.warnings.push(format!("{place}: the {round} is made of {SEGMENTS} flat parts"));
                if round == "disk" { MeshFile::Disk {} } else { MeshFile::Cylinder {} }
            }
            _ => MeshFile::Cube {},
        };
        let name = mesh_name(&mesh);
        // The name holds the mesh's file and options, so shapes with the same ones share it.
        if !self.file.meshes.contains_key(&name) {
            self.places.set(format!("meshes.{name}"), object.element.place.clone());
            self.file.meshes.insert(name.clone(), mesh);
        }
        Ok(GeometryFile::Mesh { mesh: name })
    }

    /// The name of a shape's material. Without one, Mitsuba's default: grey, or black on an emitter.
    fn material_of(
        &mut self,
        object: &Object<'a>,
        element: Option<&'a Element>,
        emits: bool,
        index: usize,
    ) -> Result<String> {
        let Some(element) = element else {
            let (name, grey) = if emits { ("default emitter", 0.0) } else { ("default", 0.5) };
            return Ok(self.plain(name, grey));
        };
        let name = match element.attribute("id") {
            Some(id) => id.to_owned(),
            // The instances of a group share its materials.
            None => match self.unnamed.get(&std::ptr::from_ref(element)) {
                Some(name) => name.clone(),
                None => self.free_name(&format!("shape {index}")),
            },
        };
        self.unnamed.insert(element, name.clone());
        self.add_material(name.clone(), element)?;
        if emits && matches!(self.file.materials[&name].innermost(), MaterialFile::Null {}) {
            self.warn(object.element, "what emits light lets none through: its \"null\" material is read as black");
            return Ok(self.plain("default emitter", 0.0));
        }
        Ok(name)
    }

    /// The name of a diffuse material of this grey, which is added if it is not there.
    fn plain(&mut self, name: &str, grey: f32) -> String {
        let name = self.free_name(name);
        let reflectance = TextureFile::rgb([grey; 3]);
        self.file.materials.entry(name.clone()).or_insert(MaterialFile::Diffuse { reflectance });
        name
    }

    /// A name that no id of the document takes.
    pub(super) fn free_name(&self, wanted: &str) -> String {
        let mut name = wanted.to_owned();
        while self.ids.get(&name).is_some() {
            name.push('_');
        }
        name
    }
}

fn too_many(element: &Element, count: usize) -> Error {
    let (place, what) = (element.place.clone(), "number of shapes".to_owned());
    Error::Limit { place, what, value: count as u64, limit: MOST_SHAPES as u64 }
}

/// `to_world`; for a cylinder after the transform of the unit cylinder to its axis and radius.
fn placement(object: &Object) -> Result<DMat4> {
    let to_world = object.transform("to_world")?.unwrap_or(DMat4::IDENTITY);
    if kind(object.element)? != "cylinder" {
        return Ok(to_world);
    }
    let end = |name: &str, default| Ok(DVec3::from_array(object.vector(name)?.unwrap_or(default)));
    let (p0, p1) = (end("p0", [0.0; 3])?, end("p1", [0.0, 0.0, 1.0])?);
    let radius = object.float("radius")?.unwrap_or(1.0);
    let axis = p1 - p0;
    if radius < 0.0 {
        return Err(object.element.malformed(format!("the radius is {radius}, expected at least 0")));
    }
    // Without length or radius this flattens space: the shape is left out later.
    let (s, t) = axis.normalize_or(DVec3::Z).any_orthonormal_pair();
    let local = DMat4::from_cols((s * radius).extend(0.0), (t * radius).extend(0.0), axis.extend(0.0), p0.extend(1.0));
    Ok(to_world * local)
}

/// A sphere as a mesh, with the texture coordinates of a sphere.
fn placed_sphere(radius: f32, center: Vec3) -> Mesh {
    let mut mesh = sphere_mesh(f64::from(radius));
    mesh.positions.iter_mut().for_each(|position| *position += center);
    mesh.uvs.iter_mut().for_each(|uv| uv.y = 1.0 - uv.y);
    mesh
}

fn mesh_name(mesh: &MeshFile) -> String {
    let flipped = |file: &String, flip_v: bool| if flip_v { format!("{file} (v flipped)") } else { file.clone() };
    let (base, flat) = match mesh {
        MeshFile::Obj { file, face_normals, flip_v, materials } => {
            let of = if materials.is_empty() { String::new() } else { format!(" of {materials:?}") };
            (flipped(file, *flip_v) + &of, *face_normals)
        }
        MeshFile::Ply { file, face_normals, flip_v, .. } => (flipped(file, *flip_v), *face_normals),
        MeshFile::Serialized { file, index, face_normals } => (format!("{file} {index}"), *face_normals),
        MeshFile::Curves { file, straight, wider } => {
            let form = if *straight { " (straight)" } else { "" };
            (if *wider == 1.0 { format!("{file}{form}") } else { format!("{file}{form} {wider} times as wide") }, false)
        }
        MeshFile::Rectangle {} => ("rectangle".to_owned(), false),
        MeshFile::Held { part } => (part.clone(), false),
        MeshFile::Disk {} => ("disk".to_owned(), false),
        MeshFile::Cylinder {} => ("cylinder".to_owned(), false),
        _ => ("cube".to_owned(), false),
    };
    if flat { format!("{base} (face normals)") } else { base }
}
