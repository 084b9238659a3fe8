//! Inverting a discrete CDF by cutpoints instead of binary search: a table says for equal parts of [0, 1) where each begins
//! (Chen and Asau 1974, *On Generating Random Variates from an Empirical Distribution*; Devroye 1986, *Non-Uniform Random Variate
//! Generation*, §III.2.4). The index is that of a binary search, to the last bit, so stratified numbers stay stratified.
//!
//! A binary search reads log₂ n entries of the CDF, which for an environment map fits in no cache; this reads one place of the
//! table and the next few of the cumulative weights.

/// Cumulative weights per part of [0, 1), on average: few enough that the table is small, and that a part lies in two cache lines.
const PER_PART: usize = 2;
/// Longest range that is searched by counting instead of halving: no branch depends on `u`.
const COUNTED: usize = 16;

/// Length of the table for `len` cumulative weights: a power of two of parts, and the end of the last. 0 for so few weights that
/// counting them all is as fast.
pub fn table_len(len: usize) -> usize {
    if len <= COUNTED { 0 } else { len.div_ceil(PER_PART).next_power_of_two() + 1 }
}

/// Fills a table of [`table_len`] entries: the number of weights of the ascending `cdf`, which ends with 1, that are at most each
/// part's beginning. There are fewer than 2³² of them.
pub fn fill(cdf: &[f64], table: &mut [u32]) {
    let parts = table.len().saturating_sub(1) as f64;
    let mut below = 0;
    for (part, entry) in table.iter_mut().enumerate() {
        let begin = part as f64 / parts;
        below += cdf[below..].iter().take_while(|&&c| c <= begin).count();
        *entry = below as u32;
    }
}

/// Entry of a table of `entries` that [`find`] begins with.
#[inline(always)]
fn part(entries: usize, u: f64) -> usize {
    // The number of parts is a power of two, so products and bounds are exact.
    ((u * (entries - 1) as f64) as usize).min(entries - 2)
}

/// The entry of the table that [`find`] reads first; none where there is no table.
#[inline(always)]
pub fn entry(table: &[u32], u: f64) -> Option<&u32> {
    table.get(if table.is_empty() { 0 } else { part(table.len(), u) })
}

/// Number of entries of `cdf` that are at most `u` in [0, 1], but at most the last index. `table` comes from [`fill`].
#[inline(always)]
pub fn find(cdf: &[f64], table: &[u32], u: f64) -> usize {
    let range = match table.len() {
        0 => 0..cdf.len(),
        entries => {
            let part = part(entries, u);
            table[part] as usize..table[part + 1] as usize
        }
    };
    let first = range.start;
    let within = &cdf[range];
    let below = match within.len() {
        0..=COUNTED => within.iter().filter(|&&c| c <= u).count(),
        _ => within.partition_point(|&c| c <= u),
    };
    (first + below).min(cdf.len() - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use crate::sampling::discrete::accumulate;

    /// As [`find`], by binary search.
    fn halved(cdf: &[f64], u: f64) -> usize {
        cdf.partition_point(|&c| c <= u).min(cdf.len() - 1)
    }

    /// Weights of many kinds: even, steep, mostly zero, all zero, one alone, and a few times each number.
    fn weights(kind: usize, len: usize, random: &mut Random) -> Vec<f64> {
        let one = random.below(len as u32) as usize;
        (0..len)
            .map(|i| match kind {
                0 => random.next_f64(),
                1 => random.next_f64().powi(40),
                2 => {
                    if random.next_f64() < 0.02 {
                        1.0
                    } else {
                        0.0
                    }
                }
                3 => 0.0,
                4 => f64::from(u8::from(i == one)),
                5 => {
                    if i == one {
                        1e9
                    } else {
                        random.next_f64()
                    }
                }
                _ => {
                    if i % 64 < 32 {
                        0.0
                    } else {
                        f64::from(random.below(4))
                    }
                }
            })
            .collect()
    }

    /// The index of a binary search: for numbers anywhere, at 0, at the last below 1 and at 1, at every cumulative weight and at the
    /// bounds of every part, and at the neighbours of all of these.
    #[test]
    fn index_of_a_binary_search() {
        let mut random = Random::new(31, 0, 0);
        for len in [1, 2, 8, 16, 17, 31, 64, 100, 511, 4096] {
            for kind in 0..7 {
                let mut cdf = weights(kind, len, &mut random);
                accumulate(&mut cdf);
                let mut table = vec![0; table_len(len)];
                fill(&cdf, &mut table);
                let bounds = (0..table.len()).map(|i| i as f64 / (table.len() - 1) as f64);
                let special = cdf.iter().copied().chain(bounds).chain([0.0, 1.0]);
                let near = special.flat_map(|u| [u.next_down().max(0.0), u, u.next_up().min(1.0)]).collect::<Vec<_>>();
                let anywhere = (0..15_000).map(|_| random.next_f64());
                for u in near.into_iter().chain(anywhere) {
                    assert_eq!(find(&cdf, &table, u), halved(&cdf, u), "{u:e} among {len} weights of kind {kind}");
                }
            }
        }
    }
}
