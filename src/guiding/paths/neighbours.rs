//! The nearest paths of the same kind.
//!
//! Paths of a kind are sorted by the coordinate in which they differ most. From a path's place both ways, no path needs to be looked at
//! that differs in that coordinate alone by more than the farthest neighbour so far.

use rayon::prelude::*;

use super::path::CompletePath;

/// Neighbours of a path (Reibold 2018, §3.4).
pub const NEIGHBOURS: usize = 10;

/// The coordinate of all points in which the paths differ most: index of the point, and axis.
fn widest(paths: &[&CompletePath]) -> (usize, usize) {
    let points = paths.first().map_or(0, |path| path.points.len());
    let spread = |(point, axis): (usize, usize)| {
        let mean = paths.iter().map(|path| f64::from(path.points[point][axis])).sum::<f64>() / paths.len() as f64;
        paths.iter().map(|path| (f64::from(path.points[point][axis]) - mean).powi(2)).sum::<f64>()
    };
    let all = (0..points).flat_map(|point| (0..3).map(move |axis| (point, axis)));
    all.map(|at| (spread(at), at)).max_by(|a, b| a.0.total_cmp(&b.0)).map_or((0, 0), |(_, at)| at)
}

/// For each of the paths, which are of one kind, the indices of its nearest others (eq. 9), nearest first; where two are as far, the one
/// of the lower index.
pub fn nearest(paths: &[&CompletePath]) -> Vec<Vec<u32>> {
    if paths.is_empty() {
        return Vec::new();
    }
    let (point, axis) = widest(paths);
    let key = |index: u32| paths[index as usize].points.get(point).map_or(0.0, |point| point[axis]);
    let mut order: Vec<u32> = (0..paths.len() as u32).collect();
    order.sort_by(|&a, &b| key(a).total_cmp(&key(b)).then(a.cmp(&b)));
    let mut places = vec![0; order.len()];
    order.iter().enumerate().for_each(|(place, &index)| places[index as usize] = place);
    (0..paths.len() as u32).into_par_iter().map(|index| search(paths, &order, places[index as usize], key)).collect()
}

/// The nearest of the path at `place` in the `order` of a coordinate, `key`.
fn search(paths: &[&CompletePath], order: &[u32], place: usize, key: impl Fn(u32) -> f32) -> Vec<u32> {
    let own = order[place];
    let mut found: Vec<(f32, u32)> = Vec::with_capacity(NEIGHBOURS + 1);
    let mut look = |index: u32| {
        let most = if found.len() < NEIGHBOURS { f32::INFINITY } else { found[NEIGHBOURS - 1].0 };
        if (key(index) - key(own)).powi(2) > most {
            return false;
        }
        let entry = (paths[own as usize].squared_distance(paths[index as usize], most), index);
        let at = found.partition_point(|other| (other.0, other.1) < entry);
        found.insert(at, entry);
        found.truncate(NEIGHBOURS);
        true
    };
    let (mut below, mut above) = (order[..place].iter().rev(), order[place + 1..].iter());
    let (mut down, mut up) = (true, true);
    while down || up {
        down = down && below.next().is_some_and(|&index| look(index));
        up = up && above.next().is_some_and(|&index| look(index));
    }
    found.into_iter().map(|(_, index)| index).collect()
}
