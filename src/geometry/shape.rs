//! Shapes: a mesh with its placement, or a sphere.

use std::sync::Arc;

use glam::{Affine3A, DAffine3, Mat3, Vec2, Vec3};

use super::mesh::Mesh;
use super::sphere::Sphere;
use crate::base::processor::prefetch;
use crate::math::error_bound::gamma;
use crate::sampling::discrete::Discrete;

/// A surface placed in the world.
#[derive(Debug, Clone)]
pub struct Shape {
    /// The mesh or sphere.
    pub geometry: Geometry,
    /// Whether the front is the side opposite to the stored normals.
    pub flip_normals: bool,
    /// Rotation from the world to the frame of a sphere's texture coordinates, whose poles are ±z; none for the identity.
    pub turn: Option<Mat3>,
    /// Whether no ray meets it: all that is there is the light that it emits.
    pub unseen: bool,
}

/// The geometry of a shape.
#[derive(Debug, Clone)]
pub enum Geometry {
    /// A mesh, shared by every shape that uses it.
    Mesh {
        /// The mesh in its own coordinates.
        mesh: Arc<Mesh>,
        /// Mesh to world.
        to_world: Affine3A,
        /// Inverse transpose of the linear part: takes normals to world.
        normal_to_world: Mat3,
        /// −1 where the placement mirrors the mesh and so turns its winding around; otherwise 1.
        winding: f32,
        /// Maps the magnitudes of a point's coordinates to bounds of their errors; none where `to_world` is the
        /// identity: the mesh is in world coordinates.
        rounding: Option<Box<Affine3A>>,
    },
    /// A sphere in world coordinates.
    Sphere(Sphere),
}

impl Shape {
    /// A mesh placed by the invertible `to_world`.
    pub fn mesh(mesh: Arc<Mesh>, to_world: Affine3A, flip_normals: bool) -> Self {
        let normal_to_world = Mat3::from(to_world.matrix3).inverse().transpose();
        let winding = to_world.matrix3.determinant().signum();
        let rounding = (to_world != Affine3A::IDENTITY).then(|| Box::new(rounding(&to_world)));
        Self {
            geometry: Geometry::Mesh { mesh, to_world, normal_to_world, winding, rounding },
            flip_normals,
            turn: None,
            unseen: false,
        }
    }

    /// The same shape with a copy of the mesh in world coordinates, which saves a transform at every hit.
    pub fn in_world(self) -> Self {
        let Geometry::Mesh { mesh, to_world, normal_to_world, winding, rounding: Some(_) } = &self.geometry else {
            return self;
        };
        let placed = Mesh {
            positions: mesh.positions.iter().map(|&p| to_world.transform_point3(p)).collect(),
            normals: mesh.normals.iter().map(|&n| *normal_to_world * n).collect(),
            uvs: mesh.uvs.clone(),
            triangles: mesh.triangles.clone(),
        };
        let geometry = Geometry::Mesh {
            mesh: Arc::new(placed),
            to_world: Affine3A::IDENTITY,
            normal_to_world: Mat3::IDENTITY,
            winding: *winding,
            rounding: None,
        };
        Self { geometry, ..self }
    }

    /// 1, or −1 where the front is the side opposite to the stored normals.
    #[inline(always)]
    pub fn front(&self) -> f32 {
        if self.flip_normals { -1.0 } else { 1.0 }
    }

    /// A sphere.
    pub fn sphere(center: Vec3, radius: f32, flip_normals: bool) -> Self {
        Self { geometry: Geometry::Sphere(Sphere { center, radius }), flip_normals, turn: None, unseen: false }
    }

    /// The same sphere, with its texture coordinates rotated by the orthogonal matrix `to_world`.
    pub fn turned(self, to_world: Mat3) -> Self {
        Self { turn: (to_world != Mat3::IDENTITY).then(|| to_world.transpose()), ..self }
    }

    /// Brings the vertex indices of a triangle near, which will be needed soon.
    #[inline(always)]
    pub fn prefetch_indices(&self, triangle: u32) {
        if let Geometry::Mesh { mesh, .. } = &self.geometry
            && let Some(indices) = mesh.triangles.get(triangle as usize)
        {
            prefetch(indices);
        }
    }

    /// Brings the vertices of a triangle near, whose indices should be near already.
    #[inline(always)]
    pub fn prefetch_vertices(&self, triangle: u32) {
        let Geometry::Mesh { mesh, .. } = &self.geometry else { return };
        let Some(indices) = mesh.triangles.get(triangle as usize) else { return };
        for vertex in indices.map(|vertex| vertex as usize) {
            mesh.positions.get(vertex).into_iter().for_each(prefetch);
            mesh.normals.get(vertex).into_iter().for_each(prefetch);
            mesh.uvs.get(vertex).into_iter().for_each(prefetch);
        }
    }

    /// World positions of a triangle's vertices; the origin for a sphere, which has none.
    #[inline]
    pub fn triangle(&self, index: u32) -> [Vec3; 3] {
        match &self.geometry {
            Geometry::Mesh { mesh, to_world, rounding, .. } => {
                let corners = mesh.triangles[index as usize].map(|v| mesh.positions[v as usize]);
                if rounding.is_none() { corners } else { corners.map(|p| to_world.transform_point3(p)) }
            }
            Geometry::Sphere(_) => [Vec3::ZERO; 3],
        }
    }

    /// Bounds of the rounding errors of the world coordinates of a triangle's point; `magnitudes` are the sums of the absolute
    /// values of the terms that its coordinates were summed from.
    #[inline(always)]
    pub fn error(&self, magnitudes: Vec3) -> Vec3 {
        match &self.geometry {
            Geometry::Mesh { rounding: Some(rounding), .. } => rounding.transform_point3(magnitudes),
            _ => gamma(12) * magnitudes,
        }
    }

    /// Texture coordinates of a triangle's vertices: the mesh's, or the barycentric coordinates.
    pub fn triangle_uvs(&self, index: u32) -> [Vec2; 3] {
        match &self.geometry {
            Geometry::Mesh { mesh, .. } if !mesh.uvs.is_empty() => {
                mesh.triangles[index as usize].map(|v| mesh.uvs[v as usize])
            }
            _ => [Vec2::ZERO, Vec2::X, Vec2::Y],
        }
    }

    /// Area of each triangle (one entry for a sphere) as a distribution; its total is the area of the shape.
    pub fn area_distribution(&self) -> Discrete {
        match &self.geometry {
            Geometry::Mesh { mesh, .. } => Discrete::new((0..mesh.triangles.len() as u32).map(|i| {
                let [a, b, c] = self.triangle(i).map(Vec3::as_dvec3);
                0.5 * (b - a).cross(c - a).length()
            })),
            Geometry::Sphere(sphere) => Discrete::new([f64::from(sphere.area())]),
        }
    }
}

/// World to mesh in double precision: only its rounding to single precision needs a bound.
pub(super) fn to_mesh(to_world: &Affine3A) -> DAffine3 {
    to_world.as_daffine3().inverse()
}

/// Error bounds of a placed mesh, see [`Geometry::Mesh`]. Rays meet an instance in the coordinates of its mesh, so the errors that
/// count are those after a point has been taken there. With M the linear part of the placement, t its translation and N the inverse
/// of M, the point q = N·(p − t) is rounded relative to |N|·|p|, |N|·|t| and itself, which is at most the sum of both; and the
/// corners that p was made of relative to |M|·|q| (Pharr, Jakob, Humphreys 2023, §6.8). Seen in the world all are parts of
/// |M|·|N|·(|p| + |t|). That is far more than |p| where a large t cancels, and where a rotation carries the error of a large
/// coordinate into a small one.
///
/// Five roundings make p, six take it to the mesh, five are those of the corners; and eight are for the direction,
/// which is rounded four times, along a triangle twice as long as p is far from the origin.
fn rounding(to_world: &Affine3A) -> Affine3A {
    let placed = to_world.as_daffine3();
    let spread = placed.matrix3.abs() * to_mesh(to_world).matrix3.abs() * f64::from(gamma(24));
    DAffine3 { matrix3: spread, translation: spread * placed.translation.abs() }.as_affine3a()
}
