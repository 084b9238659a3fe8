//! The light that paths run into infinitely far away, for sixteen of them at once, or for one.

use glam::Vec3;

use super::vertices::Vertices;
use super::{Background, Emission, NO_VERTEX, PathState, PathTracer};
use crate::lights::LightSet;
use crate::lights::seen::LightView;
use crate::math::lanes::{self, Kernel, LANES, Vectors, Wide, vector};

/// A path that has left the scene.
pub(super) struct Left {
    /// Index of the path.
    pub path: u32,
    /// Transmittance of the media on the way out, over the density of getting there.
    pub passed: Vec3,
    /// Light of the media there.
    pub glow: Vec3,
}

/// Directions that are looked in.
struct Look<'l> {
    lights: &'l LightSet,
    directions: [Vec3; LANES],
    view: LightView<'l>,
}

impl Kernel for Look<'_> {
    /// Radiance, and the density of light sampling w.r.t. solid angle.
    type Output = (Vectors, [f32; LANES]);

    #[inline(always)]
    fn run<W: Wide>(self, wide: W) -> Self::Output {
        let (radiance, pdf) = self.lights.background_lanes(wide.vectors(|lane| self.directions[lane]), &self.view);
        (wide.store_vectors(radiance), wide.store(pdf))
    }
}

/// Fewest paths that are worth lanes.
const FEWEST: usize = 3;

impl PathTracer<'_> {
    /// Lets paths see the background that they have left the scene for.
    pub(super) fn look_out(&self, left: &[Left], paths: &mut [PathState], vertices: &mut Vertices) {
        for left in left.chunks(LANES) {
            let mut view = self.view(&paths[left[0].path as usize]);
            let mut directions = [Vec3::Z; LANES];
            for (lane, Left { path, .. }) in left.iter().enumerate() {
                let path = &paths[*path as usize];
                (directions[lane], view.facing[lane]) = (path.ray.direction, path.previous.facing);
            }
            let look = Look { lights: &self.scene.lights, directions, view };
            let seen = if left.len() < FEWEST { None } else { lanes::run(look).ok() };
            for (lane, Left { path, passed, glow }) in left.iter().enumerate() {
                let path = &mut paths[*path as usize];
                let emission = match &seen {
                    // What the camera itself would see.
                    _ if self.scene.hides_emitters && path.last == NO_VERTEX => Emission::default(),
                    Some((radiance, pdf)) => weighed(path, vector(radiance, lane), pdf[lane]),
                    None => self.background(path),
                };
                path.background = vertices.backgrounds.len() as u32;
                vertices.backgrounds.push(Background { emission: emission.dimmed(*passed), glow: *glow });
            }
        }
    }

    /// The background in the direction of a path.
    pub(super) fn background(&self, path: &PathState) -> Emission {
        let (radiance, pdf) = self.scene.lights.background(path.ray.direction, &self.view(path));
        weighed(path, radiance, pdf)
    }

    fn view(&self, path: &PathState) -> LightView<'_> {
        LightView { learned: self.lights.sky(), facing: [path.previous.facing; LANES], odds: None }
    }
}

/// Radiance with its weight against light sampling of density `pdf` at the previous vertex.
#[inline(always)]
fn weighed(path: &PathState, radiance: Vec3, pdf: f32) -> Emission {
    let (weight, connected) = path.previous.weight(|tried| pdf * tried);
    Emission { radiance, weight, connected }
}
