//! Numbers of lanes between kernels: in all lanes, or in the first alone where vertices are shaded one by one.

use crate::math::lanes::{Bits, LANES, Real, V3, Vectors, Wide};

/// A number in each lane.
pub(super) type Column = [f32; LANES];

/// Four numbers in each lane, side by side.
pub(super) type Rows = [[f32; 4]; LANES];

/// A vector and a number.
#[inline(always)]
pub(super) fn row<R: Real>(v: V3<R>, number: R) -> [R; 4] {
    [v.x, v.y, v.z, number]
}

/// Where numbers are kept.
pub(super) trait Keep: Copy {
    type Real: Real;

    fn keep(self, numbers: Self::Real, column: &mut Column);

    /// What was kept.
    fn kept(self, column: &Column) -> Self::Real;

    fn keep_rows(self, columns: [Self::Real; 4], rows: &mut Rows);

    /// The columns of rows that `of` tells.
    fn columns(self, of: impl Fn(usize) -> [f32; 4]) -> [Self::Real; 4];

    /// Where bits are set.
    fn mask(self, bits: u32) -> <Self::Real as Real>::Mask;

    #[inline(always)]
    fn keep_vectors(self, v: V3<Self::Real>, [x, y, z]: &mut Vectors) {
        self.keep(v.x, x);
        self.keep(v.y, y);
        self.keep(v.z, z);
    }

    #[inline(always)]
    fn kept_vectors(self, [x, y, z]: &Vectors) -> V3<Self::Real> {
        V3::new(self.kept(x), self.kept(y), self.kept(z))
    }
}

#[derive(Clone, Copy)]
pub(super) struct All<W>(pub W);

/// The bit of each lane.
const BITS: [i32; LANES] = {
    let mut bits = [0; LANES];
    let mut lane = 0;
    while lane < LANES {
        bits[lane] = 1 << lane;
        lane += 1;
    }
    bits
};

impl<W: Wide> Keep for All<W> {
    type Real = W::Real;

    #[inline(always)]
    fn keep(self, numbers: W::Real, column: &mut Column) {
        *column = self.0.store(numbers);
    }

    #[inline(always)]
    fn kept(self, column: &Column) -> W::Real {
        self.0.load(column)
    }

    #[inline(always)]
    fn keep_rows(self, columns: [W::Real; 4], rows: &mut Rows) {
        *rows = self.0.four_rows(columns);
    }

    #[inline(always)]
    fn columns(self, of: impl Fn(usize) -> [f32; 4]) -> [W::Real; 4] {
        self.0.four_columns(of)
    }

    #[inline(always)]
    fn mask(self, bits: u32) -> <W::Real as Real>::Mask {
        let lanes = self.0.load_bits(&BITS);
        (lanes & lanes.all(bits as i32)).same(lanes)
    }
}

#[derive(Clone, Copy)]
pub(super) struct First;

impl Keep for First {
    type Real = f32;

    #[inline(always)]
    fn keep(self, number: f32, column: &mut Column) {
        column[0] = number;
    }

    #[inline(always)]
    fn kept(self, column: &Column) -> f32 {
        column[0]
    }

    #[inline(always)]
    fn keep_rows(self, columns: [f32; 4], rows: &mut Rows) {
        rows[0] = columns;
    }

    #[inline(always)]
    fn columns(self, of: impl Fn(usize) -> [f32; 4]) -> [f32; 4] {
        of(0)
    }

    #[inline(always)]
    fn mask(self, bits: u32) -> bool {
        bits & 1 == 1
    }
}
