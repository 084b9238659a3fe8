//! Records by voxel.

/// Indices grouped by key with their order kept (a counting sort).
pub(super) struct Groups {
    start: Vec<u32>,
    order: Vec<u32>,
}

impl Groups {
    /// Keys at or above `groups` belong to no group.
    pub fn new(keys: &[u32], groups: usize) -> Self {
        let mut start = vec![0u32; groups + 1];
        let valid = |key: &u32| (*key as usize) < groups;
        keys.iter().filter(|k| valid(k)).for_each(|&k| start[k as usize + 1] += 1);
        for g in 0..groups {
            start[g + 1] += start[g];
        }
        let mut next = start.clone();
        let mut order = vec![0; start[groups] as usize];
        for (i, &key) in keys.iter().enumerate().filter(|(_, k)| valid(k)) {
            order[next[key as usize] as usize] = i as u32;
            next[key as usize] += 1;
        }
        Self { start, order }
    }

    /// The indices whose key is `g`.
    pub fn group(&self, g: usize) -> &[u32] {
        &self.order[self.start[g] as usize..self.start[g + 1] as usize]
    }
}
