//! Participating media.

use crate::base::Result;
use crate::scene::file::MediumFile;
use crate::scene::readers::measured::measured;
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
        if kind != "homogeneous" {
            self.warn(
                &parameters.place,
                format!("a medium of the type \"{kind}\" is left out: only homogeneous ones are known"),
            );
            self.file.media.remove(&name);
            return Ok(());
        }
        let [absorption, scattering] = self.coefficients(parameters)?;
        let g = parameters.float_or("g", 0.0)?;
        if parameters.find("Le").is_some() || parameters.find("Lescale").is_some() {
            self.warn(&parameters.place, "a medium's own light is left out");
        }
        let albedo = |c: usize| {
            let sum = absorption[c] + scattering[c];
            if sum > 0.0 { scattering[c] / sum } else { 0.0 }
        };
        let medium = MediumFile::Homogeneous {
            sigma_t: [0, 1, 2].map(|c| absorption[c] + scattering[c]),
            albedo: [0, 1, 2].map(albedo),
            g: g as f32,
        };
        self.note_unused(parameters);
        self.places.set(format!("media.{name}"), parameters.place.clone());
        self.file.media.insert(name, medium);
        Ok(())
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
