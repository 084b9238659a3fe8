//! Participating media.

use crate::base::Result;
use crate::scene::file::MediumFile;
use crate::scene::readers::spectrum::Use;

use super::Reader;
use super::parameters::Parameters;
use super::tokens::{Token, Tokens};

/// Name, reduced scattering and absorption per mm of measured media (Jensen et al. 2001, fig. 5).
const MEASURED: [(&str, [f32; 3], [f32; 3]); 12] = [
    ("Apple", [2.29, 2.39, 1.97], [0.0030, 0.0034, 0.046]),
    ("Chicken1", [0.15, 0.21, 0.38], [0.015, 0.077, 0.19]),
    ("Chicken2", [0.19, 0.25, 0.32], [0.018, 0.088, 0.20]),
    ("Cream", [7.38, 5.47, 3.15], [0.0002, 0.0028, 0.0163]),
    ("Ketchup", [0.18, 0.07, 0.03], [0.061, 0.97, 1.45]),
    ("Marble", [2.19, 2.62, 3.00], [0.0021, 0.0041, 0.0071]),
    ("Potato", [0.68, 0.70, 0.55], [0.0024, 0.0090, 0.12]),
    ("Skimmilk", [0.70, 1.22, 1.90], [0.0014, 0.0025, 0.0142]),
    ("Skin1", [0.74, 0.88, 1.01], [0.032, 0.17, 0.48]),
    ("Skin2", [1.09, 1.59, 1.79], [0.013, 0.070, 0.145]),
    ("Spectralon", [11.6, 20.4, 14.9], [0.0, 0.0, 0.0]),
    ("Wholemilk", [2.55, 3.21, 3.77], [0.0011, 0.0024, 0.014]),
];

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
        let found = MEASURED.iter().find(|(name, ..)| *name == preset);
        if found.is_none() && !preset.is_empty() {
            self.warn(&parameters.place, format!("the measured medium \"{preset}\" is not known: whole milk is used"));
        }
        let (_, scattering, absorption) = found.unwrap_or(&MEASURED[11]);
        let read = |name, default: &[f32; 3]| -> Result<[f32; 3]> {
            let found = parameters.find(name);
            found.map_or(Ok(*default), |found| self.palette(parameters).color(found, Use::Index))
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
