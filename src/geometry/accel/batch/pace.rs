//! Which way of answering a batch is the fastest here, by measured time: it depends on the scene, the processor and how alike the rays
//! are. Answers are the same by every way, so no picture depends on the clock.

use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Instant;

use super::Way;

/// Kinds of rays. Those of a kind lie about as close together from batch to batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RayKind {
    /// Segment number `.0` of camera paths, from 1 on.
    Path(u32),
    /// From vertex number `.0` of camera paths to lights.
    Shadow(u32),
    /// Segments of light paths.
    Photon,
}

/// Depths that are told apart; the last stands for all deeper ones.
const DEPTHS: usize = 4;
const KINDS: usize = 2 * DEPTHS + 1;

impl RayKind {
    fn index(self) -> usize {
        let depth = |depth: u32| (depth.max(1) as usize).min(DEPTHS) - 1;
        match self {
            Self::Path(number) => depth(number),
            Self::Shadow(number) => DEPTHS + depth(number),
            Self::Photon => 2 * DEPTHS,
        }
    }
}

/// Measured times of the ways, by kind. All threads share them; that they do so without waiting for one another costs at worst a batch
/// that is answered by a slower way.
#[derive(Default)]
pub struct Pace {
    kinds: [Times; KINDS],
    only: Option<Way>,
}

#[derive(Default)]
struct Times {
    /// Batches so far.
    batches: AtomicU32,
    /// Nanoseconds per 16 rays; 0 where a way was not tried.
    ways: [AtomicU32; Way::ALL.len()],
}

/// Every so many batches all ways are tried again.
const PERIOD: u32 = 256;
/// Smallest batch that tells of a way's time.
const TELLING: usize = 64;
/// Part of a new time in the mean.
const NEW: f64 = 0.2;

impl Pace {
    /// Always the same way: for those who count instructions, which must not depend on the clock.
    pub fn only(way: Way) -> Self {
        Self { only: Some(way), ..Self::default() }
    }

    /// Calls `answer` with the way that was the fastest for batches of this kind, or one that has to be tried, and takes its time for
    /// `rays` rays.
    #[inline]
    pub fn measure(&self, kind: RayKind, rays: usize, answer: impl FnOnce(Way)) {
        let times = &self.kinds[kind.index()];
        if let Some(way) = self.only {
            return answer(way);
        }
        if rays < TELLING {
            return answer(times.fastest());
        }
        let turn = times.batches.fetch_add(1, Ordering::Relaxed) % PERIOD;
        let way = Way::ALL.get(turn as usize).copied().unwrap_or_else(|| times.fastest());
        let begun = Instant::now();
        answer(way);
        times.tell(way, begun.elapsed().as_nanos() as f64 * 16.0 / rays as f64);
    }
}

impl Times {
    fn fastest(&self) -> Way {
        let time = |way: &Way| match self.ways[*way as usize].load(Ordering::Relaxed) {
            0 => u32::MAX,
            time => time,
        };
        Way::ALL.into_iter().min_by_key(time).unwrap_or(Way::InFlight)
    }

    fn tell(&self, way: Way, time: f64) {
        let mean = &self.ways[way as usize];
        let before = f64::from(mean.load(Ordering::Relaxed));
        // A batch during which the thread had to wait for a processor says little.
        let new = if before == 0.0 { time } else { before + NEW * (time.min(2.0 * before) - before) };
        mean.store(new.clamp(1.0, 1e9) as u32, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every way is tried, the fastest is taken from then on, also when another becomes the fastest, and kinds do not mix.
    #[test]
    fn the_fastest_way_is_taken() {
        let pace = Pace::default();
        let times = &pace.kinds[RayKind::Shadow(9).index()];
        assert_eq!(RayKind::Shadow(4).index(), RayKind::Shadow(9).index());
        for (way, time) in Way::ALL.into_iter().zip([30.0, 20.0, 10.0]) {
            times.tell(way, time);
        }
        assert_eq!(times.fastest(), Way::ALL[2]);
        (0..40).for_each(|_| times.tell(Way::ALL[2], 25.0));
        assert_eq!(times.fastest(), Way::ALL[1]);
        // One batch that waited changes nothing.
        times.tell(Way::ALL[1], 1e9);
        assert_eq!(times.fastest(), Way::ALL[2]);
        times.tell(Way::ALL[1], 15.0);
        let tried = |kind: RayKind, rays: usize, count: usize| {
            let mut tried = vec![];
            (0..count).for_each(|_| pace.measure(kind, rays, |way| tried.push(way)));
            tried
        };
        assert_eq!(tried(RayKind::Path(1), 100, 3), Way::ALL, "another kind");
        // Batches that are too small to tell do not try.
        let fastest = times.fastest();
        assert!(tried(RayKind::Shadow(9), TELLING - 1, 10).iter().all(|way| *way == fastest));
    }
}
