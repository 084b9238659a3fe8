//! Vertices that scatter alike, of which sixteen are shaded at once.

use crate::geometry::Surface;
use crate::materials::phase::HenyeyGreenstein;
use crate::materials::{Bsdf, Plain, Variant};
use crate::math::lanes::{self, LANES, Wide};
use crate::scene::Scene;

/// How a surface scatters, or a medium of this phase function.
#[inline(always)]
pub(super) fn bsdf<'s>(scene: &'s Scene, phase: Option<HenyeyGreenstein>, surface: &Surface) -> Bsdf<'s, f32> {
    match phase {
        Some(phase) => Bsdf::phase(phase),
        None => scene.bsdf(surface),
    }
}

/// How sixteen vertices scatter, which are of one variant.
pub(super) trait Points<'b>: Copy {
    /// See [`Bsdf::chooses_lobe`].
    fn chooses_lobe(self) -> bool;

    /// Lane by lane.
    fn gather<W: Wide>(self, wide: W) -> Bsdf<'b, W::Real>;
}

/// Of any variant: of the vertices that are looked at, at least one.
impl<'b> Points<'b> for &[Bsdf<'b, f32>] {
    #[inline(always)]
    fn chooses_lobe(self) -> bool {
        self[0].chooses_lobe()
    }

    #[inline(always)]
    fn gather<W: Wide>(self, wide: W) -> Bsdf<'b, W::Real> {
        let mut points = [&self[0]; LANES];
        for (point, bsdf) in points.iter_mut().zip(self) {
            *point = bsdf;
        }
        Bsdf::gather(wide, points)
    }
}

impl<'b> Points<'b> for &[Plain; LANES] {
    #[inline(always)]
    fn chooses_lobe(self) -> bool {
        false
    }

    #[inline(always)]
    fn gather<W: Wide>(self, wide: W) -> Bsdf<'b, W::Real> {
        Plain::gather(wide, self)
    }
}

/// Fewest vertices that are shaded in lanes: fewer take less time one by one.
#[inline(always)]
pub(super) fn fewest() -> usize {
    if lanes::available() { 3 } else { usize::MAX }
}

/// Indices of vertices, for each variant with and without bumps.
#[derive(Default)]
pub(super) struct Alike(Vec<Vec<u32>>);

impl Alike {
    /// Sorts vertices, of which `kinds` tells the variants, and whether they have bumps.
    #[inline(always)]
    pub fn sort(&mut self, kinds: impl Iterator<Item = (Variant, bool)>) {
        self.0.resize_with(2 * Variant::COUNT, Vec::new);
        self.0.iter_mut().for_each(Vec::clear);
        for (index, (variant, bumped)) in (0..).zip(kinds) {
            self.0[2 * variant.index() + usize::from(bumped)].push(index);
        }
    }

    /// The groups, of which many are empty.
    pub fn all(&self) -> &[Vec<u32>] {
        &self.0
    }
}
