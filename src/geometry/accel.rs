//! The bounding volume hierarchy over all shapes of a scene.
//!
//! Triangles of a mesh that one shape uses are placed in the world and stored in the top hierarchy. A mesh that several
//! shapes use has its own hierarchy, built once, and appears in the top one as an instance.

use std::sync::Arc;
use std::time::Duration;

use glam::{Affine3A, Vec3, Vec3A};
use hashbrown::{HashMap, HashSet};
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::{BvhBuildParams, ray as obvhs_ray};

use super::Ray;
use super::mesh::Mesh;
use super::shape::{Geometry, Shape};
use super::sphere::Sphere;
use super::triangle::Shear;

/// The nearest intersection of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance along the ray.
    pub distance: f32,
    /// Index of the shape.
    pub shape: u32,
    /// Index of the triangle in the shape's mesh; 0 for a sphere.
    pub triangle: u32,
    /// Barycentric coordinates (b₁, b₂) on the triangle.
    pub barycentric: [f32; 2],
}

#[derive(Debug, Clone)]
enum Primitive {
    Triangle { vertices: [Vec3; 3], shape: u32, index: u32 },
    Sphere { sphere: Sphere, shape: u32 },
    Instance { mesh: u32, shape: u32 },
}

/// A mesh hierarchy in mesh coordinates.
struct MeshAccel {
    bvh: CwBvh,
    triangles: Vec<([Vec3; 3], u32)>,
}

/// Answers ray queries against all shapes of a scene.
pub struct Accel {
    bvh: CwBvh,
    primitives: Vec<Primitive>,
    meshes: Vec<MeshAccel>,
    to_mesh: Vec<Affine3A>,
    bounds: [Vec3; 2],
}

impl Accel {
    /// Builds the hierarchy. Triangles without area are left out: no ray can hit them.
    pub fn new(shapes: &[Shape]) -> Self {
        let shared = shared_meshes(shapes);
        let mut meshes = Vec::new();
        let mut slot: HashMap<*const Mesh, u32> = HashMap::new();
        let mut primitives = Vec::new();
        for (index, shape) in shapes.iter().enumerate() {
            let index = index as u32;
            match &shape.geometry {
                Geometry::Sphere(sphere) => primitives.push(Primitive::Sphere { sphere: *sphere, shape: index }),
                Geometry::Mesh { mesh, .. } if shared.contains(&Arc::as_ptr(mesh)) => {
                    let mesh = *slot.entry(Arc::as_ptr(mesh)).or_insert_with(|| {
                        meshes.push(MeshAccel::new(mesh));
                        meshes.len() as u32 - 1
                    });
                    if !meshes[mesh as usize].triangles.is_empty() {
                        primitives.push(Primitive::Instance { mesh, shape: index });
                    }
                }
                Geometry::Mesh { mesh, .. } => primitives.extend((0..mesh.triangles.len() as u32).filter_map(|i| {
                    let vertices = shape.triangle(i);
                    has_area(&vertices).then_some(Primitive::Triangle { vertices, shape: index, index: i })
                })),
            }
        }
        let boxes: Vec<Aabb> = primitives.iter().map(|p| bounds_of(p, shapes, &meshes)).collect();
        let bounds = boxes.iter().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], b| {
            [low.min(b.min.into()), high.max(b.max.into())]
        });
        let bvh = build(&boxes);
        let primitives = bvh.primitive_indices.iter().map(|&i| primitives[i as usize].clone()).collect();
        let to_mesh = shapes.iter().map(world_to_mesh).collect();
        Self { bvh, primitives, meshes, to_mesh, bounds }
    }

    /// Corners of the box around everything; infinite and inverted for an empty scene.
    pub fn bounds(&self) -> [Vec3; 2] {
        self.bounds
    }

    /// The nearest hit.
    pub fn intersect(&self, ray: &Ray) -> Option<Hit> {
        if self.primitives.is_empty() {
            return None;
        }
        let shear = Shear::new(ray.origin, ray.direction);
        let mut found = None;
        let mut nearest = obvhs_ray::RayHit::none();
        self.bvh.ray_traverse(query(ray, f32::INFINITY), &mut nearest, |inner, id| {
            let hit = self.hit(&self.primitives[id], ray, &shear, inner.tmax / UNIT);
            hit.map_or(f32::INFINITY, |hit| {
                found = Some(hit);
                hit.distance * UNIT
            })
        });
        found
    }

    /// Whether anything lies on the ray before distance `t_max`.
    pub fn occluded(&self, ray: &Ray, t_max: f32) -> bool {
        if self.primitives.is_empty() {
            return false;
        }
        let shear = Shear::new(ray.origin, ray.direction);
        !self.bvh.ray_traverse_miss(query(ray, t_max), |_, id| {
            self.hit(&self.primitives[id], ray, &shear, t_max).map_or(f32::INFINITY, |hit| hit.distance * UNIT)
        })
    }

    #[inline]
    fn hit(&self, primitive: &Primitive, ray: &Ray, shear: &Shear, t_max: f32) -> Option<Hit> {
        match primitive {
            Primitive::Triangle { vertices, shape, index } => shear
                .intersect(vertices, t_max)
                .map(|(distance, barycentric)| Hit { distance, shape: *shape, triangle: *index, barycentric }),
            Primitive::Sphere { sphere, shape } => sphere
                .intersect(ray.origin, ray.direction, t_max)
                .map(|distance| Hit { distance, shape: *shape, triangle: 0, barycentric: [0.0; 2] }),
            Primitive::Instance { mesh, shape } => {
                let to_mesh = &self.to_mesh[*shape as usize];
                let local = Ray {
                    origin: to_mesh.transform_point3(ray.origin),
                    // Not normalised, so that distances mean the same in both spaces.
                    direction: to_mesh.transform_vector3(ray.direction),
                };
                self.meshes[*mesh as usize].intersect(&local, t_max, *shape)
            }
        }
    }
}

impl MeshAccel {
    fn new(mesh: &Mesh) -> Self {
        let triangles: Vec<([Vec3; 3], u32)> = (0..)
            .zip(&mesh.triangles)
            .map(|(i, t)| (t.map(|v| mesh.positions[v as usize]), i))
            .filter(|(vertices, _)| has_area(vertices))
            .collect();
        let bvh = build(&triangles.iter().map(|(v, _)| box_of(v)).collect::<Vec<_>>());
        let triangles = bvh.primitive_indices.iter().map(|&i| triangles[i as usize]).collect();
        Self { bvh, triangles }
    }

    fn intersect(&self, ray: &Ray, t_max: f32, shape: u32) -> Option<Hit> {
        let shear = Shear::new(ray.origin, ray.direction);
        let mut found = None;
        let mut nearest = obvhs_ray::RayHit::none();
        self.bvh.ray_traverse(query(ray, t_max), &mut nearest, |inner, id| {
            let (vertices, index) = &self.triangles[id];
            shear.intersect(vertices, inner.tmax / UNIT).map_or(f32::INFINITY, |(distance, barycentric)| {
                found = Some(Hit { distance, shape, triangle: *index, barycentric });
                distance * UNIT
            })
        });
        found
    }
}

/// Traversal skips boxes that end nearer than 1e-4, whatever the scene's size. Its distances are therefore in a unit of 2⁻⁴⁰:
/// that limit becomes 1e-16, and a power of two rounds nothing.
const UNIT: f32 = (1u64 << 40) as f32;

fn query(ray: &Ray, t_max: f32) -> obvhs_ray::Ray {
    let mut query = obvhs_ray::Ray::new(ray.origin.into(), ray.direction.into(), 0.0, t_max * UNIT);
    query.inv_direction *= UNIT;
    query
}

fn build(boxes: &[Aabb]) -> CwBvh {
    build_cwbvh(boxes, BvhBuildParams::medium_build(), &mut Duration::default())
}

fn has_area([a, b, c]: &[Vec3; 3]) -> bool {
    let n = (b.as_dvec3() - a.as_dvec3()).cross(c.as_dvec3() - a.as_dvec3());
    n.length_squared() > 0.0 && n.is_finite()
}

/// The box of a triangle, widened by the rounding of the box test, so that flat boxes are not missed.
fn box_of(vertices: &[Vec3; 3]) -> Aabb {
    widened(Aabb::from_points(&vertices.map(Vec3A::from)))
}

fn widened(b: Aabb) -> Aabb {
    let margin = b.min.abs().max(b.max.abs()) * 4.0 * f32::EPSILON;
    Aabb::new(b.min - margin, b.max + margin)
}

fn bounds_of(primitive: &Primitive, shapes: &[Shape], meshes: &[MeshAccel]) -> Aabb {
    match primitive {
        Primitive::Triangle { vertices, .. } => box_of(vertices),
        Primitive::Sphere { sphere, .. } => {
            let (c, r) = (Vec3A::from(sphere.center), Vec3A::splat(sphere.radius));
            widened(Aabb::new(c - r, c + r))
        }
        Primitive::Instance { mesh, shape } => {
            let mut b = Aabb::empty();
            for (_, index) in &meshes[*mesh as usize].triangles {
                for vertex in shapes[*shape as usize].triangle(*index) {
                    b.extend(vertex.into());
                }
            }
            widened(b)
        }
    }
}

/// Meshes that deserve a hierarchy of their own: used more than once, and big enough that storing them twice costs more.
fn shared_meshes(shapes: &[Shape]) -> HashSet<*const Mesh> {
    const SMALL: usize = 12;
    let mut seen = HashSet::new();
    let mut shared = HashSet::new();
    for shape in shapes {
        if let Geometry::Mesh { mesh, .. } = &shape.geometry
            && mesh.triangles.len() > SMALL
            && !seen.insert(Arc::as_ptr(mesh))
        {
            shared.insert(Arc::as_ptr(mesh));
        }
    }
    shared
}

fn world_to_mesh(shape: &Shape) -> Affine3A {
    match &shape.geometry {
        Geometry::Mesh { to_world, .. } => to_world.inverse(),
        Geometry::Sphere(_) => Affine3A::IDENTITY,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use crate::sampling::warp;

    fn soup(random: &mut Random, triangles: usize, size: f32) -> Mesh {
        let mut mesh = Mesh::default();
        for i in 0..triangles as u32 {
            let center = Vec3::new(random.next_f32(), random.next_f32(), random.next_f32());
            for _ in 0..3 {
                mesh.positions.push(center + size * (warp::square_to_sphere(random.next_2d())));
            }
            mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
        }
        mesh
    }

    /// HARD_CASES S7: the same hits as testing every primitive, for placed meshes, instances and spheres.
    #[test]
    fn hierarchy_equals_brute_force() {
        let mut random = Random::new(11, 0, 0);
        let shared = Arc::new(soup(&mut random, 40, 0.2));
        let turned = Affine3A::from_scale_rotation_translation(
            Vec3::new(0.5, -0.7, 1.2),
            glam::Quat::from_rotation_x(0.8),
            Vec3::new(0.3, 0.5, -0.2),
        );
        let shapes = [
            Shape::mesh(Arc::new(soup(&mut random, 300, 0.1)), Affine3A::IDENTITY, false),
            Shape::mesh(shared.clone(), Affine3A::from_translation(Vec3::splat(0.5)), false),
            Shape::mesh(shared, turned, false),
            Shape::sphere(Vec3::splat(0.4), 0.2, false),
        ];
        let accel = Accel::new(&shapes);
        assert!(!accel.meshes.is_empty());
        for i in 0..20_000 {
            let origin = 2.0 * warp::square_to_sphere(random.next_2d()) + Vec3::splat(0.5);
            let target = Vec3::new(random.next_f32(), random.next_f32(), random.next_f32());
            let mut direction = (target - origin).normalize();
            if i % 10 == 0 {
                direction[i % 3] = 0.0;
                direction = direction.normalize();
            }
            let ray = Ray { origin, direction };
            let shear = Shear::new(ray.origin, ray.direction);
            let brute = (accel.primitives.iter())
                .filter_map(|p| accel.hit(p, &ray, &shear, f32::INFINITY))
                .min_by(|a, b| a.distance.total_cmp(&b.distance));
            let fast = accel.intersect(&ray);
            assert_eq!(fast.map(|h| h.distance), brute.map(|h| h.distance), "{ray:?}");
            if let Some(hit) = brute {
                assert!(accel.occluded(&ray, hit.distance * 1.001));
                assert!(!accel.occluded(&ray, hit.distance * 0.999));
            }
        }
    }
}
