//! `tumbled calibrate extrinsic`: the Kinect relative to the LiDAR.

use std::path::PathBuf;

use clap::Args as ClapArgs;

use crate::cli::{ConfigArgs, Failure, Outcome};

/// What `calibrate extrinsic` is asked for.
#[derive(Debug, ClapArgs)]
pub struct Args {
    /// Captures in which the target stands still in one pose after the other; several are merged by host time.
    #[arg(long, value_name = "INPUT", required = true, num_args = 1..)]
    from: Vec<PathBuf>,
    /// The calibration file that the result is written into; other results in it stay.
    #[arg(short, long, value_name = "FILE.toml")]
    output: PathBuf,
    #[command(flatten)]
    config: ConfigArgs,
}

/// Calibrates.
///
/// # Errors
/// Exit code 2: inputs or a config that cannot be used.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let _ = (&args.from, &args.output, &args.config);
    Err(Failure::failed("not built yet"))
}
