//! The recorder's thread behind a ledger: it never makes the daemon wait, and tells what it had to leave out.

use super::failing::SmallDisk;
use super::*;
use crate::live::{Delivery, Intake, Ledger, LedgerHandle, QueueBound, SessionClock};
use crate::recording::{PartFile, RecorderState, RecorderThread, Storage};
use std::fs::File;
use std::io::{self, Write};
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

/// The file system behind a gate that holds every write up while it is shut.
#[derive(Clone)]
struct Gate {
    open: Arc<(Mutex<bool>, Condvar)>,
}

struct GatedFile {
    file: File,
    gate: Gate,
}

impl Gate {
    fn set(&self, open: bool) {
        *self.open.0.lock().unwrap() = open;
        self.open.1.notify_all();
    }
    fn pass(&self) {
        drop(self.open.1.wait_while(self.open.0.lock().unwrap(), |open| !*open).unwrap());
    }
}

impl Storage for Gate {
    fn create(&mut self, path: &Path, _: bool) -> io::Result<Box<dyn PartFile>> {
        Ok(Box::new(GatedFile { file: File::create(path)?, gate: self.clone() }))
    }
    fn exists(&self, _: &Path) -> bool {
        false
    }
    fn remove(&mut self, path: &Path) -> io::Result<()> {
        std::fs::remove_file(path)
    }
    fn free_bytes(&self, _: &Path) -> io::Result<u64> {
        Ok(u64::MAX)
    }
}

impl Write for GatedFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.gate.pass();
        self.file.write(bytes)
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl PartFile for GatedFile {
    fn sync(&mut self) -> io::Result<()> {
        self.gate.pass();
        Ok(())
    }
    fn truncate(&mut self, length: u64) -> io::Result<()> {
        self.file.set_len(length)
    }
}

/// A ledger with one sensor and a recorder; `bound`: of the recorder's queue, bytes.
fn behind(mut ledger: Ledger, recorder: Recorder, bound: usize) -> (Intake, LedgerHandle, RecorderThread) {
    let intake = ledger.intake("front".into(), QueueBound(64));
    let thread = RecorderThread::start(recorder, ledger.recorder_with(bound)).expect("a thread");
    (intake, ledger.start().expect("a thread"), thread)
}

fn recorder(path: &Path) -> Recorder {
    Recorder::create(path, header("s"), RecorderOptions::default()).expect("a new file")
}

/// Waits for something that other threads bring about; far longer than it takes.
fn wait_until(what: &str, mut is_so: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !is_so() {
        assert!(begun.elapsed() < Duration::from_secs(60), "{what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_replaying_ledger_is_recorded_whole_however_small_the_queue() {
    let (_folder, path) = folder();
    // Eight packets wait at most; there are 500.
    let (mut intake, ledger, thread) = behind(Ledger::replay(), recorder(&path), 10_000);
    let events: Vec<_> = (0..500).map(|n| lidar(n, n as i64, &noise(1206, n))).collect();
    for event in &events {
        assert_eq!(intake.push_recorded(event.clone()), Ok(Delivery::Taken));
    }
    drop(intake);
    ledger.wait();
    assert_eq!(thread.status().dropped, 0);
    assert_eq!(thread.finish().counters.events, 500);
    assert_eq!(read(&[&path]).0, events);
}

#[test]
fn what_does_not_fit_is_missing_in_the_recording_alone_counted_and_in_gaps() {
    let (_folder, path) = folder();
    let gate = Gate { open: Arc::new((Mutex::new(true), Condvar::new())) };
    let recorder = Recorder::create_on(Box::new(gate.clone()), &path, header("s"), RecorderOptions::default()).unwrap();
    let (mut intake, ledger, thread) = behind(Ledger::live(SessionClock::start_on_system()), recorder, 10_000_000);
    gate.set(false);
    // A 5 MB frame closes a chunk, which waits at the gate; behind it one more fits into 10 MB, the others are lost.
    let mut push = |n: u64| {
        let Event { arrived, body, .. } = lidar(n, n as i64, &noise(5_000_000, n));
        intake.push(arrived, body)
    };
    (0..6).for_each(|n| assert_eq!(push(n), Ok(Delivery::Taken), "no source is held up"));
    wait_until("four of six are lost", || thread.status().dropped >= 4);
    std::thread::sleep(Duration::from_millis(250)); // two of the ledger's ticks, 100 ms apart
    gate.set(true);
    wait_until("the queue is empty again", || thread.status().queued_bytes == 0);
    assert_eq!(push(6), Ok(Delivery::Taken));
    drop(intake);
    ledger.stop();
    let dropped = thread.status().dropped;
    let summary = thread.finish();
    let (back, info) = read(&[&path]);
    let posted = info.counters.lost[&(SensorId::from("front"), LossPoint::Recorder)];
    assert_eq!(posted, dropped, "each loss is posted once");
    let frames = back.iter().filter(|event| matches!(event.body, Body::LidarPacket { .. })).count() as u64;
    assert_eq!(frames + posted, 7, "recorded and gaps make up what was sent");
    assert_eq!(summary.counters.events, back.len() as u64);
    assert!(back.iter().any(|event| event.body == Body::Tick), "the ledger's own events are recorded even then");
    assert!(back.windows(2).all(|pair| pair[0].seq < pair[1].seq), "a gap stands in the place of what is lost");
}

#[test]
fn a_full_disk_is_told_and_holds_nobody_up() {
    let (_folder, path) = folder();
    let disk = Box::new(SmallDisk::new(100_000));
    let full = Recorder::create_on(disk, &path, header("s"), RecorderOptions::default()).unwrap();
    // A replaying ledger waits where a live one loses: only because the thread goes on taking does it get through.
    let (mut intake, ledger, thread) = behind(Ledger::replay(), full, 10_000_000);
    let frames = 20; // of 5 MB each: a chunk each, none of which fits
    (0..frames).for_each(|n| assert_eq!(intake.push_recorded(lidar(n, 0, &noise(5_000_000, n))), Ok(Delivery::Taken)));
    drop(intake);
    assert_eq!(ledger.wait().events, frames);
    wait_until("the stop is told", || matches!(thread.status().state, RecorderState::Stopped { .. }));
    let summary = thread.finish();
    let reason = summary.stopped.expect("stopped").to_string();
    assert!(reason.contains("session.mcap"), "{reason}");
    assert_eq!((summary.lost_at_stop, summary.after_stop), (1, frames - 1), "each event is accounted for");
}

#[test]
fn what_is_recorded_is_synced_in_time_though_nothing_more_comes() {
    let (_folder, path) = folder();
    let (mut intake, ledger, thread) = behind(Ledger::replay(), recorder(&path), 10_000);
    intake.push_recorded(lidar(7, 0, b"a")).unwrap();
    wait_until("it is synced", || thread.status().synced_seq == Some(7));
    assert_eq!(read(&[&path]).0, [lidar(7, 0, b"a")], "and can be read while the recording goes on");
    drop((intake, ledger, thread));
}

#[test]
fn a_dropped_thread_leaves_a_finished_recording_and_a_ledger_that_runs_on() {
    let (_folder, path) = folder();
    let (mut intake, ledger, thread) = behind(Ledger::replay(), recorder(&path), 10_000);
    intake.push_recorded(tick(0, 0)).unwrap();
    wait_until("it has the tick", || thread.status().recorded == 1);
    drop(thread);
    assert!(read(&[&path]).1.whole());
    for seq in 1..200 {
        assert_eq!(
            intake.push_recorded(lidar(seq, 0, &[0; 900])),
            Ok(Delivery::Taken),
            "nobody takes it, nobody waits"
        );
    }
    drop(intake);
    assert_eq!(ledger.wait().events, 200);
}
