//! Which effects a scene calls for, and what in it calls for them.

use std::collections::BTreeSet;

use serde::Serialize;

use super::file::{LightFile, MaterialFile, SceneFile, TextureFile};

/// All effects that this version knows.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct EffectPlan {
    /// The scene's name.
    pub scene: String,
    /// Each effect, in a fixed order.
    pub effects: Vec<Effect>,
}

/// One effect.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Effect {
    /// Its name.
    pub name: &'static str,
    /// Whether the scene calls for it.
    pub on: bool,
    /// What calls for it, or why it is off.
    pub cause: String,
}

/// The names of what has a property; an effect is on where there are some.
type Names = BTreeSet<String>;

/// Looks through a scene. Materials that no shape uses do not count.
pub fn plan(scene: &SceneFile) -> EffectPlan {
    let used: BTreeSet<&str> = scene.shapes.iter().map(|s| s.material.as_str()).collect();
    let materials: Vec<(&str, &MaterialFile)> =
        scene.materials.iter().filter(|(name, _)| used.contains(name.as_str())).map(|(n, m)| (n.as_str(), m)).collect();
    let having = |test: fn(&MaterialFile) -> bool| -> Names {
        materials.iter().filter(|(_, m)| test(m)).map(|(name, _)| (*name).to_owned()).collect()
    };
    let emitters = scene.shapes.iter().filter(|s| s.emission.is_some()).count();
    let area: Names = (emitters > 0).then(|| format!("{emitters} emitting shapes")).into_iter().collect();
    let lights =
        |test: fn(&LightFile) -> bool| -> Names { scene.lights.iter().filter(|l| test(l)).map(light_name).collect() };
    let infinite = lights(|l| matches!(l, LightFile::Constant { .. } | LightFile::Envmap { .. }));
    let delta =
        lights(|l| matches!(l, LightFile::Point { .. } | LightFile::Spot { .. } | LightFile::Directional { .. }));
    let hittable: Names = area.union(&infinite).cloned().collect();
    let all: Names = hittable.union(&delta).cloned().collect();
    let lens: Names = (scene.camera.aperture_radius > 0.0)
        .then(|| format!("aperture {}", scene.camera.aperture_radius))
        .into_iter()
        .collect();
    let effects = vec![
        effect("direct light", "sampled towards", &all, "there is no light"),
        effect("light hit by rays", "weighted against sampled light", &hittable, "no light can be hit by a ray"),
        effect("photons", "emitted from", &all, "there is no light"),
        effect("environment", "surrounds the scene:", &infinite, "no constant light or environment map"),
        effect("delta lights", "reached by sampling only:", &delta, "no point, spot or directional light"),
        effect("mirrors", "smooth metal:", &having(is_mirror), "no smooth metal"),
        effect("refraction", "clear material:", &having(is_clear), "no clear material"),
        effect("thin panes", "thin clear material:", &having(is_pane), "no thin clear material"),
        effect("rough refraction", "rough clear material:", &having(is_frosted), "no rough clear material"),
        effect(
            "glossy reflection",
            "rough metal or principled:",
            &having(is_glossy),
            "no rough metal, no principled material",
        ),
        effect("clear coats", "coated material:", &having(is_coated), "no plastic, no clear coat"),
        effect("alpha masks", "holes in", &having(MaterialFile::is_masked), "no material has holes"),
        effect("bump maps", "shading normals of", &having(MaterialFile::is_bumped), "no bump or normal map"),
        effect("textures", "vary the colour of", &having(is_textured), "all colours are constant"),
        effect("depth of field", "thin lens:", &lens, "the camera is a pinhole"),
        guiding(scene, &having(is_rough), &all),
    ];
    EffectPlan { scene: scene.name.clone(), effects }
}

fn effect(name: &'static str, verb: &str, causes: &Names, why_off: &str) -> Effect {
    let on = !causes.is_empty();
    Effect { name, on, cause: if on { format!("{verb} {}", list(causes)) } else { why_off.into() } }
}

/// Guiding needs a lobe to choose directions in, and light that comes by way of a surface.
fn guiding(scene: &SceneFile, guidable: &Names, lights: &Names) -> Effect {
    let (on, cause) = if lights.is_empty() {
        (false, "there is no light".into())
    } else if scene.render.max_depth <= 2 {
        (false, format!("depth {} has direct light only", scene.render.max_depth))
    } else if guidable.is_empty() {
        (false, "every material is smooth and leaves no choice of direction".into())
    } else {
        (true, format!("indirect light on {}", list(guidable)))
    };
    Effect { name: "guiding", on, cause }
}

/// At most four names.
fn list(names: &Names) -> String {
    let shown: Vec<&str> = names.iter().take(4).map(String::as_str).collect();
    let more = names.len() - shown.len();
    if more == 0 { shown.join(", ") } else { format!("{} and {more} more", shown.join(", ")) }
}

fn light_name(light: &LightFile) -> String {
    match light {
        LightFile::Point { .. } => "point light",
        LightFile::Spot { .. } => "spot light",
        LightFile::Directional { .. } => "directional light",
        LightFile::Constant { .. } => "constant light",
        LightFile::Envmap { .. } => "environment map",
    }
    .into()
}

/// Whether one of the parts passes.
fn has(material: &MaterialFile, test: impl Fn(&MaterialFile) -> bool) -> bool {
    material.parts().into_iter().any(test)
}

/// Whether some part leaves a choice of direction.
fn is_rough(material: &MaterialFile) -> bool {
    has(material, |part| !(is_mirror(part) || is_clear(part) || is_pane(part)))
}

fn is_mirror(material: &MaterialFile) -> bool {
    has(material, |part| matches!(part, MaterialFile::Conductor { .. }))
}

fn is_clear(material: &MaterialFile) -> bool {
    has(material, |part| matches!(part, MaterialFile::Dielectric { .. }))
}

fn is_pane(material: &MaterialFile) -> bool {
    has(material, |part| matches!(part, MaterialFile::ThinDielectric { .. }))
}

fn is_frosted(material: &MaterialFile) -> bool {
    has(material, |part| match part {
        MaterialFile::Principled { spec_trans, .. } => *spec_trans > 0.0,
        other => matches!(other, MaterialFile::RoughDielectric { .. }),
    })
}

fn is_glossy(material: &MaterialFile) -> bool {
    has(material, |part| matches!(part, MaterialFile::RoughConductor { .. } | MaterialFile::Principled { .. }))
}

fn is_coated(material: &MaterialFile) -> bool {
    has(material, |part| match part {
        MaterialFile::Principled { clearcoat, .. } => *clearcoat > 0.0,
        other => matches!(other, MaterialFile::Plastic { .. }),
    })
}

fn is_textured(material: &MaterialFile) -> bool {
    material.textures().iter().any(|(_, texture)| !matches!(texture, TextureFile::Rgb { .. }))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCENE: &str = r#"{"version": 1, "camera": {"to_world": [1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1], "fov": 40},
        "film": {"width": 1, "height": 1},
        "materials": {"mat": {"type": "two_sided", "material": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [1,1,1]}}},
                      "pane": {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1},
                      "unused": {"type": "conductor", "eta": [1,1,1], "k": [1,1,1]}},
        "shapes": [{"geometry": {"type": "sphere", "center": [0,0,0], "radius": 1}, "material": "mat"},
                   {"geometry": {"type": "sphere", "center": [3,0,0], "radius": 1}, "material": "pane"}],
        "lights": [{"type": "point", "position": [0,0,0], "intensity": [1,1,1]}]}"#;

    fn on(scene: &SceneFile) -> Vec<&'static str> {
        plan(scene).effects.into_iter().filter(|e| e.on).map(|e| e.name).collect()
    }

    #[test]
    fn effects_follow_what_is_used() {
        let mut scene: SceneFile = serde_json::from_str(SCENE).unwrap();
        assert_eq!(on(&scene), ["direct light", "photons", "delta lights", "refraction", "guiding"]);
        scene.shapes.remove(0);
        assert_eq!(on(&scene), ["direct light", "photons", "delta lights", "refraction"]);
        scene.lights.clear();
        scene.shapes[0].material = "unused".into();
        assert_eq!(on(&scene), ["mirrors"]);
    }

    #[test]
    fn direct_light_needs_no_guiding() {
        let mut scene: SceneFile = serde_json::from_str(SCENE).unwrap();
        scene.render.max_depth = 2;
        assert!(plan(&scene).effects.iter().any(|e| e.name == "guiding" && !e.on && e.cause.contains("depth 2")));
    }
}
