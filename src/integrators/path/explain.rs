//! A path explained vertex by vertex: for samples that were dropped because their radiance is not finite.

use glam::Vec3;
use serde::Serialize;

use super::{Background, CameraPath, Details, Emission, PathScratch, PathTracer, RayCount, Step, Vertex, Wants};
use crate::geometry::Ray;

/// First quantity on a path that is not finite.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// The camera's ray.
    Camera,
    /// Radiance of a surface that the path ran into.
    Emission,
    /// Radiance of the background.
    Background,
    /// Transmittance of a medium.
    Transmittance,
    /// Value of a BSDF or of a phase function.
    Bsdf,
    /// Density of a direction.
    Pdf,
    /// Light sampling: radiance, BSDF or density towards the light.
    DirectLight,
    /// Nothing alone: the product along the path overflows.
    Overflow,
}

impl Cause {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Camera,
        Self::Emission,
        Self::Background,
        Self::Transmittance,
        Self::Bsdf,
        Self::Pdf,
        Self::DirectLight,
        Self::Overflow,
    ];

    /// Its name in statistics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Camera => "camera",
            Self::Emission => "emission",
            Self::Background => "background",
            Self::Transmittance => "transmittance",
            Self::Bsdf => "bsdf",
            Self::Pdf => "pdf",
            Self::DirectLight => "direct_light",
            Self::Overflow => "overflow",
        }
    }
}

/// Emission that a path ran into.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Met {
    /// Radiance, dimmed by a medium on the way.
    pub radiance: Vec3,
    /// Its MIS weight against light sampling at the vertex before.
    pub weight: f32,
}

impl Met {
    fn new(emission: Emission) -> Self {
        Self { radiance: emission.radiance, weight: emission.weight }
    }

    /// Cause where radiance or weight is not finite: `source` for the radiance.
    fn cause(&self, source: Cause) -> Option<Cause> {
        if !self.radiance.is_finite() { Some(source) } else { (!self.weight.is_finite()).then_some(Cause::Pdf) }
    }
}

/// Step of a path from a vertex to the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Onward {
    /// Unit direction.
    pub direction: Vec3,
    /// f·|cos θ|; zero for a delta lobe.
    pub value: Vec3,
    /// Density w.r.t. solid angle; for a delta lobe its probability.
    pub pdf: f32,
    /// f·|cos θ| / pdf.
    pub weight: Vec3,
    /// Part of the density that is the BSDF's.
    pub bsdf_share: f32,
    /// Whether a delta lobe was chosen.
    pub delta: bool,
    /// Probability of surviving roulette.
    pub survival: f32,
}

/// A vertex of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExplainedVertex {
    /// Point in the world.
    pub point: Vec3,
    /// Distance from the vertex before.
    pub distance: f32,
    /// Shading normal on the side that the path arrived at; zero in a medium.
    pub normal: Vec3,
    /// Index of the shape; none in a medium.
    pub shape: Option<u32>,
    /// Throughput for light that leaves here towards the vertex before, roulette included.
    pub throughput: Vec3,
    /// Transmittance of a medium on the way, over the density of getting here.
    pub passed: Vec3,
    /// Light of media on the way.
    pub glow: Vec3,
    /// Emission of the surface.
    pub met: Met,
    /// Light sampling here: f·L·w / p.
    pub direct: Vec3,
    /// Step to the next vertex; none where the path ends.
    pub onward: Option<Onward>,
    /// Contribution of emission and light sampling here to the sample's radiance.
    pub contribution: Vec3,
    /// First quantity that is not finite here; none where all are finite.
    pub cause: Option<Cause>,
}

/// A whole path.
#[derive(Debug, Clone)]
pub struct Explanation {
    /// The camera's ray.
    pub ray: Ray,
    /// The vertices after the camera.
    pub vertices: Vec<ExplainedVertex>,
    /// Emission of the background that the last segment ran into.
    pub background: Met,
    /// Light of media on the last segment, where that ends there.
    pub background_glow: Vec3,
    /// Contribution of both to the sample's radiance.
    pub background_contribution: Vec3,
    /// Radiance of the sample, as the film gets it.
    pub radiance: Vec3,
    /// First quantity that is not finite; none where the radiance is finite.
    pub cause: Option<Cause>,
}

impl PathTracer<'_> {
    /// Traces a path as among others, and returns its vertices.
    pub fn explain(&self, path: CameraPath) -> Explanation {
        let (ray, mut scratch) = (path.ray, PathScratch::default());
        self.trace_all([path], Wants::Records, &mut scratch, &mut RayCount::default());
        let radiance = self.radiance(0, &scratch, None);
        let mut throughput = Vec3::ONE;
        let of = &scratch.vertices;
        let mut vertices = Vec::with_capacity(of.all.len());
        for (i, (vertex, details)) in of.all.iter().zip(&of.details).enumerate() {
            let passed = of.passed.get(i).copied().unwrap_or(Vec3::ONE);
            let glow = of.glow.get(i).copied().unwrap_or(Vec3::ZERO);
            let explained = explained(vertex, [passed, glow], details, throughput);
            throughput *= passed * vertex.weight / vertex.survival;
            vertices.push(explained);
        }
        let Background { emission, glow: background_glow } = scratch.background();
        let background = Met::new(emission);
        let finite_ray = ray.origin.is_finite() && ray.direction.is_finite();
        let first = || {
            let behind =
                background.cause(Cause::Background).or((!background_glow.is_finite()).then_some(Cause::Emission));
            vertices.iter().find_map(|v| v.cause).or(behind)
        };
        let cause = match radiance.is_finite() {
            true => None,
            false if !finite_ray => Some(Cause::Camera),
            false => Some(first().unwrap_or(Cause::Overflow)),
        };
        let background_contribution = throughput * (background.radiance * background.weight + background_glow);
        Explanation { ray, vertices, background, background_glow, background_contribution, radiance, cause }
    }
}

fn explained(vertex: &Vertex, [passed, glow]: [Vec3; 2], details: &Details, throughput: Vec3) -> ExplainedVertex {
    let onward = |step: &Step| Onward {
        direction: step.direction,
        value: step.value,
        pdf: step.pdf,
        weight: step.weight,
        bsdf_share: step.bsdf_share,
        delta: step.delta,
        survival: step.survival,
    };
    let onward = details.step.as_ref().map(onward);
    let met = Met::new(details.emission);
    let scattering = onward.as_ref().and_then(|onward| {
        let density = onward.pdf > 0.0 && onward.pdf.is_finite();
        match (vertex.weight.is_finite(), onward.value.is_finite()) {
            (true, _) => None,
            (false, true) if !density => Some(Cause::Pdf),
            (false, _) => Some(Cause::Bsdf),
        }
    });
    let cause = (!passed.is_finite())
        .then_some(Cause::Transmittance)
        .or_else(|| met.cause(Cause::Emission))
        .or_else(|| (!glow.is_finite()).then_some(Cause::Emission))
        .or_else(|| (!vertex.direct.is_finite()).then_some(Cause::DirectLight))
        .or(scattering)
        .or_else(|| (!vertex.weight.is_finite()).then_some(Cause::Bsdf));
    ExplainedVertex {
        point: details.point,
        distance: details.distance,
        normal: details.normal,
        shape: (details.normal != Vec3::ZERO).then_some(details.shape),
        throughput,
        passed,
        glow,
        met,
        direct: vertex.direct,
        onward,
        contribution: throughput * (vertex.emitted + glow + passed * vertex.direct),
        cause,
    }
}
