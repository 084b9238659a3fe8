//! The `fanal` command.

#![forbid(unsafe_code)]

use fanal::base::pages::LargePages;

#[global_allocator]
static MEMORY: LargePages = LargePages;

fn main() -> std::process::ExitCode {
    fanal::cli::main()
}
