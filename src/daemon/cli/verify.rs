//! `tumbled verify`: computes a recorded session anew and compares it with what it was.

use std::path::PathBuf;

use clap::Args as ClapArgs;
use indicatif::ProgressBar;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_io::recording::{Reader, RecordingInfo};

use super::{Failure, Outcome, VERSION, output};
use crate::config::{self, Recorded};
use crate::session::chain::rig_digest;
use crate::session::{Checkpoint, Engine, engine, setup};

/// What `verify` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled verify run.mcap\n  tumbled verify run.mcap run-0001.mcap --json\n\n\
    A recording of `tumbled run --record` or `tumbled replay --record` holds a hash chain over its events, epochs, notices \
    and health, a checkpoint a second. `verify` computes them anew from the recorded events, config and files.\n\
    Exit code 0: match. 1: they differ; the first difference is told. 2: no recording. 3: nothing to compare with, or \
    the recording is damaged or incomplete.")]
pub struct Args {
    /// The recording, or parts of one in any order.
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// Threads of the core; 0 = one for each processor. Changes no result.
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

/// How a recording compares with its recomputation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Every checkpoint is the same.
    Match,
    /// Some are not.
    Different,
    /// The recording has no checkpoints: it was made by `record` or `import`.
    NothingToCompare,
}

/// Where a recomputation first differs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FirstDifference {
    /// The checkpoint after it, ns on the session's timeline.
    pub t_ns: i64,
    /// The newest checkpoint before it that is the same, ns; null: there is none.
    pub same_until_ns: Option<i64>,
    /// What differs: `rig` (config or files), `ledger` (the events are not those of the session), `epochs`, `notices`, `health`, `missing` (the
    /// recomputation has no such checkpoint).
    pub fields: Vec<String>,
    /// As it was recorded.
    pub recorded: Checkpoint,
    /// As it was computed; null: there is none.
    pub computed: Option<Checkpoint>,
}

/// What was found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled verify --json")]
pub struct VerifyReport {
    /// The session.
    pub session: String,
    /// The program that made the recording.
    pub recorded_by: String,
    /// The program that verified it.
    pub verified_by: String,
    /// How they compare.
    pub verdict: Verdict,
    /// Checkpoints compared.
    pub checkpoints: u64,
    /// Of them, those that hold the hash of the events alone: the recording began in mid-session, where the target was known
    /// already, and what is computed anew begins without it.
    #[serde(default)]
    pub checkpoints_of_events: u64,
    /// Events of the ledger.
    pub events: u64,
    /// Epochs computed.
    pub epochs: u64,
    /// One hash over everything that came out, as `tumbled replay --digest` prints it.
    pub digest: String,
    /// BLAKE3 of the config as the recording has it.
    pub config: String,
    /// The rig's files as the recording has them: key and BLAKE3.
    pub files: Vec<RigFileDigest>,
    /// The first difference.
    pub difference: Option<FirstDifference>,
    /// Nothing of the recording is damaged or missing.
    pub complete: bool,
    /// What a person should know.
    pub warnings: Vec<String>,
}

/// A file of the rig.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RigFileDigest {
    /// The key of the config that names it.
    pub key: String,
    /// BLAKE3, 64 hex digits.
    pub blake3: String,
}

/// Verifies.
///
/// # Errors
/// Exit code 2: a file that is no recording, a config that this version cannot read.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let mut reader = Reader::open(&args.files).map_err(Failure::input)?;
    let header = reader.header().clone();
    let path = args.files.first().cloned().unwrap_or_default();
    let config = config::load_recorded(Recorded { path, header: header.clone() }, &[])?.config;
    let core = setup::core_config(&config)?;
    let rig = rig_digest(&header.config, &header.files);
    let interpreter = engine::interpreter(&config, false);
    let mut engine = Engine::new(core, rig, engine::workers(args.threads)?, interpreter);
    let mut comparison = Comparison::default();
    compute(&mut reader, &mut engine, &mut comparison)?;
    let report = report(&engine, comparison, reader.info());
    report.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    output::report(&report, args.json, || text(&report))?;
    Ok(match report.verdict {
        Verdict::Different => Outcome::Different,
        Verdict::Match if report.complete => Outcome::Fine,
        Verdict::Match | Verdict::NothingToCompare => Outcome::Incomplete,
    })
}

/// Every event through the core, every checkpoint against the recorded one.
fn compute(reader: &mut Reader, engine: &mut Engine, comparison: &mut Comparison) -> Result<(), Failure> {
    let progress = ProgressBar::new_spinner();
    while let Some(event) = reader.next() {
        let event = event.map_err(Failure::input)?;
        comparison.take(&mut *reader, engine);
        if let Some(checkpoint) = engine.step(&event).checkpoint {
            comparison.computed(checkpoint);
            progress.set_position(engine.checkpoint().events); // draws on a terminal only
        }
    }
    comparison.take(reader, engine);
    engine.finish();
    comparison.computed(engine.checkpoint());
    progress.finish_and_clear();
    Ok(())
}

/// Recorded and computed checkpoints, side by side. Either may be ahead: a session records them when it can.
#[derive(Debug, Default)]
struct Comparison {
    recorded: std::collections::VecDeque<Checkpoint>,
    computed: std::collections::VecDeque<Checkpoint>,
    compared: u64,
    /// Of them, those of the events alone.
    of_events: u64,
    same_until: Option<i64>,
    difference: Option<FirstDifference>,
}

/// Checkpoints of one side that wait for the other: an hour of them.
const WAITING: usize = 3_600;

impl Comparison {
    /// What the recording holds between the event that the engine had last and the next.
    fn take(&mut self, reader: &mut Reader, engine: &Engine) {
        let checkpoints = reader.take_results();
        let checkpoints = checkpoints.iter().filter_map(Checkpoint::from_message);
        let (of_events, whole): (Vec<_>, Vec<_>) = checkpoints.partition(Checkpoint::is_of_events_alone);
        for recorded in of_events {
            // Its witness wrote it right after its event.
            let computed = engine.checkpoint().of_events_alone();
            self.of_events += 1;
            self.pair(&recorded, Some(&computed), recorded.differences(&computed));
        }
        self.recorded(whole.into_iter());
    }

    /// A recorded checkpoint beside the computed one of the same place.
    fn pair(&mut self, recorded: &Checkpoint, computed: Option<&Checkpoint>, fields: Vec<&str>) {
        self.compared += 1;
        if fields.is_empty() {
            self.same_until = Some(recorded.t_ns);
        } else if self.difference.is_none() {
            self.difference = Some(FirstDifference {
                t_ns: recorded.t_ns,
                same_until_ns: self.same_until,
                fields: fields.into_iter().map(str::to_owned).collect(),
                recorded: recorded.clone(),
                computed: computed.cloned(),
            });
        }
    }

    fn recorded(&mut self, checkpoints: impl Iterator<Item = Checkpoint>) {
        self.recorded.extend(checkpoints);
        self.compare();
    }

    fn computed(&mut self, checkpoint: Checkpoint) {
        self.computed.push_back(checkpoint);
        self.compare();
        if self.computed.len() > WAITING {
            self.computed.pop_front();
        }
    }

    /// Pairs what both sides have by the event it follows; a session that was killed has fewer.
    fn compare(&mut self) {
        while let (Some(recorded), Some(computed)) = (self.recorded.front(), self.computed.front()) {
            if computed.seq < recorded.seq || (computed.seq == recorded.seq && computed.t_ns < recorded.t_ns) {
                self.computed.pop_front();
                continue;
            }
            let (recorded, computed) = (recorded.clone(), computed.clone());
            if recorded.seq == computed.seq {
                self.pair(&recorded, Some(&computed), recorded.differences(&computed));
                self.computed.pop_front();
            } else {
                self.pair(&recorded, None, vec!["missing"]);
            }
            self.recorded.pop_front();
        }
    }

    /// What was recorded beyond the last that was computed is missing.
    fn finish(mut self) -> (u64, u64, Option<FirstDifference>) {
        if let (Some(recorded), None) = (self.recorded.pop_front(), &self.difference) {
            self.difference = Some(FirstDifference {
                t_ns: recorded.t_ns,
                same_until_ns: self.same_until,
                fields: vec!["missing".to_owned()],
                recorded,
                computed: None,
            });
        }
        (self.compared, self.of_events, self.difference)
    }
}

fn report(engine: &Engine, comparison: Comparison, info: &RecordingInfo) -> VerifyReport {
    let (checkpoints, checkpoints_of_events, difference) = comparison.finish();
    let mut warnings = info.warnings();
    let verdict = match (&difference, checkpoints) {
        (Some(_), _) => Verdict::Different,
        (None, 0) => Verdict::NothingToCompare,
        (None, _) => Verdict::Match,
    };
    if verdict == Verdict::NothingToCompare {
        warnings.push(
            "the recording holds no checkpoints: `tumbled replay FILE --record NEW` makes one that does".to_owned(),
        );
    }
    let header = &info.header;
    let end = engine.checkpoint();
    VerifyReport {
        session: header.session.clone(),
        recorded_by: header.program.clone(),
        verified_by: VERSION.to_owned(),
        verdict,
        checkpoints,
        checkpoints_of_events,
        events: end.events,
        epochs: end.epochs,
        digest: end.outputs_digest(),
        config: blake3::hash(header.config.as_bytes()).to_hex().to_string(),
        files: header
            .files
            .iter()
            .map(|file| RigFileDigest { key: file.key.clone(), blake3: file.file.blake3.clone() })
            .collect(),
        difference,
        complete: info.whole() && info.continued_in().is_none(),
        warnings,
    }
}

fn text(report: &VerifyReport) -> String {
    let VerifyReport { checkpoints, events, epochs, digest, .. } = report;
    let counts = format!("{checkpoints} checkpoints, {events} events, {epochs} epochs, digest {digest}\n");
    match (&report.verdict, &report.difference) {
        (Verdict::Different, Some(difference)) => {
            let seconds = |ns: i64| ns as f64 * 1e-9;
            let since = difference
                .same_until_ns
                .map_or_else(|| "from its start".to_owned(), |same| format!("the same until {:.3} s", seconds(same)));
            let mut text =
                format!("different: {} at {:.3} s ({since})\n", difference.fields.join(", "), seconds(difference.t_ns));
            if report.recorded_by != report.verified_by {
                text.push_str(&format!(
                    "  recorded by {}, verified by {}: another version may compute other results\n",
                    report.recorded_by, report.verified_by
                ));
            }
            text + "  " + &counts
        }
        (Verdict::NothingToCompare, _) => format!("nothing to compare with: {counts}"),
        _ if report.checkpoints_of_events > 0 => format!(
            "match: {counts}  the events alone: this is a part of a session, and its replay acquires the target anew\n"
        ),
        _ => format!("match: {counts}"),
    }
}
