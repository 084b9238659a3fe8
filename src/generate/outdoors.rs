//! Family `outdoors`: blocks and hollow houses, plants, pergolas and free-standing walls on open ground under sun and sky.

use std::f32::consts::PI;

use glam::{Quat, Vec3};

use super::build::{Builder, diffuse};
use super::draw::Draw;
use super::foliage;
use super::walls::{Opening, Room, Side};
use crate::scene::file::LightFile;

/// Distance of the farthest buildings.
const REACH: f32 = 2.5;
/// How far solids go into the ground, so that nothing lies in its plane.
const SUNK: f32 = 0.02;

/// Builds the scene; buildings are about 1 unit wide before it is scattered.
pub fn build(draw: &mut Draw, builder: &mut Builder) {
    let ground = draw.floor(builder);
    let far = draw.log_range(6.0, 30.0);
    builder.add_quad("ground", Vec3::ZERO, [Vec3::Z * far, Vec3::X * far], &ground, None);
    let house = if draw.chance(0.5) { Some(house(draw, builder)) } else { None };
    for _ in 0..draw.log_range(4.0, 16.0) as u32 {
        let away = if house.is_some() { 1.2 } else { 0.0 };
        match draw.integer(0, 5) {
            0..=2 => block(draw, builder, away),
            3 => free_wall(draw, builder, away),
            4 => pergola(draw, builder, away),
            _ => pillars(draw, builder, away),
        }
    }
    plants(draw, builder, if house.is_some() { 1.0 } else { 0.0 });
    sky(draw, builder);
    camera(draw, builder, house);
}

/// A place on the ground, at least `away` from the origin.
fn site(draw: &mut Draw, away: f32) -> Vec3 {
    let turn = draw.yaw();
    turn * Vec3::X * draw.range(away, REACH)
}

/// Upright walls with a door and windows under a roof, around the origin.
fn house(draw: &mut Draw, builder: &mut Builder) -> Room {
    let half = Vec3::new(draw.range(0.4, 0.9), 0.0, draw.range(0.4, 0.9));
    let wall = draw.range(0.03, 0.1);
    let room = Room { low: -half - Vec3::Y * SUNK, high: half + Vec3::Y * draw.range(0.5, 1.0), wall };
    let paint = draw.surface(builder, "wall");
    for side in Side::ALL {
        let openings = openings(draw, &room, side);
        room.add_wall(builder, side, &openings, &paint);
    }
    let eaves = Vec3::new(1.0, 0.0, 1.0) * (wall + draw.range(0.02, 0.3));
    let roof = draw.surface(builder, "roof");
    let low = (room.low - eaves).with_y(room.high.y);
    builder.add_block("roof", low, room.high + eaves + Vec3::Y * draw.range(0.03, 0.2), &roof);
    room
}

/// None, or one to three openings side by side, from the ground or from a sill.
fn openings(draw: &mut Draw, room: &Room, side: Side) -> Vec<Opening> {
    let [start, end] = room.along(side);
    let count = draw.integer(0, 3);
    let cell = (end - start) / count.max(1) as f32;
    let sill = if draw.chance(0.3) { SUNK } else { draw.range(0.15, 0.4) * room.high.y };
    let (width, top) = (cell * draw.range(0.2, 0.8), draw.range(0.6, 0.9) * room.high.y);
    let left = |i: u32| start + cell * i as f32 + 0.5 * (cell - width);
    (0..count).map(|i| Opening { low: [left(i), sill], high: [left(i) + width, top] }).collect()
}

/// A solid building, sometimes of two storeys.
fn block(draw: &mut Draw, builder: &mut Builder, away: f32) {
    let material = draw.surface(builder, "building");
    let (at, turn) = (site(draw, away + 0.4), draw.yaw());
    let half = Vec3::new(draw.log_range(0.1, 0.6), draw.log_range(0.1, 1.0), draw.log_range(0.1, 0.6));
    builder.add_box("building", at + Vec3::Y * (half.y - SUNK), half, turn, &material);
    if draw.chance(0.4) {
        let upper = half * Vec3::new(draw.range(0.4, 1.3), draw.range(0.05, 0.6), draw.range(0.4, 1.3));
        let material = draw.surface(builder, "building");
        builder.add_box("building", at + Vec3::Y * (2.0 * half.y + upper.y - 2.0 * SUNK), upper, turn, &material);
    }
}

fn free_wall(draw: &mut Draw, builder: &mut Builder, away: f32) {
    let material = draw.surface(builder, "wall");
    let half = Vec3::new(draw.range(0.3, 1.5), draw.range(0.1, 0.5), draw.range(0.015, 0.06));
    let at = site(draw, away + 0.3) + Vec3::Y * (half.y - SUNK);
    builder.add_box("wall", at, half, draw.yaw(), &material);
}

/// Slats on four posts.
fn pergola(draw: &mut Draw, builder: &mut Builder, away: f32) {
    let material = builder.add_material("wood", draw.diffuse());
    let (at, turn) = (site(draw, away + 0.4), draw.yaw());
    let half = Vec3::new(draw.range(0.3, 0.8), 0.5 * draw.range(0.4, 0.8), draw.range(0.3, 0.8));
    for [x, z] in [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]] {
        let post = at + turn * (half * Vec3::new(0.95 * x, 1.0, 0.95 * z)) - Vec3::Y * SUNK;
        builder.add_box("post", post, Vec3::new(0.02, half.y, 0.02), turn, &material);
    }
    let count = draw.integer(4, 20);
    let pitch = 2.0 * half.x / count as f32;
    let slat = Vec3::new(0.5 * pitch * draw.range(0.2, 0.9), 0.012, half.z);
    let tilt = turn * Quat::from_rotation_z(draw.range(-1.0, 1.0));
    for i in 0..count {
        let x = (i as f32 + 0.5) * pitch - half.x;
        let center = at + turn * Vec3::new(x, 2.0 * half.y + slat.x, 0.0);
        builder.add_box("slat", center, slat, tilt, &material);
    }
}

/// A row of posts or of balls on posts.
fn pillars(draw: &mut Draw, builder: &mut Builder, away: f32) {
    let material = draw.clutter(builder, false);
    let ball = draw.clutter(builder, true);
    let (start, along) = (site(draw, away + 0.2), draw.yaw() * Vec3::X * draw.range(0.15, 0.5));
    let half = Vec3::new(1.0, draw.range(3.0, 12.0), 1.0) * draw.range(0.02, 0.06);
    let crowned = draw.chance(0.5);
    for i in 0..draw.integer(2, 8) {
        let foot = start + along * i as f32;
        if foot.length() < away {
            continue;
        }
        builder.add_box("pillar", foot + Vec3::Y * (half.y - SUNK), half, draw.yaw(), &material);
        if crowned {
            let radius = 1.5 * half.x;
            builder.add_sphere("ball", foot + Vec3::Y * (2.0 * half.y - SUNK + radius + 1e-4), radius, &ball, None);
        }
    }
}

/// One or two kinds of trees and bushes, and grass in some scenes.
fn plants(draw: &mut Draw, builder: &mut Builder, away: f32) {
    let kinds = draw.integer(0, 3);
    for _ in 0..kinds {
        let kind = foliage::kind(draw, builder);
        let tallest = draw.log_range(0.3, 2.5);
        for _ in 0..draw.log_range(2.0, 12.0) as u32 {
            let (foot, height) = (site(draw, away + 0.2 * tallest), tallest * draw.range(0.5, 1.0));
            foliage::plant(draw, builder, &kind, foot, height);
        }
    }
    if draw.chance(0.3) {
        let center = site(draw, away + 0.3);
        let half = draw.range(0.3, 0.8);
        foliage::grass(draw, builder, center, half);
    }
}

/// A sun, a sky, or both; never neither.
fn sky(draw: &mut Draw, builder: &mut Builder) {
    let kind = draw.integer(0, 4);
    if kind <= 2 {
        sun(draw, builder, kind == 2);
    }
    match kind {
        1 | 3 => {
            let radiance = draw.log_range(0.05, 3.0);
            builder.add_light(LightFile::Constant { radiance: draw.tint().map(|c| c * radiance) });
        }
        2 | 4 => dome(draw, builder),
        _ => {}
    }
}

/// Parallel light, or a small far ball, above the horizon; within a dome only a ball.
fn sun(draw: &mut Draw, builder: &mut Builder, domed: bool) {
    let (sin, cos) = draw.range(6.0, 80.0).to_radians().sin_cos();
    let towards = draw.yaw() * Vec3::new(cos, sin, 0.0);
    let irradiance = draw.log_range(3.0, 100.0);
    let irradiance = draw.tint().map(|c| c * irradiance);
    if !domed && draw.chance(0.7) {
        builder.add_light(LightFile::Directional { direction: (-towards).to_array(), irradiance });
        return;
    }
    let away = draw.log_range(12.0, 25.0);
    // The sun's own half angle is 0.0047; larger ones stand for hazy skies.
    let radius = away * draw.log_range(0.004, 0.05);
    let dark = builder.add_material("sun", diffuse([0.0; 3]));
    let radiance = irradiance.map(|c| c * away * away / (PI * radius * radius));
    builder.add_sphere("sun", towards * away, radius, &dark, Some(radiance));
}

/// A sky of bright patches: a gradient from the horizon upwards, uneven as by clouds, with a few far brighter ones.
fn dome(draw: &mut Draw, builder: &mut Builder) {
    let dark = builder.add_material("sky", diffuse([0.0; 3]));
    let count = draw.integer(16, 80);
    // Beyond the ground and the suns.
    let away = 31.0;
    // Wider than its share of the sky, since squares leave gaps.
    let half = 0.7 * away * (2.0 * PI / count as f32).sqrt();
    let (base, tint, uneven) = (draw.log_range(0.05, 3.0), draw.tint(), draw.range(0.0, 1.5));
    let [horizon, zenith] = [0, 1].map(|_| draw.log_range(0.3, 3.0));
    let golden = PI * (3.0 - 5f32.sqrt());
    for i in 0..count {
        let y = (i as f32 + 0.5) / count as f32;
        let across = (1.0 - y * y).sqrt();
        let (sin, cos) = (golden * i as f32).sin_cos();
        let towards = Vec3::new(across * cos, y, across * sin);
        let cloud = draw.range(-uneven, uneven).exp() * if draw.chance(0.02) { 30.0 } else { 1.0 };
        let radiance = base * (horizon + (zenith - horizon) * y) * cloud;
        let turn = Quat::from_rotation_arc(Vec3::Z, -towards);
        let edges = [turn * Vec3::X * half, turn * Vec3::Y * half];
        builder.add_quad("sky", towards * away, edges, &dark, Some(tint.map(|c| c * radiance)));
    }
}

/// In the house looking out, or outside looking at what is near the origin.
fn camera(draw: &mut Draw, builder: &mut Builder, house: Option<Room>) {
    let around = [Vec3::new(-1.6, 0.05, -1.6), Vec3::new(1.6, 0.8, 1.6)];
    if let Some(room) = house.filter(|_| draw.chance(0.4)) {
        let margin = Vec3::new(0.08, 0.1, 0.08);
        return draw.camera(builder, [room.low + margin, room.high - margin], around, 0.25);
    }
    let height = Vec3::Y * draw.log_range(0.5, 3.0);
    let stand = draw.yaw() * Vec3::X * draw.range(1.2, 2.8);
    let (low, high) = (stand - Vec3::new(0.4, 0.0, 0.4), stand + Vec3::new(0.4, 0.0, 0.4) + height);
    draw.camera(builder, [low.with_y(0.15), high], [Vec3::new(-0.8, 0.05, -0.8), Vec3::new(0.8, 0.7, 0.8)], 0.5);
}
