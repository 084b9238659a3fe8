//! Family `interiors`: furnished rooms, halls and stairs, some in haze, by daylight through windows or by lamps in shades.

use glam::Vec3;

use super::build::Builder;
use super::draw::Draw;
use super::finishes::Finishes;
use super::furnishings as furnish;
use super::furniture;
use super::walls::{Opening, Room, Side};
use super::windows;

/// Builds the scene; lengths are in metres before it is scattered.
pub fn build(draw: &mut Draw, builder: &mut Builder) {
    let finishes = Finishes::new(draw, builder);
    let room = room(draw);
    let by_day = draw.chance(0.75);
    let windows = if by_day { windowed_sides(draw, &room) } else { Vec::new() };
    shell(draw, builder, &finishes, &room, &windows);
    for (side, openings) in &windows {
        windows::fit_out(draw, builder, &finishes, &room, *side, openings);
    }
    if by_day {
        windows::daylight(draw, builder, &finishes, &room, &windows);
    }
    if !by_day || draw.chance(0.3) {
        furnish::lamps(draw, builder, &finishes, &room);
    }
    contents(draw, builder, &finishes, &room);
    if draw.chance(0.12) {
        haze(draw, builder, &room);
    }
    let size = room.high - room.low;
    let margin = size.min(Vec3::splat(2.0)) * Vec3::new(0.12, 0.25, 0.12);
    let target = [room.low + size * Vec3::new(0.1, 0.05, 0.1), room.low + size * Vec3::new(0.9, 0.6, 0.9)];
    draw.camera(builder, [room.low + margin, room.high - margin], target, 1.2);
}

/// A room of a home, a hall, or a long corridor.
fn room(draw: &mut Draw) -> Room {
    let size = match draw.range(0.0, 1.0) {
        share if share < 0.65 => Vec3::new(draw.range(2.8, 7.0), draw.range(2.3, 3.4), draw.range(2.8, 7.0)),
        share if share < 0.85 => Vec3::new(draw.range(6.0, 14.0), draw.range(3.5, 7.0), draw.range(6.0, 14.0)),
        _ => Vec3::new(draw.range(1.6, 2.6), draw.range(2.3, 3.2), draw.range(8.0, 18.0)),
    };
    Room { low: Vec3::ZERO, high: size, wall: draw.range(0.12, 0.4) }
}

/// One or two walls with their openings.
fn windowed_sides(draw: &mut Draw, room: &Room) -> Vec<(Side, Vec<Opening>)> {
    let first = draw.integer(0, 3) as usize;
    let count = if draw.chance(0.3) { 2 } else { 1 };
    (0..count).map(|i| Side::ALL[(first + i) % 4]).map(|side| (side, windows::openings(draw, room, side))).collect()
}

/// Floor, ceiling and walls.
fn shell(draw: &mut Draw, builder: &mut Builder, finishes: &Finishes, room: &Room, windows: &[(Side, Vec<Opening>)]) {
    let (floor, ceiling) = (finishes.floor(draw, builder), finishes.wall(draw, builder));
    room.add_floor_and_ceiling(builder, &floor, &ceiling);
    let paint = finishes.wall(draw, builder);
    for side in Side::ALL {
        let openings = windows.iter().find(|w| w.0 == side).map_or(&[][..], |w| &w.1);
        let other = if draw.chance(0.8) { paint.clone() } else { finishes.wall(draw, builder) };
        room.add_wall(builder, side, openings, &other);
    }
}

/// Furniture along the walls, a group in the middle, and small things on the floor.
fn contents(draw: &mut Draw, builder: &mut Builder, finishes: &Finishes, room: &Room) {
    if room.high.x > 4.0 && draw.chance(0.2) {
        furnish::stairs(draw, builder, finishes, room);
    }
    let area = (room.high.x - room.low.x) * (room.high.z - room.low.z);
    for _ in 0..draw.integer(3, 5 + (area / 8.0).min(6.0) as u32) {
        match draw.integer(0, 6) {
            0 | 1 => furnish::shelf(draw, builder, finishes, room),
            2 => furnish::sofa(draw, builder, finishes, room),
            3 => furnish::picture(draw, builder, finishes, room),
            4 => furnish::cabinet(draw, builder, finishes, room),
            5 => furnish::carpet(draw, builder, finishes, room),
            _ => furnish::heap(draw, builder, finishes, room),
        }
    }
    for _ in 0..draw.integer(1, 1 + (area / 16.0).min(3.0) as u32) {
        furnish::table(draw, builder, finishes, room);
    }
    for _ in 0..draw.integer(0, 6) {
        furniture::clutter(draw, builder, room);
    }
}

/// Thin haze within the walls.
fn haze(draw: &mut Draw, builder: &mut Builder, room: &Room) {
    let beyond = Vec3::splat(room.wall + 0.05);
    // A tenth to two thirds of the light are scattered on the way across the room.
    let sigma = draw.log_range(0.1, 1.0) / (room.high - room.low).length();
    let albedo = draw.range(0.7, 0.99);
    builder.fill([room.low - beyond, room.high + beyond], [sigma; 3], [albedo; 3], draw.range(0.0, 0.8));
}
