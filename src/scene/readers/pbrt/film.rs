//! Film, pixel filter, sampler and integrator.

use crate::base::{Error, Result};
use crate::picture::Window;
use crate::scene::file::FilterFile;

use super::Reader;
use super::parameters::Parameters;

/// The filter of pbrt-v4 where a scene has none.
pub const DEFAULT_FILTER: FilterFile = FilterFile::Gaussian { stddev: 0.5, radius: Some(1.5) };

impl Reader {
    /// The film. pbrt multiplies radiance by exposure time · ISO / 100, which is 1 by default; here all light is.
    pub(super) fn film(&mut self, kind: &str, parameters: &Parameters) -> Result<()> {
        self.has_film = true;
        match kind {
            "image" => {
                self.old = true;
                (self.file.film.width, self.file.film.height) = (1280, 720);
                if self.file.film.filter == DEFAULT_FILTER {
                    self.file.film.filter = FilterFile::default();
                }
            }
            "rgb" | "gbuffer" | "spectral" => {}
            other => self.warn(&parameters.place, format!("the film \"{other}\" is read as \"rgb\"")),
        }
        let side = |name, default: u32| match parameters.integer(name)? {
            Some(side) => u32::try_from(side).map_err(|_| parameters.malformed(format!("{name} is {side}"))),
            None => Ok(default),
        };
        self.file.film.width = side("xresolution", self.file.film.width)?;
        self.file.film.height = side("yresolution", self.file.film.height)?;
        // Where the file goes, and what else is in it, is chosen when rendering; how large the film is matters to real lenses only.
        parameters.ignore(&[
            "filename",
            "savefp16",
            "diagonal",
            "nbuckets",
            "lambdamin",
            "lambdamax",
            "coordinatesystem",
        ]);
        self.crop = self.window_of_film(parameters)?;
        if parameters.find("maxcomponentvalue").is_some() || parameters.find("maxsampleluminance").is_some() {
            self.warn(&parameters.place, "bright samples are kept as they are: the film's limit is left out");
        }
        if parameters.float_or("whitebalance", 0.0)? != 0.0 {
            self.warn(&parameters.place, "white balance is left out");
        }
        if let Some(sensor) = parameters.string("sensor")?.filter(|sensor| *sensor != "cie1931") {
            let message = format!("the colours of the sensor \"{sensor}\" are left out: those of CIE 1931 are used");
            self.warn(&parameters.place, message);
        }
        let factors = [parameters.float_or("iso", 100.0)? / 100.0, parameters.float_or("exposuretime", 1.0)?];
        self.expose(factors[0] * factors[1] * parameters.float_or("scale", 1.0)?, parameters)?;
        self.places.set("film", parameters.place.clone());
        Ok(())
    }

    /// The window of the film that is to be rendered, by pixels or by parts of its sides; none for all of it.
    fn window_of_film(&mut self, parameters: &Parameters) -> Result<Option<Window>> {
        let size = [self.file.film.width, self.file.film.height];
        let bounds = match (parameters.numbers("pixelbounds")?, parameters.numbers("cropwindow")?) {
            ([], []) => return Ok(None),
            // The ends may come in any order.
            (_, &[left, right, top, bottom]) => {
                let [width, height] = size.map(f64::from);
                let [left, right] = [left.min(right), left.max(right)];
                let [top, bottom] = [top.min(bottom), top.max(bottom)];
                [left * width, right * width, top * height, bottom * height].map(f64::ceil)
            }
            (&[left, right, top, bottom], _) => [left, right, top, bottom],
            _ => return Err(parameters.malformed("a window of the film needs four numbers")),
        };
        // A cast takes what is below 0 for 0, and what is beyond the film ends with it, as in pbrt.
        let [left, right, top, bottom] = bounds.map(|bound| bound as u32);
        let (width, height) = (right.min(size[0]).saturating_sub(left), bottom.min(size[1]).saturating_sub(top));
        let window = Window { x: left, y: top, width, height };
        window.check_inside(size).map_err(|why| parameters.malformed(why.to_string()))?;
        Ok((window != Window::whole(size)).then_some(window))
    }

    /// Multiplies all light by a factor.
    pub(super) fn expose(&mut self, factor: f64, parameters: &Parameters) -> Result<()> {
        self.exposure *= factor;
        if factor >= 0.0 && self.exposure.is_finite() {
            return Ok(());
        }
        Err(parameters.malformed(format!("the exposure is {factor}, expected a finite number of at least 0")))
    }

    /// The pixel filter. Those with negative lobes have no density to draw samples from.
    pub(super) fn filter(&mut self, kind: &str, parameters: &Parameters) -> Result<()> {
        let radius = |default: f64| -> Result<(f64, bool)> {
            let axis = |names: [&'static str; 2]| Ok(parameters.float(names[0])?.or(parameters.float(names[1])?));
            let (x, y) = (axis(["xradius", "xwidth"])?, axis(["yradius", "ywidth"])?);
            let (x, y) = (x.or(y).unwrap_or(default), y.or(x).unwrap_or(default));
            Ok(((x + y) / 2.0, x != y))
        };
        let (filter, uneven) = match kind {
            "box" => radius(0.5).map(|(r, uneven)| (FilterFile::Box { radius: r as f32 }, uneven))?,
            "triangle" => radius(2.0).map(|(r, uneven)| (FilterFile::Tent { radius: r as f32 }, uneven))?,
            "gaussian" => {
                let (radius, uneven) = radius(if self.old { 2.0 } else { 1.5 })?;
                // v3 has exp(−α·x²).
                let alpha = parameters.float("alpha")?.or(self.old.then_some(2.0)).filter(|alpha| *alpha > 0.0);
                let stddev = match (parameters.float("sigma")?, alpha) {
                    (None, Some(alpha)) => (0.5 / alpha).sqrt(),
                    (sigma, _) => sigma.unwrap_or(0.5),
                };
                (FilterFile::Gaussian { stddev: stddev as f32, radius: Some(radius as f32) }, uneven)
            }
            "mitchell" | "sinc" => {
                parameters.ignore(&["B", "C", "tau", "xradius", "yradius", "xwidth", "ywidth"]);
                self.warn(&parameters.place, format!("the Gaussian filter is used instead of \"{kind}\""));
                (FilterFile::GAUSSIAN, false)
            }
            other => {
                let (place, what) = (parameters.place.clone(), format!("the pixel filter \"{other}\""));
                let supported = "box, triangle, gaussian, mitchell, sinc".to_owned();
                return Err(Error::Unsupported { place, what, supported });
            }
        };
        if uneven {
            self.warn(&parameters.place, "the filter is as wide in x as in y: the mean of both is used");
        }
        self.places.set("film.filter", parameters.place.clone());
        self.file.film.filter = filter;
        Ok(())
    }

    /// The sampler: which numbers are drawn is the renderer's own affair; how many samples is the scene's wish.
    pub(super) fn sampler(&mut self, kind: &str, parameters: &Parameters) -> Result<()> {
        let count = |name, default| Ok(parameters.integer(name)?.unwrap_or(default));
        let samples = match kind {
            "stratified" => count("xsamples", 4)?.saturating_mul(count("ysamples", 4)?),
            _ => count("pixelsamples", 16)?,
        };
        parameters.ignore(&["seed", "randomization", "jitter", "dimensions", "samplepixelcenter"]);
        let wrong = |_| parameters.malformed(format!("there are {samples} samples a pixel, expected at least 1"));
        self.file.render.spp = u32::try_from(samples).map_err(wrong)?;
        self.places.set("render.spp", parameters.place.clone());
        Ok(())
    }

    /// The integrator, of which the depth is used: pbrt's counts what is between camera and light, ours the light too.
    pub(super) fn integrator(&mut self, kind: &str, parameters: &Parameters) -> Result<()> {
        let known =
            ["path", "volpath", "simplepath", "simplevolpath", "bdpt", "lightpath", "mlt", "sppm", "directlighting"];
        if !known.contains(&kind) {
            self.warn(&parameters.place, format!("paths are traced instead of the integrator \"{kind}\""));
        }
        let depth = parameters.integer("maxdepth")?.unwrap_or(5);
        // How paths end early and how they are sampled does not belong to a scene's radiance.
        parameters.ignore(&[
            "regularize",
            "lightsampler",
            "lightsamplestrategy",
            "rrthreshold",
            "strategy",
            "pixelbounds",
        ]);
        let wrong = |_| parameters.malformed(format!("maxdepth is {depth}, expected at least 0"));
        self.file.render.max_depth = u32::try_from(depth).map_err(wrong)?.saturating_add(1);
        self.places.set("render.max_depth", parameters.place.clone());
        Ok(())
    }
}
