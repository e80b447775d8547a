//! `tumbled replay`: recordings and captures through the core, as a live session would have seen them.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args as ClapArgs;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::{SensorHealth, SensorKind};
use tumbled_io::recording::thread::SYNC_EVERY;
use tumbled_io::recording::{Origin, Recorder, RecordingHeader, ResultKind};
use tumbled_model::{Event, UnixNs};
use tumbled_sim::faults::FaultTruth;

use super::{Failure, FaultArgs, InputArgs, Outcome, import, output, signals};
use crate::config::{Loaded, show};
use crate::decoding::Inputs;
use crate::session::play::{Listener, play};
use crate::session::run_info::RunInfo;
use crate::session::serve::{About, Server};
use crate::session::transport::Transport;
use crate::session::{Checkpoint, Engine, Pace, Publish, Speed, Step, lines::EpochLine};
use crate::simulation::faults;
use crate::stream::{ShellHealth, StateLine, StreamOrigin};
use crate::vary;

/// What `replay` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled replay run.mcap --digest\n  \
    tumbled replay run.mcap --speed 1 --serve\n  tumbled replay velodyne.pcap kinect/ --config rig.toml --epochs epochs.jsonl\n  \
    tumbled replay run.mcap --speed 1 --serve --faults lost-target\n  \
    tumbled replay run.mcap --vary time_offset_ms=-10..10,extrinsic.rz_deg=-1..1 --html vary.html\n\n\
    The same events give the same output to the bit, at any speed and on any number of threads.\n\
    Exit code 3: the inputs are damaged or incomplete; the log says where.")]
pub struct Args {
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    faults: FaultArgs,
    /// `max`, or how many times as fast as it was recorded.
    #[arg(long, default_value = "max", value_name = "SPEED")]
    speed: Speed,
    /// Write the target's state after each epoch, a STATE line each (`-` = stdout).
    #[arg(short, long, value_name = "STATE.jsonl")]
    output: Option<PathBuf>,
    /// Write a JSON line for each epoch's time and points (`-` = stdout).
    #[arg(long, value_name = "FILE.jsonl")]
    epochs: Option<PathBuf>,
    /// Record what is replayed, with checkpoints that `tumbled verify` compares with.
    #[arg(long, value_name = "FILE.mcap")]
    record: Option<PathBuf>,
    /// Replace a recording of this name.
    #[arg(long)]
    force: bool,
    /// Serve the state stream while it lasts, as the config's [stream] says.
    #[arg(long)]
    serve: bool,
    /// With --serve: stay at the end, so that it can be played again from the page; a signal ends it.
    #[arg(long, requires = "serve")]
    hold: bool,
    /// Serve it beyond this machine although it is not live.
    #[arg(long)]
    allow_nonlive: bool,
    /// Use the scans too that the live session shed: the best result offline, not that session's.
    #[arg(long)]
    ignore_skips: bool,
    /// Print one hash over everything that came out.
    #[arg(long)]
    digest: bool,
    /// Vary assumptions about the rig, each alone, and tell what the capture says of each value: axis, rate, residual, NIS.
    /// KEY=FROM..TO or KEY=FROM..TO:COUNT, several with commas; KEY: time_offset_ms, extrinsic.rx_deg, ry_deg, rz_deg,
    /// extrinsic.x_mm, y_mm, z_mm, of the first Kinect or, as ID.KEY, of a sensor; values are added to the config's.
    #[arg(long, value_name = "KEY=FROM..TO", value_parser = parse_vary, conflicts_with_all =
        ["speed", "output", "epochs", "record", "serve", "digest", "faults", "ignore_skips"])]
    vary: Option<Assumptions>,
    /// With --vary: write the curves as a page.
    #[arg(long, value_name = "FILE.html", requires = "vary")]
    html: Option<PathBuf>,
    /// Threads of the core, with --vary plays at a time; 0 = one for each processor. Changes no result.
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

/// What `--vary` is given, whole.
#[derive(Clone, Debug)]
struct Assumptions(Vec<vary::Assumption>);

fn parse_vary(text: &str) -> Result<Assumptions, String> {
    vary::parse(text).map(Assumptions)
}

/// What was replayed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled replay --json")]
pub struct ReplayReport {
    /// The session's id; null: the inputs are no single recording.
    pub session: Option<String>,
    /// `replay` or `simulated`.
    pub origin: StreamOrigin,
    /// Wall time at `t_ns` 0, ns since 1970-01-01 UTC as a decimal string; null: the inputs have no wall times.
    pub epoch_unix_ns: Option<String>,
    /// Rig time that was replayed, s.
    pub duration_s: f64,
    /// One hash over the epochs, states, notices and health: equal for a live session and its replay.
    pub digest: String,
    /// The chain's values at the end.
    pub checkpoint: Checkpoint,
    /// The sensors at the end.
    pub sensors: Vec<SensorHealth>,
    /// Nothing of the inputs was missing and nothing stopped the replay. Otherwise the exit code is 3.
    pub complete: bool,
    /// What was injected; null: nothing was asked for.
    pub faults: Option<FaultTruth>,
    /// What a person should know.
    pub warnings: Vec<String>,
}

/// Replays.
///
/// # Errors
/// Exit code 2: inputs or a config that cannot be used, an output that is there. 1: an output that cannot be written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    if let Some(Assumptions(assumptions)) = &args.vary {
        return super::vary::run(&args.input, assumptions, args.threads, args.html.as_deref(), args.json);
    }
    for output in [&args.record, &args.epochs, &args.output].into_iter().flatten() {
        import::refuse_input_as_output("-o", output, &args.input.inputs)?;
    }
    let loaded = args.input.load()?;
    let mut engine = Engine::of_config(&loaded, args.ignore_skips, args.threads)?;
    let open = || Inputs::open_ledger(&args.input.inputs, &loaded.config, args.threads);
    let mut inputs = args.faults.inject(open()?, &loaded.config)?;
    let stop = signals::stop_token()?;
    let transport = Transport::new(args.speed, args.no_restart());
    let mut pace = Pace::steered(transport.clone(), stop);
    let mut sinks = Sinks::open(args, &loaded, &inputs, &pace, &transport)?;
    let finished = loop {
        let finished = play(&mut inputs, &mut engine, &mut sinks, &mut pace)?;
        let again = if finished && args.hold { pace.rest(|| sinks.waiting()) } else { transport.take_restart() };
        if !again {
            break finished;
        }
        // The same inputs through a new core: what is told at the end is of the last play.
        engine = Engine::of_config(&loaded, args.ignore_skips, args.threads)?;
        inputs = args.faults.inject(open()?, &loaded.config)?;
        sinks.publish.begin_anew();
    };
    sinks.close()?;
    let report = report(args, &inputs, &engine, finished);
    report.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    if args.json {
        output::json(&report)?;
    } else if args.digest {
        output::text(&format!("{}\n", report.digest))?;
    } else if ![&args.epochs, &args.output].into_iter().flatten().any(|path| path == Path::new("-")) {
        output::text(&text(&report))?;
    }
    Ok(if report.complete { Outcome::Fine } else { Outcome::Incomplete })
}

impl Args {
    /// Why the replay cannot begin anew: lines and recordings that were begun would have everything twice.
    fn no_restart(&self) -> Option<&'static str> {
        let writes = self.output.is_some() || self.epochs.is_some() || self.record.is_some();
        writes.then_some("it writes a file (-o, --epochs or --record); replay without it")
    }
}

/// Where the results go.
struct Sinks {
    epochs: Option<Box<dyn Write>>,
    states: Option<Box<dyn Write>>,
    origin: StreamOrigin,
    recorder: Option<Recorder>,
    checkpoints: ResultKind,
    began: Instant,
    next_sync: Instant,
    server: Option<Server>,
    publish: Publish,
}

impl Listener for Sinks {
    fn event(&mut self, event: &Event) {
        if let Some(recorder) = &mut self.recorder {
            recorder.write(event);
        }
    }

    fn step(&mut self, step: &Step<'_>) -> Result<(), Failure> {
        self.take(step)
    }

    fn end(&mut self, checkpoint: &Checkpoint) {
        self.checkpoint(checkpoint);
    }

    /// Syncs the recording if it is time, by this machine's clock whatever the replay's speed, as a live recording is:
    /// a kill costs a second. HEALTH goes on where nothing is played.
    fn waiting(&mut self) {
        if let Some(recorder) = self.recorder.as_mut().filter(|_| self.next_sync <= Instant::now()) {
            recorder.sync();
            self.next_sync = Instant::now() + SYNC_EVERY;
        }
        let (began, server) = (self.began, self.server.as_ref());
        self.publish.repeat_health(|| shell(began, server));
    }
}

impl Sinks {
    fn open(
        args: &Args,
        loaded: &Loaded,
        inputs: &Inputs,
        pace: &Pace,
        transport: &Transport,
    ) -> Result<Self, Failure> {
        let unix_at_zero = inputs.epoch().unwrap_or_default();
        let session = session(inputs).unwrap_or_else(|| "replay".to_owned());
        let info = inputs.recording().map(|header| RunInfo::of_notes(&header.notes)).unwrap_or_default();
        let about = About {
            session: &session,
            origin: origin(inputs),
            unix_at_zero,
            info: &info,
            scene: inputs.scene(),
            transport: Some(transport),
        };
        let (server, publish) = if args.serve {
            let (server, publish) = Server::start(&loaded.config, about, args.allow_nonlive, pace.clock())?;
            (Some(server), publish)
        } else {
            (None, Publish::new(about.origin, unix_at_zero, None))
        };
        let recorder = match &args.record {
            Some(path) => Some(import::create(path, header(inputs, &args.input.inputs, loaded)?, args.force)?),
            None => None,
        };
        let epochs = args.epochs.as_deref().map(writer).transpose()?;
        let states = args.output.as_deref().map(writer).transpose()?;
        Ok(Self {
            epochs,
            states,
            origin: about.origin,
            recorder,
            checkpoints: Checkpoint::kind(),
            began: Instant::now(),
            next_sync: Instant::now() + SYNC_EVERY,
            server,
            publish,
        })
    }

    fn take(&mut self, step: &Step<'_>) -> Result<(), Failure> {
        if let Some(epochs) = &mut self.epochs {
            for epoch in &step.outputs.epochs {
                let unix = self.publish.unix(epoch.t, step.wall);
                write_line(epochs, &EpochLine::new(epoch, unix))?;
            }
        }
        if let Some(states) = &mut self.states {
            for state in &step.outputs.states {
                let line = StateLine::of_epoch(self.origin, state, self.publish.unix(state.t, step.wall));
                write_line(states, &line)?;
            }
        }
        if let Some(checkpoint) = &step.checkpoint {
            self.checkpoint(checkpoint);
        }
        let (began, server) = (self.began, self.server.as_ref());
        self.publish.step(step, || shell(began, server), None);
        Ok(())
    }

    fn checkpoint(&mut self, checkpoint: &Checkpoint) {
        let Some(recorder) = &mut self.recorder else { return };
        let message = checkpoint.to_message();
        recorder.write_result(&self.checkpoints, message.t, message.seq, &message.json);
    }

    fn close(mut self) -> Result<(), Failure> {
        for lines in [&mut self.epochs, &mut self.states].into_iter().flatten() {
            lines.flush().map_err(Failure::Output)?;
        }
        self.publish.stop();
        if let Some(server) = self.server {
            server.stop();
        }
        self.recorder.map_or(Ok(()), |recorder| import::written(&recorder.finish()))
    }
}

/// What is so now on this machine.
fn shell(began: Instant, server: Option<&Server>) -> ShellHealth {
    let clients = server.map(Server::clients).unwrap_or_default();
    ShellHealth { uptime_s: began.elapsed().as_secs_f64(), stream: clients.into(), ..ShellHealth::default() }
}

fn write_line(to: &mut dyn Write, line: &impl Serialize) -> Result<(), Failure> {
    let line = serde_json::to_string(line).map_err(Failure::failed)?;
    writeln!(to, "{line}").map_err(Failure::Output)
}

fn writer(path: &Path) -> Result<Box<dyn Write>, Failure> {
    if path == Path::new("-") {
        return Ok(Box::new(BufWriter::new(std::io::stdout())));
    }
    let file = File::create(path);
    let file = file.map_err(|error| Failure::failed(format!("cannot write {}: {error}", path.display())))?;
    Ok(Box::new(BufWriter::new(file)))
}

/// A recording of a replay is of the same session with the config it was replayed with, and never live.
fn header(inputs: &Inputs, paths: &[PathBuf], loaded: &Loaded) -> Result<RecordingHeader, Failure> {
    let mut header = import::header(inputs, paths, loaded)?;
    header.config = show::text(&loaded.tree, false);
    header.files = loaded.config.attachments();
    if header.origin == Origin::Live {
        header.origin = Origin::Import;
    }
    Ok(header)
}

/// The session of a recording that is replayed alone; with faults another one.
fn session(inputs: &Inputs) -> Option<String> {
    let mut header = RecordingHeader { session: inputs.recording()?.session.clone(), ..RecordingHeader::default() };
    inputs.mark_faults(&mut header);
    Some(header.session)
}

/// What the data are for those who see them now: never live.
pub(super) fn origin(inputs: &Inputs) -> StreamOrigin {
    if inputs.scene().is_some() || inputs.faults().is_some() {
        return StreamOrigin::Simulated;
    }
    let mut origins = inputs.captures().filter_map(|capture| capture.recording().map(|header| header.origin));
    if origins.any(|origin| origin == Origin::Simulated) { StreamOrigin::Simulated } else { StreamOrigin::Replay }
}

fn report(args: &Args, inputs: &Inputs, engine: &Engine, finished: bool) -> ReplayReport {
    let checkpoint = engine.checkpoint();
    let mut warnings = inputs.warnings();
    warnings.extend(args.faults.warning(inputs));
    if !finished {
        warnings.push("the replay was stopped before the inputs' end".to_owned());
    }
    ReplayReport {
        session: session(inputs),
        origin: origin(inputs),
        epoch_unix_ns: inputs.have_host_times().then(|| inputs.epoch()).flatten().map(|UnixNs(unix)| unix.to_string()),
        duration_s: checkpoint.t_ns as f64 * 1e-9,
        digest: checkpoint.outputs_digest(),
        sensors: engine.sensors(),
        complete: finished && !inputs.data_lost(),
        faults: inputs.faults().cloned(),
        warnings,
        checkpoint,
    }
}

fn text(report: &ReplayReport) -> String {
    let Checkpoint { events, epochs, .. } = &report.checkpoint;
    let mut text = format!("{events} events, {epochs} epochs in {:.3} s of rig time\n", report.duration_s);
    for sensor in report.sensors.iter().filter(|sensor| sensor.received > 0) {
        let SensorHealth { id, kind, received, lost, points, .. } = sensor;
        let clock = sensor.clock.map_or_else(String::new, |clock| format!(", clock {}", clock.state.name()));
        let points = match kind {
            SensorKind::Serial => String::new(),
            _ => format!(", {} points in epochs of {} decoded", points.in_epochs, points.decoded),
        };
        text.push_str(&format!("  {id}: {received} received, {} lost{points}{clock}\n", lost.total));
    }
    for line in report.faults.iter().flat_map(faults::lines) {
        text.push_str(&format!("  faults at {line}\n"));
    }
    text.push_str(&format!("digest {}\n", report.digest));
    text
}
