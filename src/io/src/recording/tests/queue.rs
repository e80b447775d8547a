//! The recorder's thread: it never makes the daemon wait, and tells what it had to leave out.

use super::*;
use crate::live::outlet::{Consumer, Patience, ScanMark};
use crate::recording::{PartFile, RecorderState, RecorderThread, Storage};
use std::fs::File;
use std::io::{self, Write};
use std::sync::{Arc, Condvar, Mutex};

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

#[test]
fn everything_offered_in_time_is_recorded() {
    let (_folder, path) = folder();
    let thread =
        RecorderThread::start(Recorder::create(&path, header("s"), RecorderOptions::default()).unwrap()).unwrap();
    let events: Vec<_> = (0..5000).map(|n| lidar(n, n as i64, &noise(1206, n))).collect();
    assert!(events.iter().all(|event| thread.offer(event.clone())), "6 MB fit into 64 MiB");
    let summary = thread.finish();
    assert_eq!(summary.counters.events, 5000);
    assert_eq!(read(&[&path]).0, events);
}

#[test]
fn what_does_not_fit_is_dropped_from_the_recording_counted_and_posted_as_a_gap() {
    let (_folder, path) = folder();
    let gate = Gate { open: Arc::new((Mutex::new(true), Condvar::new())) };
    let recorder = Recorder::create_on(Box::new(gate.clone()), &path, header("s"), RecorderOptions::default()).unwrap();
    let thread = RecorderThread::start_with(recorder, 10_000_000).unwrap();
    gate.set(false);
    // A 5 MB frame closes a chunk, which waits at the gate; behind it 10 MB of queue fill up.
    let large = |seq| lidar(seq, seq as i64 * 10, &noise(5_000_000, seq));
    let mut offered: Vec<(u64, bool)> = (0..6).map(|seq| (seq, thread.offer(large(seq)))).collect();
    // The ledger's own events are taken even now.
    assert!(thread.offer(tick(6, 60)));
    let lost: Vec<u64> = offered.iter().filter(|(_, taken)| !taken).map(|(seq, _)| *seq).collect();
    assert!(lost.len() >= 3, "{offered:?}");
    assert_eq!(thread.status().dropped, lost.len() as u64);
    gate.set(true);
    while thread.status().queued_bytes > 0 {
        std::thread::yield_now();
    }
    offered.push((7, thread.offer(large(7))));
    let summary = thread.finish();
    let (back, info) = read(&[&path]);
    let posted = info.counters.lost[&(SensorId::from("front"), LossPoint::Recorder)];
    assert_eq!(posted, lost.len() as u64, "each loss is posted once");
    let taken = offered.iter().filter(|(_, taken)| *taken).count();
    // The taken frames, the tick, and one gap before the tick, in the last dropped frame's place.
    assert_eq!(back.len(), taken + 2);
    assert_eq!(summary.counters.events, back.len() as u64);
    let at_tick = back.iter().position(|event| event.body == Body::Tick).unwrap();
    assert_eq!((back[at_tick - 1].seq, back[at_tick - 1].arrived.0), (5, 50));
    assert!(back.windows(2).all(|pair| pair[0].seq < pair[1].seq));
}

#[test]
fn handing_over_waits_for_room_and_loses_nothing() {
    let (_folder, path) = folder();
    let recorder = Recorder::create(&path, header("s"), RecorderOptions::default()).unwrap();
    let thread = RecorderThread::start_with(recorder, 10_000).unwrap();
    let events: Vec<_> = (0..500).map(|n| lidar(n, n as i64, &noise(1206, n))).collect();
    assert!(events.iter().all(|event| thread.hand_over(event.clone())));
    assert_eq!((thread.status().dropped, thread.finish().counters.events), (0, 500));
    assert_eq!(read(&[&path]).0, events);
}

#[test]
fn a_stopped_recorder_lets_everybody_go_on() {
    let (_folder, path) = folder();
    let options = RecorderOptions { min_free: Some(0), ..RecorderOptions::default() };
    let mut recorder = Recorder::create(&path, header("s"), options).unwrap();
    recorder.write(&tick(0, 0));
    recorder.stop_for_test();
    let thread = RecorderThread::start_with(recorder, 1000).unwrap();
    // More than the queue holds: whoever hands over is told and not held up.
    let refused = (0..100).filter(|n| !thread.hand_over(lidar(*n, 0, &[0; 900]))).count();
    assert_eq!(refused, 100);
    assert!(matches!(thread.status().state, RecorderState::Stopped { .. }));
    assert!(thread.finish().stopped.is_some());
}

#[test]
fn what_a_ledger_hands_its_outlets_is_recorded() {
    let (_folder, path) = folder();
    let recorder = Recorder::create(&path, header("s"), RecorderOptions::default()).unwrap();
    let thread = Arc::new(RecorderThread::start(recorder).unwrap());
    let mut outlet: Box<dyn Consumer> = Box::new(thread.clone());
    let events = [tick(0, 0), lidar(1, 1, b"a")];
    events.iter().for_each(|event| outlet.offer(event, ScanMark::Within, &Patience::default()));
    assert_eq!(thread.finish().counters.events, 2);
    assert_eq!(read(&[&path]).0, events);
    assert!(thread.finish().stopped.is_some(), "there is no second end");
}

#[test]
fn a_dropped_thread_leaves_a_finished_recording() {
    let (_folder, path) = folder();
    let recorder = Recorder::create(&path, header("s"), RecorderOptions::default()).unwrap();
    let thread = RecorderThread::start(recorder).unwrap();
    thread.offer(tick(0, 0));
    drop(thread);
    assert!(read(&[&path]).1.whole());
}
