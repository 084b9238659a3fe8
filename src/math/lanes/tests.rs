//! Every kind of lanes has the bits of plain numbers, and functions have the errors that they state.

use super::*;
use crate::base::processor::{Avx2, Avx512};
use crate::base::random::Random;

/// Numbers of all exponents and both signs, with the special ones.
fn numbers(count: usize, key: u64) -> Vec<f32> {
    let mut random = Random::new(17, key, 0);
    let special =
        [0.0, -0.0, 1.0, -1.0, f32::INFINITY, f32::NEG_INFINITY, f32::NAN, f32::MAX, f32::MIN_POSITIVE, 1e-45];
    let any = (0..count).map(|_| f32::from_bits(random.next_u64() as u32));
    special.into_iter().chain(any.filter(|x| !x.is_nan())).collect()
}

/// All operations on three numbers, the integers as bits.
#[inline(always)]
fn all_operations<R: Real>(x: R, y: R, z: R) -> Vec<R> {
    let small = (x.same(x) & x.abs().lt(x.all(2e9))).choose(x, y.all(1.5));
    let (bits, others) = (x.bits(), y.bits());
    let (few, more) = (bits & bits.all(0xFFFF), others & bits.all(0xFFFF));
    let mask = x.lt(y) & !x.same(z) | y.le(z);
    let (sin, cos) = functions::sin_cos(x.between(-8192.0, 8192.0));
    let (v, w) = (V3::new(x, y, z), V3::new(y, z, x));
    let (unit, there) = w.try_normalize();
    let cross = v.cross(w);
    let mut all = vec![x + y, x - y, x * y, x / y, -x, x.abs().sqrt(), small.floor(), x.min(y), x.max(y), x.abs()];
    all.extend([x.with_sign(y), x.between(-2.0, 3.0), x.squared(), x.inverse(), mask.choose(x, y), sin, cos]);
    all.extend([small.nearest().real(), small.whole().real(), (few + more).real(), (few - more).real()]);
    all.extend([(bits & others).real_bits(), (bits | others).real_bits(), (bits ^ others).real_bits()]);
    all.extend([bits.left::<3>().real_bits(), bits.right::<5>().real_bits(), few.same(more).choose(x, z)]);
    all.extend([functions::exp(x), functions::ln(x), functions::atan2(x, y), functions::acos(x)]);
    let (sin, cos) = functions::sin_cos_turn::<R>(bits);
    all.extend([sin, cos, functions::turn(x, y).real()]);
    all.extend([functions::pow(x.abs(), y.between(-3.0, 3.0)), v.dot(w), v.max_element(), there.choose(unit.x, z)]);
    all.extend([cross.x, cross.y, cross.z, x.finite().choose(y, z), (x.gt(y) | y.ge(z)).choose(z, x)]);
    all
}

struct Compare<'a>(&'a [f32]);

impl Kernel for Compare<'_> {
    type Output = ();

    #[inline(always)]
    fn run<W: Wide>(self, wide: W) {
        let triples = self.0.as_chunks::<{ 3 * LANES }>().0;
        assert!(!triples.is_empty());
        for chunk in triples {
            let lanes = |k: usize| std::array::from_fn::<_, LANES, _>(|lane| chunk[3 * lane + k]);
            let [x, y, z] = [0, 1, 2].map(lanes);
            let found = all_operations(wide.load(&x), wide.load(&y), wide.load(&z));
            for lane in 0..LANES {
                for (i, (found, expected)) in found.iter().zip(all_operations(x[lane], y[lane], z[lane])).enumerate() {
                    let found = wide.store(*found)[lane];
                    let same = found.to_bits() == expected.to_bits() || found.is_nan() && expected.is_nan();
                    assert!(same, "operation {i} of {} {} {}: {found} {expected}", x[lane], y[lane], z[lane]);
                }
            }
            let (mask, integers) = (wide.load(&x).lt(wide.load(&y)), x.map(|x| x.to_bits().cast_signed()));
            let expected = (0..LANES).fold(0, |answers, lane| answers | u32::from(x[lane] < y[lane]) << lane);
            assert_eq!((mask.answers(), mask.any()), (expected, expected != 0));
            assert_eq!(wide.store_bits(wide.load_bits(&integers)), integers);
            assert_eq!(wide.load(&x).count_up_to(&x, y[0]), y[0].count_up_to(&x, y[0]));
        }
    }
}

/// What is made lane by lane comes to its lane and its place, however much it is.
struct ByLane;

impl Kernel for ByLane {
    type Output = ();

    #[inline(always)]
    fn run<W: Wide>(self, wide: W) {
        let lanes = std::array::from_fn(|lane| lane as f32);
        check_by_lane::<W, 1>(wide, &lanes);
        check_by_lane::<W, 3>(wide, &lanes);
        check_by_lane::<W, 4>(wide, &lanes);
        check_by_lane::<W, 17>(wide, &lanes);
        let [] = by_lane!([wide.load(&lanes)], |_, [_]| []);
    }
}

#[inline(always)]
fn check_by_lane<W: Wide, const M: usize>(wide: W, lanes: &[f32; LANES]) {
    let made = by_lane!([wide.load(lanes); 2], |lane, [x, y]| {
        assert_eq!([x, y], [lane as f32; 2]);
        std::array::from_fn::<_, M, _>(|i| (100 * i + lane) as f32)
    });
    for (i, made) in made.into_iter().enumerate() {
        assert_eq!(wide.store(made), lanes.map(|lane| 100.0 * i as f32 + lane));
    }
}

#[test]
fn what_is_made_lane_by_lane_comes_to_its_place() {
    #[cfg(target_arch = "x86_64")]
    {
        Avx2::detect().into_iter().for_each(|avx2| avx2.run(ByLane));
        Avx512::detect().into_iter().for_each(|avx512| avx512.run(ByLane));
    }
}

#[test]
fn every_kind_of_lanes_has_the_bits_of_plain_numbers() {
    let numbers = numbers(if cfg!(miri) { 200 } else { 60_000 }, 0);
    #[cfg(target_arch = "x86_64")]
    {
        Avx2::detect().into_iter().for_each(|avx2| avx2.run(Compare(&numbers)));
        Avx512::detect().into_iter().for_each(|avx512| avx512.run(Compare(&numbers)));
    }
}

/// Units in the last place between a result and the exact value, of which those below `least` count as if they had its exponent.
fn ulps(found: f32, exact: f64, least: f32) -> f64 {
    let near = (exact.abs() as f32).clamp(least.max(f32::MIN_POSITIVE), f32::MAX);
    let unit = f64::from(f32::from_bits(near.to_bits() & 0x7F80_0000)) * f64::from(f32::EPSILON);
    (f64::from(found) - exact).abs() / unit
}

struct Transpose;

impl Kernel for Transpose {
    type Output = ();

    #[inline(always)]
    fn run<W: Wide>(self, wide: W) {
        let rows: [[f32; 4]; LANES] = std::array::from_fn(|lane| [0, 1, 2, 3].map(|column| (4 * lane + column) as f32));
        let columns = wide.four_columns(|lane| rows[lane]);
        for (place, column) in columns.into_iter().enumerate() {
            assert_eq!(wide.store(column), rows.map(|row| row[place]));
        }
        assert_eq!(wide.four_rows(columns), rows);
        let wider = rows.map(|[a, b, c, d]| [a, b, c, d, -b, -a]);
        for (place, column) in wide.columns(&wider).into_iter().enumerate() {
            assert_eq!(wide.store(column), wider.map(|row| row[place]));
        }
    }
}

#[test]
fn rows_and_columns() {
    #[cfg(target_arch = "x86_64")]
    {
        Avx512::detect().into_iter().for_each(|wide| wide.run(Transpose));
        Avx2::detect().into_iter().for_each(|wide| wide.run(Transpose));
    }
}

/// The largest error of a function of one number.
fn worst(inputs: &[f32], least: f32, found: impl Fn(f32) -> f32, exact: impl Fn(f64) -> f64) -> f64 {
    let error = |&x: &f32| (ulps(found(x), exact(f64::from(x)), least), x);
    let (error, at) = inputs.iter().map(error).max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or_default();
    println!("{error} ulp at {at}");
    error
}

#[test]
fn errors_are_as_stated() {
    let number = if cfg!(miri) { 200 } else { 400_000 };
    let all = numbers(number, 1);
    let mut random = Random::new(18, 0, 0);
    let mut even = |low: f32, high: f32| (0..number).map(|_| random.range(low, high)).collect::<Vec<f32>>();
    let within = |range: std::ops::RangeInclusive<f32>| all.iter().copied().filter(move |x| range.contains(x));
    let angles: Vec<f32> = within(-8192.0..=8192.0).chain(even(-8192.0, 8192.0)).chain(even(-7.0, 7.0)).collect();
    assert!(worst(&angles, 0.5, |x| functions::sin_cos(x).0, f64::sin) < 2.0);
    assert!(worst(&angles, 0.5, |x| functions::sin_cos(x).1, f64::cos) < 2.0);
    let powers: Vec<f32> = within(-103.0..=88.7).chain(even(-103.0, 88.7)).collect();
    assert!(worst(&powers, 0.0, functions::exp, f64::exp) < 2.0);
    let positive: Vec<f32> = within(1e-45..=f32::MAX).chain(even(0.5, 2.0)).collect();
    assert!(worst(&positive, 0.0, functions::ln, f64::ln) < 2.0);
    let cosines: Vec<f32> = within(-1.0..=1.0).chain(even(-1.0, 1.0)).collect();
    assert!(worst(&cosines, 0.0, functions::acos, f64::acos) < 3.0);
    let points = all.as_chunks::<2>().0.iter().filter(|point| point.iter().all(|x| x.is_finite()));
    for [y, x] in points {
        let exact = f64::from(*y).atan2(f64::from(*x));
        // Where the quotient is subnormal, so is the angle.
        assert!(ulps(functions::atan2(*y, *x), exact, f32::MIN_POSITIVE) < 3.0, "{y} {x}");
    }
    let steps = |turn: f64| turn * 4_294_967_296.0;
    for [y, x] in all.as_chunks::<2>().0.iter().filter(|point| point.iter().all(|x| x.is_finite())) {
        let exact = f64::from(*y).atan2(f64::from(*x)) / std::f64::consts::TAU;
        let found = f64::from(functions::turn(*y, *x));
        // Half a turn forwards is one backwards.
        let error = (found - steps(exact)).abs();
        assert!(error.min((error - steps(1.0)).abs()) < steps(1.5e-8), "{y} {x}: {found}");
    }
    for turn in all.iter().map(|x| x.to_bits().cast_signed()) {
        let angle = f64::from(turn) / steps(1.0) * std::f64::consts::TAU;
        let (sin, cos) = functions::sin_cos_turn::<f32>(turn);
        let error = (f64::from(sin) - angle.sin()).abs().max((f64::from(cos) - angle.cos()).abs());
        assert!(error < 1.2e-7, "{turn}: {sin} {cos}");
    }
    for (x, y) in even(0.0, 1.0).into_iter().zip(even(-4.0, 4.0)) {
        let exact = f64::from(x).powf(f64::from(y));
        let bound = 2.5e-7 * (1.0 + (f64::from(y) * f64::from(x).ln()).abs());
        assert!((f64::from(functions::pow(x, y)) / exact - 1.0).abs() < bound, "{x} {y}");
    }
}

#[test]
fn special_numbers() {
    use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};
    let infinite = f32::INFINITY;
    assert_eq!([infinite, -infinite, 89.0, -105.0, 0.0].map(functions::exp), [infinite, 0.0, infinite, 0.0, 1.0]);
    assert_eq!([0.0, -0.0, 1.0, infinite].map(functions::ln), [-infinite, -infinite, 0.0, infinite]);
    assert!([functions::exp(f32::NAN), functions::ln(-1.0), functions::ln(f32::NAN)].iter().all(|x| x.is_nan()));
    assert_eq!([1.0, -1.0, 2.0, -2.0].map(functions::acos), [0.0, PI, 0.0, PI]);
    let turns = [(0.0, 0.0), (0.0, -0.0), (-0.0, -1.0), (1.0, 0.0), (-1.0, 0.0), (infinite, infinite), (0.0, infinite)];
    let expected = [0.0, PI, -PI, FRAC_PI_2, -FRAC_PI_2, FRAC_PI_4, 0.0];
    assert_eq!(turns.map(|(y, x)| functions::atan2(y, x)), expected);
    assert_eq!(functions::sin_cos(0.0), (0.0, 1.0));
}
