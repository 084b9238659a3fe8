//! Conversion of a scene file's texture to one that can be evaluated. It is here because materials know nothing of scene files.

use std::collections::BTreeMap;

use glam::{Affine2, Mat2, Vec2, Vec3};

use crate::base::{Error, Result};
use crate::materials::texture::{Texture, Wrap};
use crate::picture::Texels;
use crate::scene::file::{Filter, TextureFile, Wrap as WrapFile};

/// The key of a picture in [`LoadedScene::images`](super::LoadedScene::images): its `file`, marked where it is read as raw
/// data, because that gives other values.
pub fn image_key(file: &str, raw: bool) -> String {
    if raw { format!("{file} (raw)") } else { file.to_owned() }
}

impl Texture {
    /// The texture that `file` describes, with the pictures of its loaded scene.
    ///
    /// # Errors
    /// [`Error::Options`] if `images` lacks the picture; loading puts every picture there.
    pub fn new(file: &TextureFile, images: &BTreeMap<String, Texels>) -> Result<Self> {
        Ok(match file {
            TextureFile::Rgb { value } => Self::Constant(Vec3::from_array(*value)),
            TextureFile::Bitmap { file, to_uv, raw, scale, wrap, filter } => {
                let image = images.get(&image_key(file, *raw));
                let image = image.ok_or_else(|| Error::Options(format!("the picture \"{file}\" was not loaded")))?;
                Self::Bitmap {
                    image: image.clone(),
                    to_uv: affine(to_uv),
                    scale: *scale,
                    wrap: match wrap {
                        WrapFile::Repeat => Wrap::Repeat,
                        WrapFile::Mirror => Wrap::Mirror,
                        WrapFile::Clamp => Wrap::Clamp,
                    },
                    nearest: *filter == Filter::Nearest,
                }
            }
            // Where there are colours they have become a picture before; see `paint`.
            TextureFile::Attribute { scale, .. } => Self::Constant(Vec3::splat(0.5 * *scale)),
            TextureFile::Checkerboard { color0, color1, to_uv } => Self::Checkerboard {
                color0: Vec3::from_array(*color0),
                color1: Vec3::from_array(*color1),
                to_uv: affine(to_uv),
            },
        })
    }
}

/// Whether a texture is the same everywhere.
pub(super) fn is_even(texture: &TextureFile) -> bool {
    matches!(texture, TextureFile::Rgb { .. } | TextureFile::Attribute { .. })
}

/// The texture with both coordinates turned around: what it was at (u, v) it is at (1 − u, 1 − v).
pub(super) fn turned(texture: TextureFile) -> TextureFile {
    placed(texture, [-1.0, 0.0, 1.0, 0.0, -1.0, 1.0])
}

/// The texture with its first coordinate turned around.
pub(super) fn mirrored(texture: TextureFile) -> TextureFile {
    placed(texture, [-1.0, 0.0, 1.0, 0.0, 1.0, 0.0])
}

/// The texture with its second coordinate turned around.
pub(super) fn upside_down(texture: TextureFile) -> TextureFile {
    placed(texture, [1.0, 0.0, 0.0, 0.0, -1.0, 1.0])
}

/// The texture at coordinates that `first`, two rows of three, makes of the given ones.
fn placed(mut texture: TextureFile, first: [f32; 6]) -> TextureFile {
    if let TextureFile::Bitmap { to_uv, .. } | TextureFile::Checkerboard { to_uv, .. } = &mut texture {
        let [a, b, c, d, e, f] = first;
        for row in 0..2 {
            let [x, y, z] = [to_uv[3 * row], to_uv[3 * row + 1], to_uv[3 * row + 2]];
            to_uv[3 * row..3 * row + 3].copy_from_slice(&[x * a + y * d, x * b + y * e, x * c + y * f + z]);
        }
    }
    texture
}

fn affine(m: &[f32; 9]) -> Affine2 {
    Affine2::from_mat2_translation(Mat2::from_cols_array(&[m[0], m[3], m[1], m[4]]), Vec2::new(m[2], m[5]))
}
