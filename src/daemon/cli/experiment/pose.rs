//! `tumbled experiment pose`: the published rotation experiment.

use std::fs;
use std::path::PathBuf;

use clap::Args as ClapArgs;
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;

use super::write_report;
use crate::cli::{ConfigArgs, Failure, InputArgs, Outcome, VERSION, output, signals};
use crate::experiment::machine::Machine;
use crate::experiment::pose::figures::PoseRow;
use crate::experiment::pose::methods::PoseMethod;
use crate::experiment::pose::recorded;
use crate::experiment::pose::report::PoseExperimentReport;
use crate::experiment::pose::simulated::{AXES, RESTS, SETS, Session};
use crate::simulation::scenes;

/// What `experiment pose` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled experiment pose -o out/ --threads 0\n  \
    tumbled experiment pose --sensors vlp-32c --axis z --method fused,paper-filter --json\n  \
    tumbled experiment pose --from run.mcap\n\n\
    Simulated: a box bus that rests 16 times and is turned by 22.5 degrees at 5 degrees a second between, about x, y and z, \
    seen by a VLP-32C and a Kinect in a room, and by an HDL-64E and a Kinect. Attitude and axis at the rests are held \
    against the truth.\n\
    --from: the rests are those of the turntable's encoder, with which steps are compared; without one those of the \
    estimate.\n\
    With -o: report.json and report.html.\n\
    Exit code 3: a method had no pose at some rest.")]
pub struct Args {
    /// A recording, captures or a scene instead of the simulated experiment.
    #[arg(long, value_name = "INPUT", num_args = 1..)]
    from: Vec<PathBuf>,
    #[command(flatten)]
    config: ConfigArgs,
    /// The LiDAR beside the Kinect, with commas: vlp-32c, hdl-64e. [default: both, one after the other]
    #[arg(long, value_name = "LIDAR", value_delimiter = ',', value_parser = set, conflicts_with = "from")]
    sensors: Vec<(&'static str, &'static str)>,
    /// The axes turned about, with commas: x, y, z. [default: all]
    #[arg(long, value_name = "AXIS", value_delimiter = ',', value_parser = axis, conflicts_with = "from")]
    axis: Vec<(&'static str, [f64; 3])>,
    /// Methods, with commas: fused, kinect, lidar, paper-filter, gicp-chain. [default: all]
    #[arg(long, value_name = "METHOD", value_delimiter = ',', value_parser = PoseMethod::of_name)]
    method: Vec<PoseMethod>,
    /// Rests of the target; the published experiment has 16.
    #[arg(long, value_name = "N", default_value_t = RESTS, value_parser = clap::value_parser!(u32).range(2..=1_000))]
    rests: u32,
    /// Everything random follows from it.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// The folder for report.json and report.html; it is made if it is not there.
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    output: Option<PathBuf>,
    /// Sessions at a time; 0 = one for each processor. With --from threads of the core. Changes no result.
    #[arg(long, value_name = "N", default_value_t = 1)]
    threads: usize,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

fn set(text: &str) -> Result<(&'static str, &'static str), String> {
    let names = || SETS.map(|(name, _)| name).join(", ");
    SETS.into_iter().find(|(name, _)| *name == text).ok_or_else(|| format!("expected one of {}", names()))
}

fn axis(text: &str) -> Result<(&'static str, [f64; 3]), String> {
    AXES.into_iter().find(|(name, _)| *name == text).ok_or_else(|| "expected x, y or z".to_owned())
}

/// Carries the experiment out.
///
/// # Errors
/// Exit code 2: inputs or a config that cannot be used. 1: a folder that cannot be written.
pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    if args.from.is_empty() && (args.config.config.is_some() || !args.config.settings.is_empty()) {
        return Err(Failure::input(
            "--config and --set are of --from: the simulated experiment has an operator's config",
        ));
    }
    if let Some(folder) = &args.output {
        fs::create_dir_all(folder)
            .map_err(|error| Failure::failed(format!("cannot make {}: {error}", folder.display())))?;
    }
    let methods = if args.method.is_empty() { PoseMethod::ALL.to_vec() } else { args.method.clone() };
    let found = if args.from.is_empty() {
        let rows = simulated(args, &methods)?;
        rows.map(|rows| recorded::Found { rows, rests_by: "scene".to_owned(), warnings: Vec::new() })
    } else {
        let input = InputArgs { inputs: args.from.clone(), config: args.config.clone() };
        recorded::run(&input, &methods, args.threads, args.seed)?
    };
    let Some(found) = found else {
        tracing::warn!("stopped before the end: nothing is reported");
        return Ok(Outcome::Incomplete);
    };
    let source = match args.from.as_slice() {
        [] => vec!["simulated".to_owned()],
        inputs => inputs.iter().map(|path| path.display().to_string()).collect(),
    };
    let report = PoseExperimentReport {
        program: VERSION.to_owned(),
        machine: Machine::this(),
        source,
        rests_by: found.rests_by,
        seed: args.seed,
        rows: found.rows,
        warnings: found.warnings,
    };
    report.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    if let Some(folder) = &args.output {
        write_report(folder, &report, &report.page())?;
    }
    output::report(&report, args.json, || report.text())?;
    Ok(if report.rows.iter().all(|row| row.posed == row.rests) { Outcome::Fine } else { Outcome::Incomplete })
}

fn simulated(args: &Args, methods: &[PoseMethod]) -> Result<Option<Vec<PoseRow>>, Failure> {
    let sets = if args.sensors.is_empty() { SETS.to_vec() } else { args.sensors.clone() };
    let axes = if args.axis.is_empty() { AXES.to_vec() } else { args.axis.clone() };
    let session = |set, axis| Session { set, axis, rests: args.rests, seed: args.seed };
    let sessions: Vec<Session<'_>> =
        sets.iter().flat_map(|set| axes.iter().map(move |axis| session(*set, *axis))).collect();
    let stop = signals::stop_token()?;
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} sessions  {elapsed_precise}");
    let progress =
        ProgressBar::new(sessions.len() as u64).with_style(style.unwrap_or_else(|_error| ProgressStyle::default_bar()));
    let one = |session: &Session<'_>| {
        let rows = session.run(methods, &stop);
        progress.inc(1);
        rows
    };
    let rows: Result<Vec<Option<Vec<PoseRow>>>, Failure> =
        scenes::pool(args.threads)?.install(|| sessions.par_iter().map(one).collect());
    progress.finish_and_clear();
    let rows: Option<Vec<Vec<PoseRow>>> = rows?.into_iter().collect();
    Ok(rows.map(|rows| rows.into_iter().flatten().collect()))
}
