//! Furnishings of rooms in metres: shelves of books, laid tables, sofas, cabinets, lamps in shades, stairs, heaps of small things.

use std::f32::consts::{PI, TAU};

use glam::{Mat4, Quat, Vec2, Vec3};

use super::build::{Builder, diffuse};
use super::draw::Draw;
use super::finishes::Finishes;
use super::revolve;
use super::soup::{Soup, cushion};
use super::walls::{Room, Side};
use crate::scene::file::MeshFile;

/// A place on the floor along a wall for something `wide`: the middle of its back, and the turn that faces it into the room.
fn along_wall(draw: &mut Draw, room: &Room, wide: f32) -> (Vec3, Quat) {
    let side = Side::ALL[draw.integer(0, 3) as usize];
    let [start, end] = room.along(side);
    let half = 0.5 * wide + 0.02;
    let along = if end - start > 2.0 * half { draw.range(start + half, end - half) } else { 0.5 * (start + end) };
    let back = room.on_wall(side, [along, room.low.y]) - side.outwards() * 0.03;
    (back, Quat::from_rotation_arc(Vec3::Z, -side.outwards()).normalize())
}

/// A place on the floor, away from the walls.
fn on_floor(draw: &mut Draw, room: &Room) -> Vec3 {
    let spot = Vec3::new(draw.range(0.2, 0.8), 0.0, draw.range(0.2, 0.8));
    room.low + (room.high - room.low) * spot
}

/// A vase, glass, bowl or bottle about +y with its foot in the origin, 1 high.
fn vessel(draw: &mut Draw) -> (MeshFile, Vec3) {
    let widths: [f32; 4] = std::array::from_fn(|_| draw.range(0.12, 0.5));
    let radius = move |y: f32| {
        let at = y * 3.0;
        let (i, f) = ((at as usize).min(2), at - at.floor().min(2.0));
        let f = f * f * (3.0 - 2.0 * f);
        widths[i] + (widths[i + 1] - widths[i]) * f
    };
    let steps = 20;
    let ring = |i: i32| {
        let y = i as f32 / steps as f32;
        let slope = (radius((y + 0.01).min(1.0)) - radius((y - 0.01).max(0.0))) / 0.02;
        (Vec2::new(radius(y), y), Vec2::new(1.0, -slope).normalize_or(Vec2::X))
    };
    let mut profile = vec![(Vec2::ZERO, Vec2::NEG_Y), (Vec2::new(0.98 * widths[0], 0.0), Vec2::NEG_Y)];
    profile.extend((0..=steps).map(ring));
    profile.extend([(Vec2::new(0.98 * widths[3], 1.0), Vec2::Y), (Vec2::new(0.0, 1.0), Vec2::Y)]);
    let widest = (0..=20).map(|i| radius(i as f32 / 20.0)).fold(0.0, f32::max);
    (revolve::inline(&revolve::closed(&profile)), Vec3::new(widest, 1.0, widest))
}

/// Vessels on a board around `center`, `half` to each side, at most `tall` high; they stand apart.
fn vessels(draw: &mut Draw, builder: &mut Builder, [center, half]: [Vec3; 2], turn: Quat, tall: f32, most: u32) {
    let (mesh, size) = vessel(draw);
    let key = builder.define_mesh("vessel", mesh);
    let material = draw.clutter(builder, true);
    let pitch = (2.2 * size.x * tall).max(0.03);
    let [columns, rows] = [half.x, half.z].map(|h| ((2.0 * h / pitch) as u32).max(1));
    let mut left = draw.integer(1, most);
    for i in 0..columns * rows {
        if left == 0 || !draw.chance(0.5) {
            continue;
        }
        left -= 1;
        let spot = |at: u32, count: u32, half: f32| half * (2.0 * (at as f32 + 0.5) / count as f32 - 1.0);
        let away = Vec3::new(spot(i % columns, columns, half.x), 1e-4, spot(i / columns, rows, half.z));
        let to_world = Mat4::from_scale_rotation_translation(
            Vec3::splat(tall * draw.range(0.7, 1.0)),
            draw.yaw(),
            center + turn * away,
        );
        builder.add_boxed_instance("vessel", &key, to_world, [size * Vec3::new(-1.0, 0.0, -1.0), size], &material);
    }
}

/// Boards between uprights along a wall, with rows of books, vessels, or nothing on them.
pub fn shelf(draw: &mut Draw, builder: &mut Builder, finishes: &Finishes, room: &Room) {
    let extent = room.high - room.low;
    let half = Vec3::new(draw.range(0.3, 1.2), 0.5 * draw.range(0.7, 2.2).min(0.9 * extent.y), draw.range(0.11, 0.18));
    let (back, turn) = along_wall(draw, room, 2.0 * half.x);
    let at = |x: f32, y: f32, z: f32| back + turn * Vec3::new(x, y, z);
    let wood = finishes.furniture(draw, builder);
    let thick = 0.012;
    for sign in [-1.0, 1.0] {
        let upright = Vec3::new(thick, half.y, half.z);
        builder.add_box("upright", at(sign * (half.x + thick), half.y, half.z), upright, turn, &wood);
    }
    let boards = draw.integer(2, (2.0 * half.y / 0.3).max(3.0) as u32);
    let gap = 2.0 * half.y / boards as f32;
    let covers = [0; 3].map(|_| finishes.furniture(draw, builder));
    let mut rows = [0; 3].map(|_| Soup::default());
    for board in 0..boards {
        let y = gap * (board as f32 + 0.1);
        // A little narrower than the uprights, so that no two faces lie in one plane.
        builder.add_box("board", at(0.0, y, half.z), Vec3::new(half.x, thick, 0.97 * half.z), turn, &wood);
        let top = y + thick;
        if draw.chance(0.65) {
            books(draw, &mut rows, half, [top, 0.85 * gap - 2.0 * thick]);
        } else if draw.chance(0.6) {
            let size = Vec3::new(0.9 * half.x, 0.0, 0.7 * half.z);
            vessels(draw, builder, [at(0.0, top, half.z), size], turn, 0.7 * gap, 8);
        }
    }
    for (row, cover) in rows.into_iter().zip(covers).filter(|(row, _)| row.triangles() > 0) {
        let to_world = Mat4::from_rotation_translation(turn, back);
        let bounds = [Vec3::new(-half.x, 0.0, 0.0), Vec3::new(half.x, 2.0 * half.y, 1.8 * half.z)];
        builder.add_boxed("books", row.finish(), to_world, bounds, &cover);
    }
}

/// A row of books that stand on a board at height `top`, at most `tall` high, in covers that are drawn anew for each.
fn books(draw: &mut Draw, rows: &mut [Soup; 3], half: Vec3, [top, tall]: [f32; 2]) {
    let mut x = -half.x + 0.02;
    let end = half.x - draw.range(0.02, 0.8 * half.x);
    while x < end {
        let size =
            Vec3::new(draw.range(0.008, 0.03), 0.5 * tall * draw.range(0.6, 1.0), half.z * draw.range(0.55, 0.85));
        let lean = if draw.chance(0.1) { Quat::from_rotation_z(draw.range(-0.12, 0.12)) } else { Quat::IDENTITY };
        let center = Vec3::new(x + size.x, top + size.y + 1e-3, 0.03 + size.z);
        rows[draw.integer(0, 2) as usize].add_box(center, size, lean);
        x += 2.0 * size.x + draw.range(0.001, 0.006);
    }
}

/// A table with chairs around it and things on it.
pub fn table(draw: &mut Draw, builder: &mut Builder, finishes: &Finishes, room: &Room) {
    let (foot, turn) = (on_floor(draw, room), draw.yaw());
    let half = Vec3::new(draw.range(0.35, 1.1), draw.range(0.008, 0.025), draw.range(0.35, 0.6));
    let height = if draw.chance(0.3) { draw.range(0.3, 0.5) } else { draw.range(0.68, 0.8) };
    let wood = if draw.chance(0.15) { draw.clutter(builder, true) } else { finishes.furniture(draw, builder) };
    builder.add_box("table", foot + Vec3::Y * (height + half.y), half, turn, &wood);
    legs(draw, builder, [foot, half.with_y(height)], turn, &wood);
    let board = [foot + Vec3::Y * (height + 2.0 * half.y), half * 0.85];
    for _ in 0..draw.integer(0, 3) {
        let tall = draw.range(0.08, 0.35);
        vessels(draw, builder, board, turn, tall, 6);
    }
    if height > 0.6 {
        let seat = finishes.furniture(draw, builder);
        for sign in [-1.0, 1.0] {
            let count = draw.integer(0, (half.x / 0.3) as u32);
            for i in 0..count {
                let x = half.x * (2.0 * (i as f32 + 0.5) / count as f32 - 1.0);
                let z = sign * (half.z + draw.range(0.0, 0.3));
                let turned = turn * Quat::from_rotation_y(if sign < 0.0 { PI } else { 0.0 } + draw.range(-0.3, 0.3));
                chair(draw, builder, foot + turn * Vec3::new(x, 0.0, z), turned, &seat);
            }
        }
    }
}

/// Four legs below the corners of a board with half extents `half`, half.y being how high it is.
fn legs(draw: &mut Draw, builder: &mut Builder, [foot, half]: [Vec3; 2], turn: Quat, material: &str) {
    let thick = draw.range(0.012, 0.035);
    for [x, z] in [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]] {
        let at = Vec3::new(x * (half.x - 1.2 * thick), 0.5 * half.y, z * (half.z - 1.2 * thick));
        builder.add_box("leg", foot + turn * at, Vec3::new(thick, 0.5 * half.y - 1e-4, thick), turn, material);
    }
}

/// A seat on four legs with a back of bars towards +z.
fn chair(draw: &mut Draw, builder: &mut Builder, foot: Vec3, turn: Quat, material: &str) {
    let half = Vec3::new(0.2, 0.015, 0.2);
    builder.add_box("seat", foot + Vec3::Y * 0.45, half, turn, material);
    legs(draw, builder, [foot, half.with_y(0.435)], turn, material);
    let mut back = Soup::default();
    for i in 0..5 {
        let at = Vec3::new(0.09 * (i as f32 - 2.0), 0.68, 0.19);
        back.add_box(at, Vec3::new(0.012, 0.22, 0.008), Quat::IDENTITY);
    }
    back.add_box(Vec3::new(0.0, 0.92, 0.19), Vec3::new(0.2, 0.03, 0.012), Quat::IDENTITY);
    let bounds = [Vec3::new(-0.2, 0.46, 0.17), Vec3::new(0.2, 0.95, 0.21)];
    builder.add_boxed("back", back.finish(), Mat4::from_rotation_translation(turn, foot), bounds, material);
}

/// A sofa, armchair or bed of rounded parts along a wall, with cushions.
pub fn sofa(draw: &mut Draw, builder: &mut Builder, finishes: &Finishes, room: &Room) {
    let half = Vec3::new(draw.range(0.45, 1.2), draw.range(0.18, 0.25), draw.range(0.4, 0.95));
    let (back, turn) = along_wall(draw, room, 2.0 * half.x);
    let [cover, cloth] = [0; 2].map(|_| finishes.cloth(draw, builder));
    let key = builder.define_mesh("cushion", cushion(draw.range(0.12, 0.5)));
    let mut part = |center: Vec3, size: Vec3, lean: f32, material: &str| {
        let placed = Mat4::from_rotation_translation(turn * Quat::from_rotation_x(lean), back + turn * center);
        builder.add_boxed_instance(
            "cushion",
            &key,
            placed * Mat4::from_scale(size),
            [Vec3::NEG_ONE, Vec3::ONE],
            material,
        );
    };
    part(Vec3::new(0.0, half.y + 0.02, half.z), half, 0.0, &cover);
    part(Vec3::new(0.0, 2.0 * half.y + 0.1, 0.14), Vec3::new(half.x, 0.35, 0.12), 0.0, &cover);
    for sign in [-1.0, 1.0] {
        part(Vec3::new(sign * half.x, 1.4 * half.y, half.z), Vec3::new(0.1, 1.4 * half.y, half.z), 0.0, &cover);
    }
    let others: Vec<[f32; 4]> = (0..draw.integer(0, 5))
        .map(|_| [draw.range(0.15, 0.25), draw.range(0.15, 0.22), draw.range(-0.8, 0.8), draw.range(0.3, 0.5)])
        .collect();
    for [wide, tall, x, z] in others {
        part(Vec3::new(half.x * x, 2.0 * half.y + tall, z), Vec3::new(wide, tall, 0.06), -0.4, &cloth);
    }
}

/// A closed cabinet along a wall, of several doors with knobs, with things on it.
pub fn cabinet(draw: &mut Draw, builder: &mut Builder, finishes: &Finishes, room: &Room) {
    let half = Vec3::new(draw.range(0.3, 1.0), 0.5 * draw.range(0.5, 1.1), draw.range(0.2, 0.3));
    let (back, turn) = along_wall(draw, room, 2.0 * half.x);
    let (wood, door) = (finishes.furniture(draw, builder), finishes.furniture(draw, builder));
    builder.add_box("cabinet", back + turn * Vec3::new(0.0, half.y + 1e-4, half.z), half, turn, &wood);
    let doors = draw.integer(1, 4);
    let pitch = 2.0 * half.x / doors as f32;
    let metal = builder.add_material("knob", draw.metal(0.3));
    for i in 0..doors {
        let x = pitch * (i as f32 + 0.5) - half.x;
        let size = Vec3::new(0.47 * pitch, 0.92 * half.y, 0.008);
        builder.add_box("door", back + turn * Vec3::new(x, half.y, 2.0 * half.z + 0.009), size, turn, &door);
        let knob = back + turn * Vec3::new(x + 0.35 * pitch, half.y, 2.0 * half.z + 0.035);
        builder.add_sphere("knob", knob, 0.015, &metal, None);
    }
    let tall = draw.range(0.1, 0.5);
    vessels(draw, builder, [back + turn * Vec3::new(0.0, 2.0 * half.y, half.z), half * 0.8], turn, tall, 7);
}

/// A picture or a mirror in a frame on a wall, sometimes behind glass.
pub fn picture(draw: &mut Draw, builder: &mut Builder, finishes: &Finishes, room: &Room) {
    let half = Vec3::new(draw.range(0.15, 0.8), draw.range(0.15, 0.5), 0.01);
    let (back, turn) = along_wall(draw, room, 2.0 * half.x);
    let height = draw.range(0.5, 0.7) * (room.high.y - room.low.y);
    let at = |z: f32| back + turn * Vec3::new(0.0, height, z);
    let frame = finishes.furniture(draw, builder);
    builder.add_box("frame", at(0.01), half + Vec3::new(0.03, 0.03, 0.0), turn, &frame);
    let content =
        if draw.chance(0.3) { builder.add_material("mirror", draw.mirror()) } else { finishes.cloth(draw, builder) };
    builder.add_box("picture", at(0.022), half.with_z(0.004), turn, &content);
}

/// A flat carpet.
pub fn carpet(draw: &mut Draw, builder: &mut Builder, finishes: &Finishes, room: &Room) {
    let half = (room.high - room.low) * Vec3::new(draw.range(0.15, 0.4), 0.0, draw.range(0.15, 0.4));
    let cloth = finishes.cloth(draw, builder);
    let thick = draw.range(0.003, 0.02);
    let center = on_floor(draw, room) + Vec3::Y * thick;
    builder.add_box("carpet", center, half.with_y(thick), Quat::IDENTITY, &cloth);
}

/// A heap of small things of one mesh on the floor, tens to hundreds.
pub fn heap(draw: &mut Draw, builder: &mut Builder, finishes: &Finishes, room: &Room) {
    let foot = on_floor(draw, room);
    let size = draw.range(0.02, 0.08);
    let round = draw.range(0.15, 1.0);
    let key = builder.define_mesh("piece", cushion(round));
    let materials = [finishes.furniture(draw, builder), draw.clutter(builder, true), finishes.cloth(draw, builder)];
    let count = draw.log_range(20.0, 300.0) as u32;
    let wide = size * (count as f32).cbrt() * draw.range(1.2, 3.0);
    for _ in 0..count {
        let away = draw.direction() * wide * draw.range(0.0, 1.0).sqrt();
        let height = size + (wide - away.with_y(0.0).length()).max(0.0) * draw.range(0.0, 0.8);
        let placed = Mat4::from_rotation_translation(draw.rotation(), foot + away.with_y(height));
        let to_world = placed * Mat4::from_scale(Vec3::new(size, size * draw.range(0.4, 1.0), size));
        let material = &materials[draw.integer(0, 2) as usize];
        builder.add_boxed_instance("piece", &key, to_world, [Vec3::NEG_ONE, Vec3::ONE], material);
    }
}

/// A flight of steps along a wall, with or without solid ground below.
pub fn stairs(draw: &mut Draw, builder: &mut Builder, finishes: &Finishes, room: &Room) {
    let wood = finishes.furniture(draw, builder);
    let (rise, run, wide) = (draw.range(0.15, 0.2), draw.range(0.25, 0.32), draw.range(0.4, 0.7));
    let along = (room.high.x - room.low.x - 0.4) / run;
    let steps = (((room.high.y - room.low.y - 0.3) / rise).min(along)).max(1.0) as u32;
    let solid = draw.chance(0.5);
    for i in 0..steps {
        let top = room.low.y + rise * (i + 1) as f32;
        let x = room.low.x + 0.2 + run * (i as f32 + 0.5);
        let half_height = if solid { 0.5 * (top - room.low.y) - 1e-3 } else { 0.02 };
        let center = Vec3::new(x, top - half_height, room.low.z + 0.01 + wide);
        // Treads overlap by a little, so that no light comes through between them.
        builder.add_box("step", center, Vec3::new(0.5 * run + 1e-3, half_height, wide), Quat::IDENTITY, &wood);
    }
}

/// Lamps: one to five of a kind, hanging, standing or set into the ceiling.
pub fn lamps(draw: &mut Draw, builder: &mut Builder, finishes: &Finishes, room: &Room) {
    let count = draw.integer(1, 5);
    let kind = draw.integer(0, 3);
    let shade = finishes.translucent(draw, builder);
    let shade = if draw.chance(0.6) { shade } else { finishes.furniture(draw, builder) };
    let dark = builder.add_material("lamp", diffuse([0.3; 3]));
    let power = draw.log_range(10.0, 300.0) / count as f32;
    let tint = draw.near_white();
    let radius = draw.range(0.1, 0.3);
    let (mesh, wide) = shade_mesh(draw);
    let key = builder.define_mesh("shade", mesh);
    for _ in 0..count {
        let spot = on_floor(draw, room);
        if kind == 3 {
            let half = draw.range(0.05, 0.3);
            let at = spot.with_y(room.high.y - 0.004);
            let emission = tint.map(|c| c * power / (PI * 4.0 * half * half));
            builder.add_quad("panel", at, [Vec3::X * half, Vec3::Z * half], &dark, Some(emission));
            continue;
        }
        let height = match kind {
            0 => room.high.y - draw.range(0.3, 0.5) * (room.high.y - room.low.y),
            1 => room.low.y + draw.range(1.2, 1.7),
            _ => room.low.y + draw.range(0.3, 0.6),
        };
        let center = spot.with_y(height);
        let turned = if draw.chance(0.8) { Quat::IDENTITY } else { Quat::from_rotation_x(draw.range(-0.6, 0.6)) };
        let to_world = Mat4::from_scale_rotation_translation(Vec3::splat(radius), turned, center);
        builder.add_instance("shade", &key, to_world, (Vec3::ZERO, wide), &shade);
        let bulb = draw.range(0.1, 0.25) * radius;
        let emission = tint.map(|c| c * power / (PI * 4.0 * PI * bulb * bulb));
        builder.add_sphere("bulb", center, bulb, &dark, Some(emission));
        let [low, high] = if kind == 0 { [height + 0.9 * radius, room.high.y] } else { [room.low.y, height - bulb] };
        let half = Vec3::new(0.006, (0.5 * (high - low)).max(1e-3), 0.006);
        builder.add_box("stem", spot.with_y(low + half.y), half, Quat::IDENTITY, &dark);
    }
}

/// A shade about +y that is open above and below, within ±0.8 of the origin, and the radius of a ball around it.
fn shade_mesh(draw: &mut Draw) -> (MeshFile, f32) {
    let [low, high] = [draw.range(0.6, 1.2), draw.range(0.4, 1.0)];
    let mut soup = Soup::default();
    soup.add_surface([32, 3], |uv| {
        let (sin, cos) = (TAU * uv.x).sin_cos();
        let radius = low + (high - low) * uv.y;
        let normal = Vec3::new(cos, (low - high) / 1.6, -sin).normalize_or(Vec3::X);
        [Vec3::new(radius * cos, 1.6 * uv.y - 0.8, -radius * sin), normal]
    });
    (soup.finish(), low.max(high).hypot(0.8))
}
