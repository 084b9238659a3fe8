//! The Gaussian from which a vertex is drawn, given the vertex before (Reibold 2018, §3.4).
//!
//! Each vertex of a kept path has a plane through it, at a right angle to the segment on which the path arrives. Of the neighbours' points,
//! projected into the planes of a vertex and of the one before, mean and covariance are taken (eq. 10), and of these the distribution of
//! the one given the other (eq. 11 and 12). What is drawn in the plane is a direction; its density is that of the point times the squared
//! distance over the cosine.

use std::f32::consts::TAU;

use glam::{Mat2, Vec2, Vec3};

use crate::math::Frame;

/// Standard deviations at which Gaussians are cut (Reibold 2018, §3.1).
pub const CUT: f32 = 3.33;
/// Fewest paths, the kept one included, of which a covariance says anything: two means, two slopes each, and one more.
pub(super) const FEWEST: usize = 5;

/// A two-dimensional standard normal variable within [`CUT`], of two uniform numbers in [0, 1).
pub fn truncated_normal(u: [f64; 2]) -> Vec2 {
    let radius = (-2.0 * (-u[0] * inside()).ln_1p()).sqrt().min(f64::from(CUT) * (1.0 - 1e-6));
    let (sin, cos) = (std::f64::consts::TAU * u[1]).sin_cos();
    Vec2::new((radius * cos) as f32, (radius * sin) as f32)
}

/// The part of a two-dimensional Gaussian that is not cut off: 1 − exp(−c²/2).
fn inside() -> f64 {
    -(-0.5 * f64::from(CUT) * f64::from(CUT)).exp_m1()
}

/// A standard normal variable of two uniform numbers in [0, 1) (Box and Muller 1958).
pub fn normal(u: [f64; 2]) -> f32 {
    ((-2.0 * (-u[0]).ln_1p()).sqrt() * (std::f64::consts::TAU * u[1]).cos()) as f32
}

/// Density of [`normal`].
pub fn normal_density(at: f32) -> f32 {
    (-0.5 * at * at).exp() / TAU.sqrt()
}

/// Density of [`truncated_normal`].
pub fn truncated_density(at: Vec2) -> f32 {
    let squared = at.length_squared();
    if squared <= CUT * CUT { (-0.5 * squared).exp() / (TAU * inside() as f32) } else { 0.0 }
}

/// The plane of a vertex.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    pub through: Vec3,
    pub frame: Frame,
}

impl Plane {
    /// The plane of the point that a path reached from `before`.
    pub fn new(before: Vec3, through: Vec3) -> Self {
        Self { through, frame: Frame::new((through - before).normalize_or(Vec3::Z)) }
    }

    pub fn project(&self, point: Vec3) -> Vec2 {
        let to = point - self.through;
        Vec2::new(to.dot(self.frame.s), to.dot(self.frame.t))
    }
}

/// The distribution of a vertex given the one before.
#[derive(Debug, Clone, Copy)]
pub struct Kernel {
    before: Plane,
    at: Plane,
    /// Σ₁₂ Σ₂₂⁻¹.
    slope: Mat2,
    /// μ₁ − Σ₁₂ Σ₂₂⁻¹ μ₂.
    offset: Vec2,
    /// Square root of the covariance, its inverse, and the determinant of that.
    root: Mat2,
    inverse: Mat2,
    determinant: f32,
}

/// Sums of coordinates in the planes of two vertices.
#[derive(Default)]
struct Moments {
    count: f32,
    means: [Vec2; 2],
    /// Σ₁₁, Σ₁₂, Σ₂₂ times the count.
    spread: [Mat2; 3],
}

fn outer(a: Vec2, b: Vec2) -> Mat2 {
    Mat2::from_cols(a * b.x, a * b.y)
}

impl Moments {
    fn of(pairs: &[[Vec2; 2]]) -> Self {
        let count = pairs.len() as f32;
        let mean = |i: usize| pairs.iter().map(|pair| pair[i]).sum::<Vec2>() / count;
        let means = [mean(0), mean(1)];
        let mut spread = [Mat2::ZERO; 3];
        for pair in pairs {
            let [a, b] = [pair[0] - means[0], pair[1] - means[1]];
            spread[0] += outer(a, a);
            spread[1] += outer(a, b);
            spread[2] += outer(b, b);
        }
        Self { count, means, spread }
    }
}

impl Kernel {
    /// The kernel at the last of three consecutive points of a kept path, the first of which may be the camera, by the `pairs` of
    /// corresponding last and middle points of its neighbours and itself. No standard deviation is less than `footprint`.
    pub fn fit([first, middle, last]: [Vec3; 3], pairs: impl Iterator<Item = [Vec3; 2]>, footprint: f32) -> Self {
        let (before, at) = (Plane::new(first, middle), Plane::new(middle, last));
        let pairs: Vec<[Vec2; 2]> = pairs.map(|[last, middle]| [at.project(last), before.project(middle)]).collect();
        let Moments { count, means, spread: [last, both, middle] } = Moments::of(&pairs);
        let least = footprint.max(1e-6 * (at.through - before.through).length()).max(f32::MIN_POSITIVE.sqrt());
        let (slope, covariance) = if pairs.len() < FEWEST {
            // Of too few points only their distance from one another is known.
            let variance = 0.5 * (last.x_axis.x + last.y_axis.y) / count.max(1.0);
            (Mat2::ZERO, Mat2::from_diagonal(Vec2::splat(variance)))
        } else {
            // Points that coincide say nothing of a slope, so the middle ones are spread by a part of the least width.
            let widened = middle + Mat2::from_diagonal(Vec2::splat(0.25 * count * least * least));
            let slope = both * widened.inverse();
            (slope, (last - slope * both.transpose()) * (1.0 / (count - 3.0)))
        };
        let usable = slope.is_finite() && covariance.is_finite() && means.iter().all(|mean| mean.is_finite());
        let (slope, covariance) = if usable { (slope, covariance) } else { (Mat2::ZERO, Mat2::ZERO) };
        let offset = if usable { means[0] - slope * means[1] } else { Vec2::ZERO };
        let (axes, variances) = eigen(covariance);
        let widths = variances.max(Vec2::ZERO).map(f32::sqrt).max(Vec2::splat(least));
        let turned = |widths: Vec2| axes * Mat2::from_diagonal(widths) * axes.transpose();
        let (root, inverse) = (turned(widths), turned(widths.recip()));
        Self { before, at, slope, offset, root, inverse, determinant: 1.0 / (widths.x * widths.y) }
    }

    /// Mean in the plane given the point before.
    fn mean(&self, from: Vec3) -> Vec2 {
        self.offset + self.slope * self.before.project(from)
    }

    /// The unit direction from the point before that uniform numbers in [0, 1) draw; none where it leads nowhere.
    pub fn sample(&self, from: Vec3, u: [f64; 2]) -> Option<Vec3> {
        let Plane { through, frame } = self.at;
        let at = self.mean(from) + self.root * truncated_normal(u);
        (through + frame.s * at.x + frame.t * at.y - from).try_normalize()
    }

    /// Density of [`Kernel::sample`] w.r.t. solid angle.
    pub fn density(&self, from: Vec3, direction: Vec3) -> f32 {
        let Plane { through, frame } = self.at;
        let cos = direction.dot(frame.n);
        let distance = (through - from).dot(frame.n) / cos;
        // Also where it is no number.
        if !(distance > 0.0 && distance.is_finite()) {
            return 0.0;
        }
        let at = self.inverse * (self.at.project(from + direction * distance) - self.mean(from));
        let density = truncated_density(at);
        if density > 0.0 { density * self.determinant * distance * distance / cos.abs() } else { 0.0 }
    }
}

/// Eigenvectors, as columns, and eigenvalues of a symmetric matrix.
pub(super) fn eigen(matrix: Mat2) -> (Mat2, Vec2) {
    let (a, b, c) = (matrix.x_axis.x, 0.5 * (matrix.x_axis.y + matrix.y_axis.x), matrix.y_axis.y);
    let (mean, half) = (0.5 * (a + c), 0.5 * (a - c));
    let radius = half.hypot(b);
    let (sin, cos) = (0.5 * b.atan2(half)).sin_cos();
    (Mat2::from_cols(Vec2::new(cos, sin), Vec2::new(-sin, cos)), Vec2::new(mean + radius, mean - radius))
}
