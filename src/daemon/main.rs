//! The `tumbled` command: arguments in, exit code out.

use std::process::ExitCode;

use clap::Parser;
use tumbled::cli::{self, Cli, Failure, Outcome};

/// 0 fine, 1 failed, 2 bad usage, config or input, 3 finished but data were lost or a quality gate failed. Bad usage
/// that the argument parser itself finds ends in `Cli::parse`, also with 2.
fn main() -> ExitCode {
    let arguments = Cli::parse();
    cli::log::init(arguments.verbosity());
    match cli::run(arguments) {
        Ok(Outcome::Fine) => ExitCode::SUCCESS,
        Ok(Outcome::Different) => ExitCode::FAILURE,
        Ok(Outcome::Incomplete) => ExitCode::from(3),
        // Whoever read the output has seen enough: `tumbled config show | head` is no failure.
        Err(Failure::Output(error)) if error.kind() == std::io::ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        Err(failure) => {
            cli::render::to_stderr(&failure);
            ExitCode::from(failure.exit_code())
        }
    }
}
