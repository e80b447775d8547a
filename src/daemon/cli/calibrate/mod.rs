//! `tumbled calibrate`: where the sensors are, and when.

use std::path::Path;

use clap::Subcommand;

use super::{Failure, Outcome};
use crate::calibration::file;
use crate::config::calibration::RawCalibration;

pub mod extrinsic;
pub mod time;
pub mod turntable;

/// What is calibrated.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Where a Kinect is relative to a LiDAR, from a board or a sphere shown to both.
    Extrinsic(extrinsic::Args),
    /// Where the turntable's axis is in the rig, from the target's poses and the encoder's angles.
    Turntable(turntable::Args),
    /// How late each sensor's stamps are, against the turntable's encoder.
    Time(time::Args),
}

/// Calibrates.
///
/// # Errors
/// Whatever stopped it.
pub fn run(command: Command) -> Result<Outcome, Failure> {
    match command {
        Command::Extrinsic(args) => extrinsic::run(&args),
        Command::Turntable(args) => turntable::run(&args),
        Command::Time(args) => time::run(&args),
    }
}

/// Writes the calibration file, and logs where the one that was there is kept.
fn write(path: &Path, calibration: &RawCalibration) -> Result<(), Failure> {
    if let Some(kept) = file::write(path, calibration)? {
        tracing::info!("what was there is kept as {}", kept.display());
    }
    Ok(())
}
