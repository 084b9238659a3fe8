//! Solids of a scene and distances to them, to place cameras and objects in free space.

use glam::{Quat, Vec3};

/// A solid, or a ball around one.
#[derive(Debug, Clone, Copy)]
pub enum Solid {
    /// A box with half extents, turned about its centre.
    Box {
        /// Centre.
        center: Vec3,
        /// Half extents along its own axes.
        half: Vec3,
        /// Its own axes to the world's.
        turn: Quat,
    },
    /// A ball.
    Ball {
        /// Centre.
        center: Vec3,
        /// Radius.
        radius: f32,
    },
}

impl Solid {
    /// Distance from `p`, negative inside.
    fn distance(&self, p: Vec3) -> f32 {
        match *self {
            Solid::Ball { center, radius } => (p - center).length() - radius,
            Solid::Box { center, half, turn } => {
                let beyond = (turn.conjugate() * (p - center)).abs() - half;
                beyond.max(Vec3::ZERO).length() + beyond.max_element().min(0.0)
            }
        }
    }
}

/// All solids of a scene.
#[derive(Debug, Clone, Default)]
pub struct Solids(Vec<Solid>);

impl Solids {
    /// Adds one.
    pub fn add(&mut self, solid: Solid) {
        self.0.push(solid);
    }

    /// Distance from `p` to the nearest solid, negative inside one, infinite where there is none.
    pub fn distance(&self, p: Vec3) -> f32 {
        self.0.iter().map(|s| s.distance(p)).fold(f32::INFINITY, f32::min)
    }

    /// Free distance from `p` along the unit vector `along`, at most `limit` (sphere tracing, Hart 1996).
    pub fn free_path(&self, p: Vec3, along: Vec3, limit: f32) -> f32 {
        let mut gone = 0.0;
        for _ in 0..256 {
            let step = self.distance(p + along * gone);
            if step < 1e-3 * limit || gone >= limit {
                break;
            }
            gone += step;
        }
        gone.min(limit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances() {
        let mut solids = Solids::default();
        assert_eq!(solids.distance(Vec3::ZERO), f32::INFINITY);
        solids.add(Solid::Box {
            center: Vec3::ZERO,
            half: Vec3::new(1.0, 2.0, 3.0),
            turn: Quat::from_rotation_y(std::f32::consts::FRAC_PI_2),
        });
        assert!((solids.distance(Vec3::new(4.0, 0.0, 0.0)) - 1.0).abs() < 1e-5);
        assert!((solids.distance(Vec3::ZERO) + 1.0).abs() < 1e-5);
        solids.add(Solid::Ball { center: Vec3::new(0.0, 10.0, 0.0), radius: 1.0 });
        assert!((solids.free_path(Vec3::new(0.0, 5.0, 0.0), Vec3::Y, 100.0) - 4.0).abs() < 0.2);
    }
}
