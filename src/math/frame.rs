//! Orthonormal frames.

use glam::Vec3;

use super::lanes::{Real, V3};

/// A right-handed orthonormal frame in each lane; `n` is the local z axis.
#[derive(Debug, Clone, Copy)]
pub struct Frames<R> {
    /// Local x.
    pub s: V3<R>,
    /// Local y.
    pub t: V3<R>,
    /// Local z.
    pub n: V3<R>,
}

impl<R: Real> Frames<R> {
    /// Frames around the unit vectors `n`, without branches and without a singularity (Duff et al. 2017).
    #[inline(always)]
    pub fn new(n: V3<R>) -> Self {
        let one = n.z.all(1.0);
        let sign = one.with_sign(n.z);
        let a = -one / (sign + n.z);
        let b = n.x * n.y * a;
        let s = V3::new(one + sign * n.x * n.x * a, sign * b, -sign * n.x);
        Self { s, t: V3::new(b, sign + n.y * n.y * a, -n.y), n }
    }

    /// The same frame in every lane of what is `like` that.
    #[inline(always)]
    pub fn all(like: R, [s, t, n]: [Vec3; 3]) -> Self {
        let like = V3::splat(like);
        Self { s: like.all(s), t: like.all(t), n: like.all(n) }
    }

    /// World to local.
    #[inline(always)]
    pub fn to_local(&self, v: V3<R>) -> V3<R> {
        V3::new(self.s.dot(v), self.t.dot(v), self.n.dot(v))
    }

    /// Local to world.
    #[inline(always)]
    pub fn to_world(&self, v: V3<R>) -> V3<R> {
        self.s * v.x + self.t * v.y + self.n * v.z
    }
}

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
    /// A frame around the unit vector `n`, see [`Frames::new`].
    #[inline(always)]
    pub fn new(n: Vec3) -> Self {
        let Frames { s, t, n } = Frames::<f32>::new(n.into());
        Self { s: s.into(), t: t.into(), n: n.into() }
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
