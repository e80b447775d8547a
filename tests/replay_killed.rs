//! A replay that records, killed at any moment: what it had played up to a second before is in the file.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

use tumbled::cli::recover::RecoverReport;
use tumbled_io::recording::Reader;
use tumbled_model::Span;

use crate::support::Workbench;
use crate::support::replaying::Replaying;
use crate::support::rig::{self, Rig};

/// Kills at the same time: a paced replay sleeps most of the time.
const AT_ONCE: u64 = 2;

/// Kills a replay after a moment that follows from `seed`; gives the rig time that was lost, ns.
fn kill(seed: u64) -> i64 {
    let bench = Workbench::new();
    let made = rig::record(Rig::new(80, 60), Span(6_000_000_000), &bench.path("import.mcap"));
    let replaying = Replaying::start(&bench, &["import.mcap", "--speed", "1", "--record", "out.mcap"]);
    // What a client was told had been played: the true rig time at the kill is later, by the 0.2 s that epochs wait.
    let seen = Arc::new(AtomicI64::new(0));
    let lines = replaying.lines("CLOUD");
    let client = std::thread::spawn({
        let seen = Arc::clone(&seen);
        move || lines.filter_map(|line| line["t_ns"].as_i64()).for_each(|t_ns| seen.store(t_ns, Ordering::Relaxed))
    });
    // 1.2 to 5.2 s, by a multiplicative hash.
    let delay = 1_200 + (seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32) % 4_000;
    std::thread::sleep(Duration::from_millis(delay));
    replaying.signal("KILL");
    let (code, _) = replaying.finish();
    assert_eq!(code, None, "a signal ended it");
    client.join().expect("no panic");

    let mut reader = Reader::open(&[bench.path("out.mcap")]).expect("readable");
    let events: Vec<_> = reader.by_ref().map(|event| event.expect("readable")).collect();
    assert!(events.iter().enumerate().all(|(n, event)| event.seq == n as u64), "no hole before its end");
    assert!(!reader.info().whole(), "it says that it was not finished");
    let recovered = bench.run(&["recover", "out.mcap", "--json"]);
    let report: RecoverReport = recovered.json();
    assert_eq!((recovered.code, report.whole, report.ledger.events), (3, false, events.len() as u64));
    assert!((events.len() as u64) < made, "{} of {made}", events.len());
    assert!(recovered.stderr.contains("out.mcap"), "{}", recovered.stderr);
    let whole = Reader::open(&[bench.path("out.recovered.mcap")]).expect("readable").filter_map(Result::ok).count();
    assert_eq!(whole, events.len());
    seen.load(Ordering::Relaxed) - events.last().map_or(0, |event| event.arrived.0)
}

fn kill_times(kills: u64) {
    let mut lost = Vec::new();
    for round in 0..kills.div_ceil(AT_ONCE) {
        let seeds = round * AT_ONCE..((round + 1) * AT_ONCE).min(kills);
        let running: Vec<_> = seeds.map(|seed| std::thread::spawn(move || kill(seed + 1))).collect();
        lost.extend(running.into_iter().map(|thread| thread.join().expect("judged")));
    }
    let greatest = lost.iter().max().copied().unwrap_or_default();
    println!("killed {} times: at most {} ms of rig time lost", lost.len(), greatest / 1_000_000);
    assert!(greatest <= 1_000_000_000, "{lost:?}");
}

#[test]
fn a_killed_replay_costs_its_recording_a_second_at_most() {
    kill_times(3);
}

#[test]
#[ignore = "a minute: .ci/long runs it"]
fn a_replay_killed_twenty_times_costs_its_recordings_a_second_at_most() {
    kill_times(20);
}
