//! Files of points or surfaces that people bring: read whole and within a bound, and what is told of those that are none.

use std::fs;
use std::path::{Path, PathBuf};

use thiserror::Error;

/// A file that does not hold what its name says.
#[derive(Debug, Error)]
#[error("{}{}: {problem}", path.display(), line.map(|line| format!(":{line}")).unwrap_or_default())]
pub struct GeometryError {
    /// The file.
    pub path: PathBuf,
    /// The line, from 1, where the file has lines and one is at fault.
    pub line: Option<usize>,
    /// What was found and what was expected.
    pub problem: String,
}

/// What is wrong with a file's content, and in which line if it has lines.
#[derive(Debug)]
pub(crate) struct Wrong {
    pub(crate) line: Option<usize>,
    pub(crate) problem: String,
}

impl Wrong {
    pub(crate) fn new(problem: impl Into<String>) -> Self {
        Self { line: None, problem: problem.into() }
    }

    /// The same with the file's name.
    pub(crate) fn in_file(self, path: &Path) -> GeometryError {
        GeometryError { path: path.to_owned(), line: self.line, problem: self.problem }
    }
}

/// The end of a file's name, in small letters.
pub(crate) fn extension(path: &Path) -> Option<String> {
    path.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase)
}

/// A file's content; `remedy` is told of one of more bytes than `largest`.
pub(crate) fn bytes(path: &Path, largest: u64, remedy: &str) -> Result<Vec<u8>, GeometryError> {
    let unreadable = |error: std::io::Error| Wrong::new(format!("cannot be read: {error}")).in_file(path);
    let length = fs::metadata(path).map_err(unreadable)?.len();
    if length > largest {
        return Err(Wrong::new(format!("{length} bytes, at most {largest} expected: {remedy}")).in_file(path));
    }
    fs::read(path).map_err(unreadable)
}
