//! Full disks: the recording stops with its reason, what was recorded stays.

use super::*;
use crate::recording::{PartEnd, PartFile, RecorderState, StopReason, Storage};
use std::io::{self, Write};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// A disk in memory with so many bytes.
#[derive(Clone)]
pub(super) struct SmallDisk {
    left: Arc<AtomicU64>,
    content: Arc<Mutex<Vec<u8>>>,
}

impl SmallDisk {
    pub(super) fn new(bytes: u64) -> Self {
        Self { left: Arc::new(AtomicU64::new(bytes)), content: Arc::default() }
    }
}

impl Storage for SmallDisk {
    fn create(&mut self, _: &Path, _: bool) -> io::Result<Box<dyn PartFile>> {
        Ok(Box::new(self.clone()))
    }
    fn exists(&self, _: &Path) -> bool {
        false
    }
    fn remove(&mut self, _: &Path) -> io::Result<()> {
        Ok(())
    }
    fn free_bytes(&self, _: &Path) -> io::Result<u64> {
        Ok(self.left.load(Ordering::Relaxed))
    }
}

impl Write for SmallDisk {
    /// Takes what fits, as a disk does, and nothing once it is full.
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let left = self.left.load(Ordering::Relaxed);
        let fits = bytes.len().min(left as usize);
        if fits == 0 && !bytes.is_empty() {
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.left.store(left - fits as u64, Ordering::Relaxed);
        self.content.lock().unwrap().extend(&bytes[..fits]);
        Ok(fits)
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl PartFile for SmallDisk {
    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
    fn truncate(&mut self, length: u64) -> io::Result<()> {
        self.content.lock().unwrap().truncate(length as usize);
        Ok(())
    }
}

#[test]
fn a_full_disk_stops_the_recording_at_a_whole_record_and_nothing_else() {
    let disk = SmallDisk::new(1_000_000);
    let (_folder, path) = folder();
    let mut recorder =
        Recorder::create_on(Box::new(disk.clone()), &path, header("s"), RecorderOptions::default()).unwrap();
    let events: Vec<_> = (0..2000).map(|n| lidar(n, n as i64, &noise(1206, n))).collect();
    for (n, event) in events.iter().enumerate() {
        recorder.write(event);
        if n % 100 == 99 {
            recorder.sync();
        }
    }
    let RecorderState::Stopped { reason } = recorder.state() else { panic!("2.4 MB do not fit into 1 MB") };
    assert!(matches!(&reason, StopReason::Write { .. }), "{reason}");
    assert!(reason.to_string().contains("session.mcap"), "{reason}");
    let summary = recorder.finish();
    std::fs::write(&path, disk.content.lock().unwrap().as_slice()).unwrap();
    let (back, info) = read(&[&path]);
    assert_eq!(back, events[..back.len()]);
    // Chunks of 100 packets and their indexes: what is in the file is what was recorded less the chunk that failed.
    assert_eq!(back.len() as u64, summary.counters.events - summary.lost_at_stop);
    assert_eq!((back.len() % 100, summary.lost_at_stop), (0, 100));
    assert!(back.len() >= 700, "1 MB holds 7 chunks of 122 kB and more: {}", back.len());
    assert_eq!(summary.after_stop, 2000 - summary.counters.events);
    assert_eq!(info.damaged_bytes(), 0, "cut to its last whole record");
}

#[test]
fn too_little_space_stops_cleanly_with_an_end_record() {
    let disk = SmallDisk::new(1_000_000);
    let (_folder, path) = folder();
    let options = RecorderOptions { min_free: Some(500_000), ..RecorderOptions::default() };
    let mut recorder = Recorder::create_on(Box::new(disk.clone()), &path, header("s"), options).unwrap();
    let mut written = 0;
    for n in 0..2000 {
        written += u64::from(recorder.write(&lidar(n, n as i64, &noise(1206, n))));
        if n % 100 == 99 {
            recorder.sync();
        }
    }
    let RecorderState::Stopped { reason } = recorder.state() else { panic!("half of the disk is to stay free") };
    assert!(matches!(reason, StopReason::LowSpace { min_free: 500_000, .. }), "{reason}");
    recorder.finish();
    std::fs::write(&path, disk.content.lock().unwrap().as_slice()).unwrap();
    let (back, info) = read(&[&path]);
    assert_eq!(back.len() as u64, written);
    assert!(info.whole() && matches!(&info.parts[0].end, Some(PartEnd::Stopped { .. })), "{info:?}");
    assert!(info.warnings()[0].contains("the recorder stopped"), "{:?}", info.warnings());
}

#[test]
fn a_disk_too_full_to_begin_is_refused() {
    let (_folder, path) = folder();
    for (bytes, min_free) in [(100, None), (1_000_000, Some(2_000_000))] {
        let options = RecorderOptions { min_free, ..RecorderOptions::default() };
        let refused = Recorder::create_on(Box::new(SmallDisk::new(bytes)), &path, header("s"), options);
        let message = refused.unwrap_err().to_string();
        assert!(message.starts_with("cannot begin the recording: "), "{message}");
    }
}

#[test]
fn a_full_tmpfs_stops_the_recording() {
    let (folder, _) = folder();
    let mount = folder.path().join("tmpfs");
    std::fs::create_dir(&mount).unwrap();
    let run = |program: &str, arguments: &[&str]| {
        std::process::Command::new(program).args(arguments).arg(&mount).output().is_ok_and(|done| done.status.success())
    };
    if !run("mount", &["-t", "tmpfs", "-o", "size=1m", "tmpfs"]) {
        println!("skipped: a tmpfs cannot be mounted here");
        return;
    }
    let path = mount.join("session.mcap");
    let mut recorder = Recorder::create(&path, header("s"), RecorderOptions::default()).unwrap();
    let events: Vec<_> = (0..2000).map(|n| lidar(n, n as i64, &noise(1206, n))).collect();
    for (n, event) in events.iter().enumerate() {
        recorder.write(event);
        if n % 100 == 99 {
            recorder.sync();
        }
    }
    let summary = recorder.finish();
    let outcome = std::panic::catch_unwind(|| read(&[&path]));
    assert!(run("umount", &[]));
    let (back, info) = outcome.unwrap();
    assert!(matches!(summary.stopped, Some(StopReason::Write { .. })), "{summary:?}");
    assert_eq!(back, events[..back.len()]);
    assert_eq!(back.len() as u64, summary.counters.events - summary.lost_at_stop);
    assert_eq!(info.damaged_bytes(), 0);
}
