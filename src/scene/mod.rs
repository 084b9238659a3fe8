//! Scenes: the file model, its readers, and the immutable scene that is rendered.

pub mod build;
mod dress;
pub mod effects;
pub mod file;
pub mod media;
mod names;
pub mod orbit;
pub mod overrides;
pub mod plan;
pub mod readers;
mod shadows;
pub mod sheet;
pub mod views;

use std::ops::Range;

use glam::Vec3;

use crate::base::random::Random;
use crate::camera::Camera;
use crate::geometry::surface::partials;
use crate::geometry::{Accel, Hit, Ray, Shape, Surface};
use crate::lights::{BoundingSphere, Light, LightSet};
use crate::materials::bump::Tangents;
use crate::materials::medium::MediumId;
use crate::materials::{Bsdf, Coordinates, Kind, Material, Plain, Variant};
use crate::math::lanes::LANES;
use crate::math::lanes::functions::atan2;
use effects::Needs;
use media::{Border, Filling};
pub use names::Names;

/// A scene ready to be rendered. It never changes.
pub struct Scene {
    /// Name for reports.
    pub name: String,
    /// Names of shapes and materials.
    pub names: Names,
    /// Columns and rows of the picture; with several cameras those of the [sheet] with the pictures of all.
    pub size: [u32; 2],
    /// The camera, or the first of several.
    pub camera: Camera,
    /// The other cameras whose pictures are on the sheet.
    further: Vec<Camera>,
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
    /// Whether a shape is opaque everywhere; see [`Scene::opacity`].
    shape_solid: Vec<bool>,
    materials: Vec<Material>,
    /// See [`Material::variant`].
    variants: Vec<Variant>,
    /// See [`Material::plain`].
    plains: Vec<Option<Plain>>,
    /// Whether any shape has holes or is only the border of a medium.
    has_masks: bool,
    media: Vec<Filling>,
    /// Whether a medium varies in space, so that shadow rays need random numbers.
    has_grids: bool,
    /// Whether a medium has light of its own.
    glows: bool,
    /// Whether a shape is opaque everywhere and no border of media.
    shape_stops: Vec<bool>,
    /// Media on both sides of each shape; none where the shape states none.
    shape_border: Vec<Option<Border>>,
    /// Medium into which each light emits.
    light_medium: Vec<Option<MediumId>>,
    /// Whether lights are hidden from the camera.
    pub hides_emitters: bool,
    /// The medium around the camera.
    pub camera_medium: Option<MediumId>,
    /// The effects that the tracers must be compiled for.
    needs: Needs,
    /// Whether any material has a bump or normal map, or a grain: whether it matters how ∂p/∂u lies.
    has_tangents: bool,
    /// Whether meshes are too large to stay in the caches, so that their vertices have to be brought near in time.
    is_large: bool,
    /// Whether anything reads pictures.
    has_pictures: bool,
}

/// Most holes and borders of media that a ray passes through; what has more of them stops it, or no light comes through.
const MOST_HOLES: usize = 1 << 12;

impl Scene {
    /// The ray on which the camera of a view sees a place of its picture, pixels, through a place of its lens. Where [lights are
    /// hidden](Scene::hides_emitters) it begins behind those that would be seen first, and so does the medium around the camera.
    pub fn camera_ray(&self, view: usize, film: [f32; 2], lens: [f32; 2]) -> Ray {
        self.past_hidden(self.camera_of(view).ray(film, lens))
    }

    /// A camera's ray from behind the lights that it would hit before anything else, where these are hidden from it.
    pub fn past_hidden(&self, mut ray: Ray) -> Ray {
        let most = if self.hides_emitters { MOST_HOLES } else { 0 };
        for _ in 0..most {
            match self.intersect(&ray) {
                Some(surface) if self.light_of(&surface).is_some() => ray = surface.leave(ray.direction),
                _ => break,
            }
        }
        ray
    }

    /// The nearest surface that stops a ray: a masked one does so with the probability of its opacity.
    #[inline]
    pub fn trace(&self, ray: &Ray, random: &mut Random) -> Option<Surface> {
        let mut surface = self.intersect(ray);
        self.pass_holes(ray, &mut surface, random);
        surface
    }

    /// Goes on from the nearest surface on a ray to the one that stops it.
    #[inline]
    fn pass_holes(&self, ray: &Ray, nearest: &mut Option<Surface>, random: &mut Random) {
        if !self.has_masks {
            return;
        }
        for _ in 0..MOST_HOLES {
            let Some(surface) = nearest else { return };
            let opacity = self.opacity(surface);
            if opacity >= 1.0 || random.next_f32() < opacity {
                return;
            }
            let before = surface.distance;
            *nearest = self.intersect(&surface.leave(ray.direction));
            nearest.iter_mut().for_each(|behind| behind.distance += before);
        }
    }

    /// Opacity of a surface: the probability that it stops a ray. Light is sampled on whole surfaces, so emitters have no holes.
    pub fn opacity(&self, surface: &Surface) -> f32 {
        let material = self.material(surface);
        if matches!(material.kind, Kind::Null) {
            return 0.0;
        }
        let mask = material.opacity.as_ref().filter(|_| self.light_of(surface).is_none());
        mask.map_or(1.0, |mask| mask.value(surface.uv).clamp(0.0, 1.0))
    }

    /// The nearest surface on a ray, holes or not.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<Surface> {
        Some(self.surface(ray, self.accel.intersect(ray)?))
    }

    /// Makes the nearest surfaces on rays with these hits, holes or not: those at `places`, one after the other, while the vertices and
    /// the vertex indices of later ones come near, and then what their textures hold.
    #[inline(always)]
    pub fn surfaces(&self, rays: &[Ray], hits: &[Option<Hit>], places: Range<usize>, surfaces: &mut [Surface]) {
        let sixteen = |first: usize| first.min(hits.len())..hits.len().min(first + LANES);
        for (first, made) in places.step_by(LANES).zip(surfaces.chunks_mut(LANES)) {
            let (now, next, later) = (sixteen(first), sixteen(first + LANES), sixteen(first + 2 * LANES));
            self.prefetch(hits, next, later);
            let (rays, hits) = (&rays[now.clone()], &hits[now]);
            Surface::all(rays, hits, &self.shapes, made);
            for ((ray, hit), surface) in rays.iter().zip(hits).zip(made) {
                let Some(hit) = hit else { continue };
                if self.has_tangents {
                    self.bend(surface, hit, -ray.direction);
                }
                if self.has_pictures {
                    self.material(surface).prefetch(surface.uv);
                }
            }
        }
    }

    /// Brings near the vertices of the `next` hits, and the vertex indices of `later` ones.
    #[inline(always)]
    fn prefetch(&self, hits: &[Option<Hit>], next: Range<usize>, later: Range<usize>) {
        if !self.is_large {
            return;
        }
        for hit in hits[later].iter().flatten() {
            self.shapes[hit.shape as usize].prefetch_indices(hit.triangle);
        }
        for hit in hits[next].iter().flatten() {
            self.shapes[hit.shape as usize].prefetch_vertices(hit.triangle);
        }
    }

    /// The surface at the hit of a ray.
    #[inline]
    fn surface(&self, ray: &Ray, hit: Hit) -> Surface {
        let mut surface = Surface::new(ray, &hit, &self.shapes[hit.shape as usize]);
        if self.has_tangents {
            self.bend(&mut surface, &hit, -ray.direction);
        }
        surface
    }

    /// Perturbs the shading frame by the material's bump or normal map, as seen from the unit direction `out`, and finds ∂p/∂u in it where the
    /// material has a grain.
    fn bend(&self, surface: &mut Surface, hit: &Hit, out: Vec3) {
        let material = self.material(surface);
        let (bump, has_grain) = (&material.bump, material.has_grain());
        if bump.is_none() && !has_grain {
            return;
        }
        let Some(partials) = partials(surface, hit, &self.shapes[hit.shape as usize]) else { return };
        let (geometric, normal, uv) = (surface.normal, surface.smooth, surface.uv);
        if let Some(turned) =
            bump.as_ref().and_then(|bump| bump.normal(&Tangents { geometric, normal, partials, uv, out }))
        {
            surface.shading = turned;
        }
        if has_grain {
            let along = surface.frame().to_local(partials[0].normalize_or_zero());
            surface.angle = atan2(along.y, along.x);
        }
    }

    /// How a surface scatters light.
    #[inline(always)]
    pub fn bsdf(&self, surface: &Surface) -> Bsdf<'_, f32> {
        self.material(surface).at(Coordinates { uv: surface.uv, angle: surface.angle })
    }

    /// The material at a surface.
    pub fn material(&self, surface: &Surface) -> &Material {
        &self.materials[self.shape_material[surface.shape as usize] as usize]
    }

    /// Index of a shape's material among [`Scene::materials`].
    pub fn material_of(&self, shape: u32) -> usize {
        self.shape_material[shape as usize] as usize
    }

    /// The material at a surface, if it is of the variant [`Variant::PLAIN`].
    #[inline(always)]
    pub fn plain_at(&self, surface: &Surface) -> Option<Plain> {
        let index = self.shape_material[surface.shape as usize] as usize;
        self.plains[index].or_else(|| self.materials[index].plain_at(surface.uv))
    }

    /// The variant of a surface's material.
    pub fn variant(&self, surface: &Surface) -> Variant {
        self.variants[self.shape_material[surface.shape as usize] as usize]
    }

    /// The light that a surface belongs to, with its index in [`Scene::lights`].
    pub fn light_of(&self, surface: &Surface) -> Option<(usize, &Light)> {
        let index = self.shape_light[surface.shape as usize]? as usize;
        Some((index, &self.lights.lights[index]))
    }

    /// The effects that the tracers must be compiled for.
    pub fn needs(&self) -> Needs {
        self.needs
    }

    /// All materials, in the order of their names.
    pub fn materials(&self) -> &[Material] {
        &self.materials
    }
}
