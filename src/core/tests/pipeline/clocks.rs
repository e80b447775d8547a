//! What happens to the devices' clocks and to the host's, and what becomes of epochs' times.

use crate::support::devices::{FIRING_NS, Way, kinect, lidar, packets, vlp32c};
use crate::support::faults::set_clock;
use crate::support::ledger::{MS, S, Source, anchors, ledger, record, run_with, ticks};
use crate::support::rig;
use crate::synth::Sensor;
use tumbled_core::{NoticeKind, Outputs, Scan, Workers};
use tumbled_model::{Body, LidarTime, SensorId};
use tumbled_velodyne::encode::position_packet;
use tumbled_velodyne::position::Pps;

/// Three lasers in each of twelve firings hit something.
const PACKET_POINTS: u64 = 36;

/// The times of the epochs that saw the region, and what else came of a LiDAR's session. A clock that begins anew ends the
/// turn, so that there are others.
fn times(front: Source) -> (Vec<i64>, Outputs) {
    let until = front.last().map_or(0, |(arrived, _)| arrived + S);
    let mut times = Vec::new();
    let (_, out) = run_with(rig::lidar_only(), &ledger(&[front, ticks(until)]), |epoch| match &epoch.scan {
        Scan::Lidar(scan) if scan.coverage > 0.9 => times.push(epoch.t.0),
        _ => {}
    });
    (times, out)
}

/// How far the times of a 600 rpm sensor that began straight back are from the passings of the middle, between two times.
fn worst_error(times: &[i64], from: i64, to: i64) -> i64 {
    let within = times.iter().filter(|t| (from..to).contains(*t));
    let error = |t: &i64| (t - 12 * FIRING_NS - 50 * MS + 50 * MS).rem_euclid(100 * MS) - 50 * MS;
    within.map(|t| error(t).abs()).max().expect("turns")
}

#[test]
fn the_top_of_the_hour_moves_no_time() {
    let sensor = Sensor { start_us: 3_597_000_000, ..vlp32c() };
    let (times, out) = times(lidar(&packets(&sensor, 6 * S), Way::UDP, 1));
    assert!(worst_error(&times, 2_300 * MS, 5_900 * MS) < MS, "{}", worst_error(&times, 2_300 * MS, 5_900 * MS));
    assert!(out.notices.iter().all(|notice| notice.kind != NoticeKind::ClockReset));
}

#[test]
fn a_counter_that_goes_on_past_the_hour_moves_no_time() {
    // The synthetic sensor's stamps wrap; this one's do not.
    let sensor = Sensor { start_us: 0, ..vlp32c() };
    let mut packets = packets(&sensor, 6 * S);
    for packet in &mut packets {
        let stamp = u32::from_le_bytes(packet.bytes[1_200..1_204].try_into().expect("four bytes"));
        packet.bytes[1_200..1_204].copy_from_slice(&(stamp + 3_597_000_000).to_le_bytes());
    }
    let (times, _) = times(lidar(&packets, Way::UDP, 1));
    assert!(worst_error(&times, 2_300 * MS, 5_900 * MS) < MS);
}

#[test]
fn a_reboot_is_told_once_and_times_are_right_again_two_seconds_later() {
    let mut packets = packets(&vlp32c(), 8 * S);
    let at = packets.partition_point(|packet| packet.t_ns < 4 * S);
    set_clock(&mut packets, at, -4_900_000); // it counts from near 0 again
    let (times, out) = times(lidar(&packets, Way::UDP, 1));
    let resets = out.notices.iter().filter(|notice| notice.kind == NoticeKind::ClockReset).count();
    assert_eq!(resets, 1);
    assert!(times.is_sorted());
    assert!(worst_error(&times, 2_300 * MS, 3_900 * MS) < MS && worst_error(&times, 6_100 * MS, 7_900 * MS) < MS);
    // In between the arrivals are what there is: a packet's worth late, and its jitter.
    assert!(worst_error(&times, 4_200 * MS, 6_100 * MS) < 2 * MS);
}

#[test]
fn a_pulse_that_locks_and_is_lost_moves_no_time_by_more_than_a_millisecond() {
    let position = |at: i64, pps: Pps| {
        let bytes = position_packet(LidarTime((1_000_000 + at / 1_000) as u32), pps, "");
        (at, Body::LidarPacket { sensor: SensorId::from(rig::LIDAR), bytes: bytes.to_vec().into() })
    };
    let mut front = lidar(&packets(&vlp32c(), 9 * S), Way::UDP, 1);
    let state = |tenth: i64| match tenth {
        ..30 => Pps::Absent,
        30..40 => Pps::Synchronising,
        40..70 => Pps::Locked,
        _ => Pps::Absent,
    };
    front.extend((1..90).map(|tenth| position(tenth * 100 * MS, state(tenth))));
    front.sort_by_key(|(arrived, _)| *arrived);
    let (times, out) = times(front);
    assert!(worst_error(&times, 2_300 * MS, 8_900 * MS) < MS, "{}", worst_error(&times, 2_300 * MS, 8_900 * MS));
    let resets = out.notices.iter().filter(|notice| notice.kind == NoticeKind::ClockReset).count();
    assert_eq!(resets, 3, "each change begins a clock");
}

#[test]
fn one_wild_stamp_costs_its_own_points_and_nothing_else() {
    let clean = packets(&vlp32c(), 6 * S);
    let (calm, _) = times(lidar(&clean, Way::UDP, 1));
    // Minutes ahead, a little ahead, minutes back, half a second back; and the last two packets of a second on end.
    let wild =
        [(3_000, 400_000_000), (4_000, 300_000), (5_000, -200_000_000), (6_000, -500_000), (7_000, 1), (7_001, 2)];
    let mut broken = clean.clone();
    for (at, shift_s) in wild {
        let mut one = broken[at..=at].to_vec();
        set_clock(&mut one, 0, if at < 7_000 { shift_s } else { shift_s * 1_000_000_000 });
        broken[at] = one.remove(0);
    }
    let front = lidar(&broken, Way::UDP, 1);
    let points = (front.len() as u64 - 6) * PACKET_POINTS;
    let until = 7 * S;
    let (pipeline, out) = run_with(rig::lidar_only(), &ledger(&[front.clone(), ticks(until)]), |_| {});
    let sensor = &pipeline.sensors()[0];
    let (broken, _) = times(front);
    assert_eq!(broken, calm, "the same turns at the same times");
    assert!(out.notices.iter().all(|notice| notice.kind != NoticeKind::ClockReset), "{:?}", out.notices);
    let clock = sensor.clock.expect("a clock");
    assert_eq!((clock.resets, clock.state), (0, tumbled_core::ClockState::Locked));
    assert_eq!(sensor.points.in_epochs, points, "{:?}", sensor.points);
}

#[test]
fn a_wall_clock_that_is_set_changes_nothing_but_what_it_says() {
    let sources = |steps: &[(i64, i64)]| {
        let front = lidar(&packets(&vlp32c(), 5 * S), Way::UDP, 1);
        vec![kinect(5 * S, Way::USB, 2), front, ticks(6 * S), anchors(6 * S, steps)]
    };
    let hour = 3_600 * S;
    let run = |steps: &[(i64, i64)]| record(rig::whole(), &ledger(&sources(steps)), Workers::none(), true);
    let (calm, set) = (run(&[]), run(&[(2 * S, hour), (4 * S, -hour)]));
    assert_eq!(calm.epochs, set.epochs);
    let told: Vec<&String> = set.notices.iter().filter(|notice| !calm.notices.contains(notice)).collect();
    assert_eq!((told.len(), set.notices.len()), (2, calm.notices.len() + 2), "{told:?}");
    let without_wall = |health: &String| health.split("wall: WallHealth").next().map(str::to_owned);
    let sensors = |health: &[String]| health.iter().map(without_wall).collect::<Vec<_>>();
    assert_eq!(sensors(&calm.health), sensors(&set.health));
    assert!(set.health[3].contains("steps: 2") && set.health[2].contains("steps: 1"), "{:?}", set.health);
}

#[test]
fn a_kinects_counter_that_wraps_moves_no_time() {
    // 2³² ticks are 71.58 s; it begins 2 s before.
    let mut near = kinect(6 * S, Way::USB, 1);
    for (_, body) in &mut near {
        let Body::DepthFrame { ticks: Some(ticks), .. } = body else { panic!("a frame with ticks") };
        ticks.0 = ticks.0.wrapping_sub(180_000_000);
    }
    let mut times = Vec::new();
    let (_, out) = run_with(rig::kinect_only(), &ledger(&[near, ticks(7 * S)]), |epoch| times.push(epoch.t.0));
    assert_eq!(times.len(), 180);
    let steps = times.windows(2).skip(70).map(|pair| (pair[1] - pair[0] - 100 * MS / 3).abs()).max();
    assert!(steps.is_some_and(|step| step < MS), "{steps:?}");
    assert!(out.notices.iter().all(|notice| notice.kind != NoticeKind::ClockReset));
}
