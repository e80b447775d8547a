//! `tumbled diff`: the first event and field in which two ledgers differ.

use std::path::{Path, PathBuf};

use clap::Args as ClapArgs;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_io::recording::{ChannelKey, RecordingHeader, compare};
use tumbled_model::Event;

use super::{ConfigArgs, Failure, Outcome, output};
use crate::config::Config;
use crate::decoding::Inputs;

/// What `diff` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled diff live.mcap replayed.mcap\n  tumbled diff drive.pcap drive.mcap\n\n\
    Events are compared by their place: number, arrival, channel, then every field. What the recordings say of \
    themselves is listed where it differs, but decides nothing.\n\
    Exit code 0: equal. 1: different. 3: equal as far as they can be read, but part of one cannot be.")]
pub struct Args {
    /// A recording; or a foreign capture, which is compared as `import` would record it.
    #[arg(value_name = "A")]
    a: PathBuf,
    /// Another.
    #[arg(value_name = "B")]
    b: PathBuf,
    #[command(flatten)]
    config: ConfigArgs,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

/// How two ledgers compare.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled diff --json")]
pub struct DiffReport {
    /// Every event is the same; otherwise the exit code is 1.
    pub equal: bool,
    /// Events of A.
    pub events_a: u64,
    /// Events of B.
    pub events_b: u64,
    /// Events that differ from the one in the same place; those that the other has no place for count too.
    pub events_different: u64,
    /// The first difference; null: there is none.
    pub first: Option<FirstDifference>,
    /// What the recordings say of themselves and not the same way; decides nothing.
    pub header: Vec<HeaderDifference>,
    /// Both could be read whole.
    pub whole: bool,
    /// What a person should know.
    pub warnings: Vec<String>,
}

/// The first difference.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FirstDifference {
    /// Place of the event, from 0.
    pub place: u64,
    /// The event in A; null: A has ended.
    pub a: Option<EventAt>,
    /// The event in B; null: B has ended.
    pub b: Option<EventAt>,
    /// The first field that differs; null: one of them has ended.
    pub field: Option<String>,
    /// Its value in A.
    pub value_a: Option<String>,
    /// Its value in B.
    pub value_b: Option<String>,
}

/// Which event.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EventAt {
    /// Its number in the ledger.
    pub seq: u64,
    /// When it arrived, ns on the session's timeline.
    pub t_ns: i64,
    /// Its channel.
    pub channel: String,
}

/// A field of the recordings' own words.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HeaderDifference {
    /// The field.
    pub field: String,
    /// Its value in A; of texts, their lengths.
    pub a: String,
    /// Its value in B.
    pub b: String,
}

/// Compares.
///
/// # Errors
/// Exit code 2: an input that cannot be used.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let loaded = args.config.load()?;
    let (mut a, mut b) = (open(&args.a, &loaded.config)?, open(&args.b, &loaded.config)?);
    let report = compare_all(&mut a, &mut b)?;
    report.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    output::report(&report, args.json, || text(&report))?;
    Ok(match (report.equal, report.whole) {
        (false, _) => Outcome::Different,
        (true, true) => Outcome::Fine,
        (true, false) => Outcome::Incomplete,
    })
}

fn open(path: &Path, config: &Config) -> Result<Inputs, Failure> {
    Inputs::open_ledger(&[path], config, 0)
}

fn compare_all(a: &mut Inputs, b: &mut Inputs) -> Result<DiffReport, Failure> {
    let (mut events_a, mut events_b, mut events_different) = (0, 0, 0);
    let mut first = None;
    for place in 0.. {
        let (event_a, event_b) = (a.next_event()?, b.next_event()?);
        if event_a.is_none() && event_b.is_none() {
            break;
        }
        events_a += u64::from(event_a.is_some());
        events_b += u64::from(event_b.is_some());
        if event_a != event_b {
            events_different += 1;
            first.get_or_insert_with(|| difference(place, event_a.as_ref(), event_b.as_ref()));
        }
    }
    Ok(DiffReport {
        equal: events_different == 0,
        events_a,
        events_b,
        events_different,
        first,
        header: a.recording().zip(b.recording()).map_or_else(Vec::new, |(a, b)| headers(a, b)),
        whole: !a.data_lost() && !b.data_lost(),
        warnings: [a.warnings(), b.warnings()].concat(),
    })
}

fn difference(place: u64, a: Option<&Event>, b: Option<&Event>) -> FirstDifference {
    let at = |event: &Event| EventAt {
        seq: event.seq,
        t_ns: event.arrived.0,
        channel: ChannelKey::of(&event.body).map_or_else(String::new, |channel| channel.to_string()),
    };
    let field = a.zip(b).and_then(|(a, b)| compare(a, b));
    FirstDifference {
        place,
        a: a.map(at),
        b: b.map(at),
        field: field.as_ref().map(|difference| difference.field.to_owned()),
        value_a: field.as_ref().map(|difference| difference.a.clone()),
        value_b: field.map(|difference| difference.b),
    }
}

fn headers(a: &RecordingHeader, b: &RecordingHeader) -> Vec<HeaderDifference> {
    let length = |text: &str| format!("{} bytes", text.len());
    let inputs = |header: &RecordingHeader| {
        let inputs = header.inputs.iter().map(|input| format!("{} {}", input.name, input.blake3));
        inputs.collect::<Vec<_>>().join(", ")
    };
    let files = |header: &RecordingHeader| {
        let files = header.files.iter().map(|attached| format!("{} {}", attached.key, attached.file.blake3));
        files.collect::<Vec<_>>().join(", ")
    };
    let zero = |header: &RecordingHeader| header.unix_at_zero.0.to_string();
    let fields = [
        ("session", a.session == b.session, a.session.clone(), b.session.clone()),
        ("origin", a.origin == b.origin, a.origin.to_string(), b.origin.to_string()),
        ("program", a.program == b.program, a.program.clone(), b.program.clone()),
        ("unix_ns_at_zero", a.unix_at_zero == b.unix_at_zero, zero(a), zero(b)),
        ("config", a.config == b.config, length(&a.config), length(&b.config)),
        ("files", a.files == b.files, files(a), files(b)),
        ("inputs", a.inputs == b.inputs, inputs(a), inputs(b)),
    ];
    let different = fields.into_iter().filter(|(_, equal, ..)| !equal);
    different.map(|(field, _, a, b)| HeaderDifference { field: field.to_owned(), a, b }).collect()
}

fn text(report: &DiffReport) -> String {
    let mut text = String::new();
    for HeaderDifference { field, a, b } in &report.header {
        text.push_str(&format!("recordings' {field}: {a} | {b}\n"));
    }
    let Some(first) = &report.first else {
        let extent = if report.whole { "" } else { " as far as they can be read" };
        text.push_str(&format!("equal{extent}: {} events\n", report.events_a));
        return text;
    };
    let show = |event: &Option<EventAt>| match event {
        Some(event) => format!("seq {}, t_ns {}, {}", event.seq, event.t_ns, event.channel),
        None => "has ended".to_owned(),
    };
    text.push_str(&format!("first difference at event {}\n", first.place));
    text.push_str(&format!("  A: {}\n  B: {}\n", show(&first.a), show(&first.b)));
    if let (Some(field), Some(a), Some(b)) = (&first.field, &first.value_a, &first.value_b) {
        text.push_str(&format!("  {field}: {a} | {b}\n"));
    }
    let DiffReport { events_a, events_b, events_different, .. } = report;
    text.push_str(&format!("{events_different} events differ; A has {events_a}, B has {events_b}\n"));
    text
}
