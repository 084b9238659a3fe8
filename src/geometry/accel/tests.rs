//! Cases S7 and A6 to A8 of docs/stability.md, for both kinds of tests.

use super::traverse::USUAL_STACK;
use super::*;
use crate::base::random::Random;
use crate::geometry::triangle::Shear;
use crate::sampling::warp;

/// All kernels that this processor can run.
pub(super) fn kernels() -> Vec<Kernel> {
    match Kernel::detect() {
        Kernel::Portable => vec![Kernel::Portable],
        #[cfg(target_arch = "x86_64")]
        fastest @ Kernel::Avx2(_) => vec![Kernel::Portable, fastest],
        #[cfg(target_arch = "x86_64")]
        fastest @ Kernel::Avx512(proof) => vec![Kernel::Portable, Kernel::Avx2(proof.avx2()), fastest],
    }
}

/// So many of something; at most a hundred under Miri, which is a thousand times slower and looks for errors of memory alone.
pub(super) fn fewer(count: usize) -> usize {
    if cfg!(miri) { count.min(100) } else { count }
}

pub(super) fn point(random: &mut Random) -> Vec3 {
    Vec3::new(random.next_f32(), random.next_f32(), random.next_f32())
}

pub(super) fn soup(random: &mut Random, triangles: usize, size: f32) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..triangles as u32 {
        let center = point(random);
        for _ in 0..3 {
            mesh.positions.push(center + size * (warp::square_to_sphere(random.next_2d())));
        }
        mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    mesh
}

/// The same triangle again and again.
pub(super) fn in_one_place(triangles: usize) -> Mesh {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::new(0.0, 1.0, 0.1)];
    Mesh { positions, triangles: vec![[0, 1, 2]; triangles], ..Mesh::default() }
}

/// A closed sphere of `2 · turns · (rings − 1)` triangles, whose vertices are shared.
pub(super) fn closed_sphere(rings: u32, turns: u32, radius: f32, center: Vec3) -> Mesh {
    let [rings, turns] = if cfg!(miri) { [rings, turns].map(|sides| sides.min(8)) } else { [rings, turns] };
    let mut mesh = Mesh::default();
    let mut push = |direction: Vec3| mesh.positions.push(center + radius * direction);
    push(Vec3::Z);
    push(-Vec3::Z);
    for ring in 1..rings {
        for turn in 0..turns {
            let (theta, phi) = (ring as f32 / rings as f32, turn as f32 / turns as f32 * 2.0);
            let ((st, ct), (sp, cp)) =
                ((theta * std::f32::consts::PI).sin_cos(), (phi * std::f32::consts::PI).sin_cos());
            push(Vec3::new(st * cp, st * sp, ct));
        }
    }
    let at = |ring: u32, turn: u32| 2 + (ring - 1) * turns + turn % turns;
    for turn in 0..turns {
        mesh.triangles.push([0, at(1, turn), at(1, turn + 1)]);
        mesh.triangles.push([1, at(rings - 1, turn + 1), at(rings - 1, turn)]);
        for ring in 1..rings - 1 {
            let [a, b, c, d] = [at(ring, turn), at(ring + 1, turn), at(ring + 1, turn + 1), at(ring, turn + 1)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

/// The nearest hit by testing every primitive, with the hierarchy's rule for equal distances.
fn brute_force(shapes: &[Shape], ray: &Ray, instanced: &HashSet<*const Mesh>) -> Option<Hit> {
    brute_force_among(shapes, ray, instanced, |_| true)
}

/// The same among the shapes for which `counts` is true.
fn brute_force_among(
    shapes: &[Shape],
    ray: &Ray,
    instanced: &HashSet<*const Mesh>,
    counts: impl Fn(u32) -> bool,
) -> Option<Hit> {
    let mut best = Hit::NONE;
    for (shape, index) in shapes.iter().zip(0..).filter(|(_, index)| counts(*index)) {
        match &shape.geometry {
            Geometry::Sphere(sphere) => {
                if let Some(distance) = sphere.intersect(ray.origin, ray.direction, f32::INFINITY) {
                    best.replace(Hit { distance, shape: index, triangle: 0, barycentric: [0.0; 2] });
                }
            }
            Geometry::Mesh { mesh, to_world, .. } => {
                let is_instance = instanced.contains(&Arc::as_ptr(mesh));
                let to_mesh = to_mesh(to_world).as_affine3a();
                let shear = if is_instance {
                    Shear::new(to_mesh.transform_point3(ray.origin), to_mesh.transform_vector3(ray.direction))
                } else {
                    Shear::new(ray.origin, ray.direction)
                };
                for triangle in 0..mesh.triangles.len() as u32 {
                    let corners = if is_instance {
                        mesh.triangles[triangle as usize].map(|v| mesh.positions[v as usize])
                    } else {
                        shape.triangle(triangle)
                    };
                    if let Some((distance, barycentric)) = shear.intersect(&corners, f32::INFINITY) {
                        best.replace(Hit { distance, shape: index, triangle, barycentric });
                    }
                }
            }
        }
    }
    best.found()
}

pub(super) fn random_ray(random: &mut Random, i: usize) -> Ray {
    let origin = 2.0 * warp::square_to_sphere(random.next_2d()) + Vec3::splat(0.5);
    let mut direction = (point(random) - origin).normalize();
    if i.is_multiple_of(10) {
        direction[i / 10 % 3] = if i.is_multiple_of(20) { 0.0 } else { -0.0 };
        direction = direction.normalize();
    }
    Ray { origin, direction }
}

/// docs/stability.md, S7: the same hits as testing every primitive, for placed meshes, instances, spheres, and surfaces that coincide.
#[test]
fn s07_hierarchy_equals_brute_force() {
    let mut random = Random::new(11, 0, 0);
    let shared = Arc::new(soup(&mut random, 40, 0.2));
    let turned = Affine3A::from_scale_rotation_translation(
        Vec3::new(0.5, -0.7, 1.2),
        glam::Quat::from_rotation_x(0.8),
        Vec3::new(0.3, 0.5, -0.2),
    );
    let twice = soup(&mut random, 30, 0.3);
    let shapes = [
        Shape::mesh(Arc::new(soup(&mut random, 200, 0.1)), Affine3A::IDENTITY, false),
        Shape::mesh(shared.clone(), Affine3A::from_translation(Vec3::splat(0.5)), false),
        Shape::mesh(Arc::new(twice.clone()), Affine3A::IDENTITY, false),
        Shape::mesh(shared.clone(), turned, false),
        Shape::mesh(Arc::new(twice), Affine3A::IDENTITY, false),
        Shape::sphere(Vec3::splat(0.4), 0.2, false),
        Shape::mesh(shared, turned, false),
        Shape::sphere(Vec3::splat(0.4), 0.2, false),
    ];
    let instanced = shared_meshes(&shapes);
    assert_eq!(instanced.len(), 1);
    let accels: Vec<Accel> = kernels().into_iter().map(|kernel| Accel::with_kernel(&shapes, kernel)).collect();
    let mut hits = 0;
    for i in 0..fewer(100_000) {
        let ray = random_ray(&mut random, i);
        let brute = brute_force(&shapes, &ray, &instanced);
        hits += usize::from(brute.is_some());
        let third = |shape: u32| shape % 3 == i as u32 % 3;
        let near = |among: &dyn Fn(u32) -> bool| {
            brute_force_among(&shapes, &ray, &instanced, among).is_some_and(|hit| hit.distance < 2.0)
        };
        let met = match (near(&third), near(&|_| true)) {
            (true, _) => Met::Wall,
            (false, true) => Met::Veils,
            (false, false) => Met::Nothing,
        };
        let solid: Vec<bool> = (0..shapes.len() as u32).map(third).collect();
        for accel in &accels {
            assert_eq!(accel.intersect(&ray), brute, "{ray:?}");
            assert_eq!(accel.occluded(&ray, f32::INFINITY), brute.is_some(), "{ray:?}");
            if let Some(hit) = brute {
                assert!(accel.occluded(&ray, hit.distance.next_up()), "{ray:?}");
                assert!(!accel.occluded(&ray, hit.distance), "{ray:?}");
            }
            assert_eq!(accel.meets(&ray, 2.0, &solid), met, "{ray:?}");
        }
    }
    assert!((10_000..100_000).contains(&hits) || cfg!(miri), "{hits}");
}

/// docs/stability.md, S7: triangles in one place, spheres in another and instances in a third make no deep hierarchy,
/// and of those at the same distance the first is hit.
#[test]
fn s07_what_lies_in_one_place_has_an_order() {
    let mut random = Random::new(16, 0, 0);
    let shared = Arc::new(soup(&mut random, 20, 0.2));
    let mut shapes = vec![
        Shape::mesh(Arc::new(in_one_place(fewer(20_000))), Affine3A::IDENTITY, false),
        Shape::mesh(Arc::new(soup(&mut random, fewer(200), 0.05)), Affine3A::IDENTITY, false),
    ];
    let place = Affine3A::from_translation(Vec3::splat(0.2));
    shapes.extend((0..20).map(|_| Shape::mesh(shared.clone(), place, false)));
    shapes.extend((0..20).map(|_| Shape::sphere(Vec3::splat(0.7), 0.1, false)));
    let instanced = shared_meshes(&shapes);
    let accels: Vec<Accel> = kernels().into_iter().map(|kernel| Accel::with_kernel(&shapes, kernel)).collect();
    let mut met = HashSet::new();
    for i in 0..fewer(500) {
        let ray = random_ray(&mut random, i);
        let brute = brute_force(&shapes, &ray, &instanced);
        met.extend(brute.map(|hit| hit.shape));
        for accel in &accels {
            assert!(accel.hierarchy.stack() <= USUAL_STACK, "{}", accel.hierarchy.stack());
            assert_eq!(accel.intersect(&ray), brute, "{ray:?}");
            assert_eq!(accel.occluded(&ray, f32::INFINITY), brute.is_some(), "{ray:?}");
        }
    }
    let first = HashSet::from([0, 1, 2, 22]);
    assert!(met == first || cfg!(miri), "{met:?}");
}

/// docs/stability.md, S7: spheres and instances are met where they are, also beside long triangles that are split.
#[test]
#[cfg_attr(miri, ignore = "among the few triangles that Miri has time for none is worth splitting")]
fn s07_splitting_moves_nothing_else() {
    let mut random = Random::new(17, 0, 0);
    let mut mesh = soup(&mut random, 1000, 0.02);
    for _ in 0..50 {
        let first = mesh.positions.len() as u32;
        let (from, to) = (point(&mut random), point(&mut random));
        mesh.positions.extend([from, to, to + 0.01 * point(&mut random)]);
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    let triangles = mesh.triangles.len();
    let shared = Arc::new(soup(&mut random, 20, 0.1));
    let mut shapes = vec![Shape::mesh(Arc::new(mesh), Affine3A::IDENTITY, false)];
    for _ in 0..20 {
        let place = Affine3A::from_translation(point(&mut random) - 0.5);
        shapes.push(Shape::mesh(shared.clone(), place, false));
        shapes.push(Shape::sphere(point(&mut random), 0.03, false));
    }
    let instanced = shared_meshes(&shapes);
    for kernel in kernels() {
        let accel = Accel::with_kernel(&shapes, kernel);
        let held = accel.hierarchy.packets.iter().flat_map(|packet| packet.triangles);
        assert!(held.filter(|&index| index != u32::MAX).count() > triangles, "long triangles are split");
        for i in 0..2000 {
            let ray = random_ray(&mut random, i);
            assert_eq!(accel.intersect(&ray), brute_force(&shapes, &ray, &instanced), "{ray:?}");
        }
    }
}

/// docs/stability.md, A7: near the surface of a mesh an instance, whatever its scale, has the hits that the mesh has in
/// the world. The bound of rounding errors is in the units of the mesh, and distances in those of the world.
#[test]
fn a07_instances_lose_no_near_hits() {
    let turns = 128;
    let mut disk = Mesh { positions: vec![Vec3::ZERO], ..Mesh::default() };
    for turn in 0..turns {
        // The ray below goes along the middle of the first triangle.
        let (sin, cos) = ((turn as f32 - 0.5) / turns as f32 * std::f32::consts::TAU).sin_cos();
        disk.positions.push(Vec3::new(cos, 0.0, sin));
        disk.triangles.push([0, 1 + turn, 1 + (turn + 1) % turns]);
    }
    let disk = Arc::new(disk);
    let (sin, cos) = 10f32.to_radians().sin_cos();
    for scale in [1e-3f32, 1e3, 1e4] {
        let place = |z: f32| Affine3A::from_translation(z * Vec3::Z) * Affine3A::from_scale(Vec3::splat(scale));
        let instances = [0.0, 10.0 * scale].map(|z| Shape::mesh(disk.clone(), place(z), false));
        let copies = instances.clone().map(Shape::in_world);
        assert!(shared_meshes(&instances).len() == 1 && shared_meshes(&copies).is_empty());
        for kernel in kernels() {
            let [instances, copies] = [&instances, &copies].map(|shapes| Accel::with_kernel(shapes, kernel));
            for height in [1e-4, 1e-3, 1e-2, 5e-2] {
                let origin = scale * Vec3::new(0.5, height, 0.0);
                let ray = Ray { origin, direction: Vec3::new(cos, -sin, 0.0) };
                let [near, far] = [&instances, &copies].map(|accel| accel.intersect(&ray));
                let (Some(near), Some(far)) = (near, far) else {
                    panic!("{height} above a disk of {scale}: {near:?} {far:?} {kernel:?}");
                };
                assert_eq!([near, far].map(|hit| (hit.shape, hit.triangle)), [(0, 0); 2], "{height} {scale}");
                assert!((near.distance / far.distance - 1.0).abs() < 0.01, "{near:?} {far:?} {height} {scale}");
            }
        }
    }
}

/// Both kinds of tests agree to the last bit where the hierarchy is deep and many rays pass through edges and vertices.
#[test]
fn kernels_agree() {
    let mesh = closed_sphere(80, 80, 0.5, Vec3::splat(0.5));
    let corners = mesh.positions.clone();
    let mut random = Random::new(12, 0, 0);
    let clutter = soup(&mut random, fewer(20_000), 0.02);
    let shapes = [
        Shape::mesh(Arc::new(mesh), Affine3A::IDENTITY, false),
        Shape::mesh(Arc::new(clutter), Affine3A::IDENTITY, false),
    ];
    let accels: Vec<Accel> = kernels().into_iter().map(|kernel| Accel::with_kernel(&shapes, kernel)).collect();
    for i in 0..fewer(100_000) {
        let mut ray = random_ray(&mut random, i);
        if i.is_multiple_of(3) {
            let pick = |random: &mut Random| corners[(random.next_f32() * corners.len() as f32) as usize];
            ray.origin = if i.is_multiple_of(2) { Vec3::splat(0.5) } else { pick(&mut random) };
            ray.direction = (pick(&mut random) - ray.origin).normalize_or(Vec3::X);
        }
        let hits: Vec<Option<Hit>> = accels.iter().map(|accel| accel.intersect(&ray)).collect();
        assert!(hits.windows(2).all(|pair| pair[0] == pair[1]), "{ray:?}: {hits:?}");
        let t_max = hits[0].map_or(1.0, |hit| hit.distance * random.next_f32() * 2.0);
        let shadows: Vec<bool> = accels.iter().map(|accel| accel.occluded(&ray, t_max)).collect();
        let expected = hits[0].is_some_and(|hit| hit.distance < t_max);
        assert!(shadows.iter().all(|&shadow| shadow == expected), "{ray:?}");
    }
}

/// docs/stability.md, S7 and A6: no ray leaves a closed mesh, through faces, edges or vertices, whatever its size and place; and few of
/// those that come from 1e5 units away slip through it.
#[test]
fn s07_closed_mesh_is_watertight() {
    for (radius, center, distance) in [
        (1.0, Vec3::ZERO, 1e5),
        (1e-4, Vec3::ZERO, 10.0),
        (10.0, Vec3::new(1e6, -1e6, 1e6), 1e6),
        (1e6, Vec3::ONE, 1e11),
    ] {
        let mesh = closed_sphere(60, 70, radius, center);
        let corners = mesh.positions.clone();
        let shapes = [Shape::mesh(Arc::new(mesh), Affine3A::IDENTITY, false)];
        for kernel in kernels() {
            let accel = Accel::with_kernel(&shapes, kernel);
            let mut random = Random::new(13, 0, 0);
            let (mut inner, mut outer) = (0, 0);
            for i in 0..fewer(100_000) {
                let origin = center + radius * 0.9 * random.next_f32() * warp::square_to_sphere(random.next_2d());
                let pick = |random: &mut Random| corners[(random.next_f32() * corners.len() as f32) as usize];
                let direction = match i % 4 {
                    0 => (pick(&mut random) - origin).normalize(),
                    1 => {
                        let corner = 2 + i % (corners.len() - 3).min(4000);
                        (0.5 * (corners[corner] + corners[corner + 1]) - origin).normalize()
                    }
                    _ => warp::square_to_sphere(random.next_2d()),
                };
                inner += usize::from(accel.intersect(&Ray { origin, direction }).is_none());
                let far = center + distance * warp::square_to_sphere(random.next_2d());
                let target = center + 0.5 * radius * warp::square_to_sphere(random.next_2d());
                outer += usize::from(
                    !accel.occluded(&Ray { origin: far, direction: (target - far).normalize() }, f32::INFINITY),
                );
            }
            assert_eq!(inner, 0, "{radius} {center} {kernel:?}");
            assert!(outer <= 2 || cfg!(miri), "{outer} of 1e5 from {distance}: {radius} {center} {kernel:?}");
        }
    }
}

/// docs/stability.md, A8: shapes that no ray can hit, and rays that hit nothing.
#[test]
fn a08_nothing_to_hit() {
    let degenerate = Mesh {
        positions: vec![Vec3::ZERO, Vec3::X, 2.0 * Vec3::X, Vec3::NAN, Vec3::INFINITY, Vec3::Y],
        triangles: vec![[0, 1, 2], [0, 0, 0], [0, 1, 3], [0, 1, 4], [0, 1, 1]],
        ..Mesh::default()
    };
    let shapes = [
        Shape::mesh(Arc::new(degenerate.clone()), Affine3A::IDENTITY, false),
        Shape::mesh(Arc::new(Mesh::default()), Affine3A::IDENTITY, false),
        Shape::sphere(Vec3::NAN, 1.0, false),
    ];
    let one = [Shape::mesh(
        Arc::new(Mesh { triangles: vec![[0, 1, 5], [0, 1, 2]], ..degenerate }),
        Affine3A::IDENTITY,
        false,
    )];
    let down = Ray { origin: Vec3::new(0.2, 0.2, 1.0), direction: Vec3::NEG_Z };
    for kernel in kernels() {
        for shapes in [&[] as &[Shape], &shapes] {
            let empty = Accel::with_kernel(shapes, kernel);
            assert_eq!(empty.intersect(&down), None);
            assert!(!empty.occluded(&down, f32::INFINITY));
            assert!(empty.bounds()[0].cmpgt(empty.bounds()[1]).all());
        }
        let accel = Accel::with_kernel(&one, kernel);
        assert_eq!(accel.intersect(&down).map(|hit| hit.distance), Some(1.0));
        for bad in [Vec3::NAN, Vec3::INFINITY, Vec3::ZERO] {
            assert_eq!(accel.intersect(&Ray { direction: bad, ..down }), None);
        }
        for bad in [Vec3::NAN, Vec3::INFINITY] {
            assert_eq!(accel.intersect(&Ray { origin: bad, ..down }), None);
            assert!(!accel.occluded(&Ray { origin: bad, ..down }, f32::INFINITY));
        }
        assert!(!accel.occluded(&down, f32::NAN));
    }
}

/// A chain of boxes, each around all before it, makes the deepest hierarchy.
#[test]
fn deep_hierarchies_have_room() {
    let mut mesh = Mesh::default();
    for i in 0..fewer(2000) as u32 {
        let size = 1.1f32.powi((i % 700) as i32 - 350);
        mesh.positions.extend([Vec3::ZERO, size * Vec3::X, size * Vec3::new(0.0, 1.0, 0.1)]);
        mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    let shapes = [Shape::mesh(Arc::new(mesh), Affine3A::IDENTITY, false)];
    let mut random = Random::new(14, 0, 0);
    for kernel in kernels() {
        let accel = Accel::with_kernel(&shapes, kernel);
        assert!(accel.hierarchy.stack() > USUAL_STACK || cfg!(miri), "{}", accel.hierarchy.stack());
        for i in 0..fewer(2000) {
            let ray = random_ray(&mut random, i);
            assert_eq!(accel.intersect(&ray), brute_force(&shapes, &ray, &HashSet::new()), "{ray:?}");
        }
    }
}

/// A surface takes at most 120 bytes per triangle, with its positions, normals, texture coordinates and indices; loose triangles
/// that overlap in all directions, the worst case, have a hierarchy of at most 100.
#[test]
#[cfg_attr(miri, ignore = "counts the bytes of large meshes, of which Miri would make one for hours")]
fn memory_per_triangle() {
    let per_triangle = |mesh: Mesh| {
        let triangles = mesh.triangles.len() as f64;
        Accel::new(&[Shape::mesh(Arc::new(mesh), Affine3A::IDENTITY, false)]).bytes() as f64 / triangles
    };
    let surface = closed_sphere(200, 200, 1.0, Vec3::ZERO);
    let of_vertices = (surface.positions.len() * (12 + 12 + 8)) as f64 / surface.triangles.len() as f64;
    let bytes = of_vertices + 12.0 + per_triangle(surface);
    assert!((60.0..=120.0).contains(&bytes), "{bytes} bytes per triangle");
    let loose = per_triangle(soup(&mut Random::new(15, 0, 0), 50_000, 0.02));
    assert!((40.0..=100.0).contains(&loose), "{loose} bytes per loose triangle");
}
