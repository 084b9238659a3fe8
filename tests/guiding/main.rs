//! What trees hold, and what is learned.

#[path = "../support/mod.rs"]
#[allow(dead_code, reason = "no unit of tests needs all of it")]
mod support;

mod complete_paths;
mod hard_trees;
mod learning;
mod open_pgl;
