//! Furniture and clutter in rooms: crates, balls, boards, tables, racks and plants.

use std::f32::consts::FRAC_PI_2;

use glam::{Quat, Vec3};

use super::build::Builder;
use super::draw::Draw;
use super::foliage;
use super::walls::Room;

/// One thing on the floor of a room.
pub fn clutter(draw: &mut Draw, builder: &mut Builder, room: &Room) {
    let size = room.high - room.low;
    let unit = size.min_element();
    let on_floor = |draw: &mut Draw, up: f32| {
        let spot = Vec3::new(draw.range(0.1, 0.9), 0.0, draw.range(0.1, 0.9));
        room.low + size * spot + Vec3::Y * (up + 1e-4)
    };
    let kind = draw.range(0.0, 1.0);
    if kind > 0.96 {
        let foot = on_floor(draw, 0.0);
        return foliage::potted(draw, builder, foot, unit);
    }
    let material = draw.clutter(builder, (0.2..0.7).contains(&kind));
    if kind < 0.2 {
        let foot = on_floor(draw, 0.0);
        table(draw, builder, foot, unit, &material);
    } else if kind < 0.5 {
        let half =
            Vec3::new(1.0, draw.log_range(0.4, 4.0), draw.log_range(0.5, 2.0)) * unit * draw.log_range(0.03, 0.15);
        let half = half.min(Vec3::splat(0.35 * unit));
        builder.add_box("crate", on_floor(draw, half.y), half, draw.yaw(), &material);
    } else if kind < 0.7 {
        let radius = unit * draw.log_range(0.03, 0.2);
        builder.add_sphere("ball", on_floor(draw, radius), radius, &material, None);
    } else if kind < 0.82 {
        let foot = on_floor(draw, 0.0);
        rack(draw, builder, foot, unit, &material);
    } else {
        let half = Vec3::new(unit * draw.log_range(0.05, 0.3), unit * draw.log_range(0.1, 0.3), 0.004);
        let lean = draw.yaw() * Quat::from_rotation_x(draw.range(0.05, 0.9));
        builder.add_box("board", on_floor(draw, half.y), half, lean, &material);
    }
}

/// A board on four legs, with up to three things on it.
fn table(draw: &mut Draw, builder: &mut Builder, foot: Vec3, unit: f32, material: &str) {
    let half = Vec3::new(draw.range(0.1, 0.3), 0.012, draw.range(0.1, 0.3)) * unit;
    let height = draw.range(0.2, 0.45) * unit;
    let turn = Quat::from_rotation_y(draw.integer(0, 1) as f32 * FRAC_PI_2 + draw.range(-0.2, 0.2));
    builder.add_box("table", foot + Vec3::Y * height, half, turn, material);
    let leg = Vec3::new(half.y, 0.5 * (height - half.y) - 1e-4, half.y);
    for [x, z] in [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]] {
        let corner = turn * Vec3::new(x * (half.x - leg.x), leg.y, z * (half.z - leg.z));
        builder.add_box("leg", foot + corner, leg, turn, material);
    }
    for _ in 0..draw.integer(0, 3) {
        let radius = unit * draw.log_range(0.015, 0.06);
        let spot = turn * (half * Vec3::new(draw.range(-0.8, 0.8), 0.0, draw.range(-0.8, 0.8)));
        let center = foot + spot + Vec3::Y * (height + half.y + radius + 1e-4);
        let thing = draw.clutter(builder, true);
        if draw.chance(0.5) {
            builder.add_sphere("ball", center, radius, &thing, None);
        } else {
            builder.add_box("block", center, Vec3::splat(radius), draw.yaw(), &thing);
        }
    }
}

/// Boards between two uprights.
fn rack(draw: &mut Draw, builder: &mut Builder, foot: Vec3, unit: f32, material: &str) {
    let half = Vec3::new(draw.range(0.1, 0.3), 0.5 * draw.range(0.3, 0.9), draw.range(0.04, 0.12)) * unit;
    let (turn, thick) = (draw.yaw(), 0.012 * unit);
    for side in [-1.0, 1.0] {
        let upright = foot + turn * (Vec3::X * side * (half.x + thick)) + Vec3::Y * half.y;
        builder.add_box("upright", upright, Vec3::new(thick, half.y, half.z), turn, material);
    }
    let boards = draw.integer(2, 5);
    for board in 0..boards {
        let up = 2.0 * half.y * (board as f32 + 0.5) / boards as f32;
        // A little narrower than the uprights, so that no two faces lie in one plane.
        let size = Vec3::new(half.x, thick, 0.98 * half.z);
        builder.add_box("board", foot + Vec3::Y * up, size, turn, material);
    }
}
