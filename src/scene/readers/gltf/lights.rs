//! Lights of KHR_lights_punctual. Their candela and lux are taken as W·sr⁻¹ and W·m⁻², number for number, as emission's cd·m⁻² are
//! as W·m⁻²·sr⁻¹: what lamps and shining surfaces are to one another stays as it is, and the exposure makes up for the rest.

use ::gltf::json::extensions::scene::khr_lights_punctual::{Light, Type};
use ::gltf::json::validation::Checked;
use glam::DVec3;

use crate::base::Result;
use crate::scene::file::LightFile;
use crate::scene::readers::frames::{facing, rounded};

use super::document::Document;
use super::nodes::Placed;
use super::warnings::Warnings;

/// The light of a node; none where it has none.
///
/// # Errors
/// [`Error::Malformed`](crate::base::Error::Malformed) for one that is not there, or of an unknown kind.
pub fn light(document: &Document, placed: &Placed, warnings: &mut Warnings) -> Result<Option<LightFile>> {
    let named = placed.node.extensions.as_ref().and_then(|extensions| extensions.khr_lights_punctual.as_ref());
    let Some(named) = named else { return Ok(None) };
    let all = document.root.extensions.as_ref().and_then(|extensions| extensions.khr_lights_punctual.as_ref());
    let all = all.map_or(&[][..], |all| &all.lights);
    let light: &Light = document.at(all, "lights", named.light.value(), &placed.part())?;
    let part = format!("extensions.KHR_lights_punctual.lights[{}]", named.light.value());
    if light.range.is_some() {
        warnings.add(&part, "range is left out: light reaches as far as it reaches");
    }
    let power = light.color.map(|channel| channel * light.intensity);
    let position = placed.to_world.w_axis.truncate().as_vec3().to_array();
    let direction = placed.to_world.transform_vector3(DVec3::NEG_Z).try_normalize().unwrap_or(DVec3::NEG_Z);
    Ok(Some(match light.type_ {
        Checked::Valid(Type::Point) => LightFile::Point { position, intensity: power },
        Checked::Valid(Type::Directional) => {
            LightFile::Directional { direction: direction.as_vec3().to_array(), irradiance: power }
        }
        Checked::Valid(Type::Spot) => {
            let spot = light.spot.clone().unwrap_or_default();
            let outer = if light.spot.is_some() { spot.outer_cone_angle } else { std::f32::consts::FRAC_PI_4 };
            LightFile::Spot {
                to_world: rounded(facing(placed.to_world.w_axis.truncate(), direction)),
                intensity: power,
                cutoff_angle: outer.to_degrees(),
                beam_width: spot.inner_cone_angle.to_degrees().min(outer.to_degrees()),
            }
        }
        Checked::Invalid => {
            return Err(document.unsupported(part, "this type of light", "point, spot, directional"));
        }
    }))
}
