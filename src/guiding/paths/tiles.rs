//! Which kept paths may have drawn a place in the picture: squares of pixels, each with the paths whose first Gaussians reach into it.

use std::ops::Range;

/// Side of a tile over how far paths reach, and the least in pixels: then a path is in the lists of 36 tiles at most.
const SIDE: f32 = 0.5;
const LEAST_SIDE: f32 = 4.0;

/// Lists of paths by tile.
#[derive(Debug, Clone, Default)]
pub struct Tiles {
    /// Pixels of the picture: columns, rows.
    size: [f32; 2],
    /// Pixels along a side of a tile, and tiles.
    side: f32,
    columns: usize,
    rows: usize,
    /// Where the list of each tile begins, and the end of the last.
    starts: Vec<u32>,
    /// Number of the kind, and index of the path, in ascending order within a tile.
    entries: Vec<(u32, u32)>,
}

impl Tiles {
    /// Lists of paths with these places in a picture of `size` pixels and numbers of kinds, which reach `radius` pixels far.
    pub fn new(size: [u32; 2], paths: &[([f32; 2], u32)], radius: f32) -> Self {
        let side = (SIDE * radius).max(LEAST_SIDE);
        let size = size.map(|pixels| pixels as f32);
        let [columns, rows] = size.map(|pixels| (pixels / side).ceil().max(1.0) as usize);
        let reached = |[x, y]: [f32; 2]| {
            let range = |at: f32, count: usize| {
                let tile = |at: f32| ((at / side).max(0.0) as usize).min(count - 1);
                tile(at - radius)..tile(at + radius) + 1
            };
            let across = range(x, columns);
            range(y, rows).flat_map(move |row| across.clone().map(move |column| row * columns + column))
        };
        let mut starts = vec![0u32; columns * rows + 1];
        for &(film, _) in paths {
            reached(film).for_each(|tile| starts[tile + 1] += 1);
        }
        let mut sum = 0;
        starts.iter_mut().for_each(|start| {
            sum += *start;
            *start = sum;
        });
        let mut next = starts.clone();
        let mut entries = vec![(0, 0); sum as usize];
        for (index, &(film, kind)) in (0..).zip(paths) {
            for tile in reached(film) {
                entries[next[tile] as usize] = (kind, index);
                next[tile] += 1;
            }
        }
        let mut tiles = Self { size, side, columns, rows, starts, entries };
        for tile in 0..columns * rows {
            let range = tiles.range(tile);
            tiles.entries[range].sort_unstable();
        }
        tiles
    }

    fn range(&self, tile: usize) -> Range<usize> {
        self.starts[tile] as usize..self.starts[tile + 1] as usize
    }

    /// The paths that may reach a place: number of the kind, and index, in ascending order. None do outside of the picture, where no path
    /// is drawn, though the last tiles may end there.
    pub fn at(&self, film: [f32; 2]) -> &[(u32, u32)] {
        if !(0..2).all(|axis| film[axis] >= 0.0 && film[axis] < self.size[axis]) {
            return &[];
        }
        // Quotients may be rounded up.
        let tile = |at: f32, count: usize| ((at / self.side) as usize).min(count - 1);
        let (column, row) = (tile(film[0], self.columns), tile(film[1], self.rows));
        &self.entries[self.range(row * self.columns + column)]
    }

    /// The same of one kind only.
    pub fn of_kind(&self, film: [f32; 2], kind: u32) -> &[(u32, u32)] {
        let all = self.at(film);
        let first = all.partition_point(|entry| entry.0 < kind);
        let count = all[first..].partition_point(|entry| entry.0 == kind);
        &all[first..first + count]
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.starts[..]) + size_of_val(&self.entries[..])
    }
}
