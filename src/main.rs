//! The `fanal` command.

#![forbid(unsafe_code)]

fn main() -> std::process::ExitCode {
    fanal::cli::main()
}
