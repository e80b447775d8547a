//! What is missing: loss by stamps, silences that are none, clocks that are set.

mod support;

use proptest::prelude::*;
use support::capture;
use support::streams::{at_limit, far, run, sensors, set_clock, turns};
use support::synth::{Packet, Sensor};
use tumbled_model::RigNs;
use tumbled_velodyne::stream::{Decoded, Settings, StreamDecoder};
use tumbled_velodyne::track::Order;
use tumbled_velodyne::{Model, ReturnMode};

#[test]
fn a_limited_field_of_view_is_not_loss() {
    for sensor in sensors() {
        let (decoder, _) = run(&turns(&sensor, 3.3), Settings::default());
        let totals = decoder.tracker().totals();
        assert_eq!(totals.lost, 0, "{:?} {:?} {} rpm {:?}", sensor.model, sensor.mode, sensor.rpm, sensor.silent_deg);
        assert_eq!(totals.pauses > 0, sensor.silent_deg.is_some());
        let rpm = decoder.tracker().rpm().expect("it turns");
        assert!((rpm / sensor.rpm - 1.0).abs() < 2e-3, "{rpm} for {}", sensor.rpm);
    }
}

#[test]
fn a_pause_exactly_between_two_packets_is_not_loss_either() {
    // 12 firing cycles of 55.296 µs at 600 rpm are 2.389°; a view of exactly 75 packets ends every pass at a packet's end.
    let cycle_deg = 600.0 * 360.0 / 60e9 * 55_296.0;
    let width = 75.0 * 12.0 * cycle_deg;
    let sensor = Sensor {
        start_deg: 270.0,
        silent_deg: Some(((270.0 + width - 0.01) % 360.0, 269.95)),
        ..Sensor::new(Model::Vlp32c, ReturnMode::Strongest)
    };
    let packets = sensor.packets(600, far);
    let between = packets.windows(2).filter(|w| w[1].t_ns - w[0].group_t_ns[11] > 1_000_000).count();
    assert!(between >= 1, "the scene must have a pause between packets, has {between}");
    let (decoder, _) = run(&packets, Settings::default());
    assert_eq!(decoder.tracker().totals().lost, 0);
}

#[test]
fn loss_at_the_same_azimuths_turn_after_turn_is_loss_where_the_head_was_seen_to_fire() {
    let mut packets = Sensor::new(Model::Vlp32c, ReturnMode::Strongest).packets(3_000, far);
    // 150.7 packets make a turn of 600 rpm. After two whole turns the host takes the first of every 75 and misses the
    // rest: half a turn, at the same two places each time, to 1.6° a turn.
    let mut number = 0;
    packets.retain(|_| {
        number += 1;
        number <= 302 || number % 75 == 1
    });
    let (decoder, _) = run(&packets, Settings::default());
    let last = 2_926; // 39 × 75 + 1
    assert_eq!(decoder.tracker().totals().lost, last - packets.len() as u64);
    assert_eq!(decoder.tracker().silent_sector(), None);
}

#[test]
fn the_hour_rolls_over_without_loss_or_reset() {
    let sensor = Sensor { start_us: 3_599_990_000, ..Sensor::new(Model::Vlp16, ReturnMode::Strongest) };
    let (decoder, out) = run(&sensor.packets(40, far), Settings::default());
    let totals = decoder.tracker().totals();
    assert_eq!((totals.lost, totals.resets), (0, 0));
    assert!(out.packets.iter().any(|p| p.stamp.is_some_and(|s| s.0 < 1_000_000)), "the stamp did wrap");
}

#[test]
fn a_reboot_is_a_reset_and_not_an_hour_of_loss() {
    let sensor = Sensor::new(Model::Vlp32c, ReturnMode::Strongest);
    let mut packets = sensor.packets(200, far);
    let rebooted = Sensor { start_us: 5_000_000, ..Sensor::new(Model::Vlp32c, ReturnMode::Strongest) };
    for mut packet in rebooted.packets(100, far) {
        for t in &mut packet.group_t_ns {
            *t += 30_000_000_000; // it takes half a minute to boot: its counter is 26 s behind
        }
        packets.push(packet);
    }
    let (decoder, _) = run(&packets, Settings::default());
    let totals = decoder.tracker().totals();
    assert_eq!((totals.resets, totals.lost), (1, 0));
}

#[test]
fn a_clock_set_by_less_than_a_second_is_a_reset_and_not_loss() {
    for sensor in [
        Sensor::new(Model::Vlp32c, ReturnMode::Strongest),
        Sensor { silent_deg: Some((91.0, 270.0)), start_deg: 271.0, ..Sensor::new(Model::Vlp32c, ReturnMode::Dual) },
    ] {
        for shift_us in [-900_000, -200_000, -123_456, -20_000, 13_000, 70_000, 123_456, 237_000, 900_000] {
            let mut packets = sensor.packets(900, far);
            set_clock(&mut packets, 400, shift_us);
            // Five packets lost well behind the step are still counted.
            packets.drain(700..705);
            let (decoder, out) = run(&packets, Settings::default());
            let totals = decoder.tracker().totals();
            assert_eq!((totals.resets, totals.lost), (1, 5), "{:?} {shift_us} µs: {totals:?}", sensor.silent_deg);
            assert_eq!(out.packets.len(), 895);
        }
    }
}

#[test]
fn a_stalled_host_is_no_reset_and_hides_no_loss() {
    let mut packets = Sensor::new(Model::Vlp32c, ReturnMode::Strongest).packets(2_000, far);
    packets.drain(1_500..1_510);
    let mut decoder = StreamDecoder::new(Settings::default());
    let mut out = Decoded::default();
    for (k, packet) in packets.iter().enumerate() {
        // For 0.4 s nothing is fetched, then all at once.
        let arrived = if (1_000..1_603).contains(&k) { packets[1_603].t_ns } else { packet.t_ns };
        decoder.push(&packet.bytes, RigNs(arrived), &mut out);
    }
    let totals = decoder.tracker().totals();
    assert_eq!((totals.resets, totals.lost), (0, 10));
}

#[test]
fn one_early_stamp_does_not_change_the_period() {
    for shift_us in [-400, -200, 300] {
        let mut packets = Sensor::new(Model::Vlp32c, ReturnMode::Strongest).packets(400, far);
        set_clock(&mut packets, 8, shift_us);
        let (decoder, _) = run(&packets, Settings::default());
        assert_eq!((decoder.period_mismatch(), decoder.tracker().totals().lost), (None, 0), "{shift_us} µs");
    }
}

/// Real packets: any of them may go missing but the first, the last and the jumps.
#[test]
fn removing_real_packets_counts_them() {
    let Some(pcap) = capture("vlp32c_strongest_600rpm_fov180_a.pcap") else { return };
    let packets = support::udp(&pcap);
    let jumps = [75, 151, 227];
    let mut removals: Vec<Vec<usize>> = (1..227).filter(|k| !jumps.contains(k)).map(|k| vec![k]).collect();
    for (from, to) in [(10, 70), (76, 80), (76, 151), (76, 150), (100, 151), (152, 226), (1, 75), (70, 75)] {
        removals.push((from..to).collect());
    }
    removals.push((1..227).filter(|k| !jumps.contains(k) && k % 3 != 0).collect());
    for removed in removals {
        let mut decoder = StreamDecoder::new(Settings::default());
        let mut out = Decoded::default();
        for (k, (arrived, _, payload)) in packets.iter().enumerate() {
            if !removed.contains(&k) {
                decoder.push(payload, *arrived, &mut out);
            }
        }
        assert_eq!(decoder.tracker().totals().lost as usize, removed.len(), "without {removed:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    /// Any packets but the first, the last and those at the limits of the view (the one that holds the jump, or the
    /// two around a pause that falls between packets: without them nobody could say where the view ends).
    #[test]
    fn exactly_the_removed_packets_are_counted(which in 0usize..72, share in 0.0..0.3f64, seed in any::<u64>()) {
        let packets = turns(&sensors()[which], 3.3);
        let n = packets.len();
        let mut draw = seed;
        let removed: Vec<usize> = (1..n - 1).filter(|_| {
            draw = draw.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (draw >> 40) as f64 / f64::from(1u32 << 24) < share
        }).collect();
        let kept: Vec<Packet> = packets.iter().enumerate()
            .filter(|(k, _)| at_limit(&packets, *k) || !removed.contains(k))
            .map(|(_, p)| p.clone()).collect();
        let (decoder, out) = run(&kept, Settings::default());
        prop_assert_eq!(decoder.tracker().totals().lost as usize, n - kept.len());
        let told: u64 = out.packets.iter().map(|p| if let Order::Next { lost } = p.order { lost } else { 0 }).sum();
        prop_assert!(told as usize >= n - kept.len());
    }

    /// One long run of missing packets, up to more than a whole turn.
    #[test]
    fn a_long_gap_is_counted_across_silent_sectors(which in 0usize..72, at in 0.4..0.6f64, share in 0.0..0.39f64) {
        let packets = turns(&sensors()[which], 5.3);
        let n = packets.len() as f64;
        let (from, len) = ((n * at) as usize, (n * share) as usize);
        let to = (from..from + len).find(|k| at_limit(&packets, *k)).unwrap_or(from + len);
        let kept: Vec<Packet> = packets.iter().enumerate().filter(|(k, _)| !(from..to).contains(k)).map(|(_, p)| p.clone()).collect();
        let (decoder, _) = run(&kept, Settings::default());
        prop_assert_eq!(decoder.tracker().totals().lost as usize, to - from);
    }

    #[test]
    fn late_and_repeated_packets_are_not_loss(k in 100usize..300, distance in 1usize..10, repeat in 0usize..300) {
        let sensor = Sensor::new(Model::Vlp32c, ReturnMode::Strongest);
        let mut packets = sensor.packets(320, far);
        let late = packets.remove(k);
        packets.insert(k + distance, late);
        let twin = packets[repeat].clone();
        packets.insert(repeat + 1, twin);
        let (decoder, out) = run(&packets, Settings::default());
        let totals = decoder.tracker().totals();
        prop_assert_eq!((totals.lost, totals.late, totals.duplicates), (0, 1, 1));
        prop_assert_eq!(out.packets.len(), 321);
    }
}
