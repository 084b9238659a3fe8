//! Random materials, from chalk to mirrors and glass.

use super::build::{Builder, diffuse, glass};
use super::draw::Draw;
use crate::scene::file::{Distribution, MaterialFile, PrincipledFile, TextureFile};

/// Refractive index and extinction of aluminium, copper and gold at red, green and blue.
const METALS: [[[f32; 3]; 2]; 3] = [
    [[1.6575, 0.8804, 0.5212], [9.2238, 6.2695, 4.8370]],
    [[0.2010, 0.9238, 1.1022], [3.9133, 2.4531, 2.1421]],
    [[0.1430, 0.3753, 1.4420], [3.9830, 2.3856, 1.6034]],
];

fn two_sided(material: MaterialFile) -> MaterialFile {
    MaterialFile::TwoSided { material: Box::new(material) }
}

impl Draw {
    /// A diffuse material of one colour.
    pub fn diffuse(&mut self) -> MaterialFile {
        diffuse(self.albedo())
    }

    /// A checkerboard with 2 to 24 squares along the unit of texture coordinates.
    pub fn checkerboard(&mut self) -> TextureFile {
        let [u, v] = [0, 1].map(|_| self.log_range(1.0, 12.0));
        let to_uv = [u, 0.0, 0.0, 0.0, v, 0.0, 0.0, 0.0, 1.0];
        TextureFile::Checkerboard { color0: self.albedo(), color1: self.albedo(), to_uv }
    }

    /// One colour, or with probability `checkered` a checkerboard.
    fn pigment(&mut self, checkered: f32) -> TextureFile {
        if self.chance(checkered) { self.checkerboard() } else { TextureFile::rgb(self.albedo()) }
    }

    fn distribution(&mut self) -> Distribution {
        if self.chance(0.5) { Distribution::Ggx } else { Distribution::Beckmann }
    }

    /// A metal, smooth with probability `smooth`, else of log-uniform roughness; on both sides.
    pub fn metal(&mut self, smooth: f32) -> MaterialFile {
        let [eta, k] = METALS[self.integer(0, 2) as usize];
        let specular_reflectance = TextureFile::rgb([1.0; 3]);
        if self.chance(smooth) {
            return two_sided(MaterialFile::Conductor { eta, k, specular_reflectance });
        }
        let (alpha, distribution) = (self.log_range(0.02, 0.7), self.distribution());
        two_sided(MaterialFile::RoughConductor { alpha, distribution, eta, k, specular_reflectance })
    }

    /// A mirror of aluminium, sometimes tinted; on both sides.
    pub fn mirror(&mut self) -> MaterialFile {
        let [eta, k] = METALS[0];
        let color = if self.chance(0.7) { [1.0; 3] } else { self.albedo() };
        two_sided(MaterialFile::Conductor { eta, k, specular_reflectance: TextureFile::rgb(color) })
    }

    /// Glass or another clear solid.
    pub fn glass(&mut self) -> MaterialFile {
        glass(self.range(1.25, 1.9))
    }

    /// A clear solid with a ground surface.
    pub fn rough_glass(&mut self) -> MaterialFile {
        let (alpha, distribution) = (self.log_range(0.03, 0.6), self.distribution());
        MaterialFile::RoughDielectric { alpha, distribution, int_ior: self.range(1.25, 1.9), ext_ior: 1.0 }
    }

    /// A coat, smooth in a quarter of all cases, over a diffuse base that is a checkerboard with probability `checkered`; on both
    /// sides.
    pub fn plastic(&mut self, checkered: f32) -> MaterialFile {
        let alpha = if self.chance(0.25) { 0.0 } else { self.log_range(0.03, 0.5) };
        two_sided(MaterialFile::Plastic {
            alpha,
            distribution: self.distribution(),
            int_ior: self.range(1.3, 1.8),
            ext_ior: 1.0,
            diffuse_reflectance: self.pigment(checkered),
            specular_reflectance: TextureFile::rgb([1.0; 3]),
            nonlinear: self.chance(0.5),
        })
    }

    /// A principled material that lets no light through, often part metal, cloth or coated; on both sides.
    pub fn principled(&mut self, checkered: f32) -> MaterialFile {
        let grey = |value: f32| TextureFile::rgb([value; 3]);
        let sometimes = |draw: &mut Self, p: f32| if draw.chance(p) { draw.range(0.0, 1.0) } else { 0.0 };
        two_sided(MaterialFile::Principled(PrincipledFile {
            base_color: self.pigment(checkered),
            roughness: grey(self.range(0.1, 1.0)),
            metallic: grey(sometimes(self, 0.3)),
            eta: self.range(1.3, 1.8),
            spec_tint: sometimes(self, 0.3),
            sheen: sometimes(self, 0.3),
            sheen_tint: sometimes(self, 0.3),
            clearcoat: sometimes(self, 0.3),
            clearcoat_gloss: self.range(0.0, 1.0),
            flatness: sometimes(self, 0.2),
            spec_trans: 0.0,
        }))
    }

    /// Walls and other large surfaces: mostly diffuse, some checkered, some glossy.
    pub fn surface(&mut self, builder: &mut Builder, name: &str) -> String {
        let material = match self.range(0.0, 1.0) {
            share if share < 0.7 => self.diffuse(),
            share if share < 0.82 => two_sided(MaterialFile::Diffuse { reflectance: self.checkerboard() }),
            share if share < 0.9 => self.plastic(0.2),
            share if share < 0.96 => self.principled(0.2),
            _ => self.metal(0.1),
        };
        builder.add_material(name, material)
    }

    /// A floor: glossy or checkered more often than walls are.
    pub fn floor(&mut self, builder: &mut Builder) -> String {
        let material = match self.range(0.0, 1.0) {
            share if share < 0.5 => self.diffuse(),
            share if share < 0.65 => two_sided(MaterialFile::Diffuse { reflectance: self.checkerboard() }),
            share if share < 0.85 => self.plastic(0.4),
            share if share < 0.95 => self.principled(0.4),
            _ => self.metal(0.1),
        };
        builder.add_material("floor", material)
    }

    /// Any material for clutter: half of it diffuse. `closed` tells whether the shape may be glass.
    pub fn clutter(&mut self, builder: &mut Builder, closed: bool) -> String {
        let share = self.range(0.0, if closed { 1.0 } else { 0.86 });
        let (name, material) = match share {
            share if share < 0.5 => ("diffuse", self.diffuse()),
            share if share < 0.6 => ("plastic", self.plastic(0.2)),
            share if share < 0.68 => ("principled", self.principled(0.2)),
            share if share < 0.82 => ("metal", self.metal(0.15)),
            share if share < 0.86 => ("mirror", self.mirror()),
            share if share < 0.95 => ("glass", self.glass()),
            _ => ("frosted glass", self.rough_glass()),
        };
        builder.add_material(name, material)
    }
}
