//! The recorder on a thread of its own, behind a queue that never makes the daemon wait.

use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tumbled_model::{Body, Event, LossPoint, RigNs, SensorId};

use super::error::StopReason;
use super::layout::payload_bytes;
use super::recorder::{Recorder, RecorderState, RecordingSummary};
use crate::live::outlet::{Consumer, Patience, ScanMark};

/// Payload that may wait: 3 s of one LiDAR and one Kinect with a wide margin, far above the longest stall of a
/// healthy disk (20 ms).
pub const QUEUE_BYTES: usize = 64 << 20;

/// From one sync to the next. What a kill may cost is promised to be a second; the sync itself takes its part of it.
pub const SYNC_EVERY: Duration = Duration::from_millis(900);

/// What an event costs in the queue besides its payload, so that small ones are bounded too.
const EVENT_BYTES: usize = 128;

/// Ticks, anchors, states, skips and gaps are few and small, and a ledger without them cannot be replayed: so much of
/// them is taken even when the queue is full (8 000 events, minutes of them).
const LEDGER_RESERVE_BYTES: usize = 1 << 20;

/// What a recorder's thread is doing.
#[derive(Clone, Debug)]
pub struct RecorderStatus {
    /// Recording or stopped.
    pub state: RecorderState,
    /// Payload and overhead waiting, bytes; at most about [`QUEUE_BYTES`].
    pub queued_bytes: usize,
    /// Events handed to the recorder's file.
    pub recorded: u64,
    /// Events dropped because the queue was full.
    pub dropped: u64,
    /// `seq` of the last event that is on the medium, whatever happens now.
    pub synced_seq: Option<u64>,
    /// The longest sync so far.
    pub longest_sync: Duration,
}

/// A [`Recorder`] on a thread of its own.
///
/// [`RecorderThread::offer`] never waits: what does not fit is dropped from the recording only, counted, and posted as
/// one gap a sensor (place [`LossPoint::Recorder`]) as soon as there is room, under the `seq` and `arrived` of the last
/// event dropped. [`RecorderThread::hand_over`] waits instead: for replay and import.
#[derive(Debug)]
pub struct RecorderThread {
    shared: Arc<Shared>,
    thread: Mutex<Option<JoinHandle<RecordingSummary>>>,
}

#[derive(Debug)]
struct Shared {
    state: Mutex<State>,
    /// Something to write, or the end.
    work: Condvar,
    /// Room in the queue, or no more writing.
    room: Condvar,
    bound: usize,
}

#[derive(Debug)]
struct State {
    queue: VecDeque<Event>,
    /// Dropped since there was room last, by sensor: how many, and the last one's place in the ledger.
    drops: BTreeMap<SensorId, (u32, u64, RigNs)>,
    closing: bool,
    status: RecorderStatus,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl RecorderThread {
    /// Starts the thread `recorder` with a queue of [`QUEUE_BYTES`], syncing every [`SYNC_EVERY`].
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn start(recorder: Recorder) -> io::Result<Self> {
        Self::start_with(recorder, QUEUE_BYTES)
    }

    /// The same with a queue of another size, bytes.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn start_with(recorder: Recorder, bound: usize) -> io::Result<Self> {
        let status = RecorderStatus {
            state: recorder.state(),
            queued_bytes: 0,
            recorded: 0,
            dropped: 0,
            synced_seq: None,
            longest_sync: Duration::ZERO,
        };
        let state = State { queue: VecDeque::new(), drops: BTreeMap::new(), closing: false, status };
        let shared = Arc::new(Shared { state: Mutex::new(state), work: Condvar::new(), room: Condvar::new(), bound });
        let thread = std::thread::Builder::new().name("recorder".to_owned()).spawn({
            let shared = shared.clone();
            move || write_all(recorder, &shared)
        })?;
        Ok(Self { shared, thread: Mutex::new(Some(thread)) })
    }

    /// Gives an event without waiting; `false` when the queue is full and it was dropped.
    pub fn offer(&self, event: Event) -> bool {
        let mut state = self.shared.lock();
        let cost = cost(&event);
        let is_data = !is_ledger(&event.body);
        let bound = if is_data { self.shared.bound } else { self.shared.bound + LEDGER_RESERVE_BYTES };
        // An event greater than the whole queue goes through an empty one.
        if state.status.queued_bytes.saturating_add(cost) > bound && !state.queue.is_empty() {
            state.status.dropped += 1;
            if let Some(sensor) = event.body.sensor().filter(|_| is_data) {
                let drop = state.drops.entry(sensor.clone()).or_insert((0, event.seq, event.arrived));
                *drop = (drop.0.saturating_add(1), event.seq, event.arrived);
            }
            return false;
        }
        state.post_gaps();
        state.push(event, cost);
        drop(state);
        self.shared.work.notify_one();
        true
    }

    /// Gives an event and waits until there is room; `false` when the recording has stopped.
    pub fn hand_over(&self, event: Event) -> bool {
        let cost = cost(&event);
        let full = |state: &mut State| {
            let stopped = matches!(state.status.state, RecorderState::Stopped { .. });
            !stopped && !state.queue.is_empty() && state.status.queued_bytes.saturating_add(cost) > self.shared.bound
        };
        let state = self.shared.lock();
        let mut state = self.shared.room.wait_while(state, full).unwrap_or_else(PoisonError::into_inner);
        if matches!(state.status.state, RecorderState::Stopped { .. }) {
            return false;
        }
        state.push(event, cost);
        drop(state);
        self.shared.work.notify_one();
        true
    }

    /// What it is doing.
    pub fn status(&self) -> RecorderStatus {
        self.shared.lock().status.clone()
    }

    /// Writes everything that waits, ends the recording and tells what became of it. What is offered later is lost.
    /// A second call has nothing to tell but that the thread is gone.
    pub fn finish(&self) -> RecordingSummary {
        let gone = || RecordingSummary { stopped: Some(StopReason::Thread), ..RecordingSummary::default() };
        self.join().unwrap_or_else(gone)
    }

    fn join(&self) -> Option<RecordingSummary> {
        self.shared.lock().closing = true;
        self.shared.work.notify_one();
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take()?;
        thread.join().ok()
    }
}

impl Drop for RecorderThread {
    /// The recording is ended even if nobody waits to hear of it.
    fn drop(&mut self) {
        drop(self.join());
    }
}

/// The recorder as an outlet of a live ledger: its own queue is the bound, so none is put in front of it. Keep a clone to
/// ask for the status and to finish once the ledger has stopped.
impl Consumer for Arc<RecorderThread> {
    fn offer(&mut self, event: &Event, _scan: ScanMark, _patience: &Patience) {
        // What is dropped is counted and posted by the recorder itself.
        RecorderThread::offer(self, event.clone());
    }
}

impl State {
    fn push(&mut self, event: Event, cost: usize) {
        self.status.queued_bytes += cost;
        self.queue.push_back(event);
    }

    /// What was dropped comes before what is taken again, as it happened; of several sensors in ledger order.
    fn post_gaps(&mut self) {
        let mut gaps: Vec<Event> = std::mem::take(&mut self.drops)
            .into_iter()
            .map(|(sensor, (lost, seq, arrived))| Event {
                seq,
                arrived,
                body: Body::Gap { sensor, lost, place: LossPoint::Recorder },
            })
            .collect();
        gaps.sort_by_key(|gap| gap.seq);
        for gap in gaps {
            let cost = cost(&gap);
            self.push(gap, cost);
        }
    }
}

fn cost(event: &Event) -> usize {
    payload_bytes(&event.body).saturating_add(EVENT_BYTES)
}

fn is_ledger(body: &Body) -> bool {
    !matches!(
        body,
        Body::LidarPacket { .. } | Body::DepthFrame { .. } | Body::SerialChunk { .. } | Body::DeviceTables { .. }
    )
}

/// The thread: takes what waits, writes it without the lock held, syncs in time.
fn write_all(mut recorder: Recorder, shared: &Shared) -> RecordingSummary {
    let mut next_sync = Instant::now() + SYNC_EVERY;
    let mut batch = VecDeque::new();
    loop {
        let mut state = shared.lock();
        while state.queue.is_empty() && !state.closing {
            let wait = next_sync.saturating_duration_since(Instant::now());
            if wait.is_zero() {
                break;
            }
            state = shared.work.wait_timeout(state, wait).unwrap_or_else(PoisonError::into_inner).0;
        }
        if state.closing && state.queue.is_empty() {
            state.post_gaps();
            if state.queue.is_empty() {
                break;
            }
        }
        std::mem::swap(&mut batch, &mut state.queue);
        drop(state);
        for event in batch.drain(..) {
            write_one(&mut recorder, shared, &event);
            if Instant::now() >= next_sync {
                sync(&mut recorder, shared);
                next_sync = Instant::now() + SYNC_EVERY;
            }
        }
        if Instant::now() >= next_sync {
            sync(&mut recorder, shared);
            next_sync = Instant::now() + SYNC_EVERY;
        }
    }
    recorder.finish()
}

fn write_one(recorder: &mut Recorder, shared: &Shared, event: &Event) {
    let recorded = recorder.write(event);
    let mut state = shared.lock();
    state.status.queued_bytes = state.status.queued_bytes.saturating_sub(cost(event));
    state.status.recorded += u64::from(recorded);
    if !recorded {
        state.status.state = recorder.state();
    }
    drop(state);
    shared.room.notify_all();
}

fn sync(recorder: &mut Recorder, shared: &Shared) {
    let begun = Instant::now();
    recorder.sync();
    let took = begun.elapsed();
    let mut state = shared.lock();
    state.status.state = recorder.state();
    state.status.longest_sync = state.status.longest_sync.max(took);
    if matches!(state.status.state, RecorderState::Recording) {
        state.status.synced_seq = recorder.summary().counters.last_seq;
    }
    drop(state);
    shared.room.notify_all();
}
