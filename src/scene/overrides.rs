//! Effects that are switched on or off against the scene's plan.
//!
//! A switched-off effect is taken out of the scene file before anything that it refers to is read: it loads nothing and runs
//! nothing. A switched-on effect that the scene does not call for is compiled in and finds nothing to do.

use std::str::FromStr;

use super::effects::Needs;
use super::file::{LightFile, MaterialFile, MediumFile, SceneFile, TextureFile};
use super::plan::{
    EffectKind, EffectPlan, is_clear, is_coated, is_directional, is_environment, is_glossy, is_mirror, is_pane, is_spot,
};

/// One effect switched on or off, written `+name` or `-name`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Override {
    /// The effect.
    pub kind: EffectKind,
    /// Whether it is switched on.
    pub on: bool,
}

impl FromStr for Override {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let names = || EffectKind::ALL.map(EffectKind::name).join(", ");
        let (on, name) = match (text.strip_prefix('+'), text.strip_prefix('-')) {
            (Some(name), _) => (true, name),
            (_, Some(name)) => (false, name),
            _ => return Err(format!("\"{text}\" begins with neither + nor -, as in +photons,-medium")),
        };
        let kind =
            EffectKind::named(name).ok_or_else(|| format!("no effect is named \"{name}\"; there are {}", names()))?;
        Ok(Self { kind, on })
    }
}

/// Takes the switched-off effects out of the scene; returns the further effects that the tracers must be compiled for.
pub fn apply(scene: &mut SceneFile, overrides: &[Override]) -> Needs {
    let mut needs = Needs::default();
    for &Override { kind, on } in overrides {
        if on {
            needs.media |= matches!(kind, EffectKind::Medium | EffectKind::Volumes);
            needs.materials |= MATERIALS.contains(&kind);
        } else {
            remove(scene, kind);
        }
    }
    needs
}

/// Records the overrides in a plan.
pub fn decide(plan: &mut EffectPlan, overrides: &[Override]) {
    for &Override { kind, on } in overrides {
        plan.decide(kind, on, "asked for with --effects");
    }
}

/// Effects of materials that the loop for plain diffuse surfaces leaves out.
const MATERIALS: [EffectKind; 8] = [
    EffectKind::Mirrors,
    EffectKind::Transmission,
    EffectKind::ThinTransmission,
    EffectKind::Glossy,
    EffectKind::Anisotropy,
    EffectKind::Coats,
    EffectKind::Masks,
    EffectKind::BumpMaps,
];

fn remove(scene: &mut SceneFile, kind: EffectKind) {
    use EffectKind as K;
    match kind {
        K::AreaLights => {
            scene.shapes.iter_mut().for_each(|shape| (shape.emission, shape.emission_texture) = (None, None));
        }
        K::PointLights => scene.lights.retain(|light| !matches!(light, LightFile::Point { .. })),
        K::SpotLights => scene.lights.retain(|light| !is_spot(light)),
        K::DirectionalLights => scene.lights.retain(|light| !is_directional(light)),
        K::Environment => scene.lights.retain(|light| !is_environment(light)),
        K::DepthOfField => scene.views_mut().for_each(|camera| camera.aperture_radius = 0.0),
        K::Medium => remove_media(scene, |medium| !medium.is_varying()),
        K::Volumes => remove_media(scene, MediumFile::is_varying),
        K::Masks => {
            scene.materials.values_mut().for_each(|m| take_off(m, |m| matches!(m, MaterialFile::Mask { .. })));
        }
        K::BumpMaps => scene.materials.values_mut().for_each(|m| take_off(m, is_bump)),
        K::Textures => {
            scene.materials.values_mut().flat_map(MaterialFile::textures_mut).for_each(|(_, texture)| flatten(texture));
            scene.shapes.iter_mut().filter_map(|shape| shape.emission_texture.as_mut()).for_each(flatten);
            scene.lights.iter_mut().filter_map(LightFile::texture_mut).for_each(flatten);
        }
        K::Mirrors => make_diffuse(scene, is_mirror),
        K::Transmission => {
            change_parts(scene, |part| {
                if let MaterialFile::Principled(file) = part {
                    file.spec_trans = 0.0;
                }
            });
            make_diffuse(scene, is_clear);
        }
        K::ThinTransmission => {
            change_parts(scene, |part| {
                if let MaterialFile::PrincipledThin(file) = part {
                    file.make_opaque();
                }
            });
            make_diffuse(scene, is_pane);
        }
        K::Glossy => make_diffuse(scene, is_glossy),
        K::Anisotropy => {
            scene.materials.values_mut().for_each(|m| take_off(m, |m| matches!(m, MaterialFile::Anisotropic { .. })));
        }
        K::Coats => {
            change_parts(scene, |part| {
                if let MaterialFile::Principled(file) = part {
                    file.clearcoat = 0.0;
                }
            });
            make_diffuse(scene, is_coated);
        }
        // Properties of the rendering, not of the scene.
        K::DirectLight | K::Photons | K::Guiding | K::Reconstruction => {}
    }
}

fn is_bump(material: &MaterialFile) -> bool {
    matches!(material, MaterialFile::BumpMap { .. } | MaterialFile::NormalMap { .. })
}

/// Removes the media for which `test` is true. Their borders stay, so that objects inside a medium stay visible.
fn remove_media(scene: &mut SceneFile, test: fn(&MediumFile) -> bool) {
    scene.media.retain(|_, medium| !test(medium));
    let known = &scene.media;
    let forget = |name: &mut Option<String>| *name = name.take().filter(|name| known.contains_key(name));
    std::iter::once(&mut scene.camera).chain(scene.cameras.values_mut()).for_each(|camera| forget(&mut camera.medium));
    for shape in &mut scene.shapes {
        forget(&mut shape.interior);
        forget(&mut shape.exterior);
    }
}

/// Removes all wrappers around a material, such as masks, for which `test` is true.
fn take_off(material: &mut MaterialFile, test: fn(&MaterialFile) -> bool) {
    while test(material) {
        let Some(inside) = material.inside_mut() else { return };
        *material = std::mem::replace(inside, MaterialFile::Null {});
    }
    if let Some(inside) = material.inside_mut() {
        take_off(inside, test);
    } else if let MaterialFile::Blend { materials, .. } = material {
        materials.iter_mut().for_each(|part| take_off(part, test));
    }
}

/// Replaces a texture by a constant: the mean of a checkerboard, or grey for a picture, which is not read.
fn flatten(texture: &mut TextureFile) {
    let value = match texture {
        TextureFile::Rgb { .. } => return,
        TextureFile::Checkerboard { color0, color1, .. } => [0, 1, 2].map(|c| 0.5 * (color0[c] + color1[c])),
        TextureFile::Bitmap { .. } | TextureFile::Attribute { .. } => [0.5; 3],
    };
    *texture = TextureFile::rgb(value);
}

/// Replaces every part for which `test` is true by a diffuse one of the same colour; two-sided, since light came from everywhere.
fn make_diffuse(scene: &mut SceneFile, test: fn(&MaterialFile) -> bool) {
    let is_bare =
        |m: &MaterialFile| matches!(m, MaterialFile::Anisotropic { material, .. } if !material.can_have_grain());
    for material in scene.materials.values_mut() {
        flatten_parts(material, test, false);
        // A diffuse surface has no grain.
        take_off(material, is_bare);
    }
}

/// [`make_diffuse`] for one material; `two_sided` says that it is inside a two-sided one already.
fn flatten_parts(material: &mut MaterialFile, test: fn(&MaterialFile) -> bool, two_sided: bool) {
    let two_sided = two_sided || matches!(material, MaterialFile::TwoSided { .. });
    if let MaterialFile::Blend { materials, .. } = material {
        materials.iter_mut().for_each(|part| flatten_parts(part, test, two_sided));
    } else if let Some(inside) = material.inside_mut() {
        flatten_parts(inside, test, two_sided);
    } else if test(material) {
        let colour = material.textures().first().map_or(TextureFile::rgb([0.5; 3]), |(_, texture)| (*texture).clone());
        let plain = MaterialFile::Diffuse { reflectance: colour };
        *material = if two_sided { plain } else { MaterialFile::TwoSided { material: Box::new(plain) } };
    }
}

fn change_parts(scene: &mut SceneFile, mut change: impl FnMut(&mut MaterialFile)) {
    scene.materials.values_mut().for_each(|material| material.change_parts(&mut change));
}

#[cfg(test)]
mod tests {
    use super::super::plan::plan;
    use super::*;

    const SCENE: &str = r#"{"version": 1,
        "camera": {"to_world": [1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1], "fov": 40, "aperture_radius": 0.1, "focus_distance": 2, "medium": "fog"},
        "film": {"width": 1, "height": 1},
        "media": {"fog": {"type": "homogeneous", "sigma_t": [1,1,1], "albedo": [1,1,1]},
                  "cloud": {"type": "grid", "density": {"type": "vol", "file": "cloud.vol"}, "sigma_t": [1,1,1], "albedo": [1,1,1]}},
        "materials": {
            "mirror": {"type": "conductor", "eta": [1,1,1], "k": [1,1,1]},
            "glass": {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1},
            "pane": {"type": "thin_dielectric", "int_ior": 1.5, "ext_ior": 1},
            "gold": {"type": "anisotropic", "aspect": 2, "material": {"type": "rough_conductor", "alpha": 0.1, "eta": [1,1,1], "k": [1,1,1]}},
            "paint": {"type": "plastic", "int_ior": 1.5, "ext_ior": 1, "diffuse_reflectance": {"type": "rgb", "value": [1,0,0]}},
            "bark": {"type": "bump_map", "texture": {"type": "bitmap", "file": "bark.png"},
                     "material": {"type": "principled", "base_color": {"type": "rgb", "value": [1,1,0]}}},
            "leaf": {"type": "mask", "opacity": {"type": "bitmap", "file": "leaf.png"},
                     "material": {"type": "diffuse", "reflectance": {"type": "checkerboard", "color0": [1,1,1], "color1": [0,0,0]}}}},
        "shapes": [
            {"geometry": {"type": "sphere", "center": [0,0,0], "radius": 1}, "material": "mirror", "emission": [1,1,1]},
            {"geometry": {"type": "sphere", "center": [0,0,0], "radius": 1}, "material": "glass", "interior": "fog"},
            {"geometry": {"type": "sphere", "center": [0,0,0], "radius": 1}, "material": "pane", "interior": "cloud"},
            {"geometry": {"type": "sphere", "center": [0,0,0], "radius": 1}, "material": "gold"},
            {"geometry": {"type": "sphere", "center": [0,0,0], "radius": 1}, "material": "paint"},
            {"geometry": {"type": "sphere", "center": [0,0,0], "radius": 1}, "material": "bark"},
            {"geometry": {"type": "sphere", "center": [0,0,0], "radius": 1}, "material": "leaf"}],
        "lights": [{"type": "point", "position": [0,0,0], "intensity": [1,1,1]},
                   {"type": "spot", "to_world": [1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1], "intensity": [1,1,1], "cutoff_angle": 20, "beam_width": 10},
                   {"type": "directional", "direction": [0,0,1], "irradiance": [1,1,1]},
                   {"type": "constant", "radiance": [1,1,1]}]}"#;

    /// Switching off one effect of the scene removes it from the plan, and no other but those that depend on it.
    #[test]
    fn what_is_off_is_gone() {
        let whole: SceneFile = serde_json::from_str(SCENE).unwrap();
        let before = plan(&whole);
        for kind in EffectKind::ALL {
            assert!(before.is_on(kind), "{}", kind.name());
            let mut scene = whole.clone();
            assert_eq!(apply(&mut scene, &[Override { kind, on: false }]), Needs::default());
            let after = plan(&scene);
            let of_rendering = EffectKind::ALL.iter().position(|&k| k == EffectKind::Photons).unwrap();
            for (index, other) in EffectKind::ALL.into_iter().enumerate() {
                let stays = other != kind || index >= of_rendering || other == EffectKind::DirectLight;
                // What is diffuse has no grain.
                let stays = stays && !(kind == EffectKind::Glossy && other == EffectKind::Anisotropy);
                // The leaf's only picture is in its mask, but its board of two colours is a texture as well.
                assert_eq!(after.is_on(other), stays, "{} without {}", other.name(), kind.name());
            }
        }
    }

    #[test]
    fn overrides_are_read_and_refused() {
        assert_eq!("+photons".parse(), Ok(Override { kind: EffectKind::Photons, on: true }));
        assert_eq!("-depth-of-field".parse(), Ok(Override { kind: EffectKind::DepthOfField, on: false }));
        for wrong in ["photons", "+", "-fog", ""] {
            assert!(wrong.parse::<Override>().is_err(), "{wrong}");
        }
        assert!("-fog".parse::<Override>().unwrap_err().contains("medium"));
    }
}
