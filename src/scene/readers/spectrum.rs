//! Colours of spectra: linear RGB as in Mitsuba 3's RGB mode.

use glam::{DMat3, DVec3};

use super::cie::{FIRST, STEP, TABLE};

/// The use of a colour, which decides what a spectrum's colour is relative to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Use {
    /// A reflectance: seen under D65, within [0, 1].
    Reflectance,
    /// A refractive index: seen under D65, not bounded.
    Index,
    /// Emitted light: as it is, so that equal power at all wavelengths is not quite white.
    Light,
}

/// XYZ to linear sRGB (IEC 61966-2-1).
pub const XYZ_TO_RGB: DMat3 = DMat3::from_cols(
    DVec3::new(3.240479, -0.969256, 0.055648),
    DVec3::new(-1.537150, 1.875991, -0.204043),
    DVec3::new(-0.498535, 0.041556, 1.057311),
);

/// Colour of a spectrum that is linear between `points` (nm, value; wavelengths grow) and zero beyond them.
pub fn listed(points: &[(f64, f64)], purpose: Use) -> [f32; 3] {
    integrate(|nm| between(points, nm), purpose)
}

/// Value at a wavelength of a spectrum that is linear between `points` (nm, value; wavelengths grow) and zero beyond them.
pub fn between(points: &[(f64, f64)], nm: f64) -> f64 {
    let above = points.partition_point(|point| point.0 < nm);
    match (above.checked_sub(1).map(|below| points[below]), points.get(above)) {
        (Some((x0, y0)), Some((x1, y1))) => y0 + (y1 - y0) * (nm - x0) / (x1 - x0),
        (None, Some((x, y))) if *x == nm => *y,
        _ => 0.0,
    }
}

/// Radiance of a black body of `kelvin` above 0 at a wavelength in nm, W·m⁻²·sr⁻¹·nm⁻¹ (Planck's law).
pub fn planck(kelvin: f64, nm: f64) -> f64 {
    const H: f64 = 6.626_070_15e-34;
    const C: f64 = 2.997_924_58e8;
    const K: f64 = 1.380_649e-23;
    let wavelength = nm * 1e-9;
    2e-9 * H * C * C / wavelength.powi(5) / ((H * C / (wavelength * K * kelvin)).exp() - 1.0)
}

/// Linear RGB of a spectrum, relative to one that is 1 everywhere and has luminance 1. Colours outside RGB's gamut are
/// clamped.
pub fn integrate(spectrum: impl Fn(f64) -> f64, purpose: Use) -> [f32; 3] {
    let rgb = (XYZ_TO_RGB * xyz(spectrum, purpose)).max(DVec3::ZERO);
    let rgb = if purpose == Use::Reflectance { rgb.min(DVec3::ONE) } else { rgb };
    rgb.as_vec3().to_array()
}

/// XYZ of a spectrum, relative to one that is 1 everywhere and has Y = 1.
pub fn xyz(spectrum: impl Fn(f64) -> f64, purpose: Use) -> DVec3 {
    /// Number of steps between two rows of the table.
    const STEPS: usize = 10;
    let (mut sum, mut white) = (DVec3::ZERO, 0.0);
    for i in 0..(TABLE.len() - 1) * STEPS + 1 {
        let (row, part) = (i / STEPS, (i % STEPS) as f64 / STEPS as f64);
        let next = &TABLE[(row + 1).min(TABLE.len() - 1)];
        let [x, y, z, d65] = std::array::from_fn(|k| TABLE[row][k] + (next[k] - TABLE[row][k]) * part);
        let light = if purpose == Use::Light { 1.0 } else { d65 };
        sum += DVec3::new(x, y, z) * light * spectrum(FIRST + STEP * (row as f64 + part));
        white += y * light;
    }
    sum / white
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Colours that Mitsuba 3.9.1 gives (`scalar_rgb`), within half a percent: its tables are summed at other wavelengths.
    #[test]
    fn spectra_have_the_colours_of_mitsuba() {
        let close = |ours: [f32; 3], theirs: [f32; 3]| {
            assert!((0..3).all(|i| (ours[i] - theirs[i]).abs() < 5e-3 * theirs[i].max(0.5)), "{ours:?} {theirs:?}");
        };
        let ramp = |nm: f64| if (400.0..=700.0).contains(&nm) { 0.1 + 0.8 * (nm - 400.0) / 300.0 } else { 0.0 };
        close(integrate(ramp, Use::Reflectance), [0.742853, 0.48114, 0.208325]);
        close(integrate(ramp, Use::Light), [0.872215, 0.458728, 0.181301]);
        close(integrate(|_| 1.0, Use::Reflectance), [0.998985, 0.998874, 0.998802]);
        close(integrate(|_| 1.0, Use::Light), [1.20488, 0.948228, 0.909267]);
    }
}
