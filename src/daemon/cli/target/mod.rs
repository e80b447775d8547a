//! `tumbled target`: a target's model is kept, and later sessions recognise it and tell their states in its frame.
//!
//! ```text
//!   save   inputs ─ the core ─▶ the model at their end ─▶ NAME.target.ply
//!   match  inputs, NAME.target.ply ─ the core ─▶ is it seen, since when, where
//!   show   NAME.target.ply ─▶ whose it is, how large, how much of it is known
//! ```

pub mod matching;
pub mod save;
pub mod show;

use std::path::Path;

use clap::Subcommand;

use super::{Failure, Outcome};
use crate::geometry_file::{self, Wrong};
use crate::target::SavedTarget;

/// What to do with saved targets.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Keep the model of a session's target as a named frame.
    Save(save::Args),
    /// Tell whether a session's target is a saved one.
    Match(matching::Args),
    /// Tell what a saved target is.
    Show(show::Args),
}

/// Carries out a command.
///
/// # Errors
/// Those of the commands.
pub fn run(command: Command) -> Result<Outcome, Failure> {
    match command {
        Command::Save(args) => save::run(&args),
        Command::Match(args) => matching::run(&args),
        Command::Show(args) => show::run(&args),
    }
}

/// The largest file of a saved target, bytes.
const LARGEST: u64 = 16 << 20;

/// Reads a saved target.
///
/// # Errors
/// Exit code 2: it cannot be read or is none.
fn read(path: &Path) -> Result<SavedTarget, Failure> {
    let bytes = geometry_file::bytes(path, LARGEST, "it is no saved target").map_err(Failure::input)?;
    SavedTarget::read(&bytes).map_err(|error| Failure::input(Wrong::new(error.to_string()).in_file(path)))
}
