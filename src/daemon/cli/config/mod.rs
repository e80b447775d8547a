//! `tumbled config`: check, show, describe or write a config.

use clap::Subcommand;

use super::{Failure, Outcome};

pub mod check;
pub mod init;
pub mod schema;
pub mod show;

/// What to do with a config.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Find every mistake in a config file.
    Check(check::Args),
    /// Print the effective config: defaults, file, calibration and --set together.
    Show(show::Args),
    /// Print the JSON Schema of the config file, for editors.
    Schema,
    /// Write the commented default config.
    Init(init::Args),
}

pub(super) fn run(command: Command) -> Result<Outcome, Failure> {
    match command {
        Command::Check(args) => check::run(&args),
        Command::Show(args) => show::run(&args),
        Command::Schema => schema::run(),
        Command::Init(args) => init::run(&args),
    }
}
