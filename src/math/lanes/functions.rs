//! Transcendental functions of sums, products, quotients and square roots alone, so that they have the same bits in every lane of every
//! processor. Reductions and polynomials are those of Cephes for single precision (Moshier 1992, *Methods and Programs for
//! Mathematical Functions*); errors are in units in the last place (ulp), measured over all exponents by the tests.

use std::f32::consts::{FRAC_2_PI, FRAC_PI_2, FRAC_PI_4, LOG2_E, PI, SQRT_2, TAU};

use super::{Bits, Mask, Real};

/// Polynomial with the highest coefficient first.
#[inline(always)]
pub fn polynomial<R: Real, const N: usize>(x: R, coefficients: [f32; N]) -> R {
    let mut sum = x.all(coefficients[0]);
    for coefficient in &coefficients[1..] {
        sum = sum * x + x.all(*coefficient);
    }
    sum
}

/// Sine and cosine of an angle of up to 8192 in magnitude: within 2 ulp, or 1e-7 where they are small.
#[inline(always)]
pub fn sin_cos<R: Real>(x: R) -> (R, R) {
    // π/2 in three parts, so that their products with small whole numbers are exact.
    const PARTS: [f32; 3] = [1.570_312_5, 4.837_513e-4, 7.549_79e-8];
    let turns = (x * x.all(FRAC_2_PI)).nearest();
    let quarter = turns.real();
    let r = ((x - quarter * x.all(PARTS[0])) - quarter * x.all(PARTS[1])) - quarter * x.all(PARTS[2]);
    sin_cos_around(turns, r)
}

/// Steps of a turn that is counted in integers.
const STEPS: f32 = 4_294_967_296.0;

/// Sine and cosine of a part of a turn, in steps of 2⁻³²: within 1.2e-7.
#[inline(always)]
pub fn sin_cos_turn<R: Real>(turn: R::Bits) -> (R, R) {
    // What is left of the nearest quarter: the bits below it, with their own sign.
    let rest: R = turn.left::<2>().right::<2>().real();
    let quarters = (turn.right::<29>() + turn.all(1)).right::<1>();
    sin_cos_around(quarters, rest * rest.all(TAU / STEPS))
}

/// Sine and cosine of an angle `r` of up to π/4 in magnitude beyond whole quarters of a turn.
#[inline(always)]
fn sin_cos_around<R: Real>(turns: R::Bits, r: R) -> (R, R) {
    let z = r * r;
    let sin = polynomial(z, [-1.951_529_6e-4, 8.332_161e-3, -1.666_665_5e-1]) * z * r + r;
    let cos = polynomial(z, [2.443_315_7e-5, -1.388_731_6e-3, 4.166_664_6e-2]) * z * z - z * r.all(0.5) + r.all(1.0);
    let swapped = (turns & turns.all(1)).same(turns.all(1));
    let (sin, cos) = (swapped.choose(cos, sin), swapped.choose(sin, cos));
    // The second and third quarters turn the sine around, the first and second the cosine.
    let sign_sin = (turns & turns.all(2)).left::<30>();
    let sign_cos = ((turns + turns.all(1)) & turns.all(2)).left::<30>();
    ((sin.bits() ^ sign_sin).real_bits(), (cos.bits() ^ sign_cos).real_bits())
}

/// eˣ, within 2 ulp; 0 and infinity beyond single precision's range.
#[inline(always)]
pub fn exp<R: Real>(x: R) -> R {
    let bounded = x.between(-105.0, 89.0);
    let n = (bounded * x.all(LOG2_E)).nearest();
    let whole = n.real();
    // ln 2 in two parts; products with the first are exact.
    let r = (bounded - whole * x.all(0.693_359_4)) - whole * x.all(-2.121_944_4e-4);
    let tail = [1.987_569_1e-4, 1.398_2e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_5e-1, 5e-1];
    let power = polynomial(r, tail) * (r * r) + r + x.all(1.0);
    // In two steps: 2ⁿ alone may be too large or too small where the result is not.
    let half = n.right::<1>();
    let two_to = |n: R::Bits| (n + n.all(127)).left::<23>().real_bits();
    let result = power * two_to(half) * two_to(n - half);
    x.same(x).choose(result, x)
}

/// Natural logarithm, within 2 ulp; negative infinity at 0 and NaN below.
#[inline(always)]
pub fn ln<R: Real>(x: R) -> R {
    let subnormal = x.lt(x.all(f32::MIN_POSITIVE));
    // 2²⁵ makes every subnormal number normal.
    let scaled = subnormal.choose(x * x.all(33_554_432.0), x);
    let bits = scaled.bits();
    let exponent = (bits.right::<23>() - bits.all(126)).real() - subnormal.choose(x.all(25.0), x.all(0.0));
    let mantissa = (bits & bits.all(0x007F_FFFF) | bits.all(0x3F00_0000)).real_bits();
    let below = mantissa.lt(x.all(SQRT_2 / 2.0));
    let exponent = exponent - below.choose(x.all(1.0), x.all(0.0));
    let r = below.choose(mantissa + mantissa, mantissa) - x.all(1.0);
    let z = r * r;
    let tail = [
        7.037_683_6e-2,
        -1.151_461e-1,
        1.167_699_9e-1,
        -1.242_014_1e-1,
        1.424_932_3e-1,
        -1.666_805_7e-1,
        2.000_071_5e-1,
        -2.499_999_4e-1,
        3.333_333e-1,
    ];
    let small = polynomial(r, tail) * r * z + exponent * x.all(-2.121_944_4e-4) - z * x.all(0.5);
    let result = (r + small) + exponent * x.all(0.693_359_4);
    let zero = x.all(0.0);
    let positive = x.lt(x.all(f32::INFINITY)).choose(result, x);
    x.gt(zero).choose(positive, x.same(zero).choose(x.all(f32::NEG_INFINITY), x.all(f32::NAN)))
}

/// xʸ for positive x, as e to the power of y·ln x: the relative error is up to 2.5e-7 times (1 + |y·ln x|).
#[inline(always)]
pub fn pow<R: Real>(x: R, y: R) -> R {
    exp(y * ln(x))
}

/// Angle of the point (x, y) from the x axis, in [−π, π], within 3 ulp; 0 or ±π where both are 0, by the sign of x.
#[inline(always)]
pub fn atan2<R: Real>(y: R, x: R) -> R {
    let Folded { angle, far, steep } = Folded::new(y, x);
    let angle = far.choose(angle + x.all(FRAC_PI_4), angle);
    let angle = steep.choose(x.all(FRAC_PI_2) - angle, angle);
    let behind = x.bits().right::<31>().same(x.bits().all(-1));
    behind.choose(x.all(PI) - angle, angle).with_sign(y)
}

/// Angle of the point (x, y) from the x axis as a part of a turn in [0, 1), in steps of 2⁻³² and as bits of an unsigned number, within 1.5e-8 of a
/// turn. Where y is negative, of −0 too, it is never 0.
#[inline(always)]
pub fn turn<R: Real>(y: R, x: R) -> R::Bits {
    let Folded { angle, far, steep } = Folded::new(y, x);
    let number = |steps: i32| x.bits().all(steps);
    let choose = |mask: R::Mask, yes: R::Bits, no: R::Bits| mask.choose(yes.real_bits(), no.real_bits()).bits();
    // NaN is no integer.
    let part = (angle.between(-1.0, 1.0) * x.all(STEPS / TAU)).whole() + choose(far, number(1 << 29), number(0));
    let quarter = choose(steep, number(1 << 30) - part, part);
    // Behind, and below, the turn is what is left of a half, or of a whole one; but for one step, and that does not overflow.
    let (behind, below) = (x.bits().right::<31>(), y.bits().right::<31>());
    quarter ^ behind ^ below ^ (behind & number(i32::MIN))
}

/// The angle of a point from the x axis, mirrored into the first eighth of a turn.
struct Folded<R: Real> {
    /// From the axis, or from the diagonal: up to π/8 in magnitude.
    angle: R,
    /// Where it is from the diagonal.
    far: R::Mask,
    /// Where the point lies nearer to the y axis, by which it was mirrored.
    steep: R::Mask,
}

impl<R: Real> Folded<R> {
    #[inline(always)]
    fn new(y: R, x: R) -> Self {
        let (across, along) = (y.abs(), x.abs());
        let steep = across.gt(along);
        let (low, high) = (steep.choose(along, across), steep.choose(across, along));
        let one = x.all(1.0);
        // Zeros, and infinities, have no quotient.
        let slope = low.same(high).choose(low.gt(x.all(0.0)).choose(one, low), low / high);
        // Above tan π/8 by way of the angle to the diagonal.
        let far = slope.gt(x.all(0.414_213_57));
        let r = far.choose((slope - one) / (slope + one), slope);
        let z = r * r;
        let angle = polynomial(z, [8.053_744_5e-2, -1.387_768_5e-1, 1.997_771e-1, -3.333_295e-1]) * z * r + r;
        Self { angle, far, steep }
    }
}

/// Arc cosine, in [0, π], within 3 ulp; numbers beyond ±1 count as ±1.
#[inline(always)]
pub fn acos<R: Real>(x: R) -> R {
    let (half, one) = (x.all(0.5), x.all(1.0));
    let magnitude = x.abs().min(one);
    let outer = magnitude.gt(half);
    let z = outer.choose((one - magnitude) * half, magnitude * magnitude);
    let root = outer.choose(z.sqrt(), magnitude);
    let tail = [4.216_32e-2, 2.418_131e-2, 4.547_002_6e-2, 7.495_300_3e-2, 1.666_675_2e-1];
    let asin = polynomial(z, tail) * z * root + root;
    let positive = outer.choose(asin + asin, x.all(FRAC_PI_2) - asin);
    let negative = outer.choose(x.all(PI) - (asin + asin), x.all(FRAC_PI_2) + asin);
    x.lt(x.all(0.0)).choose(negative, positive)
}
