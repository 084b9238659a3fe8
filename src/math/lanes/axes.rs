//! Orthonormal frames in lanes.

use glam::Vec3;

use super::{Real, V3};

/// Three unit vectors at right angles in each lane, right-handed.
#[derive(Debug, Clone, Copy)]
pub struct Axes<R> {
    /// Local x.
    pub s: V3<R>,
    /// Local y.
    pub t: V3<R>,
    /// Local z.
    pub n: V3<R>,
}

impl<R: Real> Axes<R> {
    /// Frames around the unit vectors `n`, without branches and without a singularity (Duff et al. 2017).
    #[inline(always)]
    pub fn around(n: V3<R>) -> Self {
        let sign = n.z.all(1.0).with_sign(n.z);
        let a = sign.all(-1.0) / (sign + n.z);
        let b = n.x * n.y * a;
        Self {
            s: V3::new(sign * n.x * n.x * a + 1.0, sign * b, -sign * n.x),
            t: V3::new(b, sign + n.y * n.y * a, -n.y),
            n,
        }
    }

    /// The same in every lane of what is `like` that.
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
