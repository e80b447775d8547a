//! `tumbled run`: the daemon. Live sensors, or simulated ones in real time, through the core, recorded, served, until it is
//! told to stop.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use clap::Args as ClapArgs;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::SensorHealth;
use tumbled_io::live::SessionClock;
use tumbled_io::recording::Origin;
use tumbled_model::Body;
use tumbled_sim::faults::FaultTruth;
use tumbled_sim::scene::Scene;

use super::record::RecorderArgs;
use super::signals::{self, Signals};
use super::{ConfigArgs, Failure, Outcome, output, render};
use crate::config::{Loaded, show};
use crate::control::{self, ControlServer, Desk};
use crate::limits::{self, LimitCheck, Limits};
use crate::quantity;
use crate::session::chain::rig_digest;
use crate::session::live::{self, CorePart, RecorderPart, RecordingPart};
use crate::session::recordings::Recordings;
use crate::session::reload::{self, Change};
use crate::session::run_info::{RunInfo, SharedRunInfo};
use crate::session::serve::{About, Server};
use crate::session::service;
use crate::session::sources::SourcesEnd;
use crate::session::{Checkpoint, Engine, LiveSession, Rig, SessionEnd, SourceReport, engine, kinects, setup};
use crate::simulation::live::SimulatedRig;
use crate::simulation::live::shortfall::ShortfallReport;
use crate::simulation::rig::operators;
use crate::simulation::{SCHEME, faults};
use crate::stream::StreamOrigin;

/// What is simulated when nothing is asked for.
const DEMO: &str = "demo";
/// How often the daemon looks at its queues, its disk and its end.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// What `run` is asked for.
#[derive(Debug, ClapArgs)]
#[command(
    after_help = "Examples:\n  tumbled run                                              the demo: simulated sensors, no hardware\n  \
    tumbled run --config rig.toml\n  \
    tumbled run --config rig.toml --record run.mcap --duration 10m\n  \
    tumbled run --sim turntable-20dps --faults faults.toml   a rehearsal with lost data\n\n\
    Without --config everything is SIMULATED; the log, every line of the stream and the recording say so.\n\
    SIGINT or SIGTERM end it cleanly: what was received is measured and recorded first. SIGHUP reads the config again; \
    mountings, offsets and the region of interest are taken over.\n\
    Exit code 3, with --duration only: data were lost on this machine, or the recording is incomplete."
)]
pub struct Args {
    /// The rig's config; without it no hardware is read: the scene `demo` is simulated.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Simulate the sensors of a scene in real time: one of the program's (demo, tumble, turntable-5dps, …; a name that is none lists them) or a file.
    #[arg(long, value_name = "SCENE")]
    sim: Option<String>,
    /// Let things go wrong on purpose with a simulated scene.
    #[arg(long, value_name = "FILE")]
    faults: Option<PathBuf>,
    /// Overrides one key, e.g. lidar.port=2369 (every LiDAR), lidar.front.port=2369 (one); repeatable.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,
    /// Serve simulated data beyond this machine.
    #[arg(long)]
    allow_nonlive: bool,
    /// Record everything that arrives, with checkpoints that `tumbled verify` compares with.
    #[arg(long, value_name = "FILE.mcap")]
    record: Option<PathBuf>,
    #[command(flatten)]
    recorder: RecorderArgs,
    /// Limits that the run has to keep (lost_share, latency_p99_ms), a TOML file [default: the config's [limits]].
    #[arg(long, value_name = "FILE.toml")]
    limits: Option<PathBuf>,
    /// What the run is called; it stands in recordings and is shown.
    #[arg(long)]
    name: Option<String>,
    /// A remark of the same kind.
    #[arg(long)]
    note: Option<String>,
    /// Who runs it.
    #[arg(long)]
    operator: Option<String>,
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
    /// `live` or `simulated`.
    pub origin: StreamOrigin,
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
    /// The parts of the recordings, those that were ordered meanwhile among them; empty: nothing was recorded.
    pub recording: Vec<PathBuf>,
    /// Why a recording ended by itself; null: none did.
    pub recording_stopped: Option<String>,
    /// The scene that was simulated; null: nothing was.
    pub simulation: Option<SimulationReport>,
    /// What --faults did, by sensor; null: nothing was asked for.
    pub faults: Option<FaultTruth>,
    /// From an epoch's time to the hand-over of its state, 99th percentile to within 19 %, ms; null: no epochs.
    pub latency_p99_ms: Option<f64>,
    /// The limits that were asked for; where one is not kept, the exit code is 3.
    #[serde(default)]
    pub limits: Vec<LimitCheck>,
    /// Nothing was lost on this machine, and everything was recorded that was to be.
    pub complete: bool,
}

/// A scene in real time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SimulationReport {
    /// The scene.
    pub scene: String,
    /// Its seed.
    pub seed: u64,
    /// What was left out because this machine was too slow: the sensors never sent it.
    pub left_out: ShortfallReport,
    /// What the scene's own faults did, by sensor; null: it has none.
    pub faults: Option<FaultTruth>,
}

/// Runs.
///
/// # Errors
/// Exit code 2: a config that cannot be run, an output that is there. 1: a port that is taken, a file that cannot be
/// written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let signals = signals::catch()?;
    let clock = SessionClock::start_on_system();
    let unix_at_zero = live::unix_at_zero(&clock);
    let simulated = args.scene()?.map(|scene| SimulatedRig::load(scene, args.faults.as_deref(), unix_at_zero));
    let simulated = simulated.transpose()?;
    let scene = simulated.as_ref().map(|rig| Arc::clone(&rig.scene));
    let mut loaded = args.load(scene.as_deref())?;
    let (recorded_as, origin) = match &simulated {
        Some(rig) => {
            tell_simulated(args, rig);
            (Origin::Simulated, StreamOrigin::Simulated)
        }
        None => {
            kinects::refuse_unreadable(&loaded.config)?;
            (Origin::Live, StreamOrigin::Live)
        }
    };
    if loaded.config.lidars.is_empty() && loaded.config.kinects.is_empty() {
        return Err(Failure::input("the config has no sensor: there is nothing to measure with")
            .with_help("add a [[lidar]] to the config"));
    }
    let limits = args.limits.as_deref().map(Limits::read).transpose()?.unwrap_or(loaded.config.limits);
    let mut header = live::header(unix_at_zero, recorded_as, &loaded);
    if let Some(script) = simulated.as_ref().and_then(|rig| rig.faults.as_ref()) {
        faults::mark(script, &mut header);
    }
    let info = RunInfo { name: args.name.clone(), note: args.note.clone(), operator: args.operator.clone() };
    info.check().map_err(Failure::input)?;
    info.add_to(&mut header.notes);
    let about =
        About { session: &header.session, origin, unix_at_zero, info: &info, scene: scene.as_ref(), transport: None };
    tracing::info!(session = %header.session, origin = origin.name(), rig = %loaded.config.name, "starting");
    let core_config = setup::core_config(&loaded.config)?;
    let interpreter = engine::interpreter(&loaded.config, false);
    let rig = rig_digest(&header.config, &header.files);
    let engine = Engine::new(core_config.clone(), rig, engine::workers(args.threads)?, interpreter);
    let options = args.recorder.options(&loaded.config.record);
    let recording = args.record.as_ref().map(|path| RecordingPart {
        path: path.clone(),
        header: header.clone(),
        options: options.clone(),
    });
    let recorder = RecorderPart { recording, ring: Some(loaded.config.record.pretrigger) };
    let of_beat = clock.clone();
    let now = Box::new(move || Some(of_beat.now().rig));
    let (server, publish) = Server::start(&loaded.config, about, args.allow_nonlive, now)?;
    let control = loaded.config.stream.control.as_ref().map(control::Listener::bind).transpose();
    let control = control.map_err(Failure::input)?.flatten();
    let core = CorePart { config: core_config, engine, publish };
    let rig = simulated.map_or(Rig::Devices, Rig::Simulated);
    let session = LiveSession::start(rig, &loaded.config, &clock, &signals.stop, recorder, Some(core))?;
    let info = SharedRunInfo::new(info.clone());
    let desk = session.recorder().map(|recorder| {
        let begun = (clock.clone(), signals.stop.clone());
        let recordings = Recordings::new(recorder, (header.clone(), options), info.clone(), begun);
        Desk::new(session.control().clone(), clock.clone(), loaded.config.target.background_s, recordings)
    });
    if let Some(desk) = &desk {
        server.take_orders(desk.clone());
    }
    let take_orders = |(listener, desk)| ControlServer::start(listener, desk);
    let control = control.zip(desk).map(take_orders).transpose().map_err(Failure::failed)?;
    service::ready();
    tracing::info!(origin = origin.name(), "running");
    // Where it listens is as it always is: no key was set.
    if scene.is_some() && args.settings.is_empty() {
        tracing::info!(
            "look at it with `tumbled status --watch`, `nc 127.0.0.1 7117`, or Foxglove at ws://127.0.0.1:8765; Ctrl-C ends it"
        );
    }
    let reload = || args.load(scene.as_deref());
    let timed_out = supervise(args, &reload, &session, &server, &signals, &clock, (&mut loaded, &info));
    service::stopping();
    if let Some(control) = control {
        control.stop();
    }
    let end = session.end();
    server.stop();
    let mut report = report(&about, scene.as_deref(), end)?;
    let found = [("lost_share", limits::lost_share(&report.sensors)), ("latency_p99_ms", report.latency_p99_ms)];
    report.limits = limits.check(&found);
    output::report(&report, args.json, || text(&report))?;
    Ok(if limits::all_kept(&report.limits) && (report.complete || !timed_out) {
        Outcome::Fine
    } else {
        Outcome::Incomplete
    })
}

impl Args {
    /// The scene to simulate; `None`: the config's devices are read.
    fn scene(&self) -> Result<Option<&str>, Failure> {
        match (&self.config, &self.sim) {
            (Some(config), Some(scene)) => {
                let message = format!("--config {} and --sim {scene}: a session is of one rig", config.display());
                let help = "leave out --config: a scene brings its own config, and --set changes its keys; or leave out \
                            --sim to measure with real sensors";
                Err(Failure::input(message).with_help(help))
            }
            (Some(_), None) if self.faults.is_some() => {
                let message = "--faults with --config: faults are for rehearsals, and never done to real sensors' data";
                Err(Failure::input(message).with_help("rehearse with `--sim SCENE --faults FILE`"))
            }
            (Some(_), None) => Ok(None),
            (None, Some(scene)) => Ok(Some(scene.strip_prefix(SCHEME).unwrap_or(scene))),
            (None, None) => Ok(Some(DEMO)),
        }
    }

    fn load(&self, simulated: Option<&Scene>) -> Result<Loaded, Failure> {
        let Some(scene) = simulated else {
            return ConfigArgs { config: self.config.clone(), settings: self.settings.clone() }.load();
        };
        let name = format!("{SCHEME}{}", scene.config.name);
        // Nothing real can be ordered there; --set goes before it.
        let settings = [&["stream.http_control=true".to_owned()], self.settings.as_slice()].concat();
        let loaded = operators(scene, Path::new(&name), &settings)?;
        loaded.warnings.iter().for_each(render::warning);
        Ok(loaded)
    }
}

/// Nobody may take a rehearsal for a measurement.
fn tell_simulated(args: &Args, rig: &SimulatedRig) {
    let config = &rig.scene.config;
    let why = if args.sim.is_none() { "there is no --config" } else { "--sim asks for it" };
    tracing::warn!(
        origin = StreamOrigin::Simulated.name(),
        scene = %config.name,
        "everything here is SIMULATED, because {why}: {}. With hardware: `tumbled run --config FILE`; \
         `tumbled config init rig.toml` writes one to begin with",
        config.about
    );
    if rig.has_faults() {
        tracing::warn!("faults are done to the simulated data on purpose");
    }
}

/// Until the end; whether it came by --duration.
fn supervise(
    args: &Args,
    reload: &dyn Fn() -> Result<Loaded, Failure>,
    session: &LiveSession,
    server: &Server,
    signals: &Signals,
    clock: &SessionClock,
    (loaded, info): (&mut Loaded, &SharedRunInfo),
) -> bool {
    let mut recording_told = false;
    loop {
        session.look(server.clients(), &info.get());
        if signals.take_reload() {
            reread(reload(), session, clock, loaded);
        }
        let stopped = session.recording_stopped();
        if let Some(reason) = stopped.as_ref().filter(|_| !recording_told) {
            tracing::error!("the recording stopped, measuring goes on: {reason}");
        }
        recording_told = stopped.is_some();
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

/// Hands what may change of a config that was read again to the core, by way of the ledger.
fn reread(next: Result<Loaded, Failure>, session: &LiveSession, clock: &SessionClock, loaded: &mut Loaded) {
    let next = match next {
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

fn report(about: &About<'_>, scene: Option<&Scene>, end: SessionEnd) -> Result<RunReport, Failure> {
    let core = end.core.ok_or_else(|| Failure::failed("the session had no core"))?;
    let SourcesEnd { sources, shortfall, faults } = end.sources;
    let recordings = end.recordings;
    let lost_here: u64 = sources.iter().map(SourceReport::lost_here).sum();
    let not_recorded: u64 = recordings
        .iter()
        .map(|one| one.counters.lost_total() + one.lost_at_stop + one.after_stop + one.unrecordable)
        .sum();
    let stopped = recordings.iter().find_map(|one| one.stopped.as_ref());
    let failed = sources.iter().any(|source| source.error.is_some());
    let simulation = scene.zip(shortfall).map(|(scene, left_out)| SimulationReport {
        scene: scene.config.name.clone(),
        seed: scene.config.seed,
        left_out,
        faults: faults.of_scene,
    });
    Ok(RunReport {
        session: about.session.to_owned(),
        origin: about.origin,
        epoch_unix_ns: about.unix_at_zero.0.to_string(),
        duration_s: core.checkpoint.t_ns as f64 * 1e-9,
        digest: core.checkpoint.outputs_digest(),
        checkpoint: core.checkpoint,
        sensors: core.sensors,
        latency_p99_ms: core.latency_p99_ms,
        limits: Vec::new(),
        complete: lost_here + not_recorded + end.undelivered == 0 && stopped.is_none() && !failed,
        sources,
        simulation,
        faults: faults.asked_for,
        recording_stopped: stopped.map(ToString::to_string),
        recording: recordings.into_iter().flat_map(|one| one.parts).collect(),
    })
}

/// Where a turntable's angle was no truth at the end; empty: it was, or there is none.
fn truth(sensor: &SensorHealth) -> String {
    let turntable = sensor.turntable.as_ref();
    let invalid = turntable.and_then(|turntable| turntable.invalid_since_ns.zip(turntable.invalid_because.as_deref()));
    invalid
        .map_or_else(String::new, |(since, why)| format!("    no truth from {:.3} s on: {why}\n", since as f64 * 1e-9))
}

fn text(report: &RunReport) -> String {
    let RunReport { checkpoint, duration_s, .. } = report;
    let mut text = String::new();
    if let Some(SimulationReport { scene, left_out: ShortfallReport { left_out_s, late, .. }, .. }) = &report.simulation
    {
        text.push_str(&format!("SIMULATED: the scene {scene}"));
        if *left_out_s > 0.0 || *late > 0 {
            let missing = format!("{left_out_s:.1} s of it and {late} items");
            text.push_str(&format!("; {missing} were left out, because this machine was too slow"));
        }
        text.push('\n');
    }
    text.push_str(&format!("{} events, {} epochs in {duration_s:.1} s\n", checkpoint.events, checkpoint.epochs));
    for sensor in &report.sensors {
        let SensorHealth { id, received, lost, points, .. } = sensor;
        let made = match &sensor.turntable {
            Some(turntable) => format!("{} angles", turntable.samples),
            None => format!("{} points", points.in_epochs),
        };
        text.push_str(&format!("  {id}: {received} received, {} lost, {made}\n", lost.total));
        text.push_str(&truth(sensor));
    }
    let of_scene = report.simulation.iter().filter_map(|simulation| simulation.faults.as_ref());
    for line in of_scene.flat_map(faults::lines) {
        text.push_str(&format!("  the scene's own faults at {line}\n"));
    }
    for line in report.faults.iter().flat_map(faults::lines) {
        text.push_str(&format!("  faults at {line}\n"));
    }
    for source in &report.sources {
        if let Some(error) = &source.error {
            text.push_str(&format!("  {} ended early: {error}\n", source.sensor));
        } else if let Some(cause) = &source.cause {
            text.push_str(&format!("  {} delivered nothing at the end: {cause}\n", source.sensor));
        }
    }
    if let Some(reason) = &report.recording_stopped {
        text.push_str(&format!("the recording stopped by itself: {reason}\n"));
    }
    for part in &report.recording {
        text.push_str(&format!("recorded {}\n", part.display()));
    }
    text.push_str(&limits::lines(&report.limits));
    let verdict = if report.complete { "complete" } else { "data were lost on this machine" };
    text + &format!("digest {} ({verdict})\n", report.digest)
}
