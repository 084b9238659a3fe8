//! The `fanal-training` command.

#![forbid(unsafe_code)]

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    match fanal_training::cli::run(fanal_training::cli::Cli::parse()) {
        Ok(ended) => ended.code().into(),
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
