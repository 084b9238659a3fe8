//! Shapes, alone and as parts of objects.

use std::f64::consts::PI;

use glam::{DMat4, DVec3, Vec3};

use crate::base::{Error, Place, Result};
use crate::geometry::mesh::Mesh;
use crate::scene::file::{GeometryFile, MeshFile, ShapeFile, TextureFile};
use crate::scene::readers::frames::rounded;
use crate::scene::readers::revolved::{is_uniform, sphere_mesh};
use crate::scene::readers::sheets::{self, GAP};
use crate::scene::readers::{mesh, missing};

use super::Reader;
use super::finish::Masked;
use super::meshes;
use super::parameters::Parameters;
use super::round;
use super::state::AreaLight;
use super::textures::{Values, within};

/// Most shapes of a scene, those of objects too: a short document with instances must not grow without bound.
const MOST_SHAPES: usize = 1 << 20;

/// Shapes that have no near relation.
const LEFT_OUT: [&str; 2] = ["heightfield", "nurbs"];

/// A shape, or a part of an object.
#[derive(Debug, Clone)]
pub struct Piece {
    geometry: GeometryFile,
    to_world: DMat4,
    flip: bool,
    material: String,
    media: [Option<String>; 2],
    emission: Option<[f32; 3]>,
    picture: Option<TextureFile>,
    unseen: bool,
    place: Place,
}

impl Reader {
    /// A shape.
    pub(super) fn shape(&mut self, kind: &str, parameters: &Parameters) -> Result<()> {
        if LEFT_OUT.contains(&kind) {
            self.warn(&parameters.place, format!("a shape \"{kind}\" is left out"));
            parameters.ignore_all();
            return Ok(());
        }
        if kind == "curve" {
            return self.curve(parameters);
        }
        let opacity = self.opacity(parameters)?;
        // Holes that leave nothing of a lamp take it out of sight, not its light: so pbrt has it.
        let unseen = self.state.light.is_some() && opacity == Some(TextureFile::rgb([0.0; 3]));
        let material = self.masked_material(opacity.filter(|_| !unseen), parameters);
        let mut pieces = self.geometry(kind, parameters)?;
        let light = self.state.light.clone();
        if light.as_ref().is_some_and(|light| light.two_sided) {
            pieces = self.on_both_sides(pieces, parameters)?;
        }
        let media = self.state.media.clone();
        let media = if media[0] == media[1] { [None, None] } else { media.map(|name| self.medium_name(&name)) };
        for (geometry, to_world, flip) in pieces {
            let piece = Piece {
                geometry,
                to_world,
                flip: flip != self.state.reversed,
                material: material.clone(),
                media: media.clone(),
                emission: None,
                picture: light.as_ref().and_then(|light| light.picture.clone()),
                unseen,
                place: parameters.place.clone(),
            };
            self.add_piece(piece, light.as_ref().map(|light| light.radiance), parameters)?;
        }
        Ok(())
    }

    /// Adds a piece to the scene, or to the object that is being defined.
    fn add_piece(&mut self, piece: Piece, radiance: Option<[f32; 3]>, parameters: &Parameters) -> Result<()> {
        let factor = self.power_factor(&piece, parameters)?;
        let emission = radiance.map(|radiance| radiance.map(|channel| channel * factor));
        self.keep(Piece { emission, ..piece }, self.object.clone())
    }

    /// Adds a piece to the scene or to an object.
    fn keep(&mut self, piece: Piece, object: Option<String>) -> Result<()> {
        let Some(object) = object else { return self.put(&piece, None) };
        let pieces = self.objects.entry(object).or_default();
        limit(pieces.len(), &piece.place)?;
        pieces.push(piece);
        Ok(())
    }

    /// Adds a surface that emits nothing and borders on no medium to the scene, or to an object.
    pub(super) fn add_plain(
        &mut self,
        geometry: GeometryFile,
        to_world: DMat4,
        flip: bool,
        material: String,
        object: Option<String>,
        place: Place,
    ) -> Result<()> {
        let media = [None, None];
        let piece =
            Piece { geometry, to_world, flip, material, media, emission: None, picture: None, unseen: false, place };
        self.keep(piece, object)
    }

    /// Factor that gives a light its power, if it has one.
    fn power_factor(&self, piece: &Piece, parameters: &Parameters) -> Result<f32> {
        let Some(AreaLight { power: Some(power), two_sided, .. }) = &self.state.light else { return Ok(1.0) };
        let area = match &piece.geometry {
            GeometryFile::Sphere { radius, .. } => {
                let scale = piece.to_world.transform_vector3(DVec3::X).length_squared();
                // The other half of a light on both sides is a sphere of its own.
                4.0 * PI * f64::from(*radius).powi(2) * scale * if *two_sided { 2.0 } else { 1.0 }
            }
            // Meshes of lights on both sides have both of them.
            GeometryFile::Mesh { mesh } => match self.loaded(mesh, parameters)? {
                Some(mesh) => area(&mesh, &piece.to_world),
                None => return Ok(1.0),
            },
        };
        Ok(if area > 0.0 { (power / (PI * area)) as f32 } else { 0.0 })
    }

    /// A mesh in memory; none if its file is missing.
    fn loaded(&self, name: &str, parameters: &Parameters) -> Result<Option<Mesh>> {
        let file = &self.file.meshes[name];
        if let MeshFile::Ply { file, .. } = file
            && missing::is_absent(&self.folder, file)
        {
            return Ok(None);
        }
        let held = self.held.meshes.get(name).cloned();
        mesh::load(file, held, &self.folder, &parameters.place).map(|cleaned| Some(cleaned.mesh))
    }

    /// The geometry of a shape, placed, and whether it is turned inside out.
    fn geometry(&mut self, kind: &str, parameters: &Parameters) -> Result<Vec<(GeometryFile, DMat4, bool)>> {
        let now = self.state.transform;
        let mesh = match kind {
            "sphere" => match round::whole_sphere(parameters)? {
                (true, radius) if is_uniform(&now) => {
                    let geometry = GeometryFile::Sphere { center: [0.0; 3], radius: radius as f32 };
                    return Ok(vec![(geometry, now * upside_down(), false)]);
                }
                _ => round::mesh(kind, parameters)?,
            },
            _ if round::KINDS.contains(&kind) => round::mesh(kind, parameters)?,
            "trianglemesh" => meshes::triangles(parameters)?,
            "loopsubdiv" => {
                self.warn(&parameters.place, "a loopsubdiv is read as its control mesh with smooth normals");
                meshes::control(parameters)?
            }
            "bilinearmesh" => {
                let (mesh, flat) = meshes::patches(parameters)?;
                if !flat {
                    self.warn(&parameters.place, "bilinear patches that are not flat are read as two triangles each");
                }
                mesh
            }
            "plymesh" => {
                let name = parameters.string("filename")?;
                let file = self.locate(name.ok_or_else(|| parameters.malformed("a plymesh needs a filename"))?);
                if parameters.find("displacement").is_some() {
                    self.warn(&parameters.place, "the displacement of a mesh is left out");
                    parameters.ignore(&["displacement.edgelength", "edgelength", "displacement.uvscale", "uvscale"]);
                }
                let ply = MeshFile::Ply { file: file.clone(), face_normals: false, flip_v: false, as_given: true };
                return Ok(vec![(self.add_file(&file, ply, &parameters.place), now, false)]);
            }
            other => {
                let known = "sphere, disk, cylinder, cone, paraboloid, hyperboloid, trianglemesh, plymesh, bilinearmesh, loopsubdiv, curve";
                let (place, what) = (parameters.place.clone(), format!("the shape \"{other}\""));
                return Err(Error::Unsupported { place, what, supported: known.to_owned() });
            }
        };
        Ok(vec![(self.hold(kind, mesh, &parameters.place), now, false)])
    }

    /// Adds a mesh of the document under a new name.
    pub(super) fn hold(&mut self, kind: &str, mesh: Mesh, place: &Place) -> GeometryFile {
        let name = self.free_name(kind, |reader, name| reader.file.meshes.contains_key(name));
        self.held.meshes.insert(name.clone(), mesh);
        self.add_file(&name, MeshFile::Held { part: name.clone() }, place)
    }

    /// Adds a mesh by its own name, unless it is there already.
    fn add_file(&mut self, name: &str, file: MeshFile, place: &Place) -> GeometryFile {
        if !self.file.meshes.contains_key(name) {
            self.places.set(format!("meshes.{name}"), place.clone());
            self.file.meshes.insert(name.to_owned(), file);
        }
        GeometryFile::Mesh { mesh: name.to_owned() }
    }

    /// The pieces of a light both of whose sides shine: two sheets back to back.
    fn on_both_sides(
        &mut self,
        pieces: Vec<(GeometryFile, DMat4, bool)>,
        parameters: &Parameters,
    ) -> Result<Vec<(GeometryFile, DMat4, bool)>> {
        self.warn(&parameters.place, "a light that shines on both sides is made of two sheets, back to back");
        let mut out = Vec::new();
        for (geometry, to_world, flip) in pieces {
            match geometry {
                GeometryFile::Sphere { center, radius } => {
                    let inner = GeometryFile::Sphere { center, radius: radius * (1.0 - GAP as f32) };
                    out.extend([(GeometryFile::Sphere { center, radius }, to_world, flip), (inner, to_world, !flip)]);
                }
                GeometryFile::Mesh { mesh } => match self.loaded(&mesh, parameters)? {
                    Some(loaded) => {
                        let sheets = sheets::sheets(&loaded);
                        out.push((self.hold("sheets", sheets, &parameters.place), to_world, flip));
                    }
                    None => out.push((GeometryFile::Mesh { mesh }, to_world, flip)),
                },
            }
        }
        Ok(out)
    }

    /// The opacity of a shape that has holes.
    pub(super) fn opacity(&mut self, parameters: &Parameters) -> Result<Option<TextureFile>> {
        if parameters.find("shadowalpha").is_some() {
            self.warn(&parameters.place, "shadowalpha is left out: shadows have the holes of what casts them");
        }
        let mut opacity = self.texture(parameters, "alpha", Values::Floats)?.map(within);
        if self.old
            && let Some(given) = opacity
        {
            // v3 cuts out what has no alpha at all.
            let cut = |alpha: Vec3| if alpha == Vec3::ZERO { Vec3::ZERO } else { Vec3::ONE };
            opacity = Some(self.changed(given, "cut out", &parameters.place, cut)?);
        }
        Ok(opacity.filter(|opacity| *opacity != TextureFile::rgb([1.0; 3])))
    }

    /// The name of the current material, with holes where there is an `opacity`.
    pub(super) fn masked_material(&mut self, opacity: Option<TextureFile>, parameters: &Parameters) -> String {
        let base = self.state.material.clone();
        let Some(opacity) = opacity else { return base };
        if let Some(same) = self.masked.iter().find(|masked| masked.base == base && masked.opacity == opacity) {
            return same.name.clone();
        }
        let taken = |reader: &Self, name: &str| {
            reader.file.materials.contains_key(name) || reader.masked.iter().any(|masked| masked.name == name)
        };
        let name = self.free_name(&format!("{base} with holes"), taken);
        self.masked.push(Masked { name: name.clone(), base, opacity, place: parameters.place.clone() });
        name
    }

    /// Adds the shapes of an object.
    pub(super) fn instance(&mut self, name: &str, place: &Place) -> Result<()> {
        if let Some(object) = &self.object {
            let message = format!("an instance inside the object \"{object}\"");
            return Err(Error::malformed(place.clone(), message));
        }
        self.add_strands()?;
        let missing = || Error::malformed(place.clone(), format!("there is no object \"{name}\" yet"));
        let pieces = self.objects.remove(name).ok_or_else(missing)?;
        let outer = self.state.transform;
        let result = pieces.iter().try_for_each(|piece| self.put(piece, Some((name, outer, place))));
        self.objects.insert(name.to_owned(), pieces);
        result
    }

    /// Adds a shape to the scene, after an instance's transform and under the name of its object.
    fn put(&mut self, piece: &Piece, instance: Option<(&str, DMat4, &Place)>) -> Result<()> {
        let (object, outer, place) = instance.unwrap_or(("", DMat4::IDENTITY, &piece.place));
        limit(self.file.shapes.len(), place)?;
        let mut to_world = outer * piece.to_world;
        let geometry = match &piece.geometry {
            GeometryFile::Sphere { radius, .. } if !is_uniform(&to_world) => {
                to_world *= upside_down();
                let name = format!("sphere of radius {radius}");
                if !self.file.meshes.contains_key(&name) {
                    self.held.meshes.insert(name.clone(), sphere_mesh(f64::from(*radius)));
                }
                self.add_file(&name, MeshFile::Held { part: name.clone() }, &piece.place)
            }
            geometry => geometry.clone(),
        };
        let [interior, exterior] = piece.media.clone();
        self.places.set(format!("shapes[{}]", self.file.shapes.len()), place.clone());
        self.file.shapes.push(ShapeFile {
            name: object.to_owned(),
            geometry,
            to_world: rounded(to_world),
            flip_normals: piece.flip,
            material: piece.material.clone(),
            interior,
            exterior,
            emission: piece.emission,
            emission_texture: piece.emission.and(piece.picture.clone()),
            unseen: piece.unseen,
        });
        Ok(())
    }
}

/// pbrt's texture coordinates of a sphere begin at its lowest point, ours at the highest.
fn upside_down() -> DMat4 {
    DMat4::from_scale(DVec3::new(1.0, 1.0, -1.0))
}

fn limit(shapes: usize, place: &Place) -> Result<()> {
    if shapes < MOST_SHAPES {
        return Ok(());
    }
    let (place, what) = (place.clone(), "number of shapes".to_owned());
    Err(Error::Limit { place, what, value: shapes as u64 + 1, limit: MOST_SHAPES as u64 })
}

/// Area of a mesh where it is placed.
fn area(mesh: &Mesh, to_world: &DMat4) -> f64 {
    let corner = |i: u32| to_world.transform_point3(mesh.positions[i as usize].as_dvec3());
    let of = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(corner);
        0.5 * (b - a).cross(c - a).length()
    };
    mesh.triangles.iter().map(of).sum()
}
