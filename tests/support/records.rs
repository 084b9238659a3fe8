//! Records that a path or a photon of the given value would leave, and a tree as deep as they can make.

use fanal::guiding::record::{PathRecord, PhotonRecord, Radiance};
use fanal::guiding::tree::topology::{MAX_LEVEL, Topology};
use fanal::math::cylindrical;
use glam::Vec3;

/// Light that light sampling could not have found.
pub fn onward(onward: f32) -> Radiance {
    Radiance { emitted: 0.0, onward }
}

/// A path sample at a surface that faces +y.
pub fn path_at(point: Vec3, direction: Vec3, value: f32) -> PathRecord {
    PathRecord {
        direction,
        importance: 1.0,
        pdf: 1.0,
        radiance: onward(value),
        brought: onward(value),
        bsdf_share: 0.5,
        distance: 1.0,
        ..PathRecord::absorbed(point, Vec3::Y)
    }
}

/// A photon there.
pub fn photon_at(point: Vec3, direction: Vec3, power: f32) -> PhotonRecord {
    PhotonRecord { path: 0, point, direction, power, distance: 1.0, normal: Vec3::Y, caustic: false }
}

/// A chain of splits down to level 20, around the cell that contains `towards`.
pub fn chain(towards: Vec3) -> Topology {
    let [x, y] = cylindrical::to_cell(towards);
    let mut split = vec![true];
    for level in 1..=MAX_LEVEL {
        let bit = MAX_LEVEL - level;
        let chosen = ((x >> bit) & 1) + 2 * ((y >> bit) & 1);
        split.extend((0..4).map(|k| k == chosen && level < MAX_LEVEL));
    }
    Topology::from_split(&split).expect("one split per level")
}
