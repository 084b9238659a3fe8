//! Colours: RGB, XYZ, black bodies and spectra, by their numbers, their file or their name.
//!
//! In pbrt-v4 a light's spectrum only says its hue: it is scaled to luminance 1 before `scale` counts, while RGB colours keep their
//! luminance (Pharr, Jakob, Humphreys 2023, §12). In pbrt-v3 spectra are taken as they are.

use std::iter::once;
use std::path::Path;

use glam::DVec3;

use crate::base::files::read_bytes;
use crate::base::{Error, Place, Result};
use crate::scene::readers::conductors::conductor;
use crate::scene::readers::path;
use crate::scene::readers::spectrum::{Use, XYZ_TO_RGB, between, integrate, listed, planck, xyz};

use super::parameters::{Parameter, Values};
use super::spaces::ColorSpace;

/// Largest file of a spectrum, bytes.
const LARGEST_SPECTRUM: u64 = 1 << 22;

/// Refractive indices of pbrt's glasses at 587.6 nm (Schott's catalogue).
const GLASSES: [(&str, f32); 7] = [
    ("glass-BK7", 1.5168),
    ("glass-BAF10", 1.67),
    ("glass-FK51A", 1.4866),
    ("glass-LASF9", 1.85),
    ("glass-F5", 1.6727),
    ("glass-F10", 1.7283),
    ("glass-F11", 1.7847),
];

/// Brass after Querry 1985, eta and k at 650, 550 and 450 nm: no other reader has it.
const BRASS: [[f32; 3]; 2] = [[0.444, 0.527, 1.094], [3.695, 2.765, 1.829]];

/// Correlated colour temperatures of pbrt's illuminants, K (CIE 15:2004).
const ILLUMINANTS: [(&str, f64); 16] = [
    ("stdillum-A", 2856.0),
    ("stdillum-D50", 5003.0),
    ("stdillum-D65", 6504.0),
    ("illum-acesD60", 6000.0),
    ("stdillum-F1", 6430.0),
    ("stdillum-F2", 4230.0),
    ("stdillum-F3", 3450.0),
    ("stdillum-F4", 2940.0),
    ("stdillum-F5", 6350.0),
    ("stdillum-F6", 4150.0),
    ("stdillum-F7", 6500.0),
    ("stdillum-F8", 5000.0),
    ("stdillum-F9", 4150.0),
    ("stdillum-F10", 5000.0),
    ("stdillum-F11", 4000.0),
    ("stdillum-F12", 3000.0),
];

/// What colours are read by.
#[derive(Clone, Copy)]
pub struct Palette<'a> {
    /// The scene's folder.
    pub folder: &'a Path,
    /// The space of RGB colours.
    pub space: ColorSpace,
    /// Whether spectra of lights are taken as they are, as in pbrt-v3.
    pub as_is: bool,
}

/// A spectrum.
enum Spectrum {
    /// Wavelengths in nm and values.
    Points(Vec<(f64, f64)>),
    /// A black body of this temperature in K, times a factor on its largest value; without one it is that of a v4 light.
    BlackBody(f64, Option<f64>),
    /// Known by its colour alone, which has luminance 1 if it is a light's.
    Color([f32; 3]),
}

impl Palette<'_> {
    /// The colour of a parameter.
    ///
    /// # Errors
    /// [`Error::Malformed`], [`Error::Unsupported`] with the names that are known; those of reading a file.
    pub fn color(&self, parameter: &Parameter, purpose: Use) -> Result<[f32; 3]> {
        let rounded = |color: DVec3| color.as_vec3().to_array();
        match parameter.kind.as_str() {
            "rgb" | "color" => Ok(rounded(self.space.to_srgb(triple(parameter)?))),
            "xyz" => Ok(rounded((XYZ_TO_RGB * triple(parameter)?).max(DVec3::ZERO))),
            "float" | "integer" | "spectrum" if matches!(&parameter.values, Values::Numbers(n) if n.len() == 1) => {
                Ok([parameter.numbers()?[0] as f32; 3])
            }
            "blackbody" => {
                let spectrum = match parameter.numbers()? {
                    [kelvin] => Spectrum::BlackBody(*kelvin, None),
                    [kelvin, scale] => Spectrum::BlackBody(*kelvin, Some(*scale)),
                    _ => return Err(parameter.expected("a temperature in K")),
                };
                self.seen(parameter, &spectrum, purpose)
            }
            "spectrum" => {
                let spectrum = match &parameter.values {
                    Values::Numbers(numbers) => Spectrum::Points(pairs(numbers).ok_or_else(|| disordered(parameter))?),
                    _ => self.named(parameter, parameter.text()?)?,
                };
                self.seen(parameter, &spectrum, purpose)
            }
            _ => Err(parameter.expected("a colour: of the type rgb, blackbody or spectrum")),
        }
    }

    /// The colour of a spectrum.
    fn seen(&self, parameter: &Parameter, spectrum: &Spectrum, purpose: Use) -> Result<[f32; 3]> {
        match spectrum {
            Spectrum::Color(color) => Ok(*color),
            Spectrum::Points(points) if purpose == Use::Light && !self.as_is => {
                bright(parameter, xyz(|nm| between(points, nm), purpose))
            }
            Spectrum::Points(points) if self.as_is => {
                // Beyond its ends a spectrum of v3 goes on.
                let [first, last] = [points.first(), points.last()].map(|end| end.map_or(0.0, |(_, value)| *value));
                let all: Vec<_> = once((0.0, first)).chain(points.iter().copied()).chain(once((1e6, last))).collect();
                Ok(listed(&all, purpose))
            }
            Spectrum::Points(points) => Ok(listed(points, purpose)),
            Spectrum::BlackBody(kelvin, _) if *kelvin <= 0.0 => {
                Err(parameter.malformed(format!("the temperature is {kelvin} K, expected more than 0 K")))
            }
            Spectrum::BlackBody(kelvin, None) if purpose == Use::Light => {
                bright(parameter, xyz(|nm| planck(*kelvin, nm), purpose))
            }
            Spectrum::BlackBody(kelvin, scale) => {
                // Wien's displacement law.
                let most = planck(*kelvin, 2.897_771_955e6 / kelvin);
                Ok(integrate(|nm| scale.unwrap_or(1.0) * planck(*kelvin, nm) / most, purpose))
            }
        }
    }

    /// The spectrum of a name, or in a file.
    fn named(&self, parameter: &Parameter, name: &str) -> Result<Spectrum> {
        if let Some(color) = by_name(name) {
            return Ok(Spectrum::Color(color));
        }
        match path::resolve(self.folder, name, &parameter.place) {
            Ok(path) => self.file(parameter, &path),
            Err(_) if !name.contains(['.', '/']) => {
                let names = GLASSES.iter().map(|(name, _)| *name).chain(ILLUMINANTS.iter().map(|(name, _)| *name));
                let metals = ["metal-Ag-eta", "metal-Ag-k", "… of Al, Au, Cu, CuZn, MgO, TiO2", "a file"];
                let supported = names.chain(metals).collect::<Vec<_>>().join(", ");
                let (place, what) = (parameter.place.clone(), format!("the spectrum \"{name}\""));
                Err(Error::Unsupported { place, what, supported })
            }
            Err(error) => match by_name(&metal_of_file(name)) {
                Some(color) => Ok(Spectrum::Color(color)),
                None => Err(error),
            },
        }
    }

    /// The spectrum in the file at `path`: wavelengths and values in turn.
    fn file(&self, parameter: &Parameter, path: &Path) -> Result<Spectrum> {
        let bytes = read_bytes(path, LARGEST_SPECTRUM)?;
        let (mut numbers, text) = (Vec::new(), String::from_utf8_lossy(&bytes));
        for (line, number) in text.lines().zip(1u32..) {
            let line = line.split('#').next().unwrap_or_default();
            for word in line.split([' ', '\t', ',', '\r']).filter(|word| !word.is_empty()) {
                let value = word.parse::<f64>().ok().filter(|value| (*value as f32).is_finite());
                let wrong = || Error::malformed(Place::line(path, number), "expected wavelengths and values");
                numbers.push(value.ok_or_else(wrong)?);
            }
        }
        pairs(&numbers).map(Spectrum::Points).ok_or_else(|| disordered(parameter))
    }
}

/// The colour of a spectrum with these XYZ, scaled to luminance 1.
fn bright(parameter: &Parameter, xyz: DVec3) -> Result<[f32; 3]> {
    let color = (XYZ_TO_RGB * xyz / xyz.y).max(DVec3::ZERO);
    if xyz.y > 0.0 && color.is_finite() {
        return Ok(color.as_vec3().to_array());
    }
    Err(parameter.malformed("the spectrum is black where it can be seen"))
}

fn triple(parameter: &Parameter) -> Result<DVec3> {
    match parameter.numbers()? {
        [r, g, b] => Ok(DVec3::new(*r, *g, *b)),
        _ => Err(parameter.expected("three numbers")),
    }
}

/// Pairs of wavelengths and values; none unless wavelengths grow.
fn pairs(numbers: &[f64]) -> Option<Vec<(f64, f64)>> {
    let (pairs, []) = numbers.as_chunks::<2>() else { return None };
    let points: Vec<(f64, f64)> = pairs.iter().map(|[wavelength, value]| (*wavelength, *value)).collect();
    (!points.is_empty() && points.windows(2).all(|pair| pair[0].0 < pair[1].0)).then_some(points)
}

fn disordered(parameter: &Parameter) -> Error {
    parameter.malformed("a spectrum needs pairs of wavelengths, which grow, and values")
}

/// `metal-Cu-eta` for a file such as `spds/Cu.eta.spd`, which pbrt-v3's scenes bring along.
fn metal_of_file(name: &str) -> String {
    let file = name.rsplit('/').next().unwrap_or(name);
    format!("metal-{}", file.strip_suffix(".spd").unwrap_or(file).replace('.', "-"))
}

/// The colour of one of pbrt's spectra.
fn by_name(name: &str) -> Option<[f32; 3]> {
    if let Some((_, index)) = GLASSES.iter().find(|(known, _)| *known == name) {
        return Some([*index; 3]);
    }
    if let Some((_, kelvin)) = ILLUMINANTS.iter().find(|(known, _)| *known == name) {
        return Some(illuminant(*kelvin));
    }
    let (metal, part) = name.strip_prefix("metal-")?.split_once('-')?;
    let (eta, k) = if metal == "CuZn" { (BRASS[0], BRASS[1]) } else { conductor(metal)? };
    match part {
        "eta" => Some(eta),
        "k" => Some(k),
        _ => None,
    }
}

/// Colour with luminance 1 of light with this correlated colour temperature: of a black body below 4000 K, of daylight above.
fn illuminant(kelvin: f64) -> [f32; 3] {
    let color = match kelvin {
        // White itself.
        6504.0 => DVec3::ONE,
        ..4000.0 => {
            let xyz = xyz(|nm| planck(kelvin, nm), Use::Light);
            XYZ_TO_RGB * xyz / xyz.y
        }
        _ => {
            // Chromaticity of daylight (CIE 15:2004, §3.1).
            let t = 1e3 / kelvin;
            let x = ((-4.6070 * t + 2.9678) * t + 0.09911) * t + 0.244063;
            let y = (-3.0 * x + 2.870) * x - 0.275;
            XYZ_TO_RGB * DVec3::new(x / y, 1.0, (1.0 - x - y) / y)
        }
    };
    color.max(DVec3::ZERO).as_vec3().to_array()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_colours() {
        for (name, ..) in GLASSES {
            assert!(by_name(name).is_some_and(|[r, g, b]| r == g && g == b && r > 1.4), "{name}");
        }
        for (name, ..) in ILLUMINANTS {
            let [r, g, b] = by_name(name).unwrap();
            assert!((0.2126 * r + 0.7152 * g + 0.0722 * b - 1.0).abs() < 2e-2, "{name}: {r} {g} {b}");
        }
        for metal in ["Ag", "Al", "Au", "Cu", "CuZn", "MgO", "TiO2"] {
            assert!(by_name(&format!("metal-{metal}-eta")).is_some() && by_name(&format!("metal-{metal}-k")).is_some());
        }
        for name in ["metal-Cu", "metal-Xy-eta", "metal-Cu-x", "glass", ""] {
            assert_eq!(by_name(name), None, "{name}");
        }
        assert_eq!(metal_of_file("spds/Cu.eta.spd"), "metal-Cu-eta");
        // The D50 of the CIE is yellower than D65, A redder.
        let [r, _, b] = by_name("stdillum-A").unwrap();
        assert!(r > 1.5 && b < 0.3, "{r} {b}");
    }
}
