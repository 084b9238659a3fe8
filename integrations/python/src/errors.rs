//! The renderer's errors as Python exceptions.

use std::io::ErrorKind;

use fanal::base::Error;
use fanal::cli::fail::usage_message;
use pyo3::import_exception;
use pyo3::prelude::*;

mod python {
    use super::import_exception;
    import_exception!(fanal._errors, Error);
    import_exception!(fanal._errors, FileError);
    import_exception!(fanal._errors, FormatError);
    import_exception!(fanal._errors, NotFoundError);
    import_exception!(fanal._errors, OptionError);
}

/// The exception for an error of the renderer; its message names file and place as on the command line.
pub fn raised(error: &Error) -> PyErr {
    let message = error.to_string();
    match error {
        Error::Io { source, .. } if source.kind() == ErrorKind::NotFound => python::NotFoundError::new_err(message),
        Error::Io { .. } => python::FileError::new_err(message),
        Error::Missing { .. } => python::NotFoundError::new_err(keywords(&message)),
        Error::Malformed { .. } | Error::Unsupported { .. } | Error::Limit { .. } | Error::Model { .. } => {
            python::FormatError::new_err(message)
        }
        Error::Options(_) => python::OptionError::new_err(keywords(&message)),
        _ => python::Error::new_err(message),
    }
}

/// The exception for options that the command line's parser refuses.
pub fn refused(error: &clap::Error) -> PyErr {
    let message = usage_message(&error.to_string());
    python::OptionError::new_err(keywords(message.trim_end_matches(" (see --help)")))
}

/// The exception for work that ended without a result, which only a fault in the renderer can do.
pub fn broken() -> PyErr {
    python::Error::new_err("internal error: the work ended in a panic, whose message is on stderr")
}

/// A message with options in the way of Python: `load_guide` for `--load-guide`. Options are words; `--` within the name of
/// a file stays.
fn keywords(message: &str) -> String {
    let mut told = String::with_capacity(message.len());
    let mut parts = message.split("--");
    told.push_str(parts.next().unwrap_or_default());
    for part in parts {
        let begins = told.chars().next_back().is_none_or(|c| c.is_whitespace() || "'\"`([".contains(c));
        if !(begins && part.starts_with(|c: char| c.is_ascii_lowercase())) {
            told.push_str("--");
            told.push_str(part);
            continue;
        }
        let end = part.find(|c: char| !c.is_ascii_lowercase() && c != '-').unwrap_or(part.len());
        let (name, rest) = part.split_at(end);
        // The one option that is called otherwise.
        let name = if name == "aov" { "aovs" } else { name };
        told.push_str(&name.replace('-', "_"));
        told.push_str(rest);
    }
    told
}
