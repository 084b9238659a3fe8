//! The `fanal` command.
fn main() {}
