//! Family `rooms`: a closed room with clutter, lit only through openings: a door ajar, windows, a second room behind.

use std::f32::consts::PI;

use glam::{Quat, Vec3};

use super::build::{Builder, diffuse};
use super::draw::Draw;
use super::furniture;
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
    let floor = draw.floor(builder);
    let ceiling = builder.add_material("ceiling", draw.diffuse());
    // One floor for both rooms: two would lie in the same plane under the door.
    let both = Room { high: behind.map_or(room.high, |b| b.high), ..room };
    both.add_floor_and_ceiling(builder, &floor, &ceiling);
    let plaster = draw.surface(builder, "wall");
    for side in Side::ALL {
        let openings = match side {
            Side::East => door.as_slice(),
            Side::West => &windows,
            Side::North | Side::South => &[],
        };
        let paint = if draw.chance(0.6) { plaster.clone() } else { draw.surface(builder, "wall") };
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
        furniture::clutter(draw, builder, &room);
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
    let material = draw.surface(builder, "door");
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

/// Light that shines through the windows: a panel, a sun, the sky, or sun and sky.
fn outside(draw: &mut Draw, builder: &mut Builder, room: &Room, windows: &[Opening]) {
    let ground = draw.surface(builder, "ground");
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
