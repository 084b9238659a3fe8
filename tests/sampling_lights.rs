//! Lights: directions sampled towards them follow the stated densities w.r.t. solid angle, and carry the stated radiance.
//! False alarms: see sampling.rs.

#[path = "support/chart.rs"]
#[allow(dead_code, reason = "shared with the tests of other samplers")]
mod chart;
#[path = "support/statistics.rs"]
#[allow(dead_code, reason = "shared with the tests of other samplers")]
mod statistics;

use std::sync::Arc;

use chart::Chart;
use fanal::base::random::Random;
use fanal::geometry::mesh::Mesh;
use fanal::geometry::{Accel, Ray, Shape, Surface};
use fanal::lights::Light;
use fanal::lights::area::AreaLight;
use fanal::lights::distant::Constant;
use fanal::lights::envmap::Envmap;
use fanal::materials::image::Image;
use fanal::math::Frame;
use glam::{Affine3A, Mat3, Quat, Vec3};
use statistics::assert_chi2;

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

/// Radiance of a sample is what a ray in its direction finds, and its density what the look-up says.
fn background(light: &Light, random: &mut Random) -> Option<Vec3> {
    let sample = light.sample(Vec3::ZERO, random.next_2d())?;
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

/// A turned environment with one texel 1e4 times as bright as the rest, elsewhere and at a pole. The chart's cells are thirds of
/// the picture's, in the documented convention (u = atan2(x, −z)/2π, v = acos(y)/π, columns between texel centres). Catches a
/// forgotten sin θ, swapped rows and columns, a rotation the wrong way around.
#[test]
fn s01_environment_follows_its_density() {
    for hot in [3 * 16 + 5, 2] {
        let mut pixels: Vec<Vec3> = (0..16 * 9).map(|i| Vec3::splat(0.2 + (i % 7) as f32)).collect();
        pixels[hot] = Vec3::splat(1e4);
        pixels[100] = Vec3::ZERO;
        let to_world = Mat3::from_quat(Quat::from_euler(glam::EulerRot::XYZ, 0.4, 1.1, -0.7));
        let light = Light::Envmap(Envmap::new(Arc::new(Image { width: 16, height: 9, pixels }), 0.5, to_world));
        // φ = 0 half a texel after u = 0; atan2(x, −z) grows from −z towards +x.
        let turn = Mat3::from_rotation_y(-std::f32::consts::PI / 16.0);
        let axis = |v: Vec3| to_world * (turn * v);
        let frame = Frame { s: axis(Vec3::NEG_Z), t: axis(Vec3::X), n: axis(Vec3::Y) };
        let mass = Chart::Rows { frame }.check(
            &format!("environment, texel {hot}"),
            [24, 48],
            |wi| f64::from(light.background_pdf(wi)),
            |random| background(&light, random),
        );
        assert!((mass - 1.0).abs() < 1e-3, "{mass}");
    }
}
