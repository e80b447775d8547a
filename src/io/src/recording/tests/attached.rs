//! The rig's files come back whole or not at all.

use super::*;
use crate::recording::{AttachedFile, InputFile, MAX_FILE_BYTES, MAX_FILES, RecorderError};
use bytes::Bytes;
use std::fs;
use tumbled_model::Span;

fn with_files(files: Vec<AttachedFile>) -> RecordingHeader {
    RecordingHeader { files, ..header("s") }
}

fn calibration() -> AttachedFile {
    AttachedFile::new("lidar.front.calibration", "db.xml", noise(5_000, 3).into())
}

#[test]
fn every_part_has_the_files() {
    let (_folder, path) = folder();
    let options = RecorderOptions { rotate_duration: Some(Span(20)), ..RecorderOptions::default() };
    let mut recorder = Recorder::create(&path, with_files(vec![calibration()]), options).unwrap();
    for n in 0..4 {
        recorder.write(&lidar(n, n as i64 * 10, b"x"));
    }
    let parts = recorder.finish().parts;
    assert_eq!(parts.len(), 2);
    for part in &parts {
        assert_eq!(Reader::open(&[part]).unwrap().header().files, [calibration()]);
    }
    // BLAKE3 of nothing (its specification's first test vector).
    let empty = AttachedFile::new("k", "n", Bytes::new()).file;
    let blake3 = "af1349b9f5f9a1a6a0404dea36dcc9499bcb25c9adc112b7cc9a93cae41f3262".to_owned();
    assert_eq!(empty, InputFile { name: "n".to_owned(), bytes: 0, blake3 });
}

#[test]
fn a_damaged_copy_is_not_given_back_and_the_events_are() {
    let (_folder, path) = folder();
    let table = AttachedFile::new("kinect.near.depth_table", "t.csv", Bytes::from_static(b"raw11,depth_mm\n"));
    let header = with_files(vec![calibration(), table.clone()]);
    let mut recorder = Recorder::create(&path, header, RecorderOptions::default()).unwrap();
    recorder.write(&tick(0, 0));
    recorder.finish();
    let mut file = fs::read(&path).unwrap();
    let at = file.windows(5_000).position(|window| window == noise(5_000, 3)).expect("attachments are not packed");
    file[at + 7] ^= 1;
    fs::write(&path, &file).unwrap();
    let (events, info) = read(&[&path]);
    assert_eq!(events, [tick(0, 0)]);
    let damaged = AttachedFile { content: None, ..calibration() };
    assert_eq!(info.header.files, [damaged, table]);
    let told = info.warnings();
    assert!(told.iter().any(|w| w.contains("db.xml") && w.contains("--set lidar.front.calibration=FILE")), "{told:?}");
    // Whoever copies it copies what is known, and the copy is as damaged as the original.
    let copy = path.with_file_name("copy.mcap");
    Recorder::create(&copy, info.header.clone(), RecorderOptions::default()).unwrap().finish();
    assert_eq!(Reader::open(&[&copy]).unwrap().header(), &info.header);
}

#[test]
fn more_than_is_read_back_is_not_begun() {
    let (_folder, path) = folder();
    let refused = |header| Recorder::create(&path, header, RecorderOptions::default()).unwrap_err();
    let file = |bytes: usize| AttachedFile::new("k", "n", vec![0; bytes].into());
    let error = refused(with_files(vec![file(MAX_FILE_BYTES + 1)]));
    assert!(matches!(error, RecorderError::TooLarge { found, .. } if found == MAX_FILE_BYTES + 1), "{error}");
    assert!(matches!(refused(with_files(vec![file(0); MAX_FILES + 1])), RecorderError::TooLarge { .. }));
    let config = "c".repeat((1 << 20) + 1);
    assert!(matches!(refused(RecordingHeader { config, ..header("s") }), RecorderError::TooLarge { .. }));
    assert!(!path.exists());
}

#[test]
fn a_damaged_config_is_not_taken_for_one_and_a_copy_of_the_recording_says_so_too() {
    let (_folder, path) = folder();
    Recorder::create(&path, header("s"), RecorderOptions::default()).unwrap().finish();
    let mut file = fs::read(&path).unwrap();
    let config = header("s").config;
    let at = file.windows(config.len()).position(|window| window == config.as_bytes()).expect("not packed");
    file[at + 8] ^= 1; // still TOML, another rig
    fs::write(&path, &file).unwrap();
    let (_, info) = read(&[&path]);
    assert_eq!((info.header.config.as_str(), info.header.config_damaged), ("", true));
    assert!(info.warnings().iter().any(|warning| warning.contains("--config FILE")), "{:?}", info.warnings());
    let copy = path.with_file_name("copy.mcap");
    Recorder::create(&copy, info.header.clone(), RecorderOptions::default()).unwrap().finish();
    assert_eq!(Reader::open(&[&copy]).unwrap().header(), &info.header);
}

#[test]
fn a_recording_without_a_config_has_none_and_that_is_no_damage() {
    let (_folder, path) = folder();
    let bare = RecordingHeader { config: String::new(), ..header("s") };
    Recorder::create(&path, bare.clone(), RecorderOptions::default()).unwrap().finish();
    assert_eq!(Reader::open(&[&path]).unwrap().header(), &bare);
}
