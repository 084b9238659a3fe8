//! The command line: parse (`args`), resolve against the scene (`views`, `resolve`), work (`commands`), report (`print`, `progress`,
//! `lines`).

pub mod args;
pub mod commands;
pub mod fail;
pub mod interrupt;
pub mod lines;
pub mod print;
pub mod progress;
pub mod resolve;
pub mod views;

use std::ffi::OsString;
use std::process::ExitCode;

use anyhow::Context;
use clap::Parser;

use crate::base::processor;
use args::{Cli, Command};
use interrupt::Ended;

/// Runs the command line of this process, see [`run`].
pub fn main() -> ExitCode {
    run(std::env::args_os()).into()
}

/// Runs a command line, which begins with the program's name, and handles signals while it runs. The exit code is 0 for whole results,
/// 75 where a signal ended the work early, 2 for wrong usage, 1 for everything else.
pub fn run(words: impl IntoIterator<Item = OsString>) -> u8 {
    let cli = match Cli::try_parse_from(words) {
        Ok(cli) => cli,
        Err(error) => return fail::usage(&error),
    };
    match execute(cli.command) {
        Ok(ended) => ended.code(),
        Err(error) => fail::report(&error),
    }
}

fn execute(command: Command) -> anyhow::Result<Ended> {
    processor::check()?;
    let whole = |()| Ended::Whole;
    match command {
        Command::Render(args) => {
            let done = match (args.replay, args.part) {
                (Some(sample), _) => commands::replay::run(&args, sample).map(whole),
                (None, Some(part)) => commands::part::run(&args, part),
                (None, None) => commands::render::run(&args),
            };
            done.with_context(|| format!("cannot render {}", args.of.scene.display()))
        }
        Command::Learn(args) => {
            commands::learn::run(&args).with_context(|| format!("cannot learn {}", args.of.scene.display()))
        }
        Command::Merge(args) => commands::merge::run(&args).map(whole).context("cannot merge"),
        Command::Plan(args) => commands::plan::run(&args).map(whole).context("cannot plan"),
        Command::Compare(args) => {
            commands::compare::run(&args).with_context(|| format!("cannot compare methods on {}", args.scene.display()))
        }
        Command::Error(args) => commands::error::run(&args).map(whole).context("cannot compare"),
        Command::Inspect(args) => {
            commands::inspect::run(&args).map(whole).with_context(|| format!("cannot inspect {}", args.guide.display()))
        }
        Command::Dataset(args) => commands::dataset::run(&args).context("no data set"),
    }
}
