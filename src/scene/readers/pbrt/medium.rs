//! Participating media.

use glam::{DMat4, DVec3};

use crate::base::Result;
use crate::scene::file::{GridFile, GridMediumFile, MediumFile};
use crate::scene::readers::frames::rounded;
use crate::scene::readers::measured::{extinction, measured};
use crate::scene::readers::spectrum::Use;

use super::Reader;
use super::parameters::Parameters;
use super::tokens::{Token, Tokens};

impl Reader {
    /// Keeps a medium by its name.
    pub(super) fn make_medium(&mut self, name: String, parameters: &mut Parameters) -> Result<()> {
        if let Some(defaults) = self.state.defaults.get("medium") {
            parameters.add_defaults(defaults);
        }
        let kind = parameters.string("type")?.unwrap_or_default().to_owned();
        let medium = match kind.as_str() {
            "homogeneous" => self.homogeneous(parameters)?,
            // The second is v3's name.
            "uniformgrid" | "heterogeneous" => self.grid_medium(&kind, parameters)?,
            _ => {
                let known = "only homogeneous ones and uniform grids are known";
                self.warn(&parameters.place, format!("a medium of the type \"{kind}\" is left out: {known}"));
                self.file.media.remove(&name);
                return Ok(());
            }
        };
        self.note_unused(parameters);
        self.places.set(format!("media.{name}"), parameters.place.clone());
        self.file.media.insert(name, medium);
        Ok(())
    }

    fn homogeneous(&mut self, parameters: &Parameters) -> Result<MediumFile> {
        let (sigma_t, albedo) = extinction(self.coefficients(parameters)?);
        let g = parameters.float_or("g", 0.0)? as f32;
        if parameters.find("Le").is_some() || parameters.find("Lescale").is_some() {
            self.warn(&parameters.place, "a medium's own light is left out");
        }
        Ok(MediumFile::Homogeneous { sigma_t, albedo, g })
    }

    /// Density on a grid in a box, by which absorption, scattering and the medium's own light scale.
    fn grid_medium(&mut self, kind: &str, parameters: &Parameters) -> Result<MediumFile> {
        let mut size = [1; 3];
        for (side, name) in size.iter_mut().zip(["nx", "ny", "nz"]) {
            *side = parameters.integer(name)?.map_or(1, |cells| u32::try_from(cells).unwrap_or(0));
        }
        let (low, high) =
            (parameters.vector("p0")?.unwrap_or(DVec3::ZERO), parameters.vector("p1")?.unwrap_or(DVec3::ONE));
        let to_world = self.state.transform * DMat4::from_translation(low) * DMat4::from_scale(high - low);
        let to_world = rounded(to_world);
        let numbers =
            |name| -> Result<Vec<f32>> { Ok(parameters.numbers(name)?.iter().map(|number| *number as f32).collect()) };
        let grid = |size, values| GridFile::Inline { size, values, to_world, fades: true };
        let (density, strengths) = (numbers("density")?, numbers("Lescale")?);
        // Only v3 has a measured medium where nothing is said.
        let coefficients = if kind == "heterogeneous" || parameters.find("preset").is_some() {
            self.coefficients(parameters)?
        } else {
            self.coefficients_or(parameters, [[1.0; 3]; 2])?
        };
        let (sigma_t, albedo) = extinction(coefficients);
        let g = parameters.float_or("g", 0.0)? as f32;
        if parameters.find("temperature").is_some() {
            self.warn(&parameters.place, "light by temperatures of a grid is left out");
        }
        let emission = match parameters.find("Le") {
            Some(found) => self.palette(parameters).color(found, Use::Light)?,
            None => [0.0; 3],
        };
        // Without strengths there is one cell, and it fades.
        let strengths = match strengths.len() {
            0 => grid([1; 3], vec![1.0]),
            1 => grid([1; 3], strengths),
            _ => grid(size, strengths),
        };
        Ok(MediumFile::Grid(Box::new(GridMediumFile {
            density: grid(size, density),
            sigma_t,
            albedo,
            albedo_grid: None,
            g,
            emission,
            emission_grid: (emission != [0.0; 3]).then_some(strengths),
        })))
    }

    /// Absorption and scattering per unit, of a medium or of what is under a surface.
    pub(super) fn coefficients(&mut self, parameters: &Parameters) -> Result<[[f32; 3]; 2]> {
        let preset = parameters.string("preset")?.or(parameters.string("name")?).unwrap_or_default().to_owned();
        let found = measured(&preset);
        if found.is_none() && !preset.is_empty() {
            self.warn(&parameters.place, format!("the measured medium \"{preset}\" is not known: whole milk is used"));
        }
        let found = found.or(measured("Wholemilk"));
        let (scattering, absorption) =
            found.map_or(([1.0; 3], [0.0; 3]), |medium| (medium.reduced(), medium.absorption));
        self.coefficients_or(parameters, [absorption, scattering])
    }

    /// The same by the defaults `absorption` and `scattering`.
    fn coefficients_or(
        &mut self,
        parameters: &Parameters,
        [absorption, scattering]: [[f32; 3]; 2],
    ) -> Result<[[f32; 3]; 2]> {
        let read = |name, default: [f32; 3]| -> Result<[f32; 3]> {
            let found = parameters.find(name);
            found.map_or(Ok(default), |found| self.palette(parameters).color(found, Use::Index))
        };
        let scale = parameters.float_or("scale", 1.0)? as f32;
        let both = [read("sigma_a", absorption)?, read("sigma_s", scattering)?];
        Ok(both.map(|color| color.map(|channel| channel * scale)))
    }

    /// The media behind and in front of the surfaces that follow.
    pub(super) fn medium_interface(&mut self, tokens: &mut Tokens) -> Result<()> {
        let inside = tokens.text("a medium's name")?;
        let outside = match tokens.peek()? {
            Some(Token::Text(_)) => tokens.text("a medium's name")?,
            _ => inside.clone(),
        };
        self.state.media = [inside, outside];
        Ok(())
    }

    /// The medium of this name; none for empty space and for media that were left out.
    pub(super) fn medium_name(&self, name: &str) -> Option<String> {
        self.file.media.contains_key(name).then(|| name.to_owned())
    }
}
