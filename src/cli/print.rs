//! Results on stdout and warnings on stderr.

use std::io::{ErrorKind, IsTerminal, Write};

use crate::base::{Error, Result};

/// Prints a line of results. A reader that has gone away is no error.
///
/// # Errors
/// [`Error::Io`] where stdout cannot be written for another reason.
pub fn line(text: &str) -> Result<()> {
    match writeln!(std::io::stdout(), "{text}") {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Error::io("standard output", error)),
        _ => Ok(()),
    }
}

/// Prints a value as JSON.
///
/// # Errors
/// As [`line`].
pub fn json(value: &impl serde::Serialize) -> Result<()> {
    let text =
        serde_json::to_string_pretty(value).map_err(|e| Error::Options(format!("the result is no JSON: {e}")))?;
    line(&text)
}

/// Says on a terminal what was done, unless `quiet`; logs are not told.
pub fn to_who_watches(text: &str, quiet: bool) {
    let mut terminal = std::io::stderr();
    if !quiet && terminal.is_terminal() {
        // A terminal that has gone away is not watched.
        let _ = writeln!(terminal, "{text}");
    }
}

/// Prints warnings, unless `quiet`.
pub fn warnings(texts: &[String], quiet: bool) {
    for text in texts.iter().filter(|_| !quiet) {
        // With stderr closed there is nobody left to warn.
        let _ = writeln!(std::io::stderr(), "fanal: warning: {text}");
    }
}
