//! `tumbled experiment`: the published experiments, on simulated sensors or a recording.

mod pose;
mod reconstruction;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::{Args as ClapArgs, Subcommand};
use serde::Serialize;
use tumbled_core::register::Method;
use tumbled_model::Span;

use super::{ConfigArgs, Failure, InputArgs, Outcome, VERSION, output};
use crate::experiment::machine::Machine;
use crate::experiment::recorded::{self, Wanted};
use crate::experiment::registration::{self, DENSITIES, ExperimentReport, PAIRS, Row, Runner, Set};
use crate::experiment::sweep::{self, Parameter, SweepPoint};
use crate::experiment::trial::method_named;
use crate::experiment::{Pair, PointCounts, Start, Trial, page, stored, text};
use crate::quantity;

/// Which experiment.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Register Kinect clouds onto LiDAR clouds by every method: success, errors, residuals, milliseconds, NEES.
    Registration(Args),
    /// Turn a target in steps about x, y and z: attitude and axis at its rests by every method, or steps of a recording.
    Pose(pose::Args),
    /// Make models of targets that turn once: distance to the true surface, completeness, contour, loop closure.
    Reconstruction(reconstruction::Args),
}

/// What `experiment registration` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled experiment registration -o out/\n  \
    tumbled experiment registration --points 2653/358 --method cga,gicp --pairs 100 --json\n  \
    tumbled experiment registration --sweep m,n,rho,epsilon -o sweep/\n  \
    tumbled experiment registration --from run.mcap --pairs 40\n\n\
    Simulated: a box bus in the published attitudes (16 steps of 22.5 degrees about x, y and z), sensors side by side \
    (`views`) and 40 to 80 degrees apart (`low-overlap`), at the published numbers of points. The same seed gives the same \
    figures, times apart.\n\
    With -o: report.json, report.html and trials.jsonl (a line for each registration).")]
pub struct Args {
    /// Recordings, captures or scenes instead of simulated pairs: LiDAR crossings with the nearest Kinect frames.
    #[arg(long, value_name = "INPUT", num_args = 1..)]
    from: Vec<PathBuf>,
    #[command(flatten)]
    config: ConfigArgs,
    /// cga-paper against its parameters instead: some of m,n,rho,epsilon.
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    sweep: Vec<Parameter>,
    /// Points of Kinect and LiDAR, e.g. 2653/358; several with commas. [default: the published ones; with --from and --sweep
    /// 2653/358]
    #[arg(long, value_name = "K/L", value_delimiter = ',', value_parser = points)]
    points: Vec<PointCounts>,
    /// Methods, with commas. [default: all]
    #[arg(long, value_name = "METHOD", value_delimiter = ',', value_parser = method_named)]
    method: Vec<Method>,
    /// Pairs of a set. The published attitudes are 48.
    #[arg(long, value_name = "N", default_value_t = PAIRS, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pairs: u64,
    /// With --from: at least so long from pair to pair.
    #[arg(long, value_parser = quantity::duration, value_name = "TIME", default_value = "500ms")]
    every: Duration,
    /// Everything random follows from it.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// The folder for report.json, report.html and trials.jsonl; it is made if it is not there.
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    output: Option<PathBuf>,
    /// Write the pairs too: DIR/pairs/SET-K-L/NNNN-kinect.ply, -lidar.ply, -truth.json and -prior.json (10 degrees and
    /// 10 cm off the truth), for other programs.
    #[arg(long, requires = "output")]
    store: bool,
    /// Registrations at a time; 0 = one for each processor. With more than one, times are those of a shared machine.
    #[arg(long, value_name = "N", default_value_t = 1)]
    threads: usize,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

/// Points as they are written: `2653/358`.
pub(super) fn points(text: &str) -> Result<PointCounts, String> {
    let counts = text.split_once('/').and_then(|(kinect, lidar)| {
        Some(PointCounts { kinect: kinect.trim().parse().ok()?, lidar: lidar.trim().parse().ok()? })
    });
    let fine = counts.filter(|counts| (10..=50_000).contains(&counts.kinect) && (10..=5_000).contains(&counts.lidar));
    fine.ok_or_else(|| "expected Kinect/LiDAR points, 10 to 50000 and 10 to 5000, e.g. 2653/358".to_owned())
}

/// A registration as a line of trials.jsonl.
#[derive(Debug, Serialize)]
pub(super) struct TrialLine<'a> {
    pub(super) set: &'a str,
    pub(super) kinect_points: u64,
    pub(super) lidar_points: u64,
    pub(super) method: &'a str,
    pub(super) start: Start,
    #[serde(flatten)]
    pub(super) trial: &'a Trial,
}

/// Carries out an experiment.
///
/// # Errors
/// Exit code 2: inputs, points or a config that cannot be used. 1: a folder that cannot be written.
pub fn run(command: Command) -> Result<Outcome, Failure> {
    match command {
        Command::Registration(args) => registration(&args),
        Command::Pose(args) => pose::run(&args),
        Command::Reconstruction(args) => reconstruction::run(&args),
    }
}

fn registration(args: &Args) -> Result<Outcome, Failure> {
    if let Some(folder) = &args.output {
        fs::create_dir_all(folder)
            .map_err(|error| Failure::failed(format!("cannot make {}: {error}", folder.display())))?;
    }
    let machine = Machine::this();
    if machine.build != "release" {
        tracing::warn!("this is no release build: its times mean nothing");
    }
    let measured = if args.from.is_empty() { simulated(args)? } else { of_inputs(args)? };
    let report = ExperimentReport {
        program: VERSION.to_owned(),
        machine,
        source: measured.source,
        truth: measured.truth.to_owned(),
        seed: args.seed,
        threads: args.threads as u64,
        rows: measured.rows,
        sweep: measured.sweep,
        warnings: measured.warnings,
    };
    report.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    if let Some(folder) = &args.output {
        write_report(folder, &report, &page::experiment(&report))?;
        write(folder, "trials.jsonl", &measured.trials)?;
    }
    output::report(&report, args.json, || text::report(&report))?;
    Ok(Outcome::Fine)
}

/// What came out, and where from.
struct Measured {
    source: Vec<String>,
    truth: &'static str,
    rows: Vec<Row>,
    sweep: Vec<SweepPoint>,
    trials: Vec<u8>,
    warnings: Vec<String>,
}

fn methods(args: &Args) -> Vec<Method> {
    if args.method.is_empty() { Method::ALL.to_vec() } else { args.method.clone() }
}

/// The published density in the middle.
const USUAL: PointCounts = PointCounts { kinect: 2653, lidar: 358 };

fn simulated(args: &Args) -> Result<Measured, Failure> {
    let densities = match (args.points.is_empty(), args.sweep.is_empty()) {
        (false, _) => args.points.clone(),
        (true, true) => DENSITIES.to_vec(),
        (true, false) => vec![USUAL],
    };
    let sets = registration::sets(&densities, &methods(args), args.pairs, args.seed);
    let mut measured = Measured {
        source: vec!["simulated".to_owned()],
        truth: "simulated",
        rows: Vec::new(),
        sweep: Vec::new(),
        trials: Vec::new(),
        warnings: Vec::new(),
    };
    if let (false, Some(set)) = (args.sweep.is_empty(), sets.first()) {
        let mut runner = Runner::new(args.threads, sweep::trials(&args.sweep, set.pairs))?;
        let pairs = runner.make(set, 0..set.pairs)?;
        measured.sweep = sweep::run(&args.sweep, &pairs, &mut runner);
        runner.finish();
        return Ok(measured);
    }
    let mut runner = Runner::new(args.threads, sets.iter().map(Set::trials).sum())?;
    for set in &sets {
        let trials = runner.run(set)?;
        let rows = set.rows(&trials);
        lines(&rows, &trials, &mut measured.trials)?;
        measured.rows.extend(rows);
        if let (true, Some(folder)) = (args.store, &args.output) {
            // Made once more: a set's pairs are never all held.
            for number in 0..set.pairs {
                let pair = runner.make(set, number..number + 1)?;
                store(folder, &set.name, set.spec.points, &pair, set.seed)?;
            }
        }
    }
    runner.finish();
    Ok(measured)
}

fn store(folder: &Path, set: &str, points: PointCounts, pairs: &[Pair], seed: u64) -> Result<(), Failure> {
    let folder = folder.join("pairs").join(format!("{set}-{}-{}", points.kinect, points.lidar));
    let write = |pair: &Pair| stored::write(pair, Start::PRIOR.prior(pair, seed).as_ref(), &folder);
    let written = fs::create_dir_all(&folder).and_then(|()| pairs.iter().try_for_each(write));
    written.map_err(|error| Failure::failed(format!("cannot write {}: {error}", folder.display())))
}

fn of_inputs(args: &Args) -> Result<Measured, Failure> {
    let input = InputArgs { inputs: args.from.clone(), config: args.config.clone() };
    let points = args.points.first().copied().unwrap_or(USUAL);
    let every = Span(i64::try_from(args.every.as_nanos()).unwrap_or(i64::MAX));
    let wanted = Wanted { points, pairs: args.pairs, every, seed: args.seed, threads: args.threads };
    let found = recorded::pairs(&input, &wanted)?;
    let mut measured = Measured {
        source: args.from.iter().map(|path| path.display().to_string()).collect(),
        truth: found.truth.name(),
        rows: Vec::new(),
        sweep: Vec::new(),
        trials: Vec::new(),
        warnings: found.warnings,
    };
    if let (true, Some(folder)) = (args.store, &args.output) {
        store(folder, "recorded", points, &found.pairs, args.seed)?;
    }
    if !args.sweep.is_empty() {
        let mut runner = Runner::new(args.threads, sweep::trials(&args.sweep, found.pairs.len() as u64))?;
        measured.sweep = sweep::run(&args.sweep, &found.pairs, &mut runner);
        runner.finish();
        return Ok(measured);
    }
    let mut runs = registration::runs(&methods(args));
    if found.truth == recorded::Truth::None {
        // Without a truth there is nothing that a prior could be off by.
        runs.retain(|(_, start)| *start == Start::Global);
    }
    let runner = Runner::new(args.threads, (runs.len() * found.pairs.len()) as u64)?;
    let trials: Vec<Vec<Trial>> = runs.iter().map(|run| runner.register(&found.pairs, *run, args.seed)).collect();
    runner.finish();
    measured.rows = registration::rows("recorded", points, &runs, &trials);
    lines(&measured.rows, &trials, &mut measured.trials)?;
    Ok(measured)
}

/// Appends the trials of some rows as lines.
pub(super) fn lines(rows: &[Row], trials: &[Vec<Trial>], to: &mut Vec<u8>) -> Result<(), Failure> {
    for (row, trials) in rows.iter().zip(trials) {
        for trial in trials {
            let Row { set, kinect_points, lidar_points, method, start, .. } = row;
            let (kinect_points, lidar_points, start) = (*kinect_points, *lidar_points, *start);
            serde_json::to_writer(&mut *to, &TrialLine { set, kinect_points, lidar_points, method, start, trial })
                .map_err(Failure::failed)?;
            to.push(b'\n');
        }
    }
    Ok(())
}

/// Writes a file of a report's folder.
pub(super) fn write(folder: &Path, name: &str, bytes: &[u8]) -> Result<(), Failure> {
    output::file(&folder.join(name), bytes)
}

/// Writes report.json and report.html into a folder.
pub(super) fn write_report(folder: &Path, report: &impl Serialize, page: &str) -> Result<(), Failure> {
    let json = serde_json::to_string_pretty(report).map_err(Failure::failed)? + "\n";
    write(folder, "report.json", json.as_bytes())?;
    write(folder, "report.html", page.as_bytes())
}
