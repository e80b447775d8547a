//! Health says what happened, in numbers.

use crate::support::chance::Chance;
use crate::support::devices::{KINECT_POINTS, LASERS, Way, kinect, lidar, packets, serial, silent_between, vlp32c};
use crate::support::faults::{lose, repeat};
use crate::support::ledger::{S, Source, anchors, ledger, run_with, ticks};
use crate::support::rig::{self, KINECT, LIDAR, TABLE};
use tumbled_core::health::{EpochHealth, Level, LossHealth, SensorState};
use tumbled_core::{CoreHealth, SensorHealth};

fn sensor<'a>(report: &'a CoreHealth, id: &str) -> &'a SensorHealth {
    report.sensors.iter().find(|sensor| sensor.id == id).expect("a sensor of the rig")
}

/// A rig's session, loss and repetition included, and four seconds of nothing.
fn session(lost: &mut u64, repeated: &mut u64) -> (Vec<Source>, u64) {
    let packets = packets(&vlp32c(), 5 * S);
    let mut front = lidar(&packets, Way::UDP, 1);
    let mut chance = Chance::new(3);
    *lost = lose(&mut front, 20_000, &mut chance);
    let before = front.len() as u64;
    *repeated = repeat(&mut front, 10_000, &mut chance);
    (vec![kinect(5 * S, Way::USB, 2), front, serial(5 * S), ticks(9 * S), anchors(9 * S, &[])], before)
}

#[test]
fn the_numbers_are_those_of_the_session() {
    let (mut lost, mut repeated) = (0, 0);
    let (sources, packets) = session(&mut lost, &mut repeated);
    let (mut turns, mut frames) = (0, 0);
    let (_, out) = run_with(rig::whole(), &ledger(&sources), |epoch| match epoch.sensor.as_str() {
        LIDAR => turns += 1,
        _ => frames += 1,
    });
    let last = out.health.last().expect("a report");
    let seconds: Vec<i64> = out.health.iter().map(|report| report.t_ns / S).collect();
    assert_eq!(seconds, [1, 2, 3, 4, 5, 6, 7, 8], "a report a second, when all of the second is in");

    let front = sensor(last, LIDAR);
    assert_eq!(front.received, packets + repeated);
    assert_eq!(front.bytes, front.received * 1_206);
    assert_eq!(front.lost, LossHealth { total: lost, by_stamps: lost, ..LossHealth::default() });
    assert_eq!(front.duplicates, repeated);
    let per_packet = 12 * LASERS.len() as u64;
    assert_eq!(front.points.decoded, (packets + repeated) * per_packet);
    assert_eq!((front.points.in_epochs, front.points.duplicate), (packets * per_packet, repeated * per_packet));
    assert_eq!(front.epochs, EpochHealth { given_out: turns, ..EpochHealth::default() });
    assert!(front.lidar.as_ref().and_then(|lidar| lidar.rpm).is_some_and(|rpm| (rpm - 600.0).abs() < 1.0));

    let near = sensor(last, KINECT);
    assert_eq!((near.received, near.points.in_epochs), (150, 150 * KINECT_POINTS));
    assert_eq!(near.epochs, EpochHealth { given_out: frames, ..EpochHealth::default() });
    // Twenty a second and the counts of a turn, each asked and answered.
    assert_eq!(sensor(last, TABLE).received, 2 * 101);

    // 1507 packets a second, 2 % lost, 1 % repeated; thirty frames; twenty questions and twenty answers.
    let third = &out.health[2];
    assert!((1_440.0..1_540.0).contains(&sensor(third, LIDAR).rate_hz), "{}", sensor(third, LIDAR).rate_hz);
    assert!((29.0..=31.0).contains(&sensor(third, KINECT).rate_hz));
    assert_eq!((sensor(third, TABLE).rate_hz, sensor(last, TABLE).rate_hz), (40.0, 0.0));
    let table = sensor(third, TABLE).turntable.as_ref().expect("a turntable");
    assert_eq!((table.samples_hz, table.counts_per_turn), (20.0, Some(36_000)));
}

/// The keys of the reasons in each report.
fn keys(health: &[CoreHealth]) -> Vec<(Level, Vec<&str>)> {
    let keys = |report: &'_ CoreHealth| report.reasons.iter().map(|reason| leak(&reason.key)).collect();
    health.iter().map(|report| (report.level, keys(report))).collect()
}

/// The key's constant.
fn leak(key: &str) -> &'static str {
    ["absent", "blind", "clock", "fault", "loss", "model", "no_data", "opening", "stale"]
        .into_iter()
        .find(|known| *known == key)
        .expect("a key of the list")
}

#[test]
fn a_reason_shows_in_its_second_report_and_goes_in_the_second_without_it() {
    let mut near = kinect(9 * S, Way::USB, 1);
    silent_between(&mut near, 2 * S, 5 * S);
    let front = lidar(&packets(&vlp32c(), 9 * S), Way::UDP, 1);
    let mut config = rig::whole();
    config.turntables.clear();
    let (_, out) = run_with(config, &ledger(&[near, front, ticks(10 * S)]), |_| {});
    // Stale at 3, 4 and 5 s (the first frame comes behind 5 s): told at 4 and 5, and at 6, which is the first without.
    let degraded = (Level::Degraded, vec!["stale"]);
    let fine = (Level::Ok, vec![]);
    let expected = [
        fine.clone(),
        fine.clone(),
        fine.clone(),
        degraded.clone(),
        degraded.clone(),
        degraded,
        fine.clone(),
        fine.clone(),
    ];
    assert_eq!(keys(&out.health)[..8], expected);
}

#[test]
fn without_any_sensor_it_has_failed() {
    let (_, out) = run_with(rig::whole(), &ledger(&[ticks(4 * S)]), |_| {});
    let levels: Vec<Level> = out.health.iter().map(|report| report.level).collect();
    assert_eq!(levels, [Level::Ok, Level::Failed, Level::Failed], "told from the second report on");
    assert_eq!(keys(&out.health)[2].1, ["no_data", "absent", "absent", "absent"]);
}

#[test]
fn an_empty_session_and_one_of_a_twentieth_of_a_second_give_nothing_silly() {
    let (pipeline, out) = run_with(rig::whole(), &[], |_| panic!("no epoch"));
    assert!(out.notices.is_empty() && out.health.is_empty());
    assert!(pipeline.sensors().iter().all(|sensor| sensor.state == SensorState::Absent && sensor.age_ns.is_none()));

    let until = S / 20;
    let sources = [kinect(until, Way::USB, 1), lidar(&packets(&vlp32c(), until), Way::UDP, 1), ticks(until)];
    let mut points = Vec::new();
    let (pipeline, out) = run_with(rig::whole(), &ledger(&sources), |epoch| points.push(epoch.scan.len()));
    // One frame (of 0 ms; that of 33 ms too), and the 75 packets that there were, cut or not.
    assert_eq!(points.len(), 2, "{points:?}");
    assert!(out.health.is_empty());
    for sensor in pipeline.sensors() {
        assert!(sensor.rate_hz == 0.0 && sensor.lost.total == 0, "{sensor:?}");
        assert_eq!(sensor.points.decoded, sensor.points.in_epochs);
    }
}

#[test]
fn a_session_without_ticks_gives_its_epochs_and_no_more_wait_than_memory_has_room_for() {
    let sources = [kinect(4 * S, Way::USB, 1), lidar(&packets(&vlp32c(), 4 * S), Way::UDP, 1)];
    let mut epochs = 0;
    let (_, out) = run_with(rig::whole(), &ledger(&sources), |_| epochs += 1);
    assert_eq!((epochs, out.health.len()), (120 + 41, 0));
}
