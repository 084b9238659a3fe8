//! Leaves: crowns of trees, hedges, grass and potted plants, as meshes of small loose faces.

use glam::{Mat4, Vec3};

use super::build::{Builder, diffuse};
use super::draw::Draw;
use crate::scene::file::{MaterialFile, MeshFile, TextureFile};

/// Radius around a crown's mesh.
const CROWN_RADIUS: f32 = 1.25;

/// A kind of plant: the mesh of its leaves and their material.
#[derive(Debug, Clone)]
pub struct Kind {
    mesh: String,
    leaf: String,
}

/// Loose faces: triangles, or squares of two.
#[derive(Debug, Default)]
struct Leaves {
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl Leaves {
    fn add(&mut self, corners: &[Vec3]) {
        let first = self.positions.len() as u32;
        self.positions.extend(corners.iter().map(|c| c.to_array()));
        self.triangles.extend((2..corners.len() as u32).map(|i| [first, first + i - 1, first + i]));
    }

    fn finish(self) -> MeshFile {
        MeshFile::Inline { positions: self.positions, normals: Vec::new(), uvs: Vec::new(), triangles: self.triangles }
    }
}

/// Leaves at random in a ball of radius 1, turned at random, mostly near its surface.
fn crown(draw: &mut Draw) -> MeshFile {
    let count = draw.log_range(40.0, 400.0);
    // The leaves of all crowns cover about as much of what is behind them.
    let size = (draw.range(0.6, 2.0) / count).sqrt().min(0.16);
    let long = draw.range(1.0, 1.2);
    let (square, hollow) = (draw.chance(0.5), draw.range(0.0, 0.6));
    let mut leaves = Leaves::default();
    for _ in 0..count as u32 {
        let center = draw.direction() * draw.range(hollow, 1.0).cbrt();
        let turn = draw.rotation();
        let [u, v] = [turn * Vec3::X * size, turn * Vec3::Y * size * long];
        if square {
            leaves.add(&[center - u - v, center + u - v, center + u + v, center - u + v]);
        } else {
            leaves.add(&[center - u, center + u, center + v]);
        }
    }
    leaves.finish()
}

/// Blades that stand on the square [-1, 1]² in y = 0, at most 0.3 high.
fn lawn(draw: &mut Draw) -> MeshFile {
    let mut leaves = Leaves::default();
    let (width, height) = (draw.range(0.01, 0.03), draw.range(0.08, 0.3));
    for _ in 0..draw.log_range(60.0, 500.0) as u32 {
        let foot = Vec3::new(draw.range(-1.0, 1.0), 0.0, draw.range(-1.0, 1.0));
        let aside = draw.yaw() * Vec3::X;
        let tip = foot + Vec3::new(draw.range(-0.5, 0.5), 1.0, draw.range(-0.5, 0.5)) * height * draw.range(0.4, 0.85);
        leaves.add(&[foot - aside * width, foot + aside * width, tip]);
    }
    leaves.finish()
}

/// Green, or any colour: opaque, with some light let straight through as by small gaps, or shiny.
fn leaf(draw: &mut Draw, builder: &mut Builder) -> String {
    let green = |draw: &mut Draw| [draw.range(0.05, 0.4), draw.range(0.2, 0.6), draw.range(0.03, 0.2)];
    let color = if draw.chance(0.7) { green(draw) } else { draw.albedo() };
    let matte = diffuse(color);
    let material = match draw.range(0.0, 1.0) {
        share if share < 0.6 => matte,
        share if share < 0.75 => {
            let opacity = TextureFile::rgb([draw.range(0.4, 0.9); 3]);
            MaterialFile::Mask { opacity, material: Box::new(matte) }
        }
        share if share < 0.88 => {
            let pane = MaterialFile::ThinDielectric { int_ior: draw.range(1.2, 1.6), ext_ior: 1.0 };
            let weight = TextureFile::rgb([draw.range(0.1, 0.6); 3]);
            MaterialFile::Blend { weight, materials: Box::new([matte, pane]) }
        }
        _ => draw.plastic(0.0),
    };
    builder.add_material("leaf", material)
}

/// A new kind of plant.
pub fn kind(draw: &mut Draw, builder: &mut Builder) -> Kind {
    let mesh = crown(draw);
    Kind { mesh: builder.define_mesh("crown", mesh), leaf: leaf(draw, builder) }
}

/// A tree of `height` on a trunk, or a bush that stands on the ground.
pub fn plant(draw: &mut Draw, builder: &mut Builder, kind: &Kind, foot: Vec3, height: f32) {
    let trunk = if draw.chance(0.6) { draw.range(0.2, 0.6) * height } else { 0.0 };
    let radius = 0.5 * (height - trunk) / CROWN_RADIUS;
    if trunk > 0.0 {
        let bark = builder.add_material("bark", draw.diffuse());
        let half = Vec3::new(0.025 * height, 0.5 * trunk + 0.3 * radius, 0.025 * height);
        let center = foot + Vec3::Y * (half.y - 0.01 * height);
        builder.add_box("trunk", center, half, draw.yaw(), &bark);
    }
    let center = foot + Vec3::Y * (trunk + radius * CROWN_RADIUS);
    let to_world = Mat4::from_scale_rotation_translation(Vec3::splat(radius), draw.rotation(), center);
    builder.add_instance("crown", &kind.mesh, to_world, (Vec3::ZERO, CROWN_RADIUS), &kind.leaf);
}

/// A plant in a pot, for rooms whose shortest side is `unit`.
pub fn potted(draw: &mut Draw, builder: &mut Builder, foot: Vec3, unit: f32) {
    let kind = kind(draw, builder);
    let pot = draw.clutter(builder, false);
    let half = Vec3::new(1.0, draw.range(0.7, 1.3), 1.0) * unit * draw.range(0.03, 0.06);
    builder.add_box("pot", foot + Vec3::Y * half.y, half, draw.yaw(), &pot);
    let height = unit * draw.range(0.15, 0.5);
    plant(draw, builder, &kind, foot + Vec3::Y * 2.0 * half.y, height);
}

/// Grass around `center` on the ground, in squares of half the edge `half`.
pub fn grass(draw: &mut Draw, builder: &mut Builder, center: Vec3, half: f32) {
    let (mesh, leaf) = (lawn(draw), leaf(draw, builder));
    let key = builder.define_mesh("lawn", mesh);
    for _ in 0..draw.integer(1, 6) {
        let away = Vec3::new(draw.range(-2.0, 2.0), 0.0, draw.range(-2.0, 2.0)) * half;
        let to_world = Mat4::from_scale_rotation_translation(Vec3::splat(half), draw.yaw(), center + away);
        // Blades are no obstacle to a camera above them; the ball stands for the lowest part.
        builder.add_instance("lawn", &key, to_world, (Vec3::ZERO, 0.1), &leaf);
    }
}
