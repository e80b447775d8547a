//! What a recording says of itself and what it holds, as part of an input's report.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_io::recording::{AttachedFile, RecordingInfo};

use crate::cli::ledger::{self, LedgerReport, PartReport};

/// A recording.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RecordingReport {
    /// The session it is of.
    pub session: String,
    /// Where its events come from: live, import, simulated.
    pub origin: String,
    /// Program and commit that recorded.
    pub program: String,
    /// Wall time at its own `t_ns` 0, ns since 1970-01-01 UTC as a decimal string.
    pub unix_ns_at_zero: String,
    /// The files it was imported from.
    pub inputs: Vec<ImportedFile>,
    /// The files of the rig it carries.
    pub files: Vec<CarriedFile>,
    /// Operator, notes and the like.
    pub notes: std::collections::BTreeMap<String, String>,
    /// What it holds.
    pub ledger: LedgerReport,
    /// Its parts, in order.
    pub parts: Vec<PartReport>,
    /// Results of the session beside its ledger: checkpoints of its hash chain.
    pub results: u64,
    /// Messages whose channel or content cannot be told.
    pub undecodable: u64,
    /// Everything that was recorded in these parts is here.
    pub whole: bool,
    /// What a person should know.
    pub warnings: Vec<String>,
}

/// A file a recording was imported from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImportedFile {
    /// Its name without folders.
    pub name: String,
    /// Its size, bytes.
    pub bytes: u64,
    /// BLAKE3 of its content, hexadecimal.
    pub blake3: String,
}

/// A file the recording's config names, carried in it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CarriedFile {
    /// What the config calls it, e.g. `lidar.front.calibration`.
    pub key: String,
    /// Its name without folders.
    pub name: String,
    /// Its size, bytes.
    pub bytes: u64,
    /// BLAKE3 of its content, hexadecimal.
    pub blake3: String,
    /// The recording's copy is whole.
    pub whole: bool,
}

impl From<&RecordingInfo> for RecordingReport {
    fn from(info: &RecordingInfo) -> Self {
        let header = &info.header;
        let inputs = header.inputs.iter().map(|input| ImportedFile {
            name: input.name.clone(),
            bytes: input.bytes,
            blake3: input.blake3.clone(),
        });
        Self {
            session: header.session.clone(),
            origin: header.origin.to_string(),
            program: header.program.clone(),
            unix_ns_at_zero: header.unix_at_zero.0.to_string(),
            inputs: inputs.collect(),
            files: header.files.iter().map(carried).collect(),
            notes: header.notes.clone(),
            ledger: (&info.counters).into(),
            parts: ledger::parts(info),
            results: info.results,
            undecodable: info.undecodable,
            whole: info.whole(),
            warnings: info.warnings(),
        }
    }
}

fn carried(attached: &AttachedFile) -> CarriedFile {
    let (key, file) = (attached.key.clone(), &attached.file);
    let whole = attached.content.is_some();
    CarriedFile { key, name: file.name.clone(), bytes: file.bytes, blake3: file.blake3.clone(), whole }
}

/// Labels and values for people.
pub(super) fn lines(report: &RecordingReport) -> Vec<(&'static str, String)> {
    let mut lines = vec![("session", format!("{}, {}, by {}", report.session, report.origin, report.program))];
    let mut labelled = |label: &'static str, values: &mut dyn Iterator<Item = String>| {
        for (n, value) in values.enumerate() {
            lines.push((if n == 0 { label } else { "" }, value));
        }
    };
    let file = |input: &ImportedFile| format!("{}, {} bytes, blake3 {:.16}…", input.name, input.bytes, input.blake3);
    labelled("imported from", &mut report.inputs.iter().map(file));
    let carried =
        |file: &CarriedFile| format!("{}: {}, {} bytes, blake3 {:.16}…", file.key, file.name, file.bytes, file.blake3);
    labelled("carries", &mut report.files.iter().map(carried));
    labelled("notes", &mut report.notes.iter().map(|(key, value)| format!("{key}: {value}")));
    labelled("channels", &mut ledger::table(&report.ledger).into_iter());
    let part = |part: &PartReport| {
        let state = if part.finished { "finished" } else { "not finished" };
        format!("{}: {} events, {state}", part.path.display(), part.events)
    };
    if report.parts.len() > 1 {
        labelled("parts", &mut report.parts.iter().map(part));
    }
    if report.results > 0 {
        lines.push(("checkpoints", format!("{}: `tumbled verify` computes them anew", report.results)));
    }
    if report.ledger.missing_seqs > 0 {
        lines.push(("missing", format!("{} events of the session are not here", report.ledger.missing_seqs)));
    }
    let state = if report.whole { "complete" } else { "not complete" };
    lines.push(("state", format!("{state}: {} events read", report.ledger.events)));
    lines
}
