//! Standard output: the report and nothing else.

use std::io::Write;

use serde::Serialize;

use super::Failure;

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
