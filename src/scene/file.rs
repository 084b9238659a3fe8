//! The scene file: one JSON document, and at the same time the model that every other reader translates to.
//!
//! Lengths are in scene units, angles in degrees, colours in linear RGB. Matrices are 4×4, row by row, and act on column
//! vectors. Unknown keys are errors.

mod light;
mod material;
mod volume;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

pub use light::{LightFile, ProfileFile};
pub use material::{
    ASPECTS, Distribution, Filter, MaterialFile, PrincipledFile, PrincipledThinFile, TextureFile, Wrap, burley_axes,
    identity3,
};
pub use volume::{GridFile, GridMediumFile, MediumFile};

/// The only format version so far.
pub const VERSION: u32 = 1;

/// A 4×4 matrix, row by row.
pub type Matrix = [f32; 16];

/// The matrix that changes nothing.
pub const IDENTITY: Matrix = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.];

/// Name of the default camera where it has no other.
pub const DEFAULT_CAMERA: &str = "default";

fn default_camera() -> String {
    DEFAULT_CAMERA.into()
}

fn is_default_camera(name: &str) -> bool {
    name == DEFAULT_CAMERA
}

fn identity() -> Matrix {
    IDENTITY
}

fn is_identity(matrix: &Matrix) -> bool {
    *matrix == IDENTITY
}

fn one() -> f32 {
    1.0
}

fn is_one(value: &f32) -> bool {
    *value == 1.0
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// A whole scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// Format version, [`VERSION`].
    pub version: u32,
    /// A name for reports; may be empty.
    #[serde(default, skip_serializing_if = "is_default")]
    pub name: String,
    /// The camera that is rendered where no other is asked for.
    pub camera: CameraFile,
    /// Its name; [`DEFAULT_CAMERA`] where it is not given.
    #[serde(default = "default_camera", skip_serializing_if = "is_default_camera")]
    pub camera_name: String,
    /// Further cameras by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub cameras: BTreeMap<String, CameraFile>,
    /// The picture.
    pub film: FilmFile,
    /// Rendering defaults, which the command line overrides.
    #[serde(default)]
    pub render: RenderFile,
    /// Materials by name.
    #[serde(default)]
    pub materials: BTreeMap<String, MaterialFile>,
    /// Participating media by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub media: BTreeMap<String, MediumFile>,
    /// Meshes by name; several shapes may use one.
    #[serde(default)]
    pub meshes: BTreeMap<String, MeshFile>,
    /// Surfaces.
    #[serde(default)]
    pub shapes: Vec<ShapeFile>,
    /// Lights other than emitting shapes.
    #[serde(default)]
    pub lights: Vec<LightFile>,
}

impl SceneFile {
    /// A scene with nothing in it.
    pub fn empty(name: String, camera: CameraFile, film: FilmFile) -> Self {
        Self {
            version: VERSION,
            name,
            camera,
            camera_name: default_camera(),
            cameras: BTreeMap::new(),
            film,
            render: RenderFile::default(),
            materials: BTreeMap::new(),
            media: BTreeMap::new(),
            meshes: BTreeMap::new(),
            shapes: Vec::new(),
            lights: Vec::new(),
        }
    }

    /// All cameras with their names: the default one, then the others in the order of their names.
    pub fn views(&self) -> impl Iterator<Item = (&str, &CameraFile)> {
        let further = self.cameras.iter().map(|(name, camera)| (name.as_str(), camera));
        std::iter::once((self.camera_name.as_str(), &self.camera)).chain(further)
    }

    /// All cameras, in the same order.
    pub fn views_mut(&mut self) -> impl Iterator<Item = &mut CameraFile> {
        std::iter::once(&mut self.camera).chain(self.cameras.values_mut())
    }
}

/// A perspective camera: it sits at the origin of `to_world` and looks along +z, +y up, +x to the left of the picture
/// (Mitsuba's convention).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraFile {
    /// Camera to world.
    pub to_world: Matrix,
    /// Horizontal field of view in degrees, in (0, 180); says nothing of an orthographic camera.
    #[serde(default, skip_serializing_if = "is_default")]
    pub fov: f32,
    /// Width of what an orthographic camera shows, in its own units; none for perspective.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub orthographic_width: Option<f32>,
    /// Radius of a thin lens; 0 is a pinhole.
    #[serde(default, skip_serializing_if = "is_default")]
    pub aperture_radius: f32,
    /// Distance of the plane in focus along the viewing axis; needed where `aperture_radius` is not 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub focus_distance: Option<f32>,
    /// Name of the medium that the camera is in; none is empty space.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub medium: Option<String>,
    /// Offset of the picture's middle from the viewing axis, in parts of its width (to the right) and height (down).
    #[serde(default, skip_serializing_if = "is_default")]
    pub principal_point_offset: [f32; 2],
    /// Distance along the viewing axis that nothing nearer is seen than.
    #[serde(default, skip_serializing_if = "is_default")]
    pub near_clip: f32,
    /// Columns and rows of the picture of a further camera; none where it is as large as `film` says.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<[u32; 2]>,
}

impl CameraFile {
    /// A camera without lens, in empty space.
    pub fn pinhole(to_world: Matrix, fov: f32) -> Self {
        Self {
            to_world,
            fov,
            orthographic_width: None,
            aperture_radius: 0.0,
            focus_distance: None,
            medium: None,
            principal_point_offset: [0.0; 2],
            near_clip: 0.0,
            size: None,
        }
    }
}

/// The picture: its size in pixels and its pixel filter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilmFile {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The pixel filter.
    #[serde(default, skip_serializing_if = "is_default")]
    pub filter: FilterFile,
}

/// The pixel filter: how much light counts for a pixel by its offset from the pixel's centre along each axis. Lengths are in
/// pixels; beyond the radius nothing counts. Every filter has the integral 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum FilterFile {
    /// Weighs all light equally; with a radius of 0.5 the mean over the pixel.
    Box {
        /// Half the filter's width.
        #[serde(default = "half")]
        radius: f32,
    },
    /// Falls off linearly.
    Tent {
        /// Half the filter's width.
        #[serde(default = "one")]
        radius: f32,
    },
    /// A Gaussian, lowered so that it ends in 0 at the radius.
    Gaussian {
        /// Standard deviation before the cut.
        #[serde(default = "half")]
        stddev: f32,
        /// Half the filter's width; 4 standard deviations where it is not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        radius: Option<f32>,
    },
    /// The window of four cosine terms (Harris 1978): like a Gaussian, smooth where it ends.
    BlackmanHarris {
        /// Half the filter's width.
        #[serde(default = "blackman_harris_radius")]
        radius: f32,
    },
}

fn half() -> f32 {
    0.5
}

fn blackman_harris_radius() -> f32 {
    1.5
}

impl Default for FilterFile {
    fn default() -> Self {
        Self::Box { radius: half() }
    }
}

impl FilterFile {
    /// Largest radius and largest standard deviation, pixels.
    pub const MOST: f32 = 64.0;
    /// The tent of Mitsuba and others.
    pub const TENT: Self = Self::Tent { radius: 1.0 };
    /// The Gaussian of Mitsuba and others.
    pub const GAUSSIAN: Self = Self::Gaussian { stddev: 0.5, radius: None };
    /// About as wide as [`Self::GAUSSIAN`].
    pub const BLACKMAN_HARRIS: Self = Self::BlackmanHarris { radius: 1.5 };

    /// Name on the command line and in headers.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Box { .. } => "box",
            Self::Tent { .. } => "tent",
            Self::Gaussian { .. } => "gaussian",
            Self::BlackmanHarris { .. } => "blackman-harris",
        }
    }

    /// Half the filter's width, pixels.
    pub fn radius(&self) -> f32 {
        match *self {
            Self::Box { radius } | Self::Tent { radius } | Self::BlackmanHarris { radius } => radius,
            Self::Gaussian { stddev, radius } => radius.unwrap_or(4.0 * stddev),
        }
    }
}

/// Rendering defaults.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RenderFile {
    /// 1 = emission only, 2 = direct light, n = n-1 bounces.
    pub max_depth: u32,
    /// Samples per pixel, camera and light paths together.
    pub spp: u32,
    /// Whether the camera sees what lies behind shapes that emit light, and no light infinitely far away.
    #[serde(skip_serializing_if = "is_default")]
    pub hide_emitters: bool,
}

impl Default for RenderFile {
    fn default() -> Self {
        Self { max_depth: 20, spp: 64, hide_emitters: false }
    }
}

/// The source of a mesh. Variants without fields have braces: serde would let unit variants have any key.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum MeshFile {
    /// A Wavefront OBJ file, all its groups together, or the faces of some materials. v is turned around, since OBJ counts it from a picture's bottom.
    Obj {
        /// Path relative to the scene file.
        file: String,
        /// Shade every face flat. Otherwise a file without vertex normals gets smooth ones.
        #[serde(default, skip_serializing_if = "is_default")]
        face_normals: bool,
        /// Use 1 − v in place of v.
        #[serde(default, skip_serializing_if = "is_default")]
        flip_v: bool,
        /// Materials (`usemtl`) whose faces it has; "" is that of faces before any. All faces where there are none.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        materials: Vec<String>,
    },
    /// A PLY file, text or binary, which gzip may have packed.
    Ply {
        /// Path relative to the scene file.
        file: String,
        /// Shade every face flat. Otherwise a file without vertex normals gets smooth ones.
        #[serde(default, skip_serializing_if = "is_default")]
        face_normals: bool,
        /// Use 1 − v in place of v.
        #[serde(default, skip_serializing_if = "is_default")]
        flip_v: bool,
        /// Take normals as pbrt does: without vertex normals faces are flat, with them every face is turned to their side.
        #[serde(default, skip_serializing_if = "is_default")]
        as_given: bool,
    },
    /// One shape of a Mitsuba `.serialized` file.
    Serialized {
        /// Path relative to the scene file.
        file: String,
        /// 0-based index of the shape.
        #[serde(default, skip_serializing_if = "is_default")]
        index: u32,
        /// Shade every face flat. Otherwise a file without vertex normals gets smooth ones.
        #[serde(default, skip_serializing_if = "is_default")]
        face_normals: bool,
    },
    /// Curves with a thickness, such as hair, of a text file: lines of control points (x y z radius), and an empty line between curves. They are made
    /// of tubes with texture coordinates around and along.
    Curves {
        /// Path relative to the scene file.
        file: String,
        /// Straight from point to point instead of uniform cubic B-splines.
        #[serde(default, skip_serializing_if = "is_default")]
        straight: bool,
        /// Factor on the radii.
        #[serde(default = "one", skip_serializing_if = "is_one")]
        wider: f32,
    },
    /// The square [-1, 1]² in z = 0, facing +z.
    Rectangle {},
    /// The cube [-1, 1]³, facing outwards.
    Cube {},
    /// The unit disk in z = 0, facing +z, as a polygon of its area.
    Disk {},
    /// The side of the cylinder with radius 1 from z = 0 to z = 1, facing outwards, in flat strips with smooth normals.
    Cylinder {},
    /// A mesh written out.
    Inline {
        /// Vertex positions.
        positions: Vec<[f32; 3]>,
        /// Vertex normals, or empty.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        normals: Vec<[f32; 3]>,
        /// Texture coordinates, or empty.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        uvs: Vec<[f32; 2]>,
        /// Vertex indices, counter-clockwise seen from the front.
        triangles: Vec<[u32; 3]>,
    },
    /// A mesh that a document of another format holds, which is in memory only: such a scene cannot be saved.
    #[serde(skip_deserializing)]
    Held {
        /// Its part of that document.
        part: String,
    },
}

/// A surface with its material.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShapeFile {
    /// A name for messages and mattes, which show shapes of one name as one; may be empty.
    #[serde(default, skip_serializing_if = "is_default")]
    pub name: String,
    /// The geometry.
    pub geometry: GeometryFile,
    /// Shape to world.
    #[serde(default = "identity", skip_serializing_if = "is_identity")]
    pub to_world: Matrix,
    /// Turn the surface inside out.
    #[serde(default, skip_serializing_if = "is_default")]
    pub flip_normals: bool,
    /// Name of the material.
    pub material: String,
    /// Name of the medium behind the surface; where neither side has one, the medium does not change there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interior: Option<String>,
    /// Name of the medium in front of the surface.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exterior: Option<String>,
    /// Radiance that the front side emits, W·m⁻²·sr⁻¹ per channel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub emission: Option<[f32; 3]>,
    /// Factor on `emission` at the texture coordinates.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub emission_texture: Option<TextureFile>,
    /// No ray meets it: it lights the scene as if it were there, and is seen neither by the camera nor in a mirror.
    #[serde(default, skip_serializing_if = "is_default")]
    pub unseen: bool,
}

impl ShapeFile {
    /// Whether it emits light.
    pub fn shines(&self) -> bool {
        self.emission.is_some_and(|radiance| radiance != [0.0; 3])
    }
}

/// The geometry of a shape.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum GeometryFile {
    /// A mesh by name.
    Mesh {
        /// Key in [`SceneFile::meshes`].
        mesh: String,
    },
    /// A sphere; its transform may scale only uniformly.
    Sphere {
        /// Centre in shape coordinates.
        center: [f32; 3],
        /// Radius in shape coordinates.
        radius: f32,
    },
}
