//! The sun's mean radiance over its disk, seen through the clear air: Mitsuba 0.6 has the model of Preetham et al. 1999, Mitsuba 3 that
//! of Hošek and Wilkie 2013. In W·m⁻²·sr⁻¹·nm⁻¹ as linear RGB, for a turbidity in [1, 10] and an angle from the zenith in [0, π/2].

use crate::scene::readers::spectrum::{Use, integrate};

/// Solar radiance outside the air every 10 nm from 380 nm on, W·m⁻²·sr⁻¹·nm⁻¹ (Preetham et al. 1999, table 2).
#[rustfmt::skip]
const SOLAR: [f64; 38] = [
    16559.0, 16233.7, 21127.5, 25888.2, 25829.1, 24232.3, 26760.5, 29658.3, 30545.4, 30057.5, 30663.7, 28830.4, 28712.1,
    27825.0, 27100.6, 27233.6, 26361.3, 25503.8, 25060.2, 25311.6, 25355.9, 25134.2, 24631.5, 24173.2, 23685.3, 23212.1,
    22827.7, 22339.8, 21970.2, 21526.7, 21097.9, 20728.3, 20240.4, 19870.8, 19427.2, 19072.4, 18628.9, 18259.2,
];

/// Absorption by ozone every 10 nm from 440 nm on, cm⁻¹ (the same).
#[rustfmt::skip]
const OZONE: [f64; 35] = [
    0.003, 0.003, 0.006, 0.009, 0.014, 0.021, 0.030, 0.040, 0.048, 0.063, 0.075, 0.085, 0.103, 0.120, 0.120, 0.115, 0.125,
    0.120, 0.105, 0.090, 0.079, 0.067, 0.057, 0.048, 0.036, 0.028, 0.023, 0.018, 0.014, 0.011, 0.010, 0.009, 0.007, 0.004,
    0.0,
];

/// Ozone in the air, cm.
const OZONE_DEPTH: f64 = 0.35;

/// Linear interpolation between values every 10 nm from `first` on, zero beyond them.
fn listed(values: &[f64], first: f64, wavelength: f64) -> f64 {
    let x = (wavelength - first) / 10.0;
    if !(x >= 0.0 && x <= (values.len() - 1) as f64) {
        return 0.0;
    }
    let below = (x as usize).min(values.len() - 2);
    values[below] + (values[below + 1] - values[below]) * (x - below as f64)
}

/// After Preetham, Shirley and Smits 1999, appendix 1, scattering by air and haze and absorption by ozone. Mixed gases and water absorb
/// beyond 690 nm only, which changes less than a thousandth of any channel.
pub fn preetham(turbidity: f64, zenith: f64) -> [f32; 3] {
    let haze = 0.046_083_658_220_5 * turbidity - 0.045_860_259_285_22;
    // Relative optical mass (Kasten 1966).
    let mass = 1.0 / (zenith.cos() + 0.15 * (93.885 - zenith.to_degrees()).powf(-1.253));
    let spectrum = |nm: f64| {
        let um = nm / 1000.0;
        let depth = 0.008_735 * um.powf(-4.08) + haze * um.powf(-1.3) + OZONE_DEPTH * listed(&OZONE, 440.0, nm);
        listed(&SOLAR, 380.0, nm) * (-mass * depth).exp()
    };
    integrate(spectrum, Use::Light)
}

/// Between turbidities the model is linear; between elevations of ∛(2·elevation/π) = 0, 1/12, 2/12, … it is smooth, so that cubics through
/// four of them are right to 0.4 % of the radiance from the zenith.
const STEPS: usize = 12;

/// The mean over the disk in Mitsuba 3.7.1's `scalar_rgb`, which sums the model's spectra (Hošek and Wilkie 2013, Adding a solar-radiance
/// function to the Hošek-Wilkie skylight model), by turbidity from 1 on.
#[rustfmt::skip]
const SUN: [[[f32; 3]; STEPS + 1]; 10] = [
    [[2607., 340., -77.], [2702., 362., -80.], [3480., 570., -104.], [5737., 1384., -137.], [9754., 3618., 122.], [14157., 7337., 1554.], [17513., 11212., 4386.], [19678., 14252., 7634.], [21023., 16361., 10453.], [21856., 17755., 12586.], [22370., 18639., 14058.], [22661., 19150., 14953.], [22759., 19329., 15276.]],
    [[1274., 154., -37.], [1357., 169., -39.], [2063., 321., -60.], [4259., 1000., -100.], [8380., 3067., 103.], [13051., 6713., 1427.], [16697., 10639., 4172.], [19089., 13783., 7395.], [20591., 15993., 10230.], [21529., 17459., 12387.], [22105., 18399., 13886.], [22435., 18942., 14797.], [22550., 19132., 15128.]],
    [[391., 42., -11.], [435., 48., -12.], [870., 124., -24.], [2605., 584., -60.], [6522., 2334., 80.], [11408., 5796., 1240.], [15427., 9757., 3843.], [18151., 13042., 7015.], [19896., 15395., 9869.], [20996., 16982., 12066.], [21680., 18007., 13605.], [22068., 18600., 14542.], [22207., 18812., 14885.]],
    [[56., 5., -1.], [67., 6., -2.], [210., 26., -6.], [1158., 241., -26.], [4309., 1487., 52.], [9137., 4548., 984.], [13542., 8459., 3354.], [16707., 11906., 6434.], [18804., 14463., 9300.], [20147., 16226., 11554.], [20993., 17376., 13153.], [21479., 18050., 14136.], [21649., 18290., 14492.]],
    [[4., 0., 0.], [6., 0., 0.], [37., 4., -1.], [464., 88., -10.], [2745., 910., 33.], [7185., 3500., 766.], [11765., 7251., 2897.], [15278., 10789., 5857.], [17684., 13521., 8723.], [19271., 15447., 11029.], [20277., 16720., 12683.], [20859., 17474., 13709.], [21064., 17743., 14082.]],
    [[0., 0., 0.], [0., 0., 0.], [6., 0., 0.], [215., 38., -4.], [1956., 628., 23.], [6034., 2890., 638.], [10631., 6487., 2604.], [14323., 10050., 5475.], [16927., 12881., 8331.], [18664., 14909., 10664.], [19776., 16266., 12355.], [20427., 17074., 13408.], [20654., 17363., 13792.]],
    [[0., 0., 0.], [0., 0., 0.], [0., 0., 0.], [61., 10., -1.], [1118., 341., 13.], [4520., 2110., 473.], [8990., 5399., 2184.], [12881., 8942., 4901.], [15740., 11893., 7720.], [17700., 14066., 10090.], [18981., 15542., 11832.], [19729., 16429., 12928.], [19997., 16748., 13333.]],
    [[0., 0., 0.], [0., 0., 0.], [0., 0., 0.], [8., 1., 0.], [444., 125., 5.], [2807., 1254., 288.], [6819., 3988., 1639.], [10806., 7373., 4077.], [13965., 10420., 6811.], [16227., 12775., 9208.], [17734., 14419., 11019.], [18632., 15422., 12174.], [18953., 15786., 12603.]],
    [[0., 0., 0.], [0., 0., 0.], [0., 0., 0.], [0., 0., 0.], [97., 23., 1.], [1279., 531., 127.], [4319., 2419., 1018.], [8090., 5365., 3015.], [11461., 8385., 5539.], [14050., 10899., 7919.], [15853., 12738., 9796.], [16953., 13891., 11024.], [17348., 14315., 11489.]],
    [[0., 0., 0.], [0., 0., 0.], [0., 0., 0.], [0., 0., 0.], [8., 1., 0.], [350., 129., 33.], [2034., 1059., 464.], [5018., 3172., 1829.], [8276., 5854., 3938.], [11081., 8384., 6176.], [13173., 10382., 8070.], [14505., 11690., 9363.], [14993., 12181., 9859.]],
];

/// The model of Hošek and Wilkie 2013.
pub fn hosek_wilkie(turbidity: f64, zenith: f64) -> [f32; 3] {
    let x = (1.0 - zenith / std::f64::consts::FRAC_PI_2).clamp(0.0, 1.0).cbrt() * STEPS as f64;
    let first = (x as usize).clamp(1, STEPS - 2) - 1;
    let [a, b, c, d] = [0, 1, 2, 3].map(|node| x - (first + node) as f64);
    // Lagrange's cubic.
    let weights = [-b * c * d / 6.0, a * c * d / 2.0, -a * b * d / 2.0, a * b * c / 6.0];
    let low = (turbidity as usize).clamp(1, SUN.len() - 1) - 1;
    let high = turbidity - (low + 1) as f64;
    std::array::from_fn(|channel| {
        let at = |table: &[[f32; 3]]| -> f64 {
            (0..4).map(|node| weights[node] * f64::from(table[first + node][channel])).sum()
        };
        // Low suns are redder than RGB's gamut.
        ((1.0 - high) * at(&SUN[low]) + high * at(&SUN[low + 1])).max(0.0) as f32
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(ours: [f32; 3], theirs: [f32; 3], error: f32) {
        assert!((0..3).all(|i| (ours[i] - theirs[i]).abs() < error * theirs[0]), "{ours:?} {theirs:?}");
    }

    /// Means over the disk that Mitsuba 3.7.1 gives (`scalar_rgb`), between the table's entries.
    #[test]
    fn mitsuba_3_has_the_same_sun() {
        for (turbidity, degrees, theirs) in [
            (1.0, 20.0, [22662.1, 19157.6, 14971.1]),
            (3.0, 65.4, [19589.7, 14969.6, 9318.0]),
            (3.0, 86.0, [7742.5, 3066.4, 234.3]),
            (2.5, 50.0, [21378.1, 17403.1, 12504.5]),
            (6.2, 40.0, [19488.2, 15964.3, 12056.0]),
            (10.0, 75.0, [3743.3, 2219.0, 1170.1]),
        ] {
            close(hosek_wilkie(turbidity, f64::to_radians(degrees)), theirs, 5e-3);
        }
        assert_eq!(hosek_wilkie(3.0, 0.0), [22207.0, 18812.0, 14885.0]);
    }

    /// The same formulas with all five tables of the paper, summed elsewhere.
    #[test]
    fn preetham_with_all_absorption() {
        for (turbidity, degrees, theirs) in [
            (1.0, 0.0, [25032.1, 22151.4, 20429.5]),
            (3.0, 45.0, [19124.9, 15725.7, 12704.9]),
            (3.0, 80.0, [6524.9, 3808.3, 1505.6]),
            (10.0, 60.0, [5213.6, 3099.2, 1443.6]),
        ] {
            close(preetham(turbidity, f64::to_radians(degrees)), theirs, 2e-3);
        }
    }
}
