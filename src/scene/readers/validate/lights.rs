//! Checks of lights.

use glam::DVec3;

use crate::base::Result;
use crate::scene::file::{LightFile, ProfileFile, TextureFile};

use super::materials;
use super::number::Checker;

/// Smallest angular diameter of a sun, degrees: directions in single precision do not resolve the edge of a smaller one.
pub const LEAST_ANGLE: f32 = 0.1;

/// Most lights that project pictures: each keeps up to 3 MB to start photons by.
const MOST_PROJECTORS: u64 = 256;

/// Checks that there are not too many lights of a kind.
pub fn count(check: &Checker, lights: &[LightFile]) -> Result<()> {
    let projectors = lights.iter().filter(|light| matches!(light, LightFile::Projector { .. })).count();
    check.limit("lights", projectors as u64, MOST_PROJECTORS)
}

/// Checks one light.
pub fn light(check: &Checker, key: &str, light: &LightFile) -> Result<()> {
    let part = |name: &str| format!("{key}.{name}");
    match light {
        LightFile::Point { position, intensity } => {
            check.finite(&part("position"), position)?;
            check.color(&part("intensity"), intensity)
        }
        LightFile::Spot { to_world, intensity, cutoff_angle, beam_width } => {
            check.transform(&part("to_world"), to_world)?;
            check.color(&part("intensity"), intensity)?;
            cone(check, key, *cutoff_angle, *beam_width)
        }
        LightFile::Projector { to_world, fov, aspect, intensity, texture, profile } => {
            check.transform(&part("to_world"), to_world)?;
            if !(*fov > 0.0 && *fov < 180.0) {
                let message = format!("the angle of the picture is {fov}°, expected one between 0° and 180°");
                return check.fail(&part("fov"), message);
            }
            check.positive(&part("aspect"), *aspect)?;
            check.color(&part("intensity"), intensity)?;
            if matches!(texture, TextureFile::Attribute { .. }) {
                return check.fail(&part("texture"), "a light has no mesh whose colours it could take");
            }
            materials::emission(check, &part("texture"), texture)?;
            match profile {
                ProfileFile::Even {} | ProfileFile::Plane {} => Ok(()),
                ProfileFile::Cone { beam_width } => cone(check, &part("profile"), 0.5 * fov, *beam_width),
            }
        }
        LightFile::Directional { direction, irradiance } => {
            self::direction(check, &part("direction"), direction)?;
            check.color(&part("irradiance"), irradiance)
        }
        LightFile::Sun { direction, irradiance, angle } => {
            self::direction(check, &part("direction"), direction)?;
            check.color(&part("irradiance"), irradiance)?;
            within(check, &part("angle"), *angle, [LEAST_ANGLE, 180.0])
        }
        LightFile::Sky { sun, up, turbidity, albedo, scale, stretch, .. } => {
            direction(check, &part("sun"), sun)?;
            direction(check, &part("up"), up)?;
            let [sun, up] = [sun, up].map(|v| DVec3::from_array(v.map(f64::from)).normalize());
            if sun.dot(up) < -1e-6 {
                return check.fail(&part("sun"), "the sun is below the horizon");
            }
            within(check, &part("turbidity"), *turbidity, [1.0, 10.0])?;
            check.albedo(&part("albedo"), albedo)?;
            check.at_least(&part("scale"), *scale, 0.0)?;
            within(check, &part("stretch"), *stretch, [1.0, 2.0])
        }
        LightFile::Constant { radiance } => check.color(&part("radiance"), radiance),
        LightFile::Envmap { scale, to_world, .. } => {
            check.at_least(&part("scale"), *scale, 0.0)?;
            check.transform(&part("to_world"), to_world)
        }
    }
}

fn direction(check: &Checker, key: &str, direction: &[f32; 3]) -> Result<()> {
    check.finite(key, direction)?;
    if direction.iter().all(|&x| x == 0.0) {
        return check.fail(key, "the direction is zero");
    }
    Ok(())
}

fn within(check: &Checker, key: &str, value: f32, [least, most]: [f32; 2]) -> Result<()> {
    if value >= least && value <= most {
        return Ok(());
    }
    let name = key.rsplit('.').next().unwrap_or(key);
    check.fail(key, format!("{name} is {value}, expected a number from {least} to {most}"))
}

fn cone(check: &Checker, key: &str, cutoff: f32, beam: f32) -> Result<()> {
    if !(cutoff > 0.0 && cutoff <= 180.0) {
        return check.fail(
            &format!("{key}.cutoff_angle"),
            format!("cutoff_angle is {cutoff}°, expected more than 0° and at most 180°"),
        );
    }
    if !(beam >= 0.0 && beam <= cutoff) {
        return check.fail(
            &format!("{key}.beam_width"),
            format!("beam_width is {beam}°, expected 0° to cutoff_angle, {cutoff}°"),
        );
    }
    Ok(())
}
