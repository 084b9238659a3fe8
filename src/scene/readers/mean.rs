//! Means of textures, where only one value can be used.

use std::collections::BTreeMap;
use std::path::Path;

use crate::base::{Place, Result};
use crate::picture::{Texels, read_texels};
use crate::scene::file::TextureFile;

use super::missing::{self, Absent};
use super::{image_key, path};

/// The mean colour of the texture that is named at `place`. A picture is taken from those that are `ready`, by [`image_key`], or
/// read; one that is not there counts as grey and is added to `absent`.
///
/// # Errors
/// Those of reading a picture.
pub(super) fn mean(
    texture: &TextureFile,
    folder: &Path,
    place: &Place,
    ready: &BTreeMap<String, Texels>,
    absent: &mut Vec<Absent>,
) -> Result<[f32; 3]> {
    Ok(match texture {
        TextureFile::Rgb { value } => *value,
        // What a mesh has is not known here.
        TextureFile::Attribute { scale, .. } => [missing::GREY * *scale; 3],
        TextureFile::Checkerboard { color0, color1, .. } => [0, 1, 2].map(|i| (color0[i] + color1[i]) / 2.0),
        TextureFile::Bitmap { file, raw, scale, .. } => {
            if let Some(texels) = ready.get(&image_key(file, *raw)) {
                return Ok((texels.mean() * *scale).to_array());
            }
            if missing::is_absent(folder, file) {
                let color = [missing::GREY * *scale; 3];
                absent.push(Absent::picture(file, place.clone(), color));
                return Ok(color);
            }
            let texels = read_texels(&path::resolve(folder, file, place)?, *raw)?;
            (texels.mean() * *scale).to_array()
        }
    })
}
