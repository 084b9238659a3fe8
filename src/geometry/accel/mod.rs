//! The bounding volume hierarchy over all shapes of a scene.
//!
//! Triangles of a mesh that one shape uses are placed in the world and stored in the top hierarchy. A mesh that several
//! shapes use has its own hierarchy, built once, and appears in the top one as an instance.
//!
//! The hierarchy is eight wide (Wald, Benthin, Boulos 2008; Dammertz, Hanika, Keller 2008): a node's eight boxes, or a leaf's
//! four triangles, are tested together. With or without vector instructions the hits are the same to the last bit, and of
//! hits at the same distance the first shape's first triangle is taken, so hits do not depend on the order of traversal.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod batch;
mod build;
mod cut;
mod node;
mod order;
mod portable;
mod query;
mod search;
mod split;
#[cfg(test)]
mod tests;
#[allow(unsafe_code, reason = "calls of functions for instructions that were found on this processor")]
mod traverse;

use std::sync::Arc;

use glam::{Affine3A, Vec3, Vec3A};
use hashbrown::{HashMap, HashSet};
use obvhs::aabb::Aabb;
use rayon::prelude::*;

pub use batch::{Pace, RayKind, Scratch, Way};

use super::Ray;
use super::mesh::Mesh;
use super::shape::{Geometry, Shape, to_mesh};
use super::sphere::Sphere;
use node::Triangle;
use query::Query;
use traverse::{Anything, Hierarchy, Kernel, NoOthers, Others, Shapes};

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

impl Hit {
    /// No hit: every hit precedes it.
    const NONE: Self = Self { distance: f32::MAX, shape: u32::MAX, triangle: u32::MAX, barycentric: [0.0; 2] };

    /// Replaces this hit by one that is nearer, or as near on an earlier primitive.
    #[inline(always)]
    fn replace(&mut self, hit: Self) {
        let earlier = || (hit.shape, hit.triangle) < (self.shape, self.triangle);
        if hit.distance < self.distance || hit.distance == self.distance && earlier() {
            *self = hit;
        }
    }

    fn found(self) -> Option<Self> {
        (self.shape != u32::MAX).then_some(self)
    }
}

/// A primitive that is not a triangle.
#[derive(Debug, Clone)]
enum Primitive {
    Sphere { sphere: Sphere, shape: u32 },
    Instance { mesh: u32, shape: u32, to_mesh: Affine3A },
}

/// Answers ray queries against all shapes of a scene.
pub struct Accel {
    hierarchy: Hierarchy,
    others: Placed,
    bounds: [Vec3; 2],
    /// How long batches take.
    pub pace: Pace,
}

/// Spheres and instances, and the hierarchies of instanced meshes in mesh coordinates.
struct Placed {
    primitives: Vec<Primitive>,
    meshes: Vec<Hierarchy>,
}

impl Accel {
    /// Builds the hierarchy. Triangles without area are left out: no ray can hit them.
    pub fn new(shapes: &[Shape]) -> Self {
        Self::with_kernel(shapes, Kernel::detect())
    }

    fn with_kernel(shapes: &[Shape], kernel: Kernel) -> Self {
        let shared = shared_meshes(shapes);
        let mut others = Placed { primitives: Vec::new(), meshes: Vec::new() };
        let mut slot: HashMap<*const Mesh, u32> = HashMap::new();
        let (mut triangles, mut boxes, mut other_boxes) = (Vec::new(), Vec::new(), Vec::new());
        for (shape, index) in shapes.iter().zip(0..).filter(|(shape, _)| !shape.unseen) {
            match &shape.geometry {
                Geometry::Sphere(sphere) if !is_sound(sphere) => {}
                Geometry::Sphere(sphere) => {
                    others.primitives.push(Primitive::Sphere { sphere: *sphere, shape: index });
                    other_boxes.push(sphere_box(sphere));
                }
                Geometry::Mesh { mesh, to_world, .. } if shared.contains(&Arc::as_ptr(mesh)) => {
                    let placed = instance_box(shape, mesh);
                    if placed.valid() {
                        let mesh = *slot.entry(Arc::as_ptr(mesh)).or_insert_with(|| {
                            others.meshes.push(mesh_hierarchy(mesh, kernel));
                            others.meshes.len() as u32 - 1
                        });
                        let to_mesh = to_mesh(to_world).as_affine3a();
                        others.primitives.push(Primitive::Instance { mesh, shape: index, to_mesh });
                        other_boxes.push(placed);
                    }
                }
                Geometry::Mesh { mesh, .. } => {
                    let sound = sound_triangles(mesh, |i| shape.triangle(i));
                    triangles.par_extend(sound.par_iter().map(|&i| (index, i)));
                    boxes.par_extend(sound.par_iter().map(|&i| box_of(&shape.triangle(i))));
                }
            }
        }
        boxes.extend(other_boxes);
        let bounds = boxes.iter().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], b| {
            [low.min(b.min.into()), high.max(b.max.into())]
        });
        let tree = build::build(&boxes, triangles.len(), |i| {
            let (shape, index) = triangles[i];
            Triangle { vertices: shapes[shape as usize].triangle(index), shape, index }
        });
        Self { hierarchy: Hierarchy::new(tree, kernel), others, bounds, pace: Pace::default() }
    }

    /// Corners of the box around everything; infinite and inverted for an empty scene.
    pub fn bounds(&self) -> [Vec3; 2] {
        self.bounds
    }

    /// Size in memory, bytes.
    pub fn bytes(&self) -> usize {
        let meshes: usize = self.others.meshes.iter().map(Hierarchy::bytes).sum();
        self.hierarchy.bytes() + size_of_val(self.others.primitives.as_slice()) + meshes
    }

    /// The nearest hit; of several at the same distance, that of the first shape's first triangle.
    #[inline(always)]
    pub fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let mut best = Hit::NONE;
        Query::with(ray, |query| self.hierarchy.closest(query, &mut best, &self.others))?;
        best.found()
    }

    /// Whether anything lies on the ray before distance `t_max`.
    #[inline(always)]
    pub fn occluded(&self, ray: &Ray, t_max: f32) -> bool {
        Query::with(ray, |query| self.hierarchy.occluded(query, t_max, &self.others, &mut Anything)).unwrap_or(false)
    }

    /// What lies on the ray before distance `t_max`, where the shapes that are `solid`, by their index, are walls.
    pub fn meets(&self, ray: &Ray, t_max: f32, solid: &[bool]) -> Met {
        let mut met = Met::Nothing;
        let mut stop = Shapes(|shape| {
            met = Met::by(solid, shape).max(met);
            met == Met::Wall
        });
        Query::with(ray, |query| self.hierarchy.occluded(query, t_max, &self.others, &mut stop));
        met
    }
}

/// What a shadow ray meets, from the least to the most.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Met {
    /// Nothing.
    #[default]
    Nothing,
    /// Shapes of which none is a wall.
    Veils,
    /// A wall, whatever else lies there.
    Wall,
}

impl Met {
    #[inline(always)]
    fn by(solid: &[bool], shape: u32) -> Self {
        if solid[shape as usize] { Self::Wall } else { Self::Veils }
    }
}

impl Others for Placed {
    fn closest(&self, index: usize, query: &Query, best: &mut Hit) {
        match self.primitives.get(index) {
            Some(Primitive::Sphere { sphere, shape }) => {
                // Up to and including the best distance, where the order of the primitives decides.
                let distance = sphere.intersect(query.origin, query.direction, best.distance.next_up());
                if let Some(distance) = distance {
                    best.replace(Hit { distance, shape: *shape, triangle: 0, barycentric: [0.0; 2] });
                }
            }
            Some(Primitive::Instance { mesh, shape, to_mesh }) => {
                // The best hit so far is on another shape: at equal distance it precedes all triangles of the mesh, or none.
                let known = if best.shape < *shape { INSTANCED - 1 } else { INSTANCED + 1 };
                let mut nearest = Hit { shape: known, ..*best };
                let mesh = &self.meshes[*mesh as usize];
                Query::with(&to_local(to_mesh, query), |local| mesh.closest(local, &mut nearest, &NoOthers));
                if nearest.shape == INSTANCED {
                    *best = Hit { shape: *shape, ..nearest };
                }
            }
            None => {}
        }
    }

    fn occluded(&self, index: usize, query: &Query, t_max: f32) -> bool {
        match self.primitives.get(index) {
            Some(Primitive::Sphere { sphere, .. }) => sphere.intersect(query.origin, query.direction, t_max).is_some(),
            Some(Primitive::Instance { mesh, to_mesh, .. }) => {
                let mesh = &self.meshes[*mesh as usize];
                let any = |local: &Query| mesh.occluded(local, t_max, &NoOthers, &mut Anything);
                Query::with(&to_local(to_mesh, query), any).unwrap_or(false)
            }
            None => false,
        }
    }

    fn shape(&self, index: usize) -> u32 {
        match self.primitives.get(index) {
            Some(Primitive::Sphere { shape, .. } | Primitive::Instance { shape, .. }) => *shape,
            None => u32::MAX,
        }
    }

    fn sphere(&self, index: usize) -> Option<&Sphere> {
        if let Some(Primitive::Sphere { sphere, .. }) = self.primitives.get(index) { Some(sphere) } else { None }
    }
}

/// The ray in mesh coordinates, its direction not normalised, so that distances mean the same in both spaces.
fn to_local(to_mesh: &Affine3A, query: &Query) -> Ray {
    Ray { origin: to_mesh.transform_point3(query.origin), direction: to_mesh.transform_vector3(query.direction) }
}

/// Shape index in the triangles of an instanced mesh; the instance has the real one.
const INSTANCED: u32 = 1;

/// The hierarchy of one mesh.
fn mesh_hierarchy(mesh: &Mesh, kernel: Kernel) -> Hierarchy {
    let corners = |i: u32| mesh.triangles[i as usize].map(|v| mesh.positions[v as usize]);
    let triangles = sound_triangles(mesh, corners);
    let boxes: Vec<Aabb> = triangles.par_iter().map(|&i| box_of(&corners(i))).collect();
    let tree = build::build(&boxes, triangles.len(), |i| {
        let index = triangles[i];
        Triangle { vertices: corners(index), shape: INSTANCED, index }
    });
    Hierarchy::new(tree, kernel)
}

/// Indices of the triangles of a mesh that have an area; `corners` returns a triangle's vertices.
fn sound_triangles(mesh: &Mesh, corners: impl Fn(u32) -> [Vec3; 3] + Sync) -> Vec<u32> {
    (0..mesh.triangles.len() as u32).into_par_iter().filter(|&i| has_area(&corners(i))).collect()
}

fn has_area([a, b, c]: &[Vec3; 3]) -> bool {
    let n = (b.as_dvec3() - a.as_dvec3()).cross(c.as_dvec3() - a.as_dvec3());
    n.length_squared() > 0.0 && n.is_finite()
}

/// The box of a triangle, widened by the rounding of the box test, so that rays do not miss flat boxes.
fn box_of(vertices: &[Vec3; 3]) -> Aabb {
    widened(Aabb::from_points(&vertices.map(Vec3A::from)))
}

fn widened(b: Aabb) -> Aabb {
    let margin = b.min.abs().max(b.max.abs()) * 4.0 * f32::EPSILON;
    Aabb::new(b.min - margin, b.max + margin)
}

fn is_sound(sphere: &Sphere) -> bool {
    sphere.center.is_finite() && sphere.radius.is_finite()
}

fn sphere_box(sphere: &Sphere) -> Aabb {
    let (c, r) = (Vec3A::from(sphere.center), Vec3A::splat(sphere.radius));
    widened(Aabb::new(c - r, c + r))
}

/// The box of an instance's triangles that have an area; invalid where there is none.
fn instance_box(shape: &Shape, mesh: &Mesh) -> Aabb {
    let corners = |i: u32| mesh.triangles[i as usize].map(|v| mesh.positions[v as usize]);
    let all = (0..mesh.triangles.len() as u32)
        .into_par_iter()
        .filter(|&i| has_area(&corners(i)))
        .map(|i| Aabb::from_points(&shape.triangle(i).map(Vec3A::from)))
        .reduce(Aabb::empty, |a, b| a.union(&b));
    let is_placed = matches!(shape.geometry, Geometry::Mesh { rounding: Some(_), .. });
    if !(is_placed && all.valid()) {
        return widened(all);
    }
    // Rays meet it in mesh coordinates; the rounding of that transform moves its corners.
    let margin = Vec3A::from(shape.error(Vec3::from(all.min.abs().max(all.max.abs()))));
    widened(Aabb::new(all.min - margin, all.max + margin))
}

/// Largest mesh, in triangles, that is stored again for each shape that uses it, however many do: an instance would
/// cost rays more.
pub const SELDOM_SHARED: usize = 12;

/// Meshes that get a hierarchy of their own: used more than once, and big enough that storing them twice costs more.
fn shared_meshes(shapes: &[Shape]) -> HashSet<*const Mesh> {
    let mut seen = HashSet::new();
    let mut shared = HashSet::new();
    for shape in shapes {
        if let Geometry::Mesh { mesh, .. } = &shape.geometry
            && mesh.triangles.len() > SELDOM_SHARED
            && !seen.insert(Arc::as_ptr(mesh))
        {
            shared.insert(Arc::as_ptr(mesh));
        }
    }
    shared
}
