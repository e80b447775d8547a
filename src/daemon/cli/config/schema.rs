//! `tumbled config schema`: the JSON Schema of the config file.

use crate::cli::{Failure, Outcome, output};
use crate::schema;

/// Prints the schema.
///
/// # Errors
/// [`Failure::Output`].
pub fn run() -> Result<Outcome, Failure> {
    output::text(&schema::config().text())?;
    Ok(Outcome::Fine)
}
