//! Sixteen values side by side: the lanes of what is computed one by one, such as the parameters of sixteen surface points.

use super::{LANES, Real, V3, Wide};

/// What can be put side by side in the lanes of `W`.
pub trait Gather<W: Wide>: Copy {
    /// Sixteen of them.
    type Lanes;

    /// Lane by lane.
    fn gather(wide: W, each: [&Self; LANES]) -> Self::Lanes;
}

impl<W: Wide> Gather<W> for f32 {
    type Lanes = W::Real;

    #[inline(always)]
    fn gather(wide: W, each: [&Self; LANES]) -> W::Real {
        let mut numbers = [0.0; LANES];
        for lane in 0..LANES {
            numbers[lane] = *each[lane];
        }
        wide.load(&numbers)
    }
}

impl<W: Wide> Gather<W> for bool {
    type Lanes = <W::Real as Real>::Mask;

    #[inline(always)]
    fn gather(wide: W, each: [&Self; LANES]) -> Self::Lanes {
        let mut numbers = [0.0; LANES];
        for lane in 0..LANES {
            numbers[lane] = if *each[lane] { 1.0 } else { 0.0 };
        }
        wide.load(&numbers).above(0.0)
    }
}

impl<W: Wide> Gather<W> for V3<f32> {
    type Lanes = V3<W::Real>;

    #[inline(always)]
    fn gather(wide: W, each: [&Self; LANES]) -> Self::Lanes {
        wide.vectors(|lane| (*each[lane]).into())
    }
}

/// The type of [`Real::Each`] of one lane.
impl<W: Wide, T: Copy> Gather<W> for [T; 1] {
    type Lanes = <W::Real as Real>::Each<T>;

    #[inline(always)]
    fn gather(wide: W, each: [&Self; LANES]) -> Self::Lanes {
        let mut values = [each[0][0]; LANES];
        for lane in 0..LANES {
            values[lane] = each[lane][0];
        }
        wide.each(values)
    }
}

/// Arrays of more than one.
macro_rules! arrays {
    ($($count:literal),+) => {$(
        impl<W: Wide, T: Gather<W>> Gather<W> for [T; $count]
        where
            T::Lanes: Copy,
        {
            type Lanes = [T::Lanes; $count];

            #[inline(always)]
            fn gather(wide: W, each: [&Self; LANES]) -> Self::Lanes {
                let of = |i: usize| {
                    let mut values = [&each[0][i]; LANES];
                    for lane in 0..LANES {
                        values[lane] = &each[lane][i];
                    }
                    values
                };
                let mut lanes = [T::gather(wide, of(0)); $count];
                for i in 1..$count {
                    lanes[i] = T::gather(wide, of(i));
                }
                lanes
            }
        }
    )+};
}

arrays!(2, 4);

/// What either every lane has or none: the first lane says which.
impl<W: Wide, T: Gather<W>> Gather<W> for Option<T> {
    type Lanes = Option<T::Lanes>;

    #[inline(always)]
    fn gather(wide: W, each: [&Self; LANES]) -> Self::Lanes {
        let mut values = [each[0].as_ref()?; LANES];
        for lane in 0..LANES {
            if let Some(value) = each[lane] {
                values[lane] = value;
            }
        }
        Some(T::gather(wide, values))
    }
}

/// Implements [`Gather`] for a struct over one lane, field by field; those after `same` are taken from the first lane.
macro_rules! lanes_of {
    ($type:ident $(<$life:lifetime>)? { $($field:ident),* } $(same { $($same:ident),+ })?) => {
        impl<$($life,)? W: $crate::math::lanes::Wide> $crate::math::lanes::Gather<W> for $type<$($life,)? f32> {
            type Lanes = $type<$($life,)? W::Real>;

            #[inline(always)]
            fn gather(wide: W, each: [&Self; $crate::math::lanes::LANES]) -> Self::Lanes {
                $(
                    let mut $field = [&each[0].$field; $crate::math::lanes::LANES];
                    for lane in 0..$crate::math::lanes::LANES {
                        $field[lane] = &each[lane].$field;
                    }
                    let $field = $crate::math::lanes::Gather::gather(wide, $field);
                )*
                $type { $($field,)* $($($same: each[0].$same),+)? }
            }
        }
    };
}
pub(crate) use lanes_of;
