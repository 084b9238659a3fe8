//! Family `caustics`: glass and metal balls, blocks, bowls and rings near small lights, in diffuse surroundings.

use std::f32::consts::{FRAC_PI_2, PI};

use glam::{Mat4, Quat, Vec3};

use super::build::{Builder, diffuse};
use super::draw::Draw;
use super::revolve::{bowl, inline, ring};
use crate::scene::file::LightFile;

/// Builds the scene; the objects stand within half a unit of the origin before it is scattered.
pub fn build(draw: &mut Draw, builder: &mut Builder) {
    let walls = draw.integer(0, 5);
    let height = draw.log_range(0.8, 2.0);
    surroundings(draw, builder, walls, height);
    for _ in 0..draw.log_range(1.0, 9.0) as u32 {
        object(draw, builder);
    }
    for _ in 0..draw.integer(1, 2) {
        light(draw, builder, height);
    }
    if walls < 5 && draw.chance(0.3) {
        let radiance = draw.log_range(0.003, 0.1);
        builder.add_light(LightFile::Constant { radiance: [radiance; 3] });
    }
    let reach = if walls == 0 { 1.6 } else { 0.92 };
    let low = Vec3::new(-reach, 0.05, -reach);
    let high = Vec3::new(reach, 0.92 * height, reach);
    draw.camera(builder, [low, high], [Vec3::new(-0.4, 0.0, -0.4), Vec3::new(0.4, 0.4, 0.4)], 0.45);
}

/// A floor and the first `walls` of: three walls, a ceiling, the fourth wall.
pub fn surroundings(draw: &mut Draw, builder: &mut Builder, walls: u32, height: f32) {
    let bright = diffuse(draw.albedo().map(|c| 0.2 + 0.7 * c));
    let floor = if draw.chance(0.7) { builder.add_material("floor", bright) } else { draw.floor(builder) };
    let reach = if walls == 0 { draw.log_range(1.5, 8.0) } else { 1.0 };
    builder.add_quad("floor", Vec3::ZERO, [Vec3::Z * reach, Vec3::X * reach], &floor, None);
    let up = Vec3::Y * height * 0.5;
    let order = [Some(Vec3::NEG_Z), Some(Vec3::X), Some(Vec3::NEG_X), None, Some(Vec3::Z)];
    for side in order.into_iter().take(walls as usize) {
        let paint = draw.surface(builder, "wall");
        match side {
            Some(side) => builder.add_quad("wall", side + up, [side.cross(Vec3::Y), up], &paint, None),
            None => builder.add_quad("ceiling", up * 2.0, [Vec3::X, Vec3::Z], &paint, None),
        }
    }
}

fn object(draw: &mut Draw, builder: &mut Builder) {
    let size = draw.log_range(0.04, 0.3);
    let kind = draw.range(0.0, 1.0);
    let material = match draw.range(0.0, 1.0) {
        share if share < 0.4 => builder.add_material("glass", draw.glass()),
        share if share < 0.5 => builder.add_material("frosted glass", draw.rough_glass()),
        share if share < 0.8 => builder.add_material("metal", draw.metal(0.5)),
        _ => draw.clutter(builder, true),
    };
    let lift = if draw.chance(0.3) { draw.range(0.0, 0.4) } else { 1e-4 };
    let spot = |draw: &mut Draw, up: f32| Vec3::new(draw.range(-0.5, 0.5), up + lift, draw.range(-0.5, 0.5));
    if kind < 0.4 {
        builder.add_sphere("ball", spot(draw, size), size, &material, None);
    } else if kind < 0.6 {
        let half = Vec3::new(size, size * draw.log_range(0.3, 2.0), size * draw.log_range(0.2, 1.0));
        let (turn, up) = if draw.chance(0.3) { (draw.rotation(), half.length()) } else { (draw.yaw(), half.y) };
        builder.add_box("block", spot(draw, up), half, turn, &material);
    } else if kind < 0.8 {
        let shape = inline(&bowl(1.0, draw.log_range(0.03, 0.3), FRAC_PI_2 * draw.range(0.5, 1.2)));
        let to_world = Mat4::from_scale_rotation_translation(Vec3::splat(size), tilt(draw, 0.2), spot(draw, size));
        builder.add_mesh("bowl", shape, to_world, (Vec3::ZERO, 1.0), &material);
    } else {
        let (across, tall) = (draw.log_range(0.02, 0.3), draw.log_range(0.05, 0.6));
        let shape = inline(&ring(1.0, across, tall));
        let turn = tilt(draw, 0.5);
        let up = if turn == Quat::IDENTITY { tall * size } else { size * (1.0 + across) };
        let to_world = Mat4::from_scale_rotation_translation(Vec3::splat(size), turn, spot(draw, up));
        builder.add_mesh("ring", shape, to_world, (Vec3::ZERO, 1.0 + across.max(tall)), &material);
    }
}

/// Upright, or with probability `p` any way up.
fn tilt(draw: &mut Draw, p: f32) -> Quat {
    if draw.chance(p) { draw.rotation() } else { Quat::IDENTITY }
}

/// A small panel or ball above the objects, in free space where there is some.
fn light(draw: &mut Draw, builder: &mut Builder, height: f32) {
    let size = draw.log_range(0.005, 0.12);
    let mut center = Vec3::ZERO;
    for _ in 0..100 {
        let away = draw.log_range(0.3, 1.5);
        center = draw.direction() * Vec3::new(away, away, away);
        center = center.abs().with_x(center.x).with_z(center.z) + Vec3::Y * 0.15;
        let inside = center.y < 0.95 * height && center.x.abs().max(center.z.abs()) < 0.95;
        if inside && builder.solids().distance(center) > 1.5 * size {
            break;
        }
        center = Vec3::Y * 0.9 * height;
    }
    let dark = builder.add_material("lamp", diffuse([0.3; 3]));
    if draw.chance(0.5) {
        let emission = draw.emission(4.0 * PI * size * size);
        builder.add_sphere("bulb", center, size, &dark, Some(emission));
        return;
    }
    let target = Vec3::new(draw.range(-0.4, 0.4), 0.1, draw.range(-0.4, 0.4));
    let turn = Quat::from_rotation_arc(Vec3::Z, (target - center).normalize_or(Vec3::NEG_Y));
    let emission = draw.emission(4.0 * size * size);
    builder.add_quad("light", center, [turn * Vec3::X * size, turn * Vec3::Y * size], &dark, Some(emission));
}
