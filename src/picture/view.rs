//! View transforms: how linear radiance becomes the code values of a screen.

use glam::Vec3;

use crate::math::srgb;

/// How a picture is shown: brightened, then brought into the range of a screen. PNG files are made so; EXR files stay linear.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Display {
    /// Stops by which the picture is brightened first.
    pub exposure: f32,
    /// What brings it into the range of a screen.
    pub view: View,
}

/// A view transform.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum View {
    /// The sRGB curve; what is brighter than 1 is cut off, channel by channel.
    #[default]
    Srgb,
    /// AgX (Sobotka 2022) without a look: 16.5 stops around a middle grey of 0.18; bright colours fade to white.
    Agx,
    /// The Khronos PBR Neutral tone mapper (Khronos 2024): colours stay what they are but for the brightest.
    PbrNeutral,
}

impl View {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Srgb => "srgb",
            Self::Agx => "agx",
            Self::PbrNeutral => "pbr-neutral",
        }
    }

    /// Code values in [0, 1] of a linear colour with the primaries of sRGB. Negative light and NaN are black.
    fn encode(self, rgb: [f64; 3]) -> [f64; 3] {
        // With numbers so large every view is white, and none of them overflows.
        const BRIGHTEST: f64 = 1e30;
        let rgb = rgb.map(|value| if value > 0.0 { value.min(BRIGHTEST) } else { 0.0 });
        match self {
            Self::Srgb => rgb.map(srgb::encoded),
            Self::Agx => agx(rgb),
            Self::PbrNeutral => pbr_neutral(rgb).map(srgb::encoded),
        }
    }
}

impl Display {
    /// Bytes of a pixel.
    pub fn bytes(&self, pixel: Vec3) -> [u8; 3] {
        let factor = f64::from(self.exposure.exp2());
        let rgb = pixel.to_array().map(|value| f64::from(value) * factor);
        self.view.encode(rgb).map(|value| (value * 255.0).round() as u8)
    }
}

/// AgX after Sobotka's configuration of 2022 (github.com/sobotka/AgX-S2O3): primaries drawn towards white by a fifth, 16.5 stops in
/// equal steps, a sigmoid, and primaries drawn out again as Wrensch does it (Minimal AgX Implementation, 2023). The result is meant
/// for a screen with an exponent of 2.2, so it is not encoded once more.
fn agx(rgb: [f64; 3]) -> [f64; 3] {
    /// How far primaries are drawn towards white.
    const INSET: f64 = 0.2;
    /// Stops below and above middle grey.
    const STOPS: [f64; 2] = [10.0, 6.5];
    const GREY: f64 = 0.18;
    // Log values of neighbouring channels end where the range does, so black is finite.
    let toned = drawn(rgb, INSET).map(|value| {
        let stops = (value / GREY).log2().clamp(-STOPS[0], STOPS[1]);
        sigmoid((stops + STOPS[0]) / (STOPS[0] + STOPS[1]))
    });
    drawn(toned, INSET / (INSET - 1.0)).map(|value| value.clamp(0.0, 1.0))
}

/// Draws a colour's chromaticity towards that of white by a part of their distance in (x, y): its channels are mixed with their
/// mean, in which each primary counts as its X + Y + Z. The part `a / (a − 1)` undoes the part `a`.
fn drawn(rgb: [f64; 3], part: f64) -> [f64; 3] {
    /// X + Y + Z of the primaries of sRGB over that of their sum (IEC 61966-2-1).
    const WEIGHTS: [f64; 3] = [0.211_995, 0.392_151, 0.395_854];
    let mean: f64 = rgb.iter().zip(WEIGHTS).map(|(value, weight)| value * weight).sum();
    rgb.map(|value| value + part * (mean - value))
}

/// AgX's sigmoid on [0, 1]: through (0, 0), (20/33, 1/2) with slope 2, and (1, 1), each side a hyperbola of its own power.
fn sigmoid(x: f64) -> f64 {
    const PIVOT: [f64; 2] = [20.0 / 33.0, 0.5];
    const SLOPE: f64 = 2.0;
    const POWERS: [f64; 2] = [3.0, 3.25];
    let from_pivot = x - PIVOT[0];
    let (length, power) = if from_pivot < 0.0 { (PIVOT[0], POWERS[0]) } else { (1.0 - PIVOT[0], POWERS[1]) };
    // The factor with which the hyperbola ends in the corner.
    let scale = ((SLOPE * length / PIVOT[1]).powf(power) - 1.0) / length.powf(power);
    PIVOT[1] + SLOPE * from_pivot * (1.0 + scale * from_pivot.abs().powf(power)).powf(-1.0 / power)
}

/// PBR Neutral as in its specification (github.com/KhronosGroup/ToneMapping, PBR_Neutral/README.md); linear, in [0, 1].
fn pbr_neutral(rgb: [f64; 3]) -> [f64; 3] {
    /// What a surface of index 1.5 reflects straight back, F₉₀ there: it is subtracted.
    const REFLECTED: f64 = 0.04;
    /// Where compression starts, K_s.
    const START: f64 = 0.8 - REFLECTED;
    /// How fast bright colours fade, K_d.
    const FADE: f64 = 0.15;
    let least = rgb.into_iter().fold(f64::INFINITY, f64::min);
    let offset = if least <= 2.0 * REFLECTED { least - least * least / (4.0 * REFLECTED) } else { REFLECTED };
    let rgb = rgb.map(|value| value - offset);
    let peak = rgb.into_iter().fold(0.0, f64::max);
    if peak <= START {
        return rgb;
    }
    let compressed = 1.0 - (1.0 - START).powi(2) / (peak + 1.0 - 2.0 * START);
    let kept = 1.0 / (FADE * (peak - compressed) + 1.0);
    rgb.map(|value| value * (compressed / peak) * kept + compressed * (1.0 - kept))
}

#[cfg(test)]
mod tests {
    use super::*;

    const VIEWS: [View; 3] = [View::Srgb, View::Agx, View::PbrNeutral];

    fn near(found: [f64; 3], expected: [f64; 3], tolerance: f64) {
        let distance = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(distance <= tolerance, "{found:?}, expected {expected:?}");
    }

    /// Colours of sRGB turn into those of the published matrix, and back.
    #[test]
    fn primaries_are_drawn_as_published() {
        // Wrensch 2023, from Sobotka's configuration; columns.
        const COLUMNS: [[f64; 3]; 3] = [
            [0.842_479_06, 0.042_328_24, 0.042_375_65],
            [0.078_433_60, 0.878_468_64, 0.078_433_60],
            [0.079_223_75, 0.079_166_13, 0.879_142_97],
        ];
        for (primary, column) in COLUMNS.into_iter().enumerate() {
            let mut rgb = [0.0; 3];
            rgb[primary] = 1.0;
            near(drawn(rgb, 0.2), column, 1e-4);
            near(drawn(drawn(rgb, 0.2), 0.2 / (0.2 - 1.0)), rgb, 1e-12);
        }
    }

    /// Wrensch's polynomial is a fit to the table that the sigmoid makes, with a stated error of 2e-3 in the mean.
    #[test]
    fn the_sigmoid_is_what_others_have_fitted() {
        const FIT: [f64; 7] = [-0.002_32, 0.119_1, 0.429_8, -6.868, 31.96, -40.14, 15.5];
        let fit = |x: f64| FIT.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient);
        for i in 0..=1000 {
            let x = f64::from(i) / 1000.0;
            assert!((sigmoid(x) - fit(x)).abs() < 1e-2, "at {x}: {} and {}", sigmoid(x), fit(x));
        }
        assert!(sigmoid(0.0).abs() < 1e-12 && (sigmoid(1.0) - 1.0).abs() < 1e-12);
        // Middle grey is in the middle.
        near(View::Agx.encode([0.18; 3]), [0.5; 3], 1e-4);
    }

    /// Values computed by hand from the specification's formulas.
    #[test]
    fn pbr_neutral_is_as_specified() {
        // Dark: f = x − x²/0.16. Base colours: f = 0.04, and no more.
        near(pbr_neutral([0.04; 3]), [0.01; 3], 1e-12);
        near(pbr_neutral([0.8, 0.2, 0.1]), [0.76, 0.16, 0.06], 1e-12);
        near(pbr_neutral([0.5, 0.08, 0.3]), [0.46, 0.04, 0.26], 1e-12);
        // White: p = 0.96, p_n = 1 − 0.24²/0.44.
        near(pbr_neutral([1.0; 3]), [0.869_090_909; 3], 1e-9);
        // p = 2, p_n = 1 − 0.0576/1.48 = 0.961081, g = 1/(0.15·1.038919 + 1) = 0.865173.
        near(pbr_neutral([2.0, 0.0, 0.0]), [0.961_081, 0.129_579, 0.129_579], 1e-6);
    }

    #[test]
    fn greys_grow_from_black_to_white() {
        for view in VIEWS {
            assert!(view.encode([0.0; 3]).into_iter().all(|value| value < 1e-12), "{view:?}");
            let grey = |stop: i32| view.encode([2f64.powf(f64::from(stop) / 16.0); 3]);
            let mut last = 0.0;
            for [r, g, b] in (-320..=320).map(grey) {
                assert!(
                    (r - g).abs() < 1e-12 && (r - b).abs() < 1e-12 && r >= last - 1e-12,
                    "{view:?}: {r} after {last}"
                );
                last = r;
            }
            assert!(last > 0.999, "{view:?}");
        }
    }

    #[test]
    fn what_is_no_number_of_light_is_shown_too() {
        let [inf, nan] = [f32::INFINITY, f32::NAN];
        for view in VIEWS {
            let shown = |r, g, b| Display { exposure: 64.0, view }.bytes(Vec3::new(r, g, b));
            assert_eq!(shown(inf, inf, inf), [255; 3], "{view:?}");
            assert_eq!(shown(f32::MAX, f32::MAX, f32::MAX), [255; 3], "{view:?}");
            assert_eq!(shown(nan, -inf, -1.0), [0; 3], "{view:?}");
            let [red, green, blue] = shown(inf, 0.0, 0.0);
            assert!(red == 255 && green == blue, "{view:?}: {green} {blue}");
        }
        // A bright red fades to white, but for the curve that cuts channels off.
        let red = Vec3::new(f32::MAX, 0.0, 0.0);
        assert_eq!(VIEWS.map(|view| Display { exposure: 0.0, view }.bytes(red)[1] > 250), [false, true, true]);
    }
}
