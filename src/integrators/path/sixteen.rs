//! Vertices that are shaded together.

use super::{Arrival, PathState};
use crate::geometry::Surface;
use crate::math::lanes::LANES;

/// Vertices that are shaded together: of one variant, all with bumps or none. Lanes behind the last one repeat the first, and are not
/// looked at.
pub(super) struct Sixteen<'v, 'p> {
    pub count: usize,
    pub vertices: [&'v Arrival; LANES],
    pub surfaces: [&'v Surface; LANES],
    pub paths: [&'p PathState; LANES],
    /// Whether lights are sampled at some of them.
    pub connects: bool,
}

impl<'v, 'p> Sixteen<'v, 'p> {
    /// The first of those that `vertices` tells, at least one.
    #[inline(always)]
    pub fn new(
        first: &'v Arrival,
        vertices: impl ExactSizeIterator<Item = &'v Arrival>,
        surfaces: &'v [Surface],
        paths: &'p [PathState],
    ) -> Self {
        let (surface, path) = (&surfaces[first.place as usize], &paths[first.path as usize]);
        let mut sixteen = Self {
            count: vertices.len(),
            vertices: [first; LANES],
            surfaces: [surface; LANES],
            paths: [path; LANES],
            connects: false,
        };
        for (lane, at) in vertices.enumerate().take(LANES) {
            sixteen.vertices[lane] = at;
            sixteen.surfaces[lane] = &surfaces[at.place as usize];
            sixteen.paths[lane] = &paths[at.path as usize];
            sixteen.connects |= at.connects;
        }
        sixteen
    }
}
