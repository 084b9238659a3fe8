//! Lights other than emitting shapes, as they are written in a scene file.

use serde::{Deserialize, Serialize};

use super::{Matrix, TextureFile, identity, is_default, is_identity, is_one, one};

fn up() -> [f32; 3] {
    [0.0, 1.0, 0.0]
}

fn is_up(direction: &[f32; 3]) -> bool {
    *direction == up()
}

/// A light that is not a surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum LightFile {
    /// Emits alike in all directions from a point.
    Point {
        /// World position.
        position: [f32; 3],
        /// Radiant intensity, W·sr⁻¹ per channel.
        intensity: [f32; 3],
    },
    /// A cone of light from the origin of `to_world` along +z, linear fall-off between the two angles.
    Spot {
        /// Light to world.
        to_world: Matrix,
        /// Radiant intensity on the axis, W·sr⁻¹ per channel.
        intensity: [f32; 3],
        /// Half angle beyond which there is no light, degrees.
        cutoff_angle: f32,
        /// Half angle up to which the intensity is full, degrees.
        beam_width: f32,
    },
    /// Parallel light from infinitely far away.
    Directional {
        /// World direction in which the light travels.
        direction: [f32; 3],
        /// Irradiance on a plane across the direction, W·m⁻² per channel.
        irradiance: [f32; 3],
    },
    /// A disk of light infinitely far away, such as the sun, of the same radiance all over.
    Sun {
        /// World direction in which the light of its centre travels.
        direction: [f32; 3],
        /// Irradiance on a plane across the direction, W·m⁻² per channel.
        irradiance: [f32; 3],
        /// Angular diameter in degrees: 0.1 to 180.
        angle: f32,
    },
    /// The clear sky of Hošek and Wilkie 2012 without the sun's disk, in W·m⁻²·sr⁻¹·nm⁻¹; black below the horizon.
    Sky {
        /// World direction to the sun, which must not be below the horizon.
        sun: [f32; 3],
        /// World direction upwards.
        #[serde(default = "up", skip_serializing_if = "is_up")]
        up: [f32; 3],
        /// Turbidity: how hazy the air is, in [1, 10].
        turbidity: f32,
        /// Albedo of the ground, which lights the sky, in [0, 1].
        albedo: [f32; 3],
        /// Factor on the radiance.
        #[serde(default = "one")]
        scale: f32,
        /// Factor on angles from the zenith, in [1, 2]: 2 draws the sky down to the nadir.
        #[serde(default = "one", skip_serializing_if = "is_one")]
        stretch: f32,
        /// Whether the horizon's light goes on below it, fading out towards the nadir.
        #[serde(default, skip_serializing_if = "is_default")]
        extend: bool,
    },
    /// The same radiance from every direction.
    Constant {
        /// Radiance, W·m⁻²·sr⁻¹ per channel.
        radiance: [f32; 3],
    },
    /// A latitude-longitude picture around the scene, +y up (Mitsuba's convention).
    Envmap {
        /// Path relative to the scene file.
        file: String,
        /// Factor on every value.
        #[serde(default = "one")]
        scale: f32,
        /// Light to world; only its rotation counts.
        #[serde(default = "identity", skip_serializing_if = "is_identity")]
        to_world: Matrix,
    },
    /// A picture that is projected from the origin of `to_world` along +z, +y up, +x to its left: the way of a camera, turned around.
    Projector {
        /// Light to world.
        to_world: Matrix,
        /// Horizontal angle of the picture in degrees, in (0, 180).
        fov: f32,
        /// Width of the picture over its height.
        #[serde(default = "one", skip_serializing_if = "is_one")]
        aspect: f32,
        /// Factor on the picture, W·sr⁻¹ per channel.
        intensity: [f32; 3],
        /// The picture; texture coordinates run from its top left, (0, 0), to its bottom right.
        texture: TextureFile,
        /// How the intensity depends on the direction besides.
        #[serde(default, skip_serializing_if = "is_default")]
        profile: ProfileFile,
    },
}

impl LightFile {
    /// The picture of a projector.
    pub fn texture(&self) -> Option<&TextureFile> {
        if let Self::Projector { texture, .. } = self { Some(texture) } else { None }
    }

    /// As [`LightFile::texture`], mutable.
    pub fn texture_mut(&mut self) -> Option<&mut TextureFile> {
        if let Self::Projector { texture, .. } = self { Some(texture) } else { None }
    }
}

/// How a projector's intensity depends on the angle to its axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum ProfileFile {
    /// Not at all.
    Even {},
    /// By 1/cos³, so that a plane across the axis has as much irradiance everywhere where the picture is as bright.
    Plane {},
    /// As that of a spot whose cutoff is half of the picture's angle.
    Cone {
        /// Half angle up to which the intensity is full, degrees.
        beam_width: f32,
    },
}

impl Default for ProfileFile {
    fn default() -> Self {
        Self::Even {}
    }
}
