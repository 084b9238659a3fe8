//! Kept paths as a density of paths that is drawn from (Reibold 2018, §3.3).

use glam::{Vec2, Vec3};
use hashbrown::HashMap;
use rayon::prelude::*;

use super::kernel::{CUT, truncated_density, truncated_normal};
use super::neighbours::nearest;
use super::path::{CompletePath, Kind, Step};
use super::spatial::{InMedium, SpatialKernel};
use super::tiles::Tiles;
use super::transition::Transition;
use crate::sampling::discrete::Discrete;

/// A kept path as a mixture's component.
#[derive(Debug, Clone)]
struct Component {
    path: CompletePath,
    kernels: Kernels,
    /// Probability of drawing it.
    share: f64,
}

/// The kernels of a path.
#[derive(Debug, Clone, Default)]
struct Kernels {
    /// Of the first point, if that lies in a medium: the picture says only in which direction.
    first: Option<Box<SpatialKernel>>,
    /// Of each further one.
    further: Vec<Transition>,
}

/// A frozen mixture of kept paths.
#[derive(Debug, Clone, Default)]
pub struct PathGuide {
    components: Vec<Component>,
    kinds: HashMap<Kind, u32>,
    choice: Discrete,
    tiles: Tiles,
    /// Standard deviation of a place in the picture, pixels.
    deviation: f32,
}

/// A path to be made a component of a guide.
#[derive(Debug, Clone, Copy)]
pub struct Part<'a> {
    /// The path.
    pub path: &'a CompletePath,
    /// Its weight.
    pub weight: f64,
    /// Width of a pixel where the camera sees its first point.
    pub footprint: f32,
}

impl PathGuide {
    /// The guide of these paths for a picture of `size` pixels, in which a place is drawn no farther than `radius` pixels away.
    pub fn new(parts: &[Part], size: [u32; 2], radius: f32) -> Self {
        let mut kinds: HashMap<Kind, u32> = HashMap::new();
        let mut alike: Vec<Vec<u32>> = Vec::new();
        for (index, part) in (0..).zip(parts) {
            let kind = *kinds.entry(part.path.kind()).or_insert_with(|| {
                alike.push(Vec::new());
                alike.len() as u32 - 1
            });
            alike[kind as usize].push(index);
        }
        let choice = Discrete::new(parts.iter().map(|part| part.weight));
        let (mut kernels, mut places) = (vec![Kernels::default(); parts.len()], vec![([0.0; 2], 0); parts.len()]);
        for (kind, alike) in (0..).zip(&alike) {
            let paths: Vec<&CompletePath> = alike.iter().map(|&index| parts[index as usize].path).collect();
            let near = nearest(&paths);
            let made = |of: usize| kernels_of(of, &near[of], &paths, parts[alike[of] as usize].footprint);
            let made: Vec<Kernels> = (0..paths.len()).into_par_iter().map(made).collect();
            for (&index, made) in alike.iter().zip(made) {
                kernels[index as usize] = made;
                places[index as usize] = (parts[index as usize].path.film, kind);
            }
        }
        let component = |(index, (part, kernels)): (usize, (&Part, Kernels))| Component {
            path: part.path.clone(),
            kernels,
            share: choice.probability(index),
        };
        let components = parts.iter().zip(kernels).enumerate().map(component).collect();
        let tiles = Tiles::new(size, &places, radius);
        Self { components, kinds, choice, tiles, deviation: radius / CUT }
    }

    /// Whether there is nothing to draw from.
    pub fn is_empty(&self) -> bool {
        self.components.is_empty()
    }

    /// Number of kept paths.
    pub fn len(&self) -> usize {
        self.components.len()
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> usize {
        let of = |component: &Component| {
            let (path, kernels) = (&component.path, &component.kernels);
            let spilled = |spilled: bool, bytes: usize| if spilled { bytes } else { 0 };
            size_of::<Component>()
                + kernels.bytes()
                + spilled(path.points.spilled(), size_of_val(&path.points[..]))
                + spilled(path.steps.spilled(), size_of_val(&path.steps[..]))
        };
        self.components.iter().map(of).sum::<usize>() + self.tiles.bytes()
    }

    /// The kept path that `u` in [0, 1) draws; none where there is none.
    pub fn choose(&self, u: f64) -> Option<Chosen<'_>> {
        if self.is_empty() {
            return None;
        }
        let component = &self.components[self.choice.sample(u).0];
        Some(Chosen { component, deviation: self.deviation })
    }

    /// Density of the place in the picture that a component draws, per square pixel.
    fn film_density(&self, component: &Component, film: [f32; 2]) -> f32 {
        let offset = (Vec2::from(film) - Vec2::from(component.path.film)) / self.deviation;
        truncated_density(offset) / (self.deviation * self.deviation)
    }

    /// Whether any path may be drawn from this place in the picture.
    pub fn covers(&self, film: [f32; 2]) -> bool {
        let reaches = |&(_, index): &(u32, u32)| self.film_density(&self.components[index as usize], film) > 0.0;
        self.tiles.at(film).iter().any(reaches)
    }

    /// Density p_g of a path (eq. 8), see [the measure](super).
    pub fn density(&self, path: &CompletePath) -> f64 {
        let Some(&kind) = self.kinds.get(&path.kind()) else { return 0.0 };
        let of = |&(_, index): &(u32, u32)| {
            let component = &self.components[index as usize];
            let Kernels { first, further } = &component.kernels;
            let mut density = component.share * f64::from(self.film_density(component, path.film));
            if density > 0.0
                && let Some(first) = first
            {
                density *= first_density(first, path);
            }
            for (index, (kernel, step)) in further.iter().zip(&path.steps).enumerate() {
                if density == 0.0 {
                    return 0.0;
                }
                density *= step_density(kernel, step, path.points[index], path.points[index + 1]);
            }
            density
        };
        self.tiles.of_kind(path.film, kind).iter().map(of).sum()
    }
}

/// Density with which a step between two points is drawn: by the kernel, or by the BSDF, and then the distance to a medium's point by the kernel.
fn step_density(kernel: &Transition, &Step { direction, pdf, by_kernel, .. }: &Step, from: Vec3, to: Vec3) -> f64 {
    let drawn = if by_kernel > 0.0 { by_kernel * kernel.density(from, direction, to) } else { 0.0 };
    let pdf = (1.0 - by_kernel) * pdf;
    let otherwise = if pdf > 0.0 { pdf * kernel.distance_density(from, direction, to) } else { 0.0 };
    f64::from(drawn) + f64::from(otherwise)
}

/// Density of the distance to the first point of a path in the direction that the picture says.
fn first_density(kernel: &SpatialKernel, path: &CompletePath) -> f64 {
    let (from, Some(&to)) = (path.origin, path.points.first()) else { return 0.0 };
    f64::from(kernel.distance_density(from, (to - from).normalize_or(Vec3::Z), to))
}

/// The kernels of a path by its neighbours.
fn kernels_of(of: usize, near: &[u32], paths: &[&CompletePath], footprint: f32) -> Kernels {
    let path = paths[of];
    let alike = || near.iter().map(|&index| paths[index as usize]).chain([path]);
    let kernel = |at: usize| {
        let first = if at >= 2 { path.points[at - 2] } else { path.origin };
        let three = [first, path.points[at - 1], path.points[at]];
        let within = InMedium { before: path.in_medium(at - 1), at: path.in_medium(at) };
        Transition::fit(three, within, alike().map(|other| [other.points[at], other.points[at - 1]]), footprint)
    };
    let first = || {
        let (three, within) = ([path.origin, path.origin, path.points[0]], InMedium { before: false, at: true });
        SpatialKernel::fit(three, within, alike().map(|other| [other.points[0], other.origin]), footprint)
    };
    let first = path.in_medium(0).then(|| Box::new(first()));
    Kernels { first, further: (1..path.points.len()).map(kernel).collect() }
}

impl Kernels {
    /// Bytes of memory beside its own.
    fn bytes(&self) -> usize {
        let spatial = |kernel: &&Transition| matches!(kernel, Transition::Spatial(_));
        let boxed = usize::from(self.first.is_some()) + self.further.iter().filter(spatial).count();
        size_of_val(&self.further[..]) + boxed * size_of::<SpatialKernel>()
    }
}

/// The kept path around which a new one is drawn.
#[derive(Debug, Clone, Copy)]
pub struct Chosen<'a> {
    component: &'a Component,
    deviation: f32,
}

impl<'a> Chosen<'a> {
    /// The kept path.
    pub fn path(&self) -> &'a CompletePath {
        &self.component.path
    }

    /// A place in the picture, which may lie outside of it.
    pub fn film(&self, u: [f64; 2]) -> [f32; 2] {
        (Vec2::from(self.component.path.film) + truncated_normal(u) * self.deviation).into()
    }

    /// Kernel by which the step from point `index` is drawn; none where that leads to a light that is no point.
    pub fn kernel(&self, index: usize) -> Option<&'a Transition> {
        self.component.kernels.further.get(index)
    }

    /// Kernel by which the distance to the first point is drawn, if that lies in a medium.
    pub fn first(&self) -> Option<&'a SpatialKernel> {
        self.component.kernels.first.as_deref()
    }
}
