//! The program as users have it, and the order of its modules.

#[path = "../support/mod.rs"]
#[allow(dead_code, reason = "no unit of tests needs all of it")]
mod support;

mod cli;
mod data_parts;
mod denoise;
mod display;
mod file_circles;
mod files;
mod fireflies;
mod learned_parts;
mod mattes;
mod module_order;
mod other_parts;
mod part_files;
mod parts;
mod report;
mod resume;
mod same_bits;
mod signals;
mod unfinished_parts;
mod views;
