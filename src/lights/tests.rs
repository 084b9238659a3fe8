//! Sixteen points at once have the bits of each alone, whatever the lights.

use std::sync::Arc;

use glam::{Affine2, Affine3A, Mat3, Quat, Vec2, Vec3};

use super::counted::SkyCounts;
use super::places::Odds;
use super::projector::{Lens, Profile, Projector};
use super::seen::{LearnedSky, LightView};
use super::*;
use crate::base::processor::{Avx2, Avx512};
use crate::base::random::Random;
use crate::geometry::Shape;
use crate::geometry::mesh::Mesh;
use crate::math::lanes::{Kernel, LANES, Wide};
use crate::picture::Image;
use crate::picture::texture::{Texture, Wrap};

fn vector(random: &mut Random, extent: f32) -> Vec3 {
    Vec3::new(random.range(-extent, extent), random.range(-extent, extent), random.range(-extent, extent))
}

fn unit(random: &mut Random) -> Vec3 {
    vector(random, 1.0).normalize_or(Vec3::Z)
}

/// Triangles in a soup, one of which has no area.
fn mesh(random: &mut Random) -> Shape {
    let centre = vector(random, 5.0);
    let count = 1 + random.below(40);
    let positions = (0..3 * count).map(|_| centre + vector(random, 0.5)).collect();
    let triangles = (0..count).map(|i| [3 * i, 3 * i + 1, if i == 7 { 3 * i } else { 3 * i + 2 }]).collect();
    let to_world = Affine3A::from_rotation_translation(Quat::from_rotation_y(random.next_f32()), vector(random, 1.0));
    Shape::mesh(Arc::new(Mesh { positions, triangles, ..Mesh::default() }), to_world, random.below(2) == 0)
}

/// A picture of which much is black, or a dome that ends.
fn map(random: &mut Random) -> Envmap {
    let to_world = Mat3::from_quat(Quat::from_axis_angle(unit(random), random.range(0.0, 6.0)));
    if random.below(4) == 0 {
        return Envmap::dome([24, 9], 1.7, 0.5, to_world, |d| (d.as_vec3() + Vec3::ONE).abs());
    }
    let [width, height] = [1 + random.below(60) as usize, 1 + random.below(40) as usize];
    let black = random.below(3) * 4;
    let pixel = |_| if random.below(10) < black { Vec3::ZERO } else { vector(random, 2.0).abs() };
    let pixels = (0..width * height).map(pixel).collect();
    Envmap::new(Arc::new(Image { width, height, pixels }), 2.0, to_world)
}

/// A picture, some pixels of which are black, anyhow placed.
fn texture(random: &mut Random) -> Texture {
    let [width, height] = [1 + random.below(9) as usize, 1 + random.below(9) as usize];
    let pixel = |_| if random.below(3) == 0 { Vec3::ZERO } else { vector(random, 2.0).abs() };
    let pixels = (0..width * height).map(pixel).collect();
    let image = Arc::new(Image { width, height, pixels }).into();
    let scale = Vec2::new(random.range(-3.0, 3.0), random.range(0.1, 2.0));
    let to_uv = Affine2::from_scale_angle_translation(scale, random.range(0.0, 6.0), Vec2::new(0.3, -0.4));
    let wrap = [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp][random.below(3) as usize];
    Texture::Bitmap { image, to_uv, scale: 1.5, wrap, nearest: random.below(2) == 0 }
}

/// A picture through a perspective, or in a cone; the axes of some are not at right angles.
fn projector(intensity: Vec3, random: &mut Random) -> Projector {
    let turn = Quat::from_axis_angle(unit(random), random.range(0.0, 6.0));
    let mut to_world = Affine3A::from_rotation_translation(turn, vector(random, 5.0));
    if random.below(2) == 0 {
        to_world.matrix3.x_axis += 0.3 * to_world.matrix3.y_axis;
    }
    let half = Vec2::new(random.range(0.01, 3.0), random.range(0.01, 3.0));
    let cutoff = half.x.atan();
    let profile = match random.below(3) {
        0 => Profile::Even,
        1 => Profile::Plane,
        _ => Profile::Cone { cutoff, beam: cutoff * random.next_f32() },
    };
    let picture = if random.below(4) == 0 { Texture::Constant(Vec3::ONE) } else { texture(random) };
    Projector::new(&Lens { to_world, half, profile }, intensity, picture)
}

fn light(kind: u32, random: &mut Random) -> Light {
    let radiance = vector(random, 3.0).abs();
    match kind {
        0 if random.below(3) == 0 => Light::Area(AreaLight::textured(mesh(random), radiance, texture(random))),
        0 => Light::Area(AreaLight::new(mesh(random), radiance)),
        1 => {
            let sphere = Shape::sphere(vector(random, 5.0), random.range(0.01, 1.0), false);
            let shape = if random.below(2) == 0 { mesh(random) } else { sphere };
            Light::Area(AreaLight::new(Shape { unseen: true, ..shape }, radiance))
        }
        2 if random.below(3) == 0 => {
            let shape = Shape::sphere(vector(random, 5.0), random.range(0.01, 1.0), random.below(3) == 0);
            Light::Area(AreaLight::textured(shape, radiance, texture(random)))
        }
        2 => {
            let shape = Shape::sphere(vector(random, 5.0), random.range(0.01, 1.0), random.below(3) == 0);
            Light::Area(AreaLight::new(shape, radiance))
        }
        3 => Light::Point(Point { position: vector(random, 5.0), intensity: radiance }),
        4 => {
            let turn = Quat::from_axis_angle(unit(random), random.range(0.0, 6.0));
            let to_world = Affine3A::from_rotation_translation(turn, vector(random, 5.0));
            let cutoff = random.range(0.0, std::f32::consts::PI);
            let beam = if random.below(4) == 0 { cutoff } else { cutoff * random.next_f32() };
            Light::Spot(Spot::new(to_world, radiance, cutoff, beam))
        }
        5 => Light::Directional(Directional { direction: unit(random), irradiance: radiance }),
        6 => Light::Sun(Sun::new(unit(random), radiance, random.range(0.001, 2.0))),
        7 => Light::Constant(Constant { radiance }),
        9 => Light::Projector(Box::new(projector(radiance, random))),
        _ => Light::Envmap(map(random)),
    }
}

/// Kinds of light of scenes: each alone, then mixtures of few kinds and of all.
const MIXTURES: [&[u32]; 20] = [
    &[0],
    &[2],
    &[3],
    &[4],
    &[5],
    &[6],
    &[7],
    &[8],
    &[0, 2],
    &[1],
    &[0, 1, 2, 8],
    &[3, 4],
    &[6, 8],
    &[0, 8],
    &[5, 6, 7, 8],
    &[0, 2, 3, 4],
    &[9],
    &[4, 8, 9],
    &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9],
    &[],
];

fn scene(kinds: &[u32], count: u32, random: &mut Random) -> LightSet {
    let pick = |random: &mut Random| kinds[random.below(kinds.len() as u32) as usize];
    let lights = (0..if kinds.is_empty() { 0 } else { count }).map(|_| {
        let kind = pick(random);
        light(kind, random)
    });
    LightSet::new(lights.collect(), &BoundingSphere { center: Vec3::ZERO, radius: 10.0 })
}

/// A place near lights, far from them, or where one is.
fn place(lights: &LightSet, random: &mut Random) -> Vec3 {
    match random.below(8) {
        0 => vector(random, 1e3),
        1 => match lights.lights.first() {
            Some(Light::Point(light)) => light.position,
            Some(Light::Area(light)) => light.bounds().low,
            _ => Vec3::ZERO,
        },
        _ => vector(random, 6.0),
    }
}

/// What is learned of a sky that is mostly seen on one side; none where there is no map, or several, or nothing to gain.
fn learned(lights: &LightSet, random: &mut Random) -> Option<LearnedSky> {
    let (map, counts) = (lights.only_map()?, SkyCounts::default());
    for _ in 0..if cfg!(miri) { 100 } else { 20_000 } {
        let wi = map.sample(random.next_2d())?.wi;
        if wi.x > 0.0 || random.below(16) == 0 {
            counts.add(map, random.below(7) as u8, wi, 1.0);
        }
    }
    counts.learned(map)
}

/// Compares lanes with single points; says in how many lanes something was found and in how many nothing.
struct Compare<'a>(&'a LightSet, u64);

impl Kernel for Compare<'_> {
    type Output = [u32; 2];

    #[inline(always)]
    fn run<W: Wide>(self, wide: W) -> [u32; 2] {
        let Self(lights, key) = self;
        let mut random = Random::new(91, key, 0);
        let mut counts = [0; 2];
        let learned = learned(lights, &mut random);
        for _ in 0..if cfg!(miri) { 1 } else { 30 } {
            let points: [Vec3; LANES] = std::array::from_fn(|_| place(lights, &mut random));
            let choices: [f64; LANES] = std::array::from_fn(|_| random.next_f64());
            let u: [[f32; 2]; LANES] = std::array::from_fn(|_| random.next_2d());
            let facing: [u8; LANES] = std::array::from_fn(|_| random.below(7) as u8);
            let odds: [Odds; LANES] =
                std::array::from_fn(|_| std::array::from_fn(|_| random.range(-6.0, 6.0f32).exp2()));
            let odds = (random.below(2) == 0).then(|| odds.each_ref());
            let sky = LightView { learned: learned.as_ref(), facing, odds };
            let alone_sky = |lane: usize| LightView {
                facing: [facing[lane]; LANES],
                odds: odds.map(|odds| [odds[lane]; LANES]),
                ..sky
            };
            let lanes = |i: usize| wide.load(&points.map(|point| point[i]));
            let samples = lights.sample_lanes(wide, &V3::new(lanes(0), lanes(1), lanes(2)), &choices, &u, &sky);
            let (radiance, pdf) = lights.background_lanes(samples.wi, &sky);
            let numbers = [samples.wi, samples.radiance, radiance].map(|v| [v.x, v.y, v.z].map(|x| wide.store(x)));
            let others = [samples.distance, samples.pdf, pdf].map(|x| wide.store(x));
            let masks = [samples.found, samples.delta].map(|mask| mask.answers());
            for lane in 0..LANES {
                let [wi, radiance, seen] = numbers.map(|v| Vec3::from_array(v.map(|x| x[lane])));
                let [distance, pdf, seen_pdf] = others.map(|x| x[lane]);
                let [found, delta] = masks.map(|mask| mask >> lane & 1 == 1);
                let sample = found.then_some(LightSample { wi, distance, radiance, pdf, delta });
                let alone = lights.sample(points[lane], choices[lane], u[lane], &alone_sky(lane));
                assert_eq!(sample.map(bits), alone.map(bits), "{alone:?} {sample:?}");
                counts[usize::from(found)] += 1;
                if found {
                    let (alone, alone_pdf) = lights.background(wi, &alone_sky(lane));
                    let bits = |v: Vec3, pdf: f32| (v.to_array().map(f32::to_bits), pdf.to_bits());
                    assert_eq!(bits(seen, seen_pdf), bits(alone, alone_pdf), "{seen} {alone}");
                }
            }
        }
        counts
    }
}

fn bits(sample: LightSample) -> ([[u32; 3]; 2], [u32; 2], bool) {
    let LightSample { wi, distance, radiance, pdf, delta } = sample;
    ([wi, radiance].map(|v| v.to_array().map(f32::to_bits)), [distance, pdf].map(f32::to_bits), delta)
}

#[test]
fn every_kind_of_lanes_has_the_bits_of_single_points() {
    let mut random = Random::new(90, 0, 0);
    let (mut counts, mut skies) = ([0; 2], 0);
    for (key, kinds) in MIXTURES.iter().enumerate() {
        for count in if cfg!(miri) { [1, 2].as_slice() } else { &[1, 2, 3, 4, 9, 25, 60] } {
            let lights = scene(kinds, *count, &mut random);
            let mut add = |found: [u32; 2]| (0..2).for_each(|i| counts[i] += found[i]);
            let key = key as u64;
            skies += u32::from(learned(&lights, &mut Random::new(91, key, 0)).is_some());
            #[cfg(target_arch = "x86_64")]
            {
                Avx2::detect().into_iter().for_each(|avx2| add(avx2.run(Compare(&lights, key))));
                Avx512::detect().into_iter().for_each(|avx512| add(avx512.run(Compare(&lights, key))));
            }
        }
    }
    assert!(counts.iter().all(|count| *count > 1000 || cfg!(miri)), "{counts:?}");
    assert!(skies > 0 || cfg!(miri), "nothing was learned of any sky");
}

/// Whatever sends light to a point may be chosen there.
#[test]
fn no_light_that_shines_is_left_out() {
    const KINDS: [&[u32]; 4] = [&[4], &[3, 4], &[4, 9], &[0, 2, 3, 4, 9]];
    let (mut random, mut shining) = (Random::new(92, 0, 0), 0);
    for kinds in KINDS {
        for count in [2, 9, 60] {
            let lights = scene(kinds, count, &mut random);
            for _ in 0..if cfg!(miri) { 1 } else { 100 } {
                let point = place(&lights, &mut random);
                for (index, light) in lights.lights.iter().enumerate() {
                    let sample = light.sample(point, random.next_2d(), &LightView::PLAIN);
                    if sample.is_some_and(|sample| sample.radiance != Vec3::ZERO) {
                        assert!(lights.probability(point, index, None) > 0.0, "{light:?} from {point}");
                        shining += 1;
                    }
                }
            }
        }
    }
    assert!(shining > 5000 || cfg!(miri), "{shining}");
}

/// Of spots on a ceiling, each of 30° to every side, those are chosen that shine on a point: nearly always where one is
/// chosen, and in more than a quarter of all cases. It was a seventh when estimates did not know that spots end.
#[test]
fn spots_that_shine_on_a_point_are_chosen() {
    const ALONG: usize = 12;
    let down = Quat::from_rotation_arc(Vec3::Z, Vec3::NEG_Y);
    let spot = |i: usize| {
        let position = Vec3::new((i % ALONG) as f32, 3.0, (i / ALONG) as f32);
        let to_world = Affine3A::from_rotation_translation(down, position);
        Light::Spot(Spot::new(to_world, Vec3::ONE, 30f32.to_radians(), 20f32.to_radians()))
    };
    let around = BoundingSphere { center: Vec3::ZERO, radius: 20.0 };
    let lights = LightSet::new((0..ALONG * ALONG).map(spot).collect(), &around);
    let mut random = Random::new(93, 0, 0);
    let (mut all, mut shining, points) = (0.0, 0.0, if cfg!(miri) { 2 } else { 200 });
    for _ in 0..points {
        let point = Vec3::new(random.range(0.0, 11.0), random.range(0.0, 1.5), random.range(0.0, 11.0));
        for (index, light) in lights.lights.iter().enumerate() {
            let probability = lights.probability(point, index, None);
            all += probability;
            if light.sample(point, [0.5; 2], &LightView::PLAIN).is_some() {
                shining += probability;
            }
        }
    }
    println!("{shining} of {all} of {points}");
    assert!(shining > 0.9 * all && (shining > 0.25 * points as f32 || cfg!(miri)), "{shining} of {all} of {points}");
}

/// A square of so many squares along each side, with texture coordinates from 0 to 1, that faces along z.
fn panel(along: usize) -> Shape {
    let corner = |i: usize| Vec2::new((i % (along + 1)) as f32, (i / (along + 1)) as f32) / along as f32;
    let uvs: Vec<Vec2> = (0..(along + 1) * (along + 1)).map(corner).collect();
    let positions = uvs.iter().map(|uv| uv.extend(0.0)).collect();
    let halves = |i: usize| {
        let (first, row) = ((i / along * (along + 1) + i % along) as u32, along as u32 + 1);
        [[first, first + 1, first + row + 1], [first, first + row + 1, first + row]]
    };
    let triangles = (0..along * along).flat_map(halves).collect();
    Shape::mesh(Arc::new(Mesh { positions, uvs, triangles, ..Mesh::default() }), Affine3A::IDENTITY, false)
}

/// A black picture of so many pixels along each side, with some white ones.
fn lit(side: usize, nearest: bool, is_lit: impl Fn([usize; 2]) -> bool) -> Texture {
    let pixel = |i: usize| if is_lit([i % side, i / side]) { Vec3::ONE } else { Vec3::ZERO };
    let image = Arc::new(Image { width: side, height: side, pixels: (0..side * side).map(pixel).collect() }).into();
    Texture::Bitmap { image, to_uv: Affine2::IDENTITY, scale: 1.0, wrap: Wrap::Clamp, nearest }
}

/// The only pixel that shines is between the points at which the picture is read, in the middle of its cell.
#[test]
#[cfg_attr(miri, ignore = "takes too long")]
fn lamps_of_few_bright_pixels_are_chosen() {
    const SIDE: usize = 640;
    let dot = lit(SIDE, true, |pixel| pixel == [325, 165]);
    let pi = std::f32::consts::PI;
    for (shape, area) in [(panel(1), 1.0), (Shape::sphere(Vec3::Y, 0.5, false), pi)] {
        let lamp = AreaLight::textured(shape, Vec3::ONE, dot.clone());
        let ratio = channel_mean(lamp.power()) / (pi * area / (SIDE * SIDE) as f32);
        assert!((0.5..2.0).contains(&ratio), "{ratio} of the power");
        let other = Light::Point(Point { position: Vec3::X * 10.0, intensity: Vec3::ONE });
        let around = BoundingSphere { center: Vec3::ZERO, radius: 20.0 };
        let lights = LightSet::new(vec![Light::Area(lamp), other], &around);
        assert!(lights.probability(Vec3::Z, 0, None) > 0.0);
    }
}

/// Lamps of many small triangles are drawn by their picture too. Of this one a hundredth shines: evenly drawn, samples
/// would have 99 times their squared mean as variance. 4,000 have a standard error of about 2 %.
#[test]
#[cfg_attr(miri, ignore = "takes too long")]
fn lamps_of_many_triangles_are_drawn_by_their_picture() {
    let picture = lit(100, false, |pixel| pixel.iter().all(|x| (40..50).contains(x)));
    let lamp = AreaLight::textured(panel(100), Vec3::ONE, picture);
    let (mut random, n) = (Random::new(94, 0, 0), 4000);
    let (mut mean, mut square) = (0.0, 0.0);
    for _ in 0..n {
        let sample = lamp.sample(Vec3::new(0.5, 0.5, 1.0), random.next_2d()).expect("all of it faces the point");
        let value = f64::from(-sample.wi.z * sample.radiance.x / sample.pdf);
        mean += value / f64::from(n);
        square += value * value / f64::from(n);
    }
    let variance = square / (mean * mean) - 1.0;
    println!("irradiance {mean}, variance {variance}");
    // A hundredth of the square at a distance of 1, all of it within 9° of the axis.
    assert!((mean / 0.01 - 1.0).abs() < 0.1 && variance < 5.0, "{mean} {variance}");
}
