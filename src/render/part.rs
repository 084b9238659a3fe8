//! Parts of a render: ranges of its samples, in whole blocks, for several processes.

use std::collections::BTreeSet;
use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::base::{Error, Result};
use crate::film::BLOCK;

/// Most parts of one picture.
pub const MOST_PARTS: u32 = 1 << 20;

/// One of several parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "[u32; 2]", into = "[u32; 2]")]
pub struct PartOf {
    index: u32,
    count: u32,
}

impl PartOf {
    /// Part `index` of `count`, counted from 1.
    ///
    /// # Errors
    /// [`Error::Options`] where there is no such part.
    pub fn new(index: u32, count: u32) -> Result<Self> {
        if count > MOST_PARTS || !(1..=count).contains(&index) {
            return Err(Error::Options(format!(
                "{index}/{count} is no part: they are counted from 1, and there are at most {MOST_PARTS}"
            )));
        }
        Ok(Self { index, count })
    }

    /// Its number, from 1.
    pub fn index(self) -> u32 {
        self.index
    }

    /// Number of parts.
    pub fn count(self) -> u32 {
        self.count
    }

    /// The part's share of `all` things, counted from 0: parts differ by one at most.
    pub fn share(self, all: u64) -> Range<u64> {
        let (index, count) = (u128::from(self.index), u128::from(self.count));
        let begin = |part: u128| (u128::from(all) * part / count) as u64;
        begin(index - 1)..begin(index)
    }

    /// Whether a thing with this number, from 0 on, is the part's where things are dealt out one by one: neighbours often take as long as one
    /// another, and so do parts then.
    pub fn takes(self, number: u64) -> bool {
        number % u64::from(self.count) == u64::from(self.index - 1)
    }

    /// How many of `all` things the part gets where they are dealt out one by one.
    pub fn dealt(self, all: u64) -> u64 {
        ((u128::from(all) + u128::from(self.count - self.index)) / u128::from(self.count)) as u64
    }

    /// Those of `count` parts whose numbers are not among `there`.
    pub fn absent(count: u32, there: impl IntoIterator<Item = u32>) -> Vec<Self> {
        let there: BTreeSet<u32> = there.into_iter().collect();
        (1..=count).filter(|index| !there.contains(index)).map(|index| Self { index, count }).collect()
    }

    /// The part's samples of each pixel, of so many: whole blocks, but for the last of all.
    ///
    /// # Errors
    /// [`Error::Options`] where there are more parts than blocks.
    pub fn samples(self, spp: u32) -> Result<Range<u32>> {
        let blocks = spp.div_ceil(BLOCK);
        if self.count > blocks {
            return Err(Error::Options(format!(
                "{spp} samples per pixel are {blocks} blocks of {BLOCK}, which cannot be divided into {} parts: give at most {blocks}; \
                 windows (--crop) divide further",
                self.count
            )));
        }
        let share = self.share(blocks.into());
        let sample = |block: u64| (block * u64::from(BLOCK)).min(spp.into()) as u32;
        Ok(sample(share.start)..sample(share.end))
    }
}

impl TryFrom<[u32; 2]> for PartOf {
    type Error = Error;

    fn try_from([index, count]: [u32; 2]) -> Result<Self> {
        Self::new(index, count)
    }
}

impl From<PartOf> for [u32; 2] {
    fn from(part: PartOf) -> Self {
        [part.index, part.count]
    }
}

impl FromStr for PartOf {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(k, n)| Some([k.parse().ok()?, n.parse().ok()?]));
        let [index, count] = numbers.ok_or("expected the number of a part and how many there are, for example 3/64")?;
        Self::new(index, count).map_err(|error| error.to_string())
    }
}

impl fmt::Display for PartOf {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_all_samples_once() {
        for (spp, count) in [(1, 1), (64, 1), (65, 2), (640, 7), (1000, 16), (1 << 24, 1000)] {
            let mut end = 0;
            for index in 1..=count {
                let samples = PartOf::new(index, count).unwrap().samples(spp).unwrap();
                assert!(samples.start == end && samples.end > end, "{index}/{count} of {spp}: {samples:?}");
                assert!(samples.end.is_multiple_of(BLOCK) || samples.end == spp);
                end = samples.end;
            }
            assert_eq!(end, spp);
        }
        assert!(PartOf::new(1, 2).unwrap().samples(64).is_err());
    }

    #[test]
    fn parts_are_dealt_everything_once() {
        for (all, count) in [(0u64, 3), (7, 3), (2, 5), (12, 4)] {
            let parts: Vec<PartOf> = (1..=count).map(|index| PartOf::new(index, count).unwrap()).collect();
            let takers = |number| parts.iter().filter(move |part| part.takes(number));
            assert!((0..all).all(|number| takers(number).count() == 1));
            for part in &parts {
                assert_eq!((0..all).filter(|&number| part.takes(number)).count() as u64, part.dealt(all));
            }
        }
        let dealt: u128 = (1..=3).map(|index| u128::from(PartOf::new(index, 3).unwrap().dealt(u64::MAX))).sum();
        assert_eq!(dealt, u64::MAX.into());
    }

    #[test]
    fn absent_parts_are_the_others() {
        let absent: Vec<u32> = PartOf::absent(5, [4, 2, 2]).into_iter().map(PartOf::index).collect();
        assert_eq!(absent, [1, 3, 5]);
        assert!(PartOf::absent(MOST_PARTS, 1..=MOST_PARTS).is_empty());
    }

    #[test]
    fn words_are_numbers() {
        assert_eq!("3/64".parse(), Ok(PartOf { index: 3, count: 64 }));
        for bad in ["", "3", "0/4", "5/4", "-1/4", "1/0", "1/4/2", "a/b", "1/4294967295"] {
            assert!(bad.parse::<PartOf>().is_err(), "{bad}");
        }
    }
}
