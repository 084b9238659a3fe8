//! Family `primitives`: boxes, balls, tilted slabs and thin screens under one to three area lights.

use std::f32::consts::TAU;

use glam::{Quat, Vec3};

use super::build::{Builder, diffuse};
use super::draw::Draw;

/// Half the edge of the content.
const HALF: f32 = 1.0;

/// Builds the scene; the world has its content in [-1, 1] × [0, height] × [-1, 1] before it is scattered.
pub fn build(draw: &mut Draw, builder: &mut Builder) {
    let height = draw.log_range(0.7, 2.5);
    let closed = draw.chance(0.6);
    enclosure(draw, builder, height, closed);
    for _ in 0..draw.log_range(3.0, 30.0) as u32 {
        object(draw, builder, height);
    }
    for _ in 0..draw.integer(1, 3) {
        light(draw, builder, height, closed);
    }
    let margin = Vec3::new(0.05, 0.05, 0.05);
    let (low, high) = (Vec3::new(-HALF, 0.0, -HALF), Vec3::new(HALF, height, HALF));
    let around = if closed { [low + margin, high - margin] } else { [low * 1.8 + margin, high * 1.8] };
    draw.camera(builder, around, [low * 0.6 + margin, high * Vec3::new(0.6, 0.5, 0.6)], 0.6);
}

/// A floor; in a closed scene also walls and a ceiling.
fn enclosure(draw: &mut Draw, builder: &mut Builder, height: f32, closed: bool) {
    let floor = draw.floor(builder);
    let reach = if closed { HALF } else { draw.log_range(1.5, 10.0) };
    builder.add_quad("floor", Vec3::ZERO, [Vec3::Z * reach, Vec3::X * reach], &floor, None);
    if !closed {
        return;
    }
    let up = Vec3::Y * height * 0.5;
    let ceiling = builder.add_material("ceiling", draw.diffuse());
    builder.add_quad("ceiling", up * 2.0, [Vec3::X * HALF, Vec3::Z * HALF], &ceiling, None);
    let shared = draw.surface(builder, "wall");
    for side in [Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::NEG_Z] {
        let material = if draw.chance(0.5) { shared.clone() } else { draw.surface(builder, "wall") };
        let along = side.cross(Vec3::Y) * HALF;
        builder.add_quad("wall", side * HALF + up, [along, up], &material, None);
    }
}

fn object(draw: &mut Draw, builder: &mut Builder, height: f32) {
    let size = draw.log_range(0.03, 0.45);
    let kind = draw.range(0.0, 1.0);
    let material = draw.clutter(builder, kind < 0.75);
    let hovering = draw.chance(0.3);
    let place = |draw: &mut Draw, low: f32| {
        let y = if hovering { draw.range(low, (height - low).max(low + 0.01)) } else { low + 1e-4 };
        Vec3::new(draw.range(-0.85, 0.85) * HALF, y, draw.range(-0.85, 0.85) * HALF)
    };
    if kind < 0.35 {
        let half = Vec3::new(size, size * draw.log_range(0.4, 3.0), size * draw.log_range(0.4, 1.5));
        let (turn, low) = if hovering { (draw.rotation(), half.length()) } else { (draw.yaw(), half.y) };
        let center = place(draw, low);
        builder.add_box("box", center, half, turn, &material);
    } else if kind < 0.6 {
        let center = place(draw, size);
        builder.add_sphere("ball", center, size, &material, None);
    } else if kind < 0.75 {
        let half = Vec3::new(size * 1.5, size * draw.log_range(0.03, 0.2), size * 1.5);
        let turn = draw.yaw() * Quat::from_rotation_x(draw.range(0.1, 1.3));
        let center = place(draw, half.length() * 0.7);
        builder.add_box("slab", center, half, turn, &material);
    } else {
        let turn = draw.yaw() * Quat::from_rotation_x(draw.range(-0.6, 0.6));
        let [u, v] = [turn * Vec3::X * size * 1.5, turn * Vec3::Y * size];
        let center = place(draw, size);
        builder.add_quad("screen", center, [u, v], &material, None);
    }
}

/// A rectangular light: from the ceiling, or free in space facing anywhere that can be lit, sometimes behind a screen.
fn light(draw: &mut Draw, builder: &mut Builder, height: f32, closed: bool) {
    let [a, b] = [draw.log_range(0.01, 0.5), draw.log_range(0.5, 2.0)].map(|x| x * HALF);
    let (half_u, half_v) = (a, (a * b).min(0.8 * HALF));
    let from_ceiling = draw.chance(0.4);
    let low = if from_ceiling { 0.98 } else { draw.range(0.3, 0.95) } * height;
    let center = Vec3::new(draw.range(-0.8, 0.8) * HALF, low, draw.range(-0.8, 0.8) * HALF);
    let normal = if from_ceiling {
        Vec3::NEG_Y
    } else if closed && draw.chance(0.4) {
        Vec3::Y
    } else {
        let target = Vec3::new(draw.range(-0.5, 0.5), 0.0, draw.range(-0.5, 0.5));
        (target - center).normalize_or(Vec3::NEG_Y)
    };
    let turn = Quat::from_rotation_arc(Vec3::Z, normal) * Quat::from_rotation_z(draw.range(0.0, TAU));
    let [u, v] = [turn * Vec3::X * half_u, turn * Vec3::Y * half_v];
    let dark = builder.add_material("lamp", diffuse([0.3; 3]));
    let emission = draw.emission(4.0 * half_u * half_v);
    builder.add_quad("light", center, [u, v], &dark, Some(emission));
    if draw.chance(0.3) {
        let gap = draw.log_range(0.03, 0.3) * HALF;
        let wider = draw.log_range(0.7, 2.5);
        let screen = builder.add_material("screen", draw.diffuse());
        builder.add_quad("screen", center + normal * gap, [u * wider, v * wider], &screen, None);
    }
}
