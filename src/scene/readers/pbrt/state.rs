//! The graphics state: what a directive sets for those that follow.

use std::collections::BTreeMap;

use glam::{DAffine3, DMat3, DMat4, DVec3};

use crate::scene::file::TextureFile;
use crate::scene::readers::frames::looking;

use super::parameters::Parameter;
use super::spaces::ColorSpace;

/// What AttributeBegin and AttributeEnd keep.
#[derive(Debug, Clone)]
pub struct State {
    /// Object to world.
    pub transform: DMat4,
    /// Whether transforms change what is there at the shutter's opening: the rest of a motion is left out.
    pub moves_start: bool,
    /// Whether surfaces are turned inside out.
    pub reversed: bool,
    /// Name of the material in the scene file.
    pub material: String,
    /// Light of the shapes that follow.
    pub light: Option<AreaLight>,
    /// Media behind and in front of surfaces; empty names are empty space.
    pub media: [String; 2],
    /// Space of RGB colours.
    pub space: ColorSpace,
    /// Defaults for parameters by what they are for: shape, light, material, medium, texture.
    pub defaults: BTreeMap<String, Vec<Parameter>>,
}

/// An area light.
#[derive(Debug, Clone, PartialEq)]
pub struct AreaLight {
    /// Radiance, W·m⁻²·sr⁻¹; if there is a power, of a light whose factors are still to come.
    pub radiance: [f32; 3],
    /// Factor on the radiance.
    pub picture: Option<TextureFile>,
    /// Whether both sides emit.
    pub two_sided: bool,
    /// Power that sets the radiance once the area is known, W.
    pub power: Option<f64>,
}

/// What begins a block that must end in the same way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Block {
    /// AttributeBegin.
    Attribute,
    /// TransformBegin.
    Transform,
    /// ObjectBegin.
    Object,
}

impl Block {
    /// The name in the directives.
    pub fn name(self) -> &'static str {
        match self {
            Self::Attribute => "Attribute",
            Self::Transform => "Transform",
            Self::Object => "Object",
        }
    }
}

impl State {
    /// The state at the beginning of a scene, or of its world.
    pub fn new(material: &str) -> Self {
        Self {
            transform: DMat4::IDENTITY,
            moves_start: true,
            reversed: false,
            material: material.to_owned(),
            light: None,
            media: Default::default(),
            space: ColorSpace::default(),
            defaults: BTreeMap::new(),
        }
    }
}

/// The affine matrix with these numbers, column by column as pbrt lists them; none where it is not affine.
pub fn matrix(numbers: &[f64; 16]) -> Option<DMat4> {
    let m = DMat4::from_cols_slice(numbers);
    let last = m.row(3);
    let scaled = m * (1.0 / last.w);
    let affine = last.truncate().abs().max_element() <= 1e-6 * last.w.abs() && scaled.is_finite();
    affine.then(|| {
        let [x, y, z, w] = [0, 1, 2, 3].map(|i| scaled.col(i).truncate());
        DMat4::from_cols(x.extend(0.0), y.extend(0.0), z.extend(0.0), w.extend(1.0))
    })
}

/// The inverse of an affine matrix; none where it flattens space.
pub fn inverse(m: &DMat4) -> Option<DMat4> {
    let inverse = DAffine3::from_mat4(*m).inverse();
    (inverse.is_finite() && m.determinant() != 0.0).then(|| DMat4::from(inverse))
}

/// World to a camera at `eye` that looks at `at`; none where the view has no direction or `up` is along it.
pub fn look_at(eye: DVec3, at: DVec3, up: DVec3) -> Option<DMat4> {
    let direction = (at - eye).try_normalize()?;
    inverse(&looking(eye, direction, up)?)
}

/// The part of a transform that acts on vectors.
pub fn linear(m: &DMat4) -> DMat3 {
    DMat3::from_mat4(*m)
}
