//! Orthonormal frames.

use glam::Vec3;

/// A right-handed orthonormal frame; `n` is the local z axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Local x.
    pub s: Vec3,
    /// Local y.
    pub t: Vec3,
    /// Local z.
    pub n: Vec3,
}

impl Frame {
    /// A frame around the unit vector `n`, without branches and without a singularity (Duff et al. 2017).
    pub fn new(n: Vec3) -> Self {
        let sign = 1.0f32.copysign(n.z);
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        Self {
            s: Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
            t: Vec3::new(b, sign + n.y * n.y * a, -n.y),
            n,
        }
    }

    /// World to local.
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        Vec3::new(self.s.dot(v), self.t.dot(v), self.n.dot(v))
    }

    /// Local to world.
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.s * v.x + self.t * v.y + self.n * v.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    #[test]
    fn orthonormal_for_every_normal() {
        let mut random = Random::new(1, 0, 0);
        let poles = [Vec3::Z, Vec3::NEG_Z, Vec3::new(1e-5, 0.0, -1.0).normalize()];
        let others = (0..1000).map(|_| {
            let v = Vec3::new(random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(-1.0, 1.0));
            v.normalize_or(Vec3::Z)
        });
        for n in poles.into_iter().chain(others) {
            let f = Frame::new(n);
            assert!(f.s.dot(f.t).abs() < 1e-5 && f.s.dot(n).abs() < 1e-5 && f.t.dot(n).abs() < 1e-5);
            assert!((f.s.cross(f.t) - n).length() < 1e-5);
            assert!((f.to_world(f.to_local(Vec3::new(0.3, -0.2, 0.9))) - Vec3::new(0.3, -0.2, 0.9)).length() < 1e-5);
        }
    }
}
