//! The `fanal-training` command.
fn main() {}
