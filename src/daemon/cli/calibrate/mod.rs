//! `tumbled calibrate`: where the sensors are, and when.

use clap::Subcommand;

use super::{Failure, Outcome};

pub mod extrinsic;

/// What is calibrated.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Where a Kinect is relative to a LiDAR, from a board or a sphere shown to both.
    Extrinsic(extrinsic::Args),
}

/// Calibrates.
///
/// # Errors
/// Whatever stopped it.
pub fn run(command: Command) -> Result<Outcome, Failure> {
    match command {
        Command::Extrinsic(args) => extrinsic::run(&args),
    }
}
