//! What is missing is counted once, by whoever can tell best.

use crate::support::chance::Chance;
use crate::support::devices::{Way, kinect, lidar, lidar_packet, packets, vlp32c};
use crate::support::faults::{burst, gap, set_clock};
use crate::support::ledger::{S, Source, US, ledger, run_with, ticks};
use crate::support::rig::{self, KINECT, LIDAR};
use crate::synth::{Packet, Sensor};
use proptest::prelude::*;
use tumbled_core::health::LossHealth;
use tumbled_core::{Outputs, Pipeline, Workers};
use tumbled_model::{CivilTime, LidarTime, LossPoint};
use tumbled_velodyne::hdl64::encode::{Said, Slot};
use tumbled_velodyne::hdl64::{Calibration, Generation, Hdl64Encoder, LASERS, LaserCalibration, Unit};

fn session() -> Vec<Packet> {
    packets(&vlp32c(), S)
}

/// What is said to be lost when all is over.
fn lost(front: Source) -> LossHealth {
    let until = front.last().map_or(0, |(arrived, _)| arrived + S);
    let (pipeline, _) = run_with(rig::lidar_only(), &ledger(&[front, ticks(until)]), |_| {});
    pipeline.sensors()[0].lost
}

/// `n` packets lost from the 700th on, of which the host says that the kernel lost `told`.
fn lost_and_told(packets: &[Packet], n: usize, told: u32) -> LossHealth {
    let mut front = lidar(packets, Way::UDP, 1);
    burst(&mut front, 700, n);
    let at = front[700].0;
    front.insert(700, (at, gap(LIDAR, told, LossPoint::Kernel)));
    lost(front)
}

#[test]
fn what_the_kernel_tells_of_and_stamps_show_is_counted_once() {
    let expected = LossHealth { total: 5, by_stamps: 5, kernel: 5, ..LossHealth::default() };
    assert_eq!(lost_and_told(&session(), 5, 5), expected);
}

#[test]
fn what_was_lost_on_the_way_beside_it_is_counted_too() {
    let expected = LossHealth { total: 9, by_stamps: 9, kernel: 5, ..LossHealth::default() };
    assert_eq!(lost_and_told(&session(), 9, 5), expected);
}

#[test]
fn at_the_end_the_hosts_word_is_all_there_is() {
    let mut front = lidar(&session(), Way::UDP, 1);
    front.push((front[front.len() - 1].0, gap(LIDAR, 7, LossPoint::Queue)));
    assert_eq!(lost(front), LossHealth { total: 7, queue: 7, ..LossHealth::default() });
}

#[test]
fn before_the_first_packet_the_hosts_word_is_all_there_is() {
    let mut front = lidar(&session(), Way::UDP, 1);
    front.insert(0, (0, gap(LIDAR, 7, LossPoint::Queue)));
    assert_eq!(lost(front), LossHealth { total: 7, queue: 7, ..LossHealth::default() });
}

#[test]
fn before_a_clock_that_was_set_the_hosts_word_is_all_there_is() {
    let mut packets = session();
    set_clock(&mut packets, 705, -30_000_000);
    let expected = LossHealth { total: 5, kernel: 5, ..LossHealth::default() };
    assert_eq!(lost_and_told(&packets, 5, 5), expected);
}

#[test]
fn a_packet_that_was_overtaken_is_not_lost() {
    let mut front = lidar(&session(), Way::UDP, 1);
    let (_, overtaken) = front.remove(700);
    front.insert(702, (front[701].0, overtaken));
    assert_eq!(lost(front), LossHealth::default());
}

#[test]
fn frames_are_lost_where_it_was_noticed() {
    let mut near = kinect(S, Way::USB, 1);
    near.insert(10, (near[9].0, gap(KINECT, 2, LossPoint::Usb)));
    near.insert(20, (near[19].0, gap(KINECT, 1, LossPoint::Queue)));
    let (pipeline, _) = run_with(rig::kinect_only(), &ledger(&[near, ticks(2 * S)]), |_| {});
    assert_eq!(pipeline.sensors()[0].lost, LossHealth { total: 3, usb: 2, queue: 1, ..LossHealth::default() });
}

/// A second of an HDL-64E S1, which has no clock: 600 rpm, 3472 packets.
fn hdl64e_s1() -> (Calibration, Source) {
    let calibration = Calibration::new([LaserCalibration::default(); LASERS]).expect("plausible");
    let unit = Unit {
        noise_upper: 0,
        noise_lower: 0,
        calibrated: None,
        humidity_percent: 0,
        rpm: 600,
        view_from_cdeg: 0,
        view_to_cdeg: 36_000,
        hours: 0,
        source_ip: [0; 4],
        destination_ip: [0; 4],
        return_mode: 0,
        warnings: 0,
        power: 0,
    };
    let time = CivilTime { year: 2026, month: 11, day: 22, hour: 8, minute: 30, second: 59, nanosecond: 0 };
    let said = Said { time, gps: b'A', temperature_c: 31, firmware: 0, warnings: 0 };
    let mut encoder = Hdl64Encoder::new(Generation::S1, &calibration, &unit);
    let packet = |n: i64| {
        let azimuth = |block: i64| ((n * 6 + block / 2) * 360_000 * 48 / 1_000_000 % 36_000) as u16;
        let azimuths = core::array::from_fn(|block| azimuth(block as i64));
        let slots = [[Slot { raw: 2_000, intensity: 9 }; 32]; 12];
        (n * 288 * US, lidar_packet(&encoder.encode(LidarTime(0), &azimuths, &slots, &said)))
    };
    let source = (0..3_472).map(packet).collect();
    (calibration, source)
}

#[test]
fn of_a_sensor_without_a_clock_the_hosts_word_is_all_there_is() {
    let (calibration, mut front) = hdl64e_s1();
    burst(&mut front, 1_000, 30);
    front.insert(1_000, (front[1_000].0, gap(LIDAR, 30, LossPoint::Kernel)));
    let mut config = rig::lidar_only();
    config.lidars[0].decoder.hdl64e_calibration = Some(calibration);
    let mut turns = 0;
    let (pipeline, _) = run_with(config, &ledger(&[front, ticks(2 * S)]), |_| turns += 1);
    let sensor = &pipeline.sensors()[0];
    assert_eq!(sensor.lost, LossHealth { total: 30, kernel: 30, ..LossHealth::default() });
    // A second of 600 rpm from the middle of the region on: ten cuts, eleven pieces.
    assert_eq!((turns, sensor.points.decoded), (11, sensor.points.in_epochs), "{sensor:?}");
    assert_eq!(sensor.clock, None);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    /// Bursts of loss, of each a part told by the host: the total is never above the truth at any time, and at the end it
    /// is the truth.
    #[test]
    fn the_total_is_never_more_than_was_lost_and_in_the_end_as_much(
        bursts in prop::collection::vec((0usize..1_000, 1usize..40, 0u32..=100), 1..6),
        silent_deg in prop_oneof![Just(None), Just(Some((40.0, 320.0))), Just(Some((300.0, 60.0)))],
        seed in any::<u64>(),
    ) {
        let sensor = Sensor { silent_deg, start_deg: 100.0, ..vlp32c() };
        let packets = packets(&sensor, S);
        let mut lost = vec![false; packets.len()];
        // Where a view ends is not known before a few turns have shown it.
        let known = packets.partition_point(|packet| packet.t_ns < 400_000_000);
        // Two bursts at the same azimuths would be taken for the view's limit.
        let bursts = if silent_deg.is_some() { &bursts[..1] } else { &bursts[..] };
        for &(from, n, _) in bursts {
            let from = known + from * (packets.len() - known) / 1_000;
            lost.iter_mut().skip(from).take(n).for_each(|lost| *lost = true);
        }
        if let Some(last) = lost.last_mut() {
            *last = false; // only what is followed by a packet can be told from stamps
        }
        let percent = bursts.first().map_or(0, |burst| burst.2);
        let mut chance = Chance::new(seed);
        let (mut sources, mut missing, mut told) = (Source::new(), 0u64, 0u32);
        let mut truth = Vec::new();
        for ((arrived, body), lost) in lidar(&packets, Way::UDP, seed).into_iter().zip(&lost) {
            if *lost {
                missing += 1;
                told += u32::from(chance.below(100) < u64::from(percent));
                continue;
            }
            if told > 0 {
                sources.push((arrived, gap(LIDAR, core::mem::take(&mut told), LossPoint::Kernel)));
                truth.push(missing);
            }
            sources.push((arrived, body));
            truth.push(missing);
        }
        let mut pipeline = Pipeline::new(rig::lidar_only(), Workers::none());
        let mut out = Outputs::default();
        for (event, truth) in ledger(&[sources]).iter().zip(&truth) {
            pipeline.step(event, &mut out);
            out.clear();
            let total = pipeline.sensors()[0].lost.total;
            prop_assert!(total <= *truth, "{} of {} at {:?}", total, truth, event.arrived);
        }
        prop_assert_eq!(pipeline.sensors()[0].lost.total, missing);
    }
}
