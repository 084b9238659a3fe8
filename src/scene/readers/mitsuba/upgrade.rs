//! The dialect of Mitsuba 0.4 to 0.6, turned into that of Mitsuba 3 before anything is read: one pass over the tree that
//! renames elements and properties and writes out defaults that have changed.

use std::collections::BTreeMap;

use glam::DVec3;

use crate::base::Result;

use super::element::{Element, numbers};

/// Type that the `sunsky` of Mitsuba 0.6 gets in the upgrade.
pub const OLD_SUNSKY: &str = "sunsky 0.6";

/// Type that the `gridvolume` of Mitsuba 0.6 gets in the upgrade: it fills its file's box, from centre to centre.
pub const OLD_GRID: &str = "gridvolume 0.6";

/// Type that a spectrum of `wavelength:value` pairs of Mitsuba 0.6 gets in the upgrade: its colours are seen under equal energy.
pub const OLD_SPECTRUM: &str = "spectrum 0.6";

/// Renamed elements: the old and the new tag.
const TAGS: [(&str, &str); 2] = [("luminaire", "emitter"), ("camera", "sensor")];

/// Element, and a type that other versions and other programs call otherwise.
const TYPES: [(&str, &str, &str); 8] = [
    ("bsdf", "lambertian", "diffuse"),
    ("bsdf", "roughglass", "roughdielectric"),
    ("bsdf", "disneybsdf", "principled"),
    ("bsdf", "disney", "principled"),
    ("texture", "ldrtexture", "bitmap"),
    ("texture", "exrtexture", "bitmap"),
    ("sensor", "perspective_rdist", "perspective"),
    ("sensor", "telecentric", "orthographic"),
];

/// Element, its type (empty for any), the property's old name in snake case, and its new name.
const PROPERTIES: [(&str, &str, &str, &str); 10] = [
    ("bsdf", "principled", "specular_transmission", "spec_trans"),
    ("bsdf", "principled", "specular_tint", "spec_tint"),
    ("bsdf", "principled", "subsurface", "flatness"),
    ("bsdf", "diffuse", "diffuse_reflectance", "reflectance"),
    ("bsdf", "roughdiffuse", "diffuse_reflectance", "reflectance"),
    ("emitter", "area", "intensity", "radiance"),
    ("emitter", "constant", "intensity", "radiance"),
    ("emitter", "directional", "intensity", "irradiance"),
    ("emitter", "envmap", "intensity_scale", "scale"),
    ("sensor", "thinlens", "focus_depth", "focus_distance"),
];

/// Element and its properties that do not affect the picture's radiance: how samples are drawn, files are cached or written.
const WITHOUT_MEANING: [(&str, &[&str]); 4] = [
    ("texture", &["cache", "max_anisotropy"]),
    ("emitter", &["cache", "sampling_weight"]),
    ("shape", &["collapse"]),
    ("sensor", &["kc", "aperture_blades", "blades"]),
];

/// Upgrades the document `scene` if its version asks for that.
pub fn document(scene: &mut Element, warnings: &mut Vec<String>) -> Result<()> {
    scene.only_attributes(&["version", "type", "id"])?;
    rename_types(scene);
    match scene.attribute("version").map(|version| version.split('.').next().unwrap_or_default()) {
        Some("2" | "3") => return Ok(()),
        Some("0") => {}
        Some(_) => {
            let version = scene.required("version")?;
            return Err(scene.unsupported(format!("scene version {version}"), &["0.4 to 0.6", "2.x", "3.x"]));
        }
        None => warnings.push(format!("{}: the scene has no version: read as 0.6", scene.place)),
    }
    upgrade(scene, warnings);
    Ok(())
}

/// Gives objects of `element` the types that they have here.
fn rename_types(element: &mut Element) {
    for child in &mut element.children {
        let known = |(tag, old, _): &&(&str, &str, &str)| *tag == child.tag && child.attribute("type") == Some(*old);
        if let Some((.., new)) = TYPES.iter().find(known) {
            child.set("type", (*new).to_owned());
        }
        rename_types(child);
    }
}

/// Upgrades `element` and all that is in it; warns of what cannot be kept.
fn upgrade(element: &mut Element, warnings: &mut Vec<String>) {
    if element.upgraded {
        return;
    }
    if let Some((_, new)) = TAGS.iter().find(|(old, _)| *old == element.tag) {
        element.tag = (*new).to_owned();
    }
    let kind = element.attribute("type").unwrap_or_default().to_owned();
    for child in &mut element.children {
        upgrade(child, warnings);
        // What a shape's material is called is the name of faces in its file.
        let names_faces = element.tag == "shape" && (child.tag == "bsdf" || child.tag == "ref" && !is_medium(child));
        if !child.upgraded && !names_faces {
            rename(child, &element.tag, &kind);
        }
    }
    keep_last(element, warnings);
    let ignored = WITHOUT_MEANING.iter().find(|(tag, _)| *tag == element.tag).map_or(&[][..], |(_, names)| names);
    element.children.retain(|child| !child.attribute("name").is_some_and(|name| ignored.contains(&name)));
    match (element.tag.as_str(), kind.as_str()) {
        ("texture", "bitmap") => {
            gamma(element, warnings);
            texture_transform(element);
        }
        ("texture", _) => texture_transform(element),
        ("bsdf", "conductor" | "roughconductor") => {
            copper(element);
            conserve(element, warnings);
        }
        ("bsdf", _) => conserve(element, warnings),
        ("shape", _) => matched_border(element),
        ("medium", "homogeneous") => skin(element),
        // The same name, but another frame, another sun and other defaults.
        ("emitter", "sunsky") => element.set("type", OLD_SUNSKY.to_owned()),
        ("volume", "gridvolume") => element.set("type", OLD_GRID.to_owned()),
        ("spectrum", "") => plain_numbers(element),
        ("lookat" | "look_at", _) => look_up(element),
        ("rgb" | "srgb", _) => leave_out_intent(element),
        _ => {}
    }
}

/// Whether a reference is to a medium, by its name.
fn is_medium(reference: &Element) -> bool {
    let is = |known: &str| reference.attribute("name").is_some_and(|name| name.eq_ignore_ascii_case(known));
    is("interior") || is("exterior")
}

fn rename(property: &mut Element, tag: &str, kind: &str) {
    let Some(name) = property.attribute("name") else { return };
    let name = snake_case(name);
    let fits = |row: &&(&str, &str, &str, &str)| row.0 == tag && row.1 == kind && row.2 == name;
    let name = PROPERTIES.iter().find(fits).map_or(name.clone(), |row| row.3.to_owned());
    property.set("name", name);
}

/// `intIOR` becomes `int_ior`: a small letter before capitals begins a word.
fn snake_case(name: &str) -> String {
    let mut out = String::with_capacity(name.len() + 4);
    let mut small_before = false;
    for letter in name.chars() {
        if small_before && letter.is_ascii_uppercase() {
            out.push('_');
        }
        small_before = letter.is_ascii_lowercase();
        out.push(if out.contains('_') { letter.to_ascii_lowercase() } else { letter });
    }
    out
}

/// `uscale`, `vscale`, `uoffset`, `voffset` become `to_uv`, which scales first as Mitsuba 0.6 does; Mitsuba 3 shifts first when it
/// upgrades such a file.
fn texture_transform(element: &mut Element) {
    let number = |name: &str, element: &Element| {
        let child = element.children.iter().find(|child| child.attribute("name") == Some(name));
        child.and_then(|child| child.attribute("value").map(str::to_owned))
    };
    let names = ["uscale", "vscale", "uoffset", "voffset"];
    let [us, vs, uo, vo] = names.map(|name| number(name, element));
    if [&us, &vs, &uo, &vo].iter().all(|value| value.is_none()) {
        return;
    }
    element.children.retain(|child| !child.attribute("name").is_some_and(|name| names.contains(&name)));
    let axes = |tag: &str, [x, y]: [Option<String>; 2], default: &str| {
        let mut step = element.like(tag);
        step.set("x", x.unwrap_or_else(|| default.to_owned()));
        step.set("y", y.unwrap_or_else(|| default.to_owned()));
        step
    };
    let mut transform = element.like("transform");
    transform.set("name", "to_uv".to_owned());
    transform.children = vec![axes("scale", [us, vs], "1"), axes("translate", [uo, vo], "0")];
    element.children.push(transform);
}

/// Turns `gamma` 1 into `raw`; leaves out any other value than sRGB's, with a warning.
fn gamma(element: &mut Element, warnings: &mut Vec<String>) {
    let is_gamma = |child: &Element| child.attribute("name") == Some("gamma");
    let Some(at) = element.children.iter().position(is_gamma) else { return };
    let mut child = element.children.remove(at);
    match child.attribute("value").and_then(|text| text.trim().parse::<f64>().ok()) {
        Some(1.0) => {
            child.tag = "boolean".to_owned();
            child.set("name", "raw".to_owned());
            child.set("value", "true".to_owned());
            element.children.push(child);
        }
        Some(value) if value < 0.0 => {}
        other => warnings.push(format!(
            "{}: gamma {}: the sRGB curve is used",
            child.place,
            other.map_or("?".to_owned(), |value| value.to_string())
        )),
    }
}

/// Adds the default metal of Mitsuba 0.6, copper, where none is named.
fn copper(element: &mut Element) {
    let given = |child: &Element| matches!(child.attribute("name"), Some("material" | "eta" | "k"));
    if !element.children.iter().any(given) {
        let mut material = element.like("string");
        material.set("name", "material".to_owned());
        material.set("value", "Cu".to_owned());
        element.children.push(material);
    }
}

/// Scales reflectances above 1 down, as Mitsuba 0.6 does.
fn conserve(element: &mut Element, warnings: &mut Vec<String>) {
    for child in &mut element.children {
        let name = child.attribute("name").unwrap_or_default();
        let is_part = name.ends_with("reflectance") || name.ends_with("transmittance");
        if !is_part || !matches!(child.tag.as_str(), "rgb" | "spectrum" | "float") {
            continue;
        }
        let Ok(numbers) = numbers(child, child.attribute("value").unwrap_or_default()) else { continue };
        let most = numbers.iter().fold(1.0f64, |most, number| most.max(*number));
        if most > 1.0 && most.is_finite() {
            warnings.push(format!("{}: {name} is scaled down to 1, since it is above", child.place));
            let scaled: Vec<String> = numbers.iter().map(|number| (number / most).to_string()).collect();
            child.set("value", scaled.join(" "));
        }
    }
}

/// Makes a shape with a medium but without any material the border of that medium and nothing else.
fn matched_border(element: &mut Element) {
    let is_medium = |child: &Element| matches!(child.attribute("name"), Some("interior" | "exterior"));
    let others =
        |child: &Element| matches!(child.tag.as_str(), "bsdf" | "ref" | "emitter" | "subsurface") && !is_medium(child);
    if element.children.iter().any(is_medium) && !element.children.iter().any(others) {
        let mut border = element.like("bsdf");
        border.set("type", "null".to_owned());
        element.children.push(border);
    }
}

/// Adds the default medium of Mitsuba 0.6, skin, where none is given.
fn skin(element: &mut Element) {
    let given = |child: &Element| {
        matches!(child.attribute("name"), Some("material" | "sigma_a" | "sigma_s" | "sigma_t" | "albedo"))
    };
    if !element.children.iter().any(given) {
        let mut material = element.like("string");
        material.set("name", "material".to_owned());
        material.set("value", "Skin1".to_owned());
        element.children.push(material);
    }
}

/// Turns a spectrum of one or three numbers into a colour, which it was.
fn plain_numbers(element: &mut Element) {
    leave_out_intent(element);
    match element.attribute("value").map(|text| text.contains(':')) {
        Some(false) => element.tag = "rgb".to_owned(),
        Some(true) => element.set("type", OLD_SPECTRUM.to_owned()),
        None => {}
    }
}

/// Of a property that is given several times keeps the last, and a texture rather than a value: 0.6 sets values as it reads them, and
/// gives objects to their owners when these are there.
fn keep_last(element: &mut Element, warnings: &mut Vec<String>) {
    const VALUES: [&str; 9] =
        ["float", "integer", "boolean", "string", "rgb", "srgb", "spectrum", "blackbody", "texture"];
    let mut kept: Vec<Element> = Vec::with_capacity(element.children.len());
    let mut places: BTreeMap<String, usize> = BTreeMap::new();
    for child in std::mem::take(&mut element.children) {
        let name =
            child.attribute("name").filter(|_| VALUES.contains(&child.tag.as_str())).unwrap_or_default().to_owned();
        let before = if name.is_empty() { None } else { places.insert(name.clone(), kept.len()) };
        let Some(at) = before else {
            kept.push(child);
            continue;
        };
        places.insert(name.clone(), at);
        let last = kept[at].tag != "texture" || child.tag == "texture";
        let which = if last { "last" } else { "texture" };
        warnings.push(format!("{}: the property \"{name}\" is given twice: the {which} is used", child.place));
        if last {
            kept[at] = child;
        }
    }
    element.children = kept;
}

/// Gives a view without a direction up that of 0.6, the second vector of its basis.
fn look_up(element: &mut Element) {
    let point = |name: &str| {
        let found = element.attribute(name).and_then(|text| numbers(element, text).ok());
        found.and_then(|found| Some(DVec3::from_slice(found.get(..3)?)))
    };
    let (None, Some(origin), Some(target)) = (element.attribute("up"), point("origin"), point("target")) else {
        return;
    };
    let DVec3 { x, y, z } = (target - origin).normalize_or_zero();
    let last = if x.abs() > y.abs() { DVec3::new(z, 0.0, -x) } else { DVec3::new(0.0, z, -y) };
    let up = last.normalize_or_zero().cross(DVec3::new(x, y, z));
    element.set("up", format!("{} {} {}", up.x, up.y, up.z));
}

/// What a colour is for is known by where it stands.
fn leave_out_intent(element: &mut Element) {
    element.attributes.retain(|(name, _)| name != "intent");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names() {
        for (old, new) in [
            ("toWorld", "to_world"),
            ("intIOR", "int_ior"),
            ("extEta", "ext_eta"),
            ("alphaU", "alpha_u"),
            ("focalLength", "focal_length"),
            ("maxDepth", "max_depth"),
            ("fov", "fov"),
            ("to_uv", "to_uv"),
            ("p0", "p0"),
        ] {
            assert_eq!(snake_case(old), new);
        }
    }
}
