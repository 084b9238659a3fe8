//! Scattering at points, one or sixteen at once, whose textures have been read.

use glam::Vec3;

use super::dielectric::{Dielectric, ThinDielectric};
use super::phase::HenyeyGreenstein;
use super::principled::CLEAR;
use super::rough_dielectric::RoughDielectric;
use super::{
    BsdfSample, Transport, blend, conductor, diffuse, phase, plastic, principled, principled_thin, rough_conductor,
    rough_diffuse, translucent,
};
use crate::math::lanes::{Gather, Job, LANES, Mask, Real, V3, Wide, lanes_of};

/// Sampled directions.
#[derive(Debug, Clone, Copy)]
pub struct Drawn<R: Real> {
    /// The direction.
    pub wi: V3<R>,
    /// f·|cos θ| / pdf; for a delta lobe the factor on the radiance.
    pub weight: V3<R>,
    /// Density w.r.t. solid angle; for a delta lobe the probability of the lobe.
    pub pdf: R,
    /// Where `wi` came from a delta lobe.
    pub delta: R::Mask,
    /// Where there is a sample: elsewhere the surface absorbs, and nothing else that is said here counts.
    pub found: R::Mask,
}

impl<R: Real> Drawn<R> {
    /// Directions of lobes with a density, found where that is above 0.
    #[inline(always)]
    pub fn of_lobe(wi: V3<R>, weight: V3<R>, pdf: R) -> Self {
        let found = pdf.above(0.0);
        Self { wi, weight, pdf, delta: found.none(), found }
    }

    /// Directions of delta lobes.
    #[inline(always)]
    pub fn of_delta(wi: V3<R>, weight: V3<R>, pdf: R, found: R::Mask) -> Self {
        Self { wi, weight, pdf, delta: !found.none(), found }
    }

    /// The first where yes, the second where no.
    #[inline(always)]
    pub fn choose(mask: R::Mask, yes: Self, no: Self) -> Self {
        Self {
            wi: V3::choose(mask, yes.wi, no.wi),
            weight: V3::choose(mask, yes.weight, no.weight),
            pdf: mask.choose(yes.pdf, no.pdf),
            delta: mask & yes.delta | !mask & no.delta,
            found: mask & yes.found | !mask & no.found,
        }
    }
}

impl From<Drawn<f32>> for Option<BsdfSample> {
    #[inline(always)]
    fn from(drawn: Drawn<f32>) -> Self {
        let Drawn { wi, weight, pdf, delta, found } = drawn;
        found.then(|| BsdfSample { wi: wi.into(), weight: weight.into(), pdf, delta })
    }
}

/// The mirrored direction.
#[inline(always)]
pub(super) fn mirrored<R: Real>(w: V3<R>) -> V3<R> {
    V3::new(-w.x, -w.y, w.z)
}

/// A scattering model at points: what is asked of it there. Answers are for a `wo` that two-sided materials have turned to the front.
/// All is marked `#[inline(always)]`, as in [`Kernel::run`](crate::math::lanes::Kernel::run).
pub trait Scatter<R: Real> {
    /// See [`Bsdf::eval_and_pdf`]. Nothing if all lobes are delta lobes.
    #[inline(always)]
    fn eval_and_pdf(&self, _: V3<R>, wi: V3<R>) -> (V3<R>, R) {
        (V3::splat(wi.z.all(0.0)), wi.z.all(0.0))
    }

    /// See [`Bsdf::sample`].
    fn sample(&self, wo: V3<R>, lobe: R, u: [R; 2], transport: Transport) -> Drawn<R>;

    /// See [`Bsdf::delta_probability`].
    #[inline(always)]
    fn delta_probability(&self, wo: V3<R>) -> R {
        wo.z.all(0.0)
    }

    /// Refractive index on the other side over that on the side of `wo`; 1 where transmitted light is not refracted.
    #[inline(always)]
    fn eta(&self, wo: V3<R>) -> R {
        wo.z.all(1.0)
    }

    /// See [`Bsdf::albedo`].
    fn albedo(&self) -> V3<R>;
}

/// The border of a medium, which light passes as if it were not there.
#[derive(Debug, Clone, Copy)]
pub struct Null<R> {
    /// 1 in every lane.
    pub(super) one: R,
}

lanes_of!(Null { one });

impl<R: Real> Scatter<R> for Null<R> {
    #[inline(always)]
    fn sample(&self, wo: V3<R>, _: R, _: [R; 2], _: Transport) -> Drawn<R> {
        Drawn::of_delta(-wo, V3::splat(self.one), self.one, self.one.above(0.0))
    }

    #[inline(always)]
    fn delta_probability(&self, _: V3<R>) -> R {
        self.one
    }

    #[inline(always)]
    fn albedo(&self) -> V3<R> {
        V3::splat(self.one)
    }
}

/// Scattering at points of materials of one variant.
#[derive(Clone, Copy)]
pub struct Bsdf<'a, R: Real> {
    /// Where the back scatters like the front.
    pub(super) two_sided: R::Mask,
    /// Factors on reflected and on transmitted light.
    pub(super) tint: Option<[V3<R>; 2]>,
    pub(super) model: Model<'a, R>,
}

/// The model of a material at points.
#[derive(Clone, Copy)]
pub(super) enum Model<'a, R: Real> {
    Diffuse(diffuse::At<R>),
    RoughDiffuse(rough_diffuse::At<'a, R>),
    Conductor(conductor::At<R>),
    RoughConductor(rough_conductor::At<R>),
    Dielectric(Dielectric<R>),
    ThinDielectric(ThinDielectric<R>),
    RoughDielectric(RoughDielectric<R>),
    Plastic(plastic::At<'a, R>),
    Null(Null<R>),
    Principled(principled::At<'a, R>),
    PrincipledThin(principled_thin::At<'a, R>),
    Translucent(translucent::At<R>),
    Blend(blend::At<'a, R>),
    Phase(phase::At<R>),
}

/// The same expression for whichever model it is.
macro_rules! each_model {
    ($model:expr, $m:ident => $answer:expr) => {
        match $model {
            Model::Diffuse($m) => $answer,
            Model::RoughDiffuse($m) => $answer,
            Model::Conductor($m) => $answer,
            Model::RoughConductor($m) => $answer,
            Model::Dielectric($m) => $answer,
            Model::ThinDielectric($m) => $answer,
            Model::RoughDielectric($m) => $answer,
            Model::Plastic($m) => $answer,
            Model::Null($m) => $answer,
            Model::Principled($m) => $answer,
            Model::PrincipledThin($m) => $answer,
            Model::Translucent($m) => $answer,
            Model::Blend($m) => $answer,
            Model::Phase($m) => $answer,
        }
    };
}

/// [`Scatter::eval_and_pdf`] of a model.
struct Evaluate<'m, 'a, R: Real> {
    model: &'m Model<'a, R>,
    wo: V3<R>,
    wi: V3<R>,
}

impl<R: Real> Job for Evaluate<'_, '_, R> {
    type Output = (V3<R>, R);

    #[inline(always)]
    fn run(self) -> (V3<R>, R) {
        each_model!(self.model, m => m.eval_and_pdf(self.wo, self.wi))
    }
}

/// [`Scatter::sample`] of a model.
struct Sample<'m, 'a, R: Real> {
    model: &'m Model<'a, R>,
    wo: V3<R>,
    lobe: R,
    u: [R; 2],
    transport: Transport,
}

impl<R: Real> Job for Sample<'_, '_, R> {
    type Output = Drawn<R>;

    #[inline(always)]
    fn run(self) -> Drawn<R> {
        each_model!(self.model, m => m.sample(self.wo, self.lobe, self.u, self.transport))
    }
}

impl<R: Real> Bsdf<'_, R> {
    /// f(wo, wi)·|cos θᵢ| of the lobes that are not delta, sr⁻¹, for radiance.
    #[inline(always)]
    pub fn eval(&self, wo: V3<R>, wi: V3<R>) -> V3<R> {
        self.eval_and_pdf(wo, wi).0
    }

    /// Density of [`Bsdf::sample`] over the lobes that are not delta, w.r.t. solid angle.
    #[inline(always)]
    pub fn pdf(&self, wo: V3<R>, wi: V3<R>) -> R {
        self.eval_and_pdf(wo, wi).1
    }

    /// [`Bsdf::eval`] and [`Bsdf::pdf`], which have most in common.
    #[inline(always)]
    pub fn eval_and_pdf(&self, wo: V3<R>, wi: V3<R>) -> (V3<R>, R) {
        let (_, wo, wi) = self.in_front(wo, wi);
        let (value, pdf) = match &self.model {
            Model::Diffuse(m) => m.eval_and_pdf(wo, wi),
            model => wo.z.apart(Evaluate { model, wo, wi }),
        };
        (self.tinted(value, wo, wi), pdf)
    }

    /// Samples `wi` by numbers in [0, 1), the first for the lobe where there are several, the others for its direction.
    #[inline(always)]
    pub fn sample(&self, wo: V3<R>, lobe: R, u: [R; 2], transport: Transport) -> Drawn<R> {
        let (turned, wo, _) = self.in_front(wo, wo);
        let drawn = match &self.model {
            Model::Diffuse(m) => m.sample(wo, lobe, u, transport),
            model => wo.z.apart(Sample { model, wo, lobe, u, transport }),
        };
        let weight = self.tinted(drawn.weight, wo, drawn.wi);
        Drawn { wi: V3::choose(turned, -drawn.wi, drawn.wi), weight, ..drawn }
    }

    /// Whether [`Bsdf::sample`] reads the number that chooses a lobe: of most materials the other two say everything.
    #[inline(always)]
    pub fn chooses_lobe(&self) -> bool {
        matches!(
            self.model,
            Model::RoughDielectric(_)
                | Model::Principled(_)
                | Model::PrincipledThin(_)
                | Model::Translucent(_)
                | Model::Blend(_)
        )
    }

    /// Probability with which [`Bsdf::sample`] chooses a delta lobe.
    #[inline(always)]
    pub fn delta_probability(&self, wo: V3<R>) -> R {
        let (_, wo, _) = self.in_front(wo, wo);
        each_model!(&self.model, m => m.delta_probability(wo))
    }

    /// Whether [`Bsdf::eta`] may be other than 1.
    #[inline(always)]
    pub fn refracts(&self) -> bool {
        match &self.model {
            Model::Dielectric(_) | Model::RoughDielectric(_) | Model::Blend(_) => true,
            Model::Principled(m) => m.transmits(),
            _ => false,
        }
    }

    /// Refractive index on the side of `wi` over that on the side of `wo`: radiance that is refracted is divided by its square
    /// (Veach 1997, §5.2). 1 where both are on one side, and where transmitted light is not refracted.
    #[inline(always)]
    pub fn eta(&self, wo: V3<R>, wi: V3<R>) -> R {
        let passes = (wo.z * wi.z).below(0.0);
        let (_, wo, _) = self.in_front(wo, wi);
        passes.choose(each_model!(&self.model, m => m.eta(wo)), wo.z.all(1.0))
    }

    /// Reflectance for pictures of the albedo.
    #[inline(always)]
    pub fn albedo(&self) -> V3<R> {
        let albedo = each_model!(&self.model, m => m.albedo());
        // Tinted are glasses, of which most light is let through.
        self.tint.map_or(albedo, |[_, transmittance]| albedo * transmittance)
    }

    /// Where both directions are turned around, and the directions thereafter.
    #[inline(always)]
    fn in_front(&self, wo: V3<R>, wi: V3<R>) -> (R::Mask, V3<R>, V3<R>) {
        let turned = self.two_sided & wo.z.below(0.0);
        (turned, V3::choose(turned, -wo, wo), V3::choose(turned, -wi, wi))
    }

    #[inline(always)]
    fn tinted(&self, value: V3<R>, wo: V3<R>, wi: V3<R>) -> V3<R> {
        let Some([reflectance, transmittance]) = self.tint else { return value };
        value * V3::choose((wo.z * wi.z).above(0.0), reflectance, transmittance)
    }
}

/// What points must have in common to be computed in lanes: their model, its discrete options, and whether it is tinted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Variant(u8);

/// As many discrete options as any model has; they are numbered from 0.
const OPTIONS: usize = 4;

impl Variant {
    /// Number of variants.
    pub const COUNT: usize = 2 * OPTIONS * 15;

    /// Of phase functions, which are in the place of BSDFs in media.
    pub const PHASE: Self = Self::new(11, 0, false);

    /// Of [`Plain`] points.
    pub const PLAIN: Self = Self::new(0, 0, false);

    const fn new(model: usize, option: usize, tinted: bool) -> Self {
        Self(((model * OPTIONS + option) * 2 + tinted as usize) as u8)
    }

    /// Whether points of the variant reflect light, and let none through.
    #[inline(always)]
    pub fn reflects(self) -> bool {
        let of = usize::from(self.0) / 2;
        match of / OPTIONS {
            0..=3 | 7 => true,
            9 | 14 => of % OPTIONS < CLEAR,
            _ => false,
        }
    }

    /// Index of the variant, below [`Variant::COUNT`].
    pub fn index(self) -> usize {
        self.0.into()
    }
}

/// A point of a diffuse surface that nothing tints: the commonest by far, of which less is to be written and read than of any.
#[derive(Debug, Clone, Copy, Default)]
pub struct Plain {
    /// Albedo, and 1 where the surface is two-sided.
    row: [f32; 4],
}

impl Plain {
    #[inline(always)]
    pub(super) fn new(albedo: Vec3, two_sided: bool) -> Self {
        Self { row: [albedo.x, albedo.y, albedo.z, if two_sided { 1.0 } else { 0.0 }] }
    }

    /// Points in lanes.
    #[inline(always)]
    pub fn gather<'a, W: Wide>(wide: W, points: &[Self; LANES]) -> Bsdf<'a, W::Real> {
        let [r, g, b, two_sided] = wide.four_columns(|lane| points[lane].row);
        let model = Model::Diffuse(diffuse::At::new(V3::new(r, g, b)));
        Bsdf { two_sided: two_sided.above(0.0), tint: None, model }
    }
}

impl From<Plain> for Bsdf<'_, f32> {
    #[inline(always)]
    fn from(Plain { row: [r, g, b, two_sided] }: Plain) -> Self {
        Self { two_sided: two_sided > 0.0, tint: None, model: Model::Diffuse(diffuse::At::new(V3::new(r, g, b))) }
    }
}

impl<'a> Bsdf<'a, f32> {
    /// The phase function of a medium, in the place of a BSDF: the frame's +z is then the direction of the light that leaves.
    #[inline(always)]
    pub fn phase(phase: HenyeyGreenstein) -> Self {
        Self { two_sided: false, tint: None, model: Model::Phase(phase.at()) }
    }

    /// The variant of the point.
    pub fn variant(&self) -> Variant {
        let (model, option) = match &self.model {
            Model::Diffuse(_) => (0, 0),
            Model::RoughDiffuse(m) => (1, m.option()),
            Model::Conductor(_) => (2, 0),
            Model::RoughConductor(m) => (3, m.facets.option()),
            Model::Dielectric(_) => (4, 0),
            Model::ThinDielectric(_) => (5, 0),
            Model::RoughDielectric(m) => (6, m.facets.option()),
            Model::Plastic(m) => (7, m.option()),
            Model::Null(_) => (8, 0),
            Model::Principled(m) => (if m.has_grain() { 14 } else { 9 }, m.option()),
            Model::Blend(_) => (10, 0),
            Model::Phase(_) => return Variant::PHASE,
            Model::PrincipledThin(_) => (12, 0),
            Model::Translucent(_) => (13, 0),
        };
        Variant::new(model, option, self.tint.is_some())
    }

    /// Points of one variant in lanes; one of another variant is taken for the first.
    #[inline(always)]
    pub fn gather<W: Wide>(wide: W, points: [&Self; LANES]) -> Bsdf<'a, W::Real> {
        Gather::gather(wide, points)
    }
}

lanes_of!(Bsdf<'a> { two_sided, tint, model });

impl<'a, W: Wide> Gather<W> for Model<'a, f32> {
    type Lanes = Model<'a, W::Real>;

    #[inline(always)]
    fn gather(wide: W, each: [&Self; LANES]) -> Self::Lanes {
        macro_rules! all_are {
            ($model:ident, $first:expr) => {{
                let mut points = [$first; LANES];
                for lane in 1..LANES {
                    if let Model::$model(point) = each[lane] {
                        points[lane] = point;
                    }
                }
                Model::$model(Gather::gather(wide, points))
            }};
        }
        match each[0] {
            Model::Diffuse(m) => all_are!(Diffuse, m),
            Model::RoughDiffuse(m) => all_are!(RoughDiffuse, m),
            Model::Conductor(m) => all_are!(Conductor, m),
            Model::RoughConductor(m) => all_are!(RoughConductor, m),
            Model::Dielectric(m) => all_are!(Dielectric, m),
            Model::ThinDielectric(m) => all_are!(ThinDielectric, m),
            Model::RoughDielectric(m) => all_are!(RoughDielectric, m),
            Model::Plastic(m) => all_are!(Plastic, m),
            Model::Null(m) => all_are!(Null, m),
            Model::Principled(m) => all_are!(Principled, m),
            Model::PrincipledThin(m) => all_are!(PrincipledThin, m),
            Model::Translucent(m) => all_are!(Translucent, m),
            Model::Blend(m) => all_are!(Blend, m),
            Model::Phase(m) => all_are!(Phase, m),
        }
    }
}
