//! What a PLY file has for its vertices and faces beside their places: colours and other numbers, which only some scenes ask for.

use std::path::Path;

use glam::Vec3;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType};

use super::super::LARGEST_MESH_FILE;
use super::super::gzip::unpacked;
use super::{check_counts, explain, slot};
use crate::base::Result;
use crate::base::files::read_bytes;
use crate::math::srgb;

/// The numbers of one vertex or face, in the order of the header, and the corners of a face.
#[derive(Default)]
struct Row {
    numbers: Vec<f32>,
    corners: Vec<u32>,
}

impl PropertyAccess for Row {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if let Some(number) = property.to_f32_lossy() {
            self.numbers.push(number);
            return PropertyAccessResult::Set;
        }
        fn indices<T: TryInto<u32>>(list: Vec<T>) -> Vec<u32> {
            list.into_iter().map_while(|index| index.try_into().ok()).collect()
        }
        if matches!(name, "vertex_index" | "vertex_indices") {
            self.corners = match property {
                Property::ListChar(list) => indices(list),
                Property::ListUChar(list) => indices(list),
                Property::ListShort(list) => indices(list),
                Property::ListUShort(list) => indices(list),
                Property::ListInt(list) => indices(list),
                Property::ListUInt(list) => list,
                _ => Vec::new(),
            };
            return PropertyAccessResult::Set;
        }
        PropertyAccessResult::Ignored
    }
}

/// A named number of an element, and whether it is a byte.
struct Column {
    name: String,
    is_byte: bool,
}

/// Everything that the elements of one kind have.
#[derive(Default)]
struct Table {
    columns: Vec<Column>,
    rows: Vec<Row>,
}

/// The numbers of a file's vertices and faces.
#[derive(Default)]
pub struct Extra {
    vertices: Table,
    faces: Table,
}

/// Reads the numbers of the file at `path`.
///
/// # Errors
/// Those of [`read`](super::read).
pub fn extra(path: &Path) -> Result<Extra> {
    let bytes = unpacked(read_bytes(path, LARGEST_MESH_FILE)?, path, LARGEST_MESH_FILE)?;
    let mut reader = Reader::new(bytes.as_slice());
    let header = Parser::<Row>::new().read_header(&mut reader).map_err(|error| explain(path, &error))?;
    check_counts(path, &header, reader.get_ref().len())?;
    let mut extra = Extra::default();
    for (name, element) in &header.elements {
        let rows = Parser::<Row>::new().read_payload_for_element(&mut reader, element, &header);
        let table = Table { columns: columns(element), rows: rows.map_err(|error| explain(path, &error))? };
        match name.as_str() {
            "vertex" => extra.vertices = table,
            "face" => extra.faces = table,
            _ => {}
        }
    }
    Ok(extra)
}

fn columns(element: &ElementDef) -> Vec<Column> {
    let scalars = element.properties.iter().filter_map(|(name, property)| match &property.data_type {
        PropertyType::Scalar(scalar) => {
            Some(Column { name: name.clone(), is_byte: matches!(scalar, ScalarType::UChar | ScalarType::Char) })
        }
        PropertyType::List(..) => None,
    });
    scalars.collect()
}

impl Extra {
    /// The colour (or number, as a grey) called `name` of every vertex, or of the faces where the name begins with `face_`; none
    /// where the file has none. Bytes are taken as sRGB, other numbers as they are.
    ///
    /// `vertex_color` are the properties `r g b` or `red green blue`; others are named by what the properties have before their last
    /// underscore: `heat_0`, or `paint_r paint_g paint_b`, is `vertex_heat` or `vertex_paint_color`.
    pub fn values(&self, name: &str) -> Option<(Values, bool)> {
        let of_faces = name.starts_with("face_");
        let table = if of_faces { &self.faces } else { &self.vertices };
        let columns = table.named(name)?;
        let values = table.rows.iter().map(|row| table.value(row, &columns)).collect::<Option<Values>>()?;
        Some((values, of_faces))
    }

    /// Index of the face of each triangle that its fan is made of, and the triangle's corners.
    pub fn fans(&self) -> impl Iterator<Item = (usize, [u32; 3])> + '_ {
        self.faces.rows.iter().enumerate().flat_map(|(face, row)| {
            row.corners.windows(2).skip(1).map(move |pair| (face, [row.corners[0], pair[0], pair[1]]))
        })
    }
}

/// One colour for each vertex or face.
pub type Values = Vec<Vec3>;

impl Table {
    /// The columns of a quantity: three, or one.
    fn named(&self, name: &str) -> Option<Vec<usize>> {
        let find = |wanted: &str| self.columns.iter().position(|column| column.name == wanted);
        let bare = bare(name);
        if bare == "color" {
            for names in [["r", "g", "b"], ["red", "green", "blue"]] {
                if let [Some(r), Some(g), Some(b)] = names.map(find) {
                    return Some(vec![r, g, b]);
                }
            }
        }
        let fits = |column: &Column| {
            let prefix = column.name.rsplit_once('_').map(|(prefix, _)| prefix);
            slot(&column.name).is_none()
                && (self::bare(&column.name) == bare || prefix.is_some_and(|prefix| self::bare(prefix) == bare))
        };
        let found: Vec<usize> = (0..self.columns.len()).filter(|index| fits(&self.columns[*index])).collect();
        match found.len() {
            0 => None,
            1 | 2 => Some(found[..1].to_vec()),
            _ => Some(found[..3].to_vec()),
        }
    }

    fn value(&self, row: &Row, columns: &[usize]) -> Option<Vec3> {
        let number = |column: usize| {
            let value = row.numbers.get(column).copied().filter(|value| value.is_finite())?;
            Some(if self.columns[column].is_byte { srgb::linear(value / 255.0) } else { value })
        };
        match columns {
            [r, g, b] => Some(Vec3::new(number(*r)?, number(*g)?, number(*b)?)),
            [only] => number(*only).map(Vec3::splat),
            _ => None,
        }
    }
}

/// A quantity's name without what says where it is and that it is a colour.
fn bare(name: &str) -> &str {
    let name = name.strip_prefix("vertex_").or(name.strip_prefix("face_")).unwrap_or(name);
    match name.strip_suffix("_color") {
        Some("") | None => name,
        Some(bare) => bare,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        property uchar red\nproperty uchar green\nproperty uchar blue\nproperty float heat_0\n\
        property float paint_r\nproperty float paint_g\nproperty float paint_b\nelement face 2\n\
        property list uchar int vertex_indices\nproperty float r\nproperty float g\nproperty float b\nend_header\n\
        0 0 0 255 0 0 0.5 1 2 3\n1 0 0 0 255 0 0.25 4 5 6\n0 1 0 0 0 255 0 7 8 9\n3 0 1 2 0.1 0.2 0.3\n4 0 1 2 0 0.4 0.5 0.6\n";

    #[test]
    fn colours_and_numbers_by_name() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), FILE).unwrap();
        let extra = extra(file.path()).unwrap();
        let values = |name: &str| extra.values(name).unwrap_or_else(|| panic!("{name}"));
        assert_eq!(values("vertex_color"), (vec![Vec3::X, Vec3::Y, Vec3::Z], false));
        assert_eq!(values("vertex_heat").0[..2], [Vec3::splat(0.5), Vec3::splat(0.25)]);
        assert_eq!(values("vertex_paint_color").0[2], Vec3::new(7.0, 8.0, 9.0));
        assert_eq!(values("face_color"), (vec![Vec3::new(0.1, 0.2, 0.3), Vec3::new(0.4, 0.5, 0.6)], true));
        assert!(extra.values("vertex_x").is_none() && extra.values("face_heat").is_none());
        let fans: Vec<_> = extra.fans().collect();
        assert_eq!(fans, [(0, [0, 1, 2]), (1, [0, 1, 2]), (1, [0, 2, 0])]);
    }
}
