//! D1: the same ledger gives the same bits.

use crate::support::devices::{Way, kinect, lidar, packets, serial, vlp32c};
use crate::support::ledger::{S, Source, anchors, ledger, record, ticks};
use crate::support::rig;
use std::sync::Arc;
use tumbled_core::Workers;

fn session() -> Vec<Source> {
    let front = lidar(&packets(&vlp32c(), 4 * S), Way::UDP, 1);
    vec![kinect(4 * S, Way::USB, 2), front, serial(4 * S), ticks(5 * S), anchors(5 * S, &[(2 * S, S)])]
}

#[test]
fn the_same_ledger_twice_gives_the_same_bits() {
    let events = ledger(&session());
    let first = record(rig::whole(), &events, Workers::none(), true);
    assert_eq!(first.difference(&record(rig::whole(), &events, Workers::none(), true)), None);
    // 4 s: 120 frames, 40 turns and the piece before the first cut, health of 1 to 4 s.
    assert_eq!((first.epochs.len(), first.health.len()), (161, 4));
    assert!(first.notices.len() >= 4, "live three times, a model, a step: {:#?}", first.notices);
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let events = ledger(&session());
    let alone = record(rig::whole(), &events, Workers::none(), true);
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let with = record(rig::whole(), &events, Workers::pool(Arc::new(pool)), true);
        assert_eq!(alone.difference(&with), None, "{threads} threads");
    }
}

#[test]
fn outputs_that_are_never_cleared_are_the_same() {
    let events = ledger(&session());
    let cleared = record(rig::whole(), &events, Workers::none(), true);
    assert_eq!(cleared.difference(&record(rig::whole(), &events, Workers::none(), false)), None);
}
