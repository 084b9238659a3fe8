//! Microfacet distributions, isotropic or with a grain, their shadowing, and sampling of visible normals.

use std::f32::consts::{FRAC_1_PI, PI, TAU};

use crate::math::lanes::functions::{acos, exp, ln, pow, sin_cos};
use crate::math::lanes::{Mask, Real, V3, lanes_of};
use crate::math::special::{erf, erf_inv};

/// Below this roughness a surface is treated as perfectly smooth: its lobe is narrower than single precision resolves.
pub const SMOOTH: f32 = 1e-4;

/// Slope distribution of the facets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// Gaussian slopes (Beckmann and Spizzichino 1963).
    Beckmann,
    /// Long tails (Trowbridge and Reitz 1975; Walter et al. 2007).
    Ggx,
}

/// The grain of facets that are not as rough along one direction as across it, such as those of brushed metal. Slopes along the grain are those
/// of isotropic facets times `aspect`, across it divided by it (Heitz 2014, §5.3), so that the product of both roughnesses stays α².
#[derive(Debug, Clone, Copy)]
pub struct Grain<R = f32> {
    /// Roughness along the grain over α, above 0.
    pub aspect: R,
    /// Cosine of the angle from the local x axis to the grain.
    pub cos: R,
    /// Sine of that angle.
    pub sin: R,
}

lanes_of!(Grain { aspect, cos, sin });

impl Grain {
    /// A grain with this aspect at `angle` from the local x axis, radians.
    pub fn new(aspect: f32, angle: f32) -> Self {
        let (sin, cos) = sin_cos(angle);
        Self { aspect, cos, sin }
    }

    /// The grain turned by an angle in radians.
    #[must_use]
    pub fn turned(self, angle: f32) -> Self {
        let (sin, cos) = sin_cos(angle);
        Self { cos: self.cos * cos - self.sin * sin, sin: self.sin * cos + self.cos * sin, ..self }
    }
}

impl<R: Real> Grain<R> {
    /// `w` with x along the grain.
    #[inline(always)]
    fn along(&self, w: V3<R>) -> V3<R> {
        V3::new(w.x * self.cos + w.y * self.sin, w.y * self.cos - w.x * self.sin, w.z)
    }

    /// The inverse of [`Grain::along`].
    #[inline(always)]
    fn back(&self, w: V3<R>) -> V3<R> {
        V3::new(w.x * self.cos - w.y * self.sin, w.x * self.sin + w.y * self.cos, w.z)
    }
}

/// A microfacet distribution with roughness `alpha`.
#[derive(Debug, Clone, Copy)]
pub struct Microfacets<R = f32> {
    /// Slope distribution.
    pub shape: Shape,
    /// Roughness, at least [`SMOOTH`]; with a grain the geometric mean of both.
    pub alpha: R,
    /// The grain; none where facets are as rough in all directions.
    pub grain: Option<Grain<R>>,
}

lanes_of!(Microfacets { alpha, grain } same { shape });

impl Microfacets {
    /// Facets that are as rough in all directions.
    pub fn even(shape: Shape, alpha: f32) -> Self {
        Self { shape, alpha, grain: None }
    }

    /// These facets with a grain, as far as they stay rough enough in all directions.
    #[must_use]
    pub fn with_grain(self, grain: Option<Grain>) -> Self {
        let least = SMOOTH / self.alpha;
        Self { grain: grain.map(|grain| Grain { aspect: grain.aspect.clamp(least, least.recip()), ..grain }), ..self }
    }

    /// Number of the discrete options, which all lanes have in common; below 4.
    pub(super) fn option(&self) -> usize {
        self.shape as usize + 2 * usize::from(self.grain.is_some())
    }

    /// Facets with this part of the roughness.
    pub fn scaled(self, part: f32) -> Self {
        Self { alpha: (self.alpha * part).max(SMOOTH), ..self }
    }
}

impl<R: Real> Microfacets<R> {
    /// Density of facet normals D(h), sr⁻¹; ∫ D cos θ dω = 1.
    #[inline(always)]
    pub fn density(&self, h: V3<R>) -> R {
        // With a grain sin² stands for that of the normal whose slope isotropic facets would have.
        let even = match &self.grain {
            None => h,
            Some(grain) => {
                let h = grain.along(h);
                V3::new(h.x / grain.aspect, h.y * grain.aspect, h.z)
            }
        };
        let (cos2, sin2, alpha2) = (h.z * h.z, even.x * even.x + even.y * even.y, self.alpha * self.alpha);
        let density = match self.shape {
            Shape::Beckmann => {
                let falloff = exp(-sin2 / (cos2 * alpha2));
                // At grazing angles cos⁴ vanishes too, but later.
                (falloff * FRAC_1_PI / (alpha2 * cos2 * cos2)).only(falloff.above(0.0))
            }
            Shape::Ggx => {
                let spread = sin2 + alpha2 * cos2;
                alpha2 * FRAC_1_PI / (spread * spread)
            }
        };
        density.only(h.z.above(0.0))
    }

    /// Share of the facets facing `w` that others do not hide (Smith 1967), as the reflected light uses it. For Beckmann this is
    /// Walter's fit (Walter et al. 2007, eq. 27), off by up to 0.35 % from the integral: other renderers use it, so pictures
    /// of the same scene would differ by half a percent in places without it.
    #[inline(always)]
    pub fn shadowing(&self, w: V3<R>, h: V3<R>) -> R {
        if self.shape == Shape::Ggx {
            return self.visible_share(w, h);
        }
        let a = w.z.abs() / self.stretched_sine(w);
        let fit = (a * 2.181 + 3.535) * a / ((a * 2.577 + 2.276) * a + 1.0);
        a.below(1.6).choose(fit, a.all(1.0)).only(faces(w, h))
    }

    /// Smith's shadowing without approximation (Heitz 2014, eq. 72 and 83): sampling visible normals inverts this form, so its
    /// density must be this one.
    #[inline(always)]
    pub(super) fn visible_share(&self, w: V3<R>, h: V3<R>) -> R {
        // 1 / (α·tan θ) is cos/sine; the sine of a direction along the normal is 0, and nothing hides a facet from there.
        let (cos, sine) = (w.z.abs(), self.stretched_sine(w));
        let share = match self.shape {
            Shape::Beckmann => {
                let a = cos / sine;
                let hidden = exp(-a * a) / (a * PI.sqrt()) - erf(a).rest();
                (hidden.at_least(0.0) * 0.5 + 1.0).inverse()
            }
            Shape::Ggx => cos * 2.0 / (cos + (cos * cos + sine * sine).sqrt()),
        };
        share.only(faces(w, h))
    }

    /// `w` with x along the grain, and that stretched by it: what α·tan θ is of is its roughness seen from `w`.
    #[inline(always)]
    fn stretched(&self, w: V3<R>) -> V3<R> {
        match &self.grain {
            None => w,
            Some(grain) => {
                let w = grain.along(w);
                V3::new(w.x * grain.aspect, w.y / grain.aspect, w.z)
            }
        }
    }

    /// α·sin θ.
    #[inline(always)]
    fn stretched_sine(&self, w: V3<R>) -> R {
        let w = self.stretched(w);
        self.alpha * (w.x * w.x + w.y * w.y).sqrt()
    }

    /// Density of [`Microfacets::sample_visible`] w.r.t. the solid angle of the facet normal (Heitz and d'Eon 2014, eq. 2).
    #[inline(always)]
    pub fn visible_density(&self, w: V3<R>, h: V3<R>) -> R {
        self.visible_part(self.density(h), w, h)
    }

    /// [`Microfacets::visible_density`] where D(h) is known.
    #[inline(always)]
    pub(super) fn visible_part(&self, density: R, w: V3<R>, h: V3<R>) -> R {
        (density * self.visible_share(w, h) * w.dot(h).at_least(0.0) / w.z).only(w.z.above(0.0))
    }

    /// A facet normal visible from `w` (in front).
    ///
    /// Stretches `w` to unit roughness, samples slopes there, rotates and unstretches (Heitz and d'Eon 2014).
    #[inline(always)]
    pub fn sample_visible(&self, w: V3<R>, u: [R; 2]) -> V3<R> {
        let w = self.stretched(w);
        let stretched = V3::new(self.alpha * w.x, self.alpha * w.y, w.z).normalize();
        let h = match self.shape {
            Shape::Beckmann => self.sample_visible_beckmann(stretched, u),
            Shape::Ggx => self.sample_visible_ggx(stretched, u),
        };
        match &self.grain {
            None => h,
            Some(grain) => grain.back(V3::new(h.x * grain.aspect, h.y / grain.aspect, h.z).normalize()),
        }
    }

    #[inline(always)]
    fn sample_visible_beckmann(&self, w: V3<R>, u: [R; 2]) -> V3<R> {
        let sin = (w.x * w.x + w.y * w.y).sqrt();
        let (aslant, one) = (sin.above(0.0), sin.all(1.0));
        let (cos_phi, sin_phi) = (aslant.choose(w.x / sin, one), (w.y / sin).only(aslant));
        let [sx, sy] = beckmann_slopes(w.z, u);
        let slope_x = (cos_phi * sx - sin_phi * sy) * self.alpha;
        let slope_y = (sin_phi * sx + cos_phi * sy) * self.alpha;
        V3::new(-slope_x, -slope_y, one).normalize()
    }

    /// Projected-disk sampling of the GGX visible normals (Heitz 2018).
    #[inline(always)]
    fn sample_visible_ggx(&self, w: V3<R>, [u, v]: [R; 2]) -> V3<R> {
        let length2 = w.x * w.x + w.y * w.y;
        let (zero, one) = (u.all(0.0), u.all(1.0));
        let across = V3::new(-w.y, w.x, zero) / length2.sqrt();
        let t1 = V3::choose(length2.above(0.0), across, V3::new(one, zero, zero));
        let t2 = w.cross(t1);
        let (r, (sin, cos)) = (u.sqrt(), sin_cos(v * TAU));
        let p1 = r * cos;
        let s = (w.z + 1.0) * 0.5;
        let p2 = s.rest() * (p1 * p1).rest().at_least(0.0).sqrt() + s * r * sin;
        let n = t1 * p1 + t2 * p2 + w * ((p1 * p1).rest() - p2 * p2).at_least(0.0).sqrt();
        V3::new(self.alpha * n.x, self.alpha * n.y, n.z.at_least(1e-6)).normalize()
    }
}

/// Where `w` is on the same side of the facet with normal `h` as of the surface.
#[inline(always)]
fn faces<R: Real>(w: V3<R>, h: V3<R>) -> R::Mask {
    (w.dot(h) * w.z).above(0.0)
}

/// Slopes of the facets visible under the angle with cosine `cos`, for Beckmann with unit roughness.
#[inline(always)]
fn beckmann_slopes<R: Real>(cos: R, u: [R; 2]) -> [R; 2] {
    let upright = cos.above(0.999_9);
    let mut slopes = [cos.all(0.0); 2];
    if upright.any() {
        slopes = beckmann_slopes_from_above(u);
    }
    if (!upright).any() {
        let aslant = beckmann_slopes_aslant(cos, u, !upright);
        slopes = [upright.choose(slopes[0], aslant[0]), upright.choose(slopes[1], aslant[1])];
    }
    slopes
}

/// Along the normal, where slopes have no direction.
#[inline(always)]
fn beckmann_slopes_from_above<R: Real>([u, v]: [R; 2]) -> [R; 2] {
    let (r, (sin, cos)) = ((-ln(u.rest())).sqrt(), sin_cos(v * TAU));
    [r * cos, r * sin]
}

/// Elsewhere the marginal's CDF is inverted by Newton iterations kept inside a bracket (Heitz and d'Eon 2014, supplement; the start
/// is Jakob's 2014 fit), in the lanes that are asked for. A lane that has its slope waits for the others.
#[inline(always)]
fn beckmann_slopes_aslant<R: Real>(cos: R, [u, v]: [R; 2], asked: R::Mask) -> [R; 2] {
    let tan = (cos * cos).rest().at_least(0.0).sqrt() / cos.at_least(1e-6);
    let cot = tan.inverse();
    let tan_over_root = tan * (1.0 / PI.sqrt());
    let u = u.at_least(1e-6);
    let (mut low, mut high) = (u.all(-1.0), erf(cot));
    let theta = acos(cos);
    let fit = theta * (theta * (theta.all(0.4265) - theta * 0.0594) + -0.876) + 1.0;
    let mut b = high - (high + 1.0) * pow(u.rest(), fit);
    let norm = (high + 1.0 + tan_over_root * exp(-cot * cot)).inverse();
    let mut active = asked;
    for _ in 0..10 {
        if !active.any() {
            break;
        }
        let inside = b.ge(low) & b.le(high);
        b = (inside | !active).choose(b, (low + high) * 0.5);
        let slope = erf_inv(b);
        let value = norm * (b + 1.0 + tan_over_root * exp(-slope * slope)) - u;
        active = active & !value.abs().below(1e-6);
        let beyond = value.above(0.0);
        high = (active & beyond).choose(b, high);
        low = (active & !beyond).choose(b, low);
        b = active.choose(b - value / (norm * (slope * tan).rest()), b);
    }
    [erf_inv(b), erf_inv(v.at_least(1e-6) * 2.0 - 1.0)]
}
