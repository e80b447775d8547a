//! Rotation: parts that replay alone and together.

use super::*;
use crate::recording::recorder::part_path;
use crate::recording::{PartEnd, ReadError, RecorderError};
use std::fs;
use std::num::NonZeroU32;
use tumbled_model::Span;

/// 30 events a second apart, rotated every 10 s: parts of 10.
fn three_parts(path: &Path, keep: Option<u32>) -> (Vec<Event>, RecordingSummary) {
    let events: Vec<_> = (0..30).map(|n| lidar(n, n as i64 * 1_000_000_000, &noise(100, n))).collect();
    let options = RecorderOptions {
        rotate_duration: Some(Span(10_000_000_000)),
        keep: keep.and_then(NonZeroU32::new),
        ..RecorderOptions::default()
    };
    let summary = record(path, &events, options);
    (events, summary)
}

#[test]
fn each_part_replays_alone_from_its_own_start() {
    let (_folder, path) = folder();
    let (events, summary) = three_parts(&path, None);
    assert_eq!(summary.parts, [path.clone(), part_path(&path, 1).unwrap(), part_path(&path, 2).unwrap()]);
    for (n, part) in summary.parts.iter().enumerate() {
        let (back, info) = read(&[part]);
        assert_eq!(back, events[n * 10..n * 10 + 10], "part {n}");
        assert_eq!(info.header, header("s"), "config and all");
        assert!(info.whole(), "{info:?}");
    }
    assert_eq!(read(&[&path]).1.continued_in(), Some("session-0001.mcap"));
}

#[test]
fn parts_in_any_order_are_one_recording() {
    let (_folder, path) = folder();
    let (events, summary) = three_parts(&path, None);
    let shuffled = [&summary.parts[2], &summary.parts[0], &summary.parts[1]];
    let (back, info) = read(&shuffled);
    assert_eq!(back, events);
    assert!(info.whole() && info.continued_in().is_none());
    assert_eq!(info.parts[0].end, Some(PartEnd::Rotated { next: "session-0001.mcap".to_owned() }));
}

#[test]
fn a_part_that_was_not_given_is_told() {
    let (_folder, path) = folder();
    let (_, summary) = three_parts(&path, None);
    let (back, info) = read(&[&summary.parts[0], &summary.parts[2]]);
    assert_eq!((back.len(), info.missing_parts(), info.counters.missing_seqs), (20, 1, 10));
    assert!(!info.whole());
}

#[test]
fn keep_leaves_the_newest_parts() {
    let (_folder, path) = folder();
    let (events, summary) = three_parts(&path, Some(2));
    assert_eq!((summary.removed, summary.counters.events), (1, 30));
    assert!(!path.exists());
    assert_eq!(read(&summary.parts).0, events[10..]);
}

#[test]
fn size_rotates_at_chunk_boundaries() {
    let (_folder, path) = folder();
    let events: Vec<_> = (0..40).map(|n| lidar(n, n as i64, &noise(500_000, n))).collect();
    let options = RecorderOptions { rotate_bytes: Some(5_000_000), ..RecorderOptions::default() };
    let summary = record(&path, &events, options);
    // A chunk closes at the first message beyond 4 MiB: 9 messages of 500 kB. Two chunks exceed 5 MB: 18 messages a
    // part, so 18 + 18 + 4.
    let counts: Vec<_> = summary.parts.iter().map(|part| read(&[part]).0.len()).collect();
    assert_eq!(counts, [18, 18, 4]);
    assert_eq!(read(&summary.parts).0, events);
}

#[test]
fn files_of_different_sessions_and_parts_given_twice_are_refused() {
    let (folder, path) = folder();
    record(&path, &[tick(0, 0)], RecorderOptions::default());
    let other = folder.path().join("other.mcap");
    Recorder::create(&other, header("t"), RecorderOptions::default()).unwrap().finish();
    let different = Reader::open(&[&path, &other]).unwrap_err();
    assert!(matches!(different, ReadError::DifferentSessions { .. }), "{different}");
    let twice = Reader::open(&[&path, &path]).unwrap_err();
    assert!(matches!(twice, ReadError::SamePart { part: 0, .. }), "{twice}");
}

#[test]
fn a_file_in_the_way_is_refused_before_anything_is_recorded() {
    let (_folder, path) = folder();
    let in_the_way = part_path(&path, 1).unwrap();
    fs::write(&in_the_way, b"precious").unwrap();
    let options = RecorderOptions { rotate_bytes: Some(1), ..RecorderOptions::default() };
    let error = Recorder::create(&path, header("s"), options).unwrap_err();
    assert!(matches!(&error, RecorderError::Exists { path } if *path == in_the_way), "{error}");
    assert_eq!((fs::read(&in_the_way).unwrap(), path.exists()), (b"precious".to_vec(), false));
}
