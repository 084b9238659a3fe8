//! Checks of materials and textures.

use crate::base::Result;
use crate::scene::file::{ASPECTS, MaterialFile, PrincipledFile, PrincipledThinFile, TextureFile};

use super::number::Checker;

/// Checks one material.
pub fn material(check: &Checker, key: &str, material_file: &MaterialFile) -> Result<()> {
    wrapped(check, key, material_file, [false; 2])?;
    values(check, key, material_file)
}

fn values(check: &Checker, key: &str, material_file: &MaterialFile) -> Result<()> {
    match material_file {
        MaterialFile::TwoSided { material } => return values(check, &format!("{key}.material"), material),
        MaterialFile::Mask { opacity, material } => {
            texture(check, &format!("{key}.opacity"), opacity)?;
            return values(check, &format!("{key}.material"), material);
        }
        MaterialFile::Tinted { specular_reflectance, specular_transmittance, material } => {
            texture(check, &format!("{key}.specular_reflectance"), specular_reflectance)?;
            texture(check, &format!("{key}.specular_transmittance"), specular_transmittance)?;
            return values(check, &format!("{key}.material"), material);
        }
        MaterialFile::BumpMap { texture: map, scale, material } => {
            check.finite(&format!("{key}.scale"), &[*scale])?;
            texture(check, &format!("{key}.texture"), map)?;
            return values(check, &format!("{key}.material"), material);
        }
        MaterialFile::NormalMap { texture: map, material } | MaterialFile::RoughnessMap { texture: map, material } => {
            texture(check, &format!("{key}.texture"), map)?;
            return values(check, &format!("{key}.material"), material);
        }
        MaterialFile::Anisotropic { aspect, rotation, material } => {
            let [least, most] = ASPECTS;
            if !(least..=most).contains(aspect) {
                let what = format!("the aspect is {aspect}, expected one from {least} to {most}");
                return check.fail(&format!("{key}.aspect"), what);
            }
            check.finite(&format!("{key}.rotation"), &[*rotation])?;
            return values(check, &format!("{key}.material"), material);
        }
        MaterialFile::Blend { weight, materials } => {
            texture(check, &format!("{key}.weight"), weight)?;
            let mut parts = materials.iter().enumerate();
            return parts.try_for_each(|(i, part)| values(check, &format!("{key}.materials[{i}]"), part));
        }
        _ => {}
    }
    for (name, file) in material_file.textures() {
        texture(check, &format!("{key}.{name}"), file)?;
    }
    match material_file {
        MaterialFile::RoughDiffuse { alpha, .. } => check.at_least(&format!("{key}.alpha"), *alpha, 0.0),
        MaterialFile::Conductor { eta, k, .. } => index_of_metal(check, key, eta, k),
        MaterialFile::RoughConductor { alpha, eta, k, .. } => {
            check.at_least(&format!("{key}.alpha"), *alpha, 0.0)?;
            index_of_metal(check, key, eta, k)
        }
        MaterialFile::Dielectric { int_ior, ext_ior } | MaterialFile::ThinDielectric { int_ior, ext_ior } => {
            interface(check, key, 0.0, *int_ior, *ext_ior)
        }
        MaterialFile::RoughDielectric { alpha, int_ior, ext_ior, .. }
        | MaterialFile::Plastic { alpha, int_ior, ext_ior, .. } => interface(check, key, *alpha, *int_ior, *ext_ior),
        MaterialFile::Principled(file) => principled(check, key, file),
        MaterialFile::PrincipledThin(file) => principled_thin(check, key, file),
        MaterialFile::Null {}
        | MaterialFile::Diffuse { .. }
        | MaterialFile::Translucent { .. }
        | MaterialFile::Blend { .. }
        | MaterialFile::BumpMap { .. }
        | MaterialFile::NormalMap { .. }
        | MaterialFile::RoughnessMap { .. }
        | MaterialFile::Anisotropic { .. }
        | MaterialFile::TwoSided { .. }
        | MaterialFile::Mask { .. }
        | MaterialFile::Tinted { .. } => Ok(()),
    }
}

/// Checks how materials are nested: two sides and holes, each at most once.
fn wrapped(check: &Checker, key: &str, file: &MaterialFile, [two_sided, masked]: [bool; 2]) -> Result<()> {
    match file {
        MaterialFile::TwoSided { material } if !two_sided => wrapped(check, key, material, [true, masked]),
        MaterialFile::Mask { material, .. } if !masked => wrapped(check, key, material, [two_sided, true]),
        MaterialFile::BumpMap { material, .. } | MaterialFile::NormalMap { material, .. } if !material.is_bumped() => {
            wrapped(check, key, material, [two_sided, masked])
        }
        MaterialFile::RoughnessMap { material, .. } if material.has_facets() => {
            wrapped(check, key, material, [two_sided, masked])
        }
        MaterialFile::Anisotropic { material, .. } if material.can_have_grain() => {
            wrapped(check, key, material, [two_sided, masked])
        }
        MaterialFile::Anisotropic { .. } => {
            check.fail(key, "only a rough metal, rough glass or principled material has facets with a grain")
        }
        MaterialFile::RoughnessMap { .. } => {
            check.fail(key, "only a rough metal, rough glass or rough plastic has a roughness that varies")
        }
        MaterialFile::BumpMap { .. } | MaterialFile::NormalMap { .. } => {
            check.fail(key, "a bump or normal map inside another")
        }
        MaterialFile::TwoSided { .. } | MaterialFile::Mask { .. } => {
            check.fail(key, "a two-sided or masked material inside another of its kind")
        }
        MaterialFile::Blend { materials, .. } => {
            let key = format!("{key}.materials");
            materials.iter().try_for_each(|part| match part {
                part if part.is_masked() || part.is_bumped() => {
                    check.fail(&key, "a material with a mask, bump or normal map cannot be blended")
                }
                part => wrapped(check, &key, part, [two_sided, masked]),
            })
        }
        MaterialFile::Principled(file) if two_sided && file.spec_trans > 0.0 => {
            check.fail(key, "a material that lets light through cannot be two-sided")
        }
        MaterialFile::Tinted { material, .. }
            if !matches!(
                **material,
                MaterialFile::Dielectric { .. }
                    | MaterialFile::ThinDielectric { .. }
                    | MaterialFile::RoughDielectric { .. }
            ) =>
        {
            check.fail(key, "only a dielectric can be tinted")
        }
        MaterialFile::Null {} if masked => check.fail(key, "the border of a medium cannot have holes"),
        MaterialFile::Null {}
        | MaterialFile::Dielectric { .. }
        | MaterialFile::ThinDielectric { .. }
        | MaterialFile::RoughDielectric { .. }
        | MaterialFile::PrincipledThin(_)
        | MaterialFile::Translucent { .. }
        | MaterialFile::Tinted { .. }
            if two_sided =>
        {
            check.fail(key, "a material that lets light through cannot be two-sided")
        }
        _ => Ok(()),
    }
}

fn principled(check: &Checker, key: &str, file: &PrincipledFile) -> Result<()> {
    check.at_least(&format!("{key}.eta"), file.eta, 1.0)?;
    for (name, value) in [
        ("spec_tint", file.spec_tint),
        ("sheen", file.sheen),
        ("sheen_tint", file.sheen_tint),
        ("clearcoat", file.clearcoat),
        ("clearcoat_gloss", file.clearcoat_gloss),
        ("flatness", file.flatness),
        ("spec_trans", file.spec_trans),
    ] {
        check.albedo(&format!("{key}.{name}"), &[value; 3])?;
    }
    Ok(())
}

fn principled_thin(check: &Checker, key: &str, file: &PrincipledThinFile) -> Result<()> {
    let PrincipledThinFile { spec_tint, sheen, sheen_tint, flatness, .. } = *file;
    check.at_least(&format!("{key}.eta"), file.eta, 1.0)?;
    let numbers = [("spec_tint", spec_tint), ("sheen", sheen), ("sheen_tint", sheen_tint), ("flatness", flatness)];
    numbers.into_iter().try_for_each(|(name, value)| check.albedo(&format!("{key}.{name}"), &[value; 3]))
}

fn interface(check: &Checker, key: &str, alpha: f32, int_ior: f32, ext_ior: f32) -> Result<()> {
    check.at_least(&format!("{key}.alpha"), alpha, 0.0)?;
    check.positive(&format!("{key}.int_ior"), int_ior)?;
    check.positive(&format!("{key}.ext_ior"), ext_ior)
}

fn index_of_metal(check: &Checker, key: &str, eta: &[f32; 3], k: &[f32; 3]) -> Result<()> {
    // Colours that were fitted to spectra may be negative, and only squares count.
    check.finite(&format!("{key}.eta"), eta)?;
    check.finite(&format!("{key}.k"), k)
}

/// Checks a texture of emitted light.
pub fn emission(check: &Checker, key: &str, file: &TextureFile) -> Result<()> {
    match file {
        TextureFile::Rgb { value } => check.color(key, value),
        TextureFile::Checkerboard { color0, color1, to_uv } => {
            check.color(&format!("{key}.color0"), color0)?;
            check.color(&format!("{key}.color1"), color1)?;
            to_uv_matrix(check, key, to_uv)
        }
        other => texture(check, key, other),
    }
}

/// Checks a texture of a material: a factor on reflected light, hence at most 1. Of brighter pictures there is a warning
/// once they are read.
fn texture(check: &Checker, key: &str, texture: &TextureFile) -> Result<()> {
    match texture {
        TextureFile::Rgb { value } => check.albedo(key, value),
        TextureFile::Attribute { scale, .. } => check.at_least(&format!("{key}.scale"), *scale, 0.0),
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

/// Checks a texture transform. No inverse is needed: a texture may well be constant along an axis.
fn to_uv_matrix(check: &Checker, key: &str, to_uv: &[f32; 9]) -> Result<()> {
    let key = format!("{key}.to_uv");
    check.finite(&key, to_uv)?;
    if to_uv[6..] != [0.0, 0.0, 1.0] {
        return check.fail(&key, "the last row of to_uv must be 0 0 1");
    }
    Ok(())
}
