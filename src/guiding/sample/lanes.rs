//! Guides at sixteen points at once, which wait for memory together.

use glam::Vec3;

use super::field::{DirectionGuide, VoxelGuide};
use crate::guiding::cache::parallax::{Parallax, Sphere};
use crate::guiding::model::Directions;
use crate::math::lanes::{LANES, V3, Vectors, Wide, set_vector, vector};

/// Guides of the voxels of points, one per lane; none where the BSDF samples alone.
#[derive(Clone, Copy)]
pub struct GuideLanes<'g> {
    guides: [Option<&'g VoxelGuide>; LANES],
    /// Where there is one, one bit each.
    pub any: u32,
    /// Where its distribution is another one for each point.
    moving: u32,
    /// Probabilities α of sampling the BSDF instead; 1 where there is no guide.
    pub bsdf_fractions: [f32; LANES],
}

impl<'g> GuideLanes<'g> {
    /// Of the guides that `of` tells.
    #[inline(always)]
    pub fn new(of: impl Fn(usize) -> Option<&'g VoxelGuide>) -> Self {
        let mut all = Self { guides: [None; LANES], any: 0, moving: 0, bsdf_fractions: [1.0; LANES] };
        for lane in 0..LANES {
            let Some(guide) = of(lane) else { continue };
            if let Some(directions) = &guide.directions {
                all.guides[lane] = Some(guide);
                all.bsdf_fractions[lane] = guide.bsdf_fraction;
                all.any |= 1 << lane;
                all.moving |= u32::from(directions.mixture().is_some()) << lane;
            }
        }
        all
    }

    /// The guide of a lane at `point`; `normal` is as for [`DirectionGuide::facing`].
    #[inline(always)]
    pub fn at(&self, lane: usize, point: Vec3, normal: impl FnOnce() -> Vec3) -> Option<DirectionGuide<'g>> {
        let guide = self.guides[lane]?.at(point)?;
        Some(if self.moving >> lane & 1 == 1 { guide.facing(normal()) } else { guide })
    }

    /// Directions at `points` that points `u` of the unit square map to, and their densities w.r.t. solid angle, as by
    /// [`DirectionGuide::sample`], in the lanes whose bits `taken` has. `normal` is as for [`DirectionGuide::facing`].
    #[inline(always)]
    pub fn sample<W: Wide>(
        &self,
        wide: W,
        points: V3<W::Real>,
        (taken, u): (u32, &[[f64; 2]; LANES]),
        normal: impl Fn(usize) -> Vec3,
    ) -> (V3<W::Real>, W::Real) {
        let mut draws = [None; LANES];
        self.each(taken & !self.moving, |lane, directions| draws[lane] = Some((directions, u[lane])));
        let (at_centre, density) = Directions::sample_lanes(wide, &draws);
        let (direction, factor) = self.spheres(wide).from_centre(points, at_centre);
        let drawn = (direction, density * factor);
        if taken & self.moving == 0 {
            return drawn;
        }
        let (mut directions, mut densities) = (wide.store_vectors(drawn.0), wide.store(drawn.1));
        let points = wide.store_vectors(points);
        self.alone(taken, &points, normal, |lane, guide| {
            let direction;
            (direction, densities[lane]) = guide.sample(u[lane]);
            set_vector(&mut directions, lane, direction);
        });
        (wide.load_vectors(&directions), wide.load(&densities))
    }

    /// Densities w.r.t. solid angle with which the guides at `points` draw the unit vectors `towards`, as by [`DirectionGuide::pdf`], in
    /// the lanes whose bits `asked` has.
    #[inline(always)]
    pub fn pdf<W: Wide>(
        &self,
        wide: W,
        points: V3<W::Real>,
        (asked, towards): (u32, V3<W::Real>),
        normal: impl Fn(usize) -> Vec3,
    ) -> W::Real {
        let (at_centre, factor) = self.spheres(wide).to_centre(points, towards);
        let mut all = [None; LANES];
        self.each(asked & !self.moving, |lane, directions| all[lane] = Some(directions));
        let density = Directions::pdf_lanes(wide, &all, at_centre) * factor;
        if asked & self.moving == 0 {
            return density;
        }
        let (mut densities, points) = (wide.store(density), wide.store_vectors(points));
        let towards = wide.store_vectors(towards);
        self.alone(asked, &points, normal, |lane, guide| densities[lane] = guide.pdf(vector(&towards, lane)));
        wide.load(&densities)
    }

    #[inline(always)]
    fn spheres<W: Wide>(&self, wide: W) -> Sphere<W::Real> {
        let of = |lane: usize| self.guides[lane].map_or(Parallax::NONE, |guide| guide.parallax).to_array();
        let [x, y, z, curvature] = wide.four_columns(of);
        Sphere { centre: V3::new(x, y, z), curvature }
    }

    /// What lanes have.
    #[inline(always)]
    fn each(&self, lanes: u32, mut tell: impl FnMut(usize, &'g Directions)) {
        for (lane, guide) in self.guides.iter().enumerate() {
            if lanes >> lane & 1 == 1
                && let Some(directions) = guide.and_then(|guide| guide.directions.as_ref())
            {
                tell(lane, directions);
            }
        }
    }

    /// The guides whose distributions are other ones for each point.
    fn alone(
        &self,
        lanes: u32,
        points: &Vectors,
        normal: impl Fn(usize) -> Vec3,
        mut tell: impl FnMut(usize, DirectionGuide<'g>),
    ) {
        for lane in (0..LANES).filter(|lane| (lanes & self.moving) >> lane & 1 == 1) {
            if let Some(guide) = self.at(lane, vector(points, lane), || normal(lane)) {
                tell(lane, guide);
            }
        }
    }
}
