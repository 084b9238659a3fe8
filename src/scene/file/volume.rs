//! Participating media in a scene file, and the grids that they vary by.

use serde::{Deserialize, Serialize};

use super::{Matrix, identity, is_default, is_identity};

/// A participating medium.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum MediumFile {
    /// The same everywhere; absorbs and scatters with Henyey and Greenstein's phase function.
    Homogeneous {
        /// Extinction coefficient σ_t per channel, 1 / scene unit.
        sigma_t: [f32; 3],
        /// Scattered part of the extinction, σ_s / σ_t per channel, in [0, 1].
        albedo: [f32; 3],
        /// Mean cosine of the scattering angle, in (-1, 1); 0 is isotropic.
        #[serde(default, skip_serializing_if = "is_default")]
        g: f32,
    },
    /// Varies in space as grids say.
    Grid(Box<GridMediumFile>),
}

/// A medium whose density is on a grid, beyond which there is nothing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GridMediumFile {
    /// Density, of one or three channels: the extinction is `sigma_t` times it.
    pub density: GridFile,
    /// Extinction coefficient σ_t per channel where the density is 1, 1 / scene unit.
    pub sigma_t: [f32; 3],
    /// Scattered part of the extinction, σ_s / σ_t per channel, in [0, 1].
    pub albedo: [f32; 3],
    /// Factor on `albedo`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub albedo_grid: Option<GridFile>,
    /// Mean cosine of the scattering angle, in (-1, 1); 0 is isotropic.
    #[serde(default, skip_serializing_if = "is_default")]
    pub g: f32,
    /// Radiance L_e of its own light, W·m⁻²·sr⁻¹ per channel: a unit of length emits L_e times its absorption σ_t·(1 − albedo), so that
    /// a thick medium shines with L_e.
    #[serde(default, skip_serializing_if = "is_default")]
    pub emission: [f32; 3],
    /// Factor on `emission`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub emission_grid: Option<GridFile>,
}

/// The source of a grid: values at the centres of cells, trilinear between them. Beyond the outermost centres their values go on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum GridFile {
    /// A file in Mitsuba's format `.vol`.
    Vol {
        /// Path relative to the scene file.
        file: String,
        /// From the unit cube that the cells fill to the world.
        #[serde(default = "identity", skip_serializing_if = "is_identity")]
        to_world: Matrix,
        /// Fill the box that the file names, before `to_world`, instead of the unit cube.
        #[serde(default, skip_serializing_if = "is_default")]
        own_box: bool,
        /// The centres of the outermost cells lie on the sides of that cube or box, not the cells themselves (Mitsuba 0.4 to 0.6).
        #[serde(default, skip_serializing_if = "is_default")]
        centred: bool,
    },
    /// Written out.
    Inline {
        /// Cells along x, y and z.
        size: [u32; 3],
        /// One value for each cell, or three: those of x fastest, the channels of a cell together.
        values: Vec<f32>,
        /// From the unit cube that the cells fill to the world.
        #[serde(default = "identity", skip_serializing_if = "is_identity")]
        to_world: Matrix,
        /// Values fall to 0 within half a cell of the sides, as pbrt has it, instead of going on.
        #[serde(default, skip_serializing_if = "is_default")]
        fades: bool,
    },
}

impl GridFile {
    /// From the unit cube to the world.
    pub fn to_world(&self) -> &Matrix {
        match self {
            Self::Vol { to_world, .. } | Self::Inline { to_world, .. } => to_world,
        }
    }
}

impl MediumFile {
    /// The grids of the medium, each with the name of the key that holds it.
    pub fn grids(&self) -> Vec<(&'static str, &GridFile)> {
        let Self::Grid(file) = self else { return Vec::new() };
        let further = [("albedo_grid", &file.albedo_grid), ("emission_grid", &file.emission_grid)];
        let further = further.into_iter().filter_map(|(name, grid)| Some((name, grid.as_ref()?)));
        std::iter::once(("density", &file.density)).chain(further).collect()
    }

    /// The same, to be changed.
    pub fn grids_mut(&mut self) -> Vec<(&'static str, &mut GridFile)> {
        let Self::Grid(file) = self else { return Vec::new() };
        let further = [("albedo_grid", &mut file.albedo_grid), ("emission_grid", &mut file.emission_grid)];
        let further = further.into_iter().filter_map(|(name, grid)| Some((name, grid.as_mut()?)));
        std::iter::once(("density", &mut file.density)).chain(further).collect()
    }

    /// Whether it varies in space.
    pub fn is_varying(&self) -> bool {
        matches!(self, Self::Grid(_))
    }

    /// Whether it has light of its own.
    pub fn glows(&self) -> bool {
        matches!(self, Self::Grid(file) if file.emission != [0.0; 3])
    }
}
