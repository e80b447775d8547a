//! The ledger's thread: one order for everything that arrives.

use super::clock::SessionClock;
use super::control::ControlIntake;
use super::intake::{Intake, Offered, QueueBound};
use super::metronome::{Due, Metronome};
use super::outlet::{
    CORE_QUEUE_BYTES, CORE_QUEUE_SCANS, Consumer, EventReceiver, OutletGauge, Patience, QueueOutlet,
    RECORDER_QUEUE_BYTES, ScanMark, WhenFull,
};
use crossbeam_channel::{Receiver, Select, Sender};
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;
use tumbled_model::{Body, Event, RigNs, SensorId};

/// How long a stopping ledger delivers what it had accepted.
pub const DRAIN: Duration = Duration::from_secs(2);
/// Events taken from one source before the others get their turn: 0.2 s of a VLP-32C, a millisecond's work.
const TURN: usize = 256;
/// The longest wait for data between looks at the clock.
const LOOK: Duration = Duration::from_millis(100);

/// Tells whether an item begins a scan of its sensor. Coarse is enough: it is where shedding may begin.
pub type ScanStart = Box<dyn FnMut(&Body) -> bool + Send>;

/// A ledger being put together: its intakes, its consumers; then [`Ledger::start`].
pub struct Ledger {
    /// `None` on replay: time, seq and skips come with the events.
    clock: Option<SessionClock>,
    inlets: Vec<Inlet>,
    consumers: Vec<Box<dyn Consumer>>,
    scan_start: Option<ScanStart>,
}

struct Inlet {
    /// Whose it is and how many items it holds; `None`: the shell's.
    source: Option<(SensorId, usize)>,
    items: Receiver<Offered>,
}

impl Ledger {
    /// A live ledger: numbers what arrives from 0, adds a tick each 0.1 s and an anchor each second, sheds scans that
    /// the core has no time for.
    pub fn live(clock: SessionClock) -> Self {
        Self { clock: Some(clock), inlets: Vec::new(), consumers: Vec::new(), scan_start: None }
    }

    /// A replaying ledger: events pass as they were recorded, nothing is added, nothing is lost; full queues hold the
    /// source back. It ends by itself when its intakes are dropped.
    pub fn replay() -> Self {
        Self { clock: None, inlets: Vec::new(), consumers: Vec::new(), scan_start: None }
    }

    fn when_full(&self) -> WhenFull {
        if self.clock.is_some() { WhenFull::Lose } else { WhenFull::Wait }
    }

    /// A way in for one source.
    pub fn intake(&mut self, sensor: SensorId, bound: QueueBound) -> Intake {
        let (intake, items) = Intake::new(sensor.clone(), bound, self.when_full());
        self.inlets.push(Inlet { source: Some((sensor, bound.0.max(1))), items });
        intake
    }

    /// A way in for an operator's orders and changed configs; they concern no sensor.
    pub fn control(&mut self) -> ControlIntake {
        let (control, items) = ControlIntake::new(self.clock.is_some());
        self.inlets.push(Inlet { source: None, items });
        control
    }

    /// A way out for the recorder, [`RECORDER_QUEUE_BYTES`] long: live, what does not fit is missing in the recording
    /// alone, which says so by a gap.
    pub fn recorder(&mut self) -> EventReceiver {
        self.recorder_with(RECORDER_QUEUE_BYTES)
    }

    /// As [`Ledger::recorder`], with a bound in bytes.
    pub fn recorder_with(&mut self, bound: usize) -> EventReceiver {
        let (outlet, receiver) = QueueOutlet::recorder(self.when_full(), bound);
        self.consumers.push(Box::new(outlet));
        receiver
    }

    /// The way out for the core. `scan_start` tells where a scan begins; when [`CORE_QUEUE_SCANS`] scans of a sensor
    /// wait, its next one is shed: a skip goes into the ledger ahead of it, for every consumer.
    ///
    /// The core gets every event, the shed ones too. Should it take none at all and [`CORE_QUEUE_BYTES`] wait, the
    /// ledger waits with it, and the sources lose and count: so what the core saw is what was recorded.
    pub fn core(&mut self, scan_start: ScanStart) -> EventReceiver {
        self.core_with(scan_start, CORE_QUEUE_BYTES, CORE_QUEUE_SCANS)
    }

    /// As [`Ledger::core`], with a bound in bytes and in scans.
    pub fn core_with(&mut self, scan_start: ScanStart, bytes: usize, scans: usize) -> EventReceiver {
        let (outlet, receiver) = QueueOutlet::core(bytes, self.clock.is_some().then_some(scans));
        self.scan_start = Some(scan_start);
        self.consumers.push(Box::new(outlet));
        receiver
    }

    /// A consumer of another kind, called on the ledger's thread.
    pub fn consumer(&mut self, consumer: Box<dyn Consumer>) {
        self.consumers.push(consumer);
    }

    /// Starts the thread `ledger`.
    ///
    /// # Errors
    /// When the system has no thread left.
    pub fn start(self) -> io::Result<LedgerHandle> {
        let patience = Arc::new(Patience::default());
        let (stop, stopped) = crossbeam_channel::bounded(0);
        let fill = |inlet: &Inlet| inlet.source.clone().map(|(sensor, bound)| (sensor, inlet.items.clone(), bound));
        let fill = self.inlets.iter().filter_map(fill).collect();
        let gauges = self.consumers.iter().filter_map(|consumer| consumer.gauge()).collect();
        let shed = Arc::new(AtomicU64::new(0));
        let writer = Writer {
            shed: Arc::clone(&shed),
            clock: self.clock,
            consumers: self.consumers,
            scan_start: self.scan_start,
            patience: Arc::clone(&patience),
            metronome: Metronome::new(),
            summary: LedgerSummary::default(),
        };
        let thread =
            std::thread::Builder::new().name("ledger".to_owned()).spawn(move || writer.run(self.inlets, &stopped))?;
        Ok(LedgerHandle { thread: Some(thread), stop: Some(stop), patience, fill, gauges, shed })
    }
}

/// What the ledger did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct LedgerSummary {
    /// Events written; live, the next `seq`.
    pub events: u64,
    /// Ticks among them that the ledger added.
    pub ticks: u64,
    /// Anchors among them that the ledger added.
    pub anchors: u64,
    /// Scans shed, one skip each.
    pub shed_scans: u64,
    /// Items accepted from sources that could not be written within [`DRAIN`] of the stop.
    pub undelivered: u64,
}

/// How full a source's queue is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct QueueFill {
    /// Whose.
    pub sensor: SensorId,
    /// Items waiting.
    pub waiting: usize,
    /// Items at most.
    pub bound: usize,
}

/// A running ledger.
#[derive(Debug)]
pub struct LedgerHandle {
    thread: Option<JoinHandle<LedgerSummary>>,
    /// Dropped to stop.
    stop: Option<Sender<()>>,
    patience: Arc<Patience>,
    fill: Vec<(SensorId, Receiver<Offered>, usize)>,
    gauges: Vec<OutletGauge>,
    shed: Arc<AtomicU64>,
}

impl LedgerHandle {
    /// Stops: everything the queues have taken so far is written, within [`DRAIN`]; then the ledger ends and its
    /// consumers get their end. Stop the sources first.
    ///
    /// # Panics
    /// When the ledger's thread did.
    pub fn stop(mut self) -> LedgerSummary {
        self.begin_stop();
        self.join()
    }

    /// Waits until the ledger ends by itself: on replay, once its intakes are dropped.
    ///
    /// # Panics
    /// When the ledger's thread did.
    pub fn wait(mut self) -> LedgerSummary {
        // These receivers would keep a queue open whose ledger is gone.
        self.fill.clear();
        self.join()
    }

    /// How full the sources' queues are, in the order the intakes were made.
    pub fn queues(&self) -> Vec<QueueFill> {
        let fill = |(sensor, items, bound): &(SensorId, Receiver<Offered>, usize)| QueueFill {
            sensor: sensor.clone(),
            waiting: items.len(),
            bound: *bound,
        };
        self.fill.iter().map(fill).collect()
    }

    /// Scans shed so far.
    pub fn shed_scans(&self) -> u64 {
        self.shed.load(Ordering::Relaxed)
    }

    /// The consumers' queues, in the order they were added.
    pub fn outlets(&self) -> &[OutletGauge] {
        &self.gauges
    }

    fn begin_stop(&mut self) {
        self.fill.clear();
        self.patience.end_in(DRAIN);
        self.stop = None;
    }

    fn join(&mut self) -> LedgerSummary {
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(summary)) => summary,
            Some(Err(panic)) => std::panic::resume_unwind(panic),
            None => LedgerSummary::default(),
        }
    }
}

impl Drop for LedgerHandle {
    fn drop(&mut self) {
        self.begin_stop();
    }
}

/// The thread's own state.
struct Writer {
    shed: Arc<AtomicU64>,
    clock: Option<SessionClock>,
    consumers: Vec<Box<dyn Consumer>>,
    scan_start: Option<ScanStart>,
    patience: Arc<Patience>,
    metronome: Metronome,
    summary: LedgerSummary,
}

/// What woke the ledger.
enum Wake {
    Stop,
    Items(usize),
    Time,
}

impl Writer {
    fn run(mut self, mut inlets: Vec<Inlet>, stopped: &Receiver<()>) -> LedgerSummary {
        loop {
            let wait = self.keep_the_beat();
            match wake(&inlets, stopped, wait) {
                Wake::Stop => break,
                Wake::Time => {}
                Wake::Items(index) => {
                    let open = inlets.get(index).is_none_or(|inlet| self.take_turn(inlet));
                    if !open {
                        inlets.remove(index);
                    }
                }
            }
            if inlets.is_empty() && self.clock.is_none() {
                break;
            }
        }
        self.drain(&inlets);
        self.summary
    }

    /// Writes the tick and the anchor that are due; how long until the next.
    fn keep_the_beat(&mut self) -> Duration {
        let Some(clock) = &self.clock else { return LOOK };
        let now = clock.now();
        let Due { anchor, tick } = self.metronome.beat(now.rig);
        if anchor {
            self.summary.anchors += 1;
            self.write(now.rig, Body::Anchor { unix: now.wall }, None);
        }
        if tick {
            self.summary.ticks += 1;
            self.write(now.rig, Body::Tick, None);
        }
        self.metronome.until_next(now.rig).min(LOOK)
    }

    /// Writes what one source has waiting, a turn at most; false when its intakes are all gone and it is empty.
    fn take_turn(&mut self, inlet: &Inlet) -> bool {
        for _ in 0..TURN {
            match inlet.items.try_recv() {
                Ok(item) => self.write(item.arrived, item.body, item.seq),
                Err(crossbeam_channel::TryRecvError::Empty) => return true,
                Err(crossbeam_channel::TryRecvError::Disconnected) => return false,
            }
        }
        true
    }

    /// Writes what had been accepted before the stop. What a source puts in afterwards does not prolong it.
    fn drain(&mut self, inlets: &[Inlet]) {
        self.patience.end_in(DRAIN);
        let accepted: Vec<usize> = inlets.iter().map(|inlet| inlet.items.len()).collect();
        for (inlet, accepted) in inlets.iter().zip(accepted) {
            for item in inlet.items.try_iter().take(accepted) {
                if self.patience.is_over() {
                    self.summary.undelivered += 1;
                } else {
                    self.write(item.arrived, item.body, item.seq);
                }
            }
        }
    }

    /// Gives the event its place and hands it to everyone.
    fn write(&mut self, arrived: RigNs, body: Body, recorded_seq: Option<u64>) {
        let mut scan = ScanMark::Within;
        if self.clock.is_some()
            && let Some(starts) = &mut self.scan_start
            && starts(&body)
            && let Some(sensor) = body.sensor()
        {
            scan = ScanMark::Begins;
            if self.consumers.iter().any(|consumer| consumer.is_behind(sensor)) {
                scan = ScanMark::BeginsShed;
                self.summary.shed_scans += 1;
                self.shed.store(self.summary.shed_scans, Ordering::Relaxed);
                let skip = Body::Skip { sensor: sensor.clone(), scans: 1 };
                self.hand_out(arrived, skip, None, ScanMark::Within);
            }
        }
        self.hand_out(arrived, body, recorded_seq, scan);
    }

    fn hand_out(&mut self, arrived: RigNs, body: Body, recorded_seq: Option<u64>, scan: ScanMark) {
        // A live ledger numbers by itself: only a replay keeps the numbers it was recorded with.
        let seq = recorded_seq.filter(|_| self.clock.is_none()).unwrap_or(self.summary.events);
        self.summary.events += 1;
        let event = Event { seq, arrived, body };
        for consumer in &mut self.consumers {
            consumer.offer(&event, scan, &self.patience);
        }
    }
}

/// Waits for a source's data, the stop, or the time.
fn wake(inlets: &[Inlet], stopped: &Receiver<()>, wait: Duration) -> Wake {
    let mut select = Select::new();
    let stop = select.recv(stopped);
    for inlet in inlets {
        select.recv(&inlet.items);
    }
    match select.ready_timeout(wait) {
        // Nobody sends on `stopped`: ready means that its other end was dropped.
        Ok(index) if index == stop => Wake::Stop,
        Ok(index) => Wake::Items(index - stop - 1),
        Err(_) => Wake::Time,
    }
}
