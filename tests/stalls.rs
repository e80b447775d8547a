//! A core that takes nothing for a while, and a disk that does: what is missing is said, and one never costs the other.

use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tumbled::session::{Checkpoint, Engine};
use tumbled_core::ScanBoundaries;
use tumbled_io::live::{EventReceiver, HostClock, HostSample, Ledger, QueueBound, SessionClock};
use tumbled_io::recording::{
    FileSystem, PartFile, Reader, Recorder, RecorderOptions, RecorderThread, RecordingSummary, Storage,
};
use tumbled_model::{Body, Event, LossPoint, RigNs, Span, UnixNs};

use crate::support::rig::{self, PACKET_POINTS};

/// So long is waited for what has to happen; a machine that is busy may take its time.
const PATIENCE: Duration = Duration::from_secs(60);
/// A stall of the core: 3 s of the rig.
const STALL_PACKETS: u64 = 3 * 1_507;

/// A clock that stands still: the ledger adds no tick, and what is in it follows from what was sent alone.
struct StandingClock;

impl HostClock for StandingClock {
    fn sample(&self) -> HostSample {
        HostSample { monotonic: Span(0), wall: UnixNs(0), uncertainty: Span(0) }
    }
}

fn ledger() -> Ledger {
    Ledger::live(SessionClock::start(Arc::new(StandingClock)))
}

/// Room for all packets of a test: here the ledger's outlets are what may be full.
const ROOM: QueueBound = QueueBound(100_000);

/// The LiDAR's packets with their times.
fn packets(n: u64) -> impl Iterator<Item = (RigNs, Body)> {
    let packet =
        |(number, bytes)| (RigNs(number * rig::PACKET_NS), Body::LidarPacket { sensor: "front".into(), bytes });
    (0..n as i64).zip(rig::packets()).map(packet)
}

fn boundaries() -> Box<dyn FnMut(&Body) -> bool + Send> {
    let mut boundaries = ScanBoundaries::new(&rig::lidar_core());
    Box::new(move |body| boundaries.begins(body))
}

/// Lets the core have events until it has had so many packets.
fn take(engine: &mut Engine, events: &EventReceiver, packets: u64) {
    let began = Instant::now();
    while engine.sensors()[0].received < packets {
        assert!(began.elapsed() < PATIENCE, "{:?}", engine.sensors());
        for _ in 0..256 {
            events.recv_timeout(Duration::from_millis(1)).iter().for_each(|event| drop(engine.step(event)));
        }
    }
}

/// What remains, and the end.
fn finish(engine: &mut Engine, events: EventReceiver) -> Checkpoint {
    events.for_each(|event| drop(engine.step(&event)));
    engine.finish();
    engine.checkpoint()
}

fn wait_until(what: &str, condition: impl Fn() -> bool) {
    let began = Instant::now();
    while !condition() {
        assert!(began.elapsed() < PATIENCE, "{what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn a_core_that_stalls_for_three_seconds_sheds_whole_scans_that_are_recorded_and_replayed_as_shed() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let recorder = Recorder::create(&path, rig::header(), RecorderOptions::default()).expect("begins");
    let mut ledger = ledger();
    let mut intake = ledger.intake("front".into(), ROOM);
    let recorder = RecorderThread::start(recorder, ledger.recorder()).expect("a thread");
    let events = ledger.core(boundaries());
    let ledger = ledger.start().expect("a thread");
    let mut engine = rig::lidar_engine();
    let mut packets = packets(2 * 1_507 + STALL_PACKETS);
    let mut sent = 0;
    let mut send_until = |until: u64| {
        for (arrived, body) in packets.by_ref().take((until - sent) as usize) {
            intake.push(arrived, body).expect("open");
        }
        sent = until;
    };
    // A scan at a time the core keeps up; then it takes nothing for 3 s; then it keeps up again.
    for scan in 1..=10 {
        send_until(scan * 150);
        take(&mut engine, &events, scan * 150);
    }
    send_until(1_500 + STALL_PACKETS);
    wait_until("the ledger takes what was sent", || recorder.status().recorded >= 1_500 + STALL_PACKETS);
    take(&mut engine, &events, 1_500 + STALL_PACKETS);
    for scan in 1..=10 {
        send_until(1_500 + STALL_PACKETS + scan * 150);
        take(&mut engine, &events, 1_500 + STALL_PACKETS + scan * 150);
    }
    let summary = ledger.stop();
    let live = finish(&mut engine, events);
    let recording = recorder.finish();

    let lidar = engine.sensors().swap_remove(0);
    assert_eq!((lidar.received, lidar.lost.total, summary.undelivered), (sent, 0, 0), "{lidar:?}");
    // 30 scans begin in the stall; three wait for the core, and all that begin behind them are shed.
    assert!((26..=28).contains(&summary.shed_scans), "{summary:?}");
    assert_eq!(lidar.epochs.shed_scans, summary.shed_scans);
    let points = lidar.points;
    assert_eq!(points.decoded, sent * PACKET_POINTS);
    assert_eq!(points.in_epochs + points.shed, points.decoded, "{points:?}");
    assert_eq!(recording.counters.events, summary.events);
    let mut again = rig::lidar_engine();
    let reader = Reader::open(&[&path]).expect("opens");
    reader.for_each(|event| drop(again.step(&event.expect("reads"))));
    again.finish();
    assert_eq!(again.checkpoint(), live, "the replay sheds the same scans");
}

/// A disk whose files take nothing as long as the gate is held.
struct StalledDisk(Arc<std::sync::Mutex<()>>);

struct StalledFile(Arc<std::sync::Mutex<()>>, Box<dyn PartFile>);

impl Storage for StalledDisk {
    fn create(&mut self, path: &Path, replace: bool) -> io::Result<Box<dyn PartFile>> {
        Ok(Box::new(StalledFile(Arc::clone(&self.0), FileSystem.create(path, replace)?)))
    }
    fn exists(&self, path: &Path) -> bool {
        FileSystem.exists(path)
    }
    fn remove(&mut self, path: &Path) -> io::Result<()> {
        FileSystem.remove(path)
    }
    fn free_bytes(&self, path: &Path) -> io::Result<u64> {
        FileSystem.free_bytes(path)
    }
}

impl Write for StalledFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        drop(self.0.lock());
        self.1.write(bytes)
    }
    fn flush(&mut self) -> io::Result<()> {
        self.1.flush()
    }
}

impl PartFile for StalledFile {
    fn sync(&mut self) -> io::Result<()> {
        drop(self.0.lock());
        self.1.sync()
    }
    fn truncate(&mut self, length: u64) -> io::Result<()> {
        self.1.truncate(length)
    }
}

/// A session of 5 s whose disk stalls from its beginning until the core has had everything, or not at all.
fn recorded_session(path: &Path, stalls: bool) -> (Checkpoint, RecordingSummary, u64) {
    let gate = Arc::new(std::sync::Mutex::new(()));
    let storage = Box::new(StalledDisk(Arc::clone(&gate)));
    let recorder = Recorder::create_on(storage, path, rig::header(), RecorderOptions::default()).expect("begins");
    let held = stalls.then(|| gate.lock().expect("no panic"));
    let mut ledger = ledger();
    let mut intake = ledger.intake("front".into(), ROOM);
    // Room for 1.5 s of the LiDAR; a whole session's is 64 MiB.
    let bound = if stalls { 3 << 20 } else { 64 << 20 };
    let recorder = RecorderThread::start(recorder, ledger.recorder_with(bound)).expect("a thread");
    let events = ledger.core_with(boundaries(), usize::MAX, usize::MAX);
    let ledger = ledger.start().expect("a thread");
    let sent = 5 * 1_507;
    for (arrived, body) in packets(sent) {
        intake.push(arrived, body).expect("open");
    }
    let mut engine = rig::lidar_engine();
    take(&mut engine, &events, sent);
    drop(held);
    wait_until("the disk takes what waits", || recorder.status().queued_bytes == 0);
    assert_eq!(ledger.stop().undelivered, 0);
    (finish(&mut engine, events), recorder.finish(), sent)
}

#[test]
fn a_disk_that_stalls_costs_the_recording_a_counted_gap_and_the_run_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let (well, stalled) = (folder.path().join("well.mcap"), folder.path().join("stalled.mcap"));
    let (expected, whole, sent) = recorded_session(&well, false);
    let (run, recording, _) = recorded_session(&stalled, true);
    assert!(run.epochs > 45 && run == expected, "{run:?} {expected:?}");
    assert!(whole.stopped.is_none() && recording.stopped.is_none());
    assert_eq!(whole.counters.lost_total(), 0);

    let events: Vec<Event> = Reader::open(&[&stalled]).expect("opens").map(|event| event.expect("reads")).collect();
    let recorded = events.iter().filter(|event| matches!(event.body, Body::LidarPacket { .. })).count() as u64;
    let lost: u64 = events
        .iter()
        .map(|event| match event.body {
            Body::Gap { lost, place: LossPoint::Recorder, .. } => u64::from(lost),
            _ => 0,
        })
        .sum();
    assert!(lost > 0, "the queue held everything: {recorded} recorded");
    assert_eq!((recorded + lost, recording.counters.lost_total()), (sent, lost));
}
