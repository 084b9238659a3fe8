//! Position of the sun: the PSA algorithm (Blanco-Muriel et al. 2001, Computing the solar vector, Solar Energy 70), right to half
//! an arc minute from 1999 to 2015.

/// Mean radius of the earth and distance of the sun, km.
const EARTH: f64 = 6371.01;
const DISTANCE: f64 = 149_597_890.0;

/// A moment in local time.
#[derive(Debug, Clone, Copy)]
pub struct Moment {
    /// Year, month and day, the last two from 1.
    pub date: [i64; 3],
    /// Hours since midnight, with their fractions.
    pub hours: f64,
    /// Hours that local time is ahead of universal time.
    pub timezone: f64,
}

impl Moment {
    /// Hours of universal time since the midnight that begins the local date.
    fn universal_hours(&self) -> f64 {
        self.hours - self.timezone
    }

    /// Days since noon of January 1st, 2000, universal time.
    fn days(&self) -> f64 {
        let [year, month, day] = self.date;
        // Whole divisions round towards zero (Fliegel and van Flandern 1968).
        let start = (month - 14) / 12;
        let julian = (1461 * (year + 4800 + start)) / 4 + (367 * (month - 2 - 12 * start)) / 12
            - (3 * ((year + 4900 + start) / 100)) / 4
            + day
            - 32075;
        julian as f64 - 0.5 + self.universal_hours() / 24.0 - 2_451_545.0
    }
}

/// Angle of the sun from the zenith, and its azimuth from north by way of east, in radians, seen from a `[latitude, longitude]` in
/// degrees north and east.
pub fn position(moment: &Moment, [latitude, longitude]: [f64; 2]) -> [f64; 2] {
    let days = moment.days();
    let omega = 2.1429 - 0.001_039_459_4 * days;
    let anomaly = 6.240_060_0 + 0.017_201_969_9 * days;
    let ecliptic_longitude =
        4.895_063_0 + 0.017_202_791_698 * days + 0.033_416_07 * anomaly.sin() + 0.000_348_94 * (2.0 * anomaly).sin()
            - 0.000_113_4
            - 0.000_020_3 * omega.sin();
    let obliquity = 0.409_092_8 - 6.2140e-9 * days + 0.000_039_6 * omega.cos();
    let (sin_longitude, cos_longitude) = ecliptic_longitude.sin_cos();
    let right_ascension = (obliquity.cos() * sin_longitude).atan2(cos_longitude);
    let declination = (obliquity.sin() * sin_longitude).asin();
    let greenwich = 6.697_424_324_2 + 0.065_709_828_3 * days + moment.universal_hours();
    let hour_angle = (greenwich * 15.0 + longitude).to_radians() - right_ascension;
    let (sin_latitude, cos_latitude) = latitude.to_radians().sin_cos();
    let cos_zenith = cos_latitude * hour_angle.cos() * declination.cos() + declination.sin() * sin_latitude;
    let zenith = cos_zenith.clamp(-1.0, 1.0).acos();
    let azimuth = (-hour_angle.sin()).atan2(declination.tan() * cos_latitude - sin_latitude * hour_angle.cos());
    // The sun seen from the ground instead of the earth's centre.
    [zenith + EARTH / DISTANCE * zenith.sin(), azimuth.rem_euclid(std::f64::consts::TAU)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(moment: Moment, place: [f64; 2], [zenith, azimuth]: [f64; 2], error: f64) {
        let found = position(&moment, place).map(f64::to_degrees);
        assert!(
            (found[0] - zenith).abs() < error && (found[1] - azimuth).abs() < error,
            "{found:?} {zenith} {azimuth}"
        );
    }

    /// The example of Reda and Andreas 2004 (NREL/TP-560-34302, table A5.1), without refraction: elevation 39.872046°, azimuth
    /// 194.340241°. Within 0.02°: theirs is seen from 1830 m above the sea and counts 67 s between universal and dynamical time.
    #[test]
    fn golden_at_noon() {
        let moment = Moment { date: [2003, 10, 17], hours: 12.0 + 30.5 / 60.0, timezone: -7.0 };
        close(moment, [39.742476, -105.1786], [90.0 - 39.872046, 194.340241], 0.02);
    }

    /// At the solstice of June 2010 (21st, 11:28 UT) the declination is the obliquity, 23.44°; over Greenwich the sun is due south at
    /// 12:02 UT. South of the tropics it is due north then.
    #[test]
    fn solstice() {
        let noon = Moment { date: [2010, 6, 21], hours: 12.0 + 1.85 / 60.0, timezone: 0.0 };
        close(noon, [51.4779, 0.0], [51.4779 - 23.44, 180.0], 0.05);
        let [zenith, azimuth] = position(&noon, [-35.0, 0.0]).map(f64::to_degrees);
        assert!((zenith - 58.44).abs() < 0.02 && !(0.1..359.9).contains(&azimuth), "{zenith} {azimuth}");
    }

    /// Eight hours later and 120° further west it is the same moment of the day, but for the sun's own way.
    #[test]
    fn time_zones() {
        let at = |hours, timezone| Moment { date: [2012, 3, 1], hours, timezone };
        let [here, there] = [position(&at(10.0, 1.0), [40.0, 15.0]), position(&at(10.0, -7.0), [40.0, -105.0])];
        assert!((here[0] - there[0]).abs() < 0.005 && (here[1] - there[1]).abs() < 0.005, "{here:?} {there:?}");
        // The same moment in two time zones.
        assert_eq!(position(&at(10.0, 1.0), [40.0, 15.0]), position(&at(12.0, 3.0), [40.0, 15.0]));
    }
}
