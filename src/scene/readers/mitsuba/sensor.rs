//! Sensors, films and samplers.

use crate::base::Result;
use crate::picture::Window;
use crate::scene::file::{CameraFile, FilmFile, FilterFile};
use crate::scene::readers::cameras::{add, cropped};

use super::Reader;
use super::element::{Element, number};
use super::object::{Object, kind, refuse_slip_of_kind};

/// Mitsuba's `far_clip`, which is also where a lens without `focus_distance` is focused.
const FAR_CLIP: f64 = 1e4;
/// Its default of `near_clip`: what is nearer to the camera's plane is not seen, also in scenes in other units than metres.
const NEAR_CLIP: f64 = 1e-2;

/// The sensors that are read.
const KINDS: [&str; 4] = ["perspective", "thinlens", "orthographic", "batch"];

/// Mitsuba's film where a sensor has none.
pub const DEFAULT_FILM: FilmFile = FilmFile { width: 768, height: 576, filter: FilterFile::GAUSSIAN };

impl<'a> Reader<'a> {
    /// Reads a sensor. The first one's film and samples are those of the scene.
    pub(super) fn sensor(&mut self, element: &'a Element) -> Result<()> {
        if kind(element)? == "batch" {
            return self.batch(element);
        }
        let known = KINDS.contains(&kind(element)?);
        if self.sensors > 0 && !known {
            self.warn(element, format_args!("the sensor \"{}\" is left out", kind(element)?));
            return Ok(());
        }
        let (film, spp) = (self.file.film.clone(), self.file.render.spp);
        if self.sensors > 0 {
            self.file.film = DEFAULT_FILM;
        }
        let mut camera = self.camera(element)?;
        if self.sensors > 0 {
            let own = std::mem::replace(&mut self.file.film, film);
            let film = &self.file.film;
            camera.size = Some([own.width, own.height]).filter(|size| *size != [film.width, film.height]);
            if own.filter != film.filter || self.file.render.spp != spp {
                self.warn(element, "the pixel filter and the samples of the first sensor hold for this one too");
            }
            self.file.render.spp = spp;
        }
        let (id, place) = (element.attribute("id"), element.place.clone());
        add(&mut self.file, &mut self.places, self.sensors, id, camera, place);
        self.sensors += 1;
        Ok(())
    }

    fn camera(&mut self, element: &'a Element) -> Result<CameraFile> {
        let (lens, orthographic) = match kind(element)? {
            "perspective" => (false, false),
            "thinlens" => (true, false),
            "orthographic" => (false, true),
            other => {
                refuse_slip_of_kind(element, &KINDS)?;
                self.warn(element, format_args!("the sensor \"{other}\" is not known: a perspective one is used"));
                (false, false)
            }
        };
        let mut known = vec!["to_world", "near_clip", "far_clip", "shutter_open", "shutter_close"];
        if !orthographic {
            known.extend(["fov", "fov_axis", "focal_length", "focus_distance"]);
            known.extend(["principal_point_offset_x", "principal_point_offset_y"]);
        }
        known.extend(lens.then_some("aperture_radius"));
        let object = Object::new(element, &self.ids, &known, &["film", "sampler", "medium"])?;
        let sampler = object.single("sampler")?;
        if let Some(sampler) = sampler {
            self.sampler(sampler)?;
        }
        let crop = match object.single("film")? {
            Some(film) => self.film(film)?,
            None => None,
        };
        let near_clip = object.float("near_clip")?.unwrap_or(NEAR_CLIP) as f32;
        let far = object.float("far_clip")?.unwrap_or(FAR_CLIP);
        let focus = object.float("focus_distance")?.unwrap_or(far) as f32;
        let offset = |axis: &str| Ok(object.float(&format!("principal_point_offset_{axis}"))?.unwrap_or(0.0) as f32);
        let principal_point_offset = [offset("x")?, offset("y")?];
        let aperture = match (lens, object.float("aperture_radius")?) {
            (true, None) => return Err(element.malformed("a thinlens needs an aperture_radius")),
            (_, radius) => radius.unwrap_or(0.0) as f32,
        };
        let [medium] = self.media(element, "camera", ["medium"])?;
        let camera = CameraFile {
            medium,
            to_world: object.to_world()?,
            fov: if orthographic { 0.0 } else { horizontal_fov(&object, aspect(&self.file.film))? as f32 },
            // From −1 to 1, which to_world scales.
            orthographic_width: orthographic.then_some(2.0),
            aperture_radius: aperture,
            focus_distance: lens.then_some(focus),
            principal_point_offset,
            near_clip,
            size: None,
        };
        Ok(match crop {
            Some(window) => cropped(&camera, &mut self.file.film, window),
            None => camera,
        })
    }

    /// Sets the place of what the first sensor says for all.
    fn set_place(&mut self, key: &str, element: &Element) {
        if self.sensors == 0 {
            self.places.set(key, element.place.clone());
        }
    }

    /// Reads sensors that see the scene at once, one by one.
    fn batch(&mut self, element: &'a Element) -> Result<()> {
        let object = Object::lenient(element, &self.ids, &[])?;
        let sensors: Vec<&Element> = object.nested.iter().copied().filter(|inner| inner.tag == "sensor").collect();
        if sensors.is_empty() {
            return Err(element.malformed("a batch needs sensors inside"));
        }
        sensors.into_iter().try_for_each(|inner| self.nested(inner, |reader| reader.sensor(inner)))
    }

    fn sampler(&mut self, element: &'a Element) -> Result<()> {
        // Which numbers are drawn is the renderer's own affair; how many samples is the scene's wish.
        kind(element)?;
        let object = Object::lenient(element, &self.ids, &["sample_count"])?;
        if let Some(count) = object.integer("sample_count")? {
            let invalid = |_| element.malformed(format!("sample_count is {count}, expected at least 1"));
            self.file.render.spp = u32::try_from(count).map_err(invalid)?;
        }
        self.set_place("render.spp", element);
        Ok(())
    }

    /// Reads a film; the window of it that is to be rendered, if that is not all.
    fn film(&mut self, element: &'a Element) -> Result<Option<Window>> {
        match kind(element)? {
            "hdrfilm" | "ldrfilm" | "mfilm" | "tiledhdrfilm" => {}
            other => {
                refuse_slip_of_kind(element, &["hdrfilm", "ldrfilm", "mfilm", "tiledhdrfilm"])?;
                self.warn(element, format_args!("the film \"{other}\" is not known: it has colours in floating point"));
            }
        }
        // How the file is written is chosen when rendering.
        let known = ["width", "height", "crop_width", "crop_height", "crop_offset_x", "crop_offset_y"];
        let object = Object::lenient(element, &self.ids, &known)?;
        let side = |name: &str, default: u32| match object.integer(name)? {
            Some(side) => u32::try_from(side).map_err(|_| element.malformed(format!("{name} is {side}"))),
            None => Ok(default),
        };
        let default = &self.file.film;
        let (width, height) = (side("width", default.width)?, side("height", default.height)?);
        self.set_place("film", element);
        let filter = object.single("rfilter")?.map_or(Ok(FilterFile::GAUSSIAN), |filter| self.filter(filter))?;
        self.file.film = FilmFile { width, height, filter };
        let window = Window {
            x: side("crop_offset_x", 0)?,
            y: side("crop_offset_y", 0)?,
            width: side("crop_width", width)?,
            height: side("crop_height", height)?,
        };
        if window == Window::whole([width, height]) {
            return Ok(None);
        }
        window.check_inside([width, height]).map_err(|why| element.malformed(why.to_string()))?;
        Ok(Some(window))
    }

    /// A reconstruction filter. Those with negative lobes have no density to draw samples from.
    fn filter(&mut self, element: &'a Element) -> Result<FilterFile> {
        let kind = kind(element)?;
        let known: &[&str] = match kind {
            "box" => &["radius"],
            "catmullrom" => &[],
            "tent" => &["radius"],
            "gaussian" => &["stddev"],
            "mitchell" => &["A", "B", "C"],
            "lanczos" => &["lobes"],
            _ => {
                refuse_slip_of_kind(element, &["box", "tent", "gaussian", "mitchell", "catmullrom", "lanczos"])?;
                &["radius", "lobes"]
            }
        };
        let object = Object::new(element, &self.ids, known, &[])?;
        self.set_place("film.filter", element);
        let number = |name: &str, default: f64| Ok(object.float(name)?.unwrap_or(default) as f32);
        Ok(match kind {
            "box" => FilterFile::Box { radius: number("radius", 0.5)? },
            "tent" => FilterFile::Tent { radius: number("radius", 1.0)? },
            "gaussian" => FilterFile::Gaussian { stddev: number("stddev", 0.5)?, radius: None },
            _ => {
                let place = &element.place;
                self.warnings.push(format!("{place}: the Gaussian filter is used instead of \"{kind}\""));
                FilterFile::GAUSSIAN
            }
        })
    }
}

fn aspect(film: &FilmFile) -> f64 {
    f64::from(film.width) / f64::from(film.height.max(1))
}

/// Horizontal field of view, degrees. Without `fov`, the focal length for a 36 mm × 24 mm film sets the angle of the diagonal;
/// `aspect` is the picture's width over its height.
pub(super) fn horizontal_fov(object: &Object, aspect: f64) -> Result<f64> {
    let element = object.element;
    let half_tangent = |degrees: f64| {
        // Beyond this range the tangent below would turn into another angle.
        if degrees > 0.0 && degrees < 180.0 {
            return Ok((degrees.to_radians() / 2.0).tan());
        }
        Err(element.malformed(format!("the field of view is {degrees}°, expected one between 0° and 180°")))
    };
    let from_diagonal = |half: f64| half / (1.0 + 1.0 / (aspect * aspect)).sqrt();
    let fov = object.float("fov")?;
    let half = match (fov, object.string("focal_length")?) {
        (Some(_), Some(_)) => return Err(element.malformed("fov and focal_length exclude each other")),
        (Some(fov), None) => {
            let half = half_tangent(fov)?;
            match object.string("fov_axis")?.unwrap_or("x").to_ascii_lowercase().as_str() {
                "x" => return Ok(fov),
                "larger" if aspect > 1.0 => return Ok(fov),
                "smaller" if aspect <= 1.0 => return Ok(fov),
                "y" | "larger" | "smaller" => half * aspect,
                "diagonal" => from_diagonal(half),
                other => {
                    let known = ["x", "y", "diagonal", "smaller", "larger"];
                    return Err(element.unsupported(format!("fov_axis \"{other}\""), &known));
                }
            }
        }
        (None, focal_length) => {
            let text = focal_length.unwrap_or("50mm");
            let millimetres = number(element, text.strip_suffix("mm").unwrap_or(text))?;
            if millimetres <= 0.0 {
                return Err(element.malformed(format!("focal_length is \"{text}\", expected a positive length")));
            }
            from_diagonal(36f64.hypot(24.0) / (2.0 * millimetres))
        }
    };
    Ok(2.0 * half.atan().to_degrees())
}
