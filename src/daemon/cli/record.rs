//! `tumbled record`: the sensors' raw streams to a recording, as they come.
//!
//! ```text
//!   config ─▶ sources: UDP, USB (threads rx-…) ─▶ ledger (thread) ─▶ recorder (thread), synced every 0.9 s
//!                 ▲ stop: signal, --duration, or the recorder itself (disk full)
//! ```

use std::num::NonZeroU32;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args as ClapArgs;
use indicatif::{HumanBytes, ProgressBar, ProgressStyle};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_io::live::{SessionClock, StopToken};
use tumbled_io::recording::{Origin, RecorderOptions, RecordingHeader, RecordingSummary};
use tumbled_model::Span;

use super::ledger::LedgerReport;
use super::{ConfigArgs, Failure, Outcome, output, quantity, signals};
use crate::config::{ConfigSource, RecordConfig};
use crate::session::live::{RecorderPart, RecordingPart};
use crate::session::{LiveSession, Rig, SessionEnd, SourceReport, kinects, live};

/// How often the end is looked for.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// What `record` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled record --config rig.toml -o run.mcap\n  \
    tumbled record -o run.mcap --duration 60s --rotate 4GiB --keep 10\n\n\
    Ctrl-C ends the recording cleanly. A kill or a power cut costs at most its last second: `tumbled recover`.\n\
    Exit code 3: packets were lost on this machine, or the recording stopped by itself; the report says where.")]
pub struct Args {
    #[command(flatten)]
    config: ConfigArgs,
    /// The recording to write; further parts are FILE-0001.mcap and so on.
    #[arg(short = 'o', long = "output", value_name = "FILE.mcap")]
    output: PathBuf,
    /// End after this time, e.g. 60s, 2m.
    #[arg(long, value_parser = quantity::duration, value_name = "TIME")]
    duration: Option<Duration>,
    #[command(flatten)]
    recorder: RecorderArgs,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

/// How a recording is written; what is left out is the config's `[record]`.
#[derive(Clone, Debug, ClapArgs)]
pub struct RecorderArgs {
    /// End the recording when less than this is free on the disk [default: the config's record.min_free, 1GiB].
    #[arg(long, value_parser = quantity::size, value_name = "SIZE")]
    min_free: Option<u64>,
    /// Begin a new part when this one has so many bytes [default: record.rotate, 4GiB].
    #[arg(long, value_parser = rotate_size, value_name = "SIZE")]
    rotate: Option<u64>,
    /// Begin a new part when this one covers so much time [default: record.rotate_after, 10m].
    #[arg(long, value_parser = quantity::duration, value_name = "TIME")]
    rotate_after: Option<Duration>,
    /// Keep only the newest N parts, 0 = all [default: record.keep, 0].
    #[arg(long, value_name = "N")]
    keep: Option<u32>,
    /// Replace a recording of this name.
    #[arg(long)]
    force: bool,
}

impl RecorderArgs {
    /// The recorder's options: the command line before the config.
    pub fn options(&self, config: &RecordConfig) -> RecorderOptions {
        let rotate_after = self.rotate_after.or(config.rotate_after);
        RecorderOptions {
            rotate_bytes: self.rotate.or(config.rotate),
            rotate_duration: rotate_after.map(|after| Span(i64::try_from(after.as_nanos()).unwrap_or(i64::MAX))),
            keep: self.keep.map_or(config.keep, NonZeroU32::new),
            min_free: self.min_free.or(config.min_free),
            replace: self.force,
        }
    }
}

/// A part's size.
fn rotate_size(text: &str) -> Result<u64, String> {
    let bytes = quantity::size(text).map_err(|error| error.to_string())?;
    if bytes < RecordConfig::LEAST_ROTATE {
        return Err("a part is at least 1 MiB".to_owned());
    }
    Ok(bytes)
}

/// What was recorded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled record --json")]
pub struct RecordReport {
    /// The session id.
    pub session: String,
    /// Wall time at `t_ns` 0, ns since 1970-01-01 UTC as a decimal string.
    pub epoch_unix_ns: String,
    /// The parts on the disk, in order.
    pub parts: Vec<PathBuf>,
    /// Bytes of all parts, those that --keep removed included.
    pub file_bytes: u64,
    /// What the recording holds.
    pub ledger: LedgerReport,
    /// The sources, in the config's order.
    pub sources: Vec<SourceReport>,
    /// Why the recording ended before it was told to; null: it did not.
    pub stopped: Option<String>,
    /// Nothing was lost on this machine. Otherwise the exit code is 3.
    pub complete: bool,
}

/// Records until told to stop.
///
/// # Errors
/// Exit code 2: a config without sensors or with one that this build cannot read, an output that is there. 1: a port that is taken, a file that cannot be written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let mut loaded = args.config.load()?;
    if loaded.source == ConfigSource::Default && kinects::refuse_unreadable(&loaded.config).is_err() {
        // Nobody asked for it: the built-in rig has one.
        tracing::warn!("this build reads no Kinect: the built-in config's is left out");
        loaded.config.kinects.clear();
    }
    let config = &loaded.config;
    kinects::refuse_unreadable(config)?;
    if config.lidars.is_empty() && config.kinects.is_empty() {
        return Err(Failure::input("the config has no sensor: there is nothing to record"));
    }
    let stop = signals::stop_token()?;
    let clock = SessionClock::start_on_system();
    let header = live::header(live::unix_at_zero(&clock), Origin::Live, &loaded);
    let options = args.recorder.options(&config.record);
    let recording = RecordingPart { path: args.output.clone(), header: header.clone(), options };
    let recorder = RecorderPart { recording: Some(recording), ring: None };
    let session = LiveSession::start(Rig::Devices, config, &clock, &stop, recorder, None)?;
    wait(args, &session, &stop);
    let SessionEnd { sources, recordings, undelivered, .. } = session.end();
    if undelivered > 0 {
        tracing::error!(packets = undelivered, "packets did not reach the recording in time at the stop");
    }
    let summary = recordings.into_iter().next().unwrap_or_default();
    let report = report(&header, sources.sources, summary);
    output::report(&report, args.json, || text(&report))?;
    Ok(if report.complete { Outcome::Fine } else { Outcome::Incomplete })
}

/// Until the time is over, the recording ends by itself, or a signal comes.
fn wait(args: &Args, session: &LiveSession, stop: &StopToken) {
    let progress = progress();
    loop {
        let over = args.duration.is_some_and(|duration| session.started().elapsed() >= duration);
        if over || session.recording_stopped().is_some() || stop.wait(LOOK_EVERY) {
            break;
        }
        if let Some((events, bytes)) = session.recorded() {
            progress.set_message(format!("{events} events, {}", HumanBytes(bytes)));
        }
    }
    progress.finish_and_clear();
}

fn progress() -> ProgressBar {
    let style = ProgressStyle::with_template("{spinner} {elapsed_precise} {msg}  (Ctrl-C ends)");
    let bar = ProgressBar::new_spinner().with_style(style.unwrap_or_else(|_error| ProgressStyle::default_spinner()));
    bar.enable_steady_tick(Duration::from_millis(250)); // draws on a terminal only
    bar
}

fn report(header: &RecordingHeader, sources: Vec<SourceReport>, summary: RecordingSummary) -> RecordReport {
    let lost_here = summary.counters.lost_total() + summary.lost_at_stop + summary.after_stop + summary.unrecordable;
    let failed = sources.iter().any(|source| source.error.is_some());
    RecordReport {
        session: header.session.clone(),
        epoch_unix_ns: header.unix_at_zero.0.to_string(),
        file_bytes: summary.file_bytes,
        ledger: (&summary.counters).into(),
        stopped: summary.stopped.as_ref().map(ToString::to_string),
        complete: lost_here == 0 && summary.stopped.is_none() && !failed,
        parts: summary.parts,
        sources,
    }
}

fn text(report: &RecordReport) -> String {
    let mut text = String::new();
    for source in &report.sources {
        text.push_str(&format!("{}: {} packets, {}", source.sensor, source.packets, HumanBytes(source.bytes)));
        let mut lost = |n: u64, what: &str| {
            if n > 0 {
                text.push_str(&format!(", {n} {what}"));
            }
        };
        lost(source.lost_kernel, "lost in the kernel's buffer");
        lost(source.lost_queue, "lost in the queue");
        lost(source.lost_usb, "lost on the USB");
        lost(source.other_source, "from other addresses left out");
        lost(source.oversized, "too large left out");
        text.push('\n');
        if let Some(cause) = &source.cause {
            text.push_str(&format!("  it delivered nothing at the end: {cause}\n"));
        } else if source.packets == 0 {
            text.push_str("  nothing came: is this machine the sensor's destination, and no firewall between?\n");
        }
        if let Some(error) = &source.error {
            text.push_str(&format!("  ended early: {error}\n"));
        }
    }
    for loss in &report.ledger.lost {
        text.push_str(&format!("lost: {} of {} ({})\n", loss.count, loss.sensor, loss.place));
    }
    if let Some(reason) = &report.stopped {
        text.push_str(&format!("the recording stopped by itself: {reason}\n"));
    }
    let parts: Vec<String> = report.parts.iter().map(|part| part.display().to_string()).collect();
    let verdict = if report.complete { "complete" } else { "not complete" };
    text.push_str(&format!(
        "{} events, {} -> {} ({verdict})\n",
        report.ledger.events,
        HumanBytes(report.file_bytes),
        parts.join(", ")
    ));
    text
}
