//! What a command puts out: on stdout its report and nothing else, and the files it was asked for.

use std::fs;
use std::fs::Permissions;
use std::io::{self, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use serde::Serialize;

use tempfile::NamedTempFile;

use super::Failure;

/// What a new file may be used for, before the umask takes its part off: as of any program's files.
const NEW_FILE_MODE: u32 = 0o666;

/// Writes a text.
///
/// # Errors
/// [`Failure::Output`]; `main` takes a reader that left for no failure.
pub fn text(text: &str) -> Result<(), Failure> {
    let mut stdout = std::io::stdout().lock();
    stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()).map_err(Failure::Output)
}

/// Writes a report as indented JSON.
///
/// # Errors
/// [`Failure::Output`].
pub fn json(report: &impl Serialize) -> Result<(), Failure> {
    let json = serde_json::to_string_pretty(report).map_err(Failure::failed)?;
    text(&format!("{json}\n"))
}

/// Writes a report: as JSON, or as `text` has it for people.
///
/// # Errors
/// [`Failure::Output`].
pub fn report(report: &impl Serialize, as_json: bool, text: impl FnOnce() -> String) -> Result<(), Failure> {
    if as_json { json(report) } else { self::text(&text()) }
}

/// Writes a file, over one that is there.
///
/// # Errors
/// Exit code 1: whatever the system refuses.
pub fn file(path: &Path, content: impl AsRef<[u8]>) -> Result<(), Failure> {
    fs::write(path, content).map_err(|error| Failure::failed(format!("cannot write {}: {error}", path.display())))
}

/// A file in a folder that takes its name when it is whole. Hidden, so that no program takes it for one of those that are
/// there; its name does not grow with theirs.
///
/// # Errors
/// Whatever the system refuses.
pub fn beside(folder: &Path) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".tumbled-").suffix(".partial").permissions(Permissions::from_mode(NEW_FILE_MODE));
    builder.tempfile_in(folder)
}

/// The folder that a path lies in.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}
