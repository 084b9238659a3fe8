//! Family `rooms`: a closed room with clutter, lit only through openings: a door ajar, windows, a second room behind.

use std::f32::consts::{FRAC_PI_2, PI};

use glam::{Quat, Vec3};

use super::build::{Builder, diffuse};
use super::draw::Draw;
use super::walls::{Opening, Room, Side};
use crate::scene::file::LightFile;

/// Builds the scene; the camera's room is about 1 unit wide before it is scattered.
pub fn build(draw: &mut Draw, builder: &mut Builder) {
    let size = Vec3::new(draw.log_range(0.6, 1.8), draw.log_range(0.45, 0.9), draw.log_range(0.6, 1.8));
    let room = Room { low: Vec3::ZERO, high: size, wall: draw.log_range(0.015, 0.1) };
    let kind = draw.range(0.0, 1.0);
    let door = (kind < 0.6).then(|| doorway(draw, &room));
    let behind = door.map(|_| behind(draw, &room));
    let windows = if kind >= 0.45 { windows(draw, &room) } else { Vec::new() };
    let floor = builder.add_material("floor", draw.diffuse());
    let ceiling = builder.add_material("ceiling", draw.diffuse());
    // One floor for both rooms: two would lie in the same plane under the door.
    let both = Room { high: behind.map_or(room.high, |b| b.high), ..room };
    both.add_floor_and_ceiling(builder, &floor, &ceiling);
    let plaster = builder.add_material("wall", draw.diffuse());
    for side in Side::ALL {
        let openings = match side {
            Side::East => door.as_slice(),
            Side::West => &windows,
            Side::North | Side::South => &[],
        };
        let paint = if draw.chance(0.6) { plaster.clone() } else { builder.add_material("wall", draw.diffuse()) };
        room.add_wall(builder, side, openings, &paint);
    }
    if let (Some(door), Some(behind)) = (door, behind) {
        leaf(draw, builder, &room, door);
        furnish_behind(draw, builder, &behind);
    }
    if !windows.is_empty() {
        outside(draw, builder, &room, &windows);
    }
    for _ in 0..draw.log_range(2.0, 18.0) as u32 {
        clutter(draw, builder, &room);
    }
    let margin = size * 0.06;
    draw.camera(builder, [margin, size - margin], [margin, size * Vec3::new(1.0, 0.7, 1.0)], 0.3);
}

fn doorway(draw: &mut Draw, room: &Room) -> Opening {
    let [start, end] = room.along(Side::East);
    let width = (draw.range(0.18, 0.4)).min(0.6 * (end - start));
    let left = draw.range(start + 0.02, end - width - 0.02);
    Opening { low: [left, room.low.y], high: [left + width, room.high.y * draw.range(0.6, 0.95)] }
}

/// One to three windows side by side.
fn windows(draw: &mut Draw, room: &Room) -> Vec<Opening> {
    let [start, end] = room.along(Side::West);
    let count = draw.integer(1, 3);
    let cell = (end - start) / count as f32;
    let [sill, top] = [draw.range(0.1, 0.6), draw.range(0.7, 0.97)].map(|share| share * room.high.y);
    let width = cell * draw.log_range(0.08, 0.9);
    let left = |i: u32| start + cell * i as f32 + 0.5 * (cell - width);
    (0..count).map(|i| Opening { low: [left(i), sill], high: [left(i) + width, top] }).collect()
}

/// The room beyond the door.
fn behind(draw: &mut Draw, room: &Room) -> Room {
    let low = Vec3::new(room.high.x + room.wall, room.low.y, room.low.z);
    Room { low, high: Vec3::new(low.x + draw.log_range(0.4, 1.5), room.high.y, room.high.z), wall: room.wall }
}

/// A leaf in the doorway, nearly closed or half open. It turns about the edge of that face of the wall to which it opens: about
/// the middle of a thick wall it would stay within the frame and let nothing through.
fn leaf(draw: &mut Draw, builder: &mut Builder, room: &Room, door: Opening) {
    let angle = draw.log_range(6.0, 75.0).to_radians();
    let half = Vec3::new(0.15 * room.wall, 0.5 * (door.high[1] - door.low[1]), 0.5 * (door.high[0] - door.low[0]));
    let outwards = draw.chance(0.5);
    let face = if outwards { room.wall } else { 0.0 };
    let hinge = room.on_wall(Side::East, [door.low[0], door.low[1] + half.y]) + Vec3::X * face;
    let turn = Quat::from_rotation_y(if outwards { angle } else { -angle });
    let material = builder.add_material("door", draw.diffuse());
    // A little short of floor and lintel, so that no two faces lie in one plane.
    let size = half * Vec3::new(1.0, 0.995, 1.0);
    builder.add_box("door", hinge + turn * (Vec3::Z * half.z), size, turn, &material);
}

/// Bright walls and a lamp.
fn furnish_behind(draw: &mut Draw, builder: &mut Builder, room: &Room) {
    let paint = builder.add_material("wall", diffuse(draw.albedo().map(|c| 0.3 + 0.6 * c)));
    for side in [Side::East, Side::North, Side::South] {
        room.add_wall(builder, side, &[], &paint);
    }
    lamp(draw, builder, room);
}

/// A panel at the ceiling, one turned to a far wall or upwards, or a small bulb.
fn lamp(draw: &mut Draw, builder: &mut Builder, room: &Room) {
    let size = room.high - room.low;
    let center = room.low + size * draw.point(Vec3::splat(0.25), Vec3::splat(0.75));
    let dark = builder.add_material("lamp", diffuse([0.3; 3]));
    if draw.chance(0.3) {
        let radius = draw.log_range(0.01, 0.08);
        let emission = draw.emission(4.0 * PI * radius * radius);
        builder.add_sphere("bulb", center, radius, &dark, Some(emission));
        return;
    }
    let [a, b] = [0, 1].map(|_| draw.log_range(0.02, 0.3) * size.min_element());
    let (center, [u, v]) = match draw.integer(0, 2) {
        0 => (Vec3::new(center.x, room.high.y - 0.01 * size.y, center.z), [Vec3::X * a, Vec3::Z * b]),
        1 => (center, [Vec3::Z * a, Vec3::X * b]),
        _ => (center, [Vec3::Y * a, Vec3::Z * b]),
    };
    let emission = draw.emission(4.0 * a * b);
    builder.add_quad("light", center, [u, v], &dark, Some(emission));
}

/// What shines through the windows: a panel, a sun, the sky, or sun and sky.
fn outside(draw: &mut Draw, builder: &mut Builder, room: &Room, windows: &[Opening]) {
    let ground = builder.add_material("ground", draw.diffuse());
    let level = Vec3::new(room.low.x - room.wall - 5.0, room.low.y - room.wall, 0.5 * (room.low.z + room.high.z));
    let has_ground = draw.chance(0.6);
    if has_ground {
        builder.add_quad("ground", level, [Vec3::Z * 5.0, Vec3::X * 5.0], &ground, None);
    }
    let kind = draw.integer(0, 3);
    if kind == 0 {
        let away = draw.log_range(0.05, 1.0);
        let window = windows[draw.integer(0, windows.len() as u32 - 1) as usize];
        let middle = [0.5 * (window.low[0] + window.high[0]), 0.5 * (window.low[1] + window.high[1])];
        let center = room.on_wall(Side::West, middle) - Vec3::X * (room.wall + away);
        let [a, b] = [0, 1].map(|_| draw.log_range(0.05, 0.5));
        let b = if has_ground { b.min(0.95 * middle[1]) } else { b };
        let dark = builder.add_material("lamp", diffuse([0.3; 3]));
        let emission = draw.emission(4.0 * a * b);
        builder.add_quad("light", center, [Vec3::Y * b, Vec3::Z * a], &dark, Some(emission));
    }
    if kind == 1 || kind == 3 {
        sun(draw, builder, room, windows);
    }
    if kind >= 2 {
        let radiance = draw.log_range(0.1, 3.0);
        builder.add_light(LightFile::Constant { radiance: draw.tint().map(|c| c * radiance) });
    }
}

/// A small bright ball on the line from a point of the floor through a window.
fn sun(draw: &mut Draw, builder: &mut Builder, room: &Room, windows: &[Opening]) {
    let window = windows[draw.integer(0, windows.len() as u32 - 1) as usize];
    let through = room.on_wall(Side::West, [0, 1].map(|i| draw.range(window.low[i], window.high[i])));
    let size = room.high - room.low;
    let lit = room.low + size * Vec3::new(draw.range(0.15, 0.9), 0.0, draw.range(0.1, 0.9));
    let away = draw.log_range(5.0, 50.0);
    let along = (through - lit).normalize_or(Vec3::NEG_X);
    // The sun's own half angle is 0.0047; larger ones stand for hazy skies.
    let radius = away * draw.log_range(0.004, 0.08);
    let dark = builder.add_material("sun", diffuse([0.0; 3]));
    let irradiance = draw.log_range(3.0, 100.0);
    let radiance = irradiance * away * away / (PI * radius * radius);
    builder.add_sphere("sun", through + along * away, radius, &dark, Some(draw.tint().map(|c| c * radiance)));
}

fn clutter(draw: &mut Draw, builder: &mut Builder, room: &Room) {
    let size = room.high - room.low;
    let unit = size.min_element();
    let on_floor = |draw: &mut Draw, up: f32| {
        let spot = Vec3::new(draw.range(0.1, 0.9), 0.0, draw.range(0.1, 0.9));
        room.low + size * spot + Vec3::Y * (up + 1e-4)
    };
    let kind = draw.range(0.0, 1.0);
    let material = draw.clutter(builder, (0.2..0.75).contains(&kind));
    if kind < 0.2 {
        let foot = on_floor(draw, 0.0);
        table(draw, builder, foot, unit, &material);
    } else if kind < 0.5 {
        let half =
            Vec3::new(1.0, draw.log_range(0.4, 4.0), draw.log_range(0.5, 2.0)) * unit * draw.log_range(0.03, 0.15);
        let half = half.min(Vec3::splat(0.35 * unit));
        builder.add_box("crate", on_floor(draw, half.y), half, draw.yaw(), &material);
    } else if kind < 0.75 {
        let radius = unit * draw.log_range(0.03, 0.2);
        builder.add_sphere("ball", on_floor(draw, radius), radius, &material, None);
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
