//! Textures (specification, §3.8): which picture, which texture coordinates, how both are joined.

use ::gltf::json::extensions::texture::TextureTransform;
use ::gltf::json::material::NormalTexture;
use ::gltf::json::texture::{Info, MagFilter, Sampler, WrappingMode};
use ::gltf::json::validation::Checked;
use glam::{DVec2, Vec2, Vec3};
use serde_json::Value;

use crate::base::Result;
use crate::materials::texture::Texture;
use crate::scene::file::{Filter, TextureFile, Wrap, identity3};
use crate::scene::readers::missing::GREY;

use super::document::Document;
use super::pictures::{Pictures, Use};
use super::warnings::Warnings;

/// A use of a texture by a material.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// Index of the texture.
    texture: usize,
    /// Number of the texture coordinates.
    pub set: u32,
    /// Texture coordinates to picture coordinates, 3×3 row by row.
    to_uv: [f32; 9],
}

impl Reference {
    /// From the usual description.
    pub fn of(info: &Info) -> Self {
        let transform = info.extensions.as_ref().and_then(|extensions| extensions.texture_transform.as_ref());
        Self::new(info.index.value(), info.tex_coord, transform)
    }

    /// From that of a normal map.
    pub fn of_normals(info: &NormalTexture) -> Self {
        let others = info.extensions.as_ref().map(|extensions| &extensions.others);
        let transform = others.and_then(|others| others.get("KHR_texture_transform"));
        Self::new(info.index.value(), info.tex_coord, transform.and_then(transform_of).as_ref())
    }

    /// From that of an extension; none where there is none.
    pub fn of_value(value: Option<&Value>) -> Option<Self> {
        serde_json::from_value::<Info>(value?.clone()).ok().map(|info| Self::of(&info))
    }

    /// Unit vectors on the surface along what is right and up on the picture: their parts along ∂p/∂u and −∂p/∂v, since v
    /// points down.
    pub fn axes(&self) -> [Vec2; 2] {
        let [a, b, _, c, d, ..] = self.to_uv.map(f64::from);
        let determinant = a * d - b * c;
        // A picture that is drawn out without end has no directions.
        if determinant == 0.0 {
            return Vec2::AXES;
        }
        // The columns of the inverse of ((a, b), (c, d)), the second one for what is up.
        [DVec2::new(d, c), DVec2::new(b, a)].map(|axis| (axis / axis.length() * determinant.signum()).as_vec2())
    }

    fn new(texture: usize, set: u32, transform: Option<&TextureTransform>) -> Self {
        match transform {
            None => Self { texture, set, to_uv: identity3() },
            Some(transform) => Self { texture, set: transform.tex_coord.unwrap_or(set), to_uv: to_uv(transform) },
        }
    }
}

fn transform_of(value: &Value) -> Option<TextureTransform> {
    serde_json::from_value(value.clone()).ok()
}

/// KHR_texture_transform: scale, then rotation counter-clockwise as seen on the picture, whose v points down, then offset.
fn to_uv(transform: &TextureTransform) -> [f32; 9] {
    let ([x, y], [sx, sy]) = (transform.offset.0, transform.scale.0);
    let (sin, cos) = transform.rotation.0.sin_cos();
    [cos * sx, sin * sy, x, -sin * sx, cos * sy, y, 0.0, 0.0, 1.0]
}

/// What is needed to make textures.
pub struct Textures<'a> {
    /// The document.
    pub document: &'a Document,
    /// Its pictures.
    pub pictures: Pictures,
    /// Where warnings go.
    pub warnings: &'a mut Warnings,
}

impl Textures<'_> {
    /// The picture of a texture that the part `user` uses; none where only an extension gives one, with a warning.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) for a texture that is not there.
    pub fn picture(&mut self, reference: &Reference, user: &str) -> Result<Option<usize>> {
        let picture = picture(self.document, reference, user)?;
        if picture.is_none() {
            let part = format!("textures[{}]", reference.texture);
            self.warnings.add(part, "its picture is in a format of an extension: the texture is left out");
        }
        Ok(picture)
    }

    /// The texture for one use, times a number; none where it has no picture.
    ///
    /// # Errors
    /// As [`Textures::picture`].
    pub fn bitmap(
        &mut self,
        reference: &Reference,
        purpose: Use,
        scale: f32,
        user: &str,
    ) -> Result<Option<TextureFile>> {
        let Some(picture) = self.picture(reference, user)? else { return Ok(None) };
        let Some(file) = self.pictures.make(picture, purpose) else {
            let color = match purpose {
                Use::Color(factor) => factor.map(|factor| (GREY * factor * scale).clamp(0.0, 1.0)),
                Use::Normals(_) => [0.5, 0.5, 1.0],
                _ => [(GREY * scale).clamp(0.0, 1.0); 3],
            };
            return Ok(Some(TextureFile::rgb(color)));
        };
        let texture = self.document.at(&self.document.root.textures, "textures", reference.texture, user)?;
        let part = format!("textures[{}]", reference.texture);
        let (wrap, filter) = match texture.sampler {
            Some(index) => {
                let sampler = self.document.item(&self.document.root.samplers, "samplers", index, &part)?;
                self.sampling(sampler, &format!("samplers[{}]", index.value()))
            }
            None => (Wrap::Repeat, Filter::Bilinear),
        };
        Ok(Some(TextureFile::Bitmap { file, to_uv: reference.to_uv, raw: purpose.is_raw(), scale, wrap, filter }))
    }

    fn sampling(&mut self, sampler: &Sampler, part: &str) -> (Wrap, Filter) {
        let mut wrap = |mode: Checked<WrappingMode>| match mode {
            Checked::Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
            Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
            Checked::Valid(WrappingMode::Repeat) => Wrap::Repeat,
            Checked::Invalid => {
                self.warnings.add(part, "an unknown way to wrap: pictures are repeated");
                Wrap::Repeat
            }
        };
        let (u, v) = (wrap(sampler.wrap_s), wrap(sampler.wrap_t));
        if u != v {
            self.warnings.add(part, format_args!("{u:?} of wrapS is used in both directions, not {v:?} of wrapT"));
        }
        let nearest = matches!(sampler.mag_filter, Some(Checked::Valid(MagFilter::Nearest)));
        (u, if nearest { Filter::Nearest } else { Filter::Bilinear })
    }

    /// The mean of a texture where only one colour can be used, with a warning that says what cannot vary.
    ///
    /// # Errors
    /// As [`Textures::picture`].
    pub fn mean(&mut self, reference: &Reference, purpose: Use, what: &str, user: &str) -> Result<Vec3> {
        let Some(file) = self.bitmap(reference, purpose, 1.0, user)? else { return Ok(Vec3::ONE) };
        if matches!(file, TextureFile::Bitmap { .. }) {
            self.warnings.add(user, format_args!("{what} cannot vary: the mean of its texture is used"));
        }
        Ok(Texture::new(&file, self.pictures.made())?.mean())
    }
}

/// Index of the picture of a texture that the part `user` uses, which may be a WebP picture (`EXT_texture_webp`); none where only another
/// extension gives one.
///
/// # Errors
/// [`Error::Malformed`](crate::base::Error::Malformed) for a texture or picture that is not there.
pub fn picture(document: &Document, reference: &Reference, user: &str) -> Result<Option<usize>> {
    let texture = document.at(&document.root.textures, "textures", reference.texture, user)?;
    let mut source = texture.source.value();
    if source == u32::MAX as usize {
        let webp = texture.extensions.as_ref().and_then(|all| all.others.get("EXT_texture_webp"));
        let index = webp.and_then(|webp| webp.get("source")).and_then(|source| source.as_u64());
        let Some(index) = index else { return Ok(None) };
        source = usize::try_from(index).unwrap_or(usize::MAX);
    }
    document.at(&document.root.images, "images", source, &format!("textures[{}]", reference.texture))?;
    Ok(Some(source))
}
