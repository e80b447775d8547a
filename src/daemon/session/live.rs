//! A live session: sources, ledger, core and recorder started in the right order and ended in the right order.
//!
//! ```text
//!   sources (rx-…) ─▶ ledger ─┬─▶ recorder ◀── checkpoints ──┐
//!                             └─▶ core: engine ─▶ publish ───┘
//! ```

use std::cell::Cell;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crossbeam_channel::{RecvTimeoutError, Sender};
use tumbled_core::{CoreConfig, ScanBoundaries, SensorHealth};
use tumbled_io::live::{ControlIntake, EventReceiver, Ledger, LedgerHandle, SessionClock, StopToken};
use tumbled_io::recording::thread::ResultSink;
use tumbled_io::recording::{
    Origin, RecorderDesk, RecorderOptions, RecorderState, RecorderThread, RecordingHeader, RecordingSummary, RingBound,
    StopReason,
};
use tumbled_model::{Span, UnixNs};

use super::chain::Checkpoint;
use super::engine::Engine;
use super::publish::Publish;
use super::run_info::RunInfo;
use super::service::{Status, Watchdog};
use super::shell::{self, Facts};
use super::sources::{self, Rig, RunningSources, SourcesEnd};
use super::steps::{Histogram, StepTimes};
use crate::cli::{Failure, VERSION, import};
use crate::config::{Config, Loaded, show};
use crate::stream::{ClientTotals, ShellHealth};

/// This machine's wall time at a session's start.
pub fn unix_at_zero(clock: &SessionClock) -> UnixNs {
    let now = clock.now();
    now.wall - Span(now.rig.0)
}

/// What a session's recording says of itself.
pub fn header(unix_at_zero: UnixNs, origin: Origin, loaded: &Loaded) -> RecordingHeader {
    RecordingHeader {
        session: format!("{:x}-{:x}", unix_at_zero.0, std::process::id()),
        origin,
        program: VERSION.to_owned(),
        unix_at_zero,
        config: show::text(&loaded.tree, false),
        files: loaded.config.attachments(),
        ..RecordingHeader::default()
    }
}

/// The core of a session, and where what comes out of it goes.
pub struct CorePart {
    /// What it knows of the rig: for the scans that may be shed.
    pub config: CoreConfig,
    /// The core.
    pub engine: Engine,
    /// Those who are told.
    pub publish: Publish,
}

/// A stop takes 2 s at most where a queue is full, and a recorder a moment on a slow disk; a service manager waits 10 s.
const LONGEST_STOP: Duration = Duration::from_secs(8);

/// Ends the process when a stop takes too long: what was recorded is safe up to the last sync.
struct StopGuard {
    /// Dropped when the stop is done.
    _done: Sender<()>,
}

impl StopGuard {
    /// From now on the time runs. Without a thread for it there is no guard, and the stop goes on.
    fn new() -> Self {
        let (done, stopped) = crossbeam_channel::bounded::<()>(0);
        let watch = move || {
            if stopped.recv_timeout(LONGEST_STOP) == Err(RecvTimeoutError::Timeout) {
                tracing::error!(
                    "a thread hangs: the process ends without it; `tumbled recover` finishes the recording"
                );
                std::process::exit(1);
            }
        };
        if let Err(error) = std::thread::Builder::new().name("stop-guard".to_owned()).spawn(watch) {
            tracing::warn!("the stop is not watched over: {error}");
        }
        Self { _done: done }
    }
}

/// What of a session is recorded.
#[derive(Default)]
pub struct RecorderPart {
    /// From its start on; `None`: nothing yet.
    pub recording: Option<RecordingPart>,
    /// How much of the past is kept; `None`: nothing is recorded later either.
    pub ring: Option<RingBound>,
}

/// The recording of a session.
pub struct RecordingPart {
    /// Its first part.
    pub path: PathBuf,
    /// What it says of itself.
    pub header: RecordingHeader,
    /// How it is written.
    pub options: RecorderOptions,
}

/// A running session.
pub struct LiveSession {
    stop: StopToken,
    started: Instant,
    clock: SessionClock,
    control: ControlIntake,
    ledger: LedgerHandle,
    sources: RunningSources,
    recorder: Option<RecorderThread>,
    core: Option<JoinHandle<CoreEnd>>,
    facts: Facts,
}

/// What the core had at its end.
#[derive(Clone, Debug)]
pub struct CoreEnd {
    /// The chain's values.
    pub checkpoint: Checkpoint,
    /// The sensors.
    pub sensors: Vec<SensorHealth>,
    /// From an epoch's time to the hand-over of its state, 99th percentile to within 19 %, ms; `None`: no epochs.
    pub latency_p99_ms: Option<f64>,
}

/// What a session was.
#[derive(Debug)]
pub struct SessionEnd {
    /// The sources.
    pub sources: SourcesEnd,
    /// The core; `None`: there was none.
    pub core: Option<CoreEnd>,
    /// The recordings, in the order of their ends.
    pub recordings: Vec<RecordingSummary>,
    /// Items that did not reach the ledger in time at the stop.
    pub undelivered: u64,
}

impl LiveSession {
    /// Opens every source, begins the recording, then lets everything run: a port that is taken leaves no empty file.
    ///
    /// # Errors
    /// Exit code 1: a port that cannot be had, a file that cannot be written, no threads. 2: a file that is there, a Kinect
    /// that this build cannot read.
    pub fn start(
        rig: Rig,
        config: &Config,
        clock: &SessionClock,
        stop: &StopToken,
        RecorderPart { recording, ring }: RecorderPart,
        core: Option<CorePart>,
    ) -> Result<Self, Failure> {
        let mut ledger = Ledger::live(clock.clone());
        let control = ledger.control();
        let opened = sources::open(rig, config, &mut ledger, clock, stop)?;
        let recorder = recording.map(|part| import::create_with(&part.path, part.header, part.options)).transpose()?;
        let recorder = if recorder.is_some() || ring.is_some() {
            let started = RecorderThread::start_with(recorder, ring.unwrap_or_default(), ledger.recorder());
            Some(started.map_err(Failure::failed)?)
        } else {
            None
        };
        let facts = Facts::default();
        let core = match core {
            Some(part) => {
                let mut boundaries = ScanBoundaries::new(&part.config);
                let events = ledger.core(Box::new(move |body| boundaries.begins(body)));
                let results = recorder.as_ref().map(RecorderThread::results);
                Some(spawn_core(part, events, results, facts.clone(), clock.clone())?)
            }
            None => None,
        };
        let ledger = ledger.start().map_err(Failure::failed)?;
        let sources = opened.start(clock, stop)?;
        let (stop, clock, started) = (stop.clone(), clock.clone(), Instant::now());
        Ok(Self { stop, started, clock, control, ledger, sources, recorder, core, facts })
    }

    /// The way for an operator's orders and changed configs.
    pub fn control(&self) -> &ControlIntake {
        &self.control
    }

    /// Since the start.
    pub fn started(&self) -> Instant {
        self.started
    }

    /// Why the recording stopped by itself; `None`: it did not, or there is none.
    pub fn recording_stopped(&self) -> Option<StopReason> {
        let status = self.recorder.as_ref()?.status();
        match status.state {
            RecorderState::Stopped { reason } if status.path.is_some() => Some(reason),
            _ => None,
        }
    }

    /// Events recorded and bytes written so far.
    pub fn recorded(&self) -> Option<(u64, u64)> {
        let status = self.recorder.as_ref()?.status();
        Some((status.recorded, status.file_bytes))
    }

    /// Where recordings are ordered; `None`: none can be.
    pub fn recorder(&self) -> Option<RecorderDesk> {
        self.recorder.as_ref().map(RecorderThread::desk)
    }

    /// Whether the core's thread is gone although nobody told it to end.
    pub fn core_is_gone(&self) -> bool {
        self.core.as_ref().is_some_and(JoinHandle::is_finished)
    }

    /// Reads the facts of this moment for health. Call it a few times a second.
    pub fn look(&self, clients: ClientTotals, info: &RunInfo) {
        let recorder = self.recorder.as_ref().map(RecorderThread::status);
        let health = shell::look((self.started.elapsed(), self.clock.now().rig), &self.ledger, &self.sources, recorder);
        let run = (!info.is_empty()).then(|| info.clone());
        self.facts.set(ShellHealth { stream: clients.into(), run, ..health });
    }

    /// Ends it: sources first, then the ledger, so that everything they accepted goes through core and recorder. A thread
    /// that hangs does not hold up the process: after 8 s it is ended all the same.
    pub fn end(self) -> SessionEnd {
        self.stop.stop();
        let _guard = StopGuard::new();
        let sources = self.sources.join();
        let ledger = self.ledger.stop();
        let core = self.core.map(|core| core.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
        let recordings = self.recorder.map(RecorderThread::finish_all).unwrap_or_default();
        SessionEnd { sources, core, recordings, undelivered: ledger.undelivered }
    }
}

fn spawn_core(
    part: CorePart,
    events: EventReceiver,
    results: Option<ResultSink>,
    facts: Facts,
    clock: SessionClock,
) -> Result<JoinHandle<CoreEnd>, Failure> {
    let CorePart { mut engine, mut publish, .. } = part;
    let kind = Checkpoint::kind();
    let record = move |checkpoint: &Checkpoint| {
        if let Some(results) = &results {
            results.put(&kind, checkpoint.to_message());
        }
    };
    let work = move || {
        let times = Mutex::new(StepTimes::new());
        let steps = || times.lock().unwrap_or_else(PoisonError::into_inner);
        let feeds = Cell::new(0);
        let shell = || ShellHealth { steps: steps().report(), watchdog_feeds: feeds.get(), ..facts.get() };
        let mut latencies = Histogram::default();
        let (mut watchdog, mut status) = (Watchdog::of_service(), Status::default());
        for event in events {
            let (began, begun) = (Instant::now(), clock.now().rig);
            let step = engine.step(&event);
            publish.step(&step, shell, Some((&clock, begun)));
            let now = clock.now().rig;
            for epoch in &step.outputs.epochs {
                latencies.add(Duration::from_nanos(u64::try_from((now - epoch.t).0).unwrap_or_default()));
            }
            step.checkpoint.iter().for_each(&record);
            steps().add(&event.body, began.elapsed());
            watchdog.alive();
            feeds.set(watchdog.feeds());
            if let Some(health) = step.outputs.health.last() {
                status.tell(health.reasons.iter().chain(&facts.get().reasons));
            }
        }
        publish.step(&engine.finish(), shell, None);
        publish.stop();
        let latency_p99_ms = latencies.known_percentile_ms(0.99);
        let end = CoreEnd { checkpoint: engine.checkpoint(), sensors: engine.sensors(), latency_p99_ms };
        record(&end.checkpoint);
        end
    };
    std::thread::Builder::new().name("core".to_owned()).spawn(work).map_err(Failure::failed)
}
