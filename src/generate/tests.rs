//! Properties that every generated scene must have.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use glam::Mat4;

use super::*;
use crate::base::progress::Silent;
use crate::reconstruct::AsCounted;
use crate::render::{GuideMode, RenderSettings, StopRule, render};
use crate::scene::file::{GeometryFile, MaterialFile, Matrix};
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
    let loaded = readers::resolve(scene(family, seed, size), Path::new("."), Path::new(family.name())).unwrap();
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
