//! Maps of each method's guiding field at points of the picture, small enough for a page.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::{Deserialize, Serialize};

use crate::guiding::sample::field::GuideField;
use crate::scene::Scene;

/// Columns and rows of a map.
const SIDE: usize = 32;
/// Points along the longer side of the picture.
const POINTS: u32 = 24;

/// Pixels on a grid, and the distribution at the surface that each of them sees.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Guides {
    /// Columns (z) and rows (φ) of a map.
    pub side: usize,
    /// Pixels between points.
    pub step: u32,
    /// Column and row of each point's pixel.
    pub points: Vec<[u32; 2]>,
    /// Per point `side²` bytes in Base64, none where nothing guides. A byte b is a density relative to the uniform one:
    /// log₁₀ = b/255·6 − 3.
    pub maps: Vec<Option<String>>,
}

/// Looks up `field` at the surfaces that the pixels of a grid see.
pub fn sample(scene: &Scene, field: &GuideField) -> Guides {
    let [width, height] = scene.size;
    let step = width.max(height).div_ceil(POINTS).max(1);
    let rows = (step / 2..height).step_by(step as usize);
    let points: Vec<[u32; 2]> =
        rows.flat_map(|y| (step / 2..width).step_by(step as usize).map(move |x| [x, y])).collect();
    let maps = points.iter().map(|&point| map(scene, field, point)).collect();
    Guides { side: SIDE, step, points, maps }
}

fn map(scene: &Scene, field: &GuideField, [x, y]: [u32; 2]) -> Option<String> {
    let ray = scene.camera_ray(0, [x as f32 + 0.5, y as f32 + 0.5], [0.5; 2]);
    let surface = scene.intersect(&ray)?;
    if scene.material(&surface).is_delta() {
        return None;
    }
    let tree = field.at(surface.point, surface.normal_towards(-ray.direction))?.directions.as_ref()?;
    let byte = |relative: f64| ((relative.max(1e-9).log10() + 3.0) / 6.0 * 255.0).round().clamp(0.0, 255.0) as u8;
    Some(STANDARD.encode(tree.map(SIDE).into_iter().map(byte).collect::<Vec<u8>>()))
}
