//! Materials of pbrt-v4.

use crate::base::{Error, Result};
use crate::scene::file::{Distribution, Filter, MaterialFile, TextureFile, Wrap};

use super::finish::Mix;
use super::parameters::Parameters;
use super::roughness::Metal;
use super::textures::Values;
use super::{DEFAULT_MATERIAL, Reader};

/// The materials that are known.
const KINDS: &str = "diffuse, coateddiffuse, conductor, coatedconductor, dielectric, thindielectric, diffusetransmission, mix, \
    interface, subsurface, hair, measured; of v3 matte, plastic, metal, glass, mirror, uber, substrate, translucent, disney, \
    kdsubsurface, fourier, none";

impl Reader {
    /// The material of the shapes that follow.
    pub(super) fn material_directive(&mut self, kind: &str, parameters: &Parameters) -> Result<()> {
        let taken = |reader: &Self, name: &str| reader.has_material(name);
        let name = self.free_name("material", taken);
        self.add_material(name.clone(), kind, parameters)?;
        self.state.material = name;
        Ok(())
    }

    /// Keeps a material by its name.
    pub(super) fn make_material(&mut self, name: String, parameters: &Parameters) -> Result<()> {
        let kind = parameters.string("type")?.map(str::to_owned);
        let kind = kind.ok_or_else(|| parameters.malformed("a named material needs \"string type\""))?;
        // A later one of the same name is another material: shapes keep the one that they were given.
        let own = match self.has_material(&name) || name == DEFAULT_MATERIAL {
            true => self.free_name(&name, |reader, name| reader.has_material(name)),
            false => name.clone(),
        };
        self.add_material(own.clone(), &kind, parameters)?;
        self.note_unused(parameters);
        self.materials.insert(name, own);
        Ok(())
    }

    /// Takes a named material for the shapes that follow, which may be made later.
    pub(super) fn use_material(&mut self, name: &str) {
        self.state.material = self.materials.get(name).cloned().unwrap_or_else(|| name.to_owned());
    }

    fn has_material(&self, name: &str) -> bool {
        self.file.materials.contains_key(name) || self.mixes.contains_key(name)
    }

    fn add_material(&mut self, name: String, kind: &str, parameters: &Parameters) -> Result<()> {
        self.places.set(format!("materials.{name}"), parameters.place.clone());
        if kind == "mix" {
            let mix = self.mix(parameters)?;
            self.mixes.insert(name, mix);
            return Ok(());
        }
        let material = self.material(kind, parameters)?;
        self.file.materials.insert(name, material);
        Ok(())
    }

    fn material(&mut self, kind: &str, parameters: &Parameters) -> Result<MaterialFile> {
        let material = match kind {
            "" | "none" | "interface" => return Ok(MaterialFile::Null {}),
            "diffuse" => self.diffuse(parameters, "reflectance")?,
            "coateddiffuse" => self.coated_diffuse(parameters)?,
            "conductor" => {
                let metal = self.metal(parameters, ["eta", "k", "reflectance"])?;
                self.faceted(parameters, 0.0, |alpha| metal.surface(alpha))?
            }
            "coatedconductor" => self.coated_conductor(parameters)?,
            "dielectric" => self.dielectric(parameters)?,
            "thindielectric" => {
                let int_ior = self.index(parameters, ["eta", "index"], 1.5)?;
                MaterialFile::ThinDielectric { int_ior, ext_ior: 1.0 }
            }
            "diffusetransmission" => self.diffuse_transmission(parameters, ["reflectance", "transmittance"], 0.25)?,
            "subsurface" | "kdsubsurface" => self.subsurface(kind, parameters)?,
            "hair" => self.hair(parameters)?,
            "measured" => {
                parameters.ignore(&["filename"]);
                self.warn(&parameters.place, "a measured material is read as grey plastic");
                plastic(0.3, 1.5, TextureFile::rgb([0.3; 3]), TextureFile::rgb([1.0; 3]))
            }
            "fourier" => {
                parameters.ignore(&["bsdffile"]);
                // Those of the scenes that came with v3 are paint and porcelain.
                self.warn(&parameters.place, "a fourier material is read as white plastic");
                plastic(0.3, 1.5, TextureFile::rgb([0.8; 3]), TextureFile::rgb([1.0; 3]))
            }
            other => match self.classic(other, parameters)? {
                Some(material) => material,
                None => {
                    let (place, what) = (parameters.place.clone(), format!("the material \"{other}\""));
                    return Err(Error::Unsupported { place, what, supported: KINDS.to_owned() });
                }
            },
        };
        self.finished(material, parameters)
    }

    /// The material on both sides unless light passes it, with its bumps, which are the same relief from either side.
    fn finished(&mut self, material: MaterialFile, parameters: &Parameters) -> Result<MaterialFile> {
        let material = if material.is_masked() || material.is_two_sided() || lets_light_through(&material) {
            material
        } else {
            MaterialFile::TwoSided { material: Box::new(material) }
        };
        self.bumped(material, parameters)
    }

    fn bumped(&mut self, material: MaterialFile, parameters: &Parameters) -> Result<MaterialFile> {
        if let Some(name) = parameters.string("normalmap")? {
            let file = self.locate(name);
            self.places.set_picture(&file, parameters.place.clone());
            let to_uv = [1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0, 1.0];
            let (wrap, filter) = (Wrap::Repeat, Filter::Bilinear);
            let texture = TextureFile::Bitmap { file, to_uv, raw: true, scale: 1.0, wrap, filter };
            parameters.ignore(&["displacement", "bumpmap"]);
            return Ok(MaterialFile::NormalMap { texture, material: Box::new(material) });
        }
        let name = if parameters.has("displacement") { "displacement" } else { "bumpmap" };
        match self.texture(parameters, name, Values::Floats)? {
            Some(TextureFile::Bitmap { file, to_uv, raw, scale, wrap, filter: Filter::Bilinear }) => {
                let filter = Filter::Bilinear;
                let texture = TextureFile::Bitmap { file, to_uv, raw, scale: scale.abs(), wrap, filter };
                Ok(MaterialFile::BumpMap { texture, scale: 1f32.copysign(scale), material: Box::new(material) })
            }
            Some(TextureFile::Rgb { .. }) | None => Ok(material),
            Some(_) => {
                self.warn(&parameters.place, "a displacement without slopes changes nothing");
                Ok(material)
            }
        }
    }

    /// A diffuse surface; its facets may be rough in v3 and early v4.
    pub(super) fn diffuse(&mut self, parameters: &Parameters, name: &'static str) -> Result<MaterialFile> {
        let reflectance = self.albedo(parameters, name, 0.5)?;
        let sigma = self.number(parameters, "sigma")?.unwrap_or(0.0);
        if sigma > 0.0 {
            return Ok(MaterialFile::RoughDiffuse { reflectance, alpha: sigma.to_radians(), qualitative: true });
        }
        Ok(MaterialFile::Diffuse { reflectance })
    }

    fn dielectric(&mut self, parameters: &Parameters) -> Result<MaterialFile> {
        if parameters.find("tint").is_some() {
            self.warn(&parameters.place, "the tint of a dielectric is left out");
        }
        let int_ior = self.index(parameters, ["eta", "index"], 1.5)?;
        self.faceted(parameters, 0.0, |alpha| clear(alpha, int_ior))
    }

    /// A sheet that scatters light to both sides.
    pub(super) fn diffuse_transmission(
        &mut self,
        parameters: &Parameters,
        names: [&'static str; 2],
        default: f32,
    ) -> Result<MaterialFile> {
        let scale = TextureFile::rgb([parameters.float_or("scale", 1.0)? as f32; 3]);
        let mut part = |name: &'static str| -> Result<TextureFile> {
            let albedo = self.albedo(parameters, name, default)?;
            Ok(super::textures::within(self.product(albedo, scale.clone(), &parameters.place)?))
        };
        Ok(MaterialFile::Translucent { reflectance: part(names[0])?, transmittance: part(names[1])? })
    }

    /// Two materials by their names, and the weight of the second.
    fn mix(&mut self, parameters: &Parameters) -> Result<Mix> {
        let amount = self.texture(parameters, "amount", Values::Floats)?.unwrap_or(TextureFile::rgb([0.5; 3]));
        let amount = super::textures::within(amount);
        let (names, amount) = match parameters.strings("materials")? {
            Some([first, second]) => ([first.clone(), second.clone()], amount),
            Some(_) => return Err(parameters.malformed("a mix needs two materials")),
            None => {
                let named = |name| Ok(parameters.string(name)?.map(str::to_owned));
                let missing = || parameters.malformed("a mix needs \"string materials\" with two names");
                let first = named("namedmaterial1")?.ok_or_else(missing)?;
                let second = named("namedmaterial2")?.ok_or_else(missing)?;
                // v3 has the amount of the first.
                ([second, first], amount)
            }
        };
        let own = |name: String| self.materials.get(&name).cloned().unwrap_or(name);
        Ok(Mix { materials: names.map(own), amount })
    }
}

/// Glass.
pub fn clear(alpha: f32, int_ior: f32) -> MaterialFile {
    match alpha {
        0.0 => MaterialFile::Dielectric { int_ior, ext_ior: 1.0 },
        _ => MaterialFile::RoughDielectric { alpha, distribution: Distribution::Ggx, int_ior, ext_ior: 1.0 },
    }
}

/// A clear coat over a diffuse base.
pub fn plastic(alpha: f32, int_ior: f32, diffuse: TextureFile, specular: TextureFile) -> MaterialFile {
    MaterialFile::Plastic {
        alpha,
        distribution: Distribution::Ggx,
        int_ior,
        ext_ior: 1.0,
        diffuse_reflectance: diffuse,
        specular_reflectance: specular,
        nonlinear: true,
    }
}

/// A mirror or a metal on both sides.
pub fn mirror(tint: TextureFile) -> MaterialFile {
    Metal::mirror(tint).surface(0.0)
}

/// Whether light passes some part of the material.
fn lets_light_through(material: &MaterialFile) -> bool {
    material.parts().iter().any(|part| match part {
        MaterialFile::Null {}
        | MaterialFile::Dielectric { .. }
        | MaterialFile::ThinDielectric { .. }
        | MaterialFile::RoughDielectric { .. }
        | MaterialFile::Translucent { .. } => true,
        MaterialFile::Principled(file) => file.spec_trans > 0.0,
        _ => false,
    })
}
