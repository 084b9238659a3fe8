//! Corners of faces, and the vertices that they share.

use std::collections::HashMap;

use crate::geometry::mesh::Mesh;

use super::Part;
use crate::scene::readers::lines::integer;

/// Indices of a position, of texture coordinates and of a normal, from 0; [`NONE`] where there is none.
pub type Corner = [u32; 3];

/// No index: no file that is read has as many elements.
pub const NONE: u32 = u32::MAX;

/// Reads `1`, `1/2`, `1//3` or `1/2/3`: numbers from 1, or backwards from the last of those `before` this line. Texture coordinates
/// and normals are left out where the file has none.
pub fn corner(word: &[u8], before: [usize; 3], total: [usize; 3]) -> Result<Corner, &'static str> {
    const WRONG: &str = "a line \"f\" does not hold vertex indices";
    const MISSING: [&str; 3] = [
        "a face uses a vertex that does not exist",
        "a face uses texture coordinates that do not exist",
        "a face uses a normal that does not exist",
    ];
    let mut corner = [NONE; 3];
    for (i, index) in word.split(|&byte| byte == b'/').enumerate().filter(|(_, index)| !index.is_empty()) {
        let slot = corner.get_mut(i).ok_or(WRONG)?;
        let index = integer(index).ok_or(WRONG)?;
        if total[i] == 0 && i > 0 {
            continue;
        }
        let counted = if index < 0 { index.checked_add(before[i] as i64) } else { index.checked_sub(1) };
        let inside = counted.and_then(|index| usize::try_from(index).ok()).filter(|&index| index < total[i]);
        *slot = inside.and_then(|index| u32::try_from(index).ok()).ok_or(MISSING[i])?;
    }
    if corner[0] == NONE { Err(WRONG) } else { Ok(corner) }
}

/// Most vertices with the same position that are searched one by one.
const LONGEST: usize = 16;

/// A vertex of the mesh, and another one with the same position.
struct Vertex {
    corner: Corner,
    next: u32,
}

/// Merges equal corners to one vertex each, in the order in which faces use them.
struct Welder {
    /// First vertex of the list of each position.
    firsts: Vec<u32>,
    vertices: Vec<Vertex>,
    /// Vertices of positions whose lists are full.
    others: HashMap<Corner, u32>,
}

impl Welder {
    fn vertex(&mut self, corner: Corner) -> u32 {
        let first = self.firsts[corner[0] as usize];
        let (mut at, mut length) = (first, 0);
        while at != NONE {
            let vertex = &self.vertices[at as usize];
            if vertex.corner == corner {
                return at;
            }
            at = vertex.next;
            length += 1;
        }
        let new = self.vertices.len() as u32;
        if length < LONGEST {
            self.firsts[corner[0] as usize] = new;
        } else {
            let found = *self.others.entry(corner).or_insert(new);
            if found != new {
                return found;
            }
        }
        self.vertices.push(Vertex { corner, next: first });
        new
    }
}

/// Makes the mesh of a file's content. Where only some corners have texture coordinates or normals the others have (0, 0), as in
/// Mitsuba, and no normal, which is one of length 0.
pub fn weld(part: &Part) -> Mesh {
    let corners = 3 * part.triangles.len();
    let mut welder = Welder {
        firsts: vec![NONE; part.positions.len()],
        vertices: Vec::with_capacity(part.positions.len().min(corners)),
        others: HashMap::new(),
    };
    let triangles = part.triangles.iter().map(|corners| corners.map(|corner| welder.vertex(corner))).collect();
    let vertices = welder.vertices;
    Mesh {
        positions: vertices.iter().map(|vertex| part.positions[vertex.corner[0] as usize]).collect(),
        uvs: values(&vertices, 1, &part.uvs),
        normals: values(&vertices, 2, &part.normals),
        triangles,
    }
}

/// The value `i` of each vertex; none at all where no vertex has one.
fn values<T: Copy + Default>(vertices: &[Vertex], i: usize, all: &[T]) -> Vec<T> {
    if vertices.iter().all(|vertex| vertex.corner[i] == NONE) {
        return Vec::new();
    }
    vertices.iter().map(|vertex| all.get(vertex.corner[i] as usize).copied().unwrap_or_default()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use glam::{Vec2, Vec3};

    /// Vertices are those of a table of all corners, few or many of them at a position.
    #[test]
    fn same_corners_are_one_vertex() {
        let mut random = Random::new(52, 0, 0);
        for [positions, uvs, normals] in [[50, 1, 1], [20, 3, 2], [2, 90, 90]] {
            let mut corner = || [positions, uvs, normals].map(|count| random.below(count));
            let triangles = (0..2000).map(|_| [corner(), corner(), corner()]).collect();
            let part = Part {
                positions: (0..positions).map(|i| Vec3::X * i as f32).collect(),
                uvs: (0..uvs).map(|i| Vec2::X * i as f32).collect(),
                normals: (0..normals).map(|i| Vec3::Y * i as f32).collect(),
                triangles,
            };
            let mesh = weld(&part);
            let mut known: Vec<Corner> = Vec::new();
            for (corners, triangle) in part.triangles.iter().zip(&mesh.triangles) {
                for (&corner, &vertex) in corners.iter().zip(triangle) {
                    let expected = known.iter().position(|other| *other == corner).unwrap_or_else(|| {
                        known.push(corner);
                        known.len() - 1
                    });
                    assert_eq!(vertex as usize, expected);
                    let [position, uv, normal] = corner.map(|index| index as f32);
                    let vertex = vertex as usize;
                    let found = (mesh.positions[vertex].x, mesh.uvs[vertex].x, mesh.normals[vertex].y);
                    assert_eq!(found, (position, uv, normal));
                }
            }
            assert_eq!(mesh.positions.len(), known.len());
        }
    }
}
