//! The commands, one file each, and what they share.
//!
//! ```text
//!   arguments ──▶ Command ──▶ its run() ──▶ Ok(Outcome) or Err(Failure) ──▶ exit code (main.rs)
//!                                └──▶ report on stdout (output), everything else on stderr (log, render)
//! ```

use clap::{ArgAction, Args, Parser, Subcommand};

pub mod calibrate;
pub mod campaign;
pub mod config;
pub mod ctl;
pub mod devices;
pub mod diff;
pub mod doctor;
pub mod evaluate;
pub mod experiment;
pub mod export;
pub mod failure;
pub mod import;
pub mod info;
pub mod input;
pub mod ledger;
pub mod log;
pub mod manual;
pub mod output;
pub mod reconstruct;
pub mod record;
pub mod recover;
pub mod register;
pub mod render;
pub mod replay;
pub mod run;
pub mod signals;
pub mod simulate;
pub mod status;
pub mod target;
pub mod vary;
pub mod verify;

pub use failure::{Failure, Outcome};
pub use input::{ConfigArgs, FaultArgs, InputArgs};

pub use crate::quantity;

/// Version and, where it was built from a repository, the commit: `0.1.0 (122e041f3c5d)`.
pub const VERSION: &str = env!("TUMBLED_VERSION");

/// Kinect v1 and Velodyne clouds of a tumbling target to its pose, spin axis and rate.
#[derive(Debug, Parser)]
#[command(name = "tumbled", version = VERSION, max_term_width = 100, subcommand_required = true)]
#[command(
    after_help = "Exit codes: 0 fine, 1 failed, 2 bad usage, config or input file, 3 finished but data were lost."
)]
pub struct Cli {
    #[command(flatten)]
    log: LogArgs,
    #[command(subcommand)]
    command: Command,
}

impl Cli {
    /// How much is logged: `-v` more often than `-q` is positive, 0 by default.
    pub fn verbosity(&self) -> i8 {
        let count = |n: u8| i8::try_from(n).unwrap_or(i8::MAX);
        count(self.log.verbose).saturating_sub(count(self.log.quiet))
    }
}

/// How much is logged to stderr.
#[derive(Debug, Args)]
struct LogArgs {
    /// Log more to stderr; twice: everything.
    #[arg(short, long, global = true, action = ArgAction::Count)]
    verbose: u8,
    /// Log only warnings; twice: only errors.
    #[arg(short, long, global = true, action = ArgAction::Count, conflicts_with = "verbose")]
    quiet: u8,
}

/// What to do.
#[derive(Debug, Subcommand)]
enum Command {
    /// Run the daemon: measure live, serve, record.
    Run(run::Args),
    /// Write points and depth images to files other programs open.
    Export(export::Args),
    /// Tell what inputs hold: models, modes, rates, packets lost, clocks, fields of view.
    Info(info::Args),
    /// Write foreign captures into one recording.
    Import(import::Args),
    /// Record the sensors' raw streams as they come.
    Record(record::Args),
    /// Put recordings and captures through the core, as a live session would have seen them.
    Replay(replay::Args),
    /// Compute a recorded session anew and compare it with what it was.
    Verify(verify::Args),
    /// Write a simulated session as files, with the truth beside them.
    Simulate(simulate::Args),
    /// Find the pose between two clouds of one target, how sure it is, and whether it may be used.
    Register(register::Args),
    /// Hold a session's states against the truth: errors, and whether the stated uncertainty holds.
    Evaluate(evaluate::Args),
    /// Make a model of a session's target: points, planes, contour.
    Reconstruct(reconstruct::Args),
    /// Repeat the published experiments, on simulated sensors or a recording.
    #[command(subcommand)]
    Experiment(experiment::Command),
    /// Find where the sensors are relative to each other and when, and how well that is known.
    #[command(subcommand)]
    Calibrate(calibrate::Command),
    /// Measure the acceptance figures: experiments over seeds, held against what they must reach.
    Campaign(campaign::Args),
    /// Keep a target's model as a named frame, and recognise it in later sessions.
    #[command(subcommand)]
    Target(target::Command),
    /// Make a finished recording of one that was interrupted or damaged.
    Recover(recover::Args),
    /// Find where two recordings differ.
    Diff(diff::Args),
    /// Tell how a running daemon is doing.
    Status(status::Args),
    /// Give a running daemon an order: learn the empty room, reset the filter, write a marker.
    Ctl(ctl::Args),
    /// Check, show, describe or write a config.
    #[command(subcommand)]
    Config(config::Command),
    /// Look whether this machine is ready for a session with a config.
    Doctor(doctor::Args),
    /// Write manual pages and shell completions.
    Manual(manual::Args),
    /// List serial ports, Kinects, network interfaces and the LiDARs that are heard.
    Devices(devices::Args),
}

/// Carries out a command.
///
/// # Errors
/// Whatever stopped it; [`Failure::exit_code`] says how that ends.
pub fn run(cli: Cli) -> Result<Outcome, Failure> {
    match cli.command {
        Command::Run(args) => run::run(&args),
        Command::Export(args) => export::run(&args),
        Command::Info(args) => info::run(&args),
        Command::Import(args) => import::run(&args),
        Command::Record(args) => record::run(&args),
        Command::Replay(args) => replay::run(&args),
        Command::Verify(args) => verify::run(&args),
        Command::Simulate(args) => simulate::run(&args),
        Command::Register(args) => register::run(&args),
        Command::Evaluate(args) => evaluate::run(&args),
        Command::Reconstruct(args) => reconstruct::run(&args),
        Command::Experiment(command) => experiment::run(command),
        Command::Calibrate(command) => calibrate::run(command),
        Command::Campaign(args) => campaign::run(&args),
        Command::Target(command) => target::run(command),
        Command::Manual(args) => manual::run(&args),
        Command::Recover(args) => recover::run(&args),
        Command::Diff(args) => diff::run(&args),
        Command::Status(args) => status::run(&args),
        Command::Ctl(args) => ctl::run(&args),
        Command::Config(command) => config::run(command),
        Command::Doctor(args) => doctor::run(&args),
        Command::Devices(args) => devices::run(&args),
    }
}
