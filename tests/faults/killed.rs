//! A daemon that records a whole rig at full rate, killed at any moment: case 17.

use std::time::{Duration, SystemTime};

use tumbled::cli::recover::RecoverReport;
use tumbled_io::recording::Reader;

use super::session::S;
use crate::support::Workbench;
use crate::support::daemon::{Daemon, FREE_PORTS};

/// Kills after a moment that follows from `seed`; gives what of the session was lost, ns.
fn kill(seed: u64) -> i64 {
    let bench = Workbench::new();
    let arguments = ["run", "--sim", "demo", "--record", "run.mcap", "--min-free", "0"];
    let daemon = Daemon::start(&bench, &[&arguments[..], &FREE_PORTS].concat());
    // 1.2 to 4.2 s, by a multiplicative hash.
    let delay = 1_200 + (seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32) % 3_000;
    std::thread::sleep(Duration::from_millis(delay));
    let killed = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).expect("after 1970").as_nanos() as i64;
    daemon.signal("KILL");
    assert_eq!(daemon.finish().code, None, "a signal ended it");

    let mut reader = Reader::open(&[bench.path("run.mcap")]).expect("readable");
    let began = reader.header().unix_at_zero.0;
    let events: Vec<_> = reader.by_ref().map(|event| event.expect("readable")).collect();
    assert!(events.iter().enumerate().all(|(n, event)| event.seq == n as u64), "no hole before its end");
    assert!(!reader.info().whole(), "it says that it was not finished");
    let recovered = bench.run(&["recover", "run.mcap", "--json"]);
    let report: RecoverReport = recovered.json();
    assert_eq!((recovered.code, report.whole, report.ledger.events), (3, false, events.len() as u64));
    let mut whole = Reader::open(&[bench.path("run.recovered.mcap")]).expect("readable");
    assert_eq!(whole.by_ref().filter_map(Result::ok).count(), events.len());
    assert!(whole.info().whole(), "it has its footer");
    let newest = events.iter().map(|event| event.arrived.0).max().expect("something was recorded");
    killed - began - newest
}

fn kill_times(kills: u64) {
    let mut lost: Vec<i64> = (1..=kills).map(kill).collect();
    lost.sort_unstable();
    let ms = |place: usize| lost[place] / 1_000_000;
    println!(
        "case 17: killed {kills} times: {} ms lost in the median, {} ms at most",
        ms(lost.len() / 2),
        ms(lost.len() - 1)
    );
    assert!(lost.iter().all(|lost| *lost <= S), "{lost:?}");
}

#[test]
fn case_17_a_daemon_that_is_killed_while_it_records_costs_a_second_at_most() {
    kill_times(3);
}

#[test]
#[ignore = "some minutes: .ci/long runs it"]
fn case_17_fifty_kills_at_random_cost_a_second_each_at_most() {
    kill_times(50);
}
