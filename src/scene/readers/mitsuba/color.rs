//! Colours: linear or sRGB numbers, and spectra, which become linear RGB as in Mitsuba 3's RGB mode.

use glam::{DMat3, DVec3};

use crate::base::Result;
use crate::math::srgb;

use super::cie::{FIRST, STEP, TABLE};
use super::element::{Element, number, numbers};

/// The use of a colour, which decides what a spectrum's colour is relative to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Use {
    /// A reflectance: seen under D65, within [0, 1].
    Reflectance,
    /// A refractive index: seen under D65, not bounded.
    Index,
    /// Emitted light: as it is, so that equal power at all wavelengths is not quite white.
    Light,
}

/// The tags that [`read`] knows.
pub const TAGS: [&str; 6] = ["rgb", "srgb", "spectrum", "blackbody", "float", "integer"];

/// XYZ to linear sRGB (IEC 61966-2-1).
const XYZ_TO_RGB: DMat3 = DMat3::from_cols(
    DVec3::new(3.240479, -0.969256, 0.055648),
    DVec3::new(-1.537150, 1.875991, -0.204043),
    DVec3::new(-0.498535, 0.041556, 1.057311),
);

/// Reads a colour of any kind. A spectrum in a file is not read here.
pub fn read(element: &Element, purpose: Use) -> Result<[f32; 3]> {
    match element.tag.as_str() {
        "srgb" => Ok(triple(element)?.map(srgb::linear)),
        "spectrum" => spectrum(element, purpose),
        "blackbody" => {
            element.only_attributes(&["id", "name", "temperature", "scale"])?;
            let scale = element.attribute("scale").map_or(Ok(1.0), |text| number(element, text))?;
            black_body(element, element.required("temperature")?, scale, purpose)
        }
        _ => triple(element),
    }
}

/// One number, three numbers, or `#rrggbb`, whose values are always sRGB.
fn triple(element: &Element) -> Result<[f32; 3]> {
    let text = value(element)?;
    if let Some(digits) = text.trim().strip_prefix('#') {
        let code = (digits.len() == 6).then(|| u32::from_str_radix(digits, 16).ok()).flatten();
        let code = code.ok_or_else(|| element.malformed(format!("\"{text}\" is not a colour such as #ff8000")))?;
        let channels = [code >> 16, code >> 8, code].map(|channel| (channel & 0xFF) as f32 / 255.0);
        // An <srgb> is converted by the caller.
        return Ok(if element.tag == "srgb" { channels } else { channels.map(srgb::linear) });
    }
    match numbers(element, text)?.as_slice() {
        [grey] => Ok([*grey as f32; 3]),
        [r, g, b] if element.tag.ends_with("rgb") => Ok([*r as f32, *g as f32, *b as f32]),
        other => Err(element.unsupported(
            format!("<{}> with {} numbers", element.tag, other.len()),
            &["one number", "<rgb> with three or #rrggbb"],
        )),
    }
}

fn value(element: &Element) -> Result<&str> {
    element.only_attributes(&["id", "name", "value"])?;
    element.no_children()?;
    element.required("value")
}

fn spectrum(element: &Element, purpose: Use) -> Result<[f32; 3]> {
    let flat = |value: f64| match purpose {
        Use::Light => integrate(|_| value, purpose),
        _ => [value as f32; 3],
    };
    let Some(kind) = element.attribute("type") else {
        element.only_attributes(&["id", "name", "value", "unit"])?;
        element.no_children()?;
        let text = element.required("value")?;
        if text.contains(':') {
            return Ok(listed(&pairs(element, text)?, purpose));
        }
        return match numbers(element, text)?.as_slice() {
            [value] => Ok(flat(*value)),
            other => Err(element.unsupported(
                format!("<spectrum> with {} numbers", other.len()),
                &["one number", "wavelength:value pairs", "<rgb>"],
            )),
        };
    };
    element.only_attributes(&["id", "name", "type"])?;
    let given = |name: &str| element.children.iter().find(|child| child.attribute("name") == Some(name));
    let text = |name: &str| {
        let missing = || element.malformed(format!("the spectrum \"{kind}\" lacks the property \"{name}\""));
        given(name).and_then(|child| child.attribute("value")).ok_or_else(missing)
    };
    let optional = |name: &str| given(name).map_or(Ok(1.0), |_| number(element, text(name)?));
    match kind {
        "uniform" => Ok([optional("value")? as f32; 3]),
        "d65" => Ok([optional("scale")? as f32; 3]),
        "rgb" | "srgb" => given("color").or(given("value")).map_or(Ok([1.0; 3]), triple),
        "blackbody" => black_body(element, text("temperature")?, optional("scale")?, purpose),
        "regular" => {
            let values = numbers(element, text("values")?)?;
            let ends = [number(element, text("wavelength_min")?)?, number(element, text("wavelength_max")?)?];
            let step = (ends[1] - ends[0]) / values.len().saturating_sub(1).max(1) as f64;
            let points: Vec<_> = (0..).map(|i| ends[0] + f64::from(i) * step).zip(values).collect();
            Ok(listed(&sorted(element, points)?, purpose))
        }
        "irregular" => {
            let points: Vec<_> =
                numbers(element, text("wavelengths")?)?.into_iter().zip(numbers(element, text("values")?)?).collect();
            Ok(listed(&sorted(element, points)?, purpose))
        }
        other => {
            let known = ["uniform", "d65", "rgb", "srgb", "blackbody", "regular", "irregular"];
            Err(element.unsupported(format!("spectrum \"{other}\""), &known))
        }
    }
}

/// Parses wavelengths and values such as `400:0.1, 700:0.9`.
fn pairs(element: &Element, text: &str) -> Result<Vec<(f64, f64)>> {
    let words = text.split(|c: char| c.is_whitespace() || c == ',').filter(|word| !word.is_empty());
    let pair = |word: &str| {
        let malformed = || element.malformed(format!("\"{word}\" is not a pair wavelength:value"));
        let (wavelength, value) = word.split_once(':').ok_or_else(malformed)?;
        Ok((number(element, wavelength)?, number(element, value)?))
    };
    sorted(element, words.map(pair).collect::<Result<_>>()?)
}

/// Returns the points if there are any and their wavelengths increase.
fn sorted(element: &Element, points: Vec<(f64, f64)>) -> Result<Vec<(f64, f64)>> {
    if points.is_empty() || points.windows(2).any(|pair| pair[0].0 >= pair[1].0) {
        return Err(element.malformed("a spectrum needs wavelengths that grow"));
    }
    Ok(points)
}

/// A spectrum that is linear between `points` (nm, value) and zero beyond them.
fn listed(points: &[(f64, f64)], purpose: Use) -> [f32; 3] {
    let at = |wavelength: f64| {
        let above = points.partition_point(|point| point.0 < wavelength);
        match (above.checked_sub(1).map(|below| points[below]), points.get(above)) {
            (Some((x0, y0)), Some((x1, y1))) => y0 + (y1 - y0) * (wavelength - x0) / (x1 - x0),
            (None, Some((x, y))) if *x == wavelength => *y,
            _ => 0.0,
        }
    };
    integrate(at, purpose)
}

/// Colour of a black body by Planck's law, W·m⁻²·sr⁻¹·nm⁻¹.
fn black_body(element: &Element, temperature: &str, scale: f64, purpose: Use) -> Result<[f32; 3]> {
    let kelvin = number(element, temperature.trim().trim_end_matches(['K', 'k']))?;
    if kelvin <= 0.0 {
        return Err(element.malformed(format!("the temperature is {kelvin} K, expected more than 0 K")));
    }
    const H: f64 = 6.626_070_15e-34;
    const C: f64 = 2.997_924_58e8;
    const K: f64 = 1.380_649e-23;
    let planck = |nm: f64| {
        let wavelength = nm * 1e-9;
        2e-9 * H * C * C / wavelength.powi(5) / ((H * C / (wavelength * K * kelvin)).exp() - 1.0)
    };
    Ok(integrate(|nm| scale * planck(nm), purpose))
}

/// Linear RGB of a spectrum, relative to one that is 1 everywhere and has luminance 1. Colours outside RGB's gamut are
/// clamped.
pub(super) fn integrate(spectrum: impl Fn(f64) -> f64, purpose: Use) -> [f32; 3] {
    /// Number of steps between two rows of the table.
    const STEPS: usize = 10;
    let (mut sum, mut white) = (DVec3::ZERO, 0.0);
    for i in 0..(TABLE.len() - 1) * STEPS + 1 {
        let (row, part) = (i / STEPS, (i % STEPS) as f64 / STEPS as f64);
        let next = &TABLE[(row + 1).min(TABLE.len() - 1)];
        let [x, y, z, d65] = std::array::from_fn(|k| TABLE[row][k] + (next[k] - TABLE[row][k]) * part);
        let light = if purpose == Use::Light { 1.0 } else { d65 };
        sum += DVec3::new(x, y, z) * light * spectrum(FIRST + STEP * (row as f64 + part));
        white += y * light;
    }
    let rgb = (XYZ_TO_RGB * sum / white).max(DVec3::ZERO);
    let rgb = if purpose == Use::Reflectance { rgb.min(DVec3::ONE) } else { rgb };
    rgb.as_vec3().to_array()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Colours that Mitsuba 3.9.1 gives (`scalar_rgb`), within half a percent: its tables are summed at other wavelengths.
    #[test]
    fn spectra_have_the_colours_of_mitsuba() {
        let close = |ours: [f32; 3], theirs: [f32; 3]| {
            assert!((0..3).all(|i| (ours[i] - theirs[i]).abs() < 5e-3 * theirs[i].max(0.5)), "{ours:?} {theirs:?}");
        };
        let ramp = |nm: f64| if (400.0..=700.0).contains(&nm) { 0.1 + 0.8 * (nm - 400.0) / 300.0 } else { 0.0 };
        close(integrate(ramp, Use::Reflectance), [0.742853, 0.48114, 0.208325]);
        close(integrate(ramp, Use::Light), [0.872215, 0.458728, 0.181301]);
        close(integrate(|_| 1.0, Use::Reflectance), [0.998985, 0.998874, 0.998802]);
        close(integrate(|_| 1.0, Use::Light), [1.20488, 0.948228, 0.909267]);
    }
}
