//! `tumbled calibrate`: where the sensors are, and when.

use std::path::Path;

use clap::Subcommand;
use tumbled_calib::board::BoardSize;
use tumbled_calib::{Gate, Status};

use super::{Failure, Outcome};
use crate::calibration::file;
use crate::config::calibration::RawCalibration;

pub mod extrinsic;
pub mod kinect;
pub mod time;
pub mod turntable;

/// What is calibrated.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Where a Kinect is relative to a LiDAR, from a board or a sphere shown to both.
    Extrinsic(extrinsic::Args),
    /// A Kinect's lens and the error of its depths over the picture, from a board shown to it and a LiDAR.
    Kinect(kinect::Args),
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
        Command::Kinect(args) => kinect::run(&args),
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

/// Logs what a person should know, and the gates that did not pass.
fn tell(warnings: &[String], gates: &[Gate]) {
    for warning in warnings {
        tracing::warn!("{warning}");
    }
    for gate in gates.iter().filter(|gate| gate.status != Status::Pass) {
        tracing::warn!("{}: {}", gate.name, gate.remedy.as_deref().unwrap_or_default());
    }
}

/// What became of the file, as a line.
fn written(file: Option<&str>, kept: Option<&str>) -> String {
    match (file, kept) {
        (Some(file), Some(kept)) => format!("written: {file}; what was there: {kept}\n"),
        (Some(file), None) => format!("written: {file}\n"),
        (None, _) => "nothing written: a calibration that failed is not to be used\n".to_owned(),
    }
}

/// A board's sides as they are given: `0.8x0.6`.
fn sides(text: &str) -> Result<BoardSize, String> {
    let expected = || "expected two sides in metres, 0.2 to 3, as in 0.8x0.6".to_owned();
    let (a, b) = text.split_once('x').ok_or_else(expected)?;
    let side = |text: &str| text.trim().parse::<f64>().ok().filter(|side| (0.2..=3.0).contains(side));
    Ok(BoardSize::new(side(a).ok_or_else(expected)?, side(b).ok_or_else(expected)?))
}

/// A table for people.
fn aligned(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| {
        rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).map(|(cell, width)| {
            let missing = width.saturating_sub(cell.chars().count());
            format!("{cell}{}", " ".repeat(missing))
        });
        format!("  {}\n", cells.collect::<Vec<_>>().join("  ").trim_end())
    };
    rows.iter().map(line).collect()
}
