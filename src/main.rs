//! The `fanal` command.

fn main() -> std::process::ExitCode {
    fanal::cli::main()
}
