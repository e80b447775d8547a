//! Claims about the ways out of the ledger.

use super::*;
use bytes::Bytes;
use proptest::prelude::*;

/// A payload that, with the event's own cost, makes 1 000 bytes.
const PAYLOAD: usize = 1_000 - EVENT_COST;

fn data(seq: u64, sensor: &str) -> Event {
    let bytes = Bytes::from(vec![seq as u8; PAYLOAD]);
    Event { seq, arrived: RigNs(seq as i64), body: Body::LidarPacket { sensor: sensor.into(), bytes } }
}

fn tick(seq: u64) -> Event {
    Event { seq, arrived: RigNs(seq as i64), body: Body::Tick }
}

fn gap(seq: u64, sensor: &str, lost: u32) -> Event {
    let body = Body::Gap { sensor: sensor.into(), lost, place: LossPoint::Recorder };
    Event { seq, arrived: RigNs(seq as i64), body }
}

fn offer(outlet: &mut QueueOutlet, event: &Event) {
    outlet.offer(event, ScanMark::Within, &Patience::default());
}

#[test]
fn a_full_recorder_loses_data_and_the_gap_stands_where_they_were() {
    let (mut outlet, receiver) = QueueOutlet::recorder(WhenFull::Lose, 2_000);
    for seq in 0..5 {
        offer(&mut outlet, &data(seq, "front"));
    }
    assert_eq!([receiver.recv(), receiver.recv()], [Some(data(0, "front")), Some(data(1, "front"))]);
    offer(&mut outlet, &data(5, "front"));
    let counts = outlet.gauge().expect("a queue").counts();
    assert_eq!((counts.taken, counts.lost), (4, 3)); // 0, 1, the gap and 5; 2, 3 and 4
    drop(outlet);
    assert_eq!(receiver.collect::<Vec<_>>(), [gap(4, "front", 3), data(5, "front")]);
}

#[test]
fn the_notes_of_a_full_recorder_go_on_and_keep_the_order() {
    let (mut outlet, receiver) = QueueOutlet::recorder(WhenFull::Lose, 1_000);
    let events = [data(0, "front"), data(1, "front"), data(2, "near"), tick(3), data(4, "near")];
    for event in &events {
        offer(&mut outlet, event);
    }
    drop(outlet);
    let seen: Vec<Event> = receiver.collect();
    assert_eq!(seen, [data(0, "front"), gap(1, "front", 1), gap(2, "near", 1), tick(3), gap(4, "near", 1)]);
}

#[test]
fn notes_beyond_the_reserve_are_counted() {
    let (mut outlet, _receiver) = QueueOutlet::new(WhenFull::Lose, 1_000, 2 * EVENT_COST, None);
    offer(&mut outlet, &data(0, "front"));
    for seq in 1..=5 {
        offer(&mut outlet, &tick(seq));
    }
    assert_eq!(outlet.gauge().expect("a queue").counts().lost_notes, 3);
}

#[test]
fn an_event_larger_than_the_bound_passes_an_empty_queue() {
    let (mut outlet, receiver) = QueueOutlet::recorder(WhenFull::Lose, 10);
    offer(&mut outlet, &data(0, "front"));
    assert_eq!(receiver.recv(), Some(data(0, "front")));
    let (mut outlet, receiver) = QueueOutlet::core(10, None);
    offer(&mut outlet, &data(0, "front"));
    assert_eq!(receiver.recv(), Some(data(0, "front")));
}

#[test]
fn the_core_is_behind_when_three_scans_wait_and_catches_up_by_taking_one() {
    let (mut outlet, receiver) = QueueOutlet::core(usize::MAX, Some(3));
    let front = SensorId::from("front");
    let patience = Patience::default();
    for seq in 0..6 {
        // Two packets a scan.
        let scan = if seq % 2 == 0 { ScanMark::Begins } else { ScanMark::Within };
        outlet.offer(&data(seq, "front"), scan, &patience);
        assert_eq!(outlet.is_behind(&front), seq >= 4, "after event {seq}");
    }
    assert!(!outlet.is_behind(&"near".into()), "each sensor has its own scans");
    outlet.offer(&data(6, "front"), ScanMark::BeginsShed, &patience);
    receiver.recv();
    assert!(!outlet.is_behind(&front), "a shed scan does not count");
}

#[test]
fn a_full_core_holds_the_ledger_back_and_loses_nothing() {
    let (mut outlet, receiver) = QueueOutlet::core(3_000, None);
    let ledger = std::thread::spawn(move || {
        for seq in 0..100 {
            offer(&mut outlet, &data(seq, "front"));
        }
        outlet.gauge().expect("a queue").counts()
    });
    let seen: Vec<u64> = receiver.map(|event| event.seq).collect();
    assert_eq!(seen, (0..100).collect::<Vec<_>>());
    let counts = ledger.join().expect("no panic");
    assert_eq!((counts.taken, counts.lost, counts.undelivered), (100, 0, 0));
}

#[test]
fn patience_with_a_core_that_hangs_ends_with_the_session() {
    let (mut outlet, _receiver) = QueueOutlet::core(1_000, None);
    let patience = Patience::default();
    outlet.offer(&data(0, "front"), ScanMark::Within, &patience);
    patience.end_in(Duration::ZERO);
    outlet.offer(&data(1, "front"), ScanMark::Within, &patience);
    assert_eq!(outlet.gauge().expect("a queue").counts().undelivered, 1);
}

#[test]
fn a_receiver_that_is_gone_holds_nobody_back() {
    let (mut outlet, receiver) = QueueOutlet::core(1_000, None);
    drop(receiver);
    for seq in 0..3 {
        offer(&mut outlet, &data(seq, "front"));
    }
    assert_eq!(outlet.gauge().expect("a queue").counts().undelivered, 3);
}

#[test]
fn the_end_is_told_after_the_last_event() {
    let (mut outlet, receiver) = QueueOutlet::core(usize::MAX, None);
    offer(&mut outlet, &tick(0));
    drop(outlet);
    assert!(!receiver.is_finished());
    assert_eq!(receiver.recv_timeout(Duration::from_secs(3_600)), Some(tick(0)));
    assert!(receiver.is_finished());
    assert_eq!(receiver.recv(), None);
}

proptest! {
    #[test]
    fn recorded_and_gaps_make_up_the_ledger_and_seq_never_goes_back(
        steps in prop::collection::vec(0u8..5, 1..300)
    ) {
        // 0: the recorder takes one; 1: a tick; 2..: data of one of three sensors.
        let (mut outlet, receiver) = QueueOutlet::recorder(WhenFull::Lose, 3_000);
        let (mut seq, mut seen) = (0, Vec::new());
        for step in &steps {
            match step {
                0 => seen.extend(receiver.recv_timeout(Duration::ZERO)),
                1 => { offer(&mut outlet, &tick(seq)); seq += 1; }
                sensor => { offer(&mut outlet, &data(seq, ["a", "b", "c"][usize::from(*sensor) - 2])); seq += 1; }
            }
        }
        drop(outlet);
        seen.extend(receiver);
        prop_assert!(seen.is_sorted_by(|a, b| a.seq < b.seq));
        for (sensor, step) in ["a", "b", "c"].into_iter().zip(2u8..) {
            let offered = steps.iter().filter(|s| **s == step).count() as u64;
            let of_sensor = seen.iter().filter(|event| event.body.sensor().is_some_and(|s| s.as_str() == sensor));
            let accounted: u64 = of_sensor.map(|event| match event.body {
                Body::Gap { lost, .. } => u64::from(lost),
                _ => 1,
            }).sum();
            prop_assert_eq!(accounted, offered);
        }
    }
}
