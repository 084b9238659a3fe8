//! Scenes: the file model, its readers, and the immutable scene that is rendered.

pub mod build;
pub mod file;
pub mod plan;
pub mod readers;

use crate::camera::Camera;
use crate::geometry::{Accel, Ray, Shape, Surface};
use crate::lights::{BoundingSphere, Light, LightSet};
use crate::materials::Material;

/// A scene ready to be rendered. It never changes.
pub struct Scene {
    /// Name for reports.
    pub name: String,
    /// Columns and rows of the picture.
    pub size: [u32; 2],
    /// The camera.
    pub camera: Camera,
    /// All lights: first the emitting shapes, then the others.
    pub lights: LightSet,
    /// The sphere around all shapes.
    pub bounds: BoundingSphere,
    /// Ray queries.
    pub accel: Accel,
    /// All shapes.
    pub shapes: Vec<Shape>,
    shape_material: Vec<u32>,
    shape_light: Vec<Option<u32>>,
    materials: Vec<Material>,
}

impl Scene {
    /// The nearest surface on a ray.
    pub fn intersect(&self, ray: &Ray) -> Option<Surface> {
        let hit = self.accel.intersect(ray)?;
        Some(Surface::new(ray, &hit, &self.shapes[hit.shape as usize]))
    }

    /// The material at a surface.
    pub fn material(&self, surface: &Surface) -> &Material {
        &self.materials[self.shape_material[surface.shape as usize] as usize]
    }

    /// The light that a surface is, with its index in [`Scene::lights`].
    pub fn light_of(&self, surface: &Surface) -> Option<(usize, &Light)> {
        let index = self.shape_light[surface.shape as usize]? as usize;
        Some((index, &self.lights.lights[index]))
    }

    /// All materials, in the order of their names.
    pub fn materials(&self) -> &[Material] {
        &self.materials
    }
}
