//! Denoising at the end of a render.

use std::time::Instant;

use crate::base::Result;
use crate::film::{Denoiser, Features};
use crate::picture::{Attribute, Channel, Image};
use crate::render::{RenderSettings, features};
use crate::scene::Scene;

/// Names of the channels that keep the noisy picture.
pub const NOISY: [&str; 3] = ["noisy.R", "noisy.G", "noisy.B"];

/// The picture as it is written.
pub struct Denoised {
    /// Denoised, if that was asked for and worked; else as it was.
    pub image: Image,
    /// The noisy picture as channels, where the other is denoised.
    pub noisy: Vec<Channel>,
    /// Text for the header, where the picture is denoised.
    pub attribute: Option<Attribute>,
    /// Why it could not be denoised. The picture is worth being written all the same.
    pub failure: Result<()>,
    /// Wall time.
    pub seconds: f64,
}

/// Denoises a picture of `scene` that was rendered with `settings`, if there is a denoiser.
pub fn finish(denoiser: Option<&Denoiser>, scene: &Scene, settings: &RenderSettings, image: Image) -> Denoised {
    let begun = Instant::now();
    let done: Option<Result<_>> = denoiser.map(|denoiser| {
        let denoised = each_view(denoiser, scene.views(), &image, &features(scene, settings)?)?;
        Ok((denoised, ("denoised".to_owned(), denoiser.name())))
    });
    let (noisy, failure) = (Vec::new(), Ok(()));
    let seconds = begun.elapsed().as_secs_f64();
    match done {
        None => Denoised { image, noisy, attribute: None, failure, seconds: 0.0 },
        Some(Err(error)) => Denoised { image, noisy, attribute: None, failure: Err(error), seconds },
        Some(Ok((denoised, attribute))) => {
            let values = |part| image.pixels.iter().map(|pixel| pixel[part]).collect();
            let channel = |(part, name): (usize, &str)| Channel { name: name.to_owned(), values: values(part) };
            let noisy = NOISY.into_iter().enumerate().map(channel).collect();
            Denoised { image: denoised, noisy, attribute: Some(attribute), failure, seconds }
        }
    }
}

/// Denoises the pictures of all views on a sheet, each by itself: what lies below it on the sheet is no part of it.
fn each_view(denoiser: &Denoiser, views: usize, sheet: &Image, seen: &Features) -> Result<Image> {
    let mut pixels = Vec::with_capacity(sheet.pixels.len());
    for (view, image) in sheet.parts(views).into_iter().enumerate() {
        let places = view * image.pixels.len()..(view + 1) * image.pixels.len();
        let features = Features { albedo: seen.albedo[places.clone()].to_vec(), normal: seen.normal[places].to_vec() };
        pixels.extend(denoiser.denoise(&image, &features)?.pixels);
    }
    Ok(Image { pixels, ..*sheet })
}
