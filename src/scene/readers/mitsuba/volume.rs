//! Quantities that vary in space: grids, and the means of what else there is.

use glam::DMat4;

use crate::base::Result;
use crate::scene::file::GridFile;
use crate::scene::readers::frames::rounded;
use crate::scene::readers::missing::{Absent, is_absent};
use crate::scene::readers::path;
use crate::scene::readers::spectrum::Use;
use crate::scene::readers::vol::Vol;

use super::Reader;
use super::element::Element;
use super::object::{Object, kind};
use super::upgrade::OLD_GRID;

/// Whether an element is a grid in a file.
pub(super) fn is_grid(element: &Element) -> bool {
    element.tag == "volume" && matches!(element.attribute("type"), Some("gridvolume" | OLD_GRID))
}

/// The properties of volumes. What does not change their values is the renderer's own affair.
const PROPERTIES: [&str; 11] = [
    "filename",
    "scale",
    "to_world",
    "use_grid_bbox",
    "raw",
    "filter_type",
    "wrap_mode",
    "accel",
    "max_value",
    "min",
    "max",
];

impl<'a> Reader<'a> {
    /// A colour, or the mean of the volume or texture that stands for it.
    pub(super) fn varying(&mut self, object: &Object<'a>, name: &str) -> Result<Option<[f32; 3]>> {
        match object.property(name) {
            Some(element) if element.tag == "volume" => self.volume(element).map(Some),
            _ => self.mean_color(object, name, Use::Index),
        }
    }

    /// The grid that the property `name` is.
    pub(super) fn grid(&mut self, object: &Object<'a>, name: &str) -> Result<Option<GridFile>> {
        let Some(element) = object.property(name).filter(|element| is_grid(element)) else { return Ok(None) };
        let volume = Object::new(element, &self.ids, &PROPERTIES, &[])?;
        let is_old = kind(element)? == OLD_GRID;
        for (property, known) in [("filter_type", "trilinear"), ("wrap_mode", "clamp")] {
            if let Some(other) = volume.string(property)?.filter(|value| *value != known) {
                self.warn(element, format_args!("the {property} \"{other}\" is not known: \"{known}\" is used"));
            }
        }
        let (low, high) = (volume.vector("min")?, volume.vector("max")?);
        let mut to_world = volume.transform("to_world")?.unwrap_or(DMat4::IDENTITY);
        let placed = match (low, high) {
            (Some(low), Some(high)) => {
                let extent = [0, 1, 2].map(|axis| high[axis] - low[axis]);
                to_world *= DMat4::from_translation(low.into()) * DMat4::from_scale(extent.into());
                true
            }
            _ => false,
        };
        let own_box = !placed && volume.boolean("use_grid_bbox")?.unwrap_or(is_old);
        let file = self.located(volume.required_string("filename")?);
        Ok(Some(GridFile::Vol { file, to_world: rounded(to_world), own_box, centred: is_old }))
    }

    fn volume(&mut self, element: &'a Element) -> Result<[f32; 3]> {
        let kind = kind(element)?;
        if kind == "constvolume" {
            let object = Object::new(element, &self.ids, &["value"], &[])?;
            return Ok(self.mean_color(&object, "value", Use::Index)?.unwrap_or([1.0; 3]));
        }
        let object = Object::new(element, &self.ids, &PROPERTIES, &[])?;
        if !is_grid(element) {
            self.warn(element, format_args!("the volume \"{kind}\" is not known: the constant 1 is used"));
            return Ok([1.0; 3]);
        }
        let file = self.located(object.required_string("filename")?);
        if is_absent(&self.folder, &file) {
            self.absent.push(Absent::volume(&file, element.place.clone()));
            return Ok([1.0; 3]);
        }
        let path = path::resolve(&self.folder, &file, &element.place)?;
        self.warn(element, "a grid: the mean of its values is used everywhere");
        Ok(Vol::read(&path)?.mean().map(|x| x.max(0.0)))
    }
}
