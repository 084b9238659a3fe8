//! Materials that are parts of a blend.

use crate::scene::file::MaterialFile;

/// A material that can be mixed: without its holes and bumps, of which `left_out` is told.
pub fn mixable(material: MaterialFile, left_out: &mut impl FnMut(&'static str)) -> MaterialFile {
    match material {
        MaterialFile::Mask { material, .. } => {
            left_out("holes of what is mixed are left out");
            mixable(*material, left_out)
        }
        MaterialFile::BumpMap { material, .. } | MaterialFile::NormalMap { material, .. } => {
            left_out("bumps of what is mixed are left out");
            mixable(*material, left_out)
        }
        MaterialFile::TwoSided { material } => match mixable(*material, left_out) {
            two_sided if two_sided.is_two_sided() => two_sided,
            material => MaterialFile::TwoSided { material: Box::new(material) },
        },
        other => other,
    }
}
