//! What recording costs; a measurement, run by hand: `cargo test --release -p tumbled-io rate -- --ignored --nocapture`.

use super::*;
use crate::capture::{Routing, merge, open_all};
use std::time::Instant;

/// Seconds of the session recorded.
const SECONDS: u64 = 10;
/// A VLP-32C in single return mode, and a Kinect.
const PACKETS_PER_S: u64 = 1507;
const FRAMES_PER_S: u64 = 30;
/// How many rigs at once.
const RIGS: u64 = 4;

/// Real payloads over and over, as a rig would give them; a sync each second of the session.
#[test]
#[ignore = "a measurement of the machine"]
fn share_of_a_core_at_four_times_the_rig_rate() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/");
    let inputs = ["velodyne/vlp32c_strongest_600rpm_fov180_a.pcap", "kinect/seq7_raw11"].map(|name| {
        let path = format!("{root}{name}");
        if !Path::new(&path).exists() {
            println!("skipped: ../shared/data/{name} is not there");
        }
        path
    });
    if !inputs.iter().all(|path| Path::new(path).exists()) {
        return;
    }
    let bodies = |path: &String| -> Vec<Body> {
        let merged = merge(open_all(&[path], &Routing::default()).unwrap()).unwrap();
        merged.map(|event| event.unwrap().body).collect()
    };
    let [packets, frames] = inputs.each_ref().map(bodies);
    let (_folder, path) = folder();
    let mut recorder = Recorder::create(&path, header("rate"), RecorderOptions::default()).unwrap();
    let ticks = SECONDS * FRAMES_PER_S * RIGS;
    let (mut seq, mut payload) = (0, 0);
    let mut longest_sync = std::time::Duration::ZERO;
    let begun = Instant::now();
    let mut packet = 0;
    for tick in 0..ticks {
        let at = RigNs((tick * 1_000_000_000 / (FRAMES_PER_S * RIGS)) as i64);
        while packet < (tick + 1) * PACKETS_PER_S / FRAMES_PER_S {
            recorder.write(&Event { seq, arrived: at, body: packets[packet as usize % packets.len()].clone() });
            (seq, packet, payload) = (seq + 1, packet + 1, payload + 1206);
        }
        let body = frames[tick as usize % frames.len()].clone();
        payload += crate::recording::layout::payload_bytes(&body) as u64;
        recorder.write(&Event { seq, arrived: at, body });
        seq += 1;
        if (tick + 1) % (FRAMES_PER_S * RIGS) == 0 {
            let sync = Instant::now();
            recorder.sync();
            longest_sync = longest_sync.max(sync.elapsed());
        }
    }
    let summary = recorder.finish();
    let took = begun.elapsed();
    assert_eq!(summary.counters.events, seq);
    println!(
        "{RIGS} rigs for {SECONDS} s: {:.1} MB of payload, {:.1} MB of file, {:.2} s of wall time = {:.1} % of a core; \
         longest sync {longest_sync:?}",
        payload as f64 / 1e6,
        summary.file_bytes as f64 / 1e6,
        took.as_secs_f64(),
        took.as_secs_f64() / SECONDS as f64 * 100.0
    );
    let begun = Instant::now();
    let back = Reader::open(&[&path]).unwrap().inspect(|event| assert!(event.is_ok())).count();
    println!("read back: {back} events in {:.2} s", begun.elapsed().as_secs_f64());
    assert_eq!(back as u64, seq);
}
