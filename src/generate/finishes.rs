//! Materials of furnished rooms: what a scene has of wood, stone, cloth and paint, as pictures that several materials share.

use super::build::{Builder, diffuse};
use super::draw::Draw;
use super::pictures;
use crate::scene::file::{Filter, MaterialFile, PrincipledFile, PrincipledThinFile, TextureFile, Wrap};

/// Pictures of one scene.
#[derive(Debug, Clone)]
pub struct Finishes {
    pigments: Vec<String>,
    numbers: String,
    reliefs: Vec<String>,
}

fn two_sided(material: MaterialFile) -> MaterialFile {
    MaterialFile::TwoSided { material: Box::new(material) }
}

fn grey(value: f32) -> TextureFile {
    TextureFile::rgb([value; 3])
}

impl Finishes {
    /// Draws three to five pictures of colours, one of numbers and two reliefs.
    pub fn new(draw: &mut Draw, builder: &mut Builder) -> Self {
        let count = draw.integer(3, 5);
        let pigments =
            (0..count).map(|i| builder.add_picture(&format!("pigment-{i}"), pictures::pigment(draw))).collect();
        let numbers = builder.add_picture("numbers", pictures::numbers(draw));
        let reliefs = (0..2).map(|i| builder.add_picture(&format!("relief-{i}"), pictures::normals(draw))).collect();
        Self { pigments, numbers, reliefs }
    }

    /// One of the pictures, a few times over the unit of texture coordinates.
    fn bitmap(draw: &mut Draw, files: &[String], raw: bool) -> TextureFile {
        let file = files[draw.integer(0, files.len() as u32 - 1) as usize].clone();
        let [u, v] = [0, 1].map(|_| draw.log_range(0.7, 5.0));
        let to_uv = [u, 0.0, 0.0, 0.0, v, 0.0, 0.0, 0.0, 1.0];
        TextureFile::Bitmap { file, to_uv, raw, scale: 1.0, wrap: Wrap::Repeat, filter: Filter::Bilinear }
    }

    /// A picture, or one colour.
    fn pigment(&self, draw: &mut Draw) -> TextureFile {
        if draw.chance(0.6) { Self::bitmap(draw, &self.pigments, false) } else { TextureFile::rgb(draw.albedo()) }
    }

    /// Paint or paper: diffuse, bright in most scenes, with a pattern in some.
    pub fn wall(&self, draw: &mut Draw, builder: &mut Builder) -> String {
        let material = if draw.chance(0.65) {
            let value = draw.range(0.45, 0.88);
            let tint = draw.tint();
            diffuse(tint.map(|t| (value * (0.8 + 0.2 * t)).min(0.9)))
        } else {
            let material = two_sided(MaterialFile::Diffuse { reflectance: self.pigment(draw) });
            self.relief(draw, material, 0.3)
        };
        builder.add_material("wall", material)
    }

    /// Boards, tiles, stone or carpet; more often than not polished.
    pub fn floor(&self, draw: &mut Draw, builder: &mut Builder) -> String {
        let material = match draw.range(0.0, 1.0) {
            share if share < 0.35 => two_sided(MaterialFile::Diffuse { reflectance: self.pigment(draw) }),
            share if share < 0.75 => self.varnished(draw),
            _ => self.worn(draw),
        };
        let material = self.relief(draw, material, 0.3);
        builder.add_material("floor", material)
    }

    /// Furniture and solid things: varnished, painted, worn, metal.
    pub fn furniture(&self, draw: &mut Draw, builder: &mut Builder) -> String {
        let material = match draw.range(0.0, 1.0) {
            share if share < 0.3 => two_sided(MaterialFile::Diffuse { reflectance: self.pigment(draw) }),
            share if share < 0.6 => self.varnished(draw),
            share if share < 0.85 => self.worn(draw),
            _ => draw.metal(0.1),
        };
        let material = self.relief(draw, material, 0.2);
        builder.add_material("furniture", material)
    }

    /// Cloth of covers and cushions.
    pub fn cloth(&self, draw: &mut Draw, builder: &mut Builder) -> String {
        let reflectance = self.pigment(draw);
        let material = if draw.chance(0.5) {
            MaterialFile::RoughDiffuse { reflectance, alpha: draw.range(0.2, 0.9), qualitative: false }
        } else {
            MaterialFile::Diffuse { reflectance }
        };
        let material = self.relief(draw, two_sided(material), 0.3);
        builder.add_material("cloth", material)
    }

    /// Thin cloth or paper that lets part of the light through.
    pub fn translucent(&self, draw: &mut Draw, builder: &mut Builder) -> String {
        let value = draw.range(0.5, 0.95);
        let material = MaterialFile::PrincipledThin(PrincipledThinFile {
            base_color: if draw.chance(0.3) {
                self.pigment(draw)
            } else {
                TextureFile::rgb(draw.tint().map(|t| (value * t).min(0.95)))
            },
            roughness: grey(draw.range(0.4, 1.0)),
            spec_trans: grey(0.0),
            diff_trans: grey(draw.range(0.15, 0.8)),
            eta: 1.5,
            spec_tint: 0.0,
            sheen: if draw.chance(0.5) { draw.range(0.0, 1.0) } else { 0.0 },
            sheen_tint: 0.5,
            flatness: 0.0,
        });
        builder.add_material("translucent", material)
    }

    /// A coat over a picture, smooth or slightly rough.
    fn varnished(&self, draw: &mut Draw) -> MaterialFile {
        let MaterialFile::TwoSided { material } = draw.plastic(0.0) else { return draw.diffuse() };
        let MaterialFile::Plastic { distribution, int_ior, specular_reflectance, nonlinear, .. } = *material else {
            return draw.diffuse();
        };
        two_sided(MaterialFile::Plastic {
            alpha: if draw.chance(0.3) { 0.0 } else { draw.log_range(0.03, 0.3) },
            distribution,
            int_ior,
            ext_ior: 1.0,
            diffuse_reflectance: self.pigment(draw),
            specular_reflectance,
            nonlinear,
        })
    }

    /// A principled material whose colour and roughness, sometimes also its metal, are pictures.
    fn worn(&self, draw: &mut Draw) -> MaterialFile {
        let files = std::slice::from_ref(&self.numbers);
        let roughness = if draw.chance(0.7) { Self::bitmap(draw, files, true) } else { grey(draw.range(0.1, 0.9)) };
        let metallic = match draw.range(0.0, 1.0) {
            share if share < 0.7 => grey(0.0),
            share if share < 0.85 => grey(1.0),
            _ => Self::bitmap(draw, files, true),
        };
        two_sided(MaterialFile::Principled(PrincipledFile {
            base_color: self.pigment(draw),
            roughness,
            metallic,
            eta: draw.range(1.3, 1.7),
            spec_tint: 0.0,
            sheen: 0.0,
            sheen_tint: 0.0,
            clearcoat: if draw.chance(0.3) { draw.range(0.3, 1.0) } else { 0.0 },
            clearcoat_gloss: draw.range(0.3, 1.0),
            flatness: 0.0,
            spec_trans: 0.0,
        }))
    }

    /// The material with a relief with probability `p`.
    fn relief(&self, draw: &mut Draw, material: MaterialFile, p: f32) -> MaterialFile {
        if !draw.chance(p) {
            return material;
        }
        let texture = Self::bitmap(draw, &self.reliefs, true);
        match material {
            MaterialFile::TwoSided { material } => two_sided(MaterialFile::NormalMap { texture, material }),
            other => other,
        }
    }
}
