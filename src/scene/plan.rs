//! The effects that a scene calls for, each with its cause in the scene.

use std::collections::BTreeSet;

use serde::Serialize;

use super::file::{LightFile, MaterialFile, MediumFile, SceneFile, TextureFile};

/// An effect that a scene may call for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum EffectKind {
    /// Light sampling: next event estimation.
    DirectLight,
    /// Emitting shapes.
    AreaLights,
    /// Lights without extent, in all directions.
    PointLights,
    /// Lights without extent, in a cone or through a picture.
    SpotLights,
    /// Parallel light.
    DirectionalLights,
    /// Light from all around: constant or a picture.
    Environment,
    /// Smooth metal.
    Mirrors,
    /// Glass, smooth or rough.
    Transmission,
    /// Thin panes and sheets.
    ThinTransmission,
    /// Rough metal, principled materials.
    Glossy,
    /// Facets with a grain.
    Anisotropy,
    /// Plastic, clear coats.
    Coats,
    /// Holes in surfaces, by opacity.
    Masks,
    /// Shading normals from textures.
    BumpMaps,
    /// Colours that vary.
    Textures,
    /// Participating media that are the same everywhere, such as fog.
    Medium,
    /// Participating media that vary in space, such as clouds.
    Volumes,
    /// Depth of field of a thin lens.
    DepthOfField,
    /// Light paths to learn from.
    Photons,
    /// Learned directions.
    Guiding,
    /// Reconstruction of good distributions from noisy ones.
    Reconstruction,
}

impl EffectKind {
    /// All effects, in the order of the plan.
    pub const ALL: [Self; 21] = [
        Self::DirectLight,
        Self::AreaLights,
        Self::PointLights,
        Self::SpotLights,
        Self::DirectionalLights,
        Self::Environment,
        Self::Mirrors,
        Self::Transmission,
        Self::ThinTransmission,
        Self::Glossy,
        Self::Anisotropy,
        Self::Coats,
        Self::Masks,
        Self::BumpMaps,
        Self::Textures,
        Self::Medium,
        Self::Volumes,
        Self::DepthOfField,
        Self::Photons,
        Self::Guiding,
        Self::Reconstruction,
    ];

    /// Its name in plans and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::DirectLight => "direct-light",
            Self::AreaLights => "area-lights",
            Self::PointLights => "point-lights",
            Self::SpotLights => "spot-lights",
            Self::DirectionalLights => "directional-lights",
            Self::Environment => "environment",
            Self::Mirrors => "mirrors",
            Self::Transmission => "transmission",
            Self::ThinTransmission => "thin-transmission",
            Self::Glossy => "glossy",
            Self::Anisotropy => "anisotropy",
            Self::Coats => "coats",
            Self::Masks => "masks",
            Self::BumpMaps => "bump-maps",
            Self::Textures => "textures",
            Self::Medium => "medium",
            Self::Volumes => "volumes",
            Self::DepthOfField => "depth-of-field",
            Self::Photons => "photons",
            Self::Guiding => "guiding",
            Self::Reconstruction => "reconstruction",
        }
    }

    /// The effect with that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

/// All effects that this version knows.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct EffectPlan {
    /// The scene's name.
    pub scene: String,
    /// Names of its cameras, the default one first.
    pub cameras: Vec<String>,
    /// Each effect, in the order of [`EffectKind::ALL`].
    pub effects: Vec<Effect>,
}

/// One effect of a plan.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Effect {
    /// The effect.
    pub name: EffectKind,
    /// Whether the scene calls for it.
    pub on: bool,
    /// The parts of the scene that call for it, or the reason why it is off.
    pub cause: String,
}

impl EffectPlan {
    /// Whether an effect is on.
    pub fn is_on(&self, kind: EffectKind) -> bool {
        self.effects.iter().any(|effect| effect.name == kind && effect.on)
    }

    /// Changes the decision on an effect, because of `cause`.
    pub fn decide(&mut self, kind: EffectKind, on: bool, cause: impl Into<String>) {
        if let Some(effect) = self.effects.iter_mut().find(|effect| effect.name == kind) {
            (effect.on, effect.cause) = (on, cause.into());
        }
    }
}

/// Names of the parts of a scene with some property; an effect is on where there are some.
type Names = BTreeSet<String>;

/// Plans the effects of a scene. Materials that no shape uses do not count.
pub fn plan(scene: &SceneFile) -> EffectPlan {
    let effects = EffectKind::ALL.into_iter().map(|name| {
        let (on, cause) = Survey::new(scene).verdict(name);
        Effect { name, on, cause }
    });
    let cameras = scene.views().map(|(name, _)| name.to_owned()).collect();
    EffectPlan { scene: scene.name.clone(), cameras, effects: effects.collect() }
}

/// A scene, with the materials that its shapes use.
struct Survey<'a> {
    scene: &'a SceneFile,
    materials: Vec<(&'a str, &'a MaterialFile)>,
}

impl<'a> Survey<'a> {
    fn new(scene: &'a SceneFile) -> Self {
        let seen = scene.shapes.iter().filter(|shape| !shape.unseen);
        let used: BTreeSet<&str> = seen.map(|shape| shape.material.as_str()).collect();
        let materials = scene.materials.iter().filter(|(name, _)| used.contains(name.as_str()));
        Self { scene, materials: materials.map(|(name, material)| (name.as_str(), material)).collect() }
    }

    fn verdict(&self, kind: EffectKind) -> (bool, String) {
        use EffectKind as K;
        match kind {
            K::DirectLight => on("sampled towards", &self.all_lights(), "there is no light"),
            K::AreaLights => on("light from", &self.emitters(), "no shape emits"),
            K::PointLights => self.lights("point light", |l| matches!(l, LightFile::Point { .. })),
            K::SpotLights => self.lights("spot light", is_spot),
            K::DirectionalLights => self.lights("directional light", is_directional),
            K::Environment => self.lights("constant light or environment map", is_environment),
            K::Mirrors => on("smooth metal:", &self.having(is_mirror), "no smooth metal"),
            K::Transmission => on("clear material:", &self.having(is_clear), "no clear material"),
            K::ThinTransmission => on("thin clear material:", &self.having(is_pane), "no thin clear material"),
            K::Glossy => {
                on("rough metal or principled:", &self.having(is_glossy), "no rough metal, no principled material")
            }
            K::Anisotropy => on("the grain of", &self.having(MaterialFile::has_grain), "no facets have a grain"),
            K::Coats => on("coated material:", &self.having(is_coated), "no plastic, no clear coat"),
            K::Masks => on("holes in", &self.having(MaterialFile::is_masked), "no material has holes"),
            K::BumpMaps => on("shading normals of", &self.having(MaterialFile::is_bumped), "no bump or normal map"),
            K::Textures => on("vary the colour of", &self.textured(), "all colours are constant"),
            K::Medium => {
                let even = self.media_that(|medium| !medium.is_varying());
                on("light is scattered or absorbed in", &even, "no shape has one, nor the camera")
            }
            K::Volumes => on(
                "light is scattered, absorbed or emitted on grids:",
                &self.media_that(MediumFile::is_varying),
                NO_GRIDS,
            ),
            K::DepthOfField => {
                let mut radii = self.scene.views().map(|(_, camera)| camera.aperture_radius);
                let lens = radii.find(|radius| *radius > 0.0).map(|radius| format!("a lens of radius {radius}"));
                (lens.is_some(), lens.unwrap_or("the camera is a pinhole".into()))
            }
            K::Photons => self.photons(),
            K::Guiding => self.guiding(),
            K::Reconstruction => match self.guiding() {
                (true, _) => (true, "guides learn from few samples".into()),
                (false, cause) => (false, format!("no guiding: {cause}")),
            },
        }
    }

    fn having(&self, test: fn(&MaterialFile) -> bool) -> Names {
        self.materials.iter().filter(|(_, m)| test(m)).map(|(name, _)| (*name).to_owned()).collect()
    }

    fn textured(&self) -> Names {
        let shapes = self.scene.shapes.iter().filter_map(|shape| shape.emission_texture.as_ref());
        let lights = self.scene.lights.iter().filter_map(LightFile::texture).chain(shapes);
        let count = lights.filter(|texture| !matches!(texture, TextureFile::Rgb { .. })).count();
        let lights = (count > 0).then(|| format!("{count} lights"));
        self.having(is_textured).into_iter().chain(lights).collect()
    }

    fn emitters(&self) -> Names {
        let emitting = self.scene.shapes.iter().filter(|shape| shape.shines());
        let (count, unseen) = (emitting.clone().count(), emitting.filter(|shape| shape.unseen).count());
        let unseen = if unseen > 0 { format!(", {unseen} of them unseen") } else { String::new() };
        (count > 0).then(|| format!("{count} emitting shapes{unseen}")).into_iter().collect()
    }

    fn lights(&self, name: &str, test: fn(&LightFile) -> bool) -> (bool, String) {
        match self.scene.lights.iter().filter(|light| test(light)).count() {
            0 => (false, format!("no {name}")),
            1 => (true, format!("1 {name}")),
            count => (true, format!("{count} of kind {name}")),
        }
    }

    fn all_lights(&self) -> Names {
        self.scene.lights.iter().map(|light| light_name(light).to_owned()).chain(self.emitters()).collect()
    }

    /// Names of the media that some ray can be in and that are so.
    fn media_that(&self, test: fn(&MediumFile) -> bool) -> Names {
        let is_so = |name: &String| self.scene.media.get(name).is_some_and(test);
        self.media().into_iter().filter(is_so).collect()
    }

    /// Names of the media that some ray can be in.
    fn media(&self) -> Names {
        let shapes = self.scene.shapes.iter().flat_map(|shape| [&shape.interior, &shape.exterior]);
        let cameras = self.scene.views().map(|(_, camera)| &camera.medium);
        shapes.chain(cameras).flatten().cloned().collect()
    }

    /// Whether to trace photons, and why. They find light that camera paths seldom do: by way of clear or smooth things, and of
    /// hidden lamps. Photons of a sky start all over the scene's outside, and few of them arrive where the camera looks; where
    /// nothing gathers them, or they come alike from everywhere, they mislead more than they tell (measured on scenes/blinds).
    fn photons(&self) -> (bool, String) {
        let lights = self.all_lights();
        let gather = |m: &MaterialFile| is_mirror(m) || is_clear(m) || is_pane(m) || is_glossy(m) || is_coated(m);
        let gathering = self.having(gather);
        let only = |test: fn(&LightFile) -> bool| self.emitters().is_empty() && self.scene.lights.iter().all(test);
        if lights.is_empty() {
            (false, "there is no light".into())
        } else if self.having(is_guidable).is_empty() && self.media().is_empty() {
            (false, "no surface could be lit by way of another: every material is smooth".into())
        } else if only(|light| matches!(light, LightFile::Constant { .. })) {
            (false, "light that comes alike from everywhere is gathered nowhere".into())
        } else if !gathering.is_empty() {
            let (gathering, lights) = (list(&gathering), list(&lights));
            (true, format!("{gathering} can lie between {lights} and surfaces that are not smooth"))
        } else if only(is_environment) {
            (false, "all light comes from the environment, and nothing smooth or clear gathers it".into())
        } else {
            (true, format!("{} may light surfaces that the camera sees only by way of others", list(&lights)))
        }
    }

    /// Whether to guide, and why. It needs a lobe to choose directions in, and light that comes by way of a surface or a medium.
    fn guiding(&self) -> (bool, String) {
        let mut guidable = self.having(is_guidable);
        guidable.extend(self.media());
        if self.all_lights().is_empty() && self.media_that(MediumFile::glows).is_empty() {
            (false, "there is no light".into())
        } else if self.scene.render.max_depth <= 2 {
            (false, format!("depth {} has direct light only", self.scene.render.max_depth))
        } else if guidable.is_empty() {
            (false, "every material is smooth and leaves no choice of direction".into())
        } else {
            (true, format!("indirect light on {}", list(&guidable)))
        }
    }
}

/// Why media that vary are off.
const NO_GRIDS: &str = "no medium varies in space";

fn on(verb: &str, causes: &Names, why_off: &str) -> (bool, String) {
    if causes.is_empty() { (false, why_off.into()) } else { (true, format!("{verb} {}", list(causes))) }
}

/// Lists at most four names, and counts the others.
fn list(names: &Names) -> String {
    let shown: Vec<&str> = names.iter().take(4).map(String::as_str).collect();
    let more = names.len() - shown.len();
    if more == 0 { shown.join(", ") } else { format!("{} and {more} more", shown.join(", ")) }
}

fn light_name(light: &LightFile) -> &'static str {
    match light {
        LightFile::Point { .. } => "point light",
        LightFile::Spot { .. } => "spot light",
        LightFile::Projector { .. } => "projector",
        LightFile::Directional { .. } => "directional light",
        LightFile::Sun { .. } => "sun",
        LightFile::Sky { .. } => "sky",
        LightFile::Constant { .. } => "constant light",
        LightFile::Envmap { .. } => "environment map",
    }
}

/// Whether a light surrounds the scene.
pub(super) fn is_environment(light: &LightFile) -> bool {
    matches!(light, LightFile::Constant { .. } | LightFile::Envmap { .. } | LightFile::Sky { .. })
}

/// Whether a light shines from a point into a part of all directions.
pub(super) fn is_spot(light: &LightFile) -> bool {
    matches!(light, LightFile::Spot { .. } | LightFile::Projector { .. })
}

/// Whether a light comes from one direction, or nearly so.
pub(super) fn is_directional(light: &LightFile) -> bool {
    matches!(light, LightFile::Directional { .. } | LightFile::Sun { .. })
}

/// Whether `test` is true for one of the material's parts.
fn has(material: &MaterialFile, test: impl Fn(&MaterialFile) -> bool) -> bool {
    material.parts().into_iter().any(test)
}

/// Whether a part is a smooth metal.
pub(super) fn is_mirror(material: &MaterialFile) -> bool {
    has(material, |part| matches!(part, MaterialFile::Conductor { .. }))
}

/// Whether a part is glass, rough or smooth.
pub(super) fn is_clear(material: &MaterialFile) -> bool {
    has(material, |part| match part {
        MaterialFile::Principled(file) => file.spec_trans > 0.0,
        other => matches!(other, MaterialFile::Dielectric { .. } | MaterialFile::RoughDielectric { .. }),
    })
}

/// Whether a part is a thin pane or a sheet that lets light through.
pub(super) fn is_pane(material: &MaterialFile) -> bool {
    has(material, |part| match part {
        MaterialFile::PrincipledThin(file) => !file.is_opaque(),
        other => matches!(other, MaterialFile::ThinDielectric { .. } | MaterialFile::Translucent { .. }),
    })
}

/// Whether a part is a rough metal or a principled material.
pub(super) fn is_glossy(material: &MaterialFile) -> bool {
    has(material, |part| {
        matches!(
            part,
            MaterialFile::RoughConductor { .. } | MaterialFile::Principled(_) | MaterialFile::PrincipledThin(_)
        )
    })
}

/// Whether a part is plastic or has a clear coat.
pub(super) fn is_coated(material: &MaterialFile) -> bool {
    has(material, |part| match part {
        MaterialFile::Principled(file) => file.clearcoat > 0.0,
        other => matches!(other, MaterialFile::Plastic { .. }),
    })
}

/// Whether some part has a lobe that is not delta, which leaves a choice of directions.
fn is_guidable(material: &MaterialFile) -> bool {
    has(material, |part| {
        !matches!(
            part,
            MaterialFile::Conductor { .. }
                | MaterialFile::Dielectric { .. }
                | MaterialFile::ThinDielectric { .. }
                | MaterialFile::Null {}
        )
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
        plan(scene).effects.into_iter().filter(|e| e.on).map(|e| e.name.name()).collect()
    }

    #[test]
    fn effects_follow_what_is_used() {
        let mut scene: SceneFile = serde_json::from_str(SCENE).unwrap();
        let all = ["direct-light", "point-lights", "transmission", "photons", "guiding", "reconstruction"];
        assert_eq!(on(&scene), all);
        scene.shapes.remove(0);
        assert_eq!(on(&scene), ["direct-light", "point-lights", "transmission"]);
        scene.lights.clear();
        scene.shapes[0].material = "unused".into();
        assert_eq!(on(&scene), ["mirrors"]);
        scene.shapes[0].emission = Some([0.0; 3]);
        assert_eq!(on(&scene), ["mirrors"], "a black lamp lights nothing");
    }

    #[test]
    fn photons_need_a_lamp_or_something_that_gathers_them() {
        let mut scene: SceneFile = serde_json::from_str(SCENE).unwrap();
        let map = LightFile::Envmap { file: "sky.exr".into(), scale: 1.0, to_world: crate::scene::file::IDENTITY };
        scene.lights = vec![map];
        assert!(plan(&scene).is_on(EffectKind::Photons));
        scene.shapes.truncate(1);
        assert!(!plan(&scene).is_on(EffectKind::Photons));
        scene.lights = vec![LightFile::Constant { radiance: [1.0; 3] }];
        assert!(!plan(&scene).is_on(EffectKind::Photons));
        scene.shapes[0].emission = Some([1.0; 3]);
        assert!(plan(&scene).is_on(EffectKind::Photons));
    }

    #[test]
    fn direct_light_needs_no_guiding() {
        let mut scene: SceneFile = serde_json::from_str(SCENE).unwrap();
        scene.render.max_depth = 2;
        let guiding = |e: &Effect| e.name == EffectKind::Guiding && !e.on && e.cause.contains("depth 2");
        assert!(plan(&scene).effects.iter().any(guiding));
    }

    #[test]
    fn names_are_those_of_the_json() {
        for kind in EffectKind::ALL {
            assert_eq!(serde_json::to_value(kind).unwrap(), kind.name());
            assert_eq!(EffectKind::named(kind.name()), Some(kind));
        }
    }
}
