//! Colours: linear or sRGB numbers, and spectra, which become linear RGB as in Mitsuba 3's RGB mode.

use crate::base::Result;
use crate::math::srgb;
use crate::scene::readers::spectrum::{Use, integrate, listed, planck};

use super::element::{Element, number, numbers};
use super::upgrade::OLD_SPECTRUM;

/// The tags that [`read`] knows.
pub const TAGS: [&str; 6] = ["rgb", "srgb", "spectrum", "blackbody", "float", "integer"];

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
    if kind == OLD_SPECTRUM {
        element.only_attributes(&["id", "name", "value", "type", "unit"])?;
        element.no_children()?;
        let color = listed(&pairs(element, element.required("value")?)?, Use::Light);
        let most = if purpose == Use::Reflectance { 1.0 } else { f32::INFINITY };
        return Ok(color.map(|channel| channel.min(most)));
    }
    element.only_attributes(&["id", "name", "type"])?;
    let given = |name: &str| element.children.iter().find(|child| child.attribute("name") == Some(name));
    let text = |name: &str| {
        let missing = || element.malformed(format!("the spectrum \"{kind}\" lacks the property \"{name}\""));
        given(name).and_then(|child| child.attribute("value")).ok_or_else(missing)
    };
    let optional = |name: &str| given(name).map_or(Ok(1.0), |_| number(element, text(name)?));
    match kind {
        "uniform" => Ok([optional("value")? as f32; 3]),
        "d65" => {
            let color = given("color").filter(|color| color.tag != "spectrum").map_or(Ok([1.0; 3]), triple)?;
            let scale = optional("scale")? as f32;
            Ok(color.map(|channel| scale * channel))
        }
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

/// Colour of a black body, W·m⁻²·sr⁻¹·nm⁻¹.
fn black_body(element: &Element, temperature: &str, scale: f64, purpose: Use) -> Result<[f32; 3]> {
    let kelvin = number(element, temperature.trim().trim_end_matches(['K', 'k']))?;
    if kelvin <= 0.0 {
        return Err(element.malformed(format!("the temperature is {kelvin} K, expected more than 0 K")));
    }
    Ok(integrate(|nm| scale * planck(kelvin, nm), purpose))
}
