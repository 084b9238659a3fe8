//! Hard cases that show best in a picture or along a ray: sizes and places, rays that leave a surface, broken shapes, suns,
//! materials and media at their limits, a wrong network. What the names mean is said in hard_trees.rs.

use crate::support::scenes;

use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use fanal::base::progress::Silent;
use fanal::base::random::Random;
use fanal::base::{Error, Result};
use fanal::generate::build::{Builder, diffuse, matrix};
use fanal::geometry::accel::SELDOM_SHARED;
use fanal::geometry::mesh::Mesh;
use fanal::geometry::{Accel, Geometry, Ray, Shape, Surface};
use fanal::guiding::tree::CountedTree;
use fanal::guiding::tree::distribution::Distribution as Directions;
use fanal::guiding::tree::proposal::Proposal;
use fanal::integrators::Roulette;
use fanal::lights::seen::LightView;
use fanal::materials::{Kind, Material, Transport};
use fanal::reconstruct::{AsCounted, Reconstructor};
use fanal::render::{GuideMode, Outcome, RenderSettings, render};
use fanal::sampling::warp;
use fanal::scene::Scene;
use fanal::scene::file::{
    Distribution, GeometryFile, LightFile, MaterialFile, MediumFile, MeshFile, SceneFile, ShapeFile, TextureFile,
};
use fanal::scene::readers::{resolve, save};
use glam::{Affine3A, Mat4, Quat, Vec2, Vec3};
use scenes::{GUIDES, built, committed, floor, mean, one_sided, picture, reconstructor, settings};

/// One, two and three samples per pixel, in every mode: voxels with a sample or none, passes with an empty half, a picture that is
/// all that was learned from. Nothing may be divided by a count that is zero.
#[test]
fn a04_few_samples_give_a_picture() {
    let scene = committed("door-ajar", [5, 3]);
    for (guide, spp) in GUIDES.into_iter().flat_map(|guide| [1, 2, 3].map(|spp| (guide, spp))) {
        let image = picture(&scene, &settings(guide, spp, 1));
        assert!(image.pixels.iter().all(|p| p.is_finite() && p.min_element() >= 0.0), "{guide:?}, {spp} spp");
    }
}

fn rendered(scene: &Scene, settings: &RenderSettings) -> Outcome {
    let reconstructor = reconstructor(settings.guide);
    render(scene, settings, reconstructor.as_ref(), &Silent, &AtomicBool::new(false)).expect("the settings are sound")
}

/// A sun 1e8 units away, as a ball with the sun's angle, lights a floor of two units as parallel light does. Shadow rays of such a
/// length must neither stop short of it nor pass it, voxels must not become as large as the way to it.
#[test]
fn a06_a_sun_far_away_is_parallel_light() {
    let (distance, radius, elevation) = (1e8f32, 4.65e5f32, 0.6f32);
    let to_sun = Vec3::new(elevation.cos(), elevation.sin(), 0.0);
    let solid_angle = std::f32::consts::PI * (radius / distance).powi(2);
    for guide in GUIDES {
        let mut b = floor([8, 8], 1.0);
        let black = b.add_material("black", one_sided(0.0));
        b.add_sphere("sun", to_sun * distance, radius, &black, Some([2.0 / solid_angle; 3]));
        let mut settings = settings(guide, 64, 1);
        settings.transport.max_depth = 3;
        let Outcome { image, statistics, .. } = rendered(&built(b.finish()), &settings);
        assert!(image.pixels.iter().all(|p| p.is_finite()));
        let expected = 0.5 / std::f64::consts::PI * 2.0 * f64::from(elevation).sin();
        assert!((mean(&image) / expected - 1.0).abs() < 0.01, "{guide:?}: {} {expected}", mean(&image));
        // Müller's grid begins with one cell around everything.
        let many = statistics.guide.voxels > 8;
        assert!(many || [GuideMode::None, GuideMode::Ppg].contains(&guide.0), "{guide:?}: {:?}", statistics.guide);
    }
}

/// Coordinates beyond 1e9 units are refused where the file has them, whatever they are of; below, they are accepted.
/// Products of four lengths would leave single precision.
#[test]
fn a06_coordinates_beyond_1e9_are_refused() {
    type Put = fn(&mut Builder, Vec3);
    let cases: [(&str, Put); 6] = [
        ("shapes[1]", |b, at| b.add_quad("far", at, [Vec3::X, Vec3::Y], "grey", None)),
        ("shapes[1]", |b, at| b.add_sphere("far", at, 1.0, "grey", None)),
        ("meshes.far", |b, at| {
            let positions = [at, at + Vec3::Y * 1e6, at + Vec3::Z * 1e6].map(|p| p.to_array()).to_vec();
            let mesh = MeshFile::Inline { positions, normals: vec![], uvs: vec![], triangles: vec![[0, 1, 2]] };
            b.add_mesh("far", mesh, Mat4::IDENTITY, (at, 2e6), "grey");
        }),
        ("lights[0]", |b, at| b.add_light(LightFile::Point { position: at.to_array(), intensity: [1.0; 3] })),
        ("lights[0]", |b, at| {
            let to_world = matrix(Mat4::from_translation(at));
            b.add_light(LightFile::Spot { to_world, intensity: [1.0; 3], cutoff_angle: 30.0, beam_width: 20.0 });
        }),
        ("camera.to_world", |b, at| b.look_at(at, Vec3::ZERO, Vec3::Y, 40.0)),
    ];
    for (i, (key, put)) in cases.into_iter().enumerate() {
        let at = |x: f32| {
            let mut b = floor([4, 4], 1.0);
            put(&mut b, Vec3::X * x);
            load(b.finish()).map(|_| ())
        };
        assert!(at(0.9e9).is_ok(), "case {i}: {:?}", at(0.9e9));
        match at(1.1e9) {
            Err(Error::Malformed { place, message }) => {
                assert!(place.to_string().contains(key) && message.contains("1e9"), "case {i}: {place}: {message}");
            }
            other => panic!("case {i}: {other:?}"),
        }
    }
}

/// Directions that all but touch the surface, from triangles of all sizes, far from the origin and near it: no ray that leaves a
/// triangle or a ball may hit it again. Too small an offset darkens lit floors by their own shadows.
#[test]
fn a07_rays_do_not_hit_what_they_leave() {
    let mut random = Random::new(1, 0, 0);
    let mut tested = 0;
    for size in [1e-4f32, 1.0, 1e4, 1e6] {
        for place in [0.0f32, 1.0, 1e3, 1e6] {
            // Below its own resolution a triangle has no shape.
            if size < 1e-3 * place {
                continue;
            }
            for _ in 0..40 {
                let corners = corners(place, size, &mut random);
                if is_sliver(corners) {
                    continue;
                }
                let mesh = Mesh { positions: corners.to_vec(), triangles: vec![[0, 1, 2]], ..Mesh::default() };
                let ball = Shape::sphere(place * Vec3::ONE, size, false);
                for shape in [Shape::mesh(Arc::new(mesh), Affine3A::IDENTITY, false), ball] {
                    tested += leave_everywhere(&[shape], &mut random);
                }
            }
        }
    }
    assert!(tested > 50_000, "{tested} rays");
}

/// Three points on a sphere of radius `size` around (`place`, `place`, `place`).
fn corners(place: f32, size: f32, random: &mut Random) -> [Vec3; 3] {
    [(); 3].map(|()| place * Vec3::ONE + size * warp::square_to_sphere(random.next_2d()))
}

/// What the normal of a sliver is, singles do not know.
fn is_sliver([a, b, c]: [Vec3; 3]) -> bool {
    let (b, c) = (b - a, c - a);
    b.cross(c).length() < 0.1 * b.length_squared().max(c.length_squared())
}

/// The same for a mesh that two shapes share, which rays meet in its own coordinates: turned, mirrored and flattened,
/// far from the origin in its coordinates, in those of the world, or in both. Rounding on the way to the world and back
/// counts too: 1e-3 units here where the world's coordinates alone promise 1e-6.
#[test]
fn a07_instances_do_not_hit_what_they_leave() {
    let mut random = Random::new(2, 0, 0);
    let turn = Quat::from_euler(glam::EulerRot::XYZ, 0.4, 1.0, -0.7);
    let linear = Affine3A::from_scale_rotation_translation(Vec3::new(1.0, -0.7, 1e-2), turn, Vec3::ZERO);
    let mut tested = 0;
    for (place, size, shift) in [
        (1e4, 1.0, -linear.transform_point3(Vec3::splat(1e4))),
        (1e4, 1e4, Vec3::splat(-1e4)),
        (1e4, 10.0, Vec3::splat(-1e4)),
        (0.0, 1.0, Vec3::Y * 1e4),
        (0.0, 1.0, Vec3::ZERO),
    ] {
        let to_world = Affine3A { translation: shift.into(), ..linear };
        for _ in 0..20 {
            let mut mesh = Mesh::default();
            // Smaller ones are stored for each shape.
            while mesh.triangles.len() <= SELDOM_SHARED {
                let corners = corners(place, size, &mut random);
                if !is_sliver(corners.map(|p| to_world.transform_point3(p))) {
                    let first = mesh.positions.len() as u32;
                    mesh.positions.extend(corners);
                    mesh.triangles.push([first, first + 1, first + 2]);
                }
            }
            let shape = Shape::mesh(Arc::new(mesh), to_world, false);
            tested += leave_everywhere(&[shape.clone(), shape], &mut random);
        }
    }
    assert!(tested > 10_000, "{tested} rays");
}

/// A level square of `2 · side²` triangles, seen from below, 1e4 units away in its own coordinates.
fn far_square(side: u32) -> MeshFile {
    let row = side + 1;
    let at = |i: u32| 1e4 + i as f32 / 128.0;
    let positions = (0..row * row).map(|i| [at(i % row), 1e4, at(i / row)]).collect();
    let fields = (0..side * side).map(|i| i / side * row + i % side);
    let triangles = fields.flat_map(|i| [[i, i + 1, i + row], [i + 1, i + row + 1, i + row]]).collect();
    MeshFile::Inline { positions, normals: vec![], uvs: vec![], triangles }
}

/// Shadow rays end just before lamps whose mesh, which they share with other shapes, lies far away in its own
/// coordinates: rounding on the way to an instance would bring half of them to the lamp, and half of its light would be
/// lost. Other shapes of large meshes are instances, and those of small ones have copies.
#[test]
fn a07_shadow_rays_do_not_hit_the_lamp_that_they_go_to() {
    let mut b = Builder::new("lamps", [4, 4]);
    let black = b.add_material("black", one_sided(0.0));
    let (large, small) = (b.define_mesh("large", far_square(128)), b.define_mesh("small", far_square(8)));
    let kinds = [("lamp", &large, 3, 2.0), ("instance", &large, 2, 9.0), ("copy", &small, 2, 8.0)];
    for (name, mesh, count, height) in kinds {
        for i in 0..count {
            let to_world = Mat4::from_translation(Vec3::new(2.0 * i as f32, height, 0.0) - 1e4);
            b.add_instance(name, mesh, to_world, (Vec3::ZERO, 1.0), &black);
        }
    }
    let mut file = b.finish();
    file.shapes.iter_mut().filter(|shape| shape.name == "lamp").for_each(|lamp| lamp.emission = Some([1.0; 3]));
    let names: Vec<String> = file.shapes.iter().map(|shape| shape.name.clone()).collect();
    let scene = built(file);
    for (shape, name) in scene.shapes.iter().zip(names) {
        let is_placed = matches!(shape.geometry, Geometry::Mesh { rounding: None, .. });
        assert_eq!(is_placed, name != "instance", "{name}");
    }
    let mut random = Random::new(3, 0, 0);
    let mut tested = 0;
    for _ in 0..4000 {
        let point = Vec3::new(random.range(-1.0, 6.0), random.range(0.0, 1.0), random.range(-1.0, 2.0));
        let (choice, u) = (random.next_f64(), random.next_2d());
        let Some(light) = scene.lights.sample(point, choice, u, &LightView::PLAIN) else { continue };
        let (ray, t_max) = Surface::in_medium(point, 0.0, Vec3::Y).towards(light.wi, light.distance);
        assert!(!scene.accel.occluded(&ray, t_max), "{point} to {light:?}");
        tested += 1;
    }
    assert!(tested > 2000, "{tested} rays");
}

/// Sends grazing rays from points of shapes, none of which may hit the triangle or ball that it leaves, not even that
/// of another shape in the same place; returns their number.
fn leave_everywhere(shapes: &[Shape], random: &mut Random) -> usize {
    let accel = Accel::new(shapes);
    let [low, high] = accel.bounds();
    let mut rays = 0;
    for _ in 0..100 {
        let target = low + (high - low) * Vec3::new(random.next_f32(), random.next_f32(), random.next_f32());
        let direction = warp::square_to_sphere(random.next_2d());
        let arriving = Ray { origin: target - (high - low).length() * direction, direction };
        let Some(hit) = accel.intersect(&arriving) else { continue };
        let shape = &shapes[hit.shape as usize];
        let surface = Surface::new(&arriving, &hit, shape);
        let tangent = surface.frame().s;
        for cos in [1.0, 1e-2, 1e-4, 1e-6, 1e-8] {
            let side = if direction.dot(surface.normal) < 0.0 { 1.0 } else { -1.0 };
            let leaving = (tangent + side * cos * surface.normal).normalize();
            // A ball is hit again from inside.
            if leaving.dot(surface.normal) * side <= 0.0 || (side < 0.0 && is_ball(shape)) {
                continue;
            }
            let again = accel.intersect(&surface.leave(leaving));
            let other = again.is_none_or(|again| again.triangle != hit.triangle);
            assert!(other, "{:?}: {surface:?} left along {leaving} at {cos}, hit {again:?}", shape.geometry);
            rays += 1;
        }
    }
    rays
}

fn is_ball(shape: &Shape) -> bool {
    matches!(shape.geometry, fanal::geometry::shape::Geometry::Sphere(_))
}

/// A floor of 1e4 units, turned and moved so that its coordinates round, in light 0.2° above it: albedo/π · E · sin θ to 1e-3. Its own
/// shadow would take most of that away.
#[test]
fn a07_grazing_light_on_a_large_triangle() {
    let elevation = 0.2f32.to_radians();
    for (turn, shift) in [(Quat::IDENTITY, 0.0), (Quat::from_euler(glam::EulerRot::XYZ, 0.4, 1.0, -0.7), 3e3)] {
        let mut b = floor([8, 8], 1e4);
        b.add_light(LightFile::Directional {
            direction: [elevation.cos(), -elevation.sin(), 0.0],
            irradiance: [2.0; 3],
        });
        b.transform(1.0, turn, Vec3::splat(shift));
        let mut settings = settings(GUIDES[0], 16, 1);
        settings.transport.max_depth = 2;
        let found = mean(&picture(&built(b.finish()), &settings));
        let expected = 0.5 / std::f64::consts::PI * 2.0 * f64::from(elevation).sin();
        assert!((found / expected - 1.0).abs() < 1e-3, "{found} {expected}");
    }
}

fn load(file: SceneFile) -> Result<fanal::scene::readers::LoadedScene> {
    resolve(file, Path::new(""), Path::new("made up"))
}

/// A tetrahedron, some of its corners overwritten, under a sky.
fn tetrahedron(to_world: Mat4, overwrite: &[(usize, [f32; 3])], triangles: Vec<[u32; 3]>) -> SceneFile {
    let mut positions = vec![[0.0, 0.8, 0.0], [-0.7, -0.5, 0.5], [0.7, -0.5, 0.5], [0.0, -0.5, -0.7]];
    overwrite.iter().for_each(|&(at, position)| positions[at] = position);
    let mut b = Builder::new("tetrahedron", [16, 12]);
    let grey = b.add_material("grey", diffuse([0.5; 3]));
    let mesh = MeshFile::Inline { positions, normals: vec![], uvs: vec![], triangles };
    b.add_mesh("tetrahedron", mesh, to_world, (Vec3::ZERO, 1.0), &grey);
    b.add_light(LightFile::Directional { direction: [0.3, -1.0, -0.4], irradiance: [2.0; 3] });
    b.add_light(LightFile::Constant { radiance: [0.2; 3] });
    b.look_at(Vec3::Z * 3.0, Vec3::ZERO, Vec3::Y, 40.0);
    b.finish()
}

const FACES: [[u32; 3]; 4] = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];

/// With three triangles more, which have no area.
fn with_degenerate() -> SceneFile {
    let triangles = FACES.into_iter().chain([[0, 0, 1], [2, 2, 2], [1, 3, 3]]).collect();
    tetrahedron(Mat4::IDENTITY, &[], triangles)
}

/// What is left out is told in the statistics, so that nobody looks for it in the picture.
#[test]
fn a08_skipped_triangles_are_in_the_statistics() {
    let folder = tempfile::tempdir().unwrap();
    let [scene, out, stats] = ["scene.json", "out.exr", "stats.json"].map(|name| folder.path().join(name));
    for (file, skipped) in [(with_degenerate(), 3), (tetrahedron(Mat4::IDENTITY, &[], FACES.to_vec()), 0)] {
        save(&file, &scene).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_fanal"));
        command.arg("render").arg(&scene).arg("-o").arg(&out).arg("--stats").arg(&stats);
        let output = command.args(["--guide", "none", "--spp", "1", "--quiet"]).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let told: serde_json::Value = serde_json::from_slice(&std::fs::read(&stats).unwrap()).unwrap();
        assert_eq!(told["skipped_triangles"], skipped);
    }
}

/// Triangles without area are left out and counted, and change no pixel; what cannot be placed is an error that names the place, never
/// a picture with NaN in it.
#[test]
fn a08_broken_shapes_are_skipped_or_refused() {
    let sound = load(tetrahedron(Mat4::IDENTITY, &[], FACES.to_vec())).expect("sound");
    let with_more = load(with_degenerate()).expect("degenerate triangles are skipped");
    assert_eq!((sound.skipped_triangles, with_more.skipped_triangles), (0, 3));
    let pictures = [sound, with_more].map(|loaded| {
        let scene = Scene::build(&loaded, [16, 12]).expect("names resolve");
        picture(&scene, &settings(GUIDES[0], 4, 1))
    });
    assert!(pictures[0] == pictures[1] && mean(&pictures[0]) > 0.01);

    let flat = [Vec3::new(1.0, 0.0, 1.0), Vec3::new(1.0, f32::NAN, 1.0), Vec3::INFINITY];
    for scale in flat {
        let file = tetrahedron(Mat4::from_scale(scale), &[], FACES.to_vec());
        assert!(matches!(load(file), Err(Error::Malformed { .. })), "scale {scale}");
    }
    for (corner, triangles) in [
        ([f32::NAN, 0.0, 0.0], FACES.to_vec()),
        ([0.0, f32::INFINITY, 0.0], FACES.to_vec()),
        ([0.0, 0.8, 0.0], vec![[0, 1, 4]]),
    ] {
        let refused = load(tetrahedron(Mat4::IDENTITY, &[(0, corner)], triangles));
        assert!(matches!(refused, Err(Error::Malformed { .. })));
    }
}

/// Shapes that nothing can be seen of, as exporters leave them, are left out with a word; the picture is that of the scene without.
#[test]
fn a08_shapes_without_area_are_left_out() {
    let without = tetrahedron(Mat4::IDENTITY, &[], FACES.to_vec());
    let mut with = without.clone();
    let mesh = |triangles| MeshFile::Inline { positions: vec![[0.0; 3]; 3], normals: vec![], uvs: vec![], triangles };
    with.meshes.insert("point".into(), mesh(vec![[0, 1, 2], [2, 1, 0]]));
    with.meshes.insert("nothing".into(), mesh(vec![]));
    with.meshes.insert("square".into(), MeshFile::Rectangle {});
    let line = Mat4::from_rotation_y(0.3) * Mat4::from_scale(Vec3::new(2.0, 0.0, 1.0));
    for (mesh, to_world, emission) in [
        ("point", Mat4::IDENTITY, None),
        ("nothing", Mat4::IDENTITY, Some([1.0; 3])),
        ("square", line, Some([1.0; 3])),
        ("square", Mat4::from_scale(Vec3::ZERO), None),
    ] {
        let (geometry, name) = (GeometryFile::Mesh { mesh: mesh.into() }, mesh.to_owned());
        with.shapes
            .insert(0, ShapeFile { geometry, name, emission, to_world: matrix(to_world), ..with.shapes[0].clone() });
    }
    for (radius, scale) in [(0.0, 1.0), (1.0, 0.0)] {
        let (geometry, to_world) =
            (GeometryFile::Sphere { center: [1.0; 3], radius }, Mat4::from_scale(Vec3::splat(scale)));
        with.shapes.push(ShapeFile {
            geometry,
            name: String::new(),
            to_world: matrix(to_world),
            ..without.shapes[0].clone()
        });
    }
    let [without, with] = [without, with].map(|file| load(file).expect("what has no area is left out"));
    assert_eq!(with.file.shapes, without.file.shapes);
    assert_eq!(with.skipped_triangles, 2);
    for told in [
        "(shapes[0]): the shape \"square\" is left out: it has no area",
        "(shapes[1]): the shape \"square\", which emits light, is left out: it has no area",
        "(shapes[2]): the shape \"nothing\", which emits light, is left out: made up (meshes.nothing): the mesh has no triangles",
        "(shapes[3]): the shape \"point\" is left out: made up (meshes.point): the mesh has no triangles with an area (2 without)",
        "(shapes[5]): the shape is left out: it has no area",
        "(shapes[6]): the shape is left out: it has no area",
    ] {
        assert!(with.warnings.iter().any(|warning| warning.contains(told)), "{told}: {:#?}", with.warnings);
    }
    let [without, with] = [without, with].map(|loaded| {
        let scene = Scene::build(&loaded, [16, 12]).expect("names resolve");
        picture(&scene, &settings(GUIDES[0], 4, 1))
    });
    assert!(with == without);
}

/// A placement that mirrors turns the winding around; the front must stay the front. A mirrored room under a mirrored sun looks
/// mirrored: same mean. A lamp mirrored to face away by mistake would be black.
#[test]
fn a08_mirrored_placements_keep_their_front() {
    let with = |mirrored: bool| {
        let mut b = floor([16, 12], 2.0);
        let black = b.add_material("black", one_sided(0.0));
        b.add_quad("lamp", Vec3::Y, [Vec3::X * 0.4, Vec3::Z * 0.3], &black, Some([3.0; 3]));
        b.look_at(Vec3::new(0.9, 0.3, 0.0), Vec3::ZERO, Vec3::Z, 0.5);
        let mut file = b.finish();
        if mirrored {
            // The rectangle looks the same mirrored in its own plane.
            for shape in &mut file.shapes {
                let to_world = Mat4::from_cols_array(&shape.to_world).transpose();
                let mirror = Mat4::from_scale(Vec3::new(-1.0, 1.0, 1.0));
                shape.to_world = (to_world * mirror).transpose().to_cols_array();
            }
        }
        mean(&picture(&built(file), &settings(GUIDES[0], 64, 1)))
    };
    let (straight, mirrored) = (with(false), with(true));
    assert!(straight > 0.1 && (mirrored / straight - 1.0).abs() < 0.02, "{straight} {mirrored}");
}

/// A sun 1e6 times as bright as the sky, through a window: every mode gives a finite picture of the same mean as without guiding,
/// within 5 standard errors of 8 seeds. Features or weights that saturate at the sun would lose the sky, or its light.
#[test]
fn a10_a_sun_a_million_times_brighter_than_the_sky() {
    let mut b = Builder::new("sun", [12, 8]);
    let wall = b.add_material("wall", diffuse([0.5; 3]));
    b.add_quad("floor", Vec3::ZERO, [Vec3::Z * 2.0, Vec3::X * 2.0], &wall, None);
    b.add_block("block", Vec3::new(-1.0, 0.01, -1.0), Vec3::new(-0.2, 1.0, 0.5), &wall);
    b.add_light(LightFile::Constant { radiance: [0.5; 3] });
    let black = b.add_material("black", one_sided(0.0));
    b.add_sphere("sun", Vec3::new(600.0, 800.0, 100.0), 2.0, &black, Some([5e5; 3]));
    b.look_at(Vec3::new(2.5, 1.5, 2.0), Vec3::ZERO, Vec3::Y, 50.0);
    let scene = built(b.finish());
    let seeds = 8;
    let runs = |guide| {
        let means: Vec<f64> = (0..seeds)
            .map(|seed| {
                let image = picture(&scene, &settings(guide, 32, seed));
                assert!(image.pixels.iter().all(|p| p.is_finite()), "{guide:?}");
                mean(&image)
            })
            .collect();
        let mean = means.iter().sum::<f64>() / seeds as f64;
        let spread: f64 = means.iter().map(|m| (m - mean).powi(2)).sum();
        (mean, spread / (seeds * (seeds - 1)) as f64)
    };
    let (none, variance) = runs(GUIDES[0]);
    for guide in &GUIDES[1..] {
        let (guided, other) = runs(*guide);
        let error = (variance + other).sqrt();
        assert!(error < 0.02 * none && (guided - none).abs() < 5.0 * error, "{guide:?}: {guided} {none} ± {error}");
    }
}

/// A ball of `material` and its picture under a sky of radiance 1 that it nearly fills.
fn ball_under_sky(material: MaterialFile, medium: Option<MediumFile>) -> Scene {
    let mut b = Builder::new("ball", [8, 8]);
    let material = b.add_material("tested", material);
    b.add_sphere("ball", Vec3::ZERO, 1.0, &material, None);
    b.add_light(LightFile::Constant { radiance: [1.0; 3] });
    b.look_at(Vec3::Z * 4.0, Vec3::ZERO, Vec3::Y, 20.0);
    let mut file = b.finish();
    if let Some(medium) = medium {
        file.media.insert("inside".into(), medium);
        file.shapes[0].interior = Some("inside".into());
    }
    built(file)
}

/// The ball's material.
fn tested(scene: &Scene) -> &Material {
    let surface = scene.intersect(&Ray { origin: Vec3::Z * 4.0, direction: Vec3::NEG_Z }).expect("the ball is there");
    scene.material(&surface)
}

fn rough_glass(alpha: f32, int_ior: f32) -> MaterialFile {
    MaterialFile::RoughDielectric { alpha, distribution: Distribution::Ggx, int_ior, ext_ior: 1.0 }
}

fn rough_metal(alpha: f32) -> MaterialFile {
    MaterialFile::RoughConductor {
        alpha,
        distribution: Distribution::Ggx,
        eta: [0.0; 3],
        k: [1.0; 3],
        specular_reflectance: TextureFile::rgb([1.0; 3]),
    }
}

/// Glass with the index of what is around it is not there, smooth, thin or rough: the ball cannot be told from the sky. A half vector
/// of length 0 makes 0/0 of a rough one.
#[test]
fn a11_index_one_is_nothing() {
    let smooth = MaterialFile::Dielectric { int_ior: 1.3, ext_ior: 1.3 };
    let thin = MaterialFile::ThinDielectric { int_ior: 1.0, ext_ior: 1.0 };
    for material in [smooth, thin, rough_glass(0.3, 1.0), rough_glass(0.3, 1.000_000_1), rough_glass(1.0, 1.0001)] {
        let name = format!("{material:?}");
        for guide in [GUIDES[0], GUIDES[1]] {
            let mut settings = settings(guide, 16, 1);
            settings.transport.max_depth = 50;
            let image = picture(&ball_under_sky(material.clone(), None), &settings);
            assert!(image.pixels.iter().all(|p| (p.x - 1.0).abs() < 1e-4), "{name} {guide:?}: {}", mean(&image));
        }
    }
}

/// Roughness down to the threshold below which a surface counts as smooth, and across it: densities stay finite, and the picture
/// goes over into that of the smooth surface. A lobe narrower than singles resolve would lose its light.
#[test]
fn a11_vanishing_roughness_becomes_smooth() {
    let smooth_glass = MaterialFile::Dielectric { int_ior: 1.5, ext_ior: 1.0 };
    type Rough = fn(f32) -> MaterialFile;
    let cases: [(Rough, MaterialFile); 2] =
        [(rough_metal, rough_metal(0.0)), (|alpha| rough_glass(alpha, 1.5), smooth_glass)];
    for (rough, smooth) in cases {
        let mean_of = |material: MaterialFile| {
            let mut settings = settings(GUIDES[0], 256, 1);
            settings.transport.max_depth = 100;
            mean(&picture(&ball_under_sky(material, None), &settings))
        };
        let expected = mean_of(smooth);
        assert!((expected - 1.0).abs() < 0.01, "{expected}");
        for alpha in [0.0, 1e-6, 0.99e-4, 1e-4, 2e-4, 1e-3, 1e-2] {
            let found = mean_of(rough(alpha));
            assert!((found / expected - 1.0).abs() < 0.01, "α {alpha}: {found} {expected}");
        }
    }
}

/// What is called smooth has delta lobes alone, what is not has none: only then may guides and light sampling leave it out.
#[test]
fn a11_smooth_means_delta() {
    for (alpha, delta) in [(0.0, true), (0.99e-4, true), (1.01e-4, false), (0.5, false)] {
        for material in [rough_metal(alpha), rough_glass(alpha, 1.5)] {
            let scene = ball_under_sky(material, None);
            assert_eq!(scene.materials()[0].is_delta(), delta, "{alpha}");
            let mut random = Random::new(2, 0, 0);
            let sample =
                tested(&scene).sample(Vec2::ZERO, Vec3::Z, random.next_f32(), random.next_2d(), Transport::Radiance);
            assert!(sample.is_none_or(|sample| sample.delta == delta));
        }
    }
    let pane = ball_under_sky(MaterialFile::ThinDielectric { int_ior: 1.5, ext_ior: 1.0 }, None);
    assert!(tested(&pane).is_delta() && matches!(tested(&pane).kind, Kind::ThinDielectric(_)));
}

/// From inside glass, beyond the critical angle, all light is reflected: none of the samples may pass a smooth surface, and none may be lost.
#[test]
fn a11_total_reflection_is_total() {
    // The critical angle of 1.5 has the cosine 0.745.
    let cos = 0.3f32;
    let wo = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, -cos);
    let scene = ball_under_sky(MaterialFile::Dielectric { int_ior: 1.5, ext_ior: 1.0 }, None);
    let mut random = Random::new(3, 0, 0);
    for _ in 0..10_000 {
        let sample = tested(&scene)
            .sample(Vec2::ZERO, wo, random.next_f32(), random.next_2d(), Transport::Radiance)
            .expect("reflected");
        assert!(sample.wi == Vec3::new(-wo.x, 0.0, wo.z) && sample.weight == Vec3::ONE && sample.pdf == 1.0);
    }
    let scene = ball_under_sky(rough_glass(0.05, 1.5), None);
    let samples = (0..10_000).filter_map(|_| {
        tested(&scene).sample(Vec2::ZERO, wo, random.next_f32(), random.next_2d(), Transport::Radiance)
    });
    let (mut weight, mut passed) = (0.0, 0);
    for sample in samples {
        weight += f64::from(sample.weight.x) / 1e4;
        passed += usize::from(sample.wi.z > 0.0);
    }
    // The tail of GGX has facets that are steep enough to let light through, but few.
    assert!(passed < 100 && (0.97..1.003).contains(&weight), "{passed} passed, {weight} in all");
}

/// Media at their limits: none at all, so dense that nothing gets in, so sharp that light hardly turns. Absorbing, they are black
/// or not there; scattering without loss, they cannot be told from the sky. Divisions by g or by an extinction of 0 give NaN.
#[test]
fn a12_media_at_their_limits() {
    let medium =
        |sigma: f32, albedo: f32, g: f32| MediumFile::Homogeneous { sigma_t: [sigma; 3], albedo: [albedo; 3], g };
    for (sigma, albedo, g, inside) in [
        (0.0, 0.5, 0.5, 1.0),
        (1e-30, 0.0, 0.0, 1.0),
        (1e30, 0.0, 0.0, 0.0),
        (2.0, 1.0, 0.999_999, 1.0),
        (2.0, 1.0, 0.9999, 1.0),
        (2.0, 1.0, -0.999_999, 1.0),
        (2.0, 1.0, 1e-7, 1.0),
        (50.0, 1.0, 0.0, 1.0),
    ] {
        // Beside a guide, weights multiply along the dozens of bounces of a dense medium.
        for guide in &GUIDES[..if sigma == 50.0 { 1 } else { 2 }] {
            let mut settings = settings(*guide, 64, 1);
            settings.transport.max_depth = 5000;
            // Without light sampling and roulette the weight of every path is 1.
            (settings.transport.light_sampling, settings.transport.roulette) = (false, Roulette::Off);
            let image = picture(&ball_under_sky(MaterialFile::Null {}, Some(medium(sigma, albedo, g))), &settings);
            assert!(image.pixels.iter().all(|p| p.is_finite() && p.min_element() >= 0.0), "{sigma} {albedo} {g}");
            let middle = [27, 28, 35, 36].map(|i| f64::from(image.pixels[i].x)).iter().sum::<f64>() / 4.0;
            // With a guide 256 paths leave some noise.
            let tolerance = if *guide == GUIDES[0] { 1e-3 } else { 0.5 };
            assert!((middle - inside).abs() < tolerance, "{sigma} {albedo} {g} {guide:?}: {middle}");
        }
    }
}

/// A network that is wrong: everything it says is the opposite of what was counted, which is the plainer proposal.
struct Wrong(AsCounted);

impl Reconstructor for Wrong {
    fn name(&self) -> &'static str {
        "wrong"
    }

    fn rays_per_node(&self) -> f64 {
        0.0
    }

    fn reconstruct(&self, trees: &[CountedTree]) -> Result<Vec<Proposal>> {
        let opposite = |tree: &CountedTree| {
            let topology = tree.counted.topology();
            let area = (0..topology.levels()).flat_map(|level| {
                topology.level(level).filter(|&node| topology.is_leaf(node)).map(move |_| 0.25f64.powi(level as i32))
            });
            let mass = tree.counted.leaf_mass();
            let weights: Vec<f64> = area.zip(mass).map(|(area, mass)| area * area / (mass + 1e-4 * area)).collect();
            let opposite = Directions::from_leaf_weights(topology.clone(), &weights);
            let uniform = self.0.uniform;
            Proposal { first: (opposite, uniform), plain: Some((tree.counted.clone(), uniform)) }
        };
        Ok(trees.iter().map(opposite).collect())
    }
}

/// With a network that is wrong everywhere the picture is as bright as without guiding, to five standard errors of 24
/// pictures (by Student's distribution of 23 degrees of freedom, the fewest that Welch's test has here, one false alarm
/// in 20,000 for a scene and in 10,000 for both), and its variance at most WORST times as large without its fireflies
/// and WORST_OF_ALL times with them: the mixture keeps half of the BSDF's samples while learning, and afterwards what
/// was measured decides.
#[test]
fn a19_a_wrong_network_costs_little() {
    // Half of the samples may go into photons, and half of the others into the guide, until what was measured decides.
    const WORST: f64 = 4.5;
    // The same four times are expected of all pixels; but fireflies make the estimate itself noisy.
    const WORST_OF_ALL: f64 = 10.0;
    for name in ["cornell", "lamp-room"] {
        let scene = committed(name, [24, 18]);
        // The mean of all pictures, its standard error, and the variance of a picture's pixels, without fireflies and
        // with them.
        let runs = |wrong: bool| -> [f64; 4] {
            let mut means = vec![];
            let mut errors = vec![];
            let mut first: Option<Vec<Vec3>> = None;
            for seed in 0..24 {
                let settings = settings(GUIDES[if wrong { 6 } else { 0 }], 64, seed);
                let plain = AsCounted::default();
                let hostile = Wrong(AsCounted::default());
                let reconstructor: &dyn Reconstructor = if wrong { &hostile } else { &plain };
                let outcome = render(&scene, &settings, reconstructor, &Silent, &AtomicBool::new(false));
                let image = outcome.expect("the settings are sound").image;
                means.push(mean(&image));
                if let Some(last) = first.replace(image.pixels.clone()) {
                    // Half the squared difference of two pictures is their variance; fireflies are cut off alike.
                    let mut squares: Vec<f64> = last
                        .iter()
                        .zip(&image.pixels)
                        .map(|(a, b)| f64::from((*a - *b).length_squared()) / 2.0)
                        .collect();
                    squares.sort_by(f64::total_cmp);
                    let average = |squares: &[f64]| squares.iter().sum::<f64>() / squares.len() as f64;
                    errors.push([average(&squares[..squares.len() * 99 / 100]), average(&squares)]);
                }
            }
            let count = means.len() as f64;
            let all = means.iter().sum::<f64>() / count;
            let spread = means.iter().map(|mean| (mean - all).powi(2)).sum::<f64>() / (count - 1.0);
            let [trimmed, whole] = [0, 1].map(|i| errors.iter().map(|e| e[i]).sum::<f64>() / errors.len() as f64);
            [all, (spread / count).sqrt(), trimmed, whole]
        };
        let ([plain, plain_error, variance, whole], [wrong, wrong_error, worse, worse_whole]) =
            (runs(false), runs(true));
        let ratios = [worse / variance, worse_whole / whole];
        println!("{name}: {plain} +- {plain_error}, {wrong} +- {wrong_error}, variance ratios {ratios:?}");
        let error = plain_error.hypot(wrong_error);
        assert!(error < 0.03 * plain, "{name}: too noisy to tell: {plain} +- {error}");
        assert!((wrong - plain).abs() < 5.0 * error, "{name}: {wrong} against {plain} +- {error}");
        assert!(ratios[0] < WORST && ratios[1] < WORST_OF_ALL, "{name}: {ratios:?}");
    }
}
