//! Materials of Mitsuba 0.6 without an equal here: each becomes a similar material, with a warning that names it.

use crate::base::Result;
use crate::math::channel_mean;
use crate::scene::file::{Distribution, MaterialFile, TextureFile};
use crate::scene::readers::conductors::index_of;

use super::Reader;
use super::element::Element;
use super::object::{Object, kind};

/// Largest reflectance of a coat at normal incidence: its index would grow without bound otherwise.
const MOST_SPECULAR: f32 = 0.5;

impl<'a> Reader<'a> {
    /// The material under a coat; the coat is left out, with a warning.
    pub(super) fn coating(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let object = Object::lenient(element, &self.ids, &[])?;
        self.warn(element, format_args!("the {} is left out: what is under it is used", kind(element)?));
        self.inside(&object)
    }

    /// Phong's and Ward's lobes over a diffuse base as rough plastic that reflects as much at normal incidence, or as a rough
    /// mirror where there is no base.
    pub(super) fn glossy(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let kind = kind(element)?;
        let known =
            ["exponent", "alpha_u", "alpha_v", "variant", "specular_reflectance", "diffuse_reflectance", "alpha"];
        let object = Object::new(element, &self.ids, &known, &[])?;
        let alpha = if kind == "phong" {
            // Equal widths of the lobes (Walter et al. 2007, §5.1: α_b = √(2/(α_p + 2))).
            (2.0 / (object.float("exponent")?.unwrap_or(30.0).max(0.0) + 2.0)).sqrt() as f32
        } else {
            self.roughness(&object)?.0
        };
        let specular = self.texture(&object, "specular_reflectance", 0.2)?;
        let diffuse_reflectance = self.texture(&object, "diffuse_reflectance", 0.5)?;
        let distribution = Distribution::Beckmann;
        if diffuse_reflectance == TextureFile::rgb([0.0; 3]) {
            self.warn(element, format_args!("{kind} is read as a roughconductor with alpha {alpha}"));
            let (eta, k) = ([0.0; 3], [1.0; 3]);
            return Ok(MaterialFile::RoughConductor { alpha, distribution, eta, k, specular_reflectance: specular });
        }
        self.warn(element, format_args!("{kind} is read as a roughplastic with alpha {alpha}"));
        let color = self.mean(&specular, element, "specular_reflectance")?;
        let int_ior = index_of(channel_mean(color.into()).clamp(0.0, MOST_SPECULAR));
        let brightest = color.iter().fold(f32::MIN_POSITIVE, |most, channel| most.max(*channel));
        Ok(MaterialFile::Plastic {
            alpha,
            distribution,
            int_ior,
            ext_ior: 1.0,
            diffuse_reflectance,
            specular_reflectance: TextureFile::rgb(color.map(|channel| channel / brightest)),
            nonlinear: false,
        })
    }
}
