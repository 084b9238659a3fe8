//! How much of a budget to spend on learning (Müller 2017 §3.5), for passes that are combined.

use crate::guiding::moments::PictureMoments;

/// Share of the budget that is spent on learning without asking: variances of so few samples decide nothing.
const FREE_SHARE: f64 = 0.25;
/// Bounds of the predicted factor by which one more iteration lowers the variance of a sample. Measured factors are noisy: a
/// single firefly must neither stop learning for good nor promise wonders.
const FACTOR: [f64; 2] = [0.5, 0.97];

/// What is known before an iteration. Costs are all in one unit: samples per pixel, or seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outlook {
    /// The whole budget.
    pub budget: f64,
    /// What is left of it.
    pub left: f64,
    /// What the iteration would cost.
    pub cost: f64,
    /// Part of that cost that goes into the picture all the same: the share of camera paths.
    pub useful: f64,
    /// Most that learning may take of the budget.
    pub limit: f64,
}

/// Whether to learn for another iteration, given the variances of one sample in the iterations so far, and whether it is `known`
/// what the guide changes: while most of the noise is a few paths that found light by chance, variances tell nothing.
///
/// Stopping now renders `left` at the variance s of the field at hand. Learning on spends `cost`, of which `useful` is rendered at
/// s, and renders the rest at r·s, where r is how much the last iteration lowered the variance. Precisions add up where passes
/// are combined by inverse variance, so learning pays where (left − cost)(1/r − 1) exceeds cost·(1 − useful).
pub fn learns_on(outlook: &Outlook, variances: &[f64], known: bool) -> bool {
    let spent = outlook.budget - outlook.left;
    if spent + outlook.cost > outlook.limit * outlook.budget {
        return false;
    }
    if spent + outlook.cost <= FREE_SHARE * outlook.budget {
        return true;
    }
    let &[.., before, last] = variances else { return true };
    if !known {
        return true;
    }
    let usable = before.is_finite() && last.is_finite() && before > 0.0 && last > 0.0;
    let factor = if usable { (last / before).clamp(FACTOR[0], FACTOR[1]) } else { FACTOR[1] };
    (outlook.left - outlook.cost) * (1.0 / factor - 1.0) > outlook.cost * (1.0 - outlook.useful)
}

/// What a sample costs with a guide, in samples without: measured on scenes of a few triangles, where it is most. A constant
/// and not the clock, so that a budget in samples gives the same picture everywhere.
const GUIDED_COST: f64 = 1.35;

/// A path's vertices reduce the same variance together: at equal samples the box has 0.87 times the error where the sum over
/// vertices says 0.80, the room with the door 0.49 where it says 0.40.
const SHARED: f64 = 0.7;

/// Effective samples below which moments tell nothing: a few paths that found light by chance say little of those that did not.
const LEAST_EVIDENCE: f64 = 256.0;
/// Share of photons where paths have found nothing, above which moments tell nothing either.
const MOST_UNSEEN: f64 = 0.2;
/// Part of the variance that is too small to matter, however little is known of it.
const SMALL_PART: f64 = 0.25;

/// Variance of a sample with a guide over that without it.
///
/// `variance` is that of a sample while learning, relative to the pixel's squared value; `moments`, in the same unit, were measured
/// on `paths` samples. Means are the same whatever guides, so variances differ as second moments do; what lies between the pixels
/// of an edge is in the variance alone. A path's vertices are counted as if their gains added up, which promises too much, hence
/// the power. None where nothing was measured, where photons know of light that paths have not found, or where what guiding
/// changes is much of the variance and rests on few samples.
pub fn gain(variance: f64, moments: &PictureMoments, paths: f64) -> Option<f64> {
    let PictureMoments { learning, guided, unguided, onward, effective, unseen } = *moments;
    if effective < LEAST_EVIDENCE && onward / paths > SMALL_PART * variance || unseen > MOST_UNSEEN {
        return None;
    }
    let [with, without] = [guided, unguided].map(|moment| variance + (moment - learning) / paths);
    (without.is_finite() && without > 0.0).then(|| (with / without).max(0.0).powf(SHARED))
}

/// Whether guiding with such a gain is worth what it costs.
pub fn pays(gain: f64) -> bool {
    gain * GUIDED_COST < 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outlook(left: f64, cost: f64, useful: f64) -> Outlook {
        Outlook { budget: 100.0, left, cost, useful, limit: 0.5 }
    }

    #[test]
    fn guiding_pays_where_it_changes_most_of_the_variance() {
        let gain = |variance, [learning, guided, unguided]: [f64; 3], effective| {
            let onward = learning;
            gain(variance, &PictureMoments { learning, guided, unguided, onward, effective, unseen: 0.1 }, 1.0)
        };
        let ones = PictureMoments { learning: 1.0, guided: 1.0, unguided: 1.0, ..PictureMoments::default() };
        let unseen = PictureMoments { effective: 1e3, unseen: 0.5, ..ones };
        assert_eq!(super::gain(10.0, &unseen, 1.0), None, "photons know of light that no path has found");
        assert!(pays(gain(10.0, [8.0, 4.0, 30.0], 1e3).unwrap()));
        assert!(!pays(gain(10.0, [8.0, 7.0, 9.0], 1e3).unwrap()), "a small gain");
        assert!(!pays(gain(1000.0, [8.0, 4.0, 30.0], 3.0).unwrap()), "a large gain in a small part");
        assert_eq!(gain(10.0, [8.0, 7.0, 9.0], 3.0), None, "a small gain of which little is known");
        assert_eq!(gain(0.0, [0.0; 3], 1e3), None, "no light was found");
        assert_eq!(gain(f64::NAN, [1.0; 3], 1e3), None);
        assert_eq!(gain(1.0, [5.0, 2.0, 6.0], 1e3), Some(0.0));
    }

    #[test]
    fn learning_goes_on_while_it_pays() {
        let halving = [8.0, 4.0];
        let flat = [8.0, 8.0];
        assert!(learns_on(&outlook(94.0, 6.0, 0.5), &flat, true), "the first iterations are free");
        assert!(learns_on(&outlook(80.0, 20.0, 0.5), &halving, true));
        assert!(!learns_on(&outlook(80.0, 20.0, 0.5), &flat, true), "nothing is gained by photons that teach nothing");
        assert!(!learns_on(&outlook(60.0, 20.0, 0.5), &halving, true), "no more than the limit");
        assert!(!learns_on(&outlook(80.0, 20.0, 0.5), &[8.0, 16.0], true), "a guide that gets worse");
        assert!(learns_on(&outlook(80.0, 20.0, 1.0), &flat, true), "learning that costs nothing");
        assert!(!learns_on(&outlook(80.0, 20.0, 0.5), &[f64::NAN, 0.0], true));
        assert!(learns_on(&outlook(80.0, 20.0, 0.5), &[1.0], true), "one variance has no trend");
        assert!(learns_on(&outlook(80.0, 20.0, 0.5), &[1.0, 9.0], false), "light that has only just been found");
        assert!(!learns_on(&outlook(60.0, 20.0, 0.5), &[1.0, 9.0], false), "no more than the limit");
    }
}
