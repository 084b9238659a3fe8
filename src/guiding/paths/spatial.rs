//! The Gaussian of a vertex where it or the one before lies in a medium (Reibold 2018, §3.3 and §3.4).
//!
//! A vertex in a medium has three coordinates in its frame: two in its [plane](super::kernel) and the depth along the segment on which the kept
//! path arrives. Mean and covariance are those of all three, given the vertex before, so what is drawn is a point. Where a BSDF has chosen the
//! direction, or the place in the picture has, the point's distance is drawn from the same Gaussian on that ray.
//!
//! Densities of points are with respect to solid angle times distance, that is of the volume times the squared distance.

use glam::{Mat2, Mat3, Vec2, Vec3};

use super::kernel::{FEWEST, Plane, eigen, normal, normal_density, truncated_density, truncated_normal};

/// Whether two consecutive vertices lie in media, and not on surfaces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct InMedium {
    /// The one before.
    pub before: bool,
    /// The one that is drawn.
    pub at: bool,
}

/// What a kernel draws.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reach {
    /// Unit direction from the vertex before.
    pub direction: Vec3,
    /// Distance from there, of a point in a medium.
    pub distance: Option<f32>,
}

/// The distribution of a vertex given the one before, where at least one of them lies in a medium.
#[derive(Debug, Clone, Copy)]
pub struct SpatialKernel {
    within: InMedium,
    before: Plane,
    at: Plane,
    /// Σ₁₂ Σ₂₂⁻¹.
    slope: Mat3,
    /// μ₁ − Σ₁₂ Σ₂₂⁻¹ μ₂.
    offset: Vec3,
    /// Of the two coordinates in the plane: square root of the covariance, its inverse, and the determinant of that.
    root: Mat2,
    inverse: Mat2,
    determinant: f32,
    /// Of the depth given those: its mean for each unit of them, and its standard deviation.
    lean: Vec2,
    deviation: f32,
}

/// Coordinates of a point in the frame of a vertex; on a surface the depth does not count.
fn coordinates(plane: &Plane, point: Vec3, in_medium: bool) -> Vec3 {
    let depth = if in_medium { (point - plane.through).dot(plane.frame.n) } else { 0.0 };
    plane.project(point).extend(depth)
}

fn outer(a: Vec3, b: Vec3) -> Mat3 {
    Mat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// Mean of the points of a vertex given those of the one before, and their covariance.
struct Regression {
    slope: Mat3,
    offset: Vec3,
    covariance: Mat3,
    /// How many numbers say something of the covariance.
    freedom: f32,
}

impl Regression {
    /// Of pairs of coordinates of a vertex and of the one before. No standard deviation of the latter is less than half of `least`.
    fn new(pairs: &[[Vec3; 2]], within: InMedium, least: f32) -> Self {
        let count = pairs.len() as f32;
        let mean = |i: usize| pairs.iter().map(|pair| pair[i]).sum::<Vec3>() / count;
        let means = [mean(0), mean(1)];
        let (mut at, mut both, mut before) = (Mat3::ZERO, Mat3::ZERO, Mat3::ZERO);
        for pair in pairs {
            let [a, b] = [pair[0] - means[0], pair[1] - means[1]];
            at += outer(a, a);
            both += outer(a, b);
            before += outer(b, b);
        }
        let depth = usize::from(within.before);
        if pairs.len() < FEWEST + depth {
            // Of too few points only their distances from one another are known, across the ray and along it.
            let across = 0.5 * (at.x_axis.x + at.y_axis.y) / count.max(1.0);
            let covariance = Mat3::from_diagonal(Vec3::new(across, across, at.z_axis.z / count.max(1.0)));
            return Self { slope: Mat3::ZERO, offset: means[0], covariance, freedom: 0.0 }.usable(means[0]);
        }
        // As for planes: points that coincide say nothing of a slope.
        let widened = before + Mat3::from_diagonal(Vec3::splat(0.25 * count * least * least));
        let slope = both * widened.inverse();
        let freedom = count - 3.0 - depth as f32;
        let covariance = (at - slope * both.transpose()) * (1.0 / freedom);
        Self { slope, offset: means[0] - slope * means[1], covariance, freedom }.usable(means[0])
    }

    /// The same if it is finite; otherwise the mean alone, or the kept point itself.
    fn usable(self, mean: Vec3) -> Self {
        if self.slope.is_finite() && self.offset.is_finite() && self.covariance.is_finite() {
            return self;
        }
        let offset = if mean.is_finite() { mean } else { Vec3::ZERO };
        Self { slope: Mat3::ZERO, offset, covariance: Mat3::ZERO, freedom: 0.0 }
    }
}

impl SpatialKernel {
    /// As [`Kernel::fit`](super::kernel::Kernel::fit).
    pub fn fit(
        [first, middle, last]: [Vec3; 3],
        within: InMedium,
        pairs: impl Iterator<Item = [Vec3; 2]>,
        footprint: f32,
    ) -> Self {
        let (before, at) = (Plane::new(first, middle), Plane::new(middle, last));
        let least = footprint.max(1e-6 * (at.through - before.through).length()).max(f32::MIN_POSITIVE.sqrt());
        let pairs: Vec<[Vec3; 2]> = pairs
            .map(|[last, middle]| [coordinates(&at, last, within.at), coordinates(&before, middle, within.before)])
            .collect();
        let Regression { slope, offset, covariance, freedom } = Regression::new(&pairs, within, least);
        let (axes, variances) = eigen(Mat2::from_cols(covariance.x_axis.truncate(), covariance.y_axis.truncate()));
        let widths = variances.max(Vec2::ZERO).map(f32::sqrt).max(Vec2::splat(least));
        let turned = |widths: Vec2| axes * Mat2::from_diagonal(widths) * axes.transpose();
        let (root, inverse) = (turned(widths), turned(widths.recip()));
        let (mut lean, mut variance) = (Vec2::ZERO, covariance.z_axis.z);
        // Two more numbers are estimated.
        if freedom > 2.0 {
            let both = covariance.z_axis.truncate();
            lean = inverse * (inverse * both);
            variance = (variance - lean.dot(both)) * (freedom / (freedom - 2.0));
        }
        let deviation = variance.max(0.0).sqrt().max(least);
        let usable = lean.is_finite() && deviation.is_finite();
        let (lean, deviation) = if usable { (lean, deviation) } else { (Vec2::ZERO, least) };
        let determinant = 1.0 / (widths.x * widths.y);
        Self { within, before, at, slope, offset, root, inverse, determinant, lean, deviation }
    }

    /// Mean given the point before.
    fn mean(&self, from: Vec3) -> Vec3 {
        self.offset + self.slope * coordinates(&self.before, from, self.within.before)
    }

    /// What uniform numbers in [0, 1) draw from the point before; none where it leads nowhere.
    pub fn sample(&self, from: Vec3, across: [f64; 2], along: [f64; 2]) -> Option<Reach> {
        let (mean, Plane { through, frame }) = (self.mean(from), self.at);
        let off = self.root * truncated_normal(across);
        let depth = if self.within.at { mean.z + self.lean.dot(off) + self.deviation * normal(along) } else { 0.0 };
        let at = mean.truncate() + off;
        let to = through + frame.s * at.x + frame.t * at.y + frame.n * depth - from;
        let direction = to.try_normalize()?;
        Some(Reach { direction, distance: self.within.at.then(|| to.length()) })
    }

    /// Density of [`SpatialKernel::sample`]: of the direction towards `to`, w.r.t. solid angle; if it lies in a medium, of the point `to`.
    pub fn density(&self, from: Vec3, direction: Vec3, to: Vec3) -> f32 {
        let (mean, Plane { through, frame }) = (self.mean(from), self.at);
        if self.within.at {
            let off = coordinates(&self.at, to, true) - mean;
            let across = truncated_density(self.inverse * off.truncate());
            if across == 0.0 {
                return 0.0;
            }
            let depth = normal_density((off.z - self.lean.dot(off.truncate())) / self.deviation) / self.deviation;
            // Where points coincide the product may be larger than any number on its way, and at its end.
            let factors = [across, self.determinant, depth, from.distance_squared(to)];
            return (factors.map(f64::from).iter().product::<f64>() as f32).min(f32::MAX);
        }
        let cos = direction.dot(frame.n);
        let distance = (through - from).dot(frame.n) / cos;
        // Also where it is no number.
        if !(distance > 0.0 && distance.is_finite()) {
            return 0.0;
        }
        let at = self.inverse * (self.at.project(from + direction * distance) - mean.truncate());
        let density = truncated_density(at);
        if density > 0.0 { density * self.determinant * distance * distance / cos.abs() } else { 0.0 }
    }

    /// Mean and standard deviation of the distance on a ray.
    fn on_ray(&self, from: Vec3, direction: Vec3) -> [f32; 2] {
        let Plane { frame, .. } = self.at;
        // Coordinates in which the Gaussian is a standard one.
        let standard = |v: Vec3| {
            let across = v.truncate();
            (self.inverse * across).extend((v.z - self.lean.dot(across)) / self.deviation)
        };
        let start = standard(coordinates(&self.at, from, true) - self.mean(from));
        let step = standard(Vec3::new(direction.dot(frame.s), direction.dot(frame.t), direction.dot(frame.n)));
        let squared = step.length_squared();
        [-start.dot(step) / squared, squared.sqrt().recip()]
    }

    /// The distance of a point in a medium in a direction that is given; none where it leads nowhere.
    pub fn distance(&self, from: Vec3, direction: Vec3, u: [f64; 2]) -> Option<f32> {
        let [mean, deviation] = self.on_ray(from, direction);
        let distance = mean + deviation * normal(u);
        (self.within.at && distance > 0.0 && distance.is_finite()).then_some(distance)
    }

    /// Density of [`SpatialKernel::distance`]; 1 on a surface, which is where the direction leads to.
    pub fn distance_density(&self, from: Vec3, direction: Vec3, to: Vec3) -> f32 {
        if !self.within.at {
            return 1.0;
        }
        let [mean, deviation] = self.on_ray(from, direction);
        let density = normal_density(((to - from).dot(direction) - mean) / deviation) / deviation;
        if density.is_finite() { density } else { 0.0 }
    }
}
