//! Checks of materials and textures.

use crate::base::Result;
use crate::scene::file::{MaterialFile, TextureFile};

use super::number::Checker;

/// Checks one material.
pub fn material(check: &Checker, key: &str, material_file: &MaterialFile) -> Result<()> {
    match material_file {
        MaterialFile::Diffuse { reflectance } => texture(check, &format!("{key}.reflectance"), reflectance),
        MaterialFile::Conductor { eta, k, specular_reflectance } => {
            index_of_metal(check, key, eta, k)?;
            texture(check, &format!("{key}.specular_reflectance"), specular_reflectance)
        }
        MaterialFile::RoughConductor { alpha, eta, k, specular_reflectance, .. } => {
            check.at_least(&format!("{key}.alpha"), *alpha, 0.0)?;
            index_of_metal(check, key, eta, k)?;
            texture(check, &format!("{key}.specular_reflectance"), specular_reflectance)
        }
        MaterialFile::Dielectric { int_ior, ext_ior } => {
            check.positive(&format!("{key}.int_ior"), *int_ior)?;
            check.positive(&format!("{key}.ext_ior"), *ext_ior)
        }
        MaterialFile::TwoSided { material: inner } => match **inner {
            MaterialFile::Dielectric { .. } => {
                check.fail(key, "a material that lets light through cannot be two-sided")
            }
            MaterialFile::TwoSided { .. } => check.fail(key, "a two-sided material inside another"),
            _ => material(check, &format!("{key}.material"), inner),
        },
    }
}

fn index_of_metal(check: &Checker, key: &str, eta: &[f32; 3], k: &[f32; 3]) -> Result<()> {
    check.color(&format!("{key}.eta"), eta)?;
    check.color(&format!("{key}.k"), k)
}

/// All textures so far are factors on reflected light, hence at most 1.
fn texture(check: &Checker, key: &str, texture: &TextureFile) -> Result<()> {
    match texture {
        TextureFile::Rgb { value } => check.albedo(key, value),
        TextureFile::Bitmap { to_uv, scale, .. } => {
            to_uv_matrix(check, key, to_uv)?;
            check.at_least(&format!("{key}.scale"), *scale, 0.0)
        }
        TextureFile::Checkerboard { color0, color1, to_uv } => {
            check.albedo(&format!("{key}.color0"), color0)?;
            check.albedo(&format!("{key}.color1"), color1)?;
            to_uv_matrix(check, key, to_uv)
        }
    }
}

/// No inverse is needed: a texture may well be constant along an axis.
fn to_uv_matrix(check: &Checker, key: &str, to_uv: &[f32; 9]) -> Result<()> {
    let key = format!("{key}.to_uv");
    check.finite(&key, to_uv)?;
    if to_uv[6..] != [0.0, 0.0, 1.0] {
        return check.fail(&key, "the last row of to_uv must be 0 0 1");
    }
    Ok(())
}
