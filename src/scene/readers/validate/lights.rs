//! Checks of lights.

use crate::base::Result;
use crate::scene::file::LightFile;

use super::number::Checker;

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
        LightFile::Directional { direction, irradiance } => {
            check.finite(&part("direction"), direction)?;
            if direction.iter().all(|&x| x == 0.0) {
                return check.fail(&part("direction"), "the direction is zero");
            }
            check.color(&part("irradiance"), irradiance)
        }
        LightFile::Constant { radiance } => check.color(&part("radiance"), radiance),
        LightFile::Envmap { scale, to_world, .. } => {
            check.at_least(&part("scale"), *scale, 0.0)?;
            check.transform(&part("to_world"), to_world)
        }
    }
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
