//! Photon power, and direct light against closed forms.

use crate::support::scenes;

use std::f32::consts::PI;
use std::sync::Arc;

use fanal::base::random::Random;
use fanal::generate::build::{Builder, diffuse, matrix};
use fanal::geometry::{Ray, Shape, Surface};
use fanal::guiding::learn::emission::EmissionGuide;
use fanal::integrators::path::{CameraPath, PathScratch, PathTracer, RayCount, Wants};
use fanal::integrators::photon::{PhotonScratch, PhotonTracer};
use fanal::integrators::{Roulette, TransportSettings};
use fanal::lights::area::AreaLight;
use fanal::lights::counted::SkyCounts;
use fanal::lights::distant::{Constant, Directional};
use fanal::lights::envmap::Envmap;
use fanal::lights::learned::{LearnedLights, LightSampling};
use fanal::lights::point::{Point, Spot};
use fanal::lights::projector::{Lens, Profile, Projector};
use fanal::lights::sun::Sun;
use fanal::lights::tried::{Trial, WORTH};
use fanal::lights::{BoundingSphere, Light};
use fanal::math::{Frame, channel_mean};
use fanal::picture::texture::{Texture, Wrap};
use fanal::picture::{Image, Window};
use fanal::render::{GuideMode, Outcome, RenderSettings, StopRule};
use fanal::scene::Scene;
use fanal::scene::file::{LightFile, Matrix, ProfileFile, SceneFile, TextureFile};
use glam::{Affine2, Affine3A, DQuat, DVec3, Mat3, Mat4, Quat, Vec2, Vec3};
use rayon::prelude::*;
use scenes::{GUIDES, built, built_with, coarse, floor, mean, outcome, picture};

const SKY: BoundingSphere = BoundingSphere { center: Vec3::ZERO, radius: 2.0 };

fn environment() -> Light {
    let pixels = (0..16 * 9).map(|i| Vec3::new(1.0, (i % 5) as f32, 0.1 * (i % 9) as f32)).collect();
    let turn = Mat3::from_rotation_x(0.7);
    Light::Envmap(Envmap::new(Arc::new(Image { width: 16, height: 9, pixels }), 2.0, turn))
}

/// Every light with its power by another way than its own `power`: Σ radiance · π · area, I · solid angle, the mean of looked
/// up radiance.
fn lights() -> Vec<(Light, Vec3)> {
    let color = Vec3::new(1.0, 2.0, 3.0);
    let axis = Affine3A::from_quat(Quat::from_rotation_x(1.0));
    let (cutoff, beam) = (0.9f32, 0.4f32);
    // ∫ I dω over the cone by midpoints.
    let spot: f32 = (0..10_000)
        .map(|i| (i as f32 + 0.5) * cutoff / 10_000.0)
        .map(|a| a.sin() * if a < beam { 1.0 } else { (cutoff - a) / (cutoff - beam) } * cutoff / 10_000.0)
        .sum();
    // Four pixels around the axis: each has a quarter of the light.
    let pixels = [1.0, 0.25, 0.75, 2.0].map(Vec3::splat).to_vec();
    let image = Arc::new(Image { width: 2, height: 2, pixels }).into();
    let picture = Texture::Bitmap { image, to_uv: Affine2::IDENTITY, scale: 1.0, wrap: Wrap::Clamp, nearest: true };
    let half = Vec2::splat(cutoff.tan());
    let projector = |profile, picture: &Texture| {
        Light::Projector(Box::new(Projector::new(&Lens { to_world: axis, half, profile }, color, picture.clone())))
    };
    // The solid angle of a square, and ∫ 1/cos³ dω = ∫ dA.
    let (t2, area) = (half.x * half.x, 4.0 * half.x * half.y);
    let square = 4.0 * (t2 / (1.0 + 2.0 * t2).sqrt()).atan();
    let sky = environment();
    let mut random = Random::new(2, 0, 0);
    let n = 400_000;
    let mut sum = glam::DVec3::ZERO;
    for _ in 0..n {
        sum += sky.background(fanal::sampling::warp::square_to_sphere(random.next_2d())).as_dvec3();
    }
    let covered = PI * SKY.radius * SKY.radius;
    let sphere = Shape::sphere(Vec3::ONE, 0.5, false);
    vec![
        (Light::Area(AreaLight::new(sphere, color)), color * PI * PI),
        (Light::Point(Point { position: Vec3::ONE, intensity: color }), color * 4.0 * PI),
        (Light::Spot(Spot::new(axis, color, cutoff, beam)), color * 2.0 * PI * spot),
        (projector(Profile::Even, &picture), color * square),
        (projector(Profile::Plane, &picture), color * area),
        (projector(Profile::Cone { cutoff, beam }, &picture), color * 2.0 * PI * spot),
        (projector(Profile::Plane, &Texture::Constant(Vec3::splat(0.5))), color * 0.5 * area),
        (Light::Directional(Directional { direction: Vec3::NEG_Y, irradiance: color }), color * covered),
        // Over its solid angle the disk has more than what crosses a plane: by the mean cosine, half of 1 + cos.
        (Light::Sun(Sun::new(Vec3::NEG_Y, color, 1.0)), color * covered * 2.0 / (1.0 + 0.5f32.cos())),
        (Light::Constant(Constant { radiance: color }), color * 4.0 * PI * covered),
        (sky, (sum / f64::from(n)).as_vec3() * 4.0 * PI * covered),
    ]
}

/// Within 1 %, per channel; 2e5 samples have standard errors below 0.3 %. Catches a density left out of a photon's power, and
/// photons chosen by another power than they carry.
#[test]
fn s08_emitted_photons_carry_the_power_of_the_light() {
    let mut random = Random::new(1, 0, 0);
    for (i, (light, expected)) in lights().into_iter().enumerate() {
        let n = 200_000;
        let mut sum = glam::DVec3::ZERO;
        for _ in 0..n {
            let emission = light.emit(&SKY, random.next_2d(), random.next_2d());
            sum += emission.map_or(Vec3::ZERO, |e| e.power).as_dvec3();
        }
        let emitted = (sum / f64::from(n)).as_vec3();
        for (name, power) in [("emitted", emitted), ("stated", light.power(&SKY))] {
            assert!(
                ((power - expected) / expected).abs().max_element() < 0.01,
                "light {i}, {name}: {power} {expected}"
            );
        }
    }
}

/// A floor of 2×2 under one light.
fn lit_floor(light: LightFile) -> Scene {
    let mut b = floor([8, 8], 1.0);
    b.add_light(light);
    built(b.finish())
}

/// The same under a lamp.
fn floor_under_lamp(unseen: bool) -> Scene {
    let mut b = floor([8, 8], 1.0);
    let black = b.add_material("black", scenes::one_sided(0.0));
    b.add_quad("lamp", Vec3::new(0.3, 0.7, 0.1), [Vec3::X * 0.4, Vec3::Z * 0.3], &black, Some([3.0; 3]));
    built(with_lamp(b.finish(), unseen))
}

/// The scene whose last shape is a lamp, which rays meet or do not.
fn with_lamp(mut file: SceneFile, unseen: bool) -> SceneFile {
    file.shapes.last_mut().expect("there is a lamp").unseen = unseen;
    file
}

/// A picture in squares, of which one half is dark, beyond its edges too.
fn projected(to_world: Matrix, profile: ProfileFile) -> LightFile {
    let texture = TextureFile::Checkerboard {
        color0: [2.0, 2.0, 2.0],
        color1: [0.0, 0.0, 0.0],
        to_uv: [3.0, 0.0, 0.1, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0],
    };
    LightFile::Projector { to_world, fov: 80.0, aspect: 1.5, intensity: [2.0; 3], texture, profile }
}

/// Flux into the floor by path tracing: π/albedo · the mean radiance over the floor · its area.
fn traced_flux(scene: &Scene, light_sampling: bool) -> f64 {
    traced_fluxes(scene, light_sampling, LightSampling::Plain).iter().sum::<f64>() / PARTS as f64
}

/// The same of each part.
fn traced_fluxes(scene: &Scene, light_sampling: bool, lights: LightSampling) -> Vec<f64> {
    let settings = TransportSettings { max_depth: 2, light_sampling, roulette: Roulette::Off, guided_distances: false };
    let tracer = PathTracer { scene, settings, field: None, lights };
    let part = |part: u64| {
        let (mut scratch, mut count) = (PathScratch::default(), RayCount::default());
        let mut sum = 0.0;
        for i in 0..PART {
            let mut random = Random::new(3, part, i);
            let [x, z] = random.next_2d().map(|u| 2.0 * u - 1.0);
            // From just above the floor, below the lamp.
            let ray = Ray { origin: Vec3::new(x, 0.01, z), direction: Vec3::NEG_Y };
            sum += f64::from(tracer.trace(CameraPath { ray, random, pixel: None }, &mut scratch, None, &mut count).x);
        }
        sum / PART as f64 * std::f64::consts::PI / 0.5 * 4.0
    };
    (0..PARTS).into_par_iter().map(part).collect()
}

/// Samples of a part, and parts.
const PART: u64 = 100_000;
const PARTS: u64 = 32;

/// The mean over parts, in their order.
fn mean_of_parts(parts: u64, part: impl Fn(u64) -> f64 + Send + Sync) -> f64 {
    let means: Vec<f64> = (0..parts).into_par_iter().map(part).collect();
    means.iter().sum::<f64>() / parts as f64
}

/// Flux of `Light::emit` that meets the floor's front first.
fn emitted_flux(scene: &Scene) -> f64 {
    mean_of_parts(PARTS, |part| {
        let mut random = Random::new(4, part, 0);
        let mut sum = 0.0;
        for _ in 0..PART {
            let emission = scene.lights.lights[0].emit(&scene.bounds, random.next_2d(), random.next_2d());
            let Some(emission) = emission else { continue };
            let front = |s: &Surface| s.shape == 0 && s.normal.dot(emission.ray.direction) < 0.0;
            sum += scene.intersect(&emission.ray).filter(front).map_or(0.0, |_| f64::from(emission.power.x));
        }
        sum / PART as f64
    })
}

/// The same by the photon tracer, which keeps photons straight from lights where there is no light sampling.
fn deposited_flux(scene: &Scene, light_sampling: bool, parts: u64) -> f64 {
    let emission = EmissionGuide::new(&scene.lights.emission);
    let settings =
        TransportSettings { max_depth: 2, light_sampling, roulette: Roulette::Throughput, guided_distances: false };
    let tracer = PhotonTracer { scene, settings, emission: &emission };
    mean_of_parts(parts, |part| {
        let random = |i| Random::new(5, part, i);
        let block = tracer.trace_block(0..PART, (0, PART), random, &mut PhotonScratch::default());
        let front = block.photons.iter().filter(|r| r.normal.y > 0.0 && r.point.y < 0.1);
        front.map(|r| f64::from(r.power)).sum()
    })
}

/// Within 1 %: with a share of at least 5 % of photons that arrive, standard errors are below 0.25 % and those of the traced
/// flux below 0.2 %. Catches photons that start in the wrong place or direction, a wrong cosine, and power divided by the
/// wrong count.
#[test]
fn s08_photons_bring_the_flux_that_paths_see() {
    let down = Mat4::from_rotation_translation(Quat::from_rotation_x(1.2), Vec3::new(0.1, 1.5, -0.4));
    let to_world = down.transpose().to_cols_array();
    let scenes = [
        floor_under_lamp(false),
        lit_floor(LightFile::Sun { direction: [0.5, -1.0, 0.3], irradiance: [2.0; 3], angle: 50.0 }),
        lit_floor(LightFile::Constant { radiance: [2.0; 3] }),
        floor_under_lamp(true),
        lit_floor(LightFile::Point { position: [0.2, 0.6, -0.3], intensity: [2.0; 3] }),
        lit_floor(LightFile::Spot { to_world, intensity: [2.0; 3], cutoff_angle: 40.0, beam_width: 15.0 }),
        lit_floor(projected(to_world, ProfileFile::Even {})),
        lit_floor(projected(to_world, ProfileFile::Plane {})),
        lit_floor(projected(to_world, ProfileFile::Cone { beam_width: 15.0 })),
        lit_floor(LightFile::Directional { direction: [0.5, -1.0, 0.3], irradiance: [2.0; 3] }),
    ];
    for (i, scene) in scenes.into_iter().enumerate() {
        let expected = traced_flux(&scene, true);
        assert!(expected > 0.1);
        let mut fluxes = vec![emitted_flux(&scene)];
        if i < 3 {
            fluxes.extend([deposited_flux(&scene, false, PARTS), traced_flux(&scene, false)]);
            assert_eq!(deposited_flux(&scene, true, 1), 0.0, "light sampling finds what comes straight from light {i}");
        } else {
            let found = deposited_flux(&scene, false, 1);
            assert_eq!(found, 0.0, "no camera ray can find light {i}: its photons teach nothing");
        }
        for flux in fluxes {
            assert!((flux / expected - 1.0).abs() < 0.01, "light {i}: {flux}, paths see {expected}");
        }
    }
}

/// Light that nothing scatters is in no picture: photons must not say that paths have to find it.
#[test]
fn photons_on_black_surfaces_teach_nothing() {
    let [black, grey] = [0.0, 0.5].map(|albedo| {
        let mut b = Builder::new("floor", [8, 8]);
        let material = b.add_material("floor", scenes::one_sided(albedo));
        b.add_quad("floor", Vec3::ZERO, [Vec3::Z, Vec3::X], &material, None);
        b.add_light(LightFile::Constant { radiance: [2.0; 3] });
        deposited_flux(&built(b.finish()), false, 1)
    });
    assert!(black == 0.0 && grey > 0.1, "{black} {grey}");
}

/// Two lamps in a closed room: all of their power arrives, whichever lamp a photon comes from. The powers differ by 12, so a
/// wrong probability of choosing shows; exact but for 1 % noise.
#[test]
fn s08_photons_of_several_lights_carry_their_sum() {
    let mut b = Builder::new("closed", [4, 4]);
    let wall = b.add_material("wall", diffuse([0.5; 3]));
    b.add_block("room", Vec3::splat(-1.0), Vec3::ONE, &wall);
    b.add_sphere("a", Vec3::new(0.4, 0.0, 0.0), 0.2, &wall, Some([1.0; 3]));
    b.add_sphere("b", Vec3::new(-0.4, 0.2, 0.0), 0.1, &wall, Some([48.0; 3]));
    let scene = built(b.finish());
    let emission = EmissionGuide::new(&scene.lights.emission);
    let settings = TransportSettings {
        max_depth: 2,
        light_sampling: false,
        roulette: Roulette::Throughput,
        guided_distances: false,
    };
    let tracer = PhotonTracer { scene: &scene, settings, emission: &emission };
    let n = 100_000;
    let block = tracer.trace_block(0..n, (0, n), |i| Random::new(6, 0, i), &mut PhotonScratch::default());
    let power: f64 = block.photons.iter().map(|r| f64::from(r.power)).sum();
    let expected = 4.0 * std::f64::consts::PI.powi(2) * (0.04 + 48.0 * 0.01);
    assert!((power / expected - 1.0).abs() < 0.01, "{power} {expected}");
}

/// Form factor from a point to a parallel rectangle of half sides `a` and `b` at distance 1 above it (Howell, B-3, four corners).
fn rectangle_factor(a: f64, b: f64) -> f64 {
    let side = |x: f64, y: f64| x / (1.0 + x * x).sqrt() * (y / (1.0 + x * x).sqrt()).atan();
    4.0 * (side(a, b) + side(b, a)) / (2.0 * std::f64::consts::PI)
}

/// Radiance of the floor's centre, albedo 1/2, at 256 spp in 32×32 pixels, within 1 ± 0.025 (at 64 where lights are sampled,
/// which has less noise): the noisiest case, finding a
/// factor of 0.18 by BSDF sampling alone, has a standard error of 0.42 %, so the bound is 6σ. Catches any missing π, cosine or
/// distance².
fn direct(name: &str, scene: &Scene, irradiance: f64, reachable: bool) {
    let expected = irradiance * 0.5 / std::f64::consts::PI;
    for (guide, light_sampling) in GUIDES.iter().flat_map(|&guide| [(guide, true), (guide, false)]) {
        let transport =
            TransportSettings { max_depth: 2, light_sampling, roulette: Roulette::Throughput, guided_distances: false };
        let spp = match (light_sampling, reachable) {
            (true, _) => 64,
            (false, true) => 256,
            (false, false) => 16,
        };
        let found = mean(&picture(scene, &RenderSettings { transport, ..coarse(guide, spp, 1) }));
        if light_sampling || reachable {
            assert!(
                (found / expected - 1.0).abs() < 0.025,
                "{name}, {guide:?}, light sampling {light_sampling}: {found} {expected}"
            );
        } else {
            assert_eq!(found, 0.0, "{name}: nothing can hit this light");
        }
    }
}

#[test]
fn s04_direct_light_has_its_closed_form() {
    let pi = std::f64::consts::PI;
    let lamp = |emission| {
        let mut b = floor([32, 32], 1.0);
        let black = b.add_material("black", scenes::one_sided(0.0));
        (emission, black, b)
    };
    let (emission, black, mut b) = lamp(Some([3.0; 3]));
    b.add_quad("lamp", Vec3::Y, [Vec3::X * 0.6, Vec3::Z * 0.5], &black, emission);
    // The camera looks through below the lamp's edge: its ray rises 0.8 over a run of 0.6.
    b.look_at(Vec3::new(0.9, 0.3, 0.0), Vec3::ZERO, Vec3::Z, 0.5);
    direct("rectangle", &built(b.clone().finish()), 3.0 * pi * rectangle_factor(0.6, 0.5), true);
    // And the camera through the lamp, where it is not seen.
    b.look_at(Vec3::new(0.2, 3.0, 0.0), Vec3::ZERO, Vec3::Z, 0.5);
    direct("unseen", &built(with_lamp(b.finish(), true)), 3.0 * pi * rectangle_factor(0.6, 0.5), false);
    let (emission, black, mut b) = lamp(Some([5.0; 3]));
    b.add_sphere("ball", Vec3::new(0.0, 1.0, 0.5), 0.5, &black, emission);
    // π·L·sin²α·cos θ with sin²α = r²/d², cos θ = 1/d.
    let ball = b.finish();
    for unseen in [false, true] {
        direct("sphere", &built(with_lamp(ball.clone(), unseen)), 5.0 * pi * 0.25 / 1.25 / 1.25f64.sqrt(), !unseen);
    }
    let position = Vec3::new(0.3, 1.2, 0.4);
    let d2: f64 = 0.09 + 1.44 + 0.16;
    let of_point = 2.0 * 1.2 / (d2 * d2.sqrt());
    let mut b = floor([32, 32], 1.0);
    b.add_light(LightFile::Point { position: position.to_array(), intensity: [2.0; 3] });
    direct("point", &built(b.finish()), of_point, false);
    // Aimed beside the floor's middle: by 4° of a beam of 15°, and by 27°, where half of the way to the cutoff is left.
    for (name, target) in [("spot", Vec3::new(0.1, 0.0, 0.0)), ("edge of a spot", Vec3::new(0.6, 0.0, -0.2))] {
        let axis = target - position;
        let turn = Quat::from_rotation_arc(Vec3::Z, axis.normalize());
        let to_world = matrix(Mat4::from_rotation_translation(turn, position));
        // Without noise: every sample has the light that the point has.
        let mut b = floor([8, 8], 1.0);
        b.add_light(LightFile::Spot { to_world, intensity: [2.0; 3], cutoff_angle: 40.0, beam_width: 15.0 });
        let beside = axis.as_dvec3().angle_between(-position.as_dvec3()).to_degrees();
        direct(name, &built(b.finish()), of_point * ((40.0 - beside) / 25.0).min(1.0), false);
    }
    // On a plane across its axis the light of a projector is the same all over; else its intensity is the same in all directions.
    let below = Mat4::from_rotation_translation(Quat::from_rotation_arc(Vec3::Z, Vec3::NEG_Y), position);
    let cos = 1.2 / d2.sqrt();
    for (name, profile, factor) in
        [("picture", ProfileFile::Even {}, 1.0), ("flat picture", ProfileFile::Plane {}, 1.0 / (cos * cos * cos))]
    {
        let (to_world, texture) = (matrix(below), TextureFile::rgb([0.5; 3]));
        let mut b = floor([8, 8], 0.2);
        let intensity = [4.0; 3];
        b.add_light(LightFile::Projector { to_world, fov: 70.0, aspect: 1.2, intensity, texture, profile });
        direct(name, &built(b.finish()), of_point * factor, false);
    }
    let mut b = floor([32, 32], 1.0);
    let n = Frame::new(Vec3::new(0.5, -1.0, 0.0).normalize()).n;
    b.add_light(LightFile::Directional { direction: n.to_array(), irradiance: [2.0; 3] });
    direct("directional", &built(b.finish()), 2.0 / 1.25f64.sqrt(), false);
    let mut b = floor([32, 32], 1.0);
    b.add_light(LightFile::Constant { radiance: [2.0; 3] });
    direct("constant", &built(b.finish()), 2.0 * pi, true);
    // A disk that is wholly above the floor has its irradiance times the cosine of its centre; before a sky both add up, although
    // a ray that leaves meets both, and a lamp is chosen besides.
    for (angle, sky) in [(60.0, None), (60.0, Some(2.0)), (70.0, Some(0.01))] {
        let mut b = floor([32, 32], 1.0);
        b.add_light(LightFile::Sun { direction: n.to_array(), irradiance: [2.0; 3], angle });
        if let Some(radiance) = sky {
            b.add_light(LightFile::Constant { radiance: [radiance; 3] });
        }
        let of_sky = f64::from(sky.unwrap_or(0.0)) * pi;
        direct(&format!("sun and sky {sky:?}"), &built(b.finish()), 2.0 / 1.25f64.sqrt() + of_sky, true);
    }
}

/// Radiance of a picture around the scene, in its own frame, by the convention that scene files document: u = atan2(x, −z)/2π and
/// v = acos(y)/π, columns at u = (i + ½)/W, rows at v = j/(H − 1), bilinear between them.
fn around(image: &Image, direction: DVec3) -> f64 {
    let turns = direction.x.atan2(-direction.z) / (2.0 * std::f64::consts::PI);
    let x = turns * image.width as f64 - 0.5;
    let y = direction.y.clamp(-1.0, 1.0).acos() / std::f64::consts::PI * (image.height - 1) as f64;
    let texel = |x: f64, y: f64| {
        let (column, row) = (x.rem_euclid(image.width as f64) as usize, (y as usize).min(image.height - 1));
        f64::from(channel_mean(image.pixels[row * image.width + column]))
    };
    let (left, top) = (x.floor(), y.floor());
    let row = |y: f64| texel(left, y) + (texel(left + 1.0, y) - texel(left, y)) * (x - left);
    row(top) + (row(top + 1.0) - row(top)) * (y - top)
}

/// A turned sky with one texel forty times as bright as the others, above the floor: ∫ L cos θ dω is π times the mean over a grid
/// of sin²θ and φ, right to 1e-4. Nearly half of the light is that texel's, so a picture that is turned the wrong way, mirrored or
/// off by a texel shows.
#[test]
fn s04_a_sky_lights_by_its_integral() {
    let mut image = Image { width: 16, height: 9, pixels: vec![Vec3::new(1.0, 0.5, 1.5); 16 * 9] };
    image.pixels[2 * 16 + 13] = Vec3::new(40.0, 20.0, 60.0);
    let turn = DQuat::from_rotation_x(0.7) * DQuat::from_rotation_y(0.4);
    let (n, pi) = (500, std::f64::consts::PI);
    let at = |i: i32| (f64::from(i) + 0.5) / f64::from(n);
    let radiance = |i: i32| {
        let (sin, (y, x)) = (at(i % n).sqrt(), (2.0 * pi * at(i / n)).sin_cos());
        around(&image, turn.inverse() * DVec3::new(sin * x, (1.0 - at(i % n)).sqrt(), sin * y))
    };
    let irradiance = 2.0 * pi * (0..n * n).map(radiance).sum::<f64>() / f64::from(n * n);
    let to_world = matrix(Mat4::from_quat(turn.as_quat()));
    let sky = LightFile::Envmap { file: "sky".into(), scale: 2.0, to_world };
    let scene = built_with(floor([32, 32], 1.0).finish(), |loaded| {
        loaded.file.lights.push(sky);
        loaded.images.insert("sky".into(), Arc::new(image).into());
    });
    assert!((10.0..13.0).contains(&irradiance), "{irradiance}");
    direct("sky", &scene, irradiance, true);
}

/// A floor under a roof, which sees an uneven sky on one side alone.
fn under_a_roof(size: [u32; 2]) -> Scene {
    let pixels = (0..48 * 24).map(|i| Vec3::splat(if i == 5 * 48 + 9 { 60.0 } else { 1.0 + (i % 7) as f32 })).collect();
    let image = Image { width: 48, height: 24, pixels };
    let mut b = floor(size, 1.0);
    let black = b.add_material("black", diffuse([0.0; 3]));
    b.add_quad("roof", Vec3::new(-1.0, 0.4, 0.0), [Vec3::X * 2.0, Vec3::Z * 5.0], &black, None);
    // From below the roof.
    b.look_at(Vec3::new(1.5, 0.35, 0.0), Vec3::ZERO, Vec3::Z, 0.5);
    let sky = LightFile::Envmap { file: "sky".into(), scale: 1.0, to_world: matrix(Mat4::IDENTITY) };
    built_with(b.finish(), |loaded| {
        loaded.file.lights.push(sky);
        loaded.images.insert("sky".into(), Arc::new(image).into());
    })
}

/// Where the sky is seen is found out for the whole picture, so that a window has the bits that it has in the whole: parts of pictures and
/// replayed samples rely on that. A picture of few pixels finds out nothing.
#[test]
fn a_window_knows_the_sky_of_the_whole_picture() {
    let settings = RenderSettings::new(GuideMode::None, StopRule::Spp(1));
    let is_learned = |of: &Outcome| of.statistics.decisions.iter().any(|decision| decision.starts_with("sky sampled"));
    let scene = under_a_roof([256, 192]);
    let whole = outcome(&scene, &settings);
    assert!(is_learned(&whole), "{:?}", whole.statistics.decisions);
    let window = Window { x: 40, y: 20, width: 16, height: 24 };
    let part = outcome(&scene, &RenderSettings { crop: Some(window), ..settings.clone() });
    assert!(is_learned(&part));
    for (i, pixel) in part.image.pixels.iter().enumerate() {
        let (x, y) = (window.x as usize + i % 16, window.y as usize + i / 16);
        assert_eq!(*pixel, whole.image.pixels[y * 256 + x], "{x} {y}");
    }
    assert!(!is_learned(&outcome(&under_a_roof([32, 32]), &settings)));
}

/// Variances of the parts of two traces, whose means differ by less than five standard errors.
fn variances_of_one_mean(traces: [&[f64]; 2]) -> [f64; 2] {
    let [(mean, variance), (found, other)] = traces.map(|parts| {
        let mean = parts.iter().sum::<f64>() / PARTS as f64;
        (mean, parts.iter().map(|part| (part - mean).powi(2)).sum::<f64>() / (PARTS - 1) as f64)
    });
    let error = ((variance + other) / PARTS as f64).sqrt();
    assert!((mean - found).abs() < 5.0 * error, "{mean} {found}, standard error {error}");
    [variance, other]
}

/// A floor under a roof sees the sky on one side alone. Light sampling by where the sky was seen brings the same light as by the map, with less
/// noise. The means of 32 parts of 100,000 paths differ by less than five standard errors: a false alarm in 1.7 million seeds.
#[test]
fn s04_a_sky_seen_past_a_roof_is_sampled_without_bias() {
    let scene = under_a_roof([32, 32]);
    let counts = SkyCounts::default();
    let counted = traced_fluxes(&scene, true, LightSampling::Counted(&counts));
    let plain = traced_fluxes(&scene, true, LightSampling::Plain);
    assert_eq!(counted, plain, "counting changes nothing");
    let map = scene.lights.only_map().expect("there is one");
    let sky = Some(counts.learned(map).expect("less than half of it is seen"));
    let learned = LearnedLights { sky, places: None };
    let sampled = traced_fluxes(&scene, true, (&learned).into());
    let [variance, lower] = variances_of_one_mean([&plain, &sampled]);
    // Of 32 parts the ratio is known to a quarter: 0.76 here. How far samples follow what was counted is tested beside the counting.
    assert!(lower < variance, "{variance} {lower}");
}

/// A floor with two walls across it, and between them lamps of all kinds: emitting spheres and squares, points and spots.
fn four_rooms(size: [u32; 2]) -> Scene {
    let mut b = floor(size, 1.0);
    let black = b.add_material("black", diffuse([0.0; 3]));
    b.add_block("wall", Vec3::new(-0.02, 0.0, -1.0), Vec3::new(0.02, 1.5, 1.0), &black);
    b.add_block("wall", Vec3::new(-1.0, 0.0, -0.02), Vec3::new(1.0, 1.5, 0.02), &black);
    for i in 0..24 {
        let side = if i % 2 == 0 { 1.0 } else { -1.0 };
        let at =
            Vec3::new(side * (0.15 + 0.8 * (i as f32 / 24.0)), 0.3 + 0.1 * (i % 5) as f32, 0.3 * (i % 7) as f32 - 0.8);
        let bright = 1.0 + (i % 3) as f32;
        match i / 6 {
            0 => b.add_sphere("lamp", at, 0.03, &black, Some([50.0 * bright; 3])),
            1 => b.add_quad("lamp", at, [Vec3::X * 0.05, Vec3::Z * 0.05], &black, Some([30.0 * bright; 3])),
            2 => b.add_light(LightFile::Point { position: at.to_array(), intensity: [0.2 * bright; 3] }),
            _ => {
                let down = Mat4::from_rotation_translation(Quat::from_rotation_x(std::f32::consts::FRAC_PI_2), at);
                let (cutoff_angle, beam_width) = (50.0, 40.0);
                b.add_light(LightFile::Spot {
                    to_world: matrix(down),
                    intensity: [bright; 3],
                    cutoff_angle,
                    beam_width,
                });
            }
        }
    }
    // All rooms, from above.
    b.look_at(Vec3::new(0.0, 3.0, 0.1), Vec3::ZERO, Vec3::Z, 50.0);
    built(b.finish())
}

/// What came of lamps that light sampling has chosen on the floor of four rooms.
fn tried(scene: &Scene) -> Vec<Vec<Trial>> {
    let settings =
        TransportSettings { max_depth: 2, light_sampling: true, roulette: Roulette::Off, guided_distances: false };
    let counts = SkyCounts::default();
    let tracer = PathTracer { scene, settings, field: None, lights: LightSampling::Counted(&counts) };
    let block = |block: u64| {
        let mut scratch = PathScratch::default();
        let begin = |i| {
            let mut random = Random::new(13, block, i);
            let [x, z] = random.next_2d().map(|u| 2.0 * u - 1.0);
            CameraPath { ray: Ray { origin: Vec3::new(x, 0.01, z), direction: Vec3::NEG_Y }, random, pixel: None }
        };
        tracer.trace_all((0..1000).map(begin), Wants::Radiance, &mut scratch, &mut RayCount::default());
        scratch.trials().to_vec()
    };
    (0..32).map(block).collect()
}

/// Lamps behind a wall are left alone without bias. The means of 32 parts of 100,000 paths differ by less than five standard errors (a false
/// alarm in 1.7 million seeds), and their variance is less: most of it is of lamps that were chosen in vain.
#[test]
fn s04_lamps_behind_a_wall_are_left_alone_without_bias() {
    let scene = four_rooms([32, 32]);
    let trials = tried(&scene);
    let places = Some(scene.lights.places(&trials, WORTH).expect("most lamps are in vain"));
    let learned = LearnedLights { sky: None, places };
    let [plain, sampled] = [LightSampling::Plain, (&learned).into()].map(|lights| traced_fluxes(&scene, true, lights));
    let [variance, lower] = variances_of_one_mean([&plain, &sampled]);
    assert!(lower < variance, "{variance} {lower}");
}

/// Which lights pay is found out for the whole picture too, by any number of threads, and with and without a guide.
#[test]
fn a_window_knows_the_lamps_of_the_whole_picture() {
    let settings = RenderSettings::new(GuideMode::None, StopRule::Spp(32));
    let is_learned =
        |of: &Outcome| of.statistics.decisions.iter().any(|decision| decision.starts_with("lights sampled"));
    let scene = four_rooms([192, 144]);
    let whole = outcome(&scene, &settings);
    assert!(is_learned(&whole), "{:?}", whole.statistics.decisions);
    let window = Window { x: 40, y: 20, width: 16, height: 24 };
    let part = RenderSettings { crop: Some(window), ..settings.clone() };
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread");
    let part = one.install(|| outcome(&scene, &part));
    for (i, pixel) in part.image.pixels.iter().enumerate() {
        let (x, y) = (window.x as usize + i % 16, window.y as usize + i / 16);
        assert_eq!(*pixel, whole.image.pixels[y * 192 + x], "{x} {y}");
    }
    // Too few samples to be worth it.
    assert!(!is_learned(&outcome(&scene, &RenderSettings { stop: StopRule::Spp(4), ..settings })));
}
