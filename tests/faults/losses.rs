//! Packets that are lost, late, twice, or gone for seconds: cases 1 to 4.

use std::collections::BTreeSet;

use tumbled_core::NoticeKind;
use tumbled_core::health::SensorState;
use tumbled_model::{Body, Event};
use tumbled_sim::faults::{FaultInjector, FaultScript};

use super::session::{MS, S, Seen, both, play, seconds};
use crate::support::rig::{PACKET_POINTS, lidar_core};

/// One packet in a hundred lost, against the same without loss.
fn assert_losses_are_counted(length_s: i64) {
    let events = || seconds(length_s, true, false);
    let loss = "[[fault]]\nsensor = \"front\"\naction.loss.probability = 0.01\n";
    let (whole, lossy) = (play(events(), "", lidar_core()), play(events(), loss, lidar_core()));
    let (front, lost) = (lossy.sensor("front"), lossy.done("front").lost);
    println!("case 1: {} counted of {lost} lost in {length_s} s", front.lost.total);
    // 15.07 of 1507 packets a second, with a standard deviation of its root: five of them are allowed for.
    let expected = 15.07 * length_s as f64;
    assert!((lost as f64 - expected).abs() < 5.0 * expected.sqrt(), "{lost} of {expected} expected");
    assert!(front.lost.total.abs_diff(lost) * 500 <= lost, "{} of {lost}", front.lost.total);
    assert_eq!(lossy.states("front").len(), 1, "live from its first packet to the end: {:?}", lossy.notices);
    assert_eq!(front.clock.map(|clock| clock.resets), Some(0));
    // Every turn is an epoch as without loss, and when it was.
    let times = |epochs: &[Seen]| epochs.iter().map(|epoch| epoch.t).collect::<Vec<_>>();
    let (calm, lossy) = (times(&whole.epochs), times(&lossy.epochs));
    assert_eq!(calm.len(), lossy.len());
    let moved = calm.iter().zip(&lossy).skip(30).map(|(a, b)| (a - b).abs()).max();
    println!("case 1: no crossing's time is moved by more than {} us", moved.unwrap_or_default() / 1_000);
    assert!(moved.is_some_and(|moved| moved < MS), "{moved:?}");
}

#[test]
fn case_01_one_packet_in_a_hundred_lost_is_counted_within_two_in_a_thousand() {
    assert_losses_are_counted(20);
}

#[test]
#[ignore = "of a minute: .ci/long runs it"]
fn case_01_a_minute_with_one_packet_in_a_hundred_lost_is_counted_within_two_in_a_thousand() {
    assert_losses_are_counted(60);
}

#[test]
fn case_02_a_fifth_of_a_second_without_the_lidar_is_no_change_of_state_and_no_step_back() {
    let burst = "[[fault]]\nsensor = \"front\"\nfrom_s = 4.0\nuntil_s = 4.2\naction = \"unplug\"\n";
    let played = play(seconds(7, true, true), burst, both());
    let silenced = played.done("front").silenced;
    assert!((300..=303).contains(&silenced), "{silenced} packets of 0.2 s");
    assert_eq!(played.sensor("front").lost.total, silenced);
    assert_eq!((played.states("front").len(), played.states("near").len()), (1, 1), "{:?}", played.notices);
    played.assert_in_order();
    // The camera goes on meanwhile, and the LiDAR with the first crossing after it.
    assert_eq!(played.between(false, 4 * S, 5 * S), 30);
    assert!(played.between(true, 4_200 * MS, 4_400 * MS) >= 1);
    assert_eq!(played.between(true, 5 * S, 6 * S), 10);
}

#[test]
fn case_03_five_seconds_without_the_lidar_are_stale_within_a_second_and_live_within_half_a_second_of_its_return() {
    let silence = "[[fault]]\nsensor = \"front\"\nfrom_s = 4.0\nuntil_s = 9.1\naction = \"unplug\"\n";
    let played = play(seconds(15, true, true), silence, both());
    let [(_, SensorState::Live), (stale, SensorState::Stale), (live, SensorState::Live)] = played.states("front")[..]
    else {
        panic!("{:?}", played.notices)
    };
    assert!(stale <= 5 * S && (9_100 * MS..=9_600 * MS).contains(&live), "{stale} {live}");
    println!("case 3: stale after {} ms, live {} ms after its return", stale / MS - 4_000, live / MS - 9_100);
    // The camera's frames are all there: 30 a second.
    assert_eq!(played.between(false, 4 * S, 9 * S), 150);
    assert_eq!(played.told("front", NoticeKind::ClockReset).len(), 1, "{:?}", played.notices);
    assert!(played.between(true, 9_100 * MS, 10_300 * MS) >= 5, "it is in again");
    played.assert_in_order();
}

/// What the LiDAR's stamps show of a ledger, by themselves.
#[derive(Debug, Default)]
struct Order {
    /// Packets that came after later ones.
    late: u64,
    /// Of them those that came after more than three.
    beyond: u64,
    /// Packets that had come before.
    twice: u64,
}

fn order(events: impl Iterator<Item = Event>) -> Order {
    let (mut seen, mut order) = (BTreeSet::new(), Order::default());
    for event in events {
        let Body::LidarPacket { bytes, .. } = &event.body else { continue };
        let stamp = u32::from_le_bytes(bytes[1_200..1_204].try_into().expect("four bytes"));
        // Past the hour the count goes on.
        let stamp = u64::from(stamp) + if stamp < 1_800_000_000 { 3_600_000_000 } else { 0 };
        let overtaken_by = seen.range(stamp + 1..).count();
        if !seen.insert(stamp) {
            order.twice += 1;
        } else if overtaken_by > 0 {
            order.late += 1;
            order.beyond += u64::from(overtaken_by > 3);
        }
    }
    order
}

#[test]
fn case_04_packets_overtaken_by_three_and_every_twentieth_twice_give_the_same_points_once() {
    let script = "[[fault]]\nsensor = \"front\"\nfrom_s = 2.0\naction.reorder = { probability = 0.05, depth = 3 }\n\
                  [[fault]]\nsensor = \"front\"\nfrom_s = 2.0\naction.duplicate.probability = 0.05\n";
    let twelve = || seconds(12, true, false);
    let (calm, shaken) = (play(twelve(), "", lidar_core()), play(twelve(), script, lidar_core()));
    let parsed: FaultScript = toml::from_str(script).expect("a fault script");
    let Order { late, beyond, twice } =
        order(FaultInjector::new(twelve(), parsed).expect("faults that mean something"));
    let front = shaken.sensor("front");
    // 10 s are 15 070 packets: 750 of each, give or take 150.
    assert!((600..900).contains(&late) && (600..900).contains(&twice), "{late} {twice}");
    assert_eq!((front.reordered, front.duplicates, front.lost.total), (late, twice, 0));
    assert_eq!(shaken.done("front").duplicated, twice);
    // Nothing is lost, so all is there, once, but what was overtaken by an overtaken packet too.
    assert!(beyond < late / 50, "{beyond} of {late}");
    let points = front.points;
    assert_eq!(points.in_epochs, calm.sensor("front").points.in_epochs - beyond * PACKET_POINTS);
    assert_eq!((points.late, points.duplicate), (beyond * PACKET_POINTS, twice * PACKET_POINTS));
    assert_eq!(calm.epochs.len(), shaken.epochs.len());
    let (mut moved, mut same) = (0, 0);
    for (a, b) in calm.epochs.iter().zip(&shaken.epochs) {
        same += u64::from((a.points, a.digest) == (b.points, b.digest));
        moved = moved.max((a.t - b.t).abs());
    }
    println!(
        "case 4: {late} late, {twice} twice; {same} of {} epochs the same, moved by {moved} ns",
        calm.epochs.len()
    );
    assert!(same + beyond >= calm.epochs.len() as u64, "each has the clean run's points to the bit");
    assert!(moved < 50_000, "{moved} ns: overtaken packets teach the clock nothing");
}
