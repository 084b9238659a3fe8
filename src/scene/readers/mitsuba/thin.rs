//! The thin principled material (Burley 2015, §5.3) by materials that there are.

use crate::base::Result;
use crate::scene::file::{MaterialFile, PrincipledFile, TextureFile};

use super::Reader;
use super::element::Element;
use super::material::index;
use super::object::Object;

const PROPERTIES: [&str; 13] = [
    "base_color",
    "roughness",
    "anisotropic",
    "spec_trans",
    "eta",
    "spec_tint",
    "sheen",
    "sheen_tint",
    "flatness",
    "diff_trans",
    // The way in which lobes are sampled does not change their values.
    "diffuse_reflectance_sampling_rate",
    "specular_reflectance_sampling_rate",
    "specular_transmittance_sampling_rate",
];

impl<'a> Reader<'a> {
    /// A sheet: a principled surface on both sides, mixed by `spec_trans` with a pane of glass of its colour. Light that would be
    /// scattered through the sheet is scattered back instead, and the pane is smooth.
    pub(super) fn principled_thin(&mut self, element: &'a Element) -> Result<MaterialFile> {
        let object = Object::new(element, &self.ids, &PROPERTIES, &[])?;
        self.warn(
            element,
            "principledthin is read as a principled surface and a smooth pane: nothing is scattered through it",
        );
        let [spec_tint, sheen] = [self.amount(&object, "spec_tint")?, self.amount(&object, "sheen")?];
        let [sheen_tint, flatness] = [self.amount(&object, "sheen_tint")?, self.amount(&object, "flatness")?];
        let base_color = self.texture(&object, "base_color", 0.5)?;
        let eta = if object.property("eta").is_some() { index(&object, "eta", "bk7")? } else { 1.5 };
        let surface = MaterialFile::TwoSided {
            material: Box::new(MaterialFile::Principled(PrincipledFile {
                base_color: base_color.clone(),
                roughness: self.texture(&object, "roughness", 0.5)?,
                metallic: TextureFile::rgb([0.0; 3]),
                eta,
                spec_tint,
                sheen,
                sheen_tint,
                clearcoat: 0.0,
                clearcoat_gloss: 0.0,
                flatness,
                spec_trans: 0.0,
            })),
        };
        let weight = self.texture(&object, "spec_trans", 0.0)?;
        if weight == TextureFile::rgb([0.0; 3]) {
            return Ok(surface);
        }
        let pane = MaterialFile::ThinDielectric { int_ior: eta, ext_ior: 1.0 };
        let pane = pane.tinted(TextureFile::rgb([1.0; 3]), base_color);
        Ok(MaterialFile::Blend { weight, materials: Box::new([surface, pane]) })
    }
}
