//! Functions of every number of a slice, in lanes; the bits are those of [`functions`] one by one.

use std::marker::PhantomData;

use super::{Kernel, LANES, Real, Wide, functions, run};

/// Replaces every number by its natural logarithm, as [`functions::ln`] has it.
pub fn ln(values: &mut [f32]) {
    each::<Ln>(values);
}

/// Replaces every number x by eˣ, as [`functions::exp`] has it.
pub fn exp(values: &mut [f32]) {
    each::<Exp>(values);
}

/// A function of a number.
trait Function {
    fn of<R: Real>(x: R) -> R;
}

struct Ln;

impl Function for Ln {
    #[inline(always)]
    fn of<R: Real>(x: R) -> R {
        functions::ln(x)
    }
}

struct Exp;

impl Function for Exp {
    #[inline(always)]
    fn of<R: Real>(x: R) -> R {
        functions::exp(x)
    }
}

fn each<F: Function>(values: &mut [f32]) {
    if let Err(Each { values, .. }) = run(Each { values, function: PhantomData::<F> }) {
        values.iter_mut().for_each(|x| *x = F::of(*x));
    }
}

struct Each<'a, F> {
    values: &'a mut [f32],
    function: PhantomData<F>,
}

impl<F: Function> Kernel for Each<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run<W: Wide>(self, wide: W) {
        let (rows, rest) = self.values.as_chunks_mut::<LANES>();
        for row in rows {
            *row = wide.store(F::of(wide.load(row)));
        }
        if !rest.is_empty() {
            let mut row = [1.0; LANES];
            row[..rest.len()].copy_from_slice(rest);
            rest.copy_from_slice(&wide.store(F::of(wide.load(&row)))[..rest.len()]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    #[test]
    fn slices_have_the_bits_of_single_numbers() {
        let mut random = Random::new(61, 0, 0);
        for length in [0, 1, 15, 16, 17, 100] {
            let mut values: Vec<f32> = (0..length).map(|_| random.range(-30.0, 30.0)).collect();
            values.iter_mut().step_by(7).for_each(|x| *x = 0.0);
            let bits = |values: &[f32]| values.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
            let (mut powers, one_by_one) = (values.clone(), values.iter().map(|&x| functions::exp(x)));
            let expected: Vec<f32> = one_by_one.collect();
            exp(&mut powers);
            assert_eq!(bits(&powers), bits(&expected));
            let expected: Vec<f32> = powers.iter().map(|&x| functions::ln(x)).collect();
            ln(&mut powers);
            assert_eq!(bits(&powers), bits(&expected));
        }
    }
}
