//! What guides propose at vertices that are shaded together, and what they are asked once the BSDFs have drawn.

use glam::Vec3;

use super::shaded::Shaded;
use super::sixteen::Sixteen;
use super::vertices::Towards;
use crate::base::random::{Dimension, Generators};
use crate::geometry::Surface;
use crate::guiding::sample::field::{DirectionGuide, GuideField};
use crate::guiding::sample::lanes::GuideLanes;
use crate::integrators::kept::{All, First};
use crate::integrators::mixture::{cosine_normal, guided_point, guided_points};
use crate::math::lanes::{self, Kernel, LANES, Wide};

/// Vertices that are shaded together, with their guides.
pub(super) struct Guides<'v, 'g> {
    pub guides: GuideLanes<'g>,
    pub sixteen: &'v Sixteen<'v, 'v>,
}

impl<'g> Guides<'_, 'g> {
    /// Lets the guides propose directions, in all lanes or in the first alone.
    #[inline(always)]
    pub fn propose(&self, in_lanes: bool, shaded: &mut Shaded) {
        if in_lanes {
            // There are lanes, or these would be shaded one by one.
            let _ = lanes::run(Propose(self, shaded));
        } else {
            let random = &self.sixteen.paths[0].random;
            let drawn = self.first().and_then(|guide| Some(guide.sample(guided_point(guide.bsdf_fraction, random)?)));
            let (direction, pdf) = drawn.unwrap_or_default();
            shaded.keep_proposals(First, u32::from(drawn.is_some()), direction.into(), pdf);
        }
    }

    /// Asks the guides for their densities in the directions that the BSDFs have drawn.
    #[inline(always)]
    pub fn ask(&self, in_lanes: bool, shaded: &mut Shaded) {
        if in_lanes {
            let _ = lanes::run(Ask(self, shaded));
        } else {
            let guide = self.first().filter(|_| shaded.asks(self.guides.any) & 1 == 1);
            let pdf = guide.map_or(0.0, |guide| guide.pdf(shaded.directions(First).into()));
            shaded.keep_guides(First, &self.guides, pdf);
        }
    }

    #[inline(always)]
    fn first(&self) -> Option<DirectionGuide<'g>> {
        self.guides.at(0, self.sixteen.surfaces[0].point, || self.normal(0))
    }

    #[inline(always)]
    fn normal(&self, lane: usize) -> Vec3 {
        let Sixteen { vertices, surfaces, paths, .. } = self.sixteen;
        cosine_normal(vertices[lane].variant, surfaces[lane], -paths[lane].ray.direction)
    }
}

struct Propose<'p, 'v, 'g>(&'p Guides<'v, 'g>, &'p mut Shaded);

impl Kernel for Propose<'_, '_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<W: Wide>(self, wide: W) {
        let Self(of, shaded) = self;
        let Guides { guides, sixteen } = of;
        let random = |lane: usize| &sixteen.paths[lane].random;
        let points = Generators::new(random).fine_points(random, Dimension::GUIDE);
        let (taken, u) = guided_points(&guides.bsdf_fractions, &points);
        let (taken, at) = (taken & guides.any, Surface::point_lanes(wide, &sixteen.surfaces));
        let (direction, pdf) = guides.sample(wide, at, (taken, &u), |lane| of.normal(lane));
        shaded.keep_proposals(All(wide), taken, direction, pdf);
    }
}

struct Ask<'p, 'v, 'g>(&'p Guides<'v, 'g>, &'p mut Shaded);

impl Kernel for Ask<'_, '_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<W: Wide>(self, wide: W) {
        let Self(of, shaded) = self;
        let Guides { guides, sixteen } = of;
        let (asked, at) = (shaded.asks(guides.any), Surface::point_lanes(wide, &sixteen.surfaces));
        let towards = shaded.directions(All(wide));
        let pdf = guides.pdf(wide, at, (asked, towards), |lane| of.normal(lane));
        shaded.keep_guides(All(wide), guides, pdf);
    }
}

/// Up to sixteen connections to lights, with the guides at their vertices.
pub(super) struct Lights<'v, 'g> {
    pub guides: GuideLanes<'g>,
    /// At least one.
    pub towards: &'v [Towards],
}

impl<'v, 'g> Lights<'v, 'g> {
    /// Those of which `asks` says by their place that they are asked.
    #[inline(always)]
    pub fn new(towards: &'v [Towards], field: Option<&'g GuideField>, asks: impl Fn(usize) -> bool) -> Self {
        let guide = |lane: usize| {
            let voxel = towards.get(lane).filter(|_| asks(lane))?.voxel?;
            Some(&field?.voxels()[voxel as usize])
        };
        Self { guides: GuideLanes::new(guide), towards }
    }

    /// Densities with which the guides draw the directions to the lights; 0 where there is none.
    #[inline(always)]
    pub fn densities(self) -> [f32; LANES] {
        if self.guides.any == 0 {
            return [0.0; LANES];
        }
        lanes::run(self).unwrap_or_else(|Self { guides, towards }| {
            let mut densities = [0.0; LANES];
            for (lane, (density, at)) in densities.iter_mut().zip(towards).enumerate() {
                *density = guides.at(lane, at.point, || at.normal).map_or(0.0, |guide| guide.pdf(at.direction));
            }
            densities
        })
    }
}

impl Kernel for Lights<'_, '_> {
    type Output = [f32; LANES];

    #[inline(always)]
    fn run<W: Wide>(self, wide: W) -> [f32; LANES] {
        // Lanes behind the last one repeat it.
        let at = |lane: usize| &self.towards[lane.min(self.towards.len() - 1)];
        let (points, towards) = (wide.vectors(|lane| at(lane).point), wide.vectors(|lane| at(lane).direction));
        let asked = self.guides.any;
        wide.store(self.guides.pdf(wide, points, (asked, towards), |lane| at(lane).normal))
    }
}
