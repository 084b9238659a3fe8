//! Sun and sky: `sunsky` of Mitsuba 3.7, and `sunsky`, `sky`, `sun` of Mitsuba 0.6. Both skies are that of Hošek and Wilkie 2012; the
//! suns are of different models, the frames differ (z up in 3.7, y up before), and so do some defaults.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DMat3, DMat4, DVec3};

use super::super::validate::LEAST_ANGLE;
use super::Reader;
use super::element::Element;
use super::object::{Object, kind};
use super::solar::{Moment, position};
use super::sunlight::{hosek_wilkie, preetham};
use crate::base::Result;
use crate::scene::file::LightFile;
use crate::scene::readers::spectrum::Use;

/// Angular diameter of the models' sun, degrees.
const DIAMETER: f64 = 0.5358;

/// Properties that give the sun's direction by date and place.
const WHEN_AND_WHERE: [&str; 9] =
    ["latitude", "longitude", "timezone", "day", "year", "month", "hour", "minute", "second"];

/// Properties that both versions have.
const COMMON: [&str; 5] = ["turbidity", "albedo", "sun_direction", "to_world", "sampling_weight"];

/// Position of the sun relative to the vertical.
struct Standing {
    /// World directions to the sun and upwards.
    sun: DVec3,
    up: DVec3,
    /// Angle between them, radians.
    zenith: f64,
}

impl Standing {
    /// The direction `stretch` times as far from the zenith.
    fn stretched(&self, stretch: f64) -> DVec3 {
        let side = (self.sun - self.up * self.zenith.cos()).normalize_or_zero();
        let angle = self.zenith * stretch;
        self.up * angle.cos() + side * angle.sin()
    }
}

impl<'a> Reader<'a> {
    /// Adds the sun and the sky of an emitter.
    pub(super) fn daylight(&mut self, element: &'a Element) -> Result<()> {
        let kind = kind(element)?;
        let old = kind != "sunsky";
        let own: &[&str] = if old {
            &["scale", "sun_scale", "sky_scale", "sun_radius_scale", "stretch", "resolution", "extend"]
        } else {
            &["sun_scale", "sky_scale", "sun_aperture", "complex_sun"]
        };
        let object = Object::new(element, &self.ids, &[&COMMON[..], &WHEN_AND_WHERE, own].concat(), &[])?;
        let turbidity = ranged(&object, "turbidity", 3.0, [1.0, 10.0])?;
        let stretch = ranged(&object, "stretch", 1.0, [1.0, 2.0])?;
        let standing = self.standing(&object, old)?;
        if standing.zenith > FRAC_PI_2 {
            if old {
                return Err(element.malformed("the sun is below the horizon"));
            }
            self.warn(element, "the sun is below the horizon: there is neither sun nor sky");
            return Ok(());
        }
        if object.boolean("complex_sun")? == Some(true) {
            self.warn(element, "complex_sun is left out: the sun is as bright at its rim as inside");
        }
        let scale = object.float("scale")?.unwrap_or(1.0);
        let [sun_scale, sky_scale] = ["sun_scale", "sky_scale"].map(|name| object.float(name));
        let (sun_scale, sky_scale) = (sun_scale?.unwrap_or(scale), sky_scale?.unwrap_or(scale));
        if kind != "sun" && sky_scale != 0.0 {
            let default = if old { 0.2 } else { 0.3 };
            let sky = LightFile::Sky {
                sun: rounded(standing.sun),
                up: rounded(standing.up),
                turbidity: turbidity as f32,
                albedo: object.color_for("albedo", Use::Reflectance)?.unwrap_or([default; 3]),
                scale: sky_scale as f32,
                stretch: stretch as f32,
                extend: object.boolean("extend")?.unwrap_or(false),
            };
            self.add_light(element, sky);
        }
        if kind != "sky" && sun_scale != 0.0 {
            let radiance = if old { preetham } else { hosek_wilkie }(turbidity, standing.zenith);
            let sun = sun(&object, rounded(-standing.stretched(stretch)), radiance.map(|x| x * sun_scale as f32))?;
            self.add_light(element, sun);
        }
        Ok(())
    }

    /// Position of the sun: as given, or by date and place.
    fn standing(&mut self, object: &Object<'a>, old: bool) -> Result<Standing> {
        let element = object.element;
        let frame = object.transform("to_world")?.unwrap_or(DMat4::IDENTITY);
        let [x, y, z] = [frame.x_axis, frame.y_axis, frame.z_axis].map(|axis| axis.truncate().try_normalize());
        let (Some(x), Some(y), Some(z)) = (x, y, z) else {
            return Err(element.malformed("to_world flattens space"));
        };
        let frame = DMat3::from_cols(x, y, z);
        let up = if old { y } else { z };
        let sun = match object.vector("sun_direction")? {
            Some(direction) => {
                self.only_direction(object, old)?;
                let direction = DVec3::from_array(direction).try_normalize();
                direction.ok_or_else(|| element.malformed("sun_direction is zero"))?
            }
            None => {
                let [zenith, azimuth] = by_date_and_place(object)?;
                let ((sin, cos), (east, north)) = (zenith.sin_cos(), azimuth.sin_cos());
                // In 0.6 east is +x and north −z; in 3.7 north is −x and east −y, mirrored.
                let local = if old {
                    DVec3::new(sin * east, cos, -sin * north)
                } else {
                    DVec3::new(-sin * north, -sin * east, cos)
                };
                (frame * local).normalize()
            }
        };
        Ok(Standing { sun, up, zenith: sun.dot(up).clamp(-1.0, 1.0).acos() })
    }

    /// Refuses date and place beside a direction, or leaves them out with a warning where Mitsuba 0.6 does not mind them.
    fn only_direction(&mut self, object: &Object<'a>, old: bool) -> Result<()> {
        let refused = if old { &WHEN_AND_WHERE[..4] } else { &WHEN_AND_WHERE[..] };
        for name in WHEN_AND_WHERE {
            let Some(property) = object.property(name) else { continue };
            if refused.contains(&name) {
                return Err(property.malformed(format!("sun_direction and {name} exclude each other")));
            }
            self.warn(property, format_args!("{name} is left out: sun_direction says where the sun is"));
        }
        Ok(())
    }
}

/// A number property within the bounds that Mitsuba demands.
fn ranged(object: &Object, name: &str, default: f64, [least, most]: [f64; 2]) -> Result<f64> {
    match object.float(name)?.unwrap_or(default) {
        value if value >= least && value <= most => Ok(value),
        value => {
            let place = object.property(name).unwrap_or(object.element);
            Err(place.malformed(format!("{name} is {value}, expected a number from {least} to {most}")))
        }
    }
}

/// The sun's [`position`] at the date and place of the properties; their defaults are Tokyo on an afternoon in July.
fn by_date_and_place(object: &Object) -> Result<[f64; 2]> {
    let whole = |name: &str, default: i64, [least, most]: [i64; 2]| match object.integer(name)?.unwrap_or(default) {
        value if value >= least && value <= most => Ok(value),
        value => {
            let place = object.property(name).unwrap_or(object.element);
            Err(place.malformed(format!("{name} is {value}, expected a number from {least} to {most}")))
        }
    };
    let number = |name: &str, default: f64| Ok(object.float(name)?.unwrap_or(default));
    let date = [whole("year", 2010, [1, 9999])?, whole("month", 7, [1, 12])?, whole("day", 10, [1, 31])?];
    let hours = number("hour", 15.0)? + (number("minute", 0.0)? + number("second", 0.0)? / 60.0) / 60.0;
    let moment = Moment { date, hours, timezone: number("timezone", 9.0)? };
    Ok(position(&moment, [number("latitude", 35.6894)?, number("longitude", 139.6917)?]))
}

/// A disk with the power of the models' sun of `radiance`, or parallel light where it is too small for a disk.
fn sun(object: &Object, direction: [f32; 3], radiance: [f32; 3]) -> Result<LightFile> {
    let scaled = object.float("sun_radius_scale")?.unwrap_or(1.0) * DIAMETER;
    let angle = object.float("sun_aperture")?.unwrap_or(scaled);
    if !(0.0..180.0).contains(&angle) {
        return Err(object.element.malformed(format!("the sun fills {angle}°, expected 0° to 180°")));
    }
    let angle = if angle < f64::from(LEAST_ANGLE) { 0.0 } else { angle };
    // L·Ω is kept; ∫ cos θ over the disk is Ω times the mean of 1 and the cosine of its radius.
    let [own, wanted] = [DIAMETER, angle].map(|angle| (0.5 * angle).to_radians());
    let factor = (4.0 * PI * (0.5 * own).sin().powi(2) * 0.5 * (1.0 + wanted.cos())) as f32;
    let irradiance = radiance.map(|x| x * factor);
    Ok(if angle == 0.0 {
        LightFile::Directional { direction, irradiance }
    } else {
        LightFile::Sun { direction, irradiance, angle: angle as f32 }
    })
}

fn rounded(direction: DVec3) -> [f32; 3] {
    direction.as_vec3().to_array()
}
