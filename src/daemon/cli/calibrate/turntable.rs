//! `tumbled calibrate turntable`: the stage's axis in the rig.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args as ClapArgs;
use tumbled_calib::{Gate, Status, turntable};

use crate::calibration::plays::{Change, play_all};
use crate::calibration::{Provenance, file, provenance, turntable as told};
use crate::cli::{ConfigArgs, Failure, InputArgs, Outcome, output, signals};

/// What `calibrate turntable` is asked for.
#[derive(Debug, ClapArgs)]
#[command(
    after_help = "Examples:\n  tumbled calibrate turntable --from run.mcap -o calibration.toml --report turntable.html\n\n\
    The target is tracked as `replay` tracks it, and its poses are held against the encoder: axis, a point on it, the sense in \
    which the encoder counts, and whether its units per turn are right. Two turns of the stage are a good capture, 300 degrees \
    the least.\n\
    Exit code 3: a gate failed, and nothing was written; the report says what is missing."
)]
pub struct Args {
    /// Captures in which the target turns on its stage; several are merged by host time.
    #[arg(long, value_name = "INPUT", required = true, num_args = 1..)]
    from: Vec<PathBuf>,
    /// The calibration file that the result is written into; other results in it stay.
    #[arg(short, long, value_name = "FILE.toml")]
    output: PathBuf,
    /// A page with the verdict, the gates and what is behind them.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    config: ConfigArgs,
}

/// Calibrates.
///
/// # Errors
/// Exit code 2: inputs or a config that cannot be used, inputs without a turntable's angles. 1: a file that cannot be
/// written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let input = InputArgs { inputs: args.from.clone(), config: args.config.clone() };
    let loaded = input.load()?;
    // Before the work: what is there and is no calibration file is told at once.
    let mut calibration = file::read(&args.output)?;
    let inputs = provenance::digests(&args.from)?;
    let changes: [Change; 1] = [Arc::new(|_| {})];
    let played = play_all(&args.from, &loaded.config, &changes, 1, &signals::stop_token()?)?;
    let Some(played) = played.and_then(|played| played.into_iter().next()) else {
        return Err(Failure::failed("stopped before the inputs' end: nothing was calculated"));
    };
    let mut warnings = played.warnings.clone();
    let encoder = played.encoder(&mut warnings)?;
    let poses = told::poses(&played.turned(&encoder, &mut warnings));
    let found = turntable::turntable(&poses, true);
    let gates = match &found {
        Ok(fit) => fit.gates(),
        Err(reason) => vec![Gate::failed("axis", reason.to_string())],
    };
    let fit = found.as_ref().ok();
    let mut report = told::report(fit, Provenance::new(inputs, gates), warnings);
    if report.provenance.status != Status::Fail {
        calibration.turntable.clone_from(&report.turntable);
        file::note(&mut calibration, "turntable", &report.provenance)?;
        super::write(&args.output, &calibration)?;
        report.written = Some(args.output.display().to_string());
    }
    report.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    if let Some(path) = &args.report {
        output::file(path, told::page(&report, fit, &poses))?;
    }
    output::report(&report, args.json, || told::text(&report))?;
    let is_fine = report.provenance.status != Status::Fail && played.complete;
    Ok(if is_fine { Outcome::Fine } else { Outcome::Incomplete })
}
