//! Windows of furnished rooms: frames, bars, panes, blinds and curtains, and the daylight that comes through them.

use std::f32::consts::FRAC_PI_2;

use glam::{Mat3, Mat4, Quat, Vec3};

use super::build::{Builder, glass, matrix};
use super::draw::Draw;
use super::finishes::Finishes;
use super::foliage;
use super::pictures;
use super::soup::{Soup, curtain};
use super::walls::{Opening, Room, Side};
use crate::scene::file::{LightFile, MaterialFile};

/// Coordinates of an opening: its lower middle on the wall's inner face, and the axes along, up and out of the room.
struct Place {
    foot: Vec3,
    turn: Quat,
    half_width: f32,
    height: f32,
    wall: f32,
}

impl Place {
    fn new(room: &Room, side: Side, opening: &Opening) -> Self {
        let out = side.outwards();
        let middle = 0.5 * (opening.low[0] + opening.high[0]);
        Self {
            foot: room.on_wall(side, [middle, opening.low[1]]),
            turn: Quat::from_mat3(&Mat3::from_cols(Vec3::Y.cross(out), Vec3::Y, out)),
            half_width: 0.5 * (opening.high[0] - opening.low[0]),
            height: opening.high[1] - opening.low[1],
            wall: room.wall,
        }
    }

    fn at(&self, [along, up, out]: [f32; 3]) -> Vec3 {
        self.foot + self.turn * Vec3::new(along, up, out)
    }
}

/// One to four openings side by side: windows over a sill, or doors to the ground.
pub fn openings(draw: &mut Draw, room: &Room, side: Side) -> Vec<Opening> {
    let [start, end] = room.along(side);
    let most = ((end - start) / 0.9).clamp(1.0, 4.0) as u32;
    let count = draw.integer(1, most);
    let cell = (end - start) / count as f32;
    let extent = room.high.y - room.low.y;
    let sill = room.low.y + if draw.chance(0.25) { 0.02 } else { draw.range(0.15, 0.45) } * extent;
    let (width, top) = (cell * draw.range(0.4, 0.95), room.low.y + draw.range(0.65, 0.95) * extent);
    let left = |i: u32| start + cell * i as f32 + 0.5 * (cell - width);
    (0..count).map(|i| Opening { low: [left(i), sill], high: [left(i) + width, top] }).collect()
}

/// Fits all openings of a wall out alike.
pub fn fit_out(draw: &mut Draw, builder: &mut Builder, finishes: &Finishes, room: &Room, side: Side, all: &[Opening]) {
    let frame = finishes.furniture(draw, builder);
    let bars = [draw.integer(0, 3), draw.integer(0, 3)];
    let thick = draw.range(0.015, 0.04);
    let pane = match draw.range(0.0, 1.0) {
        share if share < 0.75 => None,
        share if share < 0.95 => Some(MaterialFile::ThinDielectric { int_ior: 1.5, ext_ior: 1.0 }),
        _ => Some(glass(1.5)),
    };
    let pane = pane.map(|material| builder.add_material("pane", material));
    let dressing = draw.range(0.0, 1.0);
    let cloth = if draw.chance(0.6) { finishes.translucent(draw, builder) } else { finishes.cloth(draw, builder) };
    let tilt = draw.range(-1.3, 1.3);
    for opening in all {
        let place = Place::new(room, side, opening);
        grille(builder, &place, bars, thick, &frame);
        if let Some(pane) = &pane {
            let half = Vec3::new(place.half_width, 0.5 * place.height, 0.003);
            builder.add_box("pane", place.at([0.0, half.y, 0.7 * place.wall]), half, place.turn, pane);
        }
        if dressing < 0.2 {
            blinds(draw, builder, &place, tilt, &frame);
        } else if dressing < 0.55 {
            curtains(draw, builder, &place, room, &cloth);
        }
    }
}

/// A frame around an opening, and upright and level bars across it, as one mesh.
fn grille(builder: &mut Builder, place: &Place, [upright, level]: [u32; 2], thick: f32, material: &str) {
    let mut soup = Soup::default();
    let [w, h] = [place.half_width, 0.5 * place.height];
    let mut bar = |along: f32, up: f32, half: [f32; 2], deep: f32| {
        soup.add_box(Vec3::new(along, up, 0.0), Vec3::new(half[0], half[1], deep), Quat::IDENTITY);
    };
    for sign in [-1.0, 1.0] {
        bar(sign * (w - thick), 0.0, [thick, h], thick);
        // Between the upright parts, so that no two faces lie in one plane.
        bar(0.0, sign * (h - thick), [w - 2.0 * thick, thick], thick);
    }
    let spread = |i: u32, count: u32, half: f32| half * (2.0 * (i + 1) as f32 / (count + 1) as f32 - 1.0);
    (0..upright).for_each(|i| bar(spread(i, upright, w), 0.0, [0.4 * thick, h - 2.0 * thick], 0.5 * thick));
    (0..level).for_each(|i| bar(0.0, spread(i, level, h), [w - 2.0 * thick, 0.4 * thick], 0.4 * thick));
    let to_world = Mat4::from_rotation_translation(place.turn, place.at([0.0, h, 0.4 * place.wall]));
    // Bars are no obstacle to a camera: what counts is that nothing stands between them and it.
    builder.add_boxed("window frame", soup.finish(), to_world, [Vec3::ZERO, Vec3::ZERO], material);
}

/// Slats before the window, from its top down to its foot or a part of the way.
fn blinds(draw: &mut Draw, builder: &mut Builder, place: &Place, tilt: f32, material: &str) {
    let pitch = draw.range(0.03, 0.09);
    let length = place.height * if draw.chance(0.6) { 1.0 } else { draw.range(0.3, 0.9) };
    let turn = Quat::from_rotation_x(tilt);
    let mut soup = Soup::default();
    for i in 0..(length / pitch) as u32 {
        let center = Vec3::new(0.0, place.height - (i as f32 + 0.5) * pitch, 0.0);
        soup.add_box(center, Vec3::new(0.98 * place.half_width, 0.001, 0.55 * pitch), turn);
    }
    if soup.triangles() == 0 {
        return;
    }
    let to_world = Mat4::from_rotation_translation(place.turn, place.at([0.0, 0.0, 0.15 * place.wall]));
    let (half, deep) = (place.half_width, 0.02);
    let bounds = [Vec3::new(-half, place.height - length, -deep), Vec3::new(half, place.height, deep)];
    builder.add_boxed("blind", soup.finish(), to_world, bounds, material);
}

/// Two curtains that leave a gap, or one across, from above the window to the sill or to the floor, with a rod.
fn curtains(draw: &mut Draw, builder: &mut Builder, place: &Place, room: &Room, cloth: &str) {
    let waves = draw.integer(4, 12);
    let deep = draw.range(0.03, 0.06);
    let drop = if draw.chance(0.5) { 0.9 * (place.foot.y - room.low.y) } else { 0.0 };
    let tall = place.height + drop + 0.05;
    let reach = 1.1 * place.half_width;
    let open = if draw.chance(0.1) { 0.0 } else { draw.range(0.2, 0.85) };
    let wide = (1.0 - open) * reach;
    let key = builder.define_mesh("curtain", curtain(waves, 0.6));
    for sign in [-1.0, 1.0] {
        let left = if sign < 0.0 { -reach } else { reach - wide };
        let shift = Mat4::from_rotation_translation(place.turn, place.at([left, -drop, -0.06 - deep]));
        let to_world = shift * Mat4::from_scale(Vec3::new(wide, tall, deep));
        builder.add_boxed_instance(
            "curtain",
            &key,
            to_world,
            [Vec3::new(0.0, 0.0, -0.6), Vec3::new(1.0, 1.0, 0.6)],
            cloth,
        );
    }
    let rod = builder.add_material("rod", draw.metal(0.2));
    let half = Vec3::new(1.1 * reach, 0.01, 0.01);
    builder.add_box("rod", place.at([0.0, tall - drop + 0.015, -0.06 - deep]), half, place.turn, &rod);
}

/// Daylight of one kind behind these windows: a clear sky with or without its sun, a picture of a surrounding, or an even sky with a
/// sun; with ground and sometimes trees before it.
pub fn daylight(
    draw: &mut Draw,
    builder: &mut Builder,
    finishes: &Finishes,
    room: &Room,
    windows: &[(Side, Vec<Opening>)],
) {
    let towards = sun_through(draw, room, windows);
    sky_and_sun(draw, builder, towards);
    outside(draw, builder, finishes, room, windows);
}

/// A clear sky with or without its sun, a picture of a surrounding, or an even sky with a sun, which is in the direction `towards`.
pub fn sky_and_sun(draw: &mut Draw, builder: &mut Builder, towards: Vec3) {
    let strength = draw.log_range(0.3, 30.0);
    let sun = |draw: &mut Draw, irradiance: f32| LightFile::Sun {
        direction: (-towards).to_array(),
        irradiance: draw.near_white().map(|c| c * irradiance),
        angle: draw.log_range(0.5, 4.0),
    };
    match draw.range(0.0, 1.0) {
        share if share < 0.4 => {
            let (turbidity, albedo) = (draw.range(2.0, 8.0), draw.albedo());
            // A clear sky has about 0.05 per nanometre.
            let scale = 20.0 * strength;
            let up = [0.0, 1.0, 0.0];
            let extend = draw.chance(0.5);
            builder.add_light(LightFile::Sky {
                sun: towards.to_array(),
                up,
                turbidity,
                albedo,
                scale,
                stretch: 1.0,
                extend,
            });
            if draw.chance(0.7) {
                let irradiance = strength * draw.range(3.0, 20.0);
                let light = sun(draw, irradiance);
                builder.add_light(light);
            }
        }
        share if share < 0.8 => {
            let file = builder.add_picture("surrounding", pictures::environment(draw, towards));
            let to_world = matrix(Mat4::IDENTITY);
            builder.add_light(LightFile::Envmap { file, scale: strength, to_world });
        }
        _ => {
            builder.add_light(LightFile::Constant { radiance: draw.near_white().map(|c| c * strength) });
            let irradiance = strength * draw.log_range(1.0, 20.0);
            let light = sun(draw, irradiance);
            builder.add_light(light);
        }
    }
}

/// Direction to a sun that shines through a window onto the floor, at least a few degrees high.
fn sun_through(draw: &mut Draw, room: &Room, windows: &[(Side, Vec<Opening>)]) -> Vec3 {
    let (side, openings) = &windows[draw.integer(0, windows.len() as u32 - 1) as usize];
    let window = openings[draw.integer(0, openings.len() as u32 - 1) as usize];
    let through = room.on_wall(*side, [0, 1].map(|i| draw.range(window.low[i], window.high[i])));
    let size = room.high - room.low;
    let lit = room.low + size * Vec3::new(draw.range(0.15, 0.85), 0.0, draw.range(0.15, 0.85));
    let along = (through - lit).normalize_or(side.outwards());
    along.with_y(along.y.max(0.08)).normalize_or(Vec3::Y)
}

/// Ground, and on it trees or a wall across the way.
fn outside(draw: &mut Draw, builder: &mut Builder, finishes: &Finishes, room: &Room, windows: &[(Side, Vec<Opening>)]) {
    let level = room.low.y - room.wall - 0.3;
    if draw.chance(0.7) {
        let ground = finishes.wall(draw, builder);
        let center = (0.5 * (room.low + room.high)).with_y(level);
        builder.add_quad("ground", center, [Vec3::Z * 40.0, Vec3::X * 40.0], &ground, None);
    }
    for (side, _) in windows {
        let middle = (0.5 * (room.low + room.high)).with_y(level);
        let out = side.outwards() * (0.5 * (room.high - room.low).dot(side.outwards().abs()) + room.wall);
        let across = Vec3::Y.cross(side.outwards());
        match draw.integer(0, 4) {
            0 => {
                let kind = foliage::kind(draw, builder);
                for _ in 0..draw.integer(2, 8) {
                    let away = side.outwards() * draw.range(2.0, 8.0) + across * draw.range(-6.0, 6.0);
                    let height = draw.range(1.0, 4.0);
                    foliage::plant(draw, builder, &kind, middle + out + away, height);
                }
            }
            1 => {
                let material = finishes.wall(draw, builder);
                let half = Vec3::new(draw.range(2.0, 8.0), draw.range(1.0, 4.0), 0.2);
                let center = middle + out + side.outwards() * draw.range(3.0, 12.0) + Vec3::Y * half.y;
                let turn = Quat::from_rotation_y(if side.outwards().x == 0.0 { 0.0 } else { FRAC_PI_2 });
                builder.add_box("house", center, half, turn, &material);
            }
            _ => {}
        }
    }
}
