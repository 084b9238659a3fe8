//! PLY, text or binary: the usual layouts by our own code, others by the crate `ply-rs-bw`.

mod binary;
pub mod extra;
mod text;

use std::path::Path;

use glam::{Vec2, Vec3};
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};

use crate::base::files::read_bytes;
use crate::base::{Error, Place, Result};
use crate::geometry::mesh::Mesh;

use super::gzip::unpacked;
use super::{BYTES_PER_TRIANGLE, LARGEST_MESH_FILE, MOST_ELEMENTS};

/// Reads a PLY file, which gzip may have packed; polygons become fans of triangles. Texture coordinates are called `u v`, `s t`, `texture_u texture_v` or
/// `texture_s texture_t`.
///
/// # Errors
/// [`Error::Io`], [`Error::Limit`], [`Error::Malformed`] naming the file and, where known, the line.
pub fn read(path: &Path) -> Result<Mesh> {
    read_up_to(path, MOST_ELEMENTS)
}

/// As [`read`], of a file with at most `most` triangles.
fn read_up_to(path: &Path, most: u64) -> Result<Mesh> {
    let bytes = unpacked(read_bytes(path, LARGEST_MESH_FILE)?, path, LARGEST_MESH_FILE)?;
    let mut reader = Reader::new(bytes.as_slice());
    let fail = |error: ParseError| explain(path, &error);
    let header = Parser::<Ignored>::new().read_header(&mut reader).map_err(fail)?;
    check_counts(path, &header, reader.get_ref().len())?;
    if let Some(layout) = binary::Layout::of(&header) {
        return layout.read(path, reader.get_ref(), most);
    }
    if let Some(layout) = text::Layout::of(&header) {
        if reader.get_ref().len() as u64 / BYTES_PER_TRIANGLE > most {
            check_triangles(path, layout.triangles(reader.get_ref()), most)?;
        }
        // Where this fails, the library finds out what is wrong with a text, and where.
        if let Some(mesh) = layout.read(reader.get_ref()) {
            return Ok(mesh);
        }
    }
    let (mut vertices, mut faces): (Vec<Vertex>, Vec<Face>) = (Vec::new(), Vec::new());
    for (name, element) in &header.elements {
        match name.as_str() {
            "vertex" => {
                vertices = Parser::new().read_payload_for_element(&mut reader, element, &header).map_err(fail)?
            }
            "face" => faces = Parser::new().read_payload_for_element(&mut reader, element, &header).map_err(fail)?,
            _ => drop(Parser::<Ignored>::new().read_payload_for_element(&mut reader, element, &header).map_err(fail)?),
        }
    }
    build(path, &header, &vertices, &faces, most)
}

/// Refuses a mesh of more than `most` triangles.
fn check_triangles(path: &Path, count: u64, most: u64) -> Result<()> {
    if count <= most {
        return Ok(());
    }
    let what = "number of triangles".to_owned();
    Err(Error::Limit { place: Place::file(path), what, value: count, limit: most })
}

fn explain(path: &Path, error: &ParseError) -> Error {
    let place = match error.line().and_then(|line| u32::try_from(line).ok()) {
        Some(line) => Place::line(path, line),
        None => Place::file(path),
    };
    Error::malformed(place, format!("not a readable PLY file: {error}"))
}

/// Checks that the body is long enough for the counts in the header, before anything is allocated by them.
fn check_counts(path: &Path, header: &Header, body: usize) -> Result<()> {
    let mut least = 0u64;
    for (name, element) in &header.elements {
        let count = element.count as u64;
        if count > MOST_ELEMENTS {
            let (place, what) = (Place::part(path, name), format!("number of {name} elements"));
            return Err(Error::Limit { place, what, value: count, limit: MOST_ELEMENTS });
        }
        least += count * smallest_size(element, header.encoding);
    }
    // The last line of a text may lack its end.
    if least > body as u64 + 1 {
        let message = format!("the header promises at least {least} bytes, but only {body} follow");
        return Err(Error::malformed(Place::file(path), message));
    }
    Ok(())
}

/// Fewest bytes that one element can take; never 0, or the count would be free.
fn smallest_size(element: &ElementDef, encoding: Encoding) -> u64 {
    let of = |property: &PropertyType| match (encoding, property) {
        (Encoding::Ascii, _) => 2,
        (_, PropertyType::Scalar(scalar) | PropertyType::List(scalar, _)) => scalar_size(scalar),
    };
    element.properties.iter().map(|(_, property)| of(&property.data_type)).sum::<u64>().max(1)
}

/// Index of a property among x, y, z, nx, ny, nz, u and v.
fn slot(name: &str) -> Option<usize> {
    match name {
        "x" => Some(0),
        "y" => Some(1),
        "z" => Some(2),
        "nx" => Some(3),
        "ny" => Some(4),
        "nz" => Some(5),
        "u" | "s" | "texture_u" | "texture_s" => Some(6),
        "v" | "t" | "texture_v" | "texture_t" => Some(7),
        _ => None,
    }
}

/// Vertices, faces and the type of the only property of faces, a list of indices; none for files in another layout.
fn usual(header: &Header) -> Option<(&ElementDef, &ElementDef, &PropertyType)> {
    let elements: Vec<(&str, &ElementDef)> = header.elements.iter().map(|(n, e)| (n.as_str(), e)).collect();
    let [("vertex", vertex), ("face", face), ..] = elements[..] else { return None };
    let mut properties = face.properties.iter();
    let (Some((name, list)), None) = (properties.next(), properties.next()) else { return None };
    matches!(name.as_str(), "vertex_index" | "vertex_indices").then_some((vertex, face, &list.data_type))
}

fn scalar_size(scalar: &ScalarType) -> u64 {
    match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

#[derive(Default)]
struct Vertex {
    position: Vec3,
    normal: Vec3,
    uv: Vec2,
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let slot = match name {
            "x" => &mut self.position.x,
            "y" => &mut self.position.y,
            "z" => &mut self.position.z,
            "nx" => &mut self.normal.x,
            "ny" => &mut self.normal.y,
            "nz" => &mut self.normal.z,
            "u" | "s" | "texture_u" | "texture_s" => &mut self.uv.x,
            "v" | "t" | "texture_v" | "texture_t" => &mut self.uv.y,
            _ => return PropertyAccessResult::Ignored,
        };
        match property.to_f32_lossy() {
            Some(value) => {
                *slot = value;
                PropertyAccessResult::Set
            }
            None => PropertyAccessResult::Ignored,
        }
    }
}

/// A polygon, or nothing where an index is negative.
#[derive(Default)]
struct Face {
    corners: Option<Vec<u32>>,
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        fn corners<T: TryInto<u32>>(list: Vec<T>) -> Option<Vec<u32>> {
            list.into_iter().map(|i| i.try_into().ok()).collect()
        }
        if !matches!(name, "vertex_index" | "vertex_indices") {
            return PropertyAccessResult::Ignored;
        }
        self.corners = match property {
            Property::ListChar(list) => corners(list),
            Property::ListUChar(list) => corners(list),
            Property::ListShort(list) => corners(list),
            Property::ListUShort(list) => corners(list),
            Property::ListInt(list) => corners(list),
            Property::ListUInt(list) => Some(list),
            _ => None,
        };
        PropertyAccessResult::Set
    }
}

struct Ignored;

impl PropertyAccess for Ignored {
    fn new() -> Self {
        Self
    }

    fn set_property(&mut self, _: &str, _: Property) -> PropertyAccessResult {
        PropertyAccessResult::Ignored
    }
}

fn build(path: &Path, header: &Header, vertices: &[Vertex], faces: &[Face], most: u64) -> Result<Mesh> {
    let mut has = [false; 8];
    let properties = header.elements.get("vertex").into_iter().flat_map(|element| element.properties.iter());
    properties.filter_map(|(name, _)| slot(name)).for_each(|slot| has[slot] = true);
    if has[..3] != [true; 3] {
        return Err(Error::malformed(Place::part(path, "vertex"), "there are no vertices with x, y and z"));
    }
    let mut mesh = Mesh { positions: vertices.iter().map(|v| v.position).collect(), ..Mesh::default() };
    if has[3..6] == [true; 3] {
        mesh.normals = vertices.iter().map(|v| v.normal).collect();
    }
    if has[6..] == [true; 2] {
        mesh.uvs = vertices.iter().map(|v| v.uv).collect();
    }
    let triangles = |face: &Face| face.corners.as_ref().map_or(0, |corners| corners.len().saturating_sub(2) as u64);
    check_triangles(path, faces.iter().map(triangles).sum(), most)?;
    for (index, face) in faces.iter().enumerate() {
        let Some(corners) = &face.corners else {
            let place = Place::part(path, format!("face {index}"));
            return Err(Error::malformed(place, "expected a list vertex_indices of indices from 0"));
        };
        mesh.triangles.extend(corners.windows(2).skip(1).map(|pair| [corners[0], pair[0], pair[1]]));
    }
    Ok(mesh)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    fn parse(bytes: &[u8]) -> Result<Mesh> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        read(file.path())
    }

    const HEADER: &str = "element vertex 4\nproperty float x\nproperty float y\nproperty double z\nproperty uchar red\n\
        property float s\nproperty float t\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";

    #[test]
    fn text_and_both_byte_orders_agree() {
        for [u, v] in [["s", "t"], ["u", "v"], ["texture_u", "texture_v"], ["texture_s", "texture_t"]] {
            let header =
                HEADER.replace("float s\n", &format!("float {u}\n")).replace("float t\n", &format!("float {v}\n"));
            let corners = [[0f32, 0.], [1., 0.], [1., 1.], [0., 1.]];
            let mut text = format!("ply\nformat ascii 1.0\n{header}");
            let mut little = format!("ply\nformat binary_little_endian 1.0\n{header}").into_bytes();
            let mut big = format!("ply\nformat binary_big_endian 1.0\n{header}").into_bytes();
            for [x, y] in corners {
                text += &format!("{x} {y} 2 255 {x} {y}\n");
                for value in [x, y] {
                    little.extend(value.to_le_bytes());
                    big.extend(value.to_be_bytes());
                }
                little.extend(2f64.to_le_bytes());
                big.extend(2f64.to_be_bytes());
                little.push(255);
                big.push(255);
                for value in [x, y] {
                    little.extend(value.to_le_bytes());
                    big.extend(value.to_be_bytes());
                }
            }
            text += "4 0 1 2 3\n";
            little.push(4);
            big.push(4);
            for i in 0..4i32 {
                little.extend(i.to_le_bytes());
                big.extend(i.to_be_bytes());
            }
            let mesh = parse(text.as_bytes()).unwrap();
            assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
            assert_eq!(mesh.positions[2], Vec3::new(1., 1., 2.));
            assert_eq!(mesh.uvs[2], Vec2::ONE);
            assert!(mesh.normals.is_empty());
            assert_eq!(parse(&little).unwrap(), mesh);
            assert_eq!(parse(&big).unwrap(), mesh, "{u} {v}");
            for cut in 0..little.len() {
                assert!(parse(&little[..cut]).is_err(), "cut at {cut}");
            }
        }
    }

    /// One polygon is many triangles: in text, in the usual binary layout, and where the library reads.
    #[test]
    fn triangles_of_polygons_are_counted() {
        let header = "element vertex 1\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
            property list uchar int vertex_index\nend_header\n";
        let binary = [[0u8; 12].as_slice(), &[6], &[0; 24]].concat();
        for (format, body) in [
            ("ascii", b"0 0 0\n6 0 0 0 0 0 0\n".to_vec()),
            ("binary_little_endian", binary.clone()),
            ("binary_big_endian", binary),
        ] {
            let file = tempfile::NamedTempFile::new().unwrap();
            let head = format!("ply\nformat {format} 1.0\n{header}");
            std::fs::write(file.path(), [head.as_bytes(), body.as_slice()].concat()).unwrap();
            assert_eq!(read_up_to(file.path(), 4).unwrap().triangles.len(), 4, "{format}");
            assert!(matches!(read_up_to(file.path(), 3), Err(Error::Limit { value: 4, limit: 3, .. })), "{format}");
        }
    }

    /// Faces of several sizes, numbers of several types, and the same as text; a negative index, and every length too short.
    #[test]
    fn usual_binary_layout() {
        let header = |format: &str, index: &str| {
            format!(
                "ply\nformat {format} 1.0\nelement vertex 5\nproperty uchar quality\nproperty float x\nproperty double y\n\
                property float z\nproperty float nx\nproperty float ny\nproperty float nz\nelement face 3\n\
                property list uchar {index} vertex_index\nend_header\n"
            )
        };
        let faces: [&[i32]; 3] = [&[0, 1, 2], &[0, 1, 2, 3, 4], &[3, 4]];
        let (mut body, mut text) = (Vec::new(), header("ascii", "int"));
        for i in 0..5u8 {
            let x = f32::from(i);
            body.push(i);
            body.extend(x.to_le_bytes());
            body.extend((2.0 * f64::from(i)).to_le_bytes());
            [0.5f32, 0.0, 1.0, 0.0].iter().for_each(|value| body.extend(value.to_le_bytes()));
            text += &format!("{i} {x} {} 0.5 0 1 0\n", 2.0 * x);
        }
        for face in faces {
            body.push(face.len() as u8);
            face.iter().for_each(|i| body.extend(i.to_le_bytes()));
            text += &format!("{} {}\n", face.len(), face.iter().map(|i| format!("{i} ")).collect::<String>());
        }
        let binary = |index: &str, body: &[u8]| [header("binary_little_endian", index).as_bytes(), body].concat();
        let mesh = parse(&binary("int", &body)).unwrap();
        assert_eq!(mesh, parse(text.as_bytes()).unwrap());
        assert_eq!(mesh, parse(&binary("uint", &body)).unwrap());
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 1, 2], [0, 2, 3], [0, 3, 4]]);
        assert_eq!((mesh.positions[3], mesh.normals[4]), (Vec3::new(3.0, 6.0, 0.5), Vec3::Y));
        for cut in 0..body.len() {
            assert!(parse(&binary("int", &body[..cut])).is_err(), "cut at {cut}");
        }
        let end_of_second = body.len() - 9;
        body[end_of_second - 1] = 0xff;
        assert!(matches!(parse(&binary("int", &body)), Err(Error::Malformed { .. })));
    }

    /// A text of several pieces gives the same mesh as the file in binary, with both kinds of numbers; a wrong line is named.
    #[test]
    fn long_texts_are_read_whole() {
        let mut random = Random::new(53, 0, 0);
        let count = 30_000;
        let header = |format: &str| {
            format!(
                "ply\nformat {format} 1.0\nelement vertex {count}\nproperty float x\nproperty double y\nproperty float z\n\
                property uchar red\nproperty float s\nproperty float t\nelement face {count}\n\
                property list uchar int vertex_indices\nend_header\n"
            )
        };
        let (mut text, mut binary) = (header("ascii"), header("binary_little_endian").into_bytes());
        let lines = text.lines().count();
        for _ in 0..count {
            let [x, z, u, v] = [0; 4].map(|_| random.range(-10.0, 10.0));
            let y = random.next_f64();
            text += &format!("{x} {y} {z} 7 {u} {v}\n");
            binary.extend(x.to_le_bytes());
            binary.extend(y.to_le_bytes());
            binary.extend(z.to_le_bytes());
            binary.push(7);
            [u, v].iter().for_each(|value| binary.extend(value.to_le_bytes()));
        }
        for _ in 0..count {
            let corners: Vec<u32> = (0..3 + random.below(2)).map(|_| random.below(count)).collect();
            text += &format!("{} {}\r\n", corners.len(), corners.iter().map(|i| format!("{i} ")).collect::<String>());
            binary.push(corners.len() as u8);
            corners.iter().for_each(|i| binary.extend(i.to_le_bytes()));
        }
        assert!(text.len() > 2 << 20);
        let mesh = parse(text.as_bytes()).unwrap();
        assert!(mesh == parse(&binary).unwrap());
        let mut reader = Reader::new(text.as_bytes());
        let header = Parser::<Ignored>::new().read_header(&mut reader).unwrap();
        let own = text::Layout::of(&header).and_then(|layout| layout.read(reader.get_ref()));
        assert!(own.as_ref() == Some(&mesh), "by our own code");
        // Without the end of the last line, and with something after it.
        assert!(mesh == parse(text.trim_end().as_bytes()).unwrap());
        assert!(mesh == parse((text.clone() + "1 2 3\n").as_bytes()).unwrap());
        let wrong: String = text
            .lines()
            .enumerate()
            .map(|(i, l)| if i == lines + 777 { "1 x 2\n".into() } else { format!("{l}\n") })
            .collect();
        let error = parse(wrong.as_bytes()).unwrap_err().to_string();
        assert!(error.contains(&format!(":{}: ", lines + 778)), "{error}");
    }

    #[test]
    fn counts_are_checked_first() {
        let vertex =
            |count: &str| format!("ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nend_header\n");
        assert!(matches!(parse(vertex("99999999999").as_bytes()), Err(Error::Limit { .. })));
        assert!(matches!(parse(vertex("100000000").as_bytes()), Err(Error::Malformed { .. })));
        let free = "ply\nformat binary_little_endian 1.0\nelement nothing 200000000\nend_header\n";
        assert!(matches!(parse(free.as_bytes()), Err(Error::Malformed { .. })));
    }

    #[test]
    fn negative_index_is_an_error() {
        let text = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
            element face 1\nproperty list uchar int vertex_index\nend_header\n0 0 0\n3 0 0 -1\n";
        assert!(matches!(parse(text.as_bytes()), Err(Error::Malformed { .. })));
    }
}
