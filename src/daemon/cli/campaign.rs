//! `tumbled campaign`: what published figures come from.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use clap::Args as ClapArgs;

use super::experiment::{lines, write};
use super::{Failure, Outcome, VERSION, output, signals};
use crate::experiment::campaign::pose::{PoseCampaignFile, PoseCampaignReport, runner};
use crate::experiment::campaign::{Campaign, CampaignFile, CampaignReport};
use crate::experiment::machine::Machine;
use crate::experiment::registration::{Runner, Set};

/// What `campaign` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled campaign registration -o campaign/\n  \
    tumbled campaign registration -o rehearsal/ --pairs 10\n  \
    tumbled campaign pose -o pose/ --threads 0\n  \
    tumbled campaign pose -o rehearsal/ --seeds 2 --threads 0\n\n\
    Writes campaign.json, campaign.html, campaign.md (a table for documentation) and trials.jsonl (a line for each \
    registration, or for each session, config and interval). The same file and seed give the same figures, times apart, \
    on any number of threads.\n\
    Exit code 3: a figure is not what it must be.")]
pub struct Args {
    /// A campaign of the program's (registration, pose) or a file.
    #[arg(value_name = "FILE.toml")]
    campaign: PathBuf,
    /// The folder to write; it is made if it is not there.
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    output: PathBuf,
    /// Another number of pairs of every set: a rehearsal.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pairs: Option<u64>,
    /// Another number of seeds of every scene of a pose campaign: a rehearsal.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=10_000), conflicts_with = "pairs")]
    seeds: Option<u64>,
    /// Another seed than the file's: fresh pairs, or fresh sessions from this seed on.
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Registrations or simulated sessions at a time; 0 = one for each processor. With more than one, times of
    /// registrations are those of a shared machine.
    #[arg(long, value_name = "N", default_value_t = 1)]
    threads: usize,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

/// Measures.
///
/// # Errors
/// Exit code 2: a file that is no campaign. 1: a folder that cannot be written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let campaign = Campaign::read(&args.campaign)?;
    let wrong = |option: &str, kind: &str| {
        Err(Failure::input(format!("{option} is of a campaign of {kind}, and {} is none", args.campaign.display())))
    };
    match campaign {
        Campaign::Registration(_) if args.seeds.is_some() => wrong("--seeds", "pose"),
        Campaign::Pose(_) if args.pairs.is_some() => wrong("--pairs", "registration"),
        Campaign::Registration(file) => registration(args, file),
        Campaign::Pose(file) => pose(args, file),
    }
}

fn folder(path: &Path) -> Result<(), Failure> {
    fs::create_dir_all(path).map_err(|error| Failure::failed(format!("cannot make {}: {error}", path.display())))
}

fn pose(args: &Args, mut file: PoseCampaignFile) -> Result<Outcome, Failure> {
    file.seed = args.seed.unwrap_or(file.seed);
    file.rehearse()?;
    folder(&args.output)?;
    if Machine::this().build != "release" {
        tracing::warn!("this is no release build: it takes many times as long");
    }
    // Line by line as sessions end: what was measured before a stop is not lost. In the end in the campaign's order.
    let path = args.output.join("trials.jsonl");
    let log =
        File::create(&path).map_err(|error| Failure::failed(format!("cannot write {}: {error}", path.display())))?;
    let Some(trials) = runner::run(&file, args.seeds, args.threads, log, &signals::stop_token()?)? else {
        tracing::warn!("stopped before the end: {} has the sessions that were over", path.display());
        return Ok(Outcome::Incomplete);
    };
    let report = PoseCampaignReport::new(&file, &trials, VERSION, args.seeds.is_none());
    let mut trial_lines = Vec::new();
    for trial in &trials {
        serde_json::to_writer(&mut trial_lines, trial).map_err(Failure::failed)?;
        trial_lines.push(b'\n');
    }
    let json = serde_json::to_string_pretty(&report).map_err(Failure::failed)? + "\n";
    write(&args.output, "campaign.json", json.as_bytes())?;
    write(&args.output, "campaign.html", report.page(&trials).as_bytes())?;
    write(&args.output, "campaign.md", report.markdown(&trials).as_bytes())?;
    write(&args.output, "trials.jsonl", &trial_lines)?;
    output::report(&report, args.json, || report.text(&trials))?;
    Ok(if report.holds { Outcome::Fine } else { Outcome::Incomplete })
}

fn registration(args: &Args, mut file: CampaignFile) -> Result<Outcome, Failure> {
    file.seed = args.seed.unwrap_or(file.seed);
    folder(&args.output)?;
    if Machine::this().build != "release" {
        tracing::warn!("this is no release build: its times mean nothing");
    }
    let sets = file.sets(args.pairs);
    let mut runner = Runner::new(args.threads, sets.iter().map(Set::trials).sum())?;
    let (mut measured, mut trial_lines) = (Vec::new(), Vec::new());
    for set in sets {
        let trials = runner.run(&set)?;
        lines(&set.rows(&trials), &trials, &mut trial_lines)?;
        measured.push((set, trials));
    }
    runner.finish();
    let report = CampaignReport::new(&file, &measured, VERSION, args.threads as u64, args.pairs.is_none());
    let json = serde_json::to_string_pretty(&report).map_err(Failure::failed)? + "\n";
    write(&args.output, "campaign.json", json.as_bytes())?;
    write(&args.output, "campaign.html", report.page().as_bytes())?;
    write(&args.output, "campaign.md", report.markdown().as_bytes())?;
    write(&args.output, "trials.jsonl", &trial_lines)?;
    output::report(&report, args.json, || report.text())?;
    Ok(if report.holds { Outcome::Fine } else { Outcome::Incomplete })
}
