//! Sample shadow rays like those of a render, from which the hierarchy learns where to look for occluders first.

use glam::Vec3;
use rayon::prelude::*;

use super::Scene;
use crate::base::random::{Dimension, Random};
use crate::geometry::{Ray, Surface};
use crate::lights::seen::LightView;
use crate::materials::{BsdfSample, Transport};

/// Seed of the random numbers, so that the learned order is the same whenever the scene is.
const SEED: u64 = 0x05AA_D0E5;
/// Number of shadow rays that are learned from. Twice as many gain next to nothing more.
const SAMPLES: usize = 2500;
/// Camera paths per unit of parallel work.
const BLOCK: u64 = 32;
/// Blocks that are traced at a time, until there are shadow rays enough.
const ROUND: u64 = 8;
/// Rounds at most. Where paths seldom meet a point that a light shines on, shadow rays are few in the render too.
const MOST_ROUNDS: u64 = 16;
/// Segments of a path at most. Later vertices are few, and lie where earlier ones do.
const MOST_SEGMENTS: u32 = 8;
/// Vertices before roulette.
const SURE_VERTICES: u32 = 3;

impl Scene {
    /// Reorders the hierarchy so that it finds occluders soonest, where that pays. No query's answer changes. Paths have
    /// `max_depth` segments at most.
    pub(super) fn order_for_shadows(&mut self, max_depth: u32) {
        if self.accel.is_worth_ordering() {
            let samples = self.shadow_rays(SAMPLES, max_depth, SEED);
            self.accel.learn_order(&samples);
        }
    }

    /// Shadow rays, each with its maximum distance, from unguided camera paths of up to `max_depth` segments: `count` of them,
    /// fewer where few vertices are connected to a light. Paths pass through media as if they were not there.
    pub fn shadow_rays(&self, count: usize, max_depth: u32, seed: u64) -> Vec<(Ray, f32)> {
        let mut rays = Vec::new();
        if self.lights.lights.is_empty() {
            return rays;
        }
        for round in 0..MOST_ROUNDS {
            let blocks = (round * ROUND..(round + 1) * ROUND).into_par_iter();
            let blocks: Vec<Vec<(Ray, f32)>> =
                blocks.map(|block| self.shadows_of_block(block, max_depth, seed)).collect();
            rays.extend(blocks.into_iter().flatten());
            if rays.len() >= count {
                break;
            }
        }
        rays.truncate(count);
        rays
    }

    fn shadows_of_block(&self, block: u64, max_depth: u32, seed: u64) -> Vec<(Ray, f32)> {
        let mut rays = Vec::new();
        for path in block * BLOCK..(block + 1) * BLOCK {
            let mut random = Random::new(seed, 0, path);
            let [x, y] = random.at(Dimension::FILM).next_2d();
            let (column, row) = (x * self.size[0] as f32, y * self.size[1] as f32);
            let (view, within) = self.view_of(row as u32);
            let film = [column, row - (row as u32 - within) as f32];
            let ray = self.camera_ray(view, film, self.camera_of(view).lens(&random));
            self.shadows_of_path(ray, max_depth, &mut random, &mut rays);
        }
        rays
    }

    fn shadows_of_path(&self, mut ray: Ray, max_depth: u32, random: &mut Random, rays: &mut Vec<(Ray, f32)>) {
        let mut throughput = 1.0;
        // The last vertex is not connected to lights.
        for depth in 1..max_depth.min(MOST_SEGMENTS) {
            random.begin_vertex(depth);
            let Some(surface) = self.trace(&ray, &mut random.at(Dimension::SEGMENT)) else { return };
            let material = self.material(&surface);
            let wo = surface.frame().to_local(-ray.direction);
            if !material.is_delta() {
                rays.extend(self.shadow_of(&surface, wo, random));
            }
            let lobe = random.at(Dimension::LOBE).next_f32();
            let u = random.at(Dimension::DIRECTION).next_2d();
            let drawn = self.bsdf(&surface).sample(wo.into(), lobe, u, Transport::Radiance);
            let Some(sample): Option<BsdfSample> = drawn.into() else { return };
            throughput *= sample.weight.max_element();
            if depth >= SURE_VERTICES {
                let survival = throughput.clamp(0.05, 1.0);
                if random.at(Dimension::ROULETTE).next_f32() >= survival {
                    return;
                }
                throughput /= survival;
            }
            ray = surface.leave(surface.frame().to_world(sample.wi));
        }
    }

    /// The shadow ray to a light that is chosen and sampled as the path tracer does; none where the light contributes nothing.
    fn shadow_of(&self, surface: &Surface, wo: Vec3, random: &Random) -> Option<(Ray, f32)> {
        let (choice, u) = (self.lights.choice(random), random.at(Dimension::LIGHT_POINT).next_2d());
        let light = self.lights.sample(surface.point, choice, u, &LightView::PLAIN)?;
        let value: Vec3 = self.bsdf(surface).eval(wo.into(), surface.frame().to_local(light.wi).into()).into();
        let (ray, t_max) = surface.towards(light.wi, light.distance);
        (value != Vec3::ZERO && t_max > 0.0).then_some((ray, t_max))
    }
}

#[cfg(test)]
mod tests {
    use rayon::ThreadPoolBuilder;

    use super::*;
    use crate::geometry::Accel;

    fn scene(name: &str) -> Scene {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name);
        let loaded = crate::scene::readers::load(&folder).unwrap();
        Scene::build(&loaded, [64, 64]).unwrap()
    }

    fn bits(rays: &[(Ray, f32)]) -> Vec<[u32; 7]> {
        let bits = |(ray, end): &(Ray, f32)| {
            let ([a, b, c], [d, e, f]) = (ray.origin.to_array(), ray.direction.to_array());
            [a, b, c, d, e, f, *end].map(f32::to_bits)
        };
        rays.iter().map(bits).collect()
    }

    #[test]
    fn they_are_the_same_for_any_number_of_threads_and_order() {
        let mut scene = scene("lamp-room");
        let of_pool = |scene: &Scene, threads| {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            bits(&pool.install(|| scene.shadow_rays(3000, 20, 7)))
        };
        let rays = of_pool(&scene, 1);
        assert_eq!(rays.len(), 3000);
        assert!(rays == of_pool(&scene, 3));
        scene.accel = Accel::new(&scene.shapes);
        assert!(rays == of_pool(&scene, 2));
        assert!(rays != bits(&scene.shadow_rays(3000, 20, 8)));
    }

    #[test]
    fn only_vertices_before_the_last_have_them() {
        let scene = scene("cornell");
        assert!(scene.shadow_rays(10, 1, 0).is_empty());
        // One from each of the first vertices, all in the box.
        let rays = scene.shadow_rays(500, 2, 0);
        let [low, high] = scene.accel.bounds();
        assert!(rays.len() == 500 && rays.iter().all(|(_, end)| *end > 0.0 && *end <= low.distance(high)));
    }
}
