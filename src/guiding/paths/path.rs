//! Complete paths, from the camera to a light.

use glam::Vec3;
use smallvec::SmallVec;

/// Most vertices of a path behind the camera, the one on the light included: longer paths are left to the path tracer.
pub const MOST_VERTICES: usize = 16;

/// How a path ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum End {
    /// On a surface that emits: its last point.
    Surface,
    /// At the sky, which counts as a sphere around the scene: the last point lies there.
    Sky,
    /// At the light of this index, which no ray can hit: it is no point of the path.
    Light(u32),
}

/// What happens at a vertex between camera and light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Event {
    /// Whether the path goes on behind the surface.
    pub transmits: bool,
    /// Whether a delta lobe scatters.
    pub delta: bool,
    /// Whether it lies in a medium, and not on a surface.
    pub medium: bool,
}

impl Event {
    fn bits(self) -> u64 {
        u64::from(self.transmits) | u64::from(self.delta) << 1 | u64::from(self.medium) << 2
    }
}

/// What paths must have in common to be neighbours: length, succession of events, and kind of end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Kind {
    points: u8,
    /// Three bits for each vertex that scatters, the first in the lowest.
    events: u64,
    end: End,
}

/// How a path goes on from one of its points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Unit direction.
    pub direction: Vec3,
    /// Density w.r.t. solid angle with which the path tracer draws it: that of the BSDF or phase function, or of its mixture with a guide of
    /// directions; of a delta lobe its probability.
    pub pdf: f32,
    /// Probability with which guided sampling chooses the direction by a kernel and not by the BSDF; 0 for a delta lobe.
    pub by_kernel: f32,
    /// What happens there.
    pub event: Event,
}

/// A path from the camera to a light.
#[derive(Debug, Clone, PartialEq)]
pub struct CompletePath {
    /// Place in the picture, pixels.
    pub film: [f32; 2],
    /// Where the camera's ray starts.
    pub origin: Vec3,
    /// The points behind it, of [`End::Surface`] and [`End::Sky`] with that of the light.
    pub points: SmallVec<[Vec3; 6]>,
    /// How it goes on from each point that scatters.
    pub steps: SmallVec<[Step; 6]>,
    /// How it ends.
    pub end: End,
}

impl CompletePath {
    /// Its kind.
    pub fn kind(&self) -> Kind {
        let events = self.steps.iter().rev().fold(0, |bits, step| bits << 3 | step.event.bits());
        Kind { points: self.points.len() as u8, events, end: self.end }
    }

    /// Whether the point of this index lies in a medium.
    pub fn in_medium(&self, point: usize) -> bool {
        self.steps.get(point).is_some_and(|step| step.event.medium)
    }

    /// Squared distance between corresponding points of two paths of one kind (eq. 9), no further than where it exceeds `most`.
    pub fn squared_distance(&self, other: &Self, most: f32) -> f32 {
        let mut sum = 0.0;
        for (a, b) in self.points.iter().zip(&other.points) {
            sum += a.distance_squared(*b);
            if sum > most {
                break;
            }
        }
        sum
    }

    /// Whether all that it is made of is finite.
    pub fn is_finite(&self) -> bool {
        self.points.iter().all(|point| point.is_finite())
            && self.steps.iter().all(|step| step.direction.is_finite() && step.pdf.is_finite())
    }
}
