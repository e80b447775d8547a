//! The recorder on a thread of its own, behind the ledger's bounded way out for it.
//!
//! A recording may begin with the session, or later by [`RecorderDesk::begin`]; meanwhile the newest events are kept in a
//! [`Ring`], so that the past can be recorded too.

use std::collections::VecDeque;
use std::io;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, Sender};
use tumbled_model::Event;

use super::error::{RecorderError, StopReason};
use super::excerpt::{MidSession, Plan};
use super::recorder::{Recorder, RecorderState, RecordingSummary};
use super::results::{ResultKind, ResultMessage};
use super::ring::{Excerpt, Ring, RingBound};
use crate::live::{EventReceiver, OutletGauge};

/// From one sync to the next. What a kill may cost is promised to be a second; the sync itself takes its part of it.
pub const SYNC_EVERY: Duration = Duration::from_millis(900);

/// How often a thread without events looks whether it is to end.
const LOOK: Duration = Duration::from_millis(20);

/// Results that may wait for the thread: one a second comes, and a disk may stall.
const WAITING_RESULTS: usize = 64;

/// Orders that may wait for the thread: people give them.
const WAITING_ORDERS: usize = 16;

/// How long an order may take: the disk may stall.
const ORDER_PATIENCE: Duration = Duration::from_secs(4);

/// Recordings that have ended and are told of at the end; of more, the newest.
const ENDED_KEPT: usize = 256;

/// What a recorder's thread is doing.
#[derive(Clone, Debug)]
pub struct RecorderStatus {
    /// The first part of what is recorded; `None`: nothing is.
    pub path: Option<PathBuf>,
    /// Recording or stopped.
    pub state: RecorderState,
    /// What the ring of the newest events holds, bytes.
    pub ring_bytes: u64,
    /// Payload and overhead waiting in the ledger's queue, bytes.
    pub queued_bytes: u64,
    /// Events handed to the recorder's file.
    pub recorded: u64,
    /// Events that found the ledger's queue full: missing in the recording alone. Those with data are in a gap.
    pub dropped: u64,
    /// Bytes written to all parts, the open one included.
    pub file_bytes: u64,
    /// `seq` of the last event that is on the medium, whatever happens now.
    pub synced_seq: Option<u64>,
    /// When everything written was on the medium last; `None`: not yet.
    pub synced: Option<Instant>,
    /// The longest sync so far.
    pub longest_sync: Duration,
}

/// What the thread tells.
#[derive(Debug)]
struct Progress {
    path: Option<PathBuf>,
    state: RecorderState,
    ring_bytes: u64,
    recorded: u64,
    file_bytes: u64,
    synced_seq: Option<u64>,
    synced: Option<Instant>,
    longest_sync: Duration,
}

#[derive(Debug)]
struct Shared {
    progress: Mutex<Progress>,
    results: Mutex<Vec<(ResultKind, ResultMessage)>>,
    closing: AtomicBool,
}

impl Progress {
    /// Of a recording that has just begun, or of none.
    fn of(recorder: Option<&Recorder>) -> Self {
        Self {
            path: recorder.map(|recorder| recorder.path().to_owned()),
            state: recorder.map_or(RecorderState::Recording, Recorder::state),
            ring_bytes: 0,
            recorded: 0,
            file_bytes: recorder.map_or(0, Recorder::written_bytes),
            synced_seq: None,
            synced: None,
            longest_sync: Duration::ZERO,
        }
    }
}

/// What the thread is asked for while it runs.
enum Order {
    Begin(Plan, Sender<Result<(), OrderError>>),
    End(Sender<Option<RecordingSummary>>),
    Excerpt(Sender<Excerpt>),
}

/// Why an order was not carried out.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OrderError {
    /// There is a recording already.
    #[error("{} is being recorded already: stop that first", path.display())]
    Recording {
        /// Its first part.
        path: PathBuf,
    },
    /// Nothing is recorded.
    #[error("nothing is being recorded")]
    Idle,
    /// The file cannot be begun.
    #[error(transparent)]
    Recorder(#[from] RecorderError),
    /// The thread does not answer.
    #[error("the recorder does not answer for {} s: its disk is held up, or the session ends", ORDER_PATIENCE.as_secs())]
    HeldUp,
}

impl Shared {
    fn progress(&self) -> MutexGuard<'_, Progress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A [`Recorder`] on a thread of its own that takes what a ledger has for it, syncing every [`SYNC_EVERY`].
///
/// What the recorder is too slow for is lost in the ledger's queue ([`crate::live::Ledger::recorder`]), which counts it
/// and puts gaps in its place. A recorder that stops (a full disk) says why, and its thread goes on taking events: neither
/// the ledger nor its other consumers ever wait for it.
#[derive(Debug)]
pub struct RecorderThread {
    desk: RecorderDesk,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<VecDeque<RecordingSummary>>>,
}

impl RecorderThread {
    /// Starts the thread `recorder`, which keeps nothing of the past.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn start(recorder: Recorder, events: EventReceiver) -> io::Result<Self> {
        Self::start_with(Some(recorder), RingBound::default(), events)
    }

    /// Starts the thread, with a recording or without one, and with a ring of the newest events.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn start_with(recorder: Option<Recorder>, ring: RingBound, events: EventReceiver) -> io::Result<Self> {
        let shared = Arc::new(Shared {
            progress: Mutex::new(Progress::of(recorder.as_ref())),
            results: Mutex::default(),
            closing: AtomicBool::new(false),
        });
        let gauge = events.gauge();
        let (orders, asked) = crossbeam_channel::bounded(WAITING_ORDERS);
        let thread = std::thread::Builder::new().name("recorder".to_owned()).spawn({
            let shared = Arc::clone(&shared);
            let writing = Writing {
                recording: recorder.map(Recording::OfSession),
                ended: VecDeque::new(),
                ring: Ring::new(ring),
                orders: asked,
                shared,
                next_sync: Instant::now() + SYNC_EVERY,
            };
            move || writing.run(&events)
        })?;
        let desk = RecorderDesk { orders, shared: Arc::clone(&shared), gauge };
        Ok(Self { desk, shared, thread: Some(thread) })
    }

    /// Where recordings are begun and ended, from any thread.
    pub fn desk(&self) -> RecorderDesk {
        self.desk.clone()
    }

    /// What it is doing.
    pub fn status(&self) -> RecorderStatus {
        self.desk.status()
    }

    /// The way for results, from any thread.
    pub fn results(&self) -> ResultSink {
        ResultSink { shared: Arc::clone(&self.shared) }
    }

    /// Writes what still waits, ends the recording and tells what became of it. Stop the ledger first: of one that runs
    /// on, the recording has what it had until now.
    pub fn finish(self) -> RecordingSummary {
        self.finish_all().pop().unwrap_or_default()
    }

    /// The same of every recording of the session, in their order.
    pub fn finish_all(mut self) -> Vec<RecordingSummary> {
        let gone = || vec![RecordingSummary { stopped: Some(StopReason::Thread), ..RecordingSummary::default() }];
        self.join().map_or_else(gone, Vec::from)
    }

    fn join(&mut self) -> Option<VecDeque<RecordingSummary>> {
        self.shared.closing.store(true, Ordering::Release);
        self.thread.take()?.join().ok()
    }
}

/// Asks a recorder's thread for recordings. Clones share it.
#[derive(Clone, Debug)]
pub struct RecorderDesk {
    orders: Sender<Order>,
    shared: Arc<Shared>,
    gauge: OutletGauge,
}

impl core::fmt::Debug for Order {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Begin(..) => "Begin",
            Self::End(_) => "End",
            Self::Excerpt(_) => "Excerpt",
        })
    }
}

impl RecorderDesk {
    /// What it is doing.
    pub fn status(&self) -> RecorderStatus {
        let counts = self.gauge.counts();
        let progress = self.shared.progress();
        RecorderStatus {
            path: progress.path.clone(),
            state: progress.state.clone(),
            ring_bytes: progress.ring_bytes,
            queued_bytes: counts.waiting_bytes,
            recorded: progress.recorded,
            dropped: counts.lost + counts.lost_notes,
            file_bytes: progress.file_bytes,
            synced_seq: progress.synced_seq,
            synced: progress.synced,
            longest_sync: progress.longest_sync,
        }
    }

    /// Records from now on: what stands now, then all that comes.
    ///
    /// # Errors
    /// There is a recording already; its file cannot be had; the thread is held up.
    pub fn begin(&self, plan: Plan) -> Result<(), OrderError> {
        self.ask(|answer| Order::Begin(plan, answer))?
    }

    /// Ends the recording.
    ///
    /// # Errors
    /// There is none; the thread is held up.
    pub fn end(&self) -> Result<RecordingSummary, OrderError> {
        self.ask(Order::End)?.ok_or(OrderError::Idle)
    }

    /// The newest events, to be recorded by whoever asks: the thread goes on meanwhile.
    ///
    /// # Errors
    /// The thread is held up.
    pub fn excerpt(&self) -> Result<Excerpt, OrderError> {
        self.ask(Order::Excerpt)
    }

    fn ask<T>(&self, order: impl FnOnce(Sender<T>) -> Order) -> Result<T, OrderError> {
        let (answer, answered) = crossbeam_channel::bounded(1);
        self.orders.send_timeout(order(answer), ORDER_PATIENCE).or(Err(OrderError::HeldUp))?;
        answered.recv_timeout(ORDER_PATIENCE).or(Err(OrderError::HeldUp))
    }
}

impl Drop for RecorderThread {
    /// The recording is ended even if nobody waits to hear of it.
    fn drop(&mut self) {
        drop(self.join());
    }
}

/// Takes results of the session for its recording.
#[derive(Clone, Debug)]
pub struct ResultSink {
    shared: Arc<Shared>,
}

impl ResultSink {
    /// Puts a result beside the ledger; `false`: too many wait, it is left out.
    pub fn put(&self, kind: &ResultKind, message: ResultMessage) -> bool {
        let mut results = self.shared.results.lock().unwrap_or_else(PoisonError::into_inner);
        let room = results.len() < WAITING_RESULTS;
        if room {
            results.push((kind.clone(), message));
        }
        room
    }
}

/// What is being written.
enum Recording {
    /// Begun with the session: the session's results belong to it.
    OfSession(Recorder),
    /// Begun later.
    Later(MidSession),
}

impl Recording {
    fn recorder(&self) -> &Recorder {
        match self {
            Self::OfSession(recorder) => recorder,
            Self::Later(later) => later.recorder(),
        }
    }

    fn write(&mut self, event: &Event) -> bool {
        match self {
            Self::OfSession(recorder) => recorder.write(event),
            Self::Later(later) => later.write(event),
        }
    }

    fn sync(&mut self) {
        match self {
            Self::OfSession(recorder) => recorder.sync(),
            Self::Later(later) => later.sync(),
        }
    }

    fn finish(self) -> RecordingSummary {
        match self {
            Self::OfSession(recorder) => recorder.finish(),
            Self::Later(later) => later.finish(),
        }
    }
}

/// The thread's own state.
struct Writing {
    recording: Option<Recording>,
    ended: VecDeque<RecordingSummary>,
    ring: Ring,
    orders: Receiver<Order>,
    shared: Arc<Shared>,
    next_sync: Instant,
}

impl Writing {
    fn run(mut self, events: &EventReceiver) -> VecDeque<RecordingSummary> {
        loop {
            // Asked before the queue is looked at: what came before the end is written, whatever comes after it.
            let closing = self.shared.closing.load(Ordering::Acquire);
            let left = self.next_sync.saturating_duration_since(Instant::now());
            let wait = if closing { Duration::ZERO } else { left.min(LOOK) };
            match events.recv_timeout(wait) {
                Some(event) => self.take(&event),
                None if closing => break,
                // The ledger has ended; a last result may still come until the recording is ended too.
                None if events.is_finished() => std::thread::sleep(LOOK),
                None => {}
            }
            self.write_results();
            while let Ok(order) = self.orders.try_recv() {
                self.obey(order);
            }
            if Instant::now() >= self.next_sync {
                self.sync();
            }
        }
        self.write_results();
        self.end();
        self.ended
    }

    /// An answer that nobody waits for any more is no fault.
    fn obey(&mut self, order: Order) {
        match order {
            Order::Begin(plan, answer) => {
                let begun = self.begin(plan);
                drop(answer.send(begun));
            }
            Order::End(answer) => {
                self.end();
                let summary = self.shared.progress().path.take().and_then(|_| self.ended.back().cloned());
                drop(answer.send(summary));
            }
            Order::Excerpt(answer) => drop(answer.send(self.ring.kept())),
        }
    }

    fn begin(&mut self, plan: Plan) -> Result<(), OrderError> {
        if let Some(recording) = &self.recording {
            let recorder = recording.recorder();
            if matches!(recorder.state(), RecorderState::Recording) {
                return Err(OrderError::Recording { path: recorder.path().to_owned() });
            }
            // One that stopped by itself makes room for the next.
            self.end();
        }
        let excerpt = self.ring.from_now();
        let mut later = MidSession::begin(plan, &excerpt)?;
        for event in &excerpt.events {
            later.write(event);
        }
        let (longest_sync, ring_bytes) = {
            let progress = self.shared.progress();
            (progress.longest_sync, progress.ring_bytes)
        };
        *self.shared.progress() = Progress { longest_sync, ring_bytes, ..Progress::of(Some(later.recorder())) };
        self.recording = Some(Recording::Later(later));
        Ok(())
    }

    fn end(&mut self) {
        let Some(recording) = self.recording.take() else { return };
        self.ended.push_back(recording.finish());
        if self.ended.len() > ENDED_KEPT {
            self.ended.pop_front();
        }
    }

    fn write_results(&mut self) {
        let results = std::mem::take(&mut *self.shared.results.lock().unwrap_or_else(PoisonError::into_inner));
        // The session's results compare with its ledger from its first event on.
        let Some(Recording::OfSession(recorder)) = &mut self.recording else { return };
        for (kind, message) in results {
            recorder.write_result(&kind, message.t, message.seq, &message.json);
        }
    }

    fn take(&mut self, event: &Event) {
        self.ring.push(event);
        let Some(recording) = &mut self.recording else { return };
        let recorded = recording.write(event);
        let mut progress = self.shared.progress();
        progress.recorded += u64::from(recorded);
        if !recorded {
            progress.state = recording.recorder().state();
        }
    }

    fn sync(&mut self) {
        self.next_sync = Instant::now() + SYNC_EVERY;
        self.shared.progress().ring_bytes = self.ring.bytes() as u64;
        let Some(recording) = &mut self.recording else { return };
        let begun = Instant::now();
        recording.sync();
        let took = begun.elapsed();
        let recorder = recording.recorder();
        let mut progress = self.shared.progress();
        progress.state = recorder.state();
        progress.file_bytes = recorder.written_bytes();
        progress.longest_sync = progress.longest_sync.max(took);
        if matches!(progress.state, RecorderState::Recording) {
            progress.synced_seq = recorder.summary().counters.last_seq;
            progress.synced = Some(Instant::now());
        }
        self.next_sync = Instant::now() + SYNC_EVERY;
    }
}
