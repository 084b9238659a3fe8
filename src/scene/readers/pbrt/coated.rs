//! Materials with layers or depth: coats, skins, hair.

use crate::base::Result;
use crate::materials::texture::luminance;
use crate::scene::file::{MaterialFile, TextureFile};
use crate::scene::readers::conductors::reflectance_of;

use super::Reader;
use super::materials::plastic;
use super::parameters::Parameters;
use super::roughness::Metal;
use super::textures::Values;

impl Reader {
    /// A dielectric coat over a diffuse base. What is in the coat is left out.
    pub(super) fn coated_diffuse(&mut self, parameters: &Parameters) -> Result<MaterialFile> {
        let diffuse = self.albedo(parameters, "reflectance", 0.5)?;
        self.coat(parameters, ["thickness", "g", "albedo"])?;
        let int_ior = self.index(parameters, ["eta", "index"], 1.5)?;
        self.faceted(parameters, 0.0, |alpha| plastic(alpha, int_ior, diffuse, TextureFile::rgb([1.0; 3])))
    }

    /// What lies between the coat and the base.
    fn coat(&mut self, parameters: &Parameters, [thickness, g, albedo]: [&'static str; 3]) -> Result<()> {
        parameters.ignore(&["maxdepth", "nsamples", thickness, g]);
        let color = self.albedo(parameters, albedo, 0.0)?;
        if color != TextureFile::rgb([0.0; 3]) {
            self.warn(&parameters.place, "what scatters within a coat is left out");
        }
        Ok(())
    }

    /// A dielectric coat over a metal: the metal as it is inside of the coat, and as much of a mirror as the coat reflects at normal
    /// incidence.
    pub(super) fn coated_conductor(&mut self, parameters: &Parameters) -> Result<MaterialFile> {
        self.warn(&parameters.place, "a coatedconductor is read as a metal and a mirror, mixed");
        self.coat(parameters, ["thickness", "g", "albedo"])?;
        let names = ["interface.roughness", "interface.uroughness", "interface.vroughness"];
        let coat = self.even_roughness(parameters, names, 0.0)?;
        let names = ["conductor.roughness", "conductor.uroughness", "conductor.vroughness"];
        let base = self.even_roughness(parameters, names, 0.0)?;
        parameters.ignore(&["interface.thickness"]);
        let index = self.index(parameters, ["interface.eta", "eta"], 1.5)?;
        let Metal { eta, k, tint } = self.metal(parameters, ["conductor.eta", "conductor.k", "reflectance"])?;
        // Given reflectances are those of the metal in air.
        let outside = if parameters.has("reflectance") { 1.0 } else { index };
        let metal = Metal { eta: eta.map(|n| n / outside), k: k.map(|k| k / outside), tint };
        let reflected = reflectance_of(index);
        let white = Metal::mirror(TextureFile::rgb([1.0; 3]));
        // Rays are spread by the coat on their way in and out, too.
        let parts = [metal.surface(base.hypot(coat)), white.surface(coat)];
        Ok(MaterialFile::Blend { weight: TextureFile::rgb([reflected; 3]), materials: Box::new(parts) })
    }

    /// Light that scatters under a surface comes out where it went in.
    pub(super) fn subsurface(&mut self, kind: &str, parameters: &Parameters) -> Result<MaterialFile> {
        self.warn(&parameters.place, format!("a {kind} material is read as a coat over a diffuse base"));
        let name = if kind == "kdsubsurface" { "Kd" } else { "reflectance" };
        let diffuse = match self.given_albedo(parameters, name)? {
            Some(texture) => texture,
            None if kind == "kdsubsurface" => TextureFile::rgb([0.5; 3]),
            None => TextureFile::rgb(self.scattered(parameters)?),
        };
        parameters.ignore(&["mfp", "g", "scale", "Kr", "Kt", "sigma_a", "sigma_s", "name", "preset"]);
        let int_ior = self.index(parameters, ["eta", "index"], 1.33)?;
        self.faceted(parameters, 0.0, |alpha| plastic(alpha, int_ior, diffuse, TextureFile::rgb([1.0; 3])))
    }

    /// Albedo of a half space that absorbs and scatters like this, without its surface (van de Hulst 1980, §14.4).
    fn scattered(&mut self, parameters: &Parameters) -> Result<[f32; 3]> {
        for name in ["sigma_a", "sigma_s"] {
            if parameters.find(name).is_some_and(|found| found.kind == "texture") {
                return Ok([0.5; 3]);
            }
        }
        let [absorption, scattering] = self.coefficients(parameters)?;
        Ok([0, 1, 2].map(|c| {
            let s = (absorption[c] / (absorption[c] + scattering[c]).max(f32::MIN_POSITIVE)).clamp(0.0, 1.0).sqrt();
            ((1.0 - s) * (1.0 - 0.139 * s) / (1.0 + 1.17 * s)).clamp(0.0, 1.0)
        }))
    }

    /// Hair, which strands of would be needed for: a coat over the colour of many.
    pub(super) fn hair(&mut self, parameters: &Parameters) -> Result<MaterialFile> {
        self.warn(&parameters.place, "hair is read as a rough coat over a diffuse base");
        parameters.ignore(&["eta", "beta_m", "beta_n", "alpha", "sigma_a"]);
        let given = [self.given_albedo(parameters, "reflectance")?, self.given_albedo(parameters, "color")?];
        let diffuse = match given.into_iter().flatten().next() {
            Some(texture) => texture,
            None => {
                let eumelanin = self.number(parameters, "eumelanin")?.unwrap_or(1.3);
                let pheomelanin = self.number(parameters, "pheomelanin")?.unwrap_or(0.0);
                // Absorption of the pigments (d'Eon et al. 2011), and the albedo of many strands (Chiang et al. 2016, §4.2).
                let pigments = [[0.419, 0.697, 1.37], [0.187, 0.4, 1.05]];
                let albedo = |c: usize| {
                    let absorbed: f32 = eumelanin * pigments[0][c] + pheomelanin * pigments[1][c];
                    (-5.97 * absorbed.max(0.0).sqrt()).exp().clamp(0.0, 1.0)
                };
                TextureFile::rgb([0, 1, 2].map(albedo))
            }
        };
        Ok(plastic(0.4, 1.55, diffuse, TextureFile::rgb([1.0; 3])))
    }

    /// The mean of a texture's luminance, without a warning where it is one colour.
    pub(super) fn strength(&mut self, parameters: &Parameters, name: &'static str, default: f32) -> Result<f32> {
        match self.texture(parameters, name, Values::Colors)? {
            None => Ok(default),
            Some(texture) => Ok(luminance(self.mean(&texture, &parameters.place, name)?.into())),
        }
    }
}
