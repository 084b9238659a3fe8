//! Words of the command line in, JSON out.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::Parser;
use fanal::base::Error;
use fanal::cli::args::{Cli, Command};
use pyo3::prelude::*;

use crate::errors::{raised, refused};

/// Parses the command line of `command` with options `words` for a scene.
pub fn parsed(command: &str, words: Vec<OsString>, scene: PathBuf) -> PyResult<Command> {
    let first = ["fanal", command].map(OsString::from);
    let last = [OsString::from("--"), scene.into_os_string()];
    let cli = Cli::try_parse_from(first.into_iter().chain(words).chain(last)).map_err(|error| refused(&error))?;
    Ok(cli.command)
}

/// The exception for words that made another command than was meant, which a scene's path after `--` cannot do.
pub fn other_command() -> PyErr {
    raised(&Error::Options("these are no options of this function".into()))
}

/// A value as JSON.
pub fn json(value: &impl serde::Serialize) -> PyResult<String> {
    serde_json::to_string(value).map_err(|error| raised(&Error::Options(format!("the result is no JSON: {error}"))))
}
