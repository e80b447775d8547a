//! `tumbled config init`: the commented default, as a file to edit.

use std::fs::OpenOptions;
use std::io::{ErrorKind, Write};
use std::path::PathBuf;

use crate::cli::{Failure, Outcome, output};
use crate::config::COMMENTED_DEFAULT;

/// Arguments of `config init`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: tumbled config init lab.toml")]
pub struct Args {
    /// The file to write.
    #[arg(value_name = "PATH", default_value = "rig.toml")]
    path: PathBuf,
    /// Overwrite it if it exists.
    #[arg(long)]
    force: bool,
}

/// Writes the file.
///
/// # Errors
/// [`Failure::Input`] if it exists and `--force` is not given; [`Failure::Failed`] if it cannot be written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let mut options = OpenOptions::new();
    options.write(true);
    if args.force {
        options.create(true).truncate(true);
    } else {
        // One system call that creates or fails: no file that appears in between is lost.
        options.create_new(true);
    }
    let path = args.path.display();
    let written = options.open(&args.path).and_then(|mut file| file.write_all(COMMENTED_DEFAULT.as_bytes()));
    match written {
        Ok(()) => {
            output::text(&format!("{path}: written; edit it, then run `tumbled config check {path}`\n"))?;
            Ok(Outcome::Fine)
        }
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {
            let help = "name another file, or overwrite this one with --force";
            Err(Failure::input(format!("{path}: exists already, nothing was written")).with_help(help))
        }
        Err(error) => Err(Failure::failed(format!("{path}: cannot be written: {error}"))),
    }
}
