//! Family `corridors`: a corridor with corners, niches and side rooms behind doors that are ajar. Light comes from its far end or from
//! a side room; floors and walls are often glossy or mirrors.

use std::collections::BTreeSet;
use std::f32::consts::PI;

use glam::{IVec2, Mat3, Mat4, Quat, Vec3};

use super::build::{Builder, diffuse, matrix};
use super::draw::Draw;
use super::furniture;
use super::walls::Room;
use crate::scene::file::LightFile;

/// Width of the corridor and edge of the cells that it is made of.
const CELL: f32 = 0.5;
/// More cells than any corridor is long.
const MOST_CELLS: i32 = 32;

/// The cells of the plan that are empty.
#[derive(Debug, Default)]
struct Plan {
    /// The corridor from its near to its far end; each cell lies beside the one before.
    path: Vec<IVec2>,
    /// Where the corridor turns, as indices into the path, and its far end.
    corners: Vec<usize>,
    /// Cells beside the corridor, with the direction to them.
    niches: Vec<(IVec2, IVec2)>,
    height: f32,
}

impl Plan {
    fn is_free(&self, cell: IVec2) -> bool {
        self.path.contains(&cell) || self.niches.iter().any(|n| n.0 == cell)
    }

    /// Whether a cell may be emptied beside `from` without touching any other empty cell.
    fn may_empty(&self, cell: IVec2, from: IVec2) -> bool {
        let near = |d: IVec2| cell + d != from && self.is_free(cell + d);
        !self.is_free(cell) && ![IVec2::X, IVec2::NEG_X, IVec2::Y, IVec2::NEG_Y].into_iter().any(near)
    }

    /// The space of a cell.
    fn room(&self, cell: IVec2) -> Room {
        let low = Vec3::new(cell.x as f32, 0.0, cell.y as f32) * CELL;
        Room { low, high: low + Vec3::new(CELL, self.height, CELL), wall: 0.02 }
    }

    /// The direction in which the corridor arrives at its far end.
    fn onwards(&self) -> IVec2 {
        match self.path[..] {
            [.., before, last] => last - before,
            _ => IVec2::X,
        }
    }

    /// The cells straight beyond the far end.
    fn beyond(&self) -> impl Iterator<Item = IVec2> {
        let (end, step) = (self.path[self.path.len() - 1], self.onwards());
        (1..MOST_CELLS).map(move |k| end + step * k)
    }

    /// Whether nothing of the corridor is straight beyond its far end.
    fn sees_outside(&self) -> bool {
        self.beyond().all(|cell| !self.is_free(cell))
    }
}

/// The direction of a step between cells.
fn direction(step: IVec2) -> Vec3 {
    Vec3::new(step.x as f32, 0.0, step.y as f32)
}

/// Builds the scene; the corridor is half a unit wide before it is scattered.
pub fn build(draw: &mut Draw, builder: &mut Builder) {
    let plan = plan(draw);
    let open = draw.chance(0.3) && plan.sees_outside();
    walls(draw, builder, &plan, open);
    for &(cell, side) in &plan.niches {
        niche(draw, builder, &plan, cell, side);
    }
    for index in 1..plan.path.len() {
        for _ in 0..if draw.chance(0.4) { draw.integer(1, 3) } else { 0 } {
            furniture::clutter(draw, builder, &plan.room(plan.path[index]));
        }
    }
    let last = plan.room(plan.path[plan.path.len() - 1]);
    if open {
        outside(draw, builder, &last, direction(plan.onwards()));
    } else {
        lamp(draw, builder, &last, direction(plan.onwards()));
    }
    camera(draw, builder, &plan);
}

/// One to four straight runs.
fn plan(draw: &mut Draw) -> Plan {
    let mut plan = Plan { path: vec![IVec2::ZERO], height: CELL * draw.range(0.8, 1.8), ..Plan::default() };
    let mut ahead = IVec2::X;
    let runs = draw.integer(1, 4);
    for _ in 0..runs {
        for _ in 0..draw.integer(2, if runs == 1 { 12 } else { 5 }) {
            let from = plan.path[plan.path.len() - 1];
            if plan.may_empty(from + ahead, from) {
                plan.path.push(from + ahead);
            }
        }
        plan.corners.push(plan.path.len() - 1);
        ahead = if draw.chance(0.5) { ahead.perp() } else { -ahead.perp() };
    }
    for index in 1..plan.path.len() - 1 {
        let step = plan.path[index + 1] - plan.path[index];
        let side = if draw.chance(0.5) { step.perp() } else { -step.perp() };
        let cell = plan.path[index] + side;
        if draw.chance(0.25) && plan.may_empty(cell, plan.path[index]) {
            plan.niches.push((cell, side));
        }
    }
    plan
}

/// Floor, ceiling, and blocks in all cells around the empty ones; `open` leaves the far end without one.
fn walls(draw: &mut Draw, builder: &mut Builder, plan: &Plan, open: bool) {
    let free = plan.path.iter().copied().chain(plan.niches.iter().map(|n| n.0));
    let around = |cell: IVec2| (-1..=1).flat_map(move |x| (-1..=1).map(move |y| cell + IVec2::new(x, y)));
    // By row, then along it, so that runs are found in order.
    let mut solid: BTreeSet<[i32; 2]> =
        free.flat_map(around).filter(|&c| !plan.is_free(c)).map(|c| [c.y, c.x]).collect();
    let low = solid.iter().fold(IVec2::MAX, |low, c| low.min(IVec2::new(c[1], c[0])));
    let high = solid.iter().fold(IVec2::MIN, |high, c| high.max(IVec2::new(c[1], c[0])));
    if open {
        solid.retain(|c| plan.beyond().all(|b| [b.y, b.x] != *c));
    }
    let whole = Room { low: plan.room(low).low, high: plan.room(high).high, wall: 0.05 };
    let floor = draw.floor(builder);
    let ceiling = builder.add_material("ceiling", draw.diffuse());
    whole.add_floor_and_ceiling(builder, &floor, &ceiling);
    let plaster = draw.surface(builder, "wall");
    let longest = draw.integer(1, 8);
    let mut run: Vec<[i32; 2]> = Vec::new();
    for cell in solid {
        if run.last().is_some_and(|l| [l[0], l[1] + 1] != cell) || run.len() as u32 == longest {
            wall(draw, builder, plan, &run, &plaster);
            run.clear();
        }
        run.push(cell);
    }
    wall(draw, builder, plan, &run, &plaster);
}

/// One block over a run of cells of a row.
fn wall(draw: &mut Draw, builder: &mut Builder, plan: &Plan, run: &[[i32; 2]], plaster: &str) {
    let (Some(first), Some(last)) = (run.first(), run.last()) else { return };
    let material = match draw.range(0.0, 1.0) {
        share if share < 0.7 => plaster.to_owned(),
        share if share < 0.94 => draw.surface(builder, "wall"),
        _ => builder.add_material("mirror", draw.mirror()),
    };
    let [from, to] = [first, last].map(|c| plan.room(IVec2::new(c[1], c[0])));
    builder.add_block("wall", from.low, to.high, &material);
}

/// An alcove: empty, furnished, lit, or lit and behind a door that is ajar.
fn niche(draw: &mut Draw, builder: &mut Builder, plan: &Plan, cell: IVec2, side: IVec2) {
    let room = plan.room(cell);
    let kind = draw.range(0.0, 1.0);
    if kind < 0.35 {
        return furniture::clutter(draw, builder, &room);
    }
    if kind < 0.75 {
        door(draw, builder, &room, direction(side));
    }
    if kind > 0.55 {
        lamp(draw, builder, &room, direction(side));
    }
}

/// Closes a side room towards the corridor but for a doorway with a leaf in it; `into` points into the room.
fn door(draw: &mut Draw, builder: &mut Builder, room: &Room, into: Vec3) {
    let paint = draw.surface(builder, "door frame");
    let extent = room.high - room.low;
    let middle = 0.5 * (room.low + room.high) - into * 0.5 * CELL;
    let across = Vec3::Y.cross(into);
    let (half_width, height, thick) = (CELL * draw.range(0.2, 0.35), extent.y * draw.range(0.6, 0.9), 0.02);
    let foot = middle.with_y(room.low.y);
    // Frames stand a little back from the corridor and beyond the corners, so that no two faces lie in one plane.
    let mut frame = |low: [f32; 2], high: [f32; 2]| {
        let corner = |[a, y]: [f32; 2], depth: f32| foot + across * a + Vec3::Y * y + into * depth;
        let (a, b) = (corner(low, 1e-3), corner(high, 1e-3 + thick));
        builder.add_block("door frame", a.min(b), a.max(b), &paint);
    };
    frame([-0.51 * CELL, -1e-3], [-half_width, extent.y + 1e-3]);
    frame([half_width, -1e-3], [0.51 * CELL, extent.y + 1e-3]);
    frame([-half_width, height], [half_width, extent.y + 1e-3]);
    let turn = Quat::from_mat3(&Mat3::from_cols(across, Vec3::Y, into))
        * Quat::from_rotation_y(-draw.log_range(6.0, 80.0).to_radians());
    let leaf = draw.surface(builder, "door");
    let half = Vec3::new(0.99 * half_width, 0.495 * height, 0.005);
    let hinge = foot - across * half_width + into * (1e-3 + thick) + Vec3::Y * 0.5 * height;
    builder.add_box("door", hinge + turn * Vec3::X * half_width, half, turn, &leaf);
}

/// A panel at the ceiling or at the wall beyond `onwards`, a bulb, or a spot at the wall.
fn lamp(draw: &mut Draw, builder: &mut Builder, room: &Room, onwards: Vec3) {
    let extent = room.high - room.low;
    let center = room.low + extent * draw.point(Vec3::splat(0.3), Vec3::splat(0.8));
    let dark = builder.add_material("lamp", diffuse([0.3; 3]));
    let across = Vec3::Y.cross(onwards);
    let [a, b] = [0, 1].map(|_| draw.log_range(0.01, 0.2));
    match draw.integer(0, 4) {
        0 => {
            let at = Vec3::new(0.5 * (room.low.x + room.high.x), room.high.y - 0.004, 0.5 * (room.low.z + room.high.z));
            builder.add_quad("light", at, [Vec3::X * a, Vec3::Z * b], &dark, Some(draw.emission(4.0 * a * b)));
        }
        1 => {
            let at = (0.5 * (room.low + room.high)).with_y(room.low.y + 0.6 * extent.y) + onwards * 0.49 * CELL;
            let b = b.min(0.35 * extent.y);
            builder.add_quad("light", at, [across * a, Vec3::NEG_Y * b], &dark, Some(draw.emission(4.0 * a * b)));
        }
        2 => {
            let aim = (onwards + 0.7 * draw.direction()).normalize_or(onwards);
            let turn = Quat::from_rotation_arc(Vec3::Z, aim);
            let (cutoff_angle, share) = (draw.log_range(5.0, 50.0), draw.range(0.3, 0.9));
            let intensity = draw.power() / (2.0 * PI * (1.0 - cutoff_angle.to_radians().cos()));
            builder.add_light(LightFile::Spot {
                to_world: matrix(Mat4::from_rotation_translation(turn, center)),
                intensity: draw.tint().map(|c| c * intensity),
                cutoff_angle,
                beam_width: share * cutoff_angle,
            });
        }
        _ => {
            let radius = draw.log_range(0.005, 0.05);
            let emission = draw.emission(4.0 * PI * radius * radius);
            builder.add_sphere("bulb", center, radius, &dark, Some(emission));
        }
    }
}

/// Light that shines in at the open end: the sky, the sun, both, or a panel; `onwards` points outside.
fn outside(draw: &mut Draw, builder: &mut Builder, room: &Room, onwards: Vec3) {
    let kind = draw.integer(0, 3);
    if kind == 0 {
        let dark = builder.add_material("lamp", diffuse([0.3; 3]));
        let at = (0.5 * (room.low + room.high)).with_y(0.5 * room.high.y) + onwards * CELL * draw.range(1.6, 4.0);
        let [a, b] = [draw.log_range(0.1, 0.6), draw.log_range(0.1, 0.5)];
        let emission = draw.emission(4.0 * a * b);
        builder.add_quad("light", at, [Vec3::Y.cross(onwards) * a, Vec3::NEG_Y * b], &dark, Some(emission));
    }
    if kind == 1 || kind == 3 {
        let aside = Vec3::Y.cross(onwards) * draw.range(-0.5, 0.5);
        let direction = (aside - onwards - Vec3::Y * draw.range(0.05, 1.0)).normalize_or(-onwards);
        let irradiance = draw.log_range(3.0, 100.0);
        let irradiance = draw.tint().map(|c| c * irradiance);
        builder.add_light(LightFile::Directional { direction: direction.to_array(), irradiance });
    }
    if kind >= 2 {
        let radiance = draw.log_range(0.3, 10.0);
        builder.add_light(LightFile::Constant { radiance: draw.tint().map(|c| c * radiance) });
    }
}

/// In a run of the corridor, mostly one of the last two, looking towards its end.
fn camera(draw: &mut Draw, builder: &mut Builder, plan: &Plan) {
    let runs = plan.corners.len();
    let run = if draw.chance(0.7) { runs - 1 - (draw.integer(0, 1) as usize).min(runs - 1) } else { 0 };
    let start = if run == 0 { 0 } else { plan.corners[run - 1] };
    let end = plan.corners[run];
    let stand = start + draw.integer(0, (end.saturating_sub(start) / 2) as u32) as usize;
    let within = |index: usize, low: Vec3, high: Vec3| {
        let room = plan.room(plan.path[index]);
        let extent = room.high - room.low;
        [room.low + extent * low, room.low + extent * high]
    };
    let from = within(stand, Vec3::new(0.1, 0.3, 0.1), Vec3::new(0.9, 0.85, 0.9));
    let to = if end > stand {
        within(end, Vec3::new(0.1, 0.1, 0.1), Vec3::new(0.9, 0.8, 0.9))
    } else {
        within(stand.saturating_sub(1), Vec3::ZERO, Vec3::ONE)
    };
    draw.camera(builder, from, to, 0.3);
}
