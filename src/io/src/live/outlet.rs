//! The ways out of the ledger: bounded queues, each with its policy.

use super::intake::payload;
use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};
use tumbled_model::{Body, Command, Event, LossPoint, RigNs, SensorId};

/// What may wait for the recorder: about 3 s of a VLP-32C and a Kinect at 20 MB/s, some 30 times the longest stall
/// of a healthy disk.
pub const RECORDER_QUEUE_BYTES: usize = 64 << 20;
/// What a full recorder queue still takes of events without data (states, ticks, anchors, gaps), so that a recording
/// with a hole says where it is: 10 minutes' worth.
pub const RECORDER_RESERVE_BYTES: usize = 1 << 20;
/// What may wait for the core at the very most: about 3 s at 20 MB/s, ten times what [`CORE_QUEUE_SCANS`] leaves in it
/// when the core keeps up again.
pub const CORE_QUEUE_BYTES: usize = 64 << 20;
/// Scans of one sensor that may wait for the core before the next one is shed: 0.3 s at 10 Hz.
pub const CORE_QUEUE_SCANS: usize = 3;
/// What an event costs beside its payload: itself and its share of the queue.
const EVENT_COST: usize = 128;

/// What a full queue does with the next item.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WhenFull {
    /// Loses it, counts it, posts a gap later: live.
    Lose,
    /// Waits for room: replay, and the core, which must see what the ledger holds.
    Wait,
}

/// What an event is to the scans of its sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScanMark {
    /// It begins none.
    Within,
    /// It begins a scan that the core will work on.
    Begins,
    /// It begins a scan that a skip before it sheds.
    BeginsShed,
}

/// Takes each event of the ledger, in order, on the ledger's thread: it hands over and returns.
pub trait Consumer: Send {
    /// Takes the event. A consumer that has to wait for room asks `patience` whether waiting still makes sense.
    fn offer(&mut self, event: &Event, scan: ScanMark, patience: &Patience);

    /// Whether so much waits that a scan of this sensor, beginning now, should be shed.
    fn is_behind(&self, sensor: &SensorId) -> bool {
        let _ = sensor;
        false
    }

    /// The queue's state, for health; `None` when there is no queue.
    fn gauge(&self) -> Option<OutletGauge> {
        None
    }
}

/// How long a blocked consumer may still wait: for ever while the session runs, 2 s once it stops.
#[derive(Debug, Default)]
pub struct Patience {
    until: OnceLock<Instant>,
}

impl Patience {
    /// From now on the time runs; a second call changes nothing.
    pub fn end_in(&self, time: Duration) {
        self.until.get_or_init(|| Instant::now() + time);
    }

    /// Whether the time is over.
    pub fn is_over(&self) -> bool {
        self.until.get().is_some_and(|until| Instant::now() >= *until)
    }
}

/// An outlet's counts, read from any thread.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OutletCounts {
    /// Events put into the queue.
    pub taken: u64,
    /// Events with data that the full queue lost; each is in a gap.
    pub lost: u64,
    /// Events without data that found even the reserve full; not in a gap.
    pub lost_notes: u64,
    /// Events that found the receiver gone, or its queue full when the session ended.
    pub undelivered: u64,
    /// Bytes waiting now.
    pub waiting_bytes: u64,
}

#[derive(Debug, Default)]
struct Counters {
    taken: AtomicU64,
    lost: AtomicU64,
    lost_notes: AtomicU64,
    undelivered: AtomicU64,
}

/// Reads an outlet's counts.
#[derive(Clone, Debug)]
pub struct OutletGauge {
    queue: Arc<Queue>,
}

impl OutletGauge {
    /// The counts now.
    pub fn counts(&self) -> OutletCounts {
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        let counters = &self.queue.counters;
        OutletCounts {
            taken: read(&counters.taken),
            lost: read(&counters.lost),
            lost_notes: read(&counters.lost_notes),
            undelivered: read(&counters.undelivered),
            waiting_bytes: self.queue.lock().bytes as u64,
        }
    }
}

#[derive(Debug, Default)]
struct Queue {
    state: Mutex<State>,
    filled: Condvar,
    emptied: Condvar,
    counters: Counters,
}

#[derive(Debug, Default)]
struct State {
    events: VecDeque<(Event, ScanMark)>,
    bytes: usize,
    /// Scans begun and not yet taken, by sensor; shed ones cost the core nothing.
    scans: BTreeMap<SensorId, usize>,
    ledger_ended: bool,
    receiver_gone: bool,
}

impl Queue {
    fn lock(&self) -> MutexGuard<'_, State> {
        // Nothing in this module panics while it holds the lock.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The receiving end: the ledger's events in order. Dropping it tells the ledger that nobody listens.
#[derive(Debug)]
pub struct EventReceiver {
    queue: Arc<Queue>,
}

impl EventReceiver {
    /// The next event; waits for it. `None` once the ledger has ended and everything was taken.
    pub fn recv(&self) -> Option<Event> {
        let mut state = self.queue.lock();
        loop {
            if let Some(event) = take(&mut state) {
                self.queue.emptied.notify_one();
                return Some(event);
            }
            if state.ledger_ended {
                return None;
            }
            state = self.queue.filled.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// The next event, if it comes within `time`; `None` also at the end, see [`EventReceiver::is_finished`].
    pub fn recv_timeout(&self, time: Duration) -> Option<Event> {
        let until = Instant::now() + time;
        let mut state = self.queue.lock();
        loop {
            if let Some(event) = take(&mut state) {
                self.queue.emptied.notify_one();
                return Some(event);
            }
            let left = until.saturating_duration_since(Instant::now());
            if state.ledger_ended || left.is_zero() {
                return None;
            }
            state = self.queue.filled.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// The queue's counts.
    pub fn gauge(&self) -> OutletGauge {
        OutletGauge { queue: Arc::clone(&self.queue) }
    }

    /// Whether the ledger has ended and everything was taken.
    pub fn is_finished(&self) -> bool {
        let state = self.queue.lock();
        state.ledger_ended && state.events.is_empty()
    }
}

impl Iterator for EventReceiver {
    type Item = Event;

    fn next(&mut self) -> Option<Event> {
        self.recv()
    }
}

impl Drop for EventReceiver {
    fn drop(&mut self) {
        let mut state = self.queue.lock();
        state.receiver_gone = true;
        state.events.clear();
        state.bytes = 0;
        state.scans.clear();
        self.queue.emptied.notify_one();
    }
}

fn take(state: &mut State) -> Option<Event> {
    let (event, scan) = state.events.pop_front()?;
    state.bytes -= cost(&event);
    if scan == ScanMark::Begins
        && let Some(waiting) = event.body.sensor().and_then(|sensor| state.scans.get_mut(sensor))
    {
        *waiting -= 1;
    }
    Some(event)
}

/// What an event costs in memory, bytes: its payload or text, and its place in a queue.
pub(crate) fn cost(event: &Event) -> usize {
    let text = match &event.body {
        Body::Config { toml } => toml.len(),
        Body::Command(Command::Marker { text }) => text.len(),
        _ => 0,
    };
    EVENT_COST + text + payload(&event.body).map_or(0, bytes::Bytes::len)
}

/// An outlet with a queue, bounded in bytes.
#[derive(Debug)]
pub(super) struct QueueOutlet {
    queue: Arc<Queue>,
    when_full: WhenFull,
    bound: usize,
    /// On top of the bound, for events without data.
    reserve: usize,
    /// Scans of a sensor that may wait; `None` never sheds.
    scans: Option<usize>,
    /// What was lost of each sensor and is not yet in a gap.
    owed: BTreeMap<SensorId, Owed>,
}

impl QueueOutlet {
    /// For the recorder: what a full queue loses is missing in the recording alone.
    pub(super) fn recorder(when_full: WhenFull, bound: usize) -> (Self, EventReceiver) {
        Self::new(when_full, bound, RECORDER_RESERVE_BYTES, None)
    }

    /// For the core: it gets everything; scans are shed through the ledger before the queue is full.
    pub(super) fn core(bound: usize, scans: Option<usize>) -> (Self, EventReceiver) {
        Self::new(WhenFull::Wait, bound, 0, scans)
    }

    fn new(when_full: WhenFull, bound: usize, reserve: usize, scans: Option<usize>) -> (Self, EventReceiver) {
        let queue = Arc::new(Queue::default());
        let receiver = EventReceiver { queue: Arc::clone(&queue) };
        (Self { queue, when_full, bound, reserve, scans, owed: BTreeMap::new() }, receiver)
    }

    /// Puts the event in if it fits below `bound`; an empty queue takes any event.
    fn put(&self, event: &Event, scan: ScanMark, bound: usize) -> bool {
        let mut state = self.queue.lock();
        if state.receiver_gone {
            self.queue.counters.undelivered.fetch_add(1, Ordering::Relaxed);
            return true;
        }
        let cost = cost(event);
        if state.bytes + cost > bound && !state.events.is_empty() {
            return false;
        }
        state.bytes += cost;
        if scan == ScanMark::Begins
            && let Some(sensor) = event.body.sensor()
        {
            *state.scans.entry(sensor.clone()).or_insert(0) += 1;
        }
        state.events.push_back((event.clone(), scan));
        drop(state);
        self.queue.filled.notify_one();
        self.queue.counters.taken.fetch_add(1, Ordering::Relaxed);
        true
    }

    fn wait_and_put(&self, event: &Event, scan: ScanMark, patience: &Patience) {
        /// How often a waiting ledger asks whether it should give up.
        const LOOK: Duration = Duration::from_millis(20);
        while !self.put(event, scan, self.bound) {
            if patience.is_over() {
                self.queue.counters.undelivered.fetch_add(1, Ordering::Relaxed);
                return;
            }
            let state = self.queue.lock();
            let full = |state: &mut State| !state.receiver_gone && state.bytes + cost(event) > self.bound;
            drop(self.queue.emptied.wait_timeout_while(state, LOOK, full));
        }
    }

    /// Puts the event in behind the gaps owed, or counts it as lost. Gaps go first whosoever they are, so that the
    /// recording's `seq` never goes back.
    fn put_or_lose(&mut self, event: &Event, scan: ScanMark) {
        let carries_data = payload(&event.body).is_some();
        let bound = if carries_data { self.bound } else { self.bound + self.reserve };
        let need = cost(event) + self.owed.len() * EVENT_COST;
        if self.has_room(need, bound) {
            self.post_owed();
            self.put(event, scan, usize::MAX);
        } else if let Some(sensor) = event.body.sensor().filter(|_| carries_data) {
            self.queue.counters.lost.fetch_add(1, Ordering::Relaxed);
            let owed = self.owed.entry(sensor.clone()).or_default();
            *owed = Owed { seq: event.seq, arrived: event.arrived, lost: owed.lost.saturating_add(1) };
        } else {
            self.queue.counters.lost_notes.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Whether `need` bytes fit below the bound. Only this side adds, so what fits now fits later.
    fn has_room(&self, need: usize, bound: usize) -> bool {
        let state = self.queue.lock();
        state.receiver_gone || state.events.is_empty() || state.bytes + need <= bound
    }

    /// Puts the gaps in, in the ledger's order.
    fn post_owed(&mut self) {
        let mut gaps: Vec<Event> = std::mem::take(&mut self.owed).into_iter().map(Owed::gap).collect();
        gaps.sort_unstable_by_key(|gap| gap.seq);
        for gap in &gaps {
            self.put(gap, ScanMark::Within, usize::MAX);
        }
    }
}

/// What a recording lacks of one sensor; the gap takes the place of the last event lost.
#[derive(Clone, Copy, Debug, Default)]
struct Owed {
    seq: u64,
    arrived: RigNs,
    lost: u32,
}

impl Owed {
    fn gap((sensor, owed): (SensorId, Self)) -> Event {
        let body = Body::Gap { sensor, lost: owed.lost, place: LossPoint::Recorder };
        Event { seq: owed.seq, arrived: owed.arrived, body }
    }
}

impl Consumer for QueueOutlet {
    fn offer(&mut self, event: &Event, scan: ScanMark, patience: &Patience) {
        match self.when_full {
            WhenFull::Wait => self.wait_and_put(event, scan, patience),
            WhenFull::Lose => self.put_or_lose(event, scan),
        }
    }

    fn is_behind(&self, sensor: &SensorId) -> bool {
        self.scans.is_some_and(|bound| self.queue.lock().scans.get(sensor).is_some_and(|waiting| *waiting >= bound))
    }

    fn gauge(&self) -> Option<OutletGauge> {
        Some(OutletGauge { queue: Arc::clone(&self.queue) })
    }
}

impl Drop for QueueOutlet {
    /// The ledger has ended: the last gaps go in whatever the bound, and the receiver learns that no more comes.
    fn drop(&mut self) {
        self.post_owed();
        self.queue.lock().ledger_ended = true;
        self.queue.filled.notify_all();
    }
}

#[cfg(test)]
mod tests;
