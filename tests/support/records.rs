//! Records that a path or a photon of the given value would leave.

use fanal::guiding::record::{PathRecord, PhotonRecord};
use glam::Vec3;

/// A path sample at a surface that faces +y.
pub fn path_at(point: Vec3, direction: Vec3, value: f32) -> PathRecord {
    PathRecord {
        point,
        direction,
        estimate: value,
        importance: 1.0,
        value,
        bsdf_share: 0.5,
        emitted: 0.0,
        light_ratio: 0.0,
        direct: 0.0,
        direct_share: 1.0,
        direct_ratio: 0.0,
        distance: 1.0,
        normal: Vec3::Y,
    }
}

/// A photon there.
pub fn photon_at(point: Vec3, direction: Vec3, power: f32) -> PhotonRecord {
    PhotonRecord { path: 0, point, direction, power, distance: 1.0, normal: Vec3::Y }
}
