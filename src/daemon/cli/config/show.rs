//! `tumbled config show`: the effective config.

use crate::cli::{ConfigArgs, Failure, Outcome, output};
use crate::config::show;

/// Arguments of `config show`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: tumbled config show --config rig.toml --origin")]
pub struct Args {
    #[command(flatten)]
    config: ConfigArgs,
    /// Say which layer set each key: default, a line of a file, or --set.
    #[arg(long)]
    origin: bool,
    /// Print the report as JSON, origins included.
    #[arg(long)]
    json: bool,
}

/// Prints the effective config: TOML that can be loaded again, or JSON.
///
/// # Errors
/// [`Failure::Config`] if the config has errors: what would be in force is not known then.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let loaded = args.config.load()?;
    if args.json {
        output::json(&show::report(&loaded.tree))?;
    } else {
        output::text(&show::text(&loaded.tree, args.origin))?;
    }
    Ok(Outcome::Fine)
}
