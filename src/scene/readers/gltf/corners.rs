//! From a primitive's vertices to its triangles (specification, §3.7.2.1).

use ::gltf::json::mesh::Mode;

/// The triangles of `count` vertices in this mode, as indices among them; none for points and lines. Vertices that do not complete a
/// triangle are left out.
pub fn triangles(mode: Mode, count: usize) -> Option<Box<dyn Iterator<Item = [usize; 3]>>> {
    match mode {
        Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => None,
        Mode::Triangles => Some(Box::new((0..count / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]))),
        // Every other triangle of a strip would be seen from behind.
        Mode::TriangleStrip => Some(Box::new((0..count.saturating_sub(2)).map(|i| [i, i + 1 + i % 2, i + 2 - i % 2]))),
        Mode::TriangleFan => Some(Box::new((0..count.saturating_sub(2)).map(|i| [i + 1, i + 2, 0]))),
    }
}

/// Numbers for the vertices that are used, in the order of their first use: exporters let many primitives share one large buffer.
#[derive(Debug)]
pub struct Numbers {
    /// For each vertex its number plus one, or 0.
    of: Of,
    /// The vertices that have numbers.
    pub used: Vec<u32>,
}

#[derive(Debug)]
enum Of {
    Table(Vec<u32>),
    Map(hashbrown::HashMap<u32, u32>),
}

impl Numbers {
    /// No numbers so far, for uses about as many as `uses` of `count` vertices.
    pub fn new(count: usize, uses: usize) -> Self {
        let of = if count / 8 <= uses { Of::Table(vec![0; count]) } else { Of::Map(hashbrown::HashMap::new()) };
        Self { of, used: Vec::new() }
    }

    /// The number of `vertex`, which must be below the count.
    pub fn of(&mut self, vertex: u32) -> u32 {
        let entry = match &mut self.of {
            Of::Table(table) => &mut table[vertex as usize],
            Of::Map(map) => map.entry(vertex).or_insert(0),
        };
        if *entry == 0 {
            self.used.push(vertex);
            *entry = self.used.len() as u32;
        }
        *entry - 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_fans() {
        let of = |mode, count| triangles(mode, count).unwrap().collect::<Vec<_>>();
        assert_eq!(of(Mode::Triangles, 7), [[0, 1, 2], [3, 4, 5]]);
        assert_eq!(of(Mode::TriangleStrip, 5), [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
        assert_eq!(of(Mode::TriangleFan, 4), [[1, 2, 0], [2, 3, 0]]);
        assert!(of(Mode::TriangleStrip, 1).is_empty() && of(Mode::TriangleFan, 2).is_empty());
        assert!(triangles(Mode::LineLoop, 3).is_none());
    }

    #[test]
    fn numbers_in_order_of_use() {
        for uses in [4, 400] {
            let mut numbers = Numbers::new(1000, uses);
            assert_eq!([900, 5, 900, 7].map(|vertex| numbers.of(vertex)), [0, 1, 0, 2]);
            assert_eq!(numbers.used, [900, 5, 7]);
        }
    }
}
