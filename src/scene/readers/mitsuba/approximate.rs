//! Materials without an equal here: each becomes a similar one, with a warning that names it.

use crate::base::Result;
use crate::math::channel_mean;
use crate::scene::file::{Distribution, MaterialFile, TextureFile};
use crate::scene::readers::conductors::index_of;
use crate::scene::readers::slips::same;
use crate::scene::readers::spectrum::Use;

use super::Reader;
use super::color;
use super::element::Element;
use super::material::KINDS;
use super::object::{Object, follow, kind, refuse_slip_of_kind};

/// Largest reflectance of a coat at normal incidence: its index would grow without bound otherwise.
const MOST_SPECULAR: f32 = 0.5;

/// Names that a material's colour may have, the first that is there.
const COLORS: [&str; 8] = [
    "reflectance",
    "diffuse_reflectance",
    "base_color",
    "albedo",
    "color",
    "transmittance",
    "diffuse",
    "specular_reflectance",
];

impl<'a> Reader<'a> {
    /// A material of an unknown kind: the one inside it, or a diffuse surface of its colour, on both sides.
    pub(super) fn stand_in(&mut self, element: &'a Element) -> Result<MaterialFile> {
        refuse_slip_of_kind(element, &KINDS)?;
        let kind = kind(element)?;
        let mut found: Option<(usize, &'a Element)> = None;
        for child in &element.children {
            let target = follow(child, &self.ids)?;
            if target.tag == "bsdf" {
                self.warn(element, format_args!("the bsdf \"{kind}\" is not known: the one inside is used"));
                return self.nested(target, |reader| reader.material(target));
            }
            let known = child.attribute("name").and_then(|name| same(name, &COLORS));
            let rank = known.and_then(|known| COLORS.iter().position(|other| *other == known));
            let is_color = target.tag == "texture" || color::TAGS.contains(&target.tag.as_str());
            if let Some(rank) = rank.filter(|rank| is_color && found.is_none_or(|(best, _)| *rank < best)) {
                found = Some((rank, target));
            }
        }
        self.warn(element, format_args!("the bsdf \"{kind}\" is not known: a diffuse surface stands in for it"));
        let reflectance = match found {
            Some((_, texture)) if texture.tag == "texture" => self.texture_object(texture)?,
            Some((_, value)) => TextureFile::rgb(color::read(value, Use::Reflectance)?),
            None => TextureFile::rgb([0.5; 3]),
        };
        Ok(MaterialFile::TwoSided { material: Box::new(MaterialFile::Diffuse { reflectance }) })
    }

    /// Fibres as diffuse surfaces of the colour that light takes on in many of them.
    pub(super) fn hair(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let object = Object::lenient(element, &self.ids, &["eumelanin", "pheomelanin", "sigma_a"])?;
        self.warn(element, "hair is read as a diffuse surface of its colour");
        let amount = |name: &str| Ok(object.float(name)?.unwrap_or(0.0) as f32);
        let given = ["eumelanin", "pheomelanin"].iter().any(|name| object.property(name).is_some());
        let absorption = match object.color_for("sigma_a", Use::Index)? {
            Some(absorption) if !given => absorption,
            None if !given => [0.419, 0.697, 1.37].map(|sigma: f32| 1.3 * sigma),
            _ => {
                let (dark, red) = (amount("eumelanin")?, amount("pheomelanin")?);
                // d'Eon et al. 2011.
                [(0.419, 0.187), (0.697, 0.4), (1.37, 1.05)].map(|(eu, pheo)| dark * eu + red * pheo)
            }
        };
        // Chiang et al. 2016, eq. 9 solved for the colour, at a roughness of 0.3.
        let reflectance = TextureFile::rgb(absorption.map(|sigma| (-5.97 * sigma.max(0.0).sqrt()).exp()));
        Ok(MaterialFile::TwoSided { material: Box::new(MaterialFile::Diffuse { reflectance }) })
    }

    /// Plastic whose light is polarised: here it is not.
    pub(super) fn polarized_plastic(&mut self, element: &'a Element) -> Result<MaterialFile> {
        self.warn(element, "pplastic is read as plastic: light is not polarised");
        let rough = element.children.iter().any(|child| {
            child.attribute("name").is_some_and(|name| same(name, &["alpha", "alpha_u", "alpha_v"]).is_some())
        });
        self.plastic(element, rough)
    }

    /// Filters of polarised light, which let all pass here.
    pub(super) fn polarizer(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let kind = kind(element)?;
        self.warn(element, format_args!("the {kind} is left out: light is not polarised"));
        Ok(MaterialFile::Null {})
    }

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
            self.roughness(&object)?.alpha
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
