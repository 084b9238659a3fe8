//! Maps from uniform points of the unit square to other domains. The formulas are in [`lanes`], for any number of points at once.

use glam::{Vec2, Vec3};

/// Uniform on the unit disk.
pub fn square_to_disk(u: [f32; 2]) -> Vec2 {
    lanes::square_to_disk(u).into()
}

/// Cosine-distributed on the hemisphere around +z.
pub fn square_to_cosine_hemisphere(u: [f32; 2]) -> Vec3 {
    lanes::square_to_cosine_hemisphere(u).into()
}

/// Density of [`square_to_cosine_hemisphere`] w.r.t. solid angle.
pub fn square_to_cosine_hemisphere_pdf(w: Vec3) -> f32 {
    lanes::square_to_cosine_hemisphere_pdf(w.into())
}

/// Uniform on the unit sphere.
pub fn square_to_sphere(u: [f32; 2]) -> Vec3 {
    lanes::square_to_sphere(u).into()
}

/// Density of [`square_to_sphere`] w.r.t. solid angle.
pub fn square_to_sphere_pdf() -> f32 {
    1.0 / (4.0 * std::f32::consts::PI)
}

/// Uniform in the cone around +z whose half angle has one minus cosine `m` (that form keeps narrow cones exact).
pub fn square_to_cone(u: [f32; 2], m: f32) -> Vec3 {
    lanes::square_to_cone(u, m).into()
}

/// Density of [`square_to_cone`] w.r.t. solid angle, inside the cone.
pub fn square_to_cone_pdf(m: f32) -> f32 {
    lanes::square_to_cone_pdf(m)
}

/// Uniform barycentric coordinates (b₁, b₂) on a triangle.
pub fn square_to_triangle(u: [f32; 2]) -> [f32; 2] {
    lanes::square_to_triangle(u)
}

/// The maps in lanes.
pub mod lanes {
    use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

    use crate::math::lanes::functions::sin_cos;
    use crate::math::lanes::{Mask, Real, V3};

    /// Uniform on the unit disk (Shirley and Chiu 1997, concentric map).
    #[inline(always)]
    pub fn square_to_disk<R: Real>([u, v]: [R; 2]) -> [R; 2] {
        let (a, b) = (u * 2.0 - 1.0, v * 2.0 - 1.0);
        let across = a.abs().gt(b.abs());
        let (lesser, r) = (across.choose(b, a), across.choose(a, b));
        let turn = lesser / r * FRAC_PI_4;
        let (sin, cos) = sin_cos(across.choose(turn, turn.all(FRAC_PI_2) - turn));
        // The centre has no angle.
        let off_centre = !r.is(0.0);
        [(r * cos).only(off_centre), (r * sin).only(off_centre)]
    }

    /// Cosine-distributed on the hemisphere around +z.
    #[inline(always)]
    pub fn square_to_cosine_hemisphere<R: Real>(u: [R; 2]) -> V3<R> {
        let [x, y] = square_to_disk(u);
        V3::new(x, y, (x * x + y * y).rest().at_least(0.0).sqrt())
    }

    /// Density of [`square_to_cosine_hemisphere`] w.r.t. solid angle.
    #[inline(always)]
    pub fn square_to_cosine_hemisphere_pdf<R: Real>(w: V3<R>) -> R {
        w.z.at_least(0.0) * (1.0 / PI)
    }

    /// Uniform on the unit sphere.
    #[inline(always)]
    pub fn square_to_sphere<R: Real>([u, v]: [R; 2]) -> V3<R> {
        let z = (u * 2.0).rest();
        let r = (z * z).rest().at_least(0.0).sqrt();
        let (sin, cos) = sin_cos(v * TAU);
        V3::new(r * cos, r * sin, z)
    }

    /// Uniform in the cone around +z whose half angle has one minus cosine `m`.
    #[inline(always)]
    pub fn square_to_cone<R: Real>([u, v]: [R; 2], m: R) -> V3<R> {
        let h = u * m;
        let r = (h * (h.all(2.0) - h)).at_least(0.0).sqrt();
        let (sin, cos) = sin_cos(v * TAU);
        V3::new(r * cos, r * sin, h.rest())
    }

    /// Density of [`square_to_cone`] w.r.t. solid angle, inside the cone.
    #[inline(always)]
    pub fn square_to_cone_pdf<R: Real>(m: R) -> R {
        (m * TAU).inverse()
    }

    /// Uniform barycentric coordinates (b₁, b₂) on a triangle.
    #[inline(always)]
    pub fn square_to_triangle<R: Real>([u, v]: [R; 2]) -> [R; 2] {
        let root = u.sqrt();
        [root.rest(), v * root]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use std::f32::consts::TAU;

    /// The value that χ² exceeds with probability 0.002 (Wilson and Hilferty 1931): the five warps together raise a false alarm for
    /// 0.01 of new seeds (Šidák).
    fn limit(freedom: f64) -> f64 {
        let h = 2.0 / (9.0 * freedom);
        freedom * (1.0 - h + 2.877 * h.sqrt()).powi(3)
    }

    /// χ² of a warp on the sphere over 16 × 32 cylindrical cells against the integral of its density (16 × 16 midpoints a cell).
    fn check_sphere(sample: impl Fn([f32; 2]) -> Vec3, pdf: impl Fn(Vec3) -> f32) {
        let (nz, nphi, n) = (16usize, 32usize, 1_000_000usize);
        let mut counts = vec![0.0f64; nz * nphi];
        let mut random = Random::new(8, 0, 0);
        for _ in 0..n {
            let [x, y] = crate::math::cylindrical::to_square(sample(random.next_2d()));
            counts[(x * nz as f64) as usize * nphi + (y * nphi as f64) as usize] += 1.0;
        }
        let fine = 16;
        let (mut chi2, mut freedom, mut mass) = (0.0, -1.0f64, 0.0);
        for z in 0..nz {
            for phi in 0..nphi {
                let mut expected = 0.0;
                for i in 0..fine * fine {
                    let x = (z as f64 + ((i / fine) as f64 + 0.5) / fine as f64) / nz as f64;
                    let y = (phi as f64 + ((i % fine) as f64 + 0.5) / fine as f64) / nphi as f64;
                    expected += f64::from(pdf(crate::math::cylindrical::to_direction([x, y])));
                }
                let share = expected * 4.0 * std::f64::consts::PI / (nz * nphi * fine * fine) as f64;
                mass += share;
                if share * n as f64 > 5.0 {
                    chi2 += (counts[z * nphi + phi] - share * n as f64).powi(2) / (share * n as f64);
                    freedom += 1.0;
                }
            }
        }
        assert!((mass - 1.0).abs() < 1e-3, "mass {mass}");
        assert!(chi2 < limit(freedom), "χ² {chi2} over {freedom}, limit {}", limit(freedom));
    }

    /// χ² of 1e6 samples over 8 × 8 cells of equal measure; `place` takes a sample to the unit square so that it keeps areas.
    fn check_even(name: &str, place: impl Fn([f32; 2]) -> [f32; 2]) {
        let n = 1_000_000;
        let mut counts = [0.0f64; 64];
        let mut random = Random::new(8, 0, 0);
        for _ in 0..n {
            let [x, y] = place(random.next_2d()).map(|c| ((8.0 * c) as usize).min(7));
            counts[8 * x + y] += 1.0;
        }
        let expected = f64::from(n) / 64.0;
        let chi2: f64 = counts.iter().map(|count| (count - expected).powi(2) / expected).sum();
        assert!(chi2 < limit(63.0), "{name}: χ² {chi2}, limit {}", limit(63.0));
    }

    #[test]
    fn s01_sphere_warps_follow_their_densities() {
        check_sphere(square_to_sphere, |_| square_to_sphere_pdf());
        check_sphere(square_to_cosine_hemisphere, square_to_cosine_hemisphere_pdf);
        check_sphere(|u| square_to_cone(u, 0.75), |w| if w.z >= 0.25 { square_to_cone_pdf(0.75) } else { 0.0 });
    }

    /// Rings of equal area and sectors of the disk; of the triangle strips along one side and wedges from the corner across.
    /// Catches a warp that crowds the centre or a corner, and seams between the disk's quarters.
    #[test]
    fn s01_disk_and_triangle_are_uniform() {
        check_even("disk", |u| {
            let at = square_to_disk(u);
            assert!(at.length() <= 1.0 + 1e-6, "{at}");
            [at.length_squared(), (at.y.atan2(at.x) / TAU).rem_euclid(1.0)]
        });
        check_even("triangle", |u| {
            let [b1, b2] = square_to_triangle(u);
            let sum = b1 + b2;
            assert!(b1 >= 0.0 && b2 >= 0.0 && sum <= 1.0 + 1e-6, "{b1} {b2}");
            [sum * sum, if sum > 0.0 { b2 / sum } else { 0.0 }]
        });
    }
}
