//! The recorder on a thread of its own, behind the ledger's bounded way out for it.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tumbled_model::Event;

use super::error::StopReason;
use super::recorder::{Recorder, RecorderState, RecordingSummary};
use super::results::{ResultKind, ResultMessage};
use crate::live::{EventReceiver, OutletGauge};

/// From one sync to the next. What a kill may cost is promised to be a second; the sync itself takes its part of it.
pub const SYNC_EVERY: Duration = Duration::from_millis(900);

/// How often a thread without events looks whether it is to end.
const LOOK: Duration = Duration::from_millis(20);

/// Results that may wait for the thread: one a second comes, and a disk may stall.
const WAITING_RESULTS: usize = 64;

/// What a recorder's thread is doing.
#[derive(Clone, Debug)]
pub struct RecorderStatus {
    /// Recording or stopped.
    pub state: RecorderState,
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
    state: RecorderState,
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
    shared: Arc<Shared>,
    gauge: OutletGauge,
    thread: Option<JoinHandle<RecordingSummary>>,
}

impl RecorderThread {
    /// Starts the thread `recorder`.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn start(recorder: Recorder, events: EventReceiver) -> io::Result<Self> {
        let progress = Progress {
            state: recorder.state(),
            recorded: 0,
            file_bytes: recorder.written_bytes(),
            synced_seq: None,
            synced: None,
            longest_sync: Duration::ZERO,
        };
        let shared = Arc::new(Shared {
            progress: Mutex::new(progress),
            results: Mutex::default(),
            closing: AtomicBool::new(false),
        });
        let gauge = events.gauge();
        let thread = std::thread::Builder::new().name("recorder".to_owned()).spawn({
            let shared = Arc::clone(&shared);
            move || Writing { recorder, shared, next_sync: Instant::now() + SYNC_EVERY }.run(&events)
        })?;
        Ok(Self { shared, gauge, thread: Some(thread) })
    }

    /// What it is doing.
    pub fn status(&self) -> RecorderStatus {
        let counts = self.gauge.counts();
        let progress = self.shared.progress();
        RecorderStatus {
            state: progress.state.clone(),
            queued_bytes: counts.waiting_bytes,
            recorded: progress.recorded,
            dropped: counts.lost + counts.lost_notes,
            file_bytes: progress.file_bytes,
            synced_seq: progress.synced_seq,
            synced: progress.synced,
            longest_sync: progress.longest_sync,
        }
    }

    /// The way for results, from any thread.
    pub fn results(&self) -> ResultSink {
        ResultSink { shared: Arc::clone(&self.shared) }
    }

    /// Writes what still waits, ends the recording and tells what became of it. Stop the ledger first: of one that runs
    /// on, the recording has what it had until now.
    pub fn finish(mut self) -> RecordingSummary {
        let gone = || RecordingSummary { stopped: Some(StopReason::Thread), ..RecordingSummary::default() };
        self.join().unwrap_or_else(gone)
    }

    fn join(&mut self) -> Option<RecordingSummary> {
        self.shared.closing.store(true, Ordering::Release);
        self.thread.take()?.join().ok()
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

/// The thread's own state.
struct Writing {
    recorder: Recorder,
    shared: Arc<Shared>,
    next_sync: Instant,
}

impl Writing {
    fn run(mut self, events: &EventReceiver) -> RecordingSummary {
        loop {
            // Asked before the queue is looked at: what came before the end is written, whatever comes after it.
            let closing = self.shared.closing.load(Ordering::Acquire);
            let left = self.next_sync.saturating_duration_since(Instant::now());
            let wait = if closing { Duration::ZERO } else { left.min(LOOK) };
            match events.recv_timeout(wait) {
                Some(event) => self.write(&event),
                None if closing => break,
                // The ledger has ended; a last result may still come until the recording is ended too.
                None if events.is_finished() => std::thread::sleep(LOOK),
                None => {}
            }
            self.write_results();
            if Instant::now() >= self.next_sync {
                self.sync();
            }
        }
        self.write_results();
        self.recorder.finish()
    }

    fn write_results(&mut self) {
        let results = std::mem::take(&mut *self.shared.results.lock().unwrap_or_else(PoisonError::into_inner));
        for (kind, message) in results {
            self.recorder.write_result(&kind, message.t, message.seq, &message.json);
        }
    }

    fn write(&mut self, event: &Event) {
        let recorded = self.recorder.write(event);
        let mut progress = self.shared.progress();
        progress.recorded += u64::from(recorded);
        if !recorded {
            progress.state = self.recorder.state();
        }
    }

    fn sync(&mut self) {
        let begun = Instant::now();
        self.recorder.sync();
        let took = begun.elapsed();
        let mut progress = self.shared.progress();
        progress.state = self.recorder.state();
        progress.file_bytes = self.recorder.written_bytes();
        progress.longest_sync = progress.longest_sync.max(took);
        if matches!(progress.state, RecorderState::Recording) {
            progress.synced_seq = self.recorder.summary().counters.last_seq;
            progress.synced = Some(Instant::now());
        }
        self.next_sync = Instant::now() + SYNC_EVERY;
    }
}
