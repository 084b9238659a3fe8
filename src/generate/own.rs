//! The scenes in `scenes/`, as the code that they were written by. A test keeps the two equal.

use std::f32::consts::FRAC_PI_2;

use glam::{Mat4, Quat, Vec3};

use super::build::{Builder, diffuse, glass, matrix};
use super::revolve::{bowl, ring};
use super::smoke::smoke;
use super::text::{json, obj, rounded};
use super::walls::{Opening, Room, Side};
use crate::base::Result;
use crate::base::random::Random;
use crate::scene::file::{
    Distribution, GridFile, GridMediumFile, LightFile, MaterialFile, MediumFile, MeshFile, SceneFile, TextureFile,
};

const GOLD: [[f32; 3]; 2] = [[0.143, 0.375, 1.442], [3.983, 2.386, 1.603]];
const SPP: u32 = 128;

/// A folder of `scenes/`.
#[derive(Debug, Clone, PartialEq)]
pub struct OwnScene {
    /// Name of the folder.
    pub folder: &'static str,
    /// Name and content of each file in it; the scene is `scene.json`.
    pub files: Vec<(&'static str, Vec<u8>)>,
}

/// All of them.
///
/// # Errors
/// As [`json`].
pub fn all() -> Result<Vec<OwnScene>> {
    let of = |folder, scene: SceneFile, beside: Option<(&'static str, Vec<u8>)>| -> Result<OwnScene> {
        let files = std::iter::once(("scene.json", json(&tidy(scene))?.into_bytes())).chain(beside).collect();
        Ok(OwnScene { folder, files })
    };
    let with = |folder, builder: Builder, mesh: Option<(&'static str, String)>| {
        of(folder, builder.finish(), mesh.map(|(name, text)| (name, text.into_bytes())))
    };
    Ok(vec![
        with("blinds", blinds(), None)?,
        with("cornell", cornell(), None)?,
        with("door-ajar", door_ajar(), None)?,
        with("glass-caustic", glass_caustic(), Some(("ring.obj", obj(&ring(1.0, 0.05, 0.22)))))?,
        with("lamp-room", lamp_room(), Some(("shade.obj", obj(&bowl(1.0, 0.04, FRAC_PI_2 * 0.8)))))?,
        with("pinhole", pinhole(), None)?,
        of("smoke", smoky_room(), Some(("smoke.vol", smoke().encode())))?,
        with("spot", spot(), None)?,
        with("starfield", starfield(), None)?,
        with("white-furnace", white_furnace(), None)?,
    ])
}

/// Rounds all matrices.
fn tidy(mut scene: SceneFile) -> SceneFile {
    scene.camera.to_world = scene.camera.to_world.map(rounded);
    scene.shapes.iter_mut().for_each(|s| s.to_world = s.to_world.map(rounded));
    scene
}

/// A mesh file beside the scene.
fn file(name: &str) -> MeshFile {
    MeshFile::Obj { file: name.into(), face_normals: false, flip_v: false, materials: Vec::new() }
}

fn gold(alpha: Option<f32>) -> MaterialFile {
    let [eta, k] = GOLD;
    let specular_reflectance = TextureFile::rgb([1.0; 3]);
    match alpha {
        None => MaterialFile::Conductor { eta, k, specular_reflectance },
        Some(alpha) => {
            MaterialFile::RoughConductor { alpha, distribution: Distribution::Ggx, eta, k, specular_reflectance }
        }
    }
}

/// A diffuse box, 2 m wide, with two blocks under a square lamp.
fn cornell() -> Builder {
    let mut b = Builder::new("cornell", [256, 256]);
    b.render(12, SPP);
    let white = cornell_box(&mut b);
    b.add_quad("ceiling", Vec3::Y * 2.0, [Vec3::X, Vec3::Z], &white, None);
    b.add_quad("lamp", Vec3::new(0.0, 1.99, 0.0), [Vec3::X * 0.25, Vec3::Z * 0.25], &white, Some([17.0, 13.0, 7.5]));
    b
}

/// The box under a spotlight that shines at the ceiling from 10 cm below, in a cone of 1 degree: all light comes from a disk of
/// 3.5 mm (after Zhu 2021, figure 3).
fn spot() -> Builder {
    let mut b = Builder::new("spot", [192, 192]);
    b.render(12, SPP);
    let white = cornell_box(&mut b);
    b.add_quad("ceiling", Vec3::Y * 2.0, [Vec3::X, Vec3::Z], &white, None);
    let to_world = Mat4::from_rotation_translation(Quat::from_rotation_x(-FRAC_PI_2), Vec3::new(0.1, 1.9, 0.1));
    b.add_light(LightFile::Spot {
        to_world: matrix(to_world),
        intensity: [38_000.0, 34_000.0, 28_000.0],
        cutoff_angle: 1.0,
        beam_width: 0.8,
    });
    b
}

/// The box under the sun, which finds a hole of 3 cm in the roof (after Zhu 2021, figure 3).
fn pinhole() -> Builder {
    let mut b = Builder::new("pinhole", [192, 192]);
    b.render(12, SPP);
    let white = cornell_box(&mut b);
    let (from, to) = (Vec3::new(0.085, 2.0, -0.115), Vec3::new(0.115, 2.1, -0.085));
    for (low, high) in [
        (Vec3::new(-1.1, 2.0, -1.1), Vec3::new(from.x, 2.1, 1.0)),
        (Vec3::new(to.x, 2.0, -1.1), Vec3::new(1.1, 2.1, 1.0)),
        (Vec3::new(from.x, 2.0, -1.1), Vec3::new(to.x, 2.1, from.z)),
        (Vec3::new(from.x, 2.0, to.z), Vec3::new(to.x, 2.1, 1.0)),
    ] {
        b.add_block("roof", low, high, &white);
    }
    b.add_light(LightFile::Directional { direction: [0.06, -1.0, 0.05], irradiance: [36_000.0, 33_000.0, 28_000.0] });
    b
}

/// A room behind a wooden blind: the light of a bright sky enters through slits of 1 cm.
fn blinds() -> Builder {
    let mut b = Builder::new("blinds", [256, 192]);
    b.render(16, SPP);
    let room = Room { low: Vec3::ZERO, high: Vec3::new(4.0, 2.5, 3.6), wall: 0.1 };
    let wall = b.add_material("wall", diffuse([0.68, 0.66, 0.62]));
    let floor = b.add_material("floor", diffuse([0.35, 0.25, 0.18]));
    room.add_floor_and_ceiling(&mut b, &floor, &wall);
    for side in [Side::West, Side::North, Side::South] {
        room.add_wall(&mut b, side, &[], &wall);
    }
    room.add_wall(&mut b, Side::East, &[Opening { low: [1.0, 0.9], high: [2.6, 2.1] }], &wall);
    let wood = b.add_material("wood", diffuse([0.4, 0.25, 0.14]));
    for slat in 0..10 {
        let low = 0.9 + 0.12 * slat as f32;
        b.add_block("slat", Vec3::new(4.04, low + 0.01, 0.95), Vec3::new(4.06, low + 0.12, 2.65), &wood);
    }
    set_table(&mut b, &wood);
    b.add_light(LightFile::Constant { radiance: [55.0, 70.0, 95.0] });
    b.look_at(Vec3::new(0.4, 1.6, 3.2), Vec3::new(2.4, 0.8, 1.4), Vec3::Y, 60.0);
    b
}

/// A room full of drifting smoke, which the sun shines into through a window: its beam is seen, and what it meets lights the rest.
fn smoky_room() -> SceneFile {
    let mut b = Builder::new("smoke", [256, 192]);
    b.render(24, SPP);
    let room = Room { low: Vec3::ZERO, high: Vec3::new(4.0, 2.4, 3.6), wall: 0.1 };
    let wall = b.add_material("wall", diffuse([0.62, 0.58, 0.52]));
    let floor = b.add_material("floor", diffuse([0.35, 0.25, 0.18]));
    room.add_floor_and_ceiling(&mut b, &floor, &wall);
    for side in [Side::West, Side::North, Side::South] {
        room.add_wall(&mut b, side, &[], &wall);
    }
    let panes = [1.05, 1.75].map(|from| Opening { low: [from, 1.0], high: [from + 0.55, 2.1] });
    room.add_wall(&mut b, Side::East, &panes, &wall);
    let wood = b.add_material("wood", diffuse([0.4, 0.25, 0.14]));
    set_table(&mut b, &wood);
    b.add_light(LightFile::Directional { direction: [-1.0, -0.62, -0.12], irradiance: [90.0, 82.0, 70.0] });
    b.add_light(LightFile::Constant { radiance: [3.0, 4.0, 5.5] });
    b.look_at(Vec3::new(0.35, 1.5, 3.3), Vec3::new(2.5, 1.0, 1.3), Vec3::Y, 62.0);
    let mut scene = b.finish();
    let density = GridFile::Vol {
        file: "smoke.vol".into(),
        to_world: matrix(Mat4::from_scale(room.high)),
        own_box: false,
        centred: false,
    };
    let smoke = GridMediumFile {
        density,
        sigma_t: [1.1; 3],
        albedo: [0.92, 0.92, 0.93],
        albedo_grid: None,
        g: 0.5,
        emission: [0.0; 3],
        emission_grid: None,
    };
    scene.media.insert("smoke".into(), MediumFile::Grid(Box::new(smoke)));
    scene.camera.medium = Some("smoke".into());
    scene
}

/// The walls, the floor, two blocks and the camera of the box; returns its white material.
fn cornell_box(b: &mut Builder) -> String {
    let white = b.add_material("white", diffuse([0.72, 0.7, 0.66]));
    let red = b.add_material("red", diffuse([0.6, 0.07, 0.05]));
    let green = b.add_material("green", diffuse([0.12, 0.45, 0.1]));
    b.add_quad("floor", Vec3::ZERO, [Vec3::Z, Vec3::X], &white, None);
    b.add_quad("back", Vec3::new(0.0, 1.0, -1.0), [Vec3::X, Vec3::Y], &white, None);
    b.add_quad("left", Vec3::new(-1.0, 1.0, 0.0), [Vec3::Y, Vec3::Z], &red, None);
    b.add_quad("right", Vec3::new(1.0, 1.0, 0.0), [Vec3::Z, Vec3::Y], &green, None);
    let tall = Quat::from_rotation_y(0.3);
    b.add_box("tall block", Vec3::new(-0.36, 0.601, -0.32), Vec3::new(0.28, 0.6, 0.28), tall, &white);
    let low = Quat::from_rotation_y(-0.28);
    b.add_box("low block", Vec3::new(0.38, 0.281, 0.32), Vec3::new(0.28, 0.28, 0.28), low, &white);
    b.look_at(Vec3::new(0.0, 1.0, 4.8), Vec3::new(0.0, 1.0, 0.0), Vec3::Y, 30.0);
    white
}

/// Two rooms. The lamp stands in the far one and shines at its far wall; the near one gets only what comes back through a door
/// that is 15 degrees ajar (after a scene in Veach 1997).
fn door_ajar() -> Builder {
    let mut b = Builder::new("door-ajar", [256, 192]);
    b.render(20, SPP);
    let near = Room { low: Vec3::ZERO, high: Vec3::new(3.0, 2.6, 4.0), wall: 0.1 };
    let far = Room { low: Vec3::new(3.1, 0.0, 0.0), high: Vec3::new(6.1, 2.6, 4.0), wall: 0.1 };
    let plaster = b.add_material("plaster", diffuse([0.7, 0.68, 0.63]));
    let blue = b.add_material("blue plaster", diffuse([0.35, 0.45, 0.6]));
    let floor = b.add_material("floor", diffuse([0.45, 0.33, 0.22]));
    let wood = b.add_material("wood", diffuse([0.5, 0.3, 0.16]));
    Room { high: far.high, ..near }.add_floor_and_ceiling(&mut b, &floor, &plaster);
    let door = Opening { low: [1.4, 0.0], high: [2.3, 2.05] };
    near.add_wall(&mut b, Side::East, &[door], &plaster);
    for (side, paint) in [(Side::West, &blue), (Side::North, &plaster), (Side::South, &plaster)] {
        near.add_wall(&mut b, side, &[], paint);
    }
    for side in [Side::East, Side::North, Side::South] {
        far.add_wall(&mut b, side, &[], &plaster);
    }
    // Hinged at the jamb next to the camera, so that the light falls on what the camera sees.
    let turn = Quat::from_rotation_y(15f32.to_radians());
    let hinge = Vec3::new(3.03, 1.025, 2.3);
    b.add_box("door", hinge - turn * Vec3::Z * 0.45, Vec3::new(0.02, 1.02, 0.45), turn, &wood);
    let lamp = b.add_material("lamp", diffuse([0.2; 3]));
    b.add_quad("lamp", Vec3::new(4.4, 1.3, 2.6), [Vec3::Y * 0.4, Vec3::Z * 0.4], &lamp, Some([5000.0, 4400.0, 3500.0]));
    set_table(&mut b, &wood);
    b.look_at(Vec3::new(0.4, 1.6, 3.7), Vec3::new(2.5, 0.8, 1.6), Vec3::Y, 58.0);
    b
}

/// A table with a jug of blocks, a ball of rough gold and one of glass.
fn set_table(b: &mut Builder, wood: &str) {
    b.add_block("table", Vec3::new(1.4, 0.72, 1.5), Vec3::new(2.3, 0.76, 2.5), wood);
    for (x, z) in [(1.45, 1.55), (2.2, 1.55), (1.45, 2.4), (2.2, 2.4)] {
        b.add_block("leg", Vec3::new(x, 0.001, z), Vec3::new(x + 0.05, 0.72, z + 0.05), wood);
    }
    let red = b.add_material("red", diffuse([0.65, 0.12, 0.1]));
    let white = b.add_material("white", diffuse([0.8, 0.8, 0.78]));
    b.add_box("box", Vec3::new(1.65, 0.841, 1.75), Vec3::new(0.1, 0.08, 0.13), Quat::from_rotation_y(0.5), &red);
    b.add_box("bottle", Vec3::new(1.98, 0.921, 1.65), Vec3::new(0.05, 0.16, 0.05), Quat::from_rotation_y(0.2), &white);
    let metal = b.add_material("rough gold", gold(Some(0.2)));
    b.add_sphere("gold ball", Vec3::new(2.08, 0.871, 1.98), 0.11, &metal, None);
    let clear = b.add_material("glass", glass(1.5));
    b.add_sphere("glass ball", Vec3::new(1.72, 0.861, 2.15), 0.1, &clear, None);
}

/// A glass ball and a gold ring on the floor of a box without front and lid, near a lamp of 8 cm.
fn glass_caustic() -> Builder {
    let mut b = Builder::new("glass-caustic", [256, 192]);
    b.render(16, SPP);
    let white = b.add_material("white", diffuse([0.75, 0.74, 0.7]));
    let green = b.add_material("green", diffuse([0.2, 0.45, 0.3]));
    b.add_quad("floor", Vec3::ZERO, [Vec3::Z * 1.2, Vec3::X * 1.2], &white, None);
    b.add_quad("back", Vec3::new(0.0, 0.7, -1.2), [Vec3::X * 1.2, Vec3::Y * 0.7], &white, None);
    b.add_quad("left", Vec3::new(-1.2, 0.7, 0.0), [Vec3::Y * 0.7, Vec3::Z * 1.2], &green, None);
    b.add_quad("right", Vec3::new(1.2, 0.7, 0.0), [Vec3::Z * 1.2, Vec3::Y * 0.7], &white, None);
    let clear = b.add_material("glass", glass(1.5));
    b.add_sphere("glass ball", Vec3::new(-0.32, 0.301, -0.1), 0.3, &clear, None);
    let smooth = b.add_material("gold", gold(None));
    let place = Mat4::from_scale_rotation_translation(Vec3::splat(0.34), Quat::IDENTITY, Vec3::new(0.45, 0.076, 0.3));
    b.add_mesh("ring", file("ring.obj"), place, (Vec3::ZERO, 1.05), &smooth);
    let turn = Quat::from_rotation_arc(Vec3::Z, Vec3::new(0.6, -1.2, 0.4).normalize());
    let half = [turn * Vec3::X * 0.04, turn * Vec3::Y * 0.04];
    let lamp = b.add_material("lamp", diffuse([0.2; 3]));
    b.add_quad("lamp", Vec3::new(-0.6, 1.3, -0.35), half, &lamp, Some([420.0, 390.0, 330.0]));
    b.look_at(Vec3::new(0.25, 1.35, 2.4), Vec3::new(0.05, 0.15, 0.05), Vec3::Y, 46.0);
    b
}

/// A room whose only lamp stands in an opaque shade that opens upwards.
fn lamp_room() -> Builder {
    let mut b = Builder::new("lamp-room", [256, 192]);
    b.render(16, SPP);
    let room = Room { low: Vec3::ZERO, high: Vec3::new(4.0, 2.5, 3.6), wall: 0.1 };
    let wall = b.add_material("wall", diffuse([0.66, 0.6, 0.5]));
    let ceiling = b.add_material("ceiling", diffuse([0.82, 0.82, 0.8]));
    let floor = b.add_material("floor", diffuse([0.3, 0.22, 0.17]));
    room.add_floor_and_ceiling(&mut b, &floor, &ceiling);
    for side in Side::ALL {
        room.add_wall(&mut b, side, &[], &wall);
    }
    let cloth = b.add_material("cloth", diffuse([0.16, 0.25, 0.4]));
    b.add_block("seat", Vec3::new(0.9, 0.05, 0.15), Vec3::new(2.7, 0.42, 0.95), &cloth);
    b.add_block("back rest", Vec3::new(0.9, 0.42, 0.15), Vec3::new(2.7, 0.85, 0.35), &cloth);
    let wood = b.add_material("wood", diffuse([0.42, 0.26, 0.13]));
    b.add_block("low table", Vec3::new(1.3, 0.36, 1.5), Vec3::new(2.3, 0.4, 2.1), &wood);
    b.add_block("foot", Vec3::new(1.7, 0.001, 1.7), Vec3::new(1.9, 0.36, 1.9), &wood);
    let metal = b.add_material("rough gold", gold(Some(0.15)));
    b.add_sphere("gold ball", Vec3::new(1.95, 0.521, 1.8), 0.12, &metal, None);
    b.add_block("pole", Vec3::new(3.19, 0.001, 0.49), Vec3::new(3.21, 1.4, 0.51), &metal);
    let shade = b.add_material("shade", diffuse([0.55, 0.5, 0.42]));
    let place = Mat4::from_scale_rotation_translation(Vec3::splat(0.2), Quat::IDENTITY, Vec3::new(3.2, 1.6, 0.5));
    b.add_mesh("shade", file("shade.obj"), place, (Vec3::ZERO, 1.0), &shade);
    b.add_sphere("bulb", Vec3::new(3.2, 1.58, 0.5), 0.04, &wall, Some([900.0, 760.0, 520.0]));
    b.look_at(Vec3::new(0.5, 1.45, 3.3), Vec3::new(2.3, 0.85, 0.7), Vec3::Y, 62.0);
    b
}

/// Balls and a wall under four hundred points of light from bright to faint, some close to what they shine on: light that no ray
/// can hit, and unlike any that the shipped network was trained with.
fn starfield() -> Builder {
    let mut b = Builder::new("starfield", [192, 144]);
    b.render(12, SPP);
    let ground = b.add_material("ground", diffuse([0.45, 0.42, 0.4]));
    let wall = b.add_material("wall", diffuse([0.6, 0.6, 0.62]));
    let metal = b.add_material("rough gold", gold(Some(0.2)));
    b.add_quad("ground", Vec3::ZERO, [Vec3::Z * 8.0, Vec3::X * 8.0], &ground, None);
    b.add_block("wall", Vec3::new(-3.0, 0.0, -2.2), Vec3::new(3.0, 2.2, -2.0), &wall);
    b.add_sphere("gold ball", Vec3::new(-1.1, 0.7, -0.3), 0.7, &metal, None);
    b.add_sphere("grey ball", Vec3::new(0.9, 0.5, 0.2), 0.5, &wall, None);
    let mut random = Random::new(11, 0, 0);
    for _ in 0..400 {
        let position = [random.range(-5.0, 5.0), random.range(0.05, 4.0), random.range(-4.0, 4.0)];
        // Magnitudes: most are faint, a few outshine hundreds.
        let intensity = 0.015 / random.range(0.002, 1.0f32);
        let warmth = random.range(-0.3, 0.3f32);
        b.add_light(LightFile::Point { position, intensity: [1.0 + warmth, 1.0, 1.0 - warmth].map(|c| c * intensity) });
    }
    b.look_at(Vec3::new(0.4, 1.8, 5.6), Vec3::new(0.0, 0.8, 0.0), Vec3::Y, 46.0);
    b
}

/// A ball of albedo 0.8 under a sky of radiance 1: its own radiance must be 0.8, everywhere else 1.
fn white_furnace() -> Builder {
    let mut b = Builder::new("white-furnace", [64, 64]);
    b.render(20, SPP);
    let grey = b.add_material("grey", MaterialFile::Diffuse { reflectance: TextureFile::rgb([0.8; 3]) });
    b.add_sphere("ball", Vec3::ZERO, 1.0, &grey, None);
    b.add_light(LightFile::Constant { radiance: [1.0; 3] });
    b.look_at(Vec3::Z * 4.0, Vec3::ZERO, Vec3::Y, 40.0);
    b
}
