//! Materials of pbrt-v3, by near relations.

use crate::base::Result;
use crate::scene::file::{MaterialFile, PrincipledFile, TextureFile, burley_axes};

use super::Reader;
use super::materials::{clear, mirror, plastic};
use super::parameters::Parameters;
use super::roughness::{ROUGHNESS, old_alpha};
use super::textures::Values;

/// Largest reflectance of a coat at normal incidence: its index would grow without bound otherwise.
const MOST_SPECULAR: f32 = 0.5;

impl Reader {
    /// A material of pbrt-v3; none if v3 has none of this kind.
    pub(super) fn classic(&mut self, kind: &str, parameters: &Parameters) -> Result<Option<MaterialFile>> {
        Ok(Some(match kind {
            "matte" => self.diffuse(parameters, "Kd")?,
            "metal" => {
                let metal = self.metal(parameters, ["eta", "k", "reflectance"])?;
                self.faceted(parameters, 0.01, |alpha| metal.surface(alpha))?
            }
            "mirror" => mirror(self.albedo(parameters, "Kr", 0.9)?),
            "glass" => {
                let int_ior = self.index(parameters, ["eta", "index"], 1.5)?;
                let (reflected, transmitted) =
                    (self.albedo(parameters, "Kr", 1.0)?, self.albedo(parameters, "Kt", 1.0)?);
                // Of all rough materials of v3 glass alone may be smooth.
                let remapped = parameters.boolean("remaproughness")?.unwrap_or(true) && self.old;
                let smooth = if remapped { old_alpha(0.0) } else { 0.0 };
                let clear = |alpha: f32| clear(if alpha > smooth { alpha } else { 0.0 }, int_ior);
                self.faceted(parameters, 0.0, |alpha| clear(alpha).tinted(reflected, transmitted))?
            }
            "plastic" => {
                self.relation(parameters, kind, "a coat over a diffuse base");
                let diffuse = self.albedo(parameters, "Kd", 0.25)?;
                let specular = self.albedo(parameters, "Ks", 0.25)?;
                self.faceted(parameters, 0.1, |alpha| plastic(alpha, 1.5, diffuse, specular))?
            }
            "substrate" => self.substrate(parameters)?,
            "uber" => self.uber(parameters)?,
            "translucent" => {
                self.relation(parameters, kind, "a diffuse sheet without gloss");
                parameters.ignore(&["Ks", "roughness", "remaproughness"]);
                let base = self.albedo(parameters, "Kd", 0.25)?;
                let mut part = |name: &'static str| -> Result<TextureFile> {
                    let part = self.albedo(parameters, name, 0.5)?;
                    self.product(base.clone(), part, &parameters.place)
                };
                MaterialFile::Translucent { reflectance: part("reflect")?, transmittance: part("transmit")? }
            }
            "disney" => self.disney(parameters)?,
            _ => return Ok(None),
        }))
    }

    fn relation(&mut self, parameters: &Parameters, kind: &str, relation: &str) {
        self.warn(&parameters.place, format!("a material \"{kind}\" is read as {relation}"));
    }

    /// A coat that reflects as much at normal incidence, over the base.
    fn substrate(&mut self, parameters: &Parameters) -> Result<MaterialFile> {
        self.relation(parameters, "substrate", "a coat over a diffuse base");
        let diffuse = self.albedo(parameters, "Kd", 0.5)?;
        let specular = self.albedo(parameters, "Ks", 0.5)?;
        let color = self.mean(&specular, &parameters.place, "Ks")?;
        let most = color.iter().fold(f32::MIN_POSITIVE, |most, channel| most.max(*channel));
        // Fresnel's equations at normal incidence, solved for the index.
        let root = most.clamp(0.0, MOST_SPECULAR).sqrt();
        let tint = TextureFile::rgb(color.map(|channel| channel / most));
        self.faceted(parameters, 0.1, |alpha| plastic(alpha, (1.0 + root) / (1.0 - root), diffuse, tint))
    }

    /// Whatever is strongest: clear, or a coat over a diffuse base.
    fn uber(&mut self, parameters: &Parameters) -> Result<MaterialFile> {
        self.relation(parameters, "uber", "its strongest part");
        let [kd, kt] = [self.strength(parameters, "Kd", 0.25)?, self.strength(parameters, "Kt", 0.0)?];
        let [ks, kr] = [self.strength(parameters, "Ks", 0.25)?, self.strength(parameters, "Kr", 0.0)?];
        let int_ior = self.index(parameters, ["eta", "index"], 1.5)?;
        let rough = self.even_roughness(parameters, ROUGHNESS, 0.1)?;
        let material = if kt > kd {
            clear(0.0, int_ior).tinted(self.albedo(parameters, "Kr", 0.0)?, self.albedo(parameters, "Kt", 0.0)?)
        } else {
            let diffuse = self.albedo(parameters, "Kd", 0.25)?;
            let (specular, alpha) = if kr > ks { ("Kr", 0.0) } else { ("Ks", rough) };
            let specular = self.albedo(parameters, specular, 0.25)?;
            MaterialFile::TwoSided { material: Box::new(plastic(alpha, int_ior, diffuse, specular)) }
        };
        let opacity = self.albedo(parameters, "opacity", 1.0)?;
        if opacity == TextureFile::rgb([1.0; 3]) {
            return Ok(match material {
                MaterialFile::TwoSided { material } => *material,
                other => other,
            });
        }
        Ok(MaterialFile::Mask { opacity, material: Box::new(material) })
    }

    fn disney(&mut self, parameters: &Parameters) -> Result<MaterialFile> {
        self.relation(parameters, "disney", "Burley's mixture of lobes");
        parameters.ignore(&["scatterdistance", "thin", "difftrans"]);
        let mut number = |name, default: f32| -> Result<f32> {
            Ok(self.number(parameters, name)?.unwrap_or(default).clamp(0.0, 1.0))
        };
        let [spec_tint, sheen, sheen_tint] =
            [number("speculartint", 0.0)?, number("sheen", 0.0)?, number("sheentint", 0.5)?];
        let [clearcoat, clearcoat_gloss] = [number("clearcoat", 0.0)?, number("clearcoatgloss", 1.0)?];
        let [spec_trans, flatness] = [number("spectrans", 0.0)?, number("flatness", 0.0)?];
        let anisotropic = number("anisotropic", 0.0)?;
        let within = |texture: Option<TextureFile>, default: f32| {
            super::textures::within(texture.unwrap_or(TextureFile::rgb([default; 3])))
        };
        let principled = MaterialFile::Principled(PrincipledFile {
            base_color: self.albedo(parameters, "color", 0.5)?,
            roughness: within(self.texture(parameters, "roughness", Values::Floats)?, 0.5),
            metallic: within(self.texture(parameters, "metallic", Values::Floats)?, 0.0),
            eta: self.index(parameters, ["eta", "index"], 1.5)?.max(1.0),
            spec_tint,
            sheen,
            sheen_tint,
            clearcoat,
            clearcoat_gloss,
            flatness,
            spec_trans,
        });
        Ok(principled.with_grain(Some(burley_axes(anisotropic))))
    }
}
