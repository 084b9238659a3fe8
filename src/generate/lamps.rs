//! Family `lamps`: a closed room with 2 to 200 small lamps: bulbs, panels, lamps in shades, points and spots, on the ceiling, on walls,
//! on a chandelier, above a cornice or anywhere, and furniture between them. Family `beams`: the same room with a few spots so narrow
//! that it is lit by the small places where they end.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::{Mat4, Quat, Vec3};

use super::build::{Builder, diffuse, matrix};
use super::draw::Draw;
use super::furniture;
use super::revolve::{bowl, inline, ring};
use super::walls::{Room, Side};
use crate::scene::file::LightFile;

/// Most lamps with a shade in one group: each is a mesh of its own to the ray tracer.
const MOST_SHADES: u32 = 24;

/// Kinds of lamps.
#[derive(Debug, Clone, PartialEq)]
enum Kind {
    /// A bright ball.
    Bulb,
    /// A bright square.
    Panel,
    /// A point.
    Point,
    /// A cone of light with this half angle, degrees.
    Spot(f32),
    /// A light within an opaque bowl or ring.
    Shade(Shade),
}

/// The shade that the lamps of one group share.
#[derive(Debug, Clone, PartialEq)]
struct Shade {
    mesh: String,
    material: String,
    /// Radius of the ball around the mesh.
    reach: f32,
    /// Radius of the bulb within a shade of radius 1; none is a point.
    bulb: Option<f32>,
    turn: Quat,
}

/// Places of the lamps of a group.
#[derive(Debug, Clone, Copy)]
enum Layout {
    /// In rows below the ceiling.
    Ceiling,
    /// Along one wall.
    Wall(Side),
    /// Around one point.
    Chandelier(Vec3),
    /// Above a board at one wall, which hides them from below.
    Cornice,
    /// Anywhere.
    Free,
}

/// Lamps of one kind.
#[derive(Debug, Clone)]
struct Group {
    kind: Kind,
    layout: Layout,
    count: u32,
    /// Material of the emitting surface.
    dark: String,
    /// Radius, half edge, or radius of the shade.
    size: f32,
    /// Power of the middle lamp of a group; by the logarithm the mean one.
    power: f32,
    /// Half the range of a lamp's power in the logarithm.
    spread: f32,
}

/// Builds a scene of `lamps`; the room is about 1 unit wide before it is scattered.
pub fn build(draw: &mut Draw, builder: &mut Builder) {
    furnish(draw, builder, light);
}

/// Builds a scene of `beams`.
pub fn build_beams(draw: &mut Draw, builder: &mut Builder) {
    furnish(draw, builder, light_by_beams);
}

fn furnish(draw: &mut Draw, builder: &mut Builder, light: fn(&mut Draw, &mut Builder, &Room)) {
    let size = Vec3::new(draw.log_range(0.6, 2.2), draw.log_range(0.45, 0.9), draw.log_range(0.6, 2.2));
    let room = Room { low: Vec3::ZERO, high: size, wall: 0.05 };
    let floor = draw.floor(builder);
    let ceiling = builder.add_material("ceiling", draw.diffuse());
    room.add_floor_and_ceiling(builder, &floor, &ceiling);
    let plaster = draw.surface(builder, "wall");
    for side in Side::ALL {
        let paint = if draw.chance(0.6) { plaster.clone() } else { draw.surface(builder, "wall") };
        room.add_wall(builder, side, &[], &paint);
    }
    for _ in 0..draw.log_range(3.0, 20.0) as u32 {
        furniture::clutter(draw, builder, &room);
    }
    light(draw, builder, &room);
    let margin = size * 0.06;
    draw.camera(builder, [margin, size - margin], [margin, size * Vec3::new(1.0, 0.8, 1.0)], 0.3);
}

/// Hangs one to three groups of lamps.
fn light(draw: &mut Draw, builder: &mut Builder, room: &Room) {
    let lamps = draw.log_range(2.0, 201.0) as u32;
    let groups = draw.integer(1, 3).min(lamps);
    let power = draw.power() / lamps as f32;
    for number in 0..groups {
        let count = lamps / groups + u32::from(number < lamps % groups);
        let each = power * draw.log_range(0.3, 3.0);
        let group = group(draw, builder, room, count, each);
        // The first lamp hangs even where there is no free place for it, so that no room is dark.
        let mut must = number == 0;
        for index in 0..group.count {
            let tint = draw.tint();
            let share = group.power * draw.range(-group.spread, group.spread).exp();
            if let Some(center) = place(draw, builder, room, &group, index, must) {
                hang(draw, builder, &group, center, tint.map(|c| c * share));
                must = false;
            }
        }
    }
}

/// Hangs up to six narrow spots, and sometimes a dim bulb.
fn light_by_beams(draw: &mut Draw, builder: &mut Builder, room: &Room) {
    let beams = draw.integer(1, 6);
    let power = draw.power() / beams as f32;
    let dark = builder.add_material("lamp", diffuse([0.3; 3]));
    let lamp =
        |kind, layout, count, power| Group { kind, layout, count, dark: dark.clone(), size: 0.01, power, spread: 0.0 };
    for index in 0..beams {
        let layout = if draw.chance(0.5) { Layout::Ceiling } else { Layout::Free };
        let beam = lamp(Kind::Spot(draw.log_range(0.5, 8.0)), layout, beams, power);
        let tint = draw.tint();
        if let Some(center) = place(draw, builder, room, &beam, index, index == 0) {
            hang(draw, builder, &beam, center, tint.map(|c| c * power));
        }
    }
    if draw.chance(0.3) {
        let dim = power * draw.log_range(0.01, 0.3);
        let bulb = lamp(Kind::Bulb, Layout::Free, 1, dim);
        if let Some(center) = place(draw, builder, room, &bulb, 0, false) {
            hang(draw, builder, &bulb, center, [dim; 3]);
        }
    }
}

fn group(draw: &mut Draw, builder: &mut Builder, room: &Room, count: u32, power: f32) -> Group {
    let extent = room.high - room.low;
    let kind = match draw.integer(0, 9) {
        0..=2 => Kind::Bulb,
        3 => Kind::Panel,
        4 => Kind::Point,
        5..=6 => Kind::Spot(draw.log_range(8.0, 60.0)),
        _ => Kind::Shade(shade(draw, builder)),
    };
    let shaded = matches!(kind, Kind::Shade(_));
    // Many lamps are small ones.
    let most = 0.3 * extent.min_element() / (count as f32).cbrt();
    let size = if shaded { most.min(0.12) * draw.range(0.4, 1.0) } else { most.min(0.05) * draw.log_range(0.06, 1.0) };
    let layout = match draw.integer(0, 9) {
        0..=3 => Layout::Ceiling,
        4..=5 => Layout::Wall(Side::ALL[draw.integer(0, 3) as usize]),
        6 => Layout::Chandelier(extent * draw.point(Vec3::new(0.3, 0.5, 0.3), Vec3::new(0.7, 0.75, 0.7))),
        7 if !shaded => {
            cornice(draw, builder, room);
            Layout::Cornice
        }
        _ => Layout::Free,
    };
    let hung = if shaded { count.min(MOST_SHADES) } else { count };
    let spread = if draw.chance(0.5) { 1.5 } else { 0.0 };
    let dark = builder.add_material("lamp", diffuse([0.3; 3]));
    Group { kind, layout, count: hung, dark, size, power: power * count as f32 / hung as f32, spread }
}

fn shade(draw: &mut Draw, builder: &mut Builder) -> Shade {
    let (mesh, reach) = if draw.chance(0.5) {
        (bowl(1.0, draw.range(0.03, 0.1), FRAC_PI_2 * draw.range(0.4, 1.1)), 1.0)
    } else {
        let (across, tall) = (draw.range(0.02, 0.06), draw.range(0.5, 1.3));
        (ring(1.0, across, tall), (1.0 + across).hypot(tall))
    };
    let mesh = builder.define_mesh("shade", inline(&mesh));
    let material = if draw.chance(0.7) { draw.diffuse() } else { draw.metal(0.2) };
    let material = builder.add_material("shade", material);
    let bulb = draw.chance(0.8).then(|| draw.range(0.1, 0.4));
    let turn = match draw.integer(0, 4) {
        0..=1 => Quat::IDENTITY,
        2..=3 => Quat::from_rotation_x(PI),
        _ => draw.rotation(),
    };
    Shade { mesh, material, reach, bulb, turn }
}

/// A board along the west wall below the ceiling.
fn cornice(draw: &mut Draw, builder: &mut Builder, room: &Room) {
    let extent = room.high - room.low;
    let board = builder.add_material("cornice", draw.diffuse());
    let low = room.low + Vec3::new(1e-3, 0.8 * extent.y, 1e-3);
    let high = Vec3::new(room.low.x + 0.12 * extent.x, room.low.y + 0.82 * extent.y, room.high.z - 1e-3);
    builder.add_block("cornice", low, high, &board);
}

/// A free place for a lamp of the group, the best of some; none where even that is taken, unless it `must` be.
fn place(draw: &mut Draw, builder: &Builder, room: &Room, group: &Group, index: u32, must: bool) -> Option<Vec3> {
    let reach = match &group.kind {
        Kind::Shade(shade) => shade.reach * group.size,
        Kind::Bulb | Kind::Panel | Kind::Point | Kind::Spot(_) => group.size,
    };
    let mut best = (f32::NEG_INFINITY, Vec3::ZERO);
    for _ in 0..20 {
        let center = spot(draw, room, group, index, reach);
        let free = builder.solids().distance(center) - reach;
        if free > best.0 {
            best = (free, center);
        }
        if free > 0.0 {
            break;
        }
    }
    (best.0 > 0.0 || must).then_some(best.1)
}

/// A place as the layout wants it, with `reach` and a little more to the walls.
fn spot(draw: &mut Draw, room: &Room, group: &Group, index: u32, reach: f32) -> Vec3 {
    let extent = room.high - room.low;
    let gap = 1.05 * reach + 2e-3;
    let free = room.low + extent * draw.point(Vec3::ZERO, Vec3::ONE);
    let wished = match group.layout {
        Layout::Ceiling => {
            let columns =
                (group.count as f32 * extent.x / extent.z).sqrt().ceil().clamp(1.0, group.count as f32) as u32;
            let rows = group.count.div_ceil(columns);
            let [x, z] =
                [(index % columns, columns), (index / columns, rows)].map(|(i, n)| (i as f32 + 0.5) / n as f32);
            Vec3::new(room.low.x + x * extent.x, room.high.y, room.low.z + z * extent.z)
        }
        Layout::Wall(side) => {
            let [start, end] = room.along(side);
            let along = start + (end - start) * (index as f32 + 0.5) / group.count as f32;
            room.on_wall(side, [along, room.low.y + extent.y * (0.65 + 0.2 * draw.range(-1.0, 1.0))])
        }
        Layout::Chandelier(center) => center + draw.direction() * draw.range(0.5, 1.0) * 0.25 * extent.min_element(),
        Layout::Cornice => {
            Vec3::new(room.low.x + draw.range(0.02, 0.1) * extent.x, room.low.y + 0.88 * extent.y, free.z)
        }
        Layout::Free => free,
    };
    let middle = 0.5 * (room.low + room.high);
    wished.max((room.low + gap).min(middle)).min((room.high - gap).max(middle))
}

/// Adds one lamp; `power` is per channel.
fn hang(draw: &mut Draw, builder: &mut Builder, group: &Group, center: Vec3, power: [f32; 3]) {
    let size = group.size;
    match &group.kind {
        Kind::Bulb => bulb(builder, center, size, power, &group.dark),
        Kind::Point => point(builder, center, power),
        Kind::Panel => {
            let down = Quat::from_rotation_x(FRAC_PI_2);
            let turn = if draw.chance(0.7) { down } else { draw.rotation() };
            let half = 0.7 * size;
            let emission = power.map(|p| p / (PI * 4.0 * half * half));
            builder.add_quad(
                "panel",
                center,
                [turn * Vec3::X * half, turn * Vec3::Y * half],
                &group.dark,
                Some(emission),
            );
        }
        Kind::Spot(cutoff) => {
            let (cutoff, beam) = (*cutoff, draw.range(0.3, 0.95));
            let aim = if draw.chance(0.7) { Vec3::NEG_Y + 0.7 * draw.direction() } else { draw.direction() };
            let turn = Quat::from_rotation_arc(Vec3::Z, aim.normalize_or(Vec3::NEG_Y));
            let solid_angle = TAU * (1.0 - cutoff.to_radians().cos());
            builder.add_light(LightFile::Spot {
                to_world: matrix(Mat4::from_rotation_translation(turn, center)),
                intensity: power.map(|p| p / solid_angle),
                cutoff_angle: cutoff,
                beam_width: beam * cutoff,
            });
        }
        Kind::Shade(shade) => {
            let to_world = Mat4::from_scale_rotation_translation(Vec3::splat(size), shade.turn, center);
            match shade.bulb {
                Some(radius) => bulb(builder, center, radius * size, power, &group.dark),
                None => point(builder, center, power),
            }
            builder.add_instance("shade", &shade.mesh, to_world, (Vec3::ZERO, shade.reach), &shade.material);
        }
    }
}

fn bulb(builder: &mut Builder, center: Vec3, radius: f32, power: [f32; 3], dark: &str) {
    let emission = power.map(|p| p / (PI * 4.0 * PI * radius * radius));
    builder.add_sphere("bulb", center, radius, dark, Some(emission));
}

fn point(builder: &mut Builder, center: Vec3, power: [f32; 3]) {
    builder.add_light(LightFile::Point { position: center.to_array(), intensity: power.map(|p| p / (4.0 * PI)) });
}
