//! How much of a budget to spend on learning (Müller 2017 §3.5), for passes that are combined.

use crate::film::VarianceRatio;
use crate::guiding::moments::PictureMoments;

/// Share of the budget that is spent on learning without asking: variances of so few samples decide nothing. And where a guide is known to
/// gain little.
const FREE_SHARE: f64 = 0.25;
const FREE_IF_WEAK: f64 = 0.05;
/// What the camera samples of iterations are worth in a picture that needs no strong guide, over those of the final pass: these follow longer
/// sequences, and go where noise is.
const WORTH_IF_WEAK: f64 = 0.5;
/// Bounds of the predicted factor by which one more iteration lowers the variance of a sample. Measured factors are noisy: a
/// single firefly must neither stop learning for good nor promise wonders.
const FACTOR: [f64; 2] = [0.5, 0.97];

/// Budget and expected cost of an iteration before it begins. Costs are all in one unit: samples per pixel, or seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outlook {
    /// The whole budget.
    pub budget: f64,
    /// Rest of the budget.
    pub left: f64,
    /// Expected cost of the iteration.
    pub cost: f64,
    /// Share of that cost for camera paths, in [0, 1], which goes into the picture all the same.
    pub camera_part: f64,
    /// Largest share of the budget that learning may take, in [0, 1].
    pub limit: f64,
}

/// Verdict of an iteration on the guide that it made.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Verdict {
    /// Variance of a sample with the guide over that without it, in (0, ∞).
    Gain(f64),
    /// A guide was sampled, but the part of the variance that guiding changes is large and rests on few samples.
    Few,
    /// Photons show light that camera paths have not found: guiding will change the variance, by how much is not known.
    Unseen,
    /// Nothing was measured.
    #[default]
    Unknown,
}

impl Verdict {
    /// The gain, where it was measured.
    pub fn gain(self) -> Option<f64> {
        if let Self::Gain(gain) = self { Some(gain) } else { None }
    }

    /// The verdict on a guide that was `tried`. Moments do not tell what roulette gains, nor what vertices gain together; but where they
    /// tell of much, samples without the guide may have missed the light that it finds.
    pub fn or_tried(self, tried: Tried) -> Self {
        match (self, tried.gain()) {
            (Self::Gain(told), Some(tried)) if told * MOST_COST > 1.0 || tried < told => Self::Gain(tried),
            _ => self,
        }
    }

    /// As much of the verdict as decides on learning before iteration `t`, see [`learns_on`], of a render with this `patience` that is
    /// guided in any case if `always`. Variances of the first iterations are no trend, and a firefly in one of them says nothing against a
    /// guide that gains much; but what gains little, as was `tried`, is learned no longer than it takes to know that.
    pub fn believed(self, t: u32, patience: u32, tried: Tried, always: bool) -> Self {
        let is_early = match self {
            Self::Gain(gain) if gain < STRONG => t <= patience || t < LATEST_VERDICT,
            Self::Gain(_) => t < patience + u32::from(tried.gain().is_none()),
            Self::Few | Self::Unknown => t <= LATEST_VERDICT || always,
            Self::Unseen => true,
        };
        if is_early { Self::Unseen } else { self }
    }

    /// The verdict as one number for checkpoints: the gain, -1 for few samples, ∞ for unseen, NaN for unknown.
    pub fn number(self) -> f64 {
        match self {
            Self::Gain(gain) => gain,
            Self::Few => -1.0,
            Self::Unseen => f64::INFINITY,
            Self::Unknown => f64::NAN,
        }
    }

    /// The verdict whose [`Verdict::number`] this is.
    pub fn from_number(number: f64) -> Self {
        match number {
            f64::INFINITY => Self::Unseen,
            gain if gain >= 0.0 => Self::Gain(gain),
            -1.0 => Self::Few,
            _ => Self::Unknown,
        }
    }

    /// Whether a guide with this verdict may turn out to be worth its cost, that of a sample with it over that without: all may but those
    /// whose gain was measured and is too small. One that was `doubted` before has to be clearly better now.
    pub fn may_pay(self, cost: f64, doubted: Option<f64>) -> bool {
        let confirmed = |gain: f64| doubted.is_none_or(|doubted| gain < CONFIRMING * doubted);
        self.price(cost).is_none_or(|price| price < 1.0) && self.gain().is_none_or(confirmed)
    }

    /// What a guide costs over what it brings, where its gain was measured and a sample with it costs `cost` times one without.
    pub fn price(self, cost: f64) -> Option<f64> {
        self.gain().map(|gain| gain * cost.min(MOST_COST))
    }

    /// Whether a gain is so little too small that it may be for the few paths of an early iteration, and the next should decide.
    pub fn is_doubtful(self, cost: f64) -> bool {
        self.price(cost).is_some_and(|price| (1.0..DOUBT).contains(&price))
    }

    /// Whether a guide with this verdict is used when nothing more is to be learned. One that no path has tried is not: in a room that
    /// needs none it costs half of the samples.
    pub fn pays(self, cost: f64, doubted: Option<f64>) -> bool {
        self != Self::Unknown && self.may_pay(cost, doubted)
    }
}

/// Whether to learn for another iteration, given the variances of one sample in the iterations so far, and the `verdict` on the guide.
/// With [`Verdict::Unseen`] variances tell nothing, and learning goes on. With [`Verdict::Few`] and [`Verdict::Unknown`] no more than the
/// free share is spent: scenes with fireflies would be learned until half of the budget is gone.
///
/// Stopping now renders `left` at the variance s of the field at hand. Learning on spends `cost`, of which `camera_part` is rendered at
/// s, and renders the rest at r·s, where r is how much the last iteration lowered the variance. Precisions add up where passes
/// are combined by inverse variance, so learning pays where (left − cost)(1/r − 1) exceeds cost·(1 − camera_part).
pub fn learns_on(outlook: &Outlook, variances: &[f64], verdict: Verdict) -> bool {
    let spent = outlook.budget - outlook.left;
    if spent + outlook.cost > outlook.limit * outlook.budget {
        return false;
    }
    let is_weak = verdict.gain().is_some_and(|gain| gain >= STRONG);
    let (free, worth) = if is_weak { (FREE_IF_WEAK, WORTH_IF_WEAK) } else { (FREE_SHARE, 1.0) };
    if spent + outlook.cost <= free * outlook.budget {
        return true;
    }
    let &[.., before, last] = variances else { return true };
    match verdict {
        Verdict::Unseen => return true,
        Verdict::Few | Verdict::Unknown => return false,
        Verdict::Gain(_) => (),
    }
    let usable = before.is_finite() && last.is_finite() && before > 0.0 && last > 0.0;
    let factor = if usable { (last / before).clamp(FACTOR[0], FACTOR[1]) } else { FACTOR[1] };
    (outlook.left - outlook.cost) * (1.0 / factor - 1.0) > outlook.cost * (1.0 - worth * outlook.camera_part)
}

/// What comparing samples with and without a guide has told of it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Tried {
    /// They were not compared.
    #[default]
    Not,
    /// Too few pixels told.
    Unclear,
    /// Variance of a sample with the guide over that without it, see [`compared`].
    Gain(f64),
}

impl Tried {
    /// The gain, where it was told.
    pub fn gain(self) -> Option<f64> {
        if let Self::Gain(gain) = self { Some(gain) } else { None }
    }

    /// What was told as one number for checkpoints: the gain, -1 where it is not clear, NaN where nothing was compared.
    pub fn number(self) -> f64 {
        match self {
            Self::Not => f64::NAN,
            Self::Unclear => -1.0,
            Self::Gain(gain) => gain,
        }
    }

    /// What has this [`Tried::number`].
    pub fn from_number(number: f64) -> Self {
        match number {
            gain if gain >= 0.0 => Self::Gain(gain),
            -1.0 => Self::Unclear,
            _ => Self::Not,
        }
    }
}

/// Gain by comparing the same samples without and with a guide, which cost `cost` times as much with it, as one of samples whose cost counts
/// as `counted`: the ratio of their variances, one standard error more and a tenth for what is still to be learned. Where the comparison is
/// too uncertain for that it still tells of guides that would not pay if it were wrong by [`SURE`] standard errors, unless moments have `told`
/// of a gain below [`WEAK`]: then so few samples without the guide may have missed the light.
pub fn compared(of: VarianceRatio, cost: f64, counted: f64, told: f64) -> Tried {
    let counted = counted.min(MOST_COST);
    let gain = |errors: f64| TO_LEARN * of.ratio * (errors * of.error).exp() * cost / counted;
    if of.error < MOST_ERROR {
        return Tried::Gain(gain(1.0));
    }
    let least = gain(-SURE);
    if least * counted >= 1.0 && told >= WEAK { Tried::Gain(least) } else { Tried::Unclear }
}

/// What is still to be learned costs samples too.
const TO_LEARN: f64 = 1.1;
/// Largest relative standard error of a comparison that tells how much a guide gains: that of 89 pixels each, if nothing pairs them.
const MOST_ERROR: f64 = 0.15;
/// First gains are at least this by moments on scenes that need no guide, and below it where they do (see [`DOUBT`]).
const WEAK: f64 = 0.84;
/// Standard errors by which a more uncertain comparison has to be away from a guide that pays.
const SURE: f64 = 2.0;

/// Cost of a sample with a guide over that without where it is not measured. A constant and not the clock, so that a budget in samples
/// gives the same picture everywhere; that such a budget is to be well spent counts more than the time it takes, which is 1.3 to 2.3
/// times that without a guide.
pub const GUIDED_COST: f64 = 1.35;
/// The same for rays.
pub const GUIDED_RAY_COST: f64 = 1.4;

/// Largest cost of a guided sample that counts. Where guiding gains much, it gains more than the vertices of its first guides tell, as each
/// was reached by guided ones: `lamp-room` has 0.04 times the error at equal time where they say 0.5 and samples cost twice as much. Giving
/// up there loses all of that, keeping a guide of 0.7 that costs as much and gains no more loses 0.4. First guides have 0.3 to 0.7 on scenes
/// whose light is hard to find, and not below 0.75 on six where light sampling finds it, later ones 0.67 and more; so a gain of 0.66 is kept at
/// any cost.
const MOST_COST: f64 = 1.5;

/// Gain over the least one that does not pay, below which it is doubtful. First gains are 0.43 to 0.83 by 24 seeds of `gaussian` on
/// `door-ajar`, where it leaves a twentieth of the error, and 0.84 and more on twelve scenes that need no guide, or not yet.
const DOUBT: f64 = 1.13;
/// Gain over a doubted one that says that guiding pays after all: 0.53 to 0.79 where it does, 0.83 to 1.03 where it does not.
const CONFIRMING: f64 = 0.82;

/// Iterations after which a verdict should be known even where light is hard to find.
pub const LATEST_VERDICT: u32 = 4;

/// Gain below which a guide is worth learning more of, whatever the variances of the first iterations.
pub const STRONG: f64 = 0.5;

/// Exponent of the gain, since a path's vertices reduce the same variance together: at equal samples the box has 0.87 times the
/// error where the sum over vertices says 0.80, the room with the door 0.49 where it says 0.40.
const SHARED: f64 = 0.7;

/// Effective samples below which moments tell nothing: a few paths that found light by chance say little of those that did not.
const LEAST_EVIDENCE: f64 = 256.0;
/// Share of the light by photons in places where camera paths have found none, above which moments tell nothing either. Rooms in which
/// sun and sky come through windows have at most 0.07, `door-ajar`, `pinhole` and `spot` 0.4 to 1 before paths have found their light.
const MOST_UNSEEN: f64 = 0.2;
/// Part of the variance that is too small to matter, however little is known of it.
const SMALL_PART: f64 = 0.25;

/// Variance of a sample with a guide over that without it, see [`Verdict`].
///
/// `variance` is that of a sample while learning, relative to the pixel's squared value, none where it is not known; `moments`, in the
/// same unit, were measured on `paths` samples. Means are the same whatever guides, so variances differ as second moments do; what lies
/// between the pixels of an edge is in the variance alone. A path's vertices are counted as if their gains added up, which promises too
/// much, hence the power.
pub fn judged(variance: Option<f64>, moments: &PictureMoments, paths: f64) -> Verdict {
    judged_by(LEAST_EVIDENCE, variance, moments, paths)
}

/// [`judged`] by a quarter of the evidence, for those who ask only whether a guide gains next to nothing: in rooms the first guides have
/// 0.87 to 1.2 by so few samples, where guides pay they have 0.3 to 0.8.
pub fn judged_roughly(variance: Option<f64>, moments: &PictureMoments, paths: f64) -> Verdict {
    judged_by(LEAST_EVIDENCE / 4.0, variance, moments, paths)
}

fn judged_by(least_evidence: f64, variance: Option<f64>, moments: &PictureMoments, paths: f64) -> Verdict {
    let PictureMoments { learning, guided, unguided, onward, effective, unseen } = *moments;
    if unseen > MOST_UNSEEN {
        return Verdict::Unseen;
    }
    let Some(variance) = variance else { return Verdict::Unknown };
    let [with, without] = [guided, unguided].map(|moment| variance + (moment - learning) / paths);
    if !(with.is_finite() && without.is_finite() && without > 0.0) {
        return Verdict::Unknown;
    }
    let few = effective < least_evidence && onward / paths > SMALL_PART * variance;
    if few { Verdict::Few } else { Verdict::Gain((with / without).max(0.0).powf(SHARED)) }
}

/// Camera paths of the first iteration, unless so many are less than one in [`EVERY_PIXEL`] pixels.
const FIRST_PATHS: u64 = 1 << 14;
/// The first iteration visits at least one in so many pixels, so that the rows that it leaves out have neighbours.
const EVERY_PIXEL: u64 = 8;

/// Pixels that iteration `t` of a picture of `pixels` visits, and its samples in each of them. Each iteration has twice the paths of the
/// one before, the third four times: two small ones find out whether guiding pays at all. Where `caustics` are much of the light, the
/// second has eight times as many as the first. After the first they have two samples per pixel or more, which their variance is
/// measured by. Of small pictures iteration t has 2^t samples per pixel.
pub fn iteration_size(t: u32, pixels: u64, caustics: bool) -> (u64, u32) {
    let growth = match t {
        0 => 0,
        _ if caustics => t + 2,
        _ => t + u32::from(t > 1),
    };
    let paths = FIRST_PATHS.max(pixels / EVERY_PIXEL).saturating_mul(1 << growth.min(32));
    let spp = (paths / pixels.max(1)).clamp(if t == 0 { 1 } else { 2 }, 1 << t.min(30));
    ((paths / spp).min(pixels), spp as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outlook(left: f64, cost: f64, camera_part: f64) -> Outlook {
        Outlook { budget: 100.0, left, cost, camera_part, limit: 0.5 }
    }

    #[test]
    fn guiding_pays_where_it_changes_most_of_the_variance() {
        let verdict = |variance, [learning, guided, unguided]: [f64; 3], effective| {
            let onward = learning;
            judged(Some(variance), &PictureMoments { learning, guided, unguided, onward, effective, unseen: 0.1 }, 1.0)
        };
        let ones = PictureMoments { learning: 1.0, guided: 1.0, unguided: 1.0, ..PictureMoments::default() };
        let unseen = PictureMoments { effective: 1e3, unseen: 0.5, ..ones };
        for variance in [None, Some(10.0)] {
            assert_eq!(judged(variance, &unseen, 1.0), Verdict::Unseen, "photons know of light that no path has found");
        }
        assert_eq!(judged(None, &ones, 1.0), Verdict::Unknown);
        let pays = |verdict: Verdict, cost: f64| verdict.gain().is_some_and(|_| verdict.pays(cost, None));
        assert!(pays(verdict(10.0, [8.0, 4.0, 30.0], 1e3), GUIDED_COST));
        assert!(pays(verdict(10.0, [8.0, 4.0, 30.0], 1e3), 5.0), "a large gain at any price");
        assert!(
            pays(verdict(10.0, [8.0, 6.0, 16.0], 1e3), 1.8),
            "so does a gain that few scenes have without need of a guide"
        );
        assert!(pays(verdict(10.0, [8.0, 8.0, 13.0], 1e3), 1.2) && !pays(verdict(10.0, [8.0, 8.0, 13.0], 1e3), 1.8));
        assert!(!verdict(10.0, [8.0, 7.0, 9.0], 1e3).pays(GUIDED_COST, None), "a small gain");
        assert!(!verdict(1000.0, [8.0, 4.0, 30.0], 3.0).pays(GUIDED_COST, None), "a large gain in a small part");
        assert_eq!(verdict(10.0, [8.0, 7.0, 9.0], 3.0), Verdict::Few, "a small gain of which little is known");
        assert!(!Verdict::Unknown.pays(1.0, None) && Verdict::Unknown.may_pay(2.0, None));
        assert!(Verdict::Few.pays(2.0, None) && Verdict::Unseen.pays(5.0, None));
        let some = PictureMoments { effective: 100.0, onward: 1.0, ..ones };
        assert_eq!(judged(Some(1.0), &some, 1.0), Verdict::Few);
        assert_eq!(judged_roughly(Some(1.0), &some, 1.0), Verdict::Gain(1.0));
        assert_eq!(verdict(0.0, [0.0; 3], 1e3), Verdict::Unknown, "no light was found");
        assert_eq!(verdict(f64::NAN, [1.0; 3], 1e3), Verdict::Unknown);
        assert_eq!(verdict(1.0, [5.0, 2.0, 6.0], 1e3), Verdict::Gain(0.0));
        for verdict in [Verdict::Gain(0.7), Verdict::Few, Verdict::Unseen] {
            assert_eq!(Verdict::from_number(verdict.number()), verdict);
        }
        assert_eq!(Verdict::from_number(Verdict::Unknown.number()), Verdict::Unknown);
    }

    #[test]
    fn a_doubtful_gain_waits_for_a_better_one() {
        let doubtful = |gain: f64, cost| Verdict::Gain(gain).is_doubtful(cost);
        assert!(!doubtful(0.7, GUIDED_COST) && doubtful(0.75, GUIDED_COST) && doubtful(0.83, GUIDED_COST));
        assert!(!doubtful(0.84, GUIDED_COST), "what needs no guide has more");
        assert!(doubtful(0.7, 5.0) && !doubtful(0.76, 5.0), "at any price");
        assert!(!Verdict::Few.is_doubtful(GUIDED_COST) && !Verdict::Unseen.is_doubtful(GUIDED_COST));
        let pays = |verdict: Verdict, doubted| verdict.pays(GUIDED_COST, doubted);
        assert!(
            pays(Verdict::Gain(0.65), Some(0.83)) && pays(Verdict::Gain(0.7), None) && pays(Verdict::Few, Some(0.83))
        );
        assert!(!pays(Verdict::Gain(0.7), Some(0.83)), "enough, but hardly better than what was not");
        assert!(!pays(Verdict::Gain(0.78), Some(1.0)), "much better, but not enough");
    }

    #[test]
    fn a_comparison_says_what_moments_do_not() {
        let gain = |ratio, error, cost, counted| compared(VarianceRatio { ratio, error }, cost, counted, 0.9);
        assert!(gain(0.5, 1e-4, 1.35, 1.35).gain().is_some_and(|gain| (gain - 0.55).abs() < 1e-3));
        assert!(
            gain(0.5, 0.07, 1.35, 1.35).gain().is_some_and(|gain| gain > 0.58),
            "few pixels may be wrong by a standard error"
        );
        assert_eq!(gain(0.5, 0.2, 1.35, 1.35), Tried::Unclear, "too few");
        assert_eq!(gain(1.3, 0.2, 1.0, 1.1), Tried::Unclear, "it may pay for all that is known");
        let surely = gain(1.5, 0.2, 1.0, 1.1);
        assert!(surely.gain().is_some_and(|gain| gain * 1.1 >= 1.0), "{surely:?}");
        let hidden = compared(VarianceRatio { ratio: 1.5, error: 0.2 }, 1.0, 1.1, 0.7);
        assert_eq!(hidden, Tried::Unclear, "moments may know of light that few samples have missed");
        // Whatever cost counts beside moments, the verdict by comparison is that of the cost itself.
        for (guided, cost) in [(4.0, 2.0), (6.0, 2.0), (9.0, 0.8), (13.0, 0.8), (9.0, 1.35)] {
            let counted = f64::max(cost, 1.1);
            let tried = Verdict::Gain(1.2).or_tried(gain(guided / 10.0, 1e-4, cost, counted));
            assert_eq!(tried.pays(counted, None), 1.1 * guided / 10.0 * cost < 1.0, "{guided} {cost}");
        }
        assert_eq!(
            Verdict::Gain(0.6).or_tried(Tried::Gain(1.4)),
            Verdict::Gain(0.6),
            "unguided samples may have missed the light"
        );
        assert_eq!(Verdict::Gain(0.6).or_tried(Tried::Gain(0.5)), Verdict::Gain(0.5));
        assert_eq!(Verdict::Gain(0.9).or_tried(Tried::Gain(0.7)), Verdict::Gain(0.7));
        assert_eq!(Verdict::Gain(0.8).or_tried(Tried::Gain(1.1)), Verdict::Gain(1.1), "moments count too much");
        for verdict in [Verdict::Gain(0.9), Verdict::Few, Verdict::Unseen, Verdict::Unknown] {
            assert_eq!(verdict.or_tried(Tried::Not), verdict);
            assert_eq!(verdict.or_tried(Tried::Unclear), verdict);
        }
        assert_eq!(
            Verdict::Unseen.or_tried(Tried::Gain(0.1)),
            Verdict::Unseen,
            "there is light that neither has found"
        );
        for tried in [Tried::Not, Tried::Unclear, Tried::Gain(0.0), Tried::Gain(0.7)] {
            assert_eq!(Tried::from_number(tried.number()), tried);
        }
    }

    #[test]
    fn learning_goes_on_while_it_pays() {
        let (halving, flat, known) = ([8.0, 4.0], [8.0, 8.0], Verdict::Gain(0.4));
        assert!(learns_on(&outlook(94.0, 6.0, 0.5), &flat, known), "the first iterations are free");
        assert!(learns_on(&outlook(80.0, 20.0, 0.5), &halving, known));
        assert!(!learns_on(&outlook(80.0, 20.0, 0.5), &flat, known), "nothing is gained by photons that teach nothing");
        assert!(!learns_on(&outlook(60.0, 20.0, 0.5), &halving, known), "no more than the limit");
        assert!(!learns_on(&outlook(80.0, 20.0, 0.5), &[8.0, 16.0], known), "a guide that gets worse");
        assert!(learns_on(&outlook(80.0, 20.0, 1.0), &flat, known), "learning that costs nothing");
        assert!(!learns_on(&outlook(80.0, 20.0, 0.5), &[f64::NAN, 0.0], known));
        assert!(learns_on(&outlook(80.0, 20.0, 0.5), &[1.0], known), "one variance has no trend");
        assert!(
            learns_on(&outlook(80.0, 20.0, 0.5), &[1.0, 9.0], Verdict::Unseen),
            "light that has only just been found"
        );
        assert!(!learns_on(&outlook(60.0, 20.0, 0.5), &[1.0, 9.0], Verdict::Unseen), "no more than the limit");
        assert!(!learns_on(&outlook(80.0, 20.0, 0.5), &halving, Verdict::Few), "fireflies");
        assert!(learns_on(&outlook(94.0, 6.0, 0.5), &flat, Verdict::Unknown), "the first iterations are free");
        let weak = Verdict::Gain(0.8);
        assert!(!learns_on(&outlook(94.0, 6.0, 0.5), &flat, weak), "not those of a guide that gains little");
        assert!(
            learns_on(&outlook(97.0, 2.0, 0.5), &flat, weak) && learns_on(&outlook(94.0, 6.0, 0.5), &halving, weak)
        );
        assert!(learns_on(&outlook(80.0, 20.0, 1.0), &[8.0, 7.2], known));
        assert!(
            !learns_on(&outlook(80.0, 20.0, 1.0), &[8.0, 7.2], weak),
            "whose samples are worth less than those of the final pass"
        );
    }

    /// Before which iterations a verdict is believed for the first time, by patience.
    #[test]
    fn early_verdicts_end_no_learning() {
        for (verdict, tried, iterations) in [
            (Verdict::Gain(0.3), Tried::Gain(0.3), [4, 5]),
            (Verdict::Gain(0.7), Tried::Gain(0.9), [2, 4]),
            (Verdict::Gain(0.7), Tried::Unclear, [3, 5]),
            (Verdict::Few, Tried::Not, [5; 2]),
            (Verdict::Unknown, Tried::Not, [5; 2]),
            (Verdict::Unseen, Tried::Not, [0; 2]),
        ] {
            for (patience, iterations) in [2, 4].into_iter().zip(iterations) {
                let first = (0..31).find(|&t| verdict.believed(t, patience, tried, false) == verdict);
                assert_eq!(first, Some(iterations), "{verdict:?} {tried:?} {patience}");
            }
        }
        let always = Verdict::Few.believed(30, 2, Tried::Not, true);
        assert_eq!(always, Verdict::Unseen, "what is always guided is learned");
    }

    #[test]
    fn iterations_double_and_leave_no_wide_gaps() {
        for pixels in [1, 48, 1024, 57_600, 921_600, 1 << 26] {
            let sizes: Vec<(u64, u32)> = (0..31).map(|t| iteration_size(t, pixels, pixels == 57_600)).collect();
            for (t, &(places, spp)) in sizes.iter().enumerate() {
                assert!(places <= pixels && places >= pixels / 8 && places > 0, "{pixels} {t}: {places}");
                assert!(spp <= 1 << t && (t == 0 || spp >= 2), "{pixels} {t}: {spp}");
            }
            for pair in sizes[3..].windows(2) {
                let [before, after] = [pair[0], pair[1]].map(|(places, spp)| places as f64 * f64::from(spp));
                assert!((1.3..3.0).contains(&(after / before)), "{pixels}: {before} {after}");
            }
            assert_eq!(sizes[30].0, pixels, "all of the picture in the end");
        }
    }
}
