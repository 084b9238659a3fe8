//! Pictures of a guiding field: the distributions at a point, and where on the picture guiding helps.

use glam::Vec3;
use rayon::prelude::*;

use crate::guiding::cache::VoxelId;
use crate::guiding::sample::field::{Evidence, GuideField};
use crate::math::srgb;
use crate::picture::Image;
use crate::scene::Scene;

/// Columns (z) and rows (φ) of the map of a sphere; equal areas are equal solid angles.
const SIDE: usize = 256;
/// Pixels between maps.
const GAP: usize = 8;
/// Range of the colour scale of densities, in powers of ten below the largest.
const DECADES: f64 = 5.0;
/// Range of the colour scale of gains, in powers of ten below 1.
const GAIN_DECADES: f64 = 2.0;
/// Colour of places of which nothing is known.
const NOTHING: Vec3 = Vec3::splat(0.02);

/// Voxels at a point, and maps of their distributions.
pub struct Maps {
    /// A row for each voxel: Q_h, a gap, Q_r.
    pub image: Image,
    /// The voxels in the order of the rows.
    pub voxels: Vec<VoxelId>,
    /// The largest density in the picture relative to the uniform one.
    pub largest: f64,
}

/// Draws the distributions as counted and as sampled of every voxel at `point`; none where there is no voxel.
pub fn at(field: &GuideField, evidence: &Evidence, point: Vec3) -> Option<Maps> {
    let voxels = field.cache().find_all(point);
    let counted = |v: VoxelId| evidence.counted.get(v as usize).and_then(Option::as_ref);
    let sampled = |v: VoxelId| field.voxels().get(v as usize).and_then(|guide| guide.directions.as_ref());
    let maps: Vec<[Option<Vec<f64>>; 2]> =
        voxels.iter().map(|&v| [counted(v), sampled(v)].map(|tree| tree.map(|tree| tree.map(SIDE)))).collect();
    let largest = maps.iter().flatten().flatten().flatten().copied().fold(1.0, f64::max);
    let rows = maps.len();
    if rows == 0 {
        return None;
    }
    let (width, height) = (2 * SIDE + GAP, rows * (SIDE + GAP) - GAP);
    let mut pixels = vec![Vec3::ONE; width * height];
    for (row, maps) in maps.iter().enumerate() {
        for (column, map) in maps.iter().enumerate() {
            for i in 0..SIDE * SIDE {
                let (x, y) = (column * (SIDE + GAP) + i % SIDE, row * (SIDE + GAP) + i / SIDE);
                let shade = |map: &Vec<f64>| colour(1.0 + (map[i] / largest).log10() / DECADES);
                pixels[y * width + x] = map.as_ref().map_or(NOTHING, shade);
            }
        }
    }
    Some(Maps { image: Image { width, height, pixels }, voxels, largest })
}

/// Picture of the gain at the first surface of each pixel: coloured by how far guiding lowers the second moment of contributions
/// from there, dark where it does nothing, bright where it is a hundredth or less; nearly black where nothing is known.
pub fn gains(scene: &Scene, field: &GuideField, evidence: &Evidence) -> Image {
    let [width, height] = scene.size.map(|n| n as usize);
    let pixel = |i: usize| {
        let ray = scene.camera_ray(0, [(i % width) as f32 + 0.5, (i / width) as f32 + 0.5], [0.5; 2]);
        let voxel = scene
            .intersect(&ray)
            .and_then(|surface| field.cache().find(surface.point, surface.normal_towards(-ray.direction)));
        let gain = voxel.and_then(|v| evidence.gain.get(v as usize)).copied().unwrap_or(f32::NAN);
        if gain.is_finite() { colour(-f64::from(gain).log10() / GAIN_DECADES) } else { NOTHING }
    };
    Image { width, height, pixels: (0..width * height).into_par_iter().map(pixel).collect() }
}

/// A scale from dark blue over green to yellow, whose lightness rises evenly; linear RGB of a value in [0, 1].
fn colour(value: f64) -> Vec3 {
    const STOPS: [[f32; 3]; 5] =
        [[0.27, 0.0, 0.33], [0.23, 0.32, 0.55], [0.13, 0.57, 0.55], [0.37, 0.79, 0.38], [0.99, 0.91, 0.14]];
    let place = value.clamp(0.0, 1.0) * (STOPS.len() - 1) as f64;
    let i = (place as usize).min(STOPS.len() - 2);
    let srgb = Vec3::from(STOPS[i]).lerp(Vec3::from(STOPS[i + 1]), (place - i as f64) as f32);
    srgb.to_array().map(srgb::linear).into()
}
