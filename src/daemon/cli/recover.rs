//! `tumbled recover`: a finished recording from one that was interrupted or damaged, and what was lost, exactly.

use std::path::{Path, PathBuf};

use clap::Args as ClapArgs;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_io::recording::{Reader, RecordingInfo};

use super::import::{create, refuse_input_as_output, written};
use super::ledger::{self, LedgerReport, PartReport};
use super::{Failure, Outcome, output};
use crate::session::Checkpoint;

/// What `recover` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled recover session.mcap\n  \
    tumbled recover session.mcap session-0001.mcap -o whole.mcap\n\n\
    The recording itself is left as it is. Exit code 0: nothing was lost. 3: something was, or may have been; the report \
    says what. 2: nothing can be read.")]
pub struct Args {
    /// The recording, or parts of one in any order.
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// The recording to write; without it FILE.recovered.mcap beside the first.
    #[arg(short = 'o', long = "output", value_name = "FILE.mcap")]
    output: Option<PathBuf>,
    /// Replace the file if it is there.
    #[arg(long)]
    force: bool,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

/// What was recovered and what was lost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled recover --json")]
pub struct RecoverReport {
    /// The finished recording.
    pub output: PathBuf,
    /// Its size.
    pub file_bytes: u64,
    /// What it holds.
    pub ledger: LedgerReport,
    /// The parts it was made from.
    pub parts: Vec<PartReport>,
    /// Messages whose channel or content cannot be told: left out.
    pub undecodable: u64,
    /// Nothing was lost; otherwise the exit code is 3.
    pub whole: bool,
    /// What a person should know.
    pub warnings: Vec<String>,
}

/// Recovers.
///
/// # Errors
/// Exit code 2: a file that is no recording, an output that is there. 1: an output that cannot be written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let output = match (&args.output, args.files.as_slice()) {
        (Some(output), _) => output.clone(),
        (None, [first, ..]) => first.with_extension("recovered.mcap"),
        (None, []) => return Err(Failure::input("no recording is given")),
    };
    refuse_input_as_output("-o", &output, &args.files)?;
    let mut reader = Reader::open(&args.files).map_err(Failure::input)?;
    let mut header = reader.header().clone();
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let names: Vec<_> = reader.info().parts.iter().map(|part| name(&part.path)).collect();
    header.notes.insert("recovered_from".to_owned(), names.join(", "));
    let mut recorder = create(&output, header, args.force)?;
    while let Some(event) = reader.next() {
        let event = event.map_err(Failure::input)?;
        // What the session computed lies between its events.
        for result in reader.take_results() {
            if let Some(kind) = Checkpoint::from_message(&result).map(|_| Checkpoint::kind()) {
                recorder.write_result(&kind, result.t, result.seq, &result.json);
            }
        }
        if !recorder.write(&event) && recorder.summary().stopped.is_some() {
            break;
        }
    }
    let summary = recorder.finish();
    written(&summary)?;
    let report = report(output, summary.file_bytes, reader.info());
    report.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    output::report(&report, args.json, || text(&report))?;
    Ok(if report.whole { Outcome::Fine } else { Outcome::Incomplete })
}

fn report(output: PathBuf, file_bytes: u64, info: &RecordingInfo) -> RecoverReport {
    RecoverReport {
        output,
        file_bytes,
        ledger: (&info.counters).into(),
        parts: ledger::parts(info),
        undecodable: info.undecodable,
        whole: info.whole(),
        warnings: info.warnings(),
    }
}

fn text(report: &RecoverReport) -> String {
    let ledger = &report.ledger;
    let mut text = format!("{} events -> {}\n", ledger.events, report.output.display());
    for line in ledger::table(ledger) {
        text.push_str(&format!("  {line}\n"));
    }
    if let (Some(seq), Some(t_ns)) = (ledger.last_seq, ledger.last_t_ns) {
        text.push_str(&format!("  last event: seq {seq}, {:.6} s after the session's start\n", t_ns as f64 * 1e-9));
    }
    for part in &report.parts {
        let lost = match part.events_lost {
            Some(lost) => format!("{lost} events lost"),
            None => "not finished: what its last second held beyond the last event is unknown".to_owned(),
        };
        let (path, events, bytes) = (part.path.display(), part.events, part.damaged_bytes);
        text.push_str(&format!("{path}: {events} events read, {lost}, {bytes} bytes damaged\n"));
    }
    text.push_str(if report.whole { "Nothing was lost.\n" } else { "Not complete.\n" });
    text
}
