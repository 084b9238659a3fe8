//! Family `glazed`: things within blocks, cases and jars of glass, by daylight or lamplight, and lamps within globes. What is lit there is lit
//! through smooth surfaces, where no light can be sampled: only paths that happen to find a lamp know of it, and its peaks are as narrow
//! as the lamp looks.

use std::f32::consts::{FRAC_PI_2, PI};

use glam::{Mat4, Quat, Vec3};

use super::build::{Builder, diffuse};
use super::caustics::surroundings;
use super::draw::Draw;
use super::revolve::{bowl, inline, ring};
use super::windows;
use crate::scene::file::MaterialFile;

/// Gap between things that stand on each other, so that no two faces lie in one plane.
const GAP: f32 = 1e-3;

/// Builds the scene; what there is to see stands within 0.7 of the origin before it is scattered.
pub fn build(draw: &mut Draw, builder: &mut Builder) {
    let walls = draw.integer(0, 5);
    let height = draw.log_range(0.8, 2.0);
    surroundings(draw, builder, walls, height);
    let by_day = walls < 5 && draw.chance(0.6);
    let in_globes = !by_day && draw.chance(0.6);
    for _ in 0..draw.integer(1, 5) {
        let size = draw.log_range(0.06, 0.35).min(0.2 * height);
        if let Some(foot) = place(draw, builder, size) {
            let in_glass = !in_globes || draw.chance(0.5);
            stand(draw, builder, foot, size, in_glass);
        }
    }
    if by_day {
        let elevation = draw.range(8.0, 80.0).to_radians();
        let towards = draw.yaw() * Vec3::new(elevation.cos(), elevation.sin(), 0.0);
        windows::sky_and_sun(draw, builder, towards);
    } else {
        for number in 0..draw.integer(1, 3) {
            let in_globe = in_globes && (number == 0 || draw.chance(0.7));
            lamp(draw, builder, height, in_globe);
        }
    }
    let reach = if walls == 0 { 1.6 } else { 0.92 };
    let (low, high) = (Vec3::new(-reach, 0.05, -reach), Vec3::new(reach, 0.92 * height, reach));
    draw.camera(builder, [low, high], [Vec3::new(-0.4, 0.0, -0.4), Vec3::new(0.4, 0.4, 0.4)], 0.3);
}

/// A free place on the floor for something within `size` of an axis and twice as high; none if there is none.
fn place(draw: &mut Draw, builder: &Builder, size: f32) -> Option<Vec3> {
    let mut tries = (0..30).map(|_| Vec3::new(draw.range(-0.6, 0.6), 0.0, draw.range(-0.6, 0.6)));
    // The floor is a solid, too: asked for is the room around a point so high that it does not count.
    tries.find(|foot| builder.solids().distance(*foot + Vec3::Y * 1.6 * size) > 1.5 * size)
}

/// Something that stands on the floor, within `size` of the axis above `foot`: bare, or in glass.
fn stand(draw: &mut Draw, builder: &mut Builder, foot: Vec3, size: f32, in_glass: bool) {
    if !in_glass {
        return thing(draw, builder, foot + Vec3::Y * GAP, size);
    }
    match draw.range(0.0, 1.0) {
        share if share < 0.35 => block(draw, builder, foot, size),
        share if share < 0.65 => case(draw, builder, foot, size),
        _ => jar(draw, builder, foot, size),
    }
}

/// A ball, a block, a ring or a heap of balls, all within `size` of the axis and 2 · `size` above `foot`.
fn thing(draw: &mut Draw, builder: &mut Builder, foot: Vec3, size: f32) {
    // Glass within glass would hide what is in it; now and then it may.
    let closed = draw.chance(0.2);
    let material = draw.clutter(builder, closed);
    match draw.integer(0, 3) {
        0 => builder.add_sphere("ball", foot + Vec3::Y * size, size, &material, None),
        1 => {
            let half = size * 0.65 * Vec3::new(1.0, draw.range(0.3, 1.5), draw.range(0.3, 1.0));
            builder.add_box("box", foot + Vec3::Y * half.y, half, draw.yaw(), &material);
        }
        2 => {
            let (across, tall) = (draw.log_range(0.1, 0.4), draw.log_range(0.1, 0.5));
            let scale = size / (1.0 + across).hypot(tall);
            let turn = if draw.chance(0.5) { draw.rotation() } else { Quat::IDENTITY };
            let to_world = Mat4::from_scale_rotation_translation(Vec3::splat(scale), turn, foot + Vec3::Y * size);
            builder.add_mesh("ring", inline(&ring(1.0, across, tall)), to_world, (Vec3::ZERO, size / scale), &material);
        }
        _ => {
            let radius = 0.24 * size;
            for level in 0..draw.integer(2, 4) {
                let turn = draw.yaw();
                let center = foot + turn * Vec3::X * 0.5 * size + Vec3::Y * radius * (1.0 + 2.02 * level as f32);
                builder.add_sphere("ball", center, radius, &material, None);
            }
        }
    }
}

/// The material of a pane with air on both sides: clear glass, now and then ground.
fn clear(draw: &mut Draw) -> MaterialFile {
    if draw.chance(0.85) { draw.glass() } else { draw.rough_glass() }
}

/// The same material for a surface behind which there is air again, as that of a hollow within it.
fn hollow(outside: &MaterialFile) -> MaterialFile {
    match outside {
        MaterialFile::Dielectric { int_ior, ext_ior } => {
            MaterialFile::Dielectric { int_ior: *ext_ior, ext_ior: *int_ior }
        }
        MaterialFile::RoughDielectric { alpha, distribution, int_ior, ext_ior } => MaterialFile::RoughDielectric {
            alpha: *alpha,
            distribution: *distribution,
            int_ior: *ext_ior,
            ext_ior: *int_ior,
        },
        other => other.clone(),
    }
}

/// A solid block with the thing cast into it.
fn block(draw: &mut Draw, builder: &mut Builder, foot: Vec3, size: f32) {
    let glass = clear(draw);
    let glass = builder.add_material("glass", glass);
    let inner = size * draw.range(0.5, 0.65);
    let up = Vec3::Y * (size + GAP);
    builder.add_box("block", foot + up, Vec3::splat(size), draw.yaw(), &glass);
    thing(draw, builder, foot + up - Vec3::Y * inner, inner);
}

/// A box of panes, thick or thin, with the thing in it.
fn case(draw: &mut Draw, builder: &mut Builder, foot: Vec3, size: f32) {
    let thick = size * draw.log_range(0.01, 0.1);
    let half = Vec3::new(size, size * draw.range(0.8, 1.3), size);
    let (center, turn) = (foot + Vec3::Y * (half.y + GAP), draw.yaw());
    if draw.chance(0.2) {
        let pane =
            builder.add_material("pane", MaterialFile::ThinDielectric { int_ior: draw.range(1.3, 1.8), ext_ior: 1.0 });
        builder.add_box("case", center, half, turn, &pane);
    } else {
        let glass = clear(draw);
        let inside = builder.add_material("inner glass", hollow(&glass));
        let glass = builder.add_material("glass", glass);
        builder.add_box("case", center, half, turn, &glass);
        builder.add_box("hollow", center, half - thick, turn, &inside);
    }
    let inner = size * draw.range(0.4, 0.6);
    thing(draw, builder, center - Vec3::Y * (half.y - thick - GAP), inner);
}

/// A bell of glass over the thing, or a tube around it.
fn jar(draw: &mut Draw, builder: &mut Builder, foot: Vec3, size: f32) {
    let glass = clear(draw);
    let glass = builder.add_material("glass", glass);
    let thick = draw.log_range(0.02, 0.12);
    let bell = draw.chance(0.5);
    let (mesh, reach) = if bell {
        (bowl(1.0, thick, FRAC_PI_2 * draw.range(1.0, 1.3)), 1.0)
    } else {
        let tall = draw.range(0.6, 1.5);
        (ring(1.0 - thick, thick, tall), 1f32.hypot(tall))
    };
    // A bell stands on its opening, upside down.
    let (turn, down) = if bell { (Quat::from_rotation_x(PI), 1.0) } else { (Quat::IDENTITY, -1.0) };
    let low = mesh.positions.iter().map(|p| down * p.y).fold(0.0, f32::max);
    let to_world = Mat4::from_scale_rotation_translation(Vec3::splat(size), turn, foot + Vec3::Y * (size * low + GAP));
    builder.add_mesh("jar", inline(&mesh), to_world, (Vec3::ZERO, reach), &glass);
    let inner = size * draw.range(0.3, 0.45);
    thing(draw, builder, foot + Vec3::Y * GAP, inner);
}

/// A bulb above the things, in a globe of glass if it is `in_globe`: solid, or hollow.
fn lamp(draw: &mut Draw, builder: &mut Builder, height: f32, in_globe: bool) {
    let radius = draw.log_range(0.008, 0.06);
    let globe = radius * draw.range(1.3, 4.0);
    let reach = if in_globe { globe } else { radius };
    let mut center = Vec3::Y * 0.85 * height;
    for _ in 0..100 {
        let spot = Vec3::new(draw.range(-0.8, 0.8), draw.range(0.2, 0.92) * height, draw.range(-0.8, 0.8));
        if builder.solids().distance(spot) > 1.1 * reach {
            center = spot;
            break;
        }
    }
    let dark = builder.add_material("lamp", diffuse([0.3; 3]));
    let emission = draw.emission(4.0 * PI * radius * radius);
    builder.add_sphere("bulb", center, radius, &dark, Some(emission));
    if !in_globe {
        return;
    }
    let glass = clear(draw);
    if draw.chance(0.6) {
        let inside = builder.add_material("inner glass", hollow(&glass));
        builder.add_sphere("hollow", center, globe * draw.range(0.85, 0.97), &inside, None);
    }
    let glass = builder.add_material("glass", glass);
    builder.add_sphere("globe", center, globe, &glass, None);
}
