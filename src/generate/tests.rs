//! What every generated scene must fulfil.

use std::collections::BTreeSet;

use glam::Mat4;

use super::*;
use crate::scene::file::{GeometryFile, LightFile, Matrix};

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
        let sky = scene.lights.iter().any(|l| matches!(l, LightFile::Constant { .. }));
        assert!(sky || scene.shapes.iter().any(|s| s.emission.is_some()), "{} is dark", scene.name);
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
    for (family, build) in [
        (Family::Primitives, primitives::build as fn(&mut Draw, &mut Builder)),
        (Family::Rooms, rooms::build),
        (Family::Caustics, caustics::build),
    ] {
        let (mut stuck, mut close) = (0, 0);
        for seed in SEEDS {
            let mut builder = Builder::new("test", DEFAULT_SIZE);
            build(&mut Draw::new(family.id(), seed), &mut builder);
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
