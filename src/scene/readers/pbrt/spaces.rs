//! Colour spaces by pbrt's names, as transforms to linear sRGB.

use glam::{DMat3, DVec3};

use crate::scene::readers::spectrum::XYZ_TO_RGB;

/// A colour space, by the matrix that takes its linear colours to linear sRGB. White stays white.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColorSpace(DMat3);

/// The names that [`ColorSpace::named`] knows.
pub const NAMES: [&str; 4] = ["srgb", "dci-p3", "rec2020", "aces2065-1"];

impl Default for ColorSpace {
    fn default() -> Self {
        Self(DMat3::IDENTITY)
    }
}

impl ColorSpace {
    /// The space of this name.
    pub fn named(name: &str) -> Option<Self> {
        const D65: [f64; 2] = [0.3127, 0.3290];
        match name {
            "srgb" => Some(Self::default()),
            // Display P3's primaries with the white of D65, as pbrt has it.
            "dci-p3" => Some(Self::spanned([[0.680, 0.320], [0.265, 0.690], [0.150, 0.060]], D65)),
            // ITU-R BT.2020-2, table 3.
            "rec2020" => Some(Self::spanned([[0.708, 0.292], [0.170, 0.797], [0.131, 0.046]], D65)),
            // SMPTE ST 2065-1, §4.2.
            "aces2065-1" => Some(Self::spanned([[0.7347, 0.2653], [0.0, 1.0], [0.0001, -0.077]], [0.32168, 0.33767])),
            _ => None,
        }
    }

    /// The space of the primaries and the white point with these chromaticities.
    fn spanned(primaries: [[f64; 2]; 3], white: [f64; 2]) -> Self {
        let xyz = |[x, y]: [f64; 2]| DVec3::new(x / y, 1.0, (1.0 - x - y) / y);
        // Scaled by y, so that the line of purples' end, where y is 0, is no exception.
        let [red, green, blue] = primaries.map(|[x, y]| DVec3::new(x, y, 1.0 - x - y));
        let columns = DMat3::from_cols(red, green, blue);
        let strengths = columns.inverse() * xyz(white);
        let to_srgb = XYZ_TO_RGB * columns * DMat3::from_diagonal(strengths);
        // White points differ, and so do the digits of the matrices.
        let shown = to_srgb * DVec3::ONE;
        Self(DMat3::from_diagonal(shown.recip()) * to_srgb)
    }

    /// A colour of this space in linear sRGB; what is out of gamut is clamped at 0.
    pub fn to_srgb(self, color: DVec3) -> DVec3 {
        if self == Self::default() { color } else { (self.0 * color).max(DVec3::ZERO) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// White stays white; ITU-R BT.2407 has the matrix of BT.2020 to BT.709.
    #[test]
    fn matrices() {
        for name in NAMES {
            let space = ColorSpace::named(name).unwrap();
            assert!((space.0 * DVec3::ONE - DVec3::ONE).length() < 1e-12, "{name}");
        }
        let ColorSpace(matrix) = ColorSpace::named("rec2020").unwrap();
        let expected =
            DMat3::from_cols_array(&[1.6605, -0.1246, -0.0182, -0.5876, 1.1329, -0.1006, -0.0728, -0.0083, 1.1187]);
        assert!(matrix.abs_diff_eq(expected, 2e-3), "{matrix}");
        assert_eq!(ColorSpace::named("adobe"), None);
    }
}
