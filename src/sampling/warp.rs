//! Maps from uniform points of the unit square to other domains.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use glam::{Vec2, Vec3};

use crate::math::lanes::functions::sin_cos;

/// Uniform on the unit disk (Shirley and Chiu 1997, concentric map).
pub fn square_to_disk([u, v]: [f32; 2]) -> Vec2 {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    if a == 0.0 && b == 0.0 {
        return Vec2::ZERO;
    }
    let (r, phi) = if a.abs() > b.abs() { (a, FRAC_PI_4 * (b / a)) } else { (b, FRAC_PI_2 - FRAC_PI_4 * (a / b)) };
    let (sin, cos) = sin_cos(phi);
    Vec2::new(r * cos, r * sin)
}

/// Cosine-distributed on the hemisphere around +z.
pub fn square_to_cosine_hemisphere(u: [f32; 2]) -> Vec3 {
    let d = square_to_disk(u);
    Vec3::new(d.x, d.y, (1.0 - d.length_squared()).max(0.0).sqrt())
}

/// Density of [`square_to_cosine_hemisphere`] w.r.t. solid angle.
pub fn square_to_cosine_hemisphere_pdf(w: Vec3) -> f32 {
    w.z.max(0.0) * (1.0 / PI)
}

/// Uniform on the unit sphere.
pub fn square_to_sphere([u, v]: [f32; 2]) -> Vec3 {
    let z = 1.0 - 2.0 * u;
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = sin_cos(TAU * v);
    Vec3::new(r * cos, r * sin, z)
}

/// Density of [`square_to_sphere`] w.r.t. solid angle.
pub fn square_to_sphere_pdf() -> f32 {
    1.0 / (4.0 * PI)
}

/// Uniform in the cone around +z whose half angle has one minus cosine `m` (that form keeps narrow cones exact).
pub fn square_to_cone([u, v]: [f32; 2], m: f32) -> Vec3 {
    let h = u * m;
    let r = (h * (2.0 - h)).max(0.0).sqrt();
    let (sin, cos) = sin_cos(TAU * v);
    Vec3::new(r * cos, r * sin, 1.0 - h)
}

/// Density of [`square_to_cone`] w.r.t. solid angle, inside the cone.
pub fn square_to_cone_pdf(m: f32) -> f32 {
    1.0 / (TAU * m)
}

/// Uniform barycentric coordinates (b₁, b₂) on a triangle.
pub fn square_to_triangle([u, v]: [f32; 2]) -> [f32; 2] {
    let root = u.sqrt();
    [1.0 - root, v * root]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

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
