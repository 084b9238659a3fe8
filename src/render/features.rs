//! Features for a denoiser: what each pixel shows, with mirrors and glass looked through.
//!
//! A camera ray is followed over delta lobes to the first surface that scatters otherwise. Where a surface both mirrors and lets
//! through, the ray takes the way that more of the light takes, always the same, since features must have no noise; a pane of glass
//! is looked through, and a lake mirrors where it is seen at a grazing angle. Each pixel is the mean of [`SAMPLES`] camera samples,
//! more of them than the picture may have: their rays are cheap beside a denoiser.

use glam::Vec3;
use rayon::prelude::*;

use super::camera::{CameraSample, camera_ray};
use super::settings::RenderSettings;
use crate::base::Result;
use crate::base::random::{Dimension, Random};
use crate::film::{Features, PixelFilter};
use crate::geometry::Ray;
use crate::materials::{BsdfSample, Transport};
use crate::scene::Scene;

/// Camera samples that features are averaged over.
pub const SAMPLES: u32 = 16;
/// Surfaces on a ray, the last included: a way through three glasses has twelve before it.
const MOST_SURFACES: u32 = 13;

/// Features of the pixels of the window that `settings` render.
///
/// # Errors
/// [`Error::Options`](crate::base::Error::Options) for a filter that cannot be.
pub fn features(scene: &Scene, settings: &RenderSettings) -> Result<Features> {
    let filter = PixelFilter::new(settings.filter)?;
    let window = settings.window(scene.size);
    let pixel = |pixel: usize| {
        let place = window.place(pixel as u64);
        let sample = |number: u32| {
            let sample = CameraSample { place, number: u64::from(number), sequences_from: Some(0) };
            let (ray, mut random) = camera_ray(scene, settings, &filter, sample);
            shown(scene, ray, &mut random)
        };
        let sum = (0..SAMPLES).map(sample).fold([Vec3::ZERO; 2], |[a, n], [albedo, normal]| [a + albedo, n + normal]);
        sum.map(|sum| sum / SAMPLES as f32)
    };
    let (albedo, normal) =
        (0..window.pixels() as usize).into_par_iter().with_min_len(256).map(pixel).map(<(_, _)>::from).unzip();
    Ok(Features { albedo, normal })
}

/// Albedo and normal of what a ray shows; zero where that is the background.
fn shown(scene: &Scene, mut ray: Ray, random: &mut Random) -> [Vec3; 2] {
    let mut carried = Vec3::ONE;
    for depth in 1.. {
        random.begin_vertex(depth);
        let Some(surface) = scene.trace(&ray, &mut random.at(Dimension::SEGMENT)) else { break };
        let (bsdf, frame) = (scene.bsdf(&surface), surface.frame());
        let wo = frame.to_local(-ray.direction);
        // The middle of the numbers that choose among two lobes falls to the likelier one. Importance is not scaled by refraction.
        let onward = bsdf.sample(wo.into(), 0.5, [0.5; 2], Transport::Importance);
        match Option::<BsdfSample>::from(onward).filter(|onward| onward.delta && depth < MOST_SURFACES) {
            Some(onward) => {
                carried *= onward.weight;
                ray = surface.leave(frame.to_world(onward.wi));
            }
            None => {
                let normal = if wo.z < 0.0 { -surface.shading } else { surface.shading };
                return [carried * Vec3::from(bsdf.albedo()), normal];
            }
        }
    }
    [Vec3::ZERO; 2]
}
