//! Lists in messages.

use std::fmt::Display;

/// Most things that a message names one by one.
const NAMED: usize = 16;

/// The things with commas between them; of many the first, and how many more there are.
pub fn named<T: Display>(all: impl IntoIterator<Item = T>) -> String {
    let mut all = all.into_iter();
    let first: Vec<String> = all.by_ref().take(NAMED).map(|thing| thing.to_string()).collect();
    match all.count() {
        0 => first.join(", "),
        more => format!("{} and {more} more", first.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_the_first_are_named() {
        assert_eq!(named(Vec::<u32>::new()), "");
        assert_eq!(named([1, 2]), "1, 2");
        assert!(named(1..=16).ends_with(", 16"));
        assert!(named(1..=1_000_000).ends_with(", 16 and 999984 more"));
    }
}
