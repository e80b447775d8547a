//! Recordings as inputs beside foreign captures.

use super::*;
use crate::capture::{CaptureKind, Heartbeat, Merged, Routing, StampOrigin, merge, open_all};
use std::fs;
use tumbled_model::Span;

fn merged<P: AsRef<Path>>(paths: &[P]) -> Merged {
    merge(open_all(paths, &Routing::default()).unwrap()).unwrap()
}

fn fakenect(path: &Path, seconds: f64) {
    let frame = [b"P5 640 480 65535\n".to_vec(), vec![0; 614_400]].concat();
    fs::write(path.join(format!("d-{seconds:.6}-1.pgm")), frame).unwrap();
}

#[test]
fn a_recording_alone_keeps_its_numbers_and_times() {
    let (_folder, path) = folder();
    let events = [tick(5, -3), lidar(9, 70, &[0; 1206]), lidar(10, 60, &[0; 512])];
    record(&path, &events, RecorderOptions::default());
    let mut merged = merged(&[&path]);
    assert!(merged.is_ledger());
    assert_eq!(merged.epoch(), Some(START));
    assert_eq!(merged.by_ref().map(Result::unwrap).collect::<Vec<_>>(), events);
    let summary = merged.summaries().next().unwrap();
    assert_eq!((summary.kind, summary.stamp_origin), (CaptureKind::Recording, StampOrigin::Ledger));
    let traffic = summary.sensors[&SensorId::from("front")];
    assert_eq!((traffic.data_packets, traffic.position_packets), (1, 1));
    assert!(!summary.data_lost());
    assert!(summary.recording.as_ref().unwrap().whole());
}

#[test]
fn parts_given_one_by_one_are_one_input() {
    let (_folder, path) = folder();
    let events: Vec<_> = (0..4).map(|n| lidar(n, n as i64 * 10, b"x")).collect();
    let options = RecorderOptions { rotate_duration: Some(Span(20)), ..RecorderOptions::default() };
    let parts = record(&path, &events, options).parts;
    assert_eq!(parts.len(), 2);
    let back = |inputs: &[PathBuf]| merged(inputs).map(Result::unwrap).collect::<Vec<_>>();
    // As a shell lists them: '-' sorts before '.'.
    assert_eq!(back(&[parts[1].clone(), parts[0].clone()]), events);
    assert_eq!(back(&[path.parent().unwrap().to_owned()]), events, "their folder is the recording too");
}

#[test]
fn with_other_inputs_it_is_merged_by_host_time() {
    let (folder, path) = folder();
    let of_session = |seq, body| Event { seq, arrived: RigNs(0), body };
    let recorded = [
        tick(0, 0),
        lidar(1, 0, b"a"),
        of_session(2, Body::Config { toml: "[rig]\n".into() }),
        of_session(3, Body::Command(Command::Marker { text: "begin".into() })),
        lidar(4, 2_000_000_000, b"b"),
    ];
    record(&path, &recorded, RecorderOptions::default());
    let frames = folder.path().join("near");
    fs::create_dir(&frames).unwrap();
    fs::write(frames.join("INDEX.txt"), format!("d-{:.6}-1.pgm\n", 1_795_341_601.0)).unwrap();
    fakenect(&frames, 1_795_341_601.0);
    let events: Vec<_> = Heartbeat::of_captures(merged(&[&path, &frames])).map(Result::unwrap).collect();
    let data = events.iter().filter(|event| event.body.sensor().is_some());
    let found: Vec<_> = data.map(|event| (event.arrived.0, event.body.sensor().unwrap().to_string())).collect();
    let expected = [(0, "front"), (1_000_000_000, "near"), (2_000_000_000, "front")];
    assert_eq!(found, expected.map(|(at, id)| (at, id.to_owned())));
    // Ticks at 0.0, 0.1, … 2.0 s and anchors at 0, 1 and 2 s; the recording's own tick is not counted twice.
    let count = |body: fn(&Body) -> bool| events.iter().filter(|event| body(&event.body)).count();
    assert_eq!(count(|body| matches!(body, Body::Tick)), 21);
    assert_eq!(count(|body| matches!(body, Body::Anchor { .. })), 3);
    assert_eq!(count(|body| matches!(body, Body::Command(_))), 1);
    assert_eq!(count(|body| matches!(body, Body::Config { .. })), 0, "all inputs are read with one config");
    assert!(events.iter().enumerate().all(|(n, event)| event.seq == n as u64));
}

#[test]
fn the_heartbeat_comes_before_what_arrives_with_it_and_rests_in_long_silences() {
    let (folder, _) = folder();
    let frames = folder.path().join("near");
    fs::create_dir(&frames).unwrap();
    let at = [1_795_341_600.0, 1_795_341_600.25, 1_795_341_600.25 + 1e6];
    let index: String = at.iter().map(|seconds| format!("d-{seconds:.6}-1.pgm\n")).collect();
    fs::write(frames.join("INDEX.txt"), index).unwrap();
    at.iter().for_each(|seconds| fakenect(&frames, *seconds));
    let events: Vec<_> = Heartbeat::of_captures(merged(&[&frames])).map(Result::unwrap).collect();
    assert_eq!(events[0].body, Body::Anchor { unix: START });
    assert_eq!((&events[1].body, events[1].arrived), (&Body::Tick, RigNs(0)));
    assert!(matches!(events[2].body, Body::DepthFrame { .. }));
    // 0.1, 0.2, the frame at 0.25 s, then 0.3, 0.4, …
    assert_eq!(events[5].arrived, RigNs(250_000_000));
    assert_eq!((&events[6].body, events[6].arrived), (&Body::Tick, RigNs(300_000_000)));
    // Ticks 0.0 to 60.2 s: the silence after 0.25 s gets 60 s of them; then none for eleven days.
    let ticks = events.iter().filter(|event| event.body == Body::Tick).count();
    assert_eq!(ticks, 603);
    let last = events.last().unwrap();
    assert_eq!(last.arrived, RigNs(1_000_000_250_000_000), "the frame itself ends the ledger");
}

#[test]
fn a_killed_recording_as_an_input_tells_that_it_is_not_whole() {
    let (_folder, path) = folder();
    record(&path, &[lidar(0, 0, b"a"), lidar(1, 1, b"b")], RecorderOptions::default());
    let file = fs::read(&path).unwrap();
    fs::write(&path, &file[..file.len() - 20]).unwrap();
    let mut merged = merged(&[&path]);
    assert_eq!(merged.by_ref().count(), 2);
    assert!(merged.summaries().next().unwrap().data_lost());
}
