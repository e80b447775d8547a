//! Who waits for whom, and for how long.

use crate::support::devices::{Way, kinect, lidar, packets, silent_between, vlp32c};
use crate::support::ledger::{MS, S, Source, anchors, given_out_at, ledger, ticks};
use crate::support::rig::{self, KINECT, LIDAR};
use tumbled_core::{CoreConfig, Timing};

/// Each epoch: whose, its time, and the arrival of the event that let it out, ms.
fn given_out(config: CoreConfig, sources: &[Source]) -> Vec<(String, i64, i64)> {
    given_out_at(config, &ledger(sources))
}

fn rig_of(near: Source, front: Source, until: i64) -> Vec<Source> {
    vec![near, front, ticks(until), anchors(until, &[])]
}

fn near(until: i64) -> Source {
    kinect(until, Way::USB, 2)
}

fn front(until: i64) -> Source {
    lidar(&packets(&vlp32c(), until), Way::UDP, 1)
}

#[test]
fn with_both_sensors_there_nothing_waits_longer_than_for_the_other() {
    let out = given_out(rig::whole(), &rig_of(near(6 * S), front(6 * S), 7 * S));
    assert!(out.is_sorted_by_key(|(_, t, _)| *t));
    // A turn is cut 13 ms behind its middle; a frame comes 30 ms after its time, and some: an epoch waits for whichever of
    // the two is later.
    let worst = out.iter().filter(|(_, t, _)| *t > 1_000 && *t < 5_900).map(|(_, t, at)| at - t).max();
    assert!(worst.is_some_and(|worst| worst <= 60), "{worst:?} ms");
}

#[test]
fn a_camera_that_falls_silent_holds_the_lidar_up_for_the_hold_and_then_not_at_all() {
    let mut frames = near(10 * S);
    silent_between(&mut frames, 3 * S, 6 * S);
    let out = given_out(rig::whole(), &rig_of(frames, front(10 * S), 11 * S));
    assert!(out.is_sorted_by_key(|(_, t, _)| *t), "none goes backwards");
    let delays = |from: i64, to: i64| -> Vec<i64> {
        let within = out.iter().filter(|(id, t, _)| id == LIDAR && (from..to).contains(t));
        within.map(|(_, t, at)| at - t).collect()
    };
    // 150 ms from the turn's end, 13 ms behind the middle; to the next tenth of a second; 0.2 s in which events of before
    // may still come; to the next tick.
    let held = delays(3_050, 4_700);
    assert!(held.len() >= 16 && held.iter().all(|delay| (350..=470).contains(delay)), "{held:?}");
    // Silent after 2 s: at 5.0 s; judged 0.2 s later. From then on a turn goes out with its cut.
    let free = delays(5_310, 5_900);
    assert!(free.len() >= 5 && free.iter().all(|delay| *delay <= 20), "{free:?}");
    let first = out.iter().find(|(id, t, _)| id == KINECT && *t >= 5_900).expect("it is back");
    assert!((6_000..=7_000).contains(&first.1), "back within a second: {first:?}");
    let frames_after = out.iter().filter(|(id, t, _)| id == KINECT && *t >= 7_000).count();
    assert!(frames_after >= 85, "30 a second from then on: {frames_after}");
}

#[test]
fn a_lidar_that_falls_silent_comes_in_within_a_second_of_its_return() {
    let mut turns = front(10 * S);
    silent_between(&mut turns, 3 * S, 6 * S);
    let out = given_out(rig::whole(), &rig_of(near(10 * S), turns, 11 * S));
    assert!(out.is_sorted_by_key(|(_, t, _)| *t), "none goes backwards");
    let free = out.iter().filter(|(id, t, _)| id == KINECT && (5_310..5_900).contains(t));
    assert!(free.clone().count() >= 15 && free.clone().all(|(_, t, at)| at - t <= 40), "no frame waits");
    let back = out.iter().find(|(id, t, _)| id == LIDAR && *t >= 5_900).expect("it is back");
    assert!((6_000..=7_000).contains(&back.1), "{back:?}");
    let ten_a_second = out.iter().filter(|(id, t, _)| id == LIDAR && (7_000..9_900).contains(t)).count();
    assert!((28..=30).contains(&ten_a_second), "{ten_a_second}");
}

#[test]
fn a_sensor_that_is_late_once_is_waited_for_and_loses_what_came_too_late() {
    for (stall_ms, lost) in [(100, 0), (600, 10)] {
        let mut frames = near(6 * S);
        let stalled = frames.iter_mut().filter(|(at, _)| (3_000 * MS..(3_000 + stall_ms) * MS).contains(at));
        stalled.for_each(|(at, _)| *at = (3_000 + stall_ms) * MS);
        let out = given_out(rig::whole(), &rig_of(frames, front(6 * S), 7 * S));
        assert!(out.is_sorted_by_key(|(_, t, _)| *t), "none goes backwards");
        let given = out.iter().filter(|(id, ..)| id == KINECT).count();
        // 600 ms late: what was due more than 150 ms (250 with the tenth of a second) before a turn that has gone.
        let left_out = 180 - given;
        assert!((lost..=lost + lost / 2).contains(&left_out), "{stall_ms} ms: {left_out} left out");
        assert_eq!(out.iter().filter(|(id, ..)| id == LIDAR).count(), 61, "{stall_ms} ms");
    }
}

#[test]
fn a_sensor_that_never_comes_holds_the_other_up_for_two_seconds() {
    let out = given_out(rig::whole(), &rig_of(Vec::new(), front(5 * S), 6 * S));
    assert_eq!(out.len(), 51);
    assert!(out.iter().filter(|(_, t, _)| *t < 1_700).all(|(_, t, at)| at - t <= 470));
    assert!(out.iter().filter(|(_, t, _)| (2_300..4_900).contains(t)).all(|(_, t, at)| at - t <= 20));
}

#[test]
fn the_hold_and_the_silence_are_what_the_config_says() {
    let timing =
        Timing { hold: tumbled_model::Span(300 * MS), silent_after: tumbled_model::Span(S), ..Timing::default() };
    let config = CoreConfig { timing, ..rig::whole() };
    let out = given_out(config, &rig_of(Vec::new(), front(4 * S), 5 * S));
    let held: Vec<i64> = out.iter().filter(|(_, t, _)| *t < 650).map(|(_, t, at)| at - t).collect();
    assert!(!held.is_empty() && held.iter().all(|delay| (500..=620).contains(delay)), "{held:?}");
    assert!(out.iter().filter(|(_, t, _)| (1_300..3_900).contains(t)).all(|(_, t, at)| at - t <= 20));
}
