//! What paths leave behind where they scatter, until it is known what arrives there: their vertices, and connections to lights that
//! something may be in the way of.

use glam::Vec3;

use super::{Background, Details, PathState, Vertex};
use crate::base::random::Random;
use crate::geometry::{Met, Ray};
use crate::lights::tried::Trial;
use crate::materials::medium::MediumId;
use crate::materials::phase::HenyeyGreenstein;
use crate::scene::effects::Effects;

/// The vertices of all paths, in the order of depth; each knows the one before it on its path.
#[derive(Default)]
pub(super) struct Vertices {
    pub all: Vec<Vertex>,
    /// Transmittance of the media before each, over the density of getting there; empty where there are no media.
    pub passed: Vec<Vec3>,
    /// Light of media on the way to each; empty where none has any.
    pub glow: Vec<Vec3>,
    /// What the paths that have left the scene ran into.
    pub backgrounds: Vec<Background>,
    /// Of each where records are wanted, otherwise none.
    pub details: Vec<Details>,
    /// The same of media, where it is wanted and there are any.
    pub flights: Vec<Flown>,
    /// Whether that is wanted.
    pub tells_flights: bool,
    /// What came of lights that were chosen, where that is counted.
    pub trials: Vec<Trial>,
}

impl Vertices {
    /// Index of the vertex that is pushed next.
    #[inline(always)]
    pub fn next(&self) -> u32 {
        self.all.len() as u32
    }

    /// What a path ran into behind its last vertex: nothing unless it has left the scene.
    #[inline(always)]
    pub fn background(&self, path: &PathState) -> Background {
        self.backgrounds.get(path.background as usize).copied().unwrap_or_default()
    }

    /// Adds a vertex.
    #[inline(always)]
    pub fn push<E: Effects, const RECORDS: bool>(
        &mut self,
        vertex: Vertex,
        passed: Vec3,
        details: impl FnOnce() -> Details,
    ) {
        self.all.push(vertex);
        if E::MEDIA {
            self.passed.push(passed);
        }
        if RECORDS {
            self.details.push(details());
        }
    }

    pub fn clear(&mut self) {
        self.all.clear();
        self.passed.clear();
        self.glow.clear();
        self.backgrounds.clear();
        self.details.clear();
        self.flights.clear();
        self.trials.clear();
    }
}

/// How a path through media got to a vertex.
pub(super) struct Flown {
    /// See [`Passage::density`](crate::scene::media::Passage::density).
    pub density: f32,
    /// The phase function of a medium, if it is there that the vertex lies.
    pub phase: Option<HenyeyGreenstein>,
}

/// A vertex and a sampled light, before it is known whether anything is in the way.
pub(super) struct Connection {
    /// Index of the vertex.
    pub vertex: u32,
    /// Which way its surface faces.
    pub facing: u8,
    /// f·L.
    pub value: Vec3,
    /// Density of light sampling.
    pub pdf: f32,
    /// The BSDF's density in the light's direction; 0 where no ray can hit the light.
    pub bsdf_pdf: f32,
    /// Weight of light sampling against the BSDF over its density; known only without guides.
    pub factor: f32,
}

/// A light with a place that was chosen at a vertex, before it is known what it brings.
pub(super) struct Tried {
    /// Indices of the path and of the vertex.
    pub path: u32,
    pub vertex: u32,
    pub point: Vec3,
    /// Index of the light.
    pub light: u32,
    /// Throughput of the path up to there.
    pub carried: Vec3,
}

/// What the guide at a vertex will be asked of the direction to a light, if nothing is in the way.
pub(super) struct Towards {
    /// Index of its voxel; none where the BSDF samples alone, and where no ray can hit the light.
    pub voxel: Option<u32>,
    pub point: Vec3,
    /// See [`cosine_normal`](crate::integrators::mixture::cosine_normal).
    pub normal: Vec3,
    /// Unit direction to the light.
    pub direction: Vec3,
    /// Probability of a delta lobe.
    pub deltas: f32,
}

/// The connections of one depth.
#[derive(Default)]
pub(super) struct Shadows {
    /// Shadow rays with their lengths.
    pub rays: Vec<(Ray, f32)>,
    /// What each brings, and to which vertex.
    pub connections: Vec<Connection>,
    /// For the weight of each; empty without guides.
    pub guided: Vec<Towards>,
    /// The lights that were chosen, where that is counted.
    pub tried: Vec<Tried>,
    /// Media that the rays start in; empty where there are no media.
    pub media: Vec<Option<MediumId>>,
    /// Random numbers for what lies on the way; empty where no medium varies.
    pub random: Vec<Random>,
    /// What each ray meets.
    pub met: Vec<Met>,
    pub occluded: Vec<bool>,
}

impl Shadows {
    pub fn clear(&mut self) {
        self.rays.clear();
        self.connections.clear();
        self.guided.clear();
        self.tried.clear();
        self.media.clear();
        self.random.clear();
    }
}
