//! `tumbled experiment reconstruction`: models against true surfaces.

use std::fs;
use std::path::PathBuf;

use clap::Args as ClapArgs;
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;
use tumbled_sim::target::TargetKind;

use super::write_report;
use crate::cli::{Failure, Outcome, VERSION, output, signals};
use crate::experiment::machine::Machine;
use crate::experiment::reconstruction::ReconstructionReport;
use crate::experiment::reconstruction::trial::{Row, TARGETS, Trial};
use crate::simulation::rig::View;
use crate::simulation::scenes;

/// What `experiment reconstruction` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled experiment reconstruction -o out/ --threads 0\n  \
    tumbled experiment reconstruction --target box --seeds 2 --true-config --json\n\n\
    Simulated: a target that turns once at 20 degrees a second, seen by a VLP-32C and a Kinect. Models of both sensors and of \
    each alone, with points put on planes and without, are laid on the true surface and held against it.\n\
    With -o: report.json and report.html.\n\
    Exit code 3: of some session there is no model.")]
pub struct Args {
    /// The targets, with commas: box, hex. [default: both]
    #[arg(long, value_name = "TARGET", value_delimiter = ',', value_parser = target)]
    target: Vec<(&'static str, TargetKind)>,
    /// Seeds of each target.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=1_000))]
    seeds: u64,
    /// The first seed; the others follow it.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// With the true mountings and times instead of what an operator would have.
    #[arg(long)]
    true_config: bool,
    /// The folder for report.json and report.html; it is made if it is not there.
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    output: Option<PathBuf>,
    /// Sessions at a time; 0 = one for each processor. Changes no result.
    #[arg(long, value_name = "N", default_value_t = 1)]
    threads: usize,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

fn target(text: &str) -> Result<(&'static str, TargetKind), String> {
    TARGETS.into_iter().find(|(name, _)| *name == text).ok_or_else(|| "expected box or hex".to_owned())
}

/// Carries the experiment out.
///
/// # Errors
/// A folder that cannot be written: exit code 1.
pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    if let Some(folder) = &args.output {
        fs::create_dir_all(folder)
            .map_err(|error| Failure::failed(format!("cannot make {}: {error}", folder.display())))?;
    }
    let view = if args.true_config { View::Truth } else { View::Operator };
    let targets = if args.target.is_empty() { TARGETS.to_vec() } else { args.target.clone() };
    let seeds = args.seed..args.seed.saturating_add(args.seeds);
    let trial = |target, seed| Trial { target, seed, view };
    let trials: Vec<Trial> =
        targets.iter().flat_map(|target| seeds.clone().map(move |seed| trial(*target, seed))).collect();
    let stop = signals::stop_token()?;
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} sessions  {elapsed_precise}");
    let progress =
        ProgressBar::new(trials.len() as u64).with_style(style.unwrap_or_else(|_error| ProgressStyle::default_bar()));
    let one = |trial: &Trial| {
        let rows = trial.run(&stop);
        progress.inc(1);
        rows
    };
    let rows: Result<Vec<Option<Vec<Row>>>, Failure> =
        scenes::pool(args.threads)?.install(|| trials.par_iter().map(one).collect());
    progress.finish_and_clear();
    let rows = rows?;
    let stopped = rows.iter().any(Option::is_none);
    let rows: Vec<Row> = rows.into_iter().flatten().flatten().collect();
    let modelless = rows.iter().filter(|row| row.points == 0).count();
    let mut warnings = Vec::new();
    if stopped {
        warnings.push("the experiment was stopped before its end".to_owned());
    }
    if modelless > 0 {
        warnings.push(format!("{modelless} of {} rows have no model", rows.len()));
    }
    let report = ReconstructionReport {
        program: VERSION.to_owned(),
        machine: Machine::this(),
        view,
        seed: args.seed,
        seeds: args.seeds,
        rows,
        warnings,
    };
    report.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    if let Some(folder) = &args.output {
        write_report(folder, &report, &report.page())?;
    }
    output::report(&report, args.json, || report.text())?;
    Ok(if report.warnings.is_empty() { Outcome::Fine } else { Outcome::Incomplete })
}
