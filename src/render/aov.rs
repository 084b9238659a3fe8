//! Layers beside the picture: features, sample counts and variances of each pixel for denoising, compositing and finding noise.
//!
//! Features are those of the first surface on a camera ray, whatever it is made of: mirrors and glass are not looked through. They
//! are averaged over the pixel's first [`MOST_SAMPLES`] camera samples, whose rays are those of an unguided picture. All this is done after
//! the picture, which does not change by it, and not at all where no layer is wanted.

use glam::Vec3;
use rayon::prelude::*;

use super::Outcome;
use super::camera::{CameraSample, first_surface};
use super::mattes::{self, Matte};
use super::settings::RenderSettings;
use crate::base::Result;
use crate::film::PixelFilter;
use crate::guiding::sample::field::GuideField;
use crate::picture::{Attribute, Channel, Image, cryptomatte};
use crate::scene::Scene;

/// Camera samples that features are averaged over, where the picture has as many.
pub const MOST_SAMPLES: u32 = 16;

/// A layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Aov {
    /// `albedo.R/G/B`: reflectance; 0 where nothing is hit.
    Albedo,
    /// `normal.X/Y/Z`: unit shading normal in the world, on the side of the camera; 0 where nothing is hit.
    Normal,
    /// `position.X/Y/Z`: point in the world, averaged over samples that hit something; 0 where none does.
    Position,
    /// `depth.Z`: distance along the camera ray, averaged over samples that hit something; 0 where none does.
    Depth,
    /// `samples.Y`: camera samples that the pixel's value is made of.
    Samples,
    /// `variance.R/G/B`: variance of the pixel's value; 0 below two samples.
    Variance,
    /// `guiding.Y`: probability that the guide, not the BSDF, chooses the direction in which the path leaves the surface, if that has no delta
    /// lobe: such lobes are drawn before.
    Guiding,
    /// `crypto_object00.r/g/b/a` to `crypto_object02.r/g/b/a`: the names of the shapes that the pixel shows, with the part of it that
    /// each covers (see [`cryptomatte`]).
    CryptoObject,
    /// `crypto_material00.r/g/b/a` to `crypto_material02.r/g/b/a`: the same for materials.
    CryptoMaterial,
}

impl Aov {
    /// All layers.
    pub const ALL: [Self; 9] = [
        Self::Albedo,
        Self::Normal,
        Self::Position,
        Self::Depth,
        Self::Samples,
        Self::Variance,
        Self::Guiding,
        Self::CryptoObject,
        Self::CryptoMaterial,
    ];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Albedo => "albedo",
            Self::Normal => "normal",
            Self::Position => "position",
            Self::Depth => "depth",
            Self::Samples => "samples",
            Self::Variance => "variance",
            Self::Guiding => "guiding",
            Self::CryptoObject => "crypto-object",
            Self::CryptoMaterial => "crypto-material",
        }
    }

    /// Whether the layer is made of the film's samples.
    pub fn is_of_film(self) -> bool {
        matches!(self, Self::Samples | Self::Variance)
    }

    /// Whether the layer tells things apart by their names.
    pub fn is_matte(self) -> bool {
        self.matte().is_some()
    }

    /// Whether the layer is a feature of surfaces.
    pub fn is_feature(self) -> bool {
        !self.is_of_film() && !self.is_matte()
    }

    fn matte(self) -> Option<Matte> {
        match self {
            Self::CryptoObject => Some(Matte::Object),
            Self::CryptoMaterial => Some(Matte::Material),
            _ => None,
        }
    }

    /// Its channels' names.
    pub fn channels(self) -> Vec<String> {
        let parts: &[&str] = match self {
            Self::CryptoObject | Self::CryptoMaterial => {
                return self.matte().map_or(Vec::new(), |matte| cryptomatte::names(matte.name()));
            }
            Self::Albedo | Self::Variance => &["R", "G", "B"],
            Self::Normal | Self::Position => &["X", "Y", "Z"],
            Self::Depth => &["Z"],
            Self::Samples | Self::Guiding => &["Y"],
        };
        parts.iter().map(|part| format!("{}.{part}", self.name())).collect()
    }
}

/// Features of one camera sample, or their means over a pixel.
#[derive(Debug, Clone, Copy, Default)]
struct Features {
    albedo: Vec3,
    normal: Vec3,
    position: Vec3,
    depth: f32,
    guiding: f32,
}

/// The channels of `aovs` for the picture that `outcome` holds, which was rendered with `settings`.
///
/// # Errors
/// [`Error::Options`](crate::base::Error::Options) for a filter that cannot be.
pub fn channels(scene: &Scene, settings: &RenderSettings, outcome: &Outcome, aovs: &[Aov]) -> Result<Vec<Channel>> {
    let wanted = aovs.iter().any(|aov| aov.is_feature());
    let features = if wanted { features(scene, settings, outcome)? } else { Vec::new() };
    let film = outcome.spread.as_ref();
    let of = |aov: Aov, part: usize| -> Vec<f32> {
        let feature = |f: fn(&Features) -> Vec3| features.iter().map(|features| f(features)[part]).collect();
        match aov {
            Aov::Albedo => feature(|f| f.albedo),
            Aov::Normal => feature(|f| f.normal),
            Aov::Position => feature(|f| f.position),
            Aov::Depth => feature(|f| Vec3::splat(f.depth)),
            Aov::Guiding => feature(|f| Vec3::splat(f.guiding)),
            Aov::Samples => film.map_or(Vec::new(), |film| film.samples.iter().map(|&n| n as f32).collect()),
            Aov::Variance => film.map_or(Vec::new(), |film| film.variance.iter().map(|v| v[part]).collect()),
            Aov::CryptoObject | Aov::CryptoMaterial => Vec::new(),
        }
    };
    let named = |&aov: &Aov| {
        let names = aov.channels().into_iter().enumerate();
        names.map(move |(part, name)| (aov, part, name)).collect::<Vec<_>>()
    };
    let channel = |(aov, part, name): (Aov, usize, String)| Channel { name, values: of(aov, part) };
    let mut channels: Vec<Channel> = aovs.iter().filter(|aov| !aov.is_matte()).flat_map(named).map(channel).collect();
    let mattes: Vec<Matte> = aovs.iter().filter_map(|aov| aov.matte()).collect();
    if !mattes.is_empty() {
        channels.extend(mattes::channels(scene, settings, outcome, &mattes)?);
    }
    Ok(channels)
}

/// The channels of the light of `fireflies` that was taken out of the picture: `fireflies.R/G/B`.
pub fn fireflies_channels(fireflies: &Image) -> Vec<Channel> {
    let values = |part| fireflies.pixels.iter().map(|light| light[part]).collect();
    let parts = ["R", "G", "B"].into_iter().enumerate();
    parts.map(|(part, name)| Channel { name: format!("fireflies.{name}"), values: values(part) }).collect()
}

/// What belongs to `aovs` in the header of an EXR file that holds them among `channels`: the names of what mattes show.
pub fn header(scene: &Scene, aovs: &[Aov], channels: &[Channel]) -> Vec<Attribute> {
    aovs.iter().filter_map(|aov| aov.matte()).flat_map(|matte| matte.header(scene, channels)).collect()
}

fn features(scene: &Scene, settings: &RenderSettings, outcome: &Outcome) -> Result<Vec<Features>> {
    let filter = PixelFilter::new(settings.filter)?;
    let samples = outcome.samples_of_all(settings).clamp(1, MOST_SAMPLES);
    let window = settings.window(scene.size);
    let pixels = outcome.image.pixels.len();
    let field = Some(&outcome.field).filter(|field| !field.voxels().is_empty());
    let pixel = |pixel: usize| {
        let (mut sum, mut hits) = (Features::default(), 0.0f32);
        for sample in 0..u64::from(samples) {
            if let Some(seen) = seen(scene, settings, &filter, field, window.place(pixel as u64), sample) {
                sum.albedo += seen.albedo;
                sum.normal += seen.normal;
                sum.position += seen.position;
                sum.depth += seen.depth;
                sum.guiding += seen.guiding;
                hits += 1.0;
            }
        }
        let (all, hits) = (samples as f32, hits.max(1.0));
        Features {
            albedo: sum.albedo / all,
            normal: sum.normal / all,
            position: sum.position / hits,
            depth: sum.depth / hits,
            guiding: sum.guiding / all,
        }
    };
    Ok((0..pixels).into_par_iter().with_min_len(256).map(pixel).collect())
}

/// Features of the first surface on the ray of a camera sample; none where it hits nothing.
fn seen(
    scene: &Scene,
    settings: &RenderSettings,
    filter: &PixelFilter,
    field: Option<&GuideField>,
    place: [u32; 2],
    sample: u64,
) -> Option<Features> {
    let sample = CameraSample { place, number: sample, sequences_from: Some(0) };
    let (ray, surface) = first_surface(scene, settings, filter, sample)?;
    let material = scene.material(&surface);
    let normal = surface.normal_towards(-ray.direction);
    let guide = field.filter(|_| !material.is_delta()).and_then(|field| field.at(surface.point, normal));
    let guided = guide.and_then(|guide| guide.at(surface.point));
    Some(Features {
        albedo: material.albedo(surface.uv),
        normal,
        position: surface.point,
        depth: surface.distance,
        guiding: guided.map_or(0.0, |guide| 1.0 - guide.bsdf_fraction),
    })
}
