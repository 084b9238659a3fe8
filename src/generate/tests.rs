//! Properties that every generated scene must have.

use std::collections::BTreeSet;
use std::sync::atomic::AtomicBool;

use glam::Mat4;

use super::*;
use crate::base::progress::Silent;
use crate::reconstruct::AsCounted;
use crate::render::{GuideMode, RenderSettings, StopRule, render};
use crate::scene::file::{GeometryFile, LightFile, MaterialFile, Matrix, MeshFile, ShapeFile, TextureFile};
use crate::scene::{Scene, readers};

const SEEDS: std::ops::Range<u64> = 0..150;

fn every_scene(check: impl Fn(&SceneFile)) {
    for family in Family::ALL {
        SEEDS.for_each(|seed| check(&scene(family, seed, DEFAULT_SIZE)));
    }
}

fn determinant(m: &Matrix) -> f32 {
    Mat4::from_cols_array(m).transpose().determinant()
}

#[test]
fn scenes_are_whole() {
    every_scene(|scene| {
        let text = text::json(scene).unwrap();
        assert_eq!(
            &serde_json::from_str::<SceneFile>(&text).unwrap(),
            scene,
            "a null would be a number that is not finite"
        );
        assert!(
            !scene.lights.is_empty() || scene.shapes.iter().any(|s| s.emission.is_some()),
            "{} is dark",
            scene.name
        );
        for shape in &scene.shapes {
            assert!(scene.materials.contains_key(&shape.material));
            assert!(
                determinant(&shape.to_world) > 0.0,
                "{}: a mirrored {} would be inside out",
                scene.name,
                shape.name
            );
            assert!(shape.emission.is_none_or(|e| e.iter().all(|c| c.is_finite() && *c > 0.0)));
            if let GeometryFile::Mesh { mesh } = &shape.geometry {
                assert!(scene.meshes.contains_key(mesh));
            }
        }
        assert!((8..=12).contains(&scene.render.max_depth));
        assert!((determinant(&scene.camera.to_world) - 1.0).abs() < 1e-3);
    });
}

#[test]
fn scenes_follow_from_their_seed_alone() {
    for family in Family::ALL {
        let names: BTreeSet<String> =
            SEEDS.map(|seed| text::json(&scene(family, seed, DEFAULT_SIZE)).unwrap()).collect();
        assert_eq!(names.len(), SEEDS.count());
        assert_eq!(scene(family, 5, DEFAULT_SIZE), scene(family, 5, DEFAULT_SIZE));
    }
}

/// The camera stands in free space, and sees something that is not right before it.
#[test]
fn cameras_are_free() {
    for family in Family::ALL {
        let (mut stuck, mut close) = (0, 0);
        for seed in SEEDS {
            let mut builder = Builder::new("test", DEFAULT_SIZE);
            family.build()(&mut Draw::new(family.id(), seed), &mut builder);
            let solids = builder.solids().clone();
            let camera = Mat4::from_cols_array(&builder.finish().camera.to_world).transpose();
            let [along, origin] = [camera.z_axis, camera.w_axis].map(|c| c.truncate());
            stuck += u32::from(solids.distance(origin) <= 0.0);
            close += u32::from(solids.free_path(origin, along, 1.0) < 0.1);
        }
        assert_eq!(stuck, 0, "{}", family.name());
        assert!(close <= 3, "{}: {close}", family.name());
    }
}

/// Mean over pixels and channels of a small path-traced picture.
fn mean_of_picture(family: Family, seed: u64) -> f64 {
    let size = [24, 24];
    let loaded = load(family, seed, size).unwrap();
    let scene = Scene::build(&loaded, size).unwrap();
    let mut settings = RenderSettings::new(GuideMode::None, StopRule::Spp(16));
    settings.transport.max_depth = loaded.file.render.max_depth;
    let outcome = render(&scene, &settings, &AsCounted::default(), &Silent, &AtomicBool::new(false)).unwrap();
    let pixels = &outcome.image.pixels;
    pixels.iter().map(|p| f64::from(p.element_sum()) / 3.0).sum::<f64>() / pixels.len() as f64
}

/// Light reaches the camera: nothing walls in the lamps of a family, or the camera, but for a chance in few scenes.
#[test]
fn pictures_are_lit() {
    const SCENES: usize = 10;
    for family in Family::ALL {
        let means: Vec<f64> = (0..SCENES as u64).map(|seed| mean_of_picture(family, seed)).collect();
        assert!(means.iter().all(|m| m.is_finite()), "{}: {means:?}", family.name());
        let lit = means.iter().filter(|&&m| m > 0.0).count();
        assert!(lit >= SCENES - 2, "{}: {means:?}", family.name());
    }
}

/// Scenes vary as training needs: every kind of material somewhere, and lamps from few to many.
#[test]
fn scenes_are_varied() {
    let kind = |m: &MaterialFile| {
        let value = serde_json::to_value(m.innermost()).unwrap();
        value["type"].as_str().unwrap().to_owned()
    };
    for family in Family::ALL {
        let scenes = SEEDS.map(|seed| scene(family, seed, DEFAULT_SIZE));
        let kinds: BTreeSet<String> = scenes.flat_map(|s| s.materials.values().map(kind).collect::<Vec<_>>()).collect();
        for wanted in
            ["diffuse", "conductor", "rough_conductor", "dielectric", "rough_dielectric", "plastic", "principled"]
        {
            assert!(kinds.contains(wanted), "{} has no {wanted}", family.name());
        }
    }
    let lamps = |s: &SceneFile| s.lights.len() + s.shapes.iter().filter(|s| s.emission.is_some()).count();
    let counts: Vec<usize> = SEEDS.map(|seed| lamps(&scene(Family::Lamps, seed, DEFAULT_SIZE))).collect();
    assert!(counts.iter().all(|n| (1..=200).contains(n)), "{counts:?}");
    assert!(counts.iter().any(|&n| n < 4) && counts.iter().any(|&n| n > 80), "{counts:?}");
}

/// Interiors are what they are for: some lit by pictures around them, some by a sky, some by lamps alone, some in haze, some of very
/// many triangles.
#[test]
fn interiors_are_as_artists_make_them() {
    let triangles = |scene: &SceneFile| -> usize {
        let of = |shape: &ShapeFile| match &shape.geometry {
            GeometryFile::Mesh { mesh } => match &scene.meshes[mesh] {
                MeshFile::Inline { triangles, .. } => triangles.len(),
                _ => 12,
            },
            GeometryFile::Sphere { .. } => 1,
        };
        scene.shapes.iter().map(of).sum()
    };
    let scenes: Vec<SceneFile> = SEEDS.map(|seed| scene(Family::Interiors, seed, DEFAULT_SIZE)).collect();
    let share = |is: &dyn Fn(&SceneFile) -> bool| scenes.iter().filter(|s| is(s)).count() as f64 / scenes.len() as f64;
    let lit_by = |is: fn(&LightFile) -> bool| share(&|s: &SceneFile| s.lights.iter().any(is));
    assert!(lit_by(|l| matches!(l, LightFile::Envmap { .. })) > 0.2);
    assert!(lit_by(|l| matches!(l, LightFile::Sky { .. })) > 0.2);
    assert!(share(&|s| s.lights.is_empty()) > 0.1);
    assert!((0.03..0.3).contains(&share(&|s| !s.media.is_empty())));
    assert!(share(&|s| triangles(s) > 100_000) > 0.05, "{:?}", scenes.iter().map(triangles).collect::<Vec<_>>());
    let textured = |s: &SceneFile| {
        let all = s.materials.values().flat_map(|m| m.textures());
        all.filter(|(_, texture)| matches!(texture, TextureFile::Bitmap { .. })).count()
    };
    assert!(share(&|s| textured(s) > 0) > 0.9);
}

/// Glazed scenes are what they are for: something in glass in each, half of them by day, lamps in globes in some; and where a case is
/// hollow, its inner faces lead from glass into air.
#[test]
fn glazed_scenes_are_behind_glass() {
    let scenes: Vec<SceneFile> = SEEDS.map(|seed| scene(Family::Glazed, seed, DEFAULT_SIZE)).collect();
    let share = |is: &dyn Fn(&SceneFile) -> bool| scenes.iter().filter(|s| is(s)).count() as f64 / scenes.len() as f64;
    let has_shape = |name: &'static str| share(&move |s: &SceneFile| s.shapes.iter().any(|shape| shape.name == name));
    let kept_in = ["case", "jar", "globe"].map(has_shape);
    assert!(kept_in.iter().all(|share| *share > 0.1), "{kept_in:?}");
    let glass = |m: &MaterialFile| {
        use MaterialFile::{Dielectric, RoughDielectric, ThinDielectric};
        matches!(m, Dielectric { .. } | RoughDielectric { .. } | ThinDielectric { .. })
    };
    assert!(share(&|s| s.materials.values().any(glass)) > 0.95);
    let by_day = share(&|s| !s.lights.is_empty());
    assert!((0.35..0.65).contains(&by_day), "{by_day}");
    let inner = scenes.iter().flat_map(|s| &s.materials).filter(|(name, _)| name.starts_with("inner glass"));
    let mut hollows = 0;
    for (_, material) in inner {
        let (MaterialFile::Dielectric { int_ior, ext_ior } | MaterialFile::RoughDielectric { int_ior, ext_ior, .. }) =
            material
        else {
            panic!("{material:?}");
        };
        assert!(*int_ior == 1.0 && *ext_ior > 1.2);
        hollows += 1;
    }
    assert!(hollows > 20, "{hollows}");
}

/// What is written into a folder is the scene that is in memory, to the last bit of its pictures.
#[test]
fn written_scenes_are_those_in_memory() {
    let folder = tempfile::tempdir().unwrap();
    let has_surrounding = |seed: &u64| {
        let scene = scene(Family::Interiors, *seed, DEFAULT_SIZE);
        scene.lights.iter().any(|light| matches!(light, LightFile::Envmap { .. }))
    };
    let seed = SEEDS.into_iter().find(has_surrounding).unwrap();
    write(Family::Interiors, seed, DEFAULT_SIZE, folder.path()).unwrap();
    let (read, made) = (readers::load(folder.path()).unwrap(), load(Family::Interiors, seed, DEFAULT_SIZE).unwrap());
    assert_eq!(read.file, made.file);
    assert_eq!(read.crc32(), made.crc32());
}
