//! Wavefront OBJ: the lines that make up geometry, as one mesh. Groups do not split it, so that smooth normals do not break where
//! one ends; the faces of some materials may be asked for alone. Material files are not read.
//!
//! Pieces of the text are read in parallel, twice: first to count, so that each knows what the indices of its faces refer to.

mod corners;

use std::path::Path;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::base::files::read_bytes;
use crate::base::{Error, Place, Result};
use crate::geometry::mesh::Mesh;

use super::lines::{lines, number, numbers, pieces, words};
use super::{BYTES_PER_TRIANGLE, LARGEST_MESH_FILE, MOST_ELEMENTS};
use corners::{Corner, corner, weld};

/// Reads an OBJ file; polygons become fans of triangles, points and lines are left out. v becomes 1 − v, because OBJ counts it from
/// the bottom of a picture, and this renderer, like Mitsuba, from the top.
///
/// Where `only` names materials, there are only their faces; those before any `usemtl` have the material "".
///
/// # Errors
/// [`Error::Io`], [`Error::Limit`], [`Error::Malformed`] naming the file and, where there is one, the line.
pub fn read(path: &Path, only: &[String]) -> Result<Mesh> {
    read_up_to(path, only, MOST_ELEMENTS)
}

/// As [`read`], of a file with at most `most` values of each kind, vertices and triangles.
fn read_up_to(path: &Path, only: &[String], most: u64) -> Result<Mesh> {
    let bytes = continued(read_bytes(path, LARGEST_MESH_FILE)?);
    let limit = |what: &str, value: u64| match value > most {
        true => Err(Error::Limit { place: Place::file(path), what: format!("number of {what}"), value, limit: most }),
        false => Ok(()),
    };
    let pieces = pieces(&bytes);
    let counts: Vec<Counts> = pieces.par_iter().map(|piece| Counts::of(piece)).collect();
    let mut total = Counts::default();
    let mut begins = Vec::with_capacity(counts.len());
    let mut material: &[u8] = b"";
    for (counts, piece) in counts.iter().zip(&pieces) {
        begins.push(Begin { counts: total, kept: is_among(only, material) });
        total = total.plus(counts);
        if !only.is_empty() {
            material = lines(piece).filter_map(material_named).last().unwrap_or(material);
        }
    }
    for (what, count) in ["positions", "texture coordinates", "normals"].into_iter().zip(total.values) {
        limit(what, count as u64)?;
    }
    // No triangle takes fewer bytes.
    if bytes.len() as u64 / BYTES_PER_TRIANGLE > most {
        limit("triangles", pieces.par_iter().map(|piece| count_triangles(piece)).sum())?;
    }
    let parts: Vec<Result<Part, Broken>> = pieces
        .par_iter()
        .zip(begins.par_iter().zip(&counts))
        .map(|(piece, (begin, counts))| part(piece, begin, counts, &total, only))
        .collect();
    let triangles = parts.iter().flatten().map(|part| part.triangles.len()).sum();
    let mut whole = Part::with_capacity(&total, triangles);
    let mut start = 0;
    for (part, piece) in parts.into_iter().zip(&pieces) {
        match part {
            Ok(part) => whole.append(part),
            Err((line, why)) => {
                let before = start + lines(piece).take(line).map(<[u8]>::len).sum::<usize>();
                let ends = bytes[..before].iter().filter(|byte| matches!(**byte, b'\n' | GOES_ON)).count();
                let place = Place::line(path, u32::try_from(ends + 1).unwrap_or(u32::MAX));
                return Err(Error::malformed(place, format!("not a readable OBJ file: {why}")));
            }
        }
        start += piece.len();
    }
    let mesh = weld(&whole);
    limit("vertices", mesh.positions.len() as u64)?;
    Ok(mesh)
}

/// The end of a line that the next one continues: white space that no line needs, a form feed.
const GOES_ON: u8 = 0x0C;

/// Lines that a backslash continues, as one: it becomes a space, and the end of its line [`GOES_ON`]. Comments do not go
/// on.
fn continued(mut bytes: Vec<u8>) -> Vec<u8> {
    let mut is_comment = false;
    for at in 0..bytes.len() {
        match bytes[at] {
            b'#' => is_comment = true,
            GOES_ON => bytes[at] = b' ',
            b'\n' => {
                let line = bytes[..at].strip_suffix(b"\r").unwrap_or(&bytes[..at]);
                if line.ends_with(b"\\") && !is_comment {
                    let last = line.len() - 1;
                    bytes[last..at].fill(b' ');
                    bytes[at] = GOES_ON;
                } else {
                    is_comment = false;
                }
            }
            _ => {}
        }
    }
    bytes
}

/// Number of triangles that the faces in a piece are made of.
fn count_triangles(piece: &[u8]) -> u64 {
    let of_line = |line| {
        let mut words = words(line).take_while(|word| word[0] != b'#');
        let is_face = words.next() == Some(b"f");
        if is_face { words.count().saturating_sub(2) as u64 } else { 0 }
    };
    lines(piece).map(of_line).sum()
}

/// The materials that the faces of an OBJ file have by their `usemtl`, in the order in which they come; "" is that before any.
///
/// # Errors
/// [`Error::Io`], [`Error::Limit`].
pub fn materials(path: &Path) -> Result<Vec<String>> {
    let bytes = read_bytes(path, LARGEST_MESH_FILE)?;
    let mut found = Vec::new();
    let (mut material, mut seen): (&[u8], bool) = (b"", false);
    for line in lines(&bytes) {
        if let Some(name) = material_named(line) {
            (material, seen) = (name, false);
        } else if !seen && words(line).next() == Some(b"f") {
            seen = true;
            let name = String::from_utf8_lossy(material).into_owned();
            if !found.contains(&name) {
                found.push(name);
                if found.len() > MOST_MATERIALS {
                    let (place, what) = (Place::file(path), "number of materials".to_owned());
                    return Err(Error::Limit { place, what, value: found.len() as u64, limit: MOST_MATERIALS as u64 });
                }
            }
        }
    }
    Ok(found)
}

/// Most materials of a file whose faces are told apart.
const MOST_MATERIALS: usize = 1024;

/// What a line `usemtl` names: the rest of it.
fn material_named(line: &[u8]) -> Option<&[u8]> {
    let rest = line.trim_ascii().strip_prefix(b"usemtl")?;
    rest.first().is_none_or(u8::is_ascii_whitespace).then(|| rest.trim_ascii())
}

/// Whether faces of a material are wanted.
fn is_among(only: &[String], material: &[u8]) -> bool {
    only.is_empty() || only.iter().any(|name| *name == String::from_utf8_lossy(material))
}

/// What came before a piece.
struct Begin {
    counts: Counts,
    /// Whether faces are wanted there.
    kept: bool,
}

/// Index of a line in its piece, and its fault.
type Broken = (usize, &'static str);

/// Number of each kind of values.
#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    /// Positions, texture coordinates, normals.
    values: [usize; 3],
}

impl Counts {
    fn of(piece: &[u8]) -> Self {
        let mut counts = Self::default();
        for line in lines(piece) {
            if let Some(kind) = words(line).next().and_then(kind) {
                counts.values[kind] += 1;
            }
        }
        counts
    }

    fn plus(&self, other: &Self) -> Self {
        Self { values: [0, 1, 2].map(|i| self.values[i] + other.values[i]) }
    }
}

/// Index of the kind of values (positions, texture coordinates, normals) in a line that begins with `word`.
fn kind(word: &[u8]) -> Option<usize> {
    match word {
        b"v" => Some(0),
        b"vt" => Some(1),
        b"vn" => Some(2),
        _ => None,
    }
}

/// The content of some lines.
#[derive(Default)]
struct Part {
    positions: Vec<Vec3>,
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
    triangles: Vec<[Corner; 3]>,
}

impl Part {
    fn with_capacity(counts: &Counts, triangles: usize) -> Self {
        let [positions, uvs, normals] = counts.values;
        Self {
            positions: Vec::with_capacity(positions),
            uvs: Vec::with_capacity(uvs),
            normals: Vec::with_capacity(normals),
            triangles: Vec::with_capacity(triangles),
        }
    }

    fn append(&mut self, mut other: Self) {
        self.positions.append(&mut other.positions);
        self.uvs.append(&mut other.uvs);
        self.normals.append(&mut other.normals);
        self.triangles.append(&mut other.triangles);
    }
}

/// Reads a piece that holds `counts` values, after `begin`, in a file of `total`.
fn part(piece: &[u8], begin: &Begin, counts: &Counts, total: &Counts, only: &[String]) -> Result<Part, Broken> {
    let mut part = Part::with_capacity(counts, 0);
    let mut kept = begin.kept;
    for (index, line) in lines(piece).enumerate() {
        // The rest of a line after # is a comment.
        let mut words = words(line).take_while(|word| word[0] != b'#');
        let Some(first) = words.next() else { continue };
        let read = match first {
            b"v" => position(&mut words).map(|position| part.positions.push(position)),
            b"vt" => texture_coordinates(&mut words).map(|uv| part.uvs.push(uv)),
            b"vn" => {
                let normal = numbers(&mut words).ok_or("a line \"vn\" does not hold three numbers");
                normal.map(|normal| part.normals.push(Vec3::from_array(normal)))
            }
            b"usemtl" => {
                kept = is_among(only, material_named(line).unwrap_or_default());
                Ok(())
            }
            b"f" if kept => {
                let here = [part.positions.len(), part.uvs.len(), part.normals.len()];
                let before = [0, 1, 2].map(|i| begin.counts.values[i] + here[i]);
                fan(words.map(|word| corner(word, before, total.values)), &mut part.triangles)
            }
            _ => Ok(()),
        };
        read.map_err(|why| (index, why))?;
    }
    Ok(part)
}

/// Reads a position: three numbers, divided by a fourth if that is all that follows; a colour may follow as well.
fn position<'a>(words: &mut impl Iterator<Item = &'a [u8]>) -> Result<Vec3, &'static str> {
    const WRONG: &str = "a line \"v\" does not hold three numbers";
    let position = Vec3::from_array(numbers(words).ok_or(WRONG)?);
    match (words.next(), words.next()) {
        (Some(weight), None) => match number::<f32>(weight).ok_or(WRONG)? {
            0.0 => Err("a line \"v\" holds a point at infinity"),
            weight => Ok(position / weight),
        },
        _ => Ok(position),
    }
}

/// Reads texture coordinates: u, and v unless that is 0.
fn texture_coordinates<'a>(words: &mut impl Iterator<Item = &'a [u8]>) -> Result<Vec2, &'static str> {
    let read = |word: &[u8]| number::<f32>(word).ok_or("a line \"vt\" does not hold two numbers");
    let u = read(words.next().unwrap_or_default())?;
    let v = words.next().map_or(Ok(0.0), read)?;
    Ok(Vec2::new(u, 1.0 - v))
}

/// Adds the triangles of a polygon.
fn fan(
    mut corners: impl Iterator<Item = Result<Corner, &'static str>>,
    triangles: &mut Vec<[Corner; 3]>,
) -> Result<(), &'static str> {
    let first = corners.next().ok_or("a face has no vertices")??;
    let Some(second) = corners.next() else { return Ok(()) };
    let mut last = second?;
    for corner in corners {
        let corner = corner?;
        triangles.push([first, last, corner]);
        last = corner;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    fn parse(text: &str) -> Result<Mesh> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        read(file.path(), &[])
    }

    #[test]
    fn groups_polygons_and_attributes() {
        let text = "mtllib none.mtl\no a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 0.25\nvn 0 0 1\n\
                    g first\nf 1/1/1 2/2/1 3/3/1 4/4/1\nusemtl m\ng second\nv 2 0 0\nf -5/1/1 -1/2/1 -4/3/1\n";
        let mesh = parse(text).unwrap();
        assert_eq!(mesh.triangles.len(), 3, "the square as two triangles, and one more");
        assert_eq!(mesh.uvs.len(), mesh.positions.len());
        assert_eq!(mesh.normals.len(), mesh.positions.len());
        let corner = mesh.positions.iter().position(|p| *p == Vec3::Y).unwrap();
        assert_eq!(mesh.uvs[corner], Vec2::new(0.0, 0.75), "v counts from the top");
    }

    #[test]
    fn points_weights_colours_and_comments() {
        let text = "\tv 2 4 6 2 # half\r\nv 1 0 0 0.5 0.5 0.5\r\nv 0 1 0\nv 9 9 9 # unused\np 1\nl 1 2\nf 1 2\nf 1 2 3 # all\n";
        let mesh = parse(text).unwrap();
        assert_eq!(mesh.positions, [Vec3::new(1.0, 2.0, 3.0), Vec3::X, Vec3::Y]);
        assert_eq!(mesh.triangles, [[0, 1, 2]]);
    }

    #[test]
    fn bad_files_are_errors() {
        for (line, text) in [
            (1, "v 0 0\n"),
            (1, "v 0 0 x\n"),
            (2, "# a comment\nv 0 0 0 0\n"),
            (2, "v 0 0 0\nf 1 2 3\n"),
            (5, "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/2 3/3\n"),
            (5, "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//9 2//9 3//9\n"),
            (4, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf a b c\n"),
            (4, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n"),
            (4, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/2/3/4 2 3\n"),
            (4, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf\n"),
            (4, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -9 -8 -7\n"),
            (4, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 99999999999999999999 1 2\nv x\n"),
            (6, "v 0 0 0\nv 1 0 0\nv 0 \\\r\n1 0\nf 1 2 3\nf 1 2 x\n"),
            (3, "v 0 0 0\nv 1 0 0\x0C\nf 1 2 \\\nx\n"),
        ] {
            let error = parse(text).unwrap_err();
            assert!(matches!(&error, Error::Malformed { .. }), "{text}");
            assert!(error.to_string().contains(&format!(":{line}: ")), "{error}");
        }
    }

    /// A few bytes of a face make a triangle of many, and a few positions vertices of each use. A comment makes none.
    #[test]
    fn too_much_of_a_kind() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let read = |text: &str, most: u64| {
            std::fs::write(file.path(), text).unwrap();
            read_up_to(file.path(), &[], most)
        };
        let fan = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 1 2 3 1 2 3 # 1 2 3\n";
        assert_eq!(read(fan, 7).unwrap().triangles.len(), 7);
        let told = |text: &str, most: u64| match read(text, most) {
            Err(Error::Limit { what, value, limit, .. }) if limit == most => (what, value),
            other => panic!("{other:?}"),
        };
        assert_eq!(told(fan, 6), ("number of triangles".to_owned(), 7));
        assert_eq!(told(fan, 2), ("number of positions".to_owned(), 3));
        let normals = "vn 1 0 0\nvn 0 1 0\nvn 0 0 1\n";
        let each = format!("{fan}{normals}f 1//1 2//2 3//3\nf 1//2 2//3 3//1\n");
        assert_eq!(told(&each, 8), ("number of triangles".to_owned(), 9));
        let each = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\n{normals}f 1//1 2//2 3//3\nf 1//2 2//3 3//1\n");
        assert_eq!(told(&each, 5), ("number of vertices".to_owned(), 6));
    }

    /// As exporters write it: faces with and without texture coordinates or normals in one file, u alone, a line in two.
    #[test]
    fn what_some_corners_lack() {
        let mesh = parse(
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0.5\nvt 0.25 0.5\nvn 0 0 1\n# C:\\\nf 1/1/1 2/2/1 3/1/1\nf 2 4 \\\r\n3\n",
        );
        let mesh = mesh.unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [3, 4, 5]]);
        let expected = [[0.5, 1.0], [0.25, 0.5], [0.5, 1.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]].map(Vec2::from);
        assert_eq!(mesh.uvs, expected);
        assert_eq!(mesh.normals, [Vec3::Z, Vec3::Z, Vec3::Z, Vec3::ZERO, Vec3::ZERO, Vec3::ZERO]);
    }

    /// Faces by their material, in a file that is cut into pieces between a name and its faces. Each has its own vertices alone.
    #[test]
    fn faces_by_material() {
        let mut text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nusemtl of wood \r\n".to_owned();
        for i in 0..60_000 {
            text += &format!("v {i} 1 2 # a long line of one vertex\n");
        }
        text += "f -1 -2 1\nf -3 -4 1\n\tusemtl glass\nf 1 2 3\nusemtl unused\nusemtl of wood\nf 1 2 3\nusemtl\nf 3 2 1\nusemtlx\n";
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), &text).unwrap();
        assert!(pieces(text.as_bytes()).len() > 1);
        assert_eq!(materials(file.path()).unwrap(), ["", "of wood", "glass"]);
        let of = |names: &[&str]| {
            let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
            let mesh = read(file.path(), &names).unwrap();
            (mesh.triangles.len(), mesh.positions.len())
        };
        assert_eq!(of(&["of wood"]), (3, 7));
        assert_eq!(of(&["glass"]), (1, 3));
        assert_eq!(of(&[""]), (2, 3));
        assert_eq!(of(&["", "glass"]), (3, 3));
        assert_eq!(of(&[]), (6, 7));
        assert_eq!(of(&["unused"]), (0, 0));
    }

    #[test]
    fn too_many_materials() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let text: String = (0..=MOST_MATERIALS).map(|i| format!("usemtl {i}\nf\n")).collect();
        std::fs::write(file.path(), text).unwrap();
        assert!(matches!(materials(file.path()), Err(Error::Limit { value: 1025, limit: 1024, .. })));
    }

    /// A long file, so that it is cut, with numbers of faces from the beginning and from the end of what came before, and one wrong
    /// line in the middle of it.
    #[test]
    fn pieces_make_one_mesh() {
        let mut random = Random::new(51, 0, 0);
        let (mut text, mut corners, mut places) = (String::new(), Vec::new(), Vec::new());
        for line in 0..90_000 {
            let count = places.len();
            if line % 3 < 2 {
                places.push(line as f32);
                text += &format!("v {line} 0.5 {}\n", random.next_f32());
                continue;
            }
            let face = [0; 3].map(|_| random.below(count as u32) as usize);
            let word = |i: i64, v: usize| if i % 2 == 0 { v as i64 + 1 } else { v as i64 - count as i64 };
            text += &format!("f {} {} {}\n", word(0, face[0]), word(1, face[1]), word(line, face[2]));
            corners.extend(face);
        }
        assert!(pieces(text.as_bytes()).len() > 1);
        let mesh = parse(&text).unwrap();
        let expected: Vec<f32> = corners.iter().map(|&vertex| places[vertex]).collect();
        let found: Vec<f32> = mesh.triangles.iter().flatten().map(|&i| mesh.positions[i as usize].x).collect();
        assert!(found == expected);
        let end = text.len() - 1;
        let begin = text[..end].rfind('\n').unwrap() + 1;
        text.replace_range(begin..end, "f 1 2 z");
        let error = parse(&text).unwrap_err();
        assert!(error.to_string().contains(&format!(":{}: ", text.lines().count())), "{error}");
    }
}
