//! Cameras.

use glam::{DMat4, DVec3};

use crate::base::{Error, Result};
use crate::scene::file::{CameraFile, Matrix};
use crate::scene::readers::cameras::cropped;
use crate::scene::readers::frames::rounded;

use super::Reader;
use super::parameters::Parameters;
use super::state::inverse;

/// Height of the sensor of a camera with a lens that is not simulated, and the focal length that is taken for it, mm.
const REAL: [f64; 2] = [24.0, 50.0];

impl Reader {
    /// Keeps the camera until the film is known.
    pub(super) fn set_camera(&mut self, kind: &str, parameters: Parameters) {
        let to_camera = self.state.transform;
        if let Some(to_world) = inverse(&to_camera) {
            self.systems.insert("camera".to_owned(), to_world);
        }
        self.camera = Some((kind.to_owned(), parameters, to_camera, self.state.media[1].clone()));
    }

    /// Translates the camera.
    pub(super) fn finish_camera(&mut self) -> Result<()> {
        let Some((kind, parameters, to_camera, medium)) = self.camera.take() else {
            self.warnings
                .push(format!("{}: there is no camera: one at the origin is used", self.places.source().display()));
            self.file.camera.to_world = turned(DMat4::IDENTITY);
            return Ok(());
        };
        let orthographic = kind == "orthographic";
        let [half, offset] = match kind.as_str() {
            "perspective" => self.view(&parameters)?,
            "orthographic" => self.window(&parameters)?,
            "realistic" => {
                parameters.ignore(&["lensfile", "aperture", "aperturediameter", "focusdistance", "simpleweighting"]);
                self.warn(&parameters.place, "the lens is left out: a pinhole with a focal length of 50 mm is used");
                let (width, height) = (f64::from(self.file.film.width), f64::from(self.file.film.height.max(1)));
                [[REAL[0] / (2.0 * REAL[1]) * width / height.min(width), 0.0], [0.0; 2]]
            }
            other => {
                let (place, what) = (parameters.place.clone(), format!("the camera \"{other}\""));
                return Err(Error::Unsupported {
                    place,
                    what,
                    supported: "perspective, orthographic, realistic".to_owned(),
                });
            }
        };
        let to_world =
            inverse(&to_camera).ok_or_else(|| parameters.malformed("the camera's transform flattens space"))?;
        let mut radius = parameters.float_or("lensradius", 0.0)?;
        if orthographic && radius > 0.0 {
            radius = 0.0;
            self.warn(&parameters.place, "the lens is left out: an orthographic camera sees all distances sharply");
        }
        let focus = parameters.float_or("focaldistance", 1e6)?;
        let shutter = parameters.float_or("shutterclose", 1.0)? - parameters.float_or("shutteropen", 0.0)?;
        // v3 has no time of exposure.
        self.expose(if self.old { 1.0 } else { shutter }, &parameters)?;
        self.note_unused(&parameters);
        self.places.set("camera", parameters.place.clone());
        self.file.camera = CameraFile {
            to_world: turned(to_world),
            fov: if orthographic { 0.0 } else { (2.0 * half[0].atan().to_degrees()) as f32 },
            orthographic_width: orthographic.then_some((2.0 * half[0]) as f32),
            aperture_radius: radius as f32,
            focus_distance: (radius > 0.0).then_some(focus as f32),
            medium: self.medium_name(&medium),
            principal_point_offset: offset.map(|part| part as f32),
            near_clip: 0.0,
            size: None,
        };
        if let Some(window) = self.crop {
            self.file.camera = cropped(&self.file.camera, &mut self.file.film, window);
        }
        Ok(())
    }

    /// Half the width of the picture at distance 1, and the offset of its middle in parts of its sides.
    fn view(&mut self, parameters: &Parameters) -> Result<[[f64; 2]; 2]> {
        let fov = match (parameters.float("fov")?, parameters.float("halffov")?) {
            (Some(fov), _) => fov,
            (None, half) => half.map_or(90.0, |half| 2.0 * half),
        };
        if !(fov > 0.0 && fov < 180.0) {
            return Err(parameters.malformed(format!("the field of view is {fov}°, expected one between 0° and 180°")));
        }
        let tan = (0.5 * fov).to_radians().tan();
        let [half, offset] = self.window(parameters)?;
        Ok([half.map(|half| half * tan), offset])
    }

    /// Half the width of the picture's window, and the offset of its middle in parts of its sides.
    fn window(&mut self, parameters: &Parameters) -> Result<[[f64; 2]; 2]> {
        let pixels = f64::from(self.file.film.width) / f64::from(self.file.film.height.max(1));
        let aspect = parameters.float_or("frameaspectratio", pixels)?;
        let window = match parameters.numbers("screenwindow")? {
            [] if aspect > 1.0 => [-aspect, aspect, -1.0, 1.0],
            [] => [-1.0, 1.0, -1.0 / aspect, 1.0 / aspect],
            [left, right, bottom, top] => [*left, *right, *bottom, *top],
            _ => return Err(parameters.malformed("screenwindow needs four numbers")),
        };
        let [left, right, bottom, top] = window;
        let (width, height) = (right - left, top - bottom);
        if !(width > 0.0 && height > 0.0) {
            return Err(parameters.malformed("the picture's window has no area"));
        }
        if (width / height / pixels - 1.0).abs() > 1e-3 {
            let message = "pixels are squares: the window's height follows from its width and the picture's size";
            self.warn(&parameters.place, message);
        }
        Ok([[width / 2.0, 0.0], [(left + right) / (2.0 * width), -(bottom + top) / (2.0 * height)]])
    }
}

/// Our camera's x points to the left.
fn turned(to_world: DMat4) -> Matrix {
    rounded(to_world * DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0))).map(|value| value + 0.0)
}
