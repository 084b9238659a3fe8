//! What paths leave behind for learning: plain records, merged later in a fixed order.

use glam::Vec3;

/// A camera path's sampled direction at one vertex, with what the rest of the path brought back along it.
#[derive(Debug, Clone, Copy)]
pub struct PathRecord {
    /// World position of the vertex.
    pub point: Vec3,
    /// Unit direction that was sampled, away from the vertex.
    pub direction: Vec3,
    /// Channel mean of f·|cos θ|·L̂ / p, radiance. Here L̂ holds light that was hit as it enters the picture, weighted against
    /// light sampling: whoever chooses between BSDF and guide by what trees learn alone, light that is hit left out, gives up
    /// the BSDF samples that a glossy surface needs for a large lamp.
    pub estimate: f32,
    /// Channel mean of the path's throughput before the vertex over the value of its pixel: what the picture sees of the
    /// estimate.
    pub importance: f32,
    /// V for the radiance target, √V for second moments (see [`Target`](super::leaves::Target)): as a root, so that squares
    /// cannot overflow.
    pub value: f32,
    /// Channel mean of the radiance that light sampling sent back from the vertex along the path.
    pub direct: f32,
    /// Part of the mixture density that is the BSDF's, in [0, 1].
    pub bsdf_share: f32,
    /// Channel mean of the BSDF's value without the cosine, sr⁻¹.
    pub bsdf: f32,
    /// Distance to the next vertex; infinite for the background.
    pub distance: f32,
    /// Shading normal at the vertex, on the side that the path arrived at.
    pub normal: Vec3,
    /// Shading normal at the next vertex, on the side of this one; zero for the background.
    pub next_normal: Vec3,
}

/// A photon that arrived at a surface.
#[derive(Debug, Clone, Copy)]
pub struct PhotonRecord {
    /// Number of the light path among those of its chunk.
    pub path: u32,
    /// World position of the surface point.
    pub point: Vec3,
    /// Unit direction towards where the photon came from.
    pub direction: Vec3,
    /// Channel mean of the photon's power, W.
    pub power: f32,
    /// Distance to the previous vertex; infinite from a light at infinity.
    pub distance: f32,
    /// Shading normal at the point, on the side that the photon arrived at.
    pub normal: Vec3,
    /// Normal at the previous vertex, on the side that the photon left on.
    pub previous_normal: Vec3,
}
