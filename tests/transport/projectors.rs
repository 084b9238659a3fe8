//! Light through a picture: where it falls, how much of it, and where its photons start.

use std::sync::Arc;

use fanal::base::random::Random;
use fanal::camera::Camera;
use fanal::lights::projector::{Lens, Profile, Projector};
use fanal::lights::seen::LightView;
use fanal::lights::{BoundingSphere, Light};
use fanal::math::channel_mean;
use fanal::picture::Image;
use fanal::picture::texture::{Texture, Wrap};
use glam::{Affine2, Affine3A, Mat3, Quat, Vec2, Vec3};

const NOWHERE: BoundingSphere = BoundingSphere { center: Vec3::ZERO, radius: 1.0 };
const SIZE: [u32; 2] = [5, 3];

/// A picture whose pixels all differ.
fn image() -> Image {
    let [width, height] = SIZE.map(|side| side as usize);
    let pixels = (0..width * height).map(|i| Vec3::new(1.0 + i as f32, 0.5, 20.0 - i as f32)).collect();
    Image { width, height, pixels }
}

fn sharp(image: Image) -> Texture {
    let image = Arc::new(image).into();
    Texture::Bitmap { image, to_uv: Affine2::IDENTITY, scale: 1.0, wrap: Wrap::Clamp, nearest: true }
}

fn to_world() -> Affine3A {
    let turn = Quat::from_euler(glam::EulerRot::XYZ, 0.4, 1.1, -0.7);
    Affine3A::from_rotation_translation(turn, Vec3::new(0.5, -1.0, 0.7))
}

/// The lens of a projector of `image`'s proportions whose width is seen under `fov`°.
fn lens(to_world: Affine3A, fov: f32, profile: Profile) -> Lens {
    let half = (0.5 * fov.to_radians()).tan();
    Lens { to_world, half: Vec2::new(half, half * SIZE[1] as f32 / SIZE[0] as f32), profile }
}

fn light(lens: &Lens, picture: Texture) -> Light {
    Light::Projector(Box::new(Projector::new(lens, Vec3::ONE, picture)))
}

/// Radiance times solid angle from the light at a point; nothing where it does not shine.
fn arriving(light: &Light, point: Vec3) -> Vec3 {
    light.sample(point, [0.5; 2], &LightView::PLAIN).map_or(Vec3::ZERO, |sample| sample.radiance)
}

/// What a camera would have in a pixel is lit by that pixel, whatever the length of the light's axes. Catches a picture that is
/// mirrored, turned, or of another angle.
#[test]
fn the_picture_goes_back_the_way_of_a_camera() {
    let (to_world, fov, picture) = (to_world(), 50.0, image());
    let camera = Camera::new(to_world, fov, SIZE, 0.0, 1.0);
    let shrunk = to_world * Affine3A::from_mat3(Mat3::from_diagonal(Vec3::splat(0.01)));
    for to_world in [to_world, shrunk] {
        let light = light(&lens(to_world, fov, Profile::Even), sharp(image()));
        for (i, pixel) in picture.pixels.iter().enumerate() {
            let corner = Vec2::new((i as u32 % SIZE[0]) as f32, (i as u32 / SIZE[0]) as f32);
            for inside in [Vec2::splat(0.02), Vec2::splat(0.5), Vec2::new(0.98, 0.3)] {
                let ray = camera.ray((corner + inside).to_array(), [0.5; 2]);
                let found = arriving(&light, ray.origin + 3.0 * ray.direction) * 9.0;
                assert!(found.distance(*pixel) < 1e-4 * pixel.length(), "pixel {i}: {found} {pixel}");
            }
        }
        for beside in [[-0.05, 1.0], [5.05, 1.0], [2.0, -0.05], [2.0, 3.05]] {
            let ray = camera.ray(beside, [0.5; 2]);
            assert_eq!(arriving(&light, ray.origin + ray.direction), Vec3::ZERO, "{beside:?}");
        }
        assert_eq!(arriving(&light, to_world.transform_point3(Vec3::NEG_Z)), Vec3::ZERO, "behind it");
    }
}

/// On a plane across the axis at the distance z the irradiance is the picture's over z², up to its corners.
#[test]
fn a_plane_is_lit_as_the_picture_says() {
    let (to_world, picture) = (to_world(), image());
    let lens = lens(to_world, 120.0, Profile::Plane);
    let light = light(&lens, sharp(image()));
    for z in [0.5f32, 4.0] {
        for (i, pixel) in picture.pixels.iter().enumerate() {
            let uv = (Vec2::new((i as u32 % SIZE[0]) as f32, (i as u32 / SIZE[0]) as f32) + 0.4)
                / Vec2::new(SIZE[0] as f32, SIZE[1] as f32);
            let local = ((1.0 - 2.0 * uv) * lens.half * z).extend(z);
            let irradiance = arriving(&light, to_world.transform_point3(local)) * (z / local.length());
            let expected = *pixel / (z * z);
            assert!(irradiance.distance(expected) < 1e-4 * expected.length(), "{i} {z}: {irradiance} {expected}");
        }
    }
}

/// Photons start in proportion to the light of each pixel, a thousandfold between them, so that all carry about the same. Counts of
/// 200,000 are within five standard deviations, but for what cells count for at least, 2 % of the mean; their powers within a fifth.
#[test]
fn photons_start_where_the_picture_is_bright() {
    let mut picture = image();
    picture.pixels.iter_mut().enumerate().for_each(|(i, pixel)| *pixel = Vec3::splat([0.0, 1.0, 30.0, 1000.0][i % 4]));
    let lens = lens(to_world(), 60.0, Profile::Plane);
    let light = light(&lens, sharp(picture.clone()));
    let total: f32 = picture.pixels.iter().map(|pixel| pixel.x).sum();
    let (n, mut random) = (200_000, Random::new(31, 0, 0));
    let mut counts = vec![0u32; picture.pixels.len()];
    let power = channel_mean(light.power(&NOWHERE));
    for _ in 0..n {
        let Some(emission) = light.emit(&NOWHERE, random.next_2d(), random.next_2d()) else { continue };
        let local = to_world().inverse().transform_vector3(emission.ray.direction);
        let uv = 0.5 - 0.5 * local.truncate() / (local.z * lens.half);
        let [column, row] = [uv.x * SIZE[0] as f32, uv.y * SIZE[1] as f32].map(|place| place as usize);
        counts[row * SIZE[0] as usize + column] += 1;
        if picture.pixels[row * SIZE[0] as usize + column].x > 100.0 {
            assert!((channel_mean(emission.power) / power - 1.0).abs() < 0.2, "{} {power}", emission.power);
        }
    }
    for (i, (count, pixel)) in counts.iter().zip(&picture.pixels).enumerate() {
        let share = (pixel.x / total + if pixel.x > 0.0 { 0.02 / 15.0 } else { 0.0 }) / 1.02;
        let expected = f64::from(n) * f64::from(share);
        let bound = 5.0 * expected.sqrt().max(1.0);
        assert!((f64::from(*count) - expected).abs() < bound, "{i}: {count} {expected}");
    }
}
