//! `tumbled manual`: manual pages and completions, made from the commands' own descriptions.

use std::fs;
use std::path::{Path, PathBuf};

use clap::{Args as ClapArgs, CommandFactory};
use clap_complete::Shell;

use super::{Cli, Failure, Outcome};

/// What `manual` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled manual -o ~/.local/share\n  man tumbled-replay\n\n\
    Written are man/man1/tumbled*.1 and completions for bash, zsh and fish where these shells look for them: below \
    ~/.local/share for one user, below /usr/share for all.")]
pub struct Args {
    /// The folder below which they are written; it is made if it is not there.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

/// Writes them.
///
/// # Errors
/// Exit code 1: a folder or a file that cannot be written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let cannot =
        |path: &Path, error: std::io::Error| Failure::failed(format!("cannot write {}: {error}", path.display()));
    let folder = |name: &str| {
        let path = args.output.join(name);
        fs::create_dir_all(&path).map_err(|error| cannot(&path, error)).map(|()| path)
    };
    let pages = folder("man/man1")?;
    clap_mangen::generate_to(Cli::command(), &pages).map_err(|error| cannot(&pages, error))?;
    for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
        let (place, name) = match shell {
            Shell::Bash => ("bash-completion/completions", "tumbled"),
            Shell::Zsh => ("zsh/site-functions", "_tumbled"),
            _ => ("fish/vendor_completions.d", "tumbled.fish"),
        };
        let path = folder(place)?.join(name);
        let mut text = Vec::new();
        clap_complete::generate(shell, &mut Cli::command(), "tumbled", &mut text);
        fs::write(&path, text).map_err(|error| cannot(&path, error))?;
    }
    Ok(Outcome::Fine)
}
