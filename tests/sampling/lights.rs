//! Lights: directions sampled towards them follow the stated densities w.r.t. solid angle, and carry the stated radiance; and where
//! rays start on the lens. False alarms: see sampling.rs.

use crate::support::{chart, statistics};

use std::sync::Arc;

use chart::Chart;
use fanal::base::random::Random;
use fanal::camera::Camera;
use fanal::geometry::mesh::Mesh;
use fanal::geometry::{Accel, Ray, Shape, Surface};
use fanal::guiding::learn::emission::EmissionLearner;
use fanal::lights::area::AreaLight;
use fanal::lights::distant::{Constant, Directional};
use fanal::lights::envmap::Envmap;
use fanal::lights::point::{Point, Spot};
use fanal::lights::seen::LightView;
use fanal::lights::sky::{Atmosphere, Sky};
use fanal::lights::sun::Sun;
use fanal::lights::{BoundingSphere, Light, LightSet};
use fanal::math::Frame;
use fanal::picture::Image;
use fanal::picture::texture::{Texture, Wrap};
use fanal::sampling::discrete::Discrete;
use glam::{Affine2, Affine3A, Mat3, Quat, Vec2, Vec3};
use statistics::{assert_chi2, chi2_quantile};

/// Density of a shape's light as the tracer looks it up: by hitting the surface.
fn shape_pdf(light: &AreaLight, shape: &Shape, accel: &Accel, point: Vec3, direction: Vec3) -> f32 {
    let ray = Ray { origin: point, direction };
    accel.intersect(&ray).map_or(0.0, |hit| {
        let surface = Surface::new(&ray, &hit, shape);
        if light.emitted(&surface, -direction) == Vec3::ZERO { 0.0 } else { light.pdf(point, &surface) }
    })
}

/// Near, far and from inside. Catches a cone of the wrong angle and 1 − cos without digits for a distant sphere. The mass is
/// 1; the rim is resolved to 1e-3 of it.
#[test]
fn s01_sphere_lights_follow_their_density() {
    for (distance, radius, inside) in [(1.1, 1.0, false), (50.0, 0.5, false), (0.4, 1.0, true)] {
        let center = Vec3::new(0.3, -0.2, 0.9).normalize() * distance;
        let shape = Shape::sphere(center, radius, inside);
        let (light, accel) = (AreaLight::new(shape.clone(), Vec3::ONE), Accel::new(std::slice::from_ref(&shape)));
        let chart = Chart::around(center.normalize(), if distance > 10.0 { 4.0 } else { 1.0 });
        let mass = chart.check(
            &format!("sphere at {distance}"),
            [128, 8],
            |wi| f64::from(shape_pdf(&light, &shape, &accel, Vec3::ZERO, wi)),
            |random| light.sample(Vec3::ZERO, random.next_2d()).map(|s| s.wi),
        );
        assert!((mass - 1.0).abs() < 1e-3, "{mass}");
    }
}

/// Three triangles of areas 2, 1/2 and 1/8 that face the origin.
fn triangles() -> Shape {
    let mut positions = vec![];
    for (x, size) in [(0.0f32, 2.0f32), (2.5, 1.0), (4.0, 0.5)] {
        let z = 2.0 + 0.3 * x;
        positions.extend([[x, 0.0, z], [x, size, z], [x + size, 0.0, z + 0.2 * size]].map(Vec3::from_array));
    }
    let triangles = vec![[0, 1, 2], [3, 4, 5], [6, 7, 8]];
    let mesh = Mesh { positions, triangles, normals: vec![], uvs: vec![] };
    Shape::mesh(Arc::new(mesh), Affine3A::IDENTITY, false)
}

/// Points on a mesh light are uniform over its area: 64 equal parts of each triangle. Catches triangles chosen by number and
/// not by area, and a warp that crowds a corner. The density is that of the hit point, distance² / (cos · area).
#[test]
fn s01_mesh_lights_are_uniform_over_their_area() {
    let shape = triangles();
    let (light, accel) = (AreaLight::new(shape.clone(), Vec3::ONE), Accel::new(std::slice::from_ref(&shape)));
    let areas: [f64; 3] = std::array::from_fn(|i| {
        let [a, b, c] = shape.triangle(i as u32);
        f64::from((b - a).cross(c - a).length()) / 2.0
    });
    let n = 1_000_000;
    let mut counts = vec![0.0; 3 * 128];
    let mut random = Random::new(4, 0, 0);
    for _ in 0..n {
        let sample = light.sample(Vec3::ZERO, random.next_2d()).expect("every triangle faces the origin");
        let ray = Ray { origin: Vec3::ZERO, direction: sample.wi };
        // Rounding may carry a point past an edge: such samples, some in 1e6, stay uncounted.
        let Some(hit) = accel.intersect(&ray) else { continue };
        let surface = Surface::new(&ray, &hit, &shape);
        let pdf = light.pdf(Vec3::ZERO, &surface);
        assert!((pdf - sample.pdf).abs() < 1e-4 * pdf && (sample.distance - hit.distance).abs() < 1e-4);
        let [u, v] = hit.barycentric.map(|b| (8.0 * b).clamp(0.0, 7.999));
        let upper = usize::from(u.fract() + v.fract() > 1.0);
        counts[128 * hit.triangle as usize + 16 * u as usize + 2 * v as usize + upper] += 1.0;
    }
    let total: f64 = areas.iter().sum();
    let part = |i: usize| {
        let (u, v, upper) = (i % 128 / 16, i % 16 / 2, i % 2);
        if u + v + upper < 8 { f64::from(n) * areas[i / 128] / total / 64.0 } else { 0.0 }
    };
    let expected: Vec<f64> = (0..counts.len()).map(part).collect();
    assert_chi2("mesh light", &counts, &expected, chart::level());
}

/// Seen at all angles, the same light's density w.r.t. solid angle integrates to 1. Catches a missing distance² or cosine.
#[test]
fn s01_mesh_lights_follow_their_density() {
    let shape = triangles();
    let (light, accel) = (AreaLight::new(shape.clone(), Vec3::ONE), Accel::new(std::slice::from_ref(&shape)));
    let mass = Chart::around(Vec3::new(1.0, 0.5, 2.0).normalize(), 2.0).check(
        "mesh light by direction",
        [32, 32],
        |wi| f64::from(shape_pdf(&light, &shape, &accel, Vec3::ZERO, wi)),
        |random| light.sample(Vec3::ZERO, random.next_2d()).map(|s| s.wi),
    );
    assert!((mass - 1.0).abs() < 1e-3, "{mass}");
}

/// A picture of which a few pixels shine and a third is black, turned and repeated.
fn glowing(width: usize, height: usize) -> Texture {
    let mut random = Random::new(77, 0, 0);
    let pixel = |i: usize| match i % 3 {
        0 => Vec3::ZERO,
        _ if i % 13 == 4 => Vec3::splat(40.0),
        _ => Vec3::splat(random.range(0.0, 1.0)),
    };
    let pixels = (0..width * height).map(pixel).collect();
    let image = Arc::new(Image { width, height, pixels }).into();
    let to_uv = Affine2::from_scale_angle_translation(Vec2::new(1.3, 0.9), 0.4, Vec2::new(0.2, -0.7));
    Texture::Bitmap { image, to_uv, scale: 2.0, wrap: Wrap::Mirror, nearest: false }
}

/// The same light with a picture: its density w.r.t. solid angle integrates to 1, samples follow it, and the radiance of a sample is
/// that of the surface which a ray in its direction hits. Catches a grid that is cut elsewhere than it is looked up, and texture
/// coordinates of pieces that are not those of their triangles.
#[test]
fn s01_textured_mesh_lights_follow_their_density() {
    let shape = triangles();
    let light = AreaLight::textured(shape.clone(), Vec3::new(1.0, 0.5, 2.0), glowing(4, 3));
    let accel = Accel::new(std::slice::from_ref(&shape));
    let density = |direction: Vec3| {
        let ray = Ray { origin: Vec3::ZERO, direction };
        let surface = accel.intersect(&ray).map(|hit| Surface::new(&ray, &hit, &shape));
        surface.map_or(0.0, |surface| f64::from(light.pdf(Vec3::ZERO, &surface)))
    };
    let mass = Chart::around(Vec3::new(1.0, 0.5, 2.0).normalize(), 2.0).check(
        "textured mesh light by direction",
        // Small beside the picture's cells: else slivers of bright ones among dark ones are missed by the quadrature.
        [128, 128],
        density,
        |random| {
            let sample = light.sample(Vec3::ZERO, random.next_2d())?;
            let ray = Ray { origin: Vec3::ZERO, direction: sample.wi };
            if let Some(hit) = accel.intersect(&ray) {
                let surface = Surface::new(&ray, &hit, &shape);
                let emitted = light.emitted(&surface, -sample.wi);
                assert!(
                    emitted.distance(sample.radiance) <= 0.02 + 1e-2 * emitted.length(),
                    "{emitted} {}",
                    sample.radiance
                );
            }
            Some(sample.wi)
        },
    );
    assert!((mass - 1.0).abs() < 2e-3, "{mass}");
}

/// Irradiance of a square lamp with that picture: the same whether its points are drawn by the picture or evenly, and by the picture
/// with less than a third of the variance. 2¹⁸ samples: both means have a standard error below 1 %.
#[test]
fn textured_lamps_are_drawn_by_their_picture() {
    let corners = [[-1.0, -1.0, 2.0], [-1.0, 1.0, 2.0], [1.0, 1.0, 2.0], [1.0, -1.0, 2.0]].map(Vec3::from_array);
    let uvs = [[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]].map(Vec2::from_array);
    let (positions, uvs, triangles) = (corners.to_vec(), uvs.to_vec(), vec![[0, 1, 2], [0, 2, 3]]);
    let mesh = Mesh { positions, uvs, triangles, ..Mesh::default() };
    let shape = Shape::mesh(Arc::new(mesh), Affine3A::IDENTITY, false);
    let (by_picture, evenly) =
        (AreaLight::textured(shape.clone(), Vec3::ONE, glowing(12, 9)), AreaLight::new(shape.clone(), Vec3::ONE));
    let accel = Accel::new(std::slice::from_ref(&shape));
    let moments = |light: &AreaLight, key: u64| {
        let mut random = Random::new(31, key, 0);
        let (mut sum, mut squares, n) = (0.0, 0.0, 1 << 18);
        for _ in 0..n {
            let Some(sample) = light.sample(Vec3::ZERO, random.next_2d()) else { continue };
            let ray = Ray { origin: Vec3::ZERO, direction: sample.wi };
            let Some(hit) = accel.intersect(&ray) else { continue };
            let radiance = by_picture.emitted(&Surface::new(&ray, &hit, &shape), -sample.wi);
            let value = f64::from(radiance.x * sample.wi.z / sample.pdf);
            (sum, squares) = (sum + value, squares + value * value);
        }
        let mean = sum / f64::from(n);
        (mean, squares / f64::from(n) - mean * mean)
    };
    let ((mean, variance), (even_mean, even_variance)) = (moments(&by_picture, 0), moments(&evenly, 1));
    println!("variance {variance} by the picture, {even_variance} evenly");
    assert!((mean / even_mean - 1.0).abs() < 0.04, "{mean} {even_mean}");
    assert!(variance < even_variance / 3.0, "{variance} {even_variance}");
}

/// Radiance of a sample is what a ray in its direction finds, and its density what the look-up says.
fn background(light: &Light, random: &mut Random) -> Option<Vec3> {
    let sample = light.sample(Vec3::ZERO, random.next_2d(), &LightView::PLAIN)?;
    let pdf = light.background_pdf(sample.wi);
    assert!((pdf - sample.pdf).abs() <= 1e-4 * pdf && pdf > 0.0);
    assert!((light.background(sample.wi) - sample.radiance).length() <= 1e-5 * sample.radiance.length());
    Some(sample.wi)
}

#[test]
fn s01_constant_light_follows_its_density() {
    let light = Light::Constant(Constant { radiance: Vec3::ONE });
    let mass = Chart::around(Vec3::X, 1.0).check(
        "constant light",
        [32, 32],
        |wi| f64::from(light.background_pdf(wi)),
        |random| background(&light, random),
    );
    assert!((mass - 1.0).abs() < 1e-3, "{mass}");
}

/// A chart whose cells can be parts of those of an environment of 16 columns, in the documented convention: u = atan2(x, −z)/2π,
/// v = acos(y)/π, columns between texel centres.
fn environment_chart(to_world: Mat3) -> Chart {
    // φ = 0 half a texel after u = 0; atan2(x, −z) grows from −z towards +x.
    let turn = Mat3::from_rotation_y(-std::f32::consts::PI / 16.0);
    let axis = |v: Vec3| to_world * (turn * v);
    Chart::Rows { frame: Frame { s: axis(Vec3::NEG_Z), t: axis(Vec3::X), n: axis(Vec3::Y) } }
}

/// A turned environment with one texel 1e4 times as bright as the rest, elsewhere and at a pole. The chart's cells are thirds of
/// the picture's. Catches a forgotten sin θ, swapped rows and columns, a rotation the wrong way around.
#[test]
fn s01_environment_follows_its_density() {
    for hot in [3 * 16 + 5, 2] {
        let mut pixels: Vec<Vec3> = (0..16 * 9).map(|i| Vec3::splat(0.2 + (i % 7) as f32)).collect();
        pixels[hot] = Vec3::splat(1e4);
        pixels[100] = Vec3::ZERO;
        let to_world = Mat3::from_quat(Quat::from_euler(glam::EulerRot::XYZ, 0.4, 1.1, -0.7));
        let light = Light::Envmap(Envmap::new(Arc::new(Image { width: 16, height: 9, pixels }), 0.5, to_world));
        let mass = environment_chart(to_world).check(
            &format!("environment, texel {hot}"),
            [24, 48],
            |wi| f64::from(light.background_pdf(wi)),
            |random| background(&light, random),
        );
        assert!((mass - 1.0).abs() < 1e-3, "{mass}");
    }
}

/// A disk of a quarter of a degree, and a wide one. Catches a cone of the wrong angle, and the digits that its cosine has lost.
#[test]
fn s01_suns_follow_their_density() {
    let towards = Vec3::new(0.3, -0.2, 0.9).normalize();
    for (angle, power) in [(0.25f32, 12.0), (40.0, 2.0)] {
        let light = Light::Sun(Sun::new(-towards, Vec3::ONE, angle.to_radians()));
        let chart = Chart::around(towards, power);
        let mass = chart.check(
            &format!("sun of {angle}°"),
            [128, 8],
            |wi| f64::from(light.background_pdf(wi)),
            |random| background(&light, random),
        );
        assert!((mass - 1.0).abs() < 1e-3, "{mass}");
        // Radiance over the cosine's integral: the irradiance.
        let irradiance = chart.mass(|wi| f64::from(light.background(wi).x * wi.dot(towards)));
        assert!((irradiance - 1.0).abs() < 1e-3, "{irradiance}");
    }
}

/// A dome that ends above the nadir, where a row of the chart's cells does: a sky. Catches rows that are taken for those of a whole
/// sphere.
#[test]
fn s01_skies_follow_their_density() {
    let (sun, up) = (Vec3::new(0.5, 0.3, 0.6).normalize(), Vec3::new(0.1, 1.0, 0.4).normalize());
    for (stretch, extend) in [(1.0, false), (1.25, false), (1.0, true)] {
        let air = Atmosphere { sun, up, turbidity: 3.0, albedo: Vec3::splat(0.2), stretch, extend };
        let light = Light::Envmap(Sky::new(&air).expect("within the model").envmap(1.0));
        let mass = Chart::Rows { frame: Frame::new(up) }.check(
            &format!("sky {stretch} {extend}"),
            [32, 32],
            |wi| f64::from(light.background_pdf(wi)),
            |random| background(&light, random),
        );
        assert!((mass - 1.0).abs() < 1e-3, "{mass}");
    }
}

/// Lamps of several sizes and sides, a point, a sky and a sun.
fn many_lights() -> LightSet {
    let mut random = Random::new(21, 0, 0);
    let mut vector = || Vec3::new(random.range(-3.0, 3.0), random.range(-3.0, 3.0), random.range(-3.0, 3.0));
    let mut lights: Vec<Light> = (0..20)
        .map(|i| {
            let radiance = Vec3::splat(1.0 + (i % 5) as f32);
            let shape = if i % 2 == 0 { Shape::sphere(vector(), 0.1 + 0.02 * i as f32, false) } else { triangles() };
            Light::Area(AreaLight::new(shape, radiance))
        })
        .collect();
    lights.push(Light::Point(Point { position: vector(), intensity: Vec3::splat(3.0) }));
    lights.push(Light::Constant(Constant { radiance: Vec3::splat(0.3) }));
    lights.push(Light::Directional(Directional { direction: Vec3::NEG_Y, irradiance: Vec3::ONE }));
    LightSet::new(lights, &BoundingSphere { center: Vec3::ZERO, radius: 6.0 })
}

/// Which of many lights is sampled, near them, among them and far away. Catches turns in the tree that are taken with another
/// probability than is said, and a share that lights at infinity do not get. Where the tree promises nothing, no light is drawn.
#[test]
fn s01_lights_are_chosen_by_their_probability() {
    let set = many_lights();
    for point in [Vec3::ZERO, Vec3::new(2.0, -1.0, 0.5), Vec3::splat(50.0)] {
        let n = 1_000_000;
        let mut counts = vec![0.0; set.lights.len() + 1];
        let mut random = Random::new(22, 0, 0);
        for _ in 0..n {
            let chosen = set.choose(point, random.next_f64(), None);
            if let Some((index, probability)) = chosen {
                let again = set.probability(point, index, None);
                assert!((probability - again).abs() <= 1e-5 * again, "{index}: {probability} {again}");
            }
            counts[chosen.map_or(set.lights.len(), |(index, _)| index)] += 1.0;
        }
        let mut expected: Vec<f64> =
            (0..set.lights.len()).map(|i| f64::from(n) * f64::from(set.probability(point, i, None))).collect();
        expected.push((f64::from(n) - expected.iter().sum::<f64>()).max(0.0));
        assert_chi2(&format!("choice at {point}"), &counts, &expected, chart::level());
    }
}

/// Directions of photons: cosine-distributed about the normals of a surface, uniform from a point and within a spot's cone, by
/// radiance from the sky. They all have one, to 1e-3 by quadrature. Catches photons that leave a lamp as from a point, and skies
/// turned inside out.
#[test]
fn s01_photons_leave_in_the_directions_of_their_light() {
    let bounds = BoundingSphere { center: Vec3::ZERO, radius: 2.0 };
    let down = Shape::mesh(
        Arc::new(Mesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Z], triangles: vec![[0, 1, 2]], ..Mesh::default() }),
        Affine3A::IDENTITY,
        false,
    );
    let pixels: Vec<Vec3> = (0..16 * 9).map(|i| Vec3::splat(0.2 + (i % 7) as f32)).collect();
    let sky = Envmap::new(Arc::new(Image { width: 16, height: 9, pixels }), 0.5, Mat3::from_rotation_x(0.6));
    let looked_up = Light::Envmap(sky.clone());
    let cosine = |wi: Vec3| f64::from(wi.y.min(0.0).abs()) / std::f64::consts::PI;
    let uniform = |_: Vec3| 0.25 / std::f64::consts::PI;
    let cutoff = 0.9f32;
    let cone = move |wi: Vec3| {
        if wi.z >= cutoff.cos() { 0.5 / std::f64::consts::PI / (1.0 - f64::from(cutoff).cos()) } else { 0.0 }
    };
    type Density<'a> = Box<dyn Fn(Vec3) -> f64 + Sync + 'a>;
    let sun = Sun::new(Vec3::Z, Vec3::ONE, 1.8);
    let disk = Light::Sun(sun);
    let cases: [(&str, Light, Density); 7] = [
        ("sun", disk.clone(), Box::new(|wi: Vec3| f64::from(disk.background_pdf(-wi)))),
        ("triangle", Light::Area(AreaLight::new(down, Vec3::ONE)), Box::new(cosine)),
        ("ball", Light::Area(AreaLight::new(Shape::sphere(Vec3::ONE, 0.5, false), Vec3::ONE)), Box::new(uniform)),
        ("point", Light::Point(Point { position: Vec3::ONE, intensity: Vec3::ONE }), Box::new(uniform)),
        ("spot", Light::Spot(Spot::new(Affine3A::IDENTITY, Vec3::ONE, cutoff, 0.4)), Box::new(cone)),
        ("constant", Light::Constant(Constant { radiance: Vec3::ONE }), Box::new(uniform)),
        ("sky", Light::Envmap(sky), Box::new(|wi: Vec3| f64::from(looked_up.background_pdf(-wi)))),
    ];
    for (name, light, density) in &cases {
        // For the sky cells that are parts of its picture's, seen from outside.
        let outside = Mat3::from_rotation_x(0.6) * Mat3::from_diagonal(Vec3::NEG_ONE);
        let chart = if *name == "sky" { environment_chart(outside) } else { Chart::around(Vec3::Z, 1.0) };
        let mass = chart.check(&format!("photons of {name}"), [96, 32], density, |random| {
            light.emit(&bounds, random.next_2d(), random.next_2d()).map(|emission| emission.ray.direction)
        });
        assert!((mass - 1.0).abs() < 1e-3, "{name}: {mass}");
    }
}

/// Rays start evenly all over a thin lens, wherever in the picture they go through and wherever the camera is: 8 rings of equal
/// area by 8 sectors. Catches a lens that is sampled by its radius, or that the camera leaves behind.
#[test]
fn s01_rays_start_evenly_all_over_the_lens() {
    let turn = Quat::from_euler(glam::EulerRot::XYZ, 0.4, 1.1, -0.7);
    let to_world = Affine3A::from_rotation_translation(turn, Vec3::new(0.5, -1.0, 0.7));
    let (size, radius, n) = ([64u32, 48], 0.25, 1_000_000);
    let (camera, to_local) = (Camera::new(to_world, 40.0, size, radius, 5.0), to_world.inverse());
    let mut random = Random::new(24, 0, 0);
    let mut counts = vec![0.0; 64];
    for _ in 0..n {
        let [x, y] = random.next_2d();
        let ray =
            camera.ray([x * size[0] as f32, y * size[1] as f32], camera.lens(&Random::new(random.next_u64(), 0, 0)));
        let start = to_local.transform_point3(ray.origin) / radius;
        assert!(start.z.abs() < 1e-5 && start.length() < 1.0 + 1e-5, "{start}");
        let turn = (start.y.atan2(start.x) / std::f32::consts::TAU).rem_euclid(1.0);
        let [ring, sector] = [start.truncate().length_squared(), turn].map(|c| ((8.0 * c) as usize).min(7));
        counts[8 * ring + sector] += 1.0;
    }
    assert_chi2("lens", &counts, &[f64::from(n) / 64.0; 64], chart::level());
}

/// Starts of photons that were learned: every start's probability is stated, so the mean of its inverse over any part of the
/// squares is the size of that part, for each light. Squared deviations over their variances are χ². Catches a light or a square
/// whose density is left out.
#[test]
fn s01_photon_starts_follow_their_density() {
    let powers = Discrete::new([1.0, 5.0, 2.0]);
    let mut learner = EmissionLearner::new(&powers);
    let mut random = Random::new(23, 0, 0);
    for _ in 0..3 {
        let guide = learner.publish();
        let useful: Vec<_> = (0..20_000)
            .filter_map(|_| guide.sample(&mut random))
            .map(|start| {
                let near = start.squares[0][0] < 0.3 && start.squares[1][1] > 0.6;
                (start, if near { 1.0 } else { 1e-3 } / start.probability)
            })
            .collect();
        learner.absorb(&useful);
    }
    let guide = learner.publish();
    let (n, side) = (1_000_000u32, 2usize);
    let cells = 3 * side.pow(4);
    let mut sums = vec![[0.0f64; 2]; cells];
    for _ in 0..n {
        let start = guide.sample(&mut random).expect("there are lights");
        let [a, b] = start.squares.map(|square| square.map(|x| (x * side as f64) as usize));
        let cell = (((start.light * side + a[0]) * side + a[1]) * side + b[0]) * side + b[1];
        let weight = 1.0 / start.probability;
        sums[cell] = [sums[cell][0] + weight, sums[cell][1] + weight * weight];
    }
    let size = 1.0 / side.pow(4) as f64;
    let (n, mut chi2) = (f64::from(n), 0.0);
    for (cell, [sum, squares]) in sums.iter().enumerate() {
        let (mean, square) = (sum / n, squares / n);
        let variance = (square - mean * mean) / n;
        assert!(mean > 0.0, "cell {cell} is never drawn");
        chi2 += (mean - size).powi(2) / variance;
    }
    let limit = chi2_quantile(chart::level(), cells as f64);
    assert!(chi2 < limit, "χ² {chi2:.1} over {cells} cells, limit {limit:.1}");
}
