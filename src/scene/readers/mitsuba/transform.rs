//! Transforms: a later element acts after the ones before it.

use glam::{DMat3, DMat4, DVec3};

use crate::base::Result;
use crate::scene::readers::frames::looking;

use super::element::{Element, number, numbers, xyz};

/// Reads a `<transform>`.
pub fn read(element: &Element) -> Result<DMat4> {
    // The time of an animation's transform.
    element.only_attributes(&["id", "name", "time"])?;
    element.children.iter().try_fold(DMat4::IDENTITY, |before, child| {
        child.no_children()?;
        Ok(step(child)? * before)
    })
}

fn step(element: &Element) -> Result<DMat4> {
    match element.tag.as_str() {
        "translate" => {
            element.only_attributes(&["x", "y", "z", "value"])?;
            Ok(DMat4::from_translation(DVec3::from_array(xyz(element, 0.0)?)))
        }
        "scale" => {
            element.only_attributes(&["x", "y", "z", "value"])?;
            Ok(DMat4::from_scale(DVec3::from_array(xyz(element, 1.0)?)))
        }
        "rotate" => {
            element.only_attributes(&["x", "y", "z", "value", "angle"])?;
            let axis = DVec3::from_array(xyz(element, 0.0)?);
            let axis = axis.try_normalize().ok_or_else(|| element.malformed("the axis of rotation is zero"))?;
            Ok(DMat4::from_axis_angle(axis, number(element, element.required("angle")?)?.to_radians()))
        }
        "matrix" => matrix(element),
        "lookat" | "look_at" => look_at(element),
        other => {
            let known = ["translate", "scale", "rotate", "matrix", "lookat"];
            Err(element.unsupported(format!("<{other}> inside <transform>"), &known))
        }
    }
}

/// Reads a matrix row by row: 4×4, or 3×3 without translation.
fn matrix(element: &Element) -> Result<DMat4> {
    element.only_attributes(&["value"])?;
    let values = numbers(element, element.required("value")?)?;
    match values.len() {
        16 => Ok(DMat4::from_cols_slice(&values).transpose()),
        9 => Ok(DMat4::from_mat3(DMat3::from_cols_slice(&values).transpose())),
        count => Err(element.malformed(format!("a matrix has 16 or 9 numbers, found {count}"))),
    }
}

/// Transform from a frame that looks along +z with +y up to one at `origin` that looks at `target`.
fn look_at(element: &Element) -> Result<DMat4> {
    element.only_attributes(&["origin", "target", "up"])?;
    let vector = |name: &str, text: &str| match numbers(element, text)?.as_slice() {
        [x, y, z] => Ok(DVec3::new(*x, *y, *z)),
        _ => Err(element.malformed(format!("\"{name}\" needs three numbers"))),
    };
    let origin = vector("origin", element.required("origin")?)?;
    let target = vector("target", element.required("target")?)?;
    let direction =
        (target - origin).try_normalize().ok_or_else(|| element.malformed("origin and target are the same"))?;
    let up = element.attribute("up").map_or(Ok(DVec3::ZERO), |text| vector("up", text))?;
    // Mitsuba takes the first vector of its basis around the view.
    let up = if up == DVec3::ZERO { direction.any_orthonormal_pair().0 } else { up };
    looking(origin, direction, up).ok_or_else(|| element.malformed("\"up\" is along the view"))
}
