//! Ray-box and ray-triangle tests in plain Rust, with the same result to the last bit as those with vector instructions.

use super::Hit;
use super::node::{LANES, Node, Packet, WIDTH};
use super::query::Slabs;
use crate::geometry::triangle::Shear;

/// The children of a node whose boxes the ray meets at a distance in [0, `t_max`], one bit each; `distances` gets the distances.
pub fn boxes(node: &Node, slabs: &Slabs, t_max: f32, distances: &mut [f32; WIDTH]) -> u32 {
    let [mut near, mut far] = [[0.0; WIDTH], [t_max; WIDTH]];
    for axis in 0..3 {
        let origin = slabs.origin[axis];
        let (nearer, farther) = (&node.planes[slabs.nearer_plane[axis]], &node.planes[slabs.farther_plane[axis]]);
        for lane in 0..WIDTH {
            // Not f32::max, but what a vector instruction does: NaN leaves the old value.
            let distance = (origin - nearer[lane]) * slabs.nearer[axis];
            near[lane] = if distance > near[lane] { distance } else { near[lane] };
            let distance = (origin - farther[lane]) * slabs.farther[axis];
            far[lane] = if distance < far[lane] { distance } else { far[lane] };
        }
    }
    *distances = near;
    (0..WIDTH).filter(|&lane| near[lane] <= far[lane]).fold(0, |mask, lane| mask | 1 << lane)
}

/// Replaces `best` by the nearest hit of the packet that precedes it.
pub fn closest(packet: &Packet, shear: &Shear, best: &mut Hit) {
    for lane in 0..LANES {
        // Up to and including the best distance, where the order of the primitives decides.
        if let Some((distance, barycentric)) = shear.intersect(&packet.triangle(lane), best.distance.next_up()) {
            best.replace(Hit { distance, shape: packet.shapes[lane], triangle: packet.triangles[lane], barycentric });
        }
    }
}

/// Whether the ray meets a triangle of the packet before `t_max`.
pub fn occluded(packet: &Packet, shear: &Shear, t_max: f32) -> bool {
    (0..LANES).any(|lane| shear.intersect(&packet.triangle(lane), t_max).is_some())
}

/// The triangles of the packet that the ray meets before `t_max`, one bit each.
pub fn occluders(packet: &Packet, shear: &Shear, t_max: f32) -> u32 {
    let meets = |lane: &usize| shear.intersect(&packet.triangle(*lane), t_max).is_some();
    (0..LANES).filter(meets).fold(0, |mask, lane| mask | 1 << lane)
}
