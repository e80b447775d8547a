//! `tumbled campaign`: what published figures come from.

use std::fs;
use std::path::PathBuf;

use clap::Args as ClapArgs;

use super::experiment::{lines, write};
use super::{Failure, Outcome, VERSION, output};
use crate::experiment::campaign::{CampaignFile, CampaignReport};
use crate::experiment::machine::Machine;
use crate::experiment::registration::{Runner, Set};

/// What `campaign` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled campaign registration -o campaign/\n  \
    tumbled campaign registration -o rehearsal/ --pairs 10\n\n\
    Writes campaign.json, campaign.html, campaign.md (a table for documentation) and trials.jsonl (a line for each \
    registration). The same file and seed give the same figures, times apart.\n\
    Exit code 3: a figure is not what it must be.")]
pub struct Args {
    /// A campaign of the program's (registration) or a file.
    #[arg(value_name = "FILE.toml")]
    campaign: PathBuf,
    /// The folder to write; it is made if it is not there.
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    output: PathBuf,
    /// Another number of pairs of every set: a rehearsal.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pairs: Option<u64>,
    /// Another seed than the file's: fresh pairs.
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Registrations at a time; 0 = one for each processor. With more than one, times are those of a shared machine.
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
    let mut file = CampaignFile::read(&args.campaign)?;
    file.seed = args.seed.unwrap_or(file.seed);
    fs::create_dir_all(&args.output)
        .map_err(|error| Failure::failed(format!("cannot make {}: {error}", args.output.display())))?;
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
    if args.json {
        output::json(&report)?
    } else {
        output::text(&report.text())?
    }
    Ok(if report.holds { Outcome::Fine } else { Outcome::Incomplete })
}
