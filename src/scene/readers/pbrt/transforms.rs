//! Directives that change the transform.

use glam::{DMat4, DVec3};

use crate::base::{Error, Result};

use super::Reader;
use super::state;
use super::tokens::{Token, Tokens};

impl Reader {
    /// A directive that changes the transform.
    pub(super) fn transform(&mut self, word: &str, tokens: &mut Tokens) -> Result<()> {
        let place = tokens.place();
        let now = self.state.transform;
        let affine = |numbers: [f64; 16]| {
            let projective = || Error::malformed(place.clone(), "a transform must be affine, its last row 0 0 0 1");
            state::matrix(&numbers).ok_or_else(projective)
        };
        let next = match word {
            "Identity" => DMat4::IDENTITY,
            "Translate" => now * DMat4::from_translation(DVec3::from_array(tokens.numbers()?)),
            "Scale" => now * DMat4::from_scale(DVec3::from_array(tokens.numbers()?)),
            "Rotate" => {
                let [angle, x, y, z] = tokens.numbers()?;
                let axis = DVec3::new(x, y, z).try_normalize();
                let axis = axis.ok_or_else(|| Error::malformed(place.clone(), "the axis of rotation is zero"))?;
                now * DMat4::from_axis_angle(axis, angle.to_radians())
            }
            "LookAt" => {
                let [ex, ey, ez, ax, ay, az, ux, uy, uz] = tokens.numbers()?;
                let (eye, at) = (DVec3::new(ex, ey, ez), DVec3::new(ax, ay, az));
                let view = state::look_at(eye, at, DVec3::new(ux, uy, uz));
                let undirected =
                    || Error::malformed(place.clone(), "LookAt needs a direction, and one upwards across it");
                now * view.ok_or_else(undirected)?
            }
            "Transform" => affine(tokens.numbers()?)?,
            "ConcatTransform" => now * affine(tokens.numbers()?)?,
            _ => {
                let name = tokens.text("a coordinate system's name")?;
                match self.systems.get(&name) {
                    Some(system) => *system,
                    None => {
                        self.warn(&place, format!("there is no coordinate system \"{name}\": the transform stays"));
                        now
                    }
                }
            }
        };
        if self.state.moves_start {
            self.state.transform = next;
        } else {
            self.warn(&place, "motion is left out: everything is where it is when the shutter opens");
        }
        Ok(())
    }

    /// Which end of a motion the transforms that follow are for.
    pub(super) fn active_transform(&mut self, tokens: &mut Tokens) -> Result<()> {
        let when = tokens.next()?;
        self.state.moves_start = match when {
            Some(Token::Word("StartTime" | "All")) => true,
            Some(Token::Word("EndTime")) => false,
            _ => return Err(tokens.malformed("expected StartTime, EndTime or All")),
        };
        Ok(())
    }
}
