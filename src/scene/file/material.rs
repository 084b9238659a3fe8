//! Materials and their textures, as they are written in a scene file.

use serde::{Deserialize, Serialize};

use super::{is_default, one};
use crate::materials::microfacet::SMOOTH;

/// A spatially varying or constant colour.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum TextureFile {
    /// One colour everywhere.
    Rgb {
        /// Linear RGB.
        value: [f32; 3],
    },
    /// A picture (EXR, PNG, JPEG, TGA, BMP, WebP, QOI, HDR, PFM) over the texture coordinates; (0, 0) is its top left.
    Bitmap {
        /// Path relative to the scene file.
        file: String,
        /// Texture coordinates to picture coordinates, 3×3 row by row.
        #[serde(default = "identity3")]
        to_uv: [f32; 9],
        /// Whether the picture is data, not colour: formats other than float ones are then not converted from sRGB.
        #[serde(default, skip_serializing_if = "is_default")]
        raw: bool,
        /// Factor on every value.
        #[serde(default = "one")]
        scale: f32,
        /// Continuation beyond the picture's edges.
        #[serde(default, skip_serializing_if = "is_default")]
        wrap: Wrap,
        /// Interpolation between pixel centres.
        #[serde(default, skip_serializing_if = "is_default")]
        filter: Filter,
    },
    /// What the mesh has for each vertex or face, such as `vertex_color` or `face_color`.
    Attribute {
        /// Its name; see the readers of meshes.
        name: String,
        /// Factor on every value.
        #[serde(default = "one")]
        scale: f32,
    },
    /// Two colours in squares of half a texture unit.
    Checkerboard {
        /// Colour where the two half-unit indices are equal.
        color0: [f32; 3],
        /// The other colour.
        color1: [f32; 3],
        /// Texture coordinates to board coordinates, 3×3 row by row.
        #[serde(default = "identity3")]
        to_uv: [f32; 9],
    },
}

/// Continuation of a picture beyond its edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default)]
#[serde(rename_all = "snake_case")]
pub enum Wrap {
    /// The picture again.
    #[default]
    Repeat,
    /// The picture mirrored.
    Mirror,
    /// The pixels of its edge.
    Clamp,
}

/// Interpolation between the pixel centres of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default)]
#[serde(rename_all = "snake_case")]
pub enum Filter {
    /// The four nearest pixels, bilinearly.
    #[default]
    Bilinear,
    /// The nearest pixel.
    Nearest,
}

/// The 3×3 matrix that changes nothing.
pub fn identity3() -> [f32; 9] {
    [1., 0., 0., 0., 1., 0., 0., 0., 1.]
}

impl TextureFile {
    /// A constant colour.
    pub fn rgb(value: [f32; 3]) -> Self {
        Self::Rgb { value }
    }
}

/// Microfacet distribution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default)]
#[serde(rename_all = "snake_case")]
pub enum Distribution {
    /// Beckmann and Spizzichino 1963.
    #[default]
    Beckmann,
    /// Walter et al. 2007, Trowbridge and Reitz 1975.
    Ggx,
}

/// Least and largest roughness along a grain over the mean, see [`MaterialFile::Anisotropic`].
pub const ASPECTS: [f32; 2] = [1e-3, 1e3];

/// Roughness along the grain and across it, over the mean, of Burley's `anisotropic` in [0, 1] (Burley 2012, §5.4).
pub fn burley_axes(anisotropic: f32) -> [f32; 2] {
    let aspect = (1.0 - 0.9 * anisotropic.clamp(0.0, 1.0)).sqrt();
    [aspect.recip(), aspect]
}

fn white() -> TextureFile {
    TextureFile::rgb([1.0; 3])
}

fn grey() -> TextureFile {
    TextureFile::rgb([0.5; 3])
}

fn black() -> TextureFile {
    TextureFile::rgb([0.0; 3])
}

fn glass_index() -> f32 {
    1.5
}

/// How a surface scatters light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum MaterialFile {
    /// Lambertian reflection on the front side; the back side is black.
    Diffuse {
        /// Albedo in [0, 1].
        reflectance: TextureFile,
    },
    /// Diffuse facets (Oren and Nayar 1994) on the front side; the back side is black.
    RoughDiffuse {
        /// Albedo of the facets in [0, 1].
        reflectance: TextureFile,
        /// Roughness, the root mean square slope of the facets; 0 is diffuse.
        alpha: f32,
        /// Use the simpler of the authors' two models, which leaves out interreflection between facets.
        #[serde(default, skip_serializing_if = "is_default")]
        qualitative: bool,
    },
    /// A thin sheet that scatters light evenly to both sides, alike on both; where it would scatter more than arrives, both parts are
    /// scaled down.
    Translucent {
        /// Albedo of what comes back, in [0, 1].
        reflectance: TextureFile,
        /// Albedo of what goes through, in [0, 1].
        transmittance: TextureFile,
    },
    /// A smooth metal.
    Conductor {
        /// Real part of the refractive index per channel. Colours fitted to spectra may be negative; only squares count.
        eta: [f32; 3],
        /// Extinction coefficient per channel, likewise.
        k: [f32; 3],
        /// Factor on the reflection.
        #[serde(default = "white")]
        specular_reflectance: TextureFile,
    },
    /// A rough metal (Walter et al. 2007).
    RoughConductor {
        /// Roughness, the root mean square slope of the microfacets.
        alpha: f32,
        /// Microfacet distribution.
        #[serde(default)]
        distribution: Distribution,
        /// Real part of the refractive index per channel. Colours fitted to spectra may be negative; only squares count.
        eta: [f32; 3],
        /// Extinction coefficient per channel, likewise.
        k: [f32; 3],
        /// Factor on the reflection.
        #[serde(default = "white")]
        specular_reflectance: TextureFile,
    },
    /// Smooth glass, water: reflects and refracts.
    Dielectric {
        /// Refractive index on the side that the normal points away from.
        int_ior: f32,
        /// Refractive index on the side that the normal points to.
        ext_ior: f32,
    },
    /// A thin pane of smooth glass: nothing is bent.
    ThinDielectric {
        /// Refractive index of the pane.
        int_ior: f32,
        /// Refractive index around it.
        ext_ior: f32,
    },
    /// Rough glass (Walter et al. 2007).
    RoughDielectric {
        /// Roughness, the root mean square slope of the microfacets.
        alpha: f32,
        /// Microfacet distribution.
        #[serde(default)]
        distribution: Distribution,
        /// Refractive index on the side that the normal points away from.
        int_ior: f32,
        /// Refractive index on the side that the normal points to.
        ext_ior: f32,
    },
    /// A clear coat over a diffuse base; the back side is black.
    Plastic {
        /// Roughness of the coat, the root mean square slope of its microfacets; 0 is smooth.
        #[serde(default)]
        alpha: f32,
        /// Microfacet distribution.
        #[serde(default)]
        distribution: Distribution,
        /// Refractive index of the coat.
        int_ior: f32,
        /// Refractive index outside.
        ext_ior: f32,
        /// Albedo of the base.
        diffuse_reflectance: TextureFile,
        /// Factor on the coat's reflection.
        #[serde(default = "white")]
        specular_reflectance: TextureFile,
        /// Whether light that the coat reflects back to the base takes on its colour each time.
        #[serde(default)]
        nonlinear: bool,
    },
    /// No surface: only the border between two media.
    Null {},
    /// Burley's mixture of lobes.
    Principled(PrincipledFile),
    /// Burley's mixture of lobes for thin sheets, alike on both sides.
    PrincipledThin(PrincipledThinFile),
    /// Two materials mixed: (1 − weight) of the first, weight of the second.
    Blend {
        /// Weight in [0, 1]; the luminance of a colour.
        weight: TextureFile,
        /// The two materials, without masks.
        materials: Box<[MaterialFile; 2]>,
    },
    /// A clear material with factors on the light that Fresnel's equations let it reflect and transmit.
    Tinted {
        /// Factor on reflected light.
        #[serde(default = "white")]
        specular_reflectance: TextureFile,
        /// Factor on transmitted light.
        #[serde(default = "white")]
        specular_transmittance: TextureFile,
        /// The material.
        material: Box<MaterialFile>,
    },
    /// Another material whose shading normals are those of a surface displaced along its normals (Blinn 1978). Only bilinear pictures
    /// have slopes.
    BumpMap {
        /// Height: the luminance of the texture.
        texture: TextureFile,
        /// Scene units per unit of height.
        #[serde(default = "one")]
        scale: f32,
        /// The material.
        material: Box<MaterialFile>,
    },
    /// Another material whose shading normals come from a texture.
    NormalMap {
        /// Normals n as (n + 1)/2 in the tangent frame, z along the surface's own; a picture should be `raw`.
        texture: TextureFile,
        /// The material.
        material: Box<MaterialFile>,
    },
    /// Another material whose facets are of varying roughness.
    RoughnessMap {
        /// Factor in [0, 1] on the material's α: the luminance of the texture. No facets become smoother than 0.0001.
        texture: TextureFile,
        /// A rough metal, rough glass or plastic with an α above 0, tinted or not.
        material: Box<MaterialFile>,
    },
    /// Another material whose facets have a grain: they are rougher along ∂p/∂u than across it, or less.
    Anisotropic {
        /// Roughness along the grain is α·aspect, across it α/aspect, with the material's α; in [0.001, 1000].
        aspect: f32,
        /// Angle of the grain from ∂p/∂u, counterclockwise as seen from the front, degrees.
        #[serde(default, skip_serializing_if = "is_default")]
        rotation: f32,
        /// A rough metal, rough glass or principled material, tinted or of varying roughness or not.
        material: Box<MaterialFile>,
    },
    /// Another material with holes.
    Mask {
        /// Probability in [0, 1] that the surface is there; the luminance of a colour.
        opacity: TextureFile,
        /// The material where it is.
        material: Box<MaterialFile>,
    },
    /// Another material on both sides.
    TwoSided {
        /// The material; its front is used on both sides.
        material: Box<MaterialFile>,
    },
}

/// Burley's mixture of lobes (2012, 2015) with the formulas of Mitsuba's `principled`, bounded so that it never scatters more than
/// arrives. Numbers are in [0, 1]; textures of numbers count by their luminance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PrincipledFile {
    /// Albedo of the base, colour of a metal.
    pub base_color: TextureFile,
    /// Square root of the facets' roughness.
    #[serde(default = "grey")]
    pub roughness: TextureFile,
    /// Blend from dielectric (0) to metal (1).
    #[serde(default = "black")]
    pub metallic: TextureFile,
    /// Refractive index relative to the outside, at least 1.
    #[serde(default = "glass_index")]
    pub eta: f32,
    /// How much the dielectric's reflection takes on the base's hue.
    #[serde(default)]
    pub spec_tint: f32,
    /// Strength of the sheen: reflection at grazing angles as of cloth.
    #[serde(default)]
    pub sheen: f32,
    /// How much the sheen takes on the base's hue.
    #[serde(default)]
    pub sheen_tint: f32,
    /// Strength of a clear coat.
    #[serde(default)]
    pub clearcoat: f32,
    /// Gloss of the coat, from satin (0) to glossy (1).
    #[serde(default)]
    pub clearcoat_gloss: f32,
    /// Blend from the diffuse base (0) to an approximation of subsurface scattering (1).
    #[serde(default)]
    pub flatness: f32,
    /// Part of the dielectric that transmits light instead of having a base.
    #[serde(default)]
    pub spec_trans: f32,
}

/// Burley's thin sheet (2015) with the formulas of Mitsuba's `principledthin`, bounded so that it never scatters more than arrives. Numbers
/// are in [0, 1]; textures of numbers count by their luminance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PrincipledThinFile {
    /// Colour of the base, and of what passes.
    pub base_color: TextureFile,
    /// Square root of the facets' roughness.
    #[serde(default = "grey")]
    pub roughness: TextureFile,
    /// Blend from a diffuse sheet (0) to a clear one (1).
    #[serde(default = "black")]
    pub spec_trans: TextureFile,
    /// Part of the diffuse light that goes through.
    #[serde(default = "black")]
    pub diff_trans: TextureFile,
    /// Refractive index relative to the outside, at least 1.
    #[serde(default = "glass_index")]
    pub eta: f32,
    /// How much the specular reflection takes on the base's hue.
    #[serde(default)]
    pub spec_tint: f32,
    /// Strength of the sheen: reflection at grazing angles as of cloth.
    #[serde(default)]
    pub sheen: f32,
    /// How much the sheen takes on the base's hue.
    #[serde(default)]
    pub sheen_tint: f32,
    /// Blend from the diffuse base (0) to an approximation of subsurface scattering (1).
    #[serde(default)]
    pub flatness: f32,
}

impl PrincipledThinFile {
    /// Whether nothing passes.
    pub fn is_opaque(&self) -> bool {
        [&self.spec_trans, &self.diff_trans].into_iter().all(|part| *part == black())
    }

    /// Lets nothing pass.
    pub fn make_opaque(&mut self) {
        (self.spec_trans, self.diff_trans) = (black(), black());
    }
}

/// Lists a material's textures, for shared and for mutable access.
macro_rules! textures {
    ($material:ident, $each:ident, $iter:ident) => {
        match $material {
            Self::Diffuse { reflectance } | Self::RoughDiffuse { reflectance, .. } => {
                vec![("reflectance", reflectance)]
            }
            Self::Translucent { reflectance, transmittance } => {
                vec![("reflectance", reflectance), ("transmittance", transmittance)]
            }
            Self::Conductor { specular_reflectance, .. } | Self::RoughConductor { specular_reflectance, .. } => {
                vec![("specular_reflectance", specular_reflectance)]
            }
            Self::Plastic { diffuse_reflectance, specular_reflectance, .. } => {
                vec![("diffuse_reflectance", diffuse_reflectance), ("specular_reflectance", specular_reflectance)]
            }
            Self::Principled(PrincipledFile { base_color, roughness, metallic, .. }) => {
                vec![("base_color", base_color), ("roughness", roughness), ("metallic", metallic)]
            }
            Self::PrincipledThin(PrincipledThinFile { base_color, roughness, spec_trans, diff_trans, .. }) => vec![
                ("base_color", base_color),
                ("roughness", roughness),
                ("spec_trans", spec_trans),
                ("diff_trans", diff_trans),
            ],
            Self::Mask { opacity, material } => {
                let mut textures = material.$each();
                textures.push(("opacity", opacity));
                textures
            }
            Self::BumpMap { texture, material, .. }
            | Self::NormalMap { texture, material }
            | Self::RoughnessMap { texture, material } => {
                let mut textures = material.$each();
                textures.push(("texture", texture));
                textures
            }
            Self::Tinted { specular_reflectance, specular_transmittance, material } => {
                let mut textures = material.$each();
                textures.push(("specular_reflectance", specular_reflectance));
                textures.push(("specular_transmittance", specular_transmittance));
                textures
            }
            Self::TwoSided { material } | Self::Anisotropic { material, .. } => material.$each(),
            Self::Blend { weight, materials } => {
                let mut textures: Vec<_> = materials.$iter().flat_map(Self::$each).collect();
                textures.push(("weight", weight));
                textures
            }
            Self::Null {} | Self::Dielectric { .. } | Self::ThinDielectric { .. } | Self::RoughDielectric { .. } => {
                vec![]
            }
        }
    };
}

/// Gets the material inside a mask, tint, bump or two-sided one, for shared and for mutable access.
macro_rules! inside {
    ($material:ident) => {
        match $material {
            Self::Mask { material, .. }
            | Self::Tinted { material, .. }
            | Self::BumpMap { material, .. }
            | Self::NormalMap { material, .. }
            | Self::RoughnessMap { material, .. }
            | Self::Anisotropic { material, .. }
            | Self::TwoSided { material } => Some(material),
            _ => None,
        }
    };
}

impl MaterialFile {
    /// Its textures, those of the materials inside too, with the names that they have in a file.
    pub fn textures(&self) -> Vec<(&'static str, &TextureFile)> {
        textures!(self, textures, iter)
    }

    /// As [`MaterialFile::textures`], mutable.
    pub fn textures_mut(&mut self) -> Vec<(&'static str, &mut TextureFile)> {
        textures!(self, textures_mut, iter_mut)
    }

    /// The material inside a mask, bump, tint or the like.
    pub fn inside(&self) -> Option<&Self> {
        inside!(self)
    }

    /// As [`MaterialFile::inside`], mutable.
    pub fn inside_mut(&mut self) -> Option<&mut Self> {
        inside!(self)
    }

    /// The material under a tint of this reflection and transmission, unless both are white.
    pub fn tinted(self, specular_reflectance: TextureFile, specular_transmittance: TextureFile) -> Self {
        let white = TextureFile::rgb([1.0; 3]);
        if specular_reflectance == white && specular_transmittance == white {
            return self;
        }
        Self::Tinted { specular_reflectance, specular_transmittance, material: Box::new(self) }
    }

    /// The material with a factor on the roughness of its facets, if there is one and it has facets.
    pub fn roughened(self, factor: Option<TextureFile>) -> Self {
        match factor {
            Some(texture) if self.has_facets() => Self::RoughnessMap { texture, material: Box::new(self) },
            _ => self,
        }
    }

    /// The material with facets of these roughnesses along ∂p/∂u and across it, of which its α is the geometric mean, if it can have a grain.
    pub fn with_grain(self, axes: Option<[f32; 2]>) -> Self {
        // Smoother facets than that are smooth.
        let Some([along, across]) = axes.map(|axes| axes.map(|alpha| alpha.max(SMOOTH))) else { return self };
        if along == across || !self.can_have_grain() {
            return self;
        }
        let aspect = (along / across).sqrt().clamp(ASPECTS[0], ASPECTS[1]);
        Self::Anisotropic { aspect, rotation: 0.0, material: Box::new(self) }
    }

    /// Whether its facets, if it has any, can have a grain.
    pub fn can_have_grain(&self) -> bool {
        match self {
            Self::Tinted { material, .. } | Self::RoughnessMap { material, .. } => material.can_have_grain(),
            Self::RoughConductor { .. } | Self::RoughDielectric { .. } | Self::Principled(_) => true,
            _ => false,
        }
    }

    /// Whether it consists of rough facets of one kind, tinted or not.
    pub fn has_facets(&self) -> bool {
        match self {
            Self::Tinted { material, .. } => material.has_facets(),
            Self::RoughConductor { alpha, .. } | Self::RoughDielectric { alpha, .. } | Self::Plastic { alpha, .. } => {
                *alpha > 0.0
            }
            _ => false,
        }
    }

    /// Whether it has holes.
    pub fn is_masked(&self) -> bool {
        matches!(self, Self::Mask { .. }) || self.inside().is_some_and(Self::is_masked)
    }

    /// Whether it has a bump or normal map.
    pub fn is_bumped(&self) -> bool {
        matches!(self, Self::BumpMap { .. } | Self::NormalMap { .. }) || self.inside().is_some_and(Self::is_bumped)
    }

    /// Whether facets of it have a grain.
    pub fn has_grain(&self) -> bool {
        match self {
            Self::Anisotropic { .. } => true,
            Self::Blend { materials, .. } => materials.iter().any(Self::has_grain),
            other => other.inside().is_some_and(Self::has_grain),
        }
    }

    /// Whether its back scatters like its front.
    pub fn is_two_sided(&self) -> bool {
        match self {
            Self::TwoSided { .. } | Self::PrincipledThin(_) | Self::Translucent { .. } => true,
            Self::Blend { materials, .. } => materials.iter().all(Self::is_two_sided),
            other => other.inside().is_some_and(Self::is_two_sided),
        }
    }

    /// The material inside masks, bumps, tints and two-sided ones.
    pub fn innermost(&self) -> &Self {
        self.inside().map_or(self, Self::innermost)
    }

    /// The scattering parts: the materials inside masks, bumps, tints, two-sided ones and blends.
    pub fn parts(&self) -> Vec<&Self> {
        match self.innermost() {
            Self::Blend { materials, .. } => materials.iter().flat_map(Self::parts).collect(),
            other => vec![other],
        }
    }

    /// Applies `change` to every scattering part.
    pub fn change_parts(&mut self, change: &mut impl FnMut(&mut Self)) {
        if let Some(inside) = self.inside_mut() {
            inside.change_parts(change);
        } else if let Self::Blend { materials, .. } = self {
            materials.iter_mut().for_each(|material| material.change_parts(change));
        } else {
            change(self);
        }
    }
}
