//! The library's one error type. Every variant carries the place that a user has to look at.

use std::fmt;
use std::path::{Path, PathBuf};

/// Result with the library's error type.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// The place in the input where an error was found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// The file that was being read.
    pub path: PathBuf,
    /// The position inside it, if known.
    pub at: Option<At>,
}

/// A position inside a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum At {
    /// 1-based line of a text file.
    Line(u32),
    /// Byte offset in a binary file.
    Byte(u64),
    /// A named part: a tensor, a JSON key, an XML element.
    Part(String),
}

impl Place {
    /// A place that is a whole file.
    pub fn file(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into(), at: None }
    }

    /// A 1-based line of a file.
    pub fn line(path: impl Into<PathBuf>, line: u32) -> Self {
        Self { path: path.into(), at: Some(At::Line(line)) }
    }

    /// A byte offset in a file.
    pub fn byte(path: impl Into<PathBuf>, offset: u64) -> Self {
        Self { path: path.into(), at: Some(At::Byte(offset)) }
    }

    /// A named part of a file.
    pub fn part(path: impl Into<PathBuf>, part: impl Into<String>) -> Self {
        Self { path: path.into(), at: Some(At::Part(part.into())) }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path.display())?;
        match &self.at {
            None => Ok(()),
            Some(At::Line(line)) => write!(f, ":{line}"),
            Some(At::Byte(offset)) => write!(f, " at byte {offset}"),
            Some(At::Part(part)) => write!(f, " ({part})"),
        }
    }
}

/// Why files are not the parts of one whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unfit {
    /// Some are not there.
    Missing,
    /// Two are the same part, or parts of the same pixels.
    Double,
    /// One is of another whole.
    Foreign,
    /// One is not finished.
    Unfinished,
}

/// Everything that can go wrong in the library.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused to read or write a file.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's own error.
        source: std::io::Error,
    },
    /// A file's content breaks its format, or a value in it is out of range.
    #[error("{place}: {message}")]
    Malformed {
        /// The place in the input.
        place: Place,
        /// Description of the fault and of what was expected.
        message: String,
    },
    /// A file asks for something that this version cannot do.
    #[error("{place}: {what} is not supported; supported: {supported}")]
    Unsupported {
        /// The place in the input.
        place: Place,
        /// The feature or value that was asked for.
        what: String,
        /// The supported alternatives.
        supported: String,
    },
    /// A count or size exceeds what this version accepts.
    #[error("{place}: {what} is {value}, the limit is {limit}")]
    Limit {
        /// The place in the input.
        place: Place,
        /// The quantity.
        what: String,
        /// Its value in the file.
        value: u64,
        /// The largest accepted value.
        limit: u64,
    },
    /// A scene names meshes or pictures that are not there.
    #[error("{}", told(scene, files))]
    Missing {
        /// The scene.
        scene: PathBuf,
        /// The files as the scene names them, and the places that name them.
        files: Vec<(String, Place)>,
    },
    /// A model does not fit what it is asked to do (features, target, mode, version).
    #[error("model {}: {message}", path.display())]
    Model {
        /// The model's folder or file.
        path: PathBuf,
        /// Description of the mismatch.
        message: String,
    },
    /// An inference backend is missing or failed.
    #[error("{backend} backend: {message}")]
    Backend {
        /// Name of the backend.
        backend: &'static str,
        /// Description of the failure, and what to install.
        message: String,
    },
    /// The program that was to show the picture cannot be reached.
    #[error(
        "no viewer answers at {address}: {source}; start tev, or HDRView and let it listen for image updates, or leave \
         --display out"
    )]
    Viewer {
        /// Host and port.
        address: String,
        /// The system's own error.
        source: std::io::Error,
    },
    /// Files that are not the parts of one whole.
    #[error("{message}")]
    Parts {
        /// Why not.
        fault: Unfit,
        /// Those that are at fault; of missing parts none.
        files: Vec<PathBuf>,
        /// The same in words, with the names.
        message: String,
    },
    /// The work was stopped, as asked for, before there was anything to keep.
    #[error("{0}")]
    Interrupted(String),
    /// Options that contradict one another or are out of range.
    #[error("{0}")]
    Options(String),
}

/// Message that lists every missing file with its place.
fn told(scene: &Path, files: &[(String, Place)]) -> String {
    let each: Vec<String> = files.iter().map(|(file, place)| format!("{file} (named at {place})")).collect();
    let count = if files.len() == 1 { "1 file is".to_owned() } else { format!("{} files are", files.len()) };
    format!("{}: {count} missing: {}; --missing skip does without", scene.display(), each.join(", "))
}

impl Error {
    /// An input or output error on `path`.
    pub fn io(path: impl AsRef<Path>, source: std::io::Error) -> Self {
        Self::Io { path: path.as_ref().to_owned(), source }
    }

    /// Malformed content at `place`.
    pub fn malformed(place: Place, message: impl Into<String>) -> Self {
        Self::Malformed { place, message: message.into() }
    }
}
