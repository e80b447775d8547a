//! `tumbled run`: the daemon. Live sensors through the core, recorded, served, until it is told to stop.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args as ClapArgs;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::SensorHealth;
use tumbled_io::live::SessionClock;
use tumbled_model::Body;

use super::record::RecorderArgs;
use super::signals::{self, Signals};
use super::{ConfigArgs, Failure, Outcome, output};
use crate::config::{Loaded, show};
use crate::quantity;
use crate::session::chain::rig_digest;
use crate::session::live::{self, CorePart, RecordingPart};
use crate::session::reload::{self, Change};
use crate::session::serve::{About, Server};
use crate::session::{Checkpoint, Engine, LiveSession, SessionEnd, SourceReport, engine, setup};
use crate::stream::StreamOrigin;

/// How often the daemon looks at its queues, its disk and its end.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// What `run` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled run --config rig.toml\n  \
    tumbled run --config rig.toml --record run.mcap --duration 10m\n\n\
    SIGINT or SIGTERM end it cleanly: what was received is measured and recorded first. SIGHUP reads the config again; \
    mountings, offsets and the region of interest are taken over.\n\
    Exit code 3, with --duration only: data were lost on this machine, or the recording is incomplete.")]
pub struct Args {
    #[command(flatten)]
    config: ConfigArgs,
    /// Record everything that arrives, with checkpoints that `tumbled verify` compares with.
    #[arg(long, value_name = "FILE.mcap")]
    record: Option<PathBuf>,
    #[command(flatten)]
    recorder: RecorderArgs,
    /// End after this time, e.g. 60s, 2m.
    #[arg(long, value_parser = quantity::duration, value_name = "TIME")]
    duration: Option<Duration>,
    /// Threads of the core; 0 = one for each processor. Changes no result.
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    /// Report on stdout as JSON at the end.
    #[arg(long)]
    json: bool,
}

/// What a session was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled run --json")]
pub struct RunReport {
    /// The session id.
    pub session: String,
    /// Wall time at `t_ns` 0, ns since 1970-01-01 UTC as a decimal string.
    pub epoch_unix_ns: String,
    /// How long it was, s.
    pub duration_s: f64,
    /// One hash over the epochs, notices and health: its replay has the same.
    pub digest: String,
    /// The chain's values at the end.
    pub checkpoint: Checkpoint,
    /// The sensors at the end.
    pub sensors: Vec<SensorHealth>,
    /// The sources, in the config's order.
    pub sources: Vec<SourceReport>,
    /// The parts of the recording; empty: nothing was recorded.
    pub recording: Vec<PathBuf>,
    /// Why the recording ended by itself; null: it did not.
    pub recording_stopped: Option<String>,
    /// Nothing was lost on this machine, and everything was recorded that was to be.
    pub complete: bool,
}

/// Runs.
///
/// # Errors
/// Exit code 2: a config that cannot be run, an output that is there. 1: a port that is taken, a file that cannot be
/// written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let mut loaded = args.config.load()?;
    refuse(&loaded)?;
    let signals = signals::catch()?;
    let clock = SessionClock::start_on_system();
    let header = live::header(&clock, &loaded);
    let about = About { session: &header.session, origin: StreamOrigin::Live, unix_at_zero: header.unix_at_zero };
    let core_config = setup::core_config(&loaded.config)?;
    let interpreter = engine::interpreter(&loaded.config, false);
    let rig = rig_digest(&header.config, &header.files);
    let engine = Engine::new(core_config.clone(), rig, engine::workers(args.threads)?, interpreter);
    let recording = args.record.as_ref().map(|path| RecordingPart {
        path: path.clone(),
        header: header.clone(),
        options: args.recorder.options(&loaded.config.record),
    });
    let (server, publish) = Server::start(&loaded.config, about, false)?;
    let core = CorePart { config: core_config, engine, publish };
    let session = LiveSession::start(&loaded.config, &clock, &signals.stop, recording, Some(core))?;
    tracing::info!(session = %header.session, origin = about.origin.name(), rig = %loaded.config.name, "running");
    let timed_out = supervise(args, &session, &server, &signals, &clock, &mut loaded);
    let end = session.end();
    server.stop();
    let report = report(&header.session, header.unix_at_zero.0, end)?;
    if args.json {
        output::json(&report)?;
    } else {
        output::text(&text(&report))?;
    }
    Ok(if report.complete || !timed_out { Outcome::Fine } else { Outcome::Incomplete })
}

/// What this program cannot measure with must not look as if it did.
fn refuse(loaded: &Loaded) -> Result<(), Failure> {
    let config = &loaded.config;
    if let Some(kinect) = config.kinects.first() {
        return Err(Failure::input(format!(
            "the config has the Kinect `{}`, and this program was built without kinect-usb: it cannot read one",
            kinect.id
        ))
        .with_help("put `kinect = []` at the top of the config to run without"));
    }
    if config.lidars.is_empty() {
        return Err(Failure::input("the config has no sensor: there is nothing to measure with")
            .with_help("add a [[lidar]] to the config"));
    }
    if config.turntable.is_some() {
        tracing::warn!("this build does not read the turntable: its angle is not known");
    }
    Ok(())
}

/// Until the end; whether it came by --duration.
fn supervise(
    args: &Args,
    session: &LiveSession,
    server: &Server,
    signals: &Signals,
    clock: &SessionClock,
    loaded: &mut Loaded,
) -> bool {
    let mut recording_told = false;
    loop {
        session.look(server.clients());
        if signals.take_reload() {
            reread(args, session, clock, loaded);
        }
        if let Some(reason) = session.recording_stopped().filter(|_| !recording_told) {
            tracing::error!("the recording stopped, measuring goes on: {reason}");
            recording_told = true;
        }
        let left = args.duration.map(|duration| duration.saturating_sub(session.started().elapsed()));
        if left.is_some_and(|left| left.is_zero()) {
            return true;
        }
        let ended = signals.stop.wait(left.map_or(LOOK_EVERY, |left| left.min(LOOK_EVERY)));
        if ended || session.core_is_gone() {
            return false;
        }
    }
}

/// Reads the config again and hands what may change to the core, by way of the ledger.
fn reread(args: &Args, session: &LiveSession, clock: &SessionClock, loaded: &mut Loaded) {
    let next = match args.config.load() {
        Ok(next) => next,
        Err(failure) => {
            tracing::error!("the config was not taken over: {failure}");
            return;
        }
    };
    match reload::compare(loaded, &next) {
        Change::None => tracing::info!("the config is as it was"),
        Change::Refused(keys) => {
            tracing::error!(keys = %keys.join(", "), "the config was not taken over: these keys need a new start");
        }
        Change::Allowed(keys) => {
            let toml = show::text(&next.tree, false).into();
            match session.control().post(clock.now().rig, Body::Config { toml }) {
                Ok(()) => {
                    tracing::info!(keys = %keys.join(", "), "the config was taken over");
                    *loaded = next;
                }
                Err(error) => tracing::error!("the config was not taken over: {error}"),
            }
        }
    }
}

fn report(session: &str, unix_at_zero: i64, end: SessionEnd) -> Result<RunReport, Failure> {
    let core = end.core.ok_or_else(|| Failure::failed("the session had no core"))?;
    let recording = end.recording.unwrap_or_default();
    let lost_here: u64 = end.sources.iter().map(|source| source.lost_kernel + source.lost_queue).sum();
    let not_recorded =
        recording.counters.lost_total() + recording.lost_at_stop + recording.after_stop + recording.unrecordable;
    let failed = end.sources.iter().any(|source| source.error.is_some());
    Ok(RunReport {
        session: session.to_owned(),
        epoch_unix_ns: unix_at_zero.to_string(),
        duration_s: core.checkpoint.t_ns as f64 * 1e-9,
        digest: core.checkpoint.outputs_digest(),
        checkpoint: core.checkpoint,
        sensors: core.sensors,
        complete: lost_here + not_recorded + end.undelivered == 0 && recording.stopped.is_none() && !failed,
        sources: end.sources,
        recording: recording.parts,
        recording_stopped: recording.stopped.map(|reason| reason.to_string()),
    })
}

fn text(report: &RunReport) -> String {
    let RunReport { checkpoint, duration_s, .. } = report;
    let mut text = format!("{} events, {} epochs in {duration_s:.1} s\n", checkpoint.events, checkpoint.epochs);
    for sensor in &report.sensors {
        let SensorHealth { id, received, lost, points, .. } = sensor;
        text.push_str(&format!("  {id}: {received} received, {} lost, {} points\n", lost.total, points.in_epochs));
    }
    for source in &report.sources {
        if let Some(error) = &source.error {
            text.push_str(&format!("  {} ended early: {error}\n", source.sensor));
        }
    }
    if let Some(reason) = &report.recording_stopped {
        text.push_str(&format!("the recording stopped by itself: {reason}\n"));
    }
    for part in &report.recording {
        text.push_str(&format!("recorded {}\n", part.display()));
    }
    let verdict = if report.complete { "complete" } else { "data were lost on this machine" };
    text + &format!("digest {} ({verdict})\n", report.digest)
}
