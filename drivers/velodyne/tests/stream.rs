//! Streams of synthetic packets: time, loss, order, limited fields of view, products, arbitrary bytes.

mod support;

use proptest::prelude::*;
use support::capture;
use support::synth::{Packet, Sensor};
use tumbled_model::{CivilTime, LidarTime, RigNs, Span, UnixNs, nmea};
use tumbled_velodyne::encode::{DataPacketBuilder, position_packet};
use tumbled_velodyne::position::Pps;
use tumbled_velodyne::stream::{Decoded, Rejection, Settings, StreamDecoder};
use tumbled_velodyne::track::Order;
use tumbled_velodyne::{Model, ReturnMode, WireError};

fn run(packets: &[Packet], settings: Settings) -> (StreamDecoder, Decoded) {
    let mut decoder = StreamDecoder::new(settings);
    let mut out = Decoded::default();
    for packet in packets {
        // The packet leaves when its last block has fired.
        let arrived = RigNs(packet.group_t_ns.last().copied().unwrap_or(0) + 100_000);
        decoder.push(&packet.bytes, arrived, &mut out);
    }
    decoder.finish(&mut out);
    (decoder, out)
}

/// Packets of three turns and a bit. A pause that falls exactly between two packets is told from loss by the next one:
/// one turn alone may not show the view's limits.
fn turns(sensor: &Sensor, turns: f64) -> Vec<Packet> {
    let view = sensor.silent_deg.map_or(360.0, |(from, to)| 360.0 - (to - from).rem_euclid(360.0));
    let period = tumbled_velodyne::detect::packet_period_ns(sensor.model, sensor.mode).expect("built-in");
    let per_turn = view / 360.0 * 60e9 / sensor.rpm / period as f64;
    sensor.packets((turns * per_turn) as usize, far)
}

/// Whether the view ends or begins in or right beside packet `k`.
fn at_limit(packets: &[Packet], k: usize) -> bool {
    let pause_before = |k: usize| {
        k > 0 && k < packets.len() && {
            let (last, next) = (&packets[k - 1].group_t_ns, packets[k].group_t_ns[0]);
            next - last[last.len() - 1] > last[1] - last[0] && next - last[last.len() - 1] > last[2] - last[1]
        }
    };
    packets[k].has_jump || pause_before(k) || pause_before(k + 1)
}

fn far(_slot: usize, _t: i64) -> (u16, u16) {
    (1_000, 1_000)
}

/// Four sensors: model, mode, limited view.
fn sensors() -> Vec<Sensor> {
    let views = [None, Some((91.0, 270.0)), Some((10.0, 350.0)), Some((200.0, 230.0))];
    let kinds = [
        (Model::Vlp32c, ReturnMode::Strongest),
        (Model::Vlp32c, ReturnMode::Dual),
        (Model::Vlp16, ReturnMode::Last),
        (Model::Vlp16, ReturnMode::Dual),
        (Model::Vlp16HiRes, ReturnMode::Strongest),
        (Model::Hdl32e, ReturnMode::Strongest),
    ];
    let mut sensors = Vec::new();
    for rpm in [300.0, 600.0, 1_200.0] {
        for silent_deg in views {
            for (model, mode) in kinds {
                let start_deg = if silent_deg == Some((10.0, 350.0)) { 355.0 } else { 300.0 };
                sensors.push(Sensor { rpm, silent_deg, start_deg, ..Sensor::new(model, mode) });
            }
        }
    }
    sensors
}

#[test]
fn every_point_has_its_own_firing_time_also_behind_a_pause() {
    for sensor in sensors() {
        let packets = sensor.packets(400, far);
        let (decoder, out) = run(&packets, Settings::default());
        assert_eq!(out.packets.len(), packets.len());
        assert_eq!(decoder.counts().points, 400 * 384 / sensor.mode.blocks_per_firing() as u64);
        let beams = tumbled_velodyne::beams::BeamTable::new(sensor.model.spec().expect("built-in"), false);
        // The last packet's pause has no successor to tell it.
        for (packet, info) in packets.iter().zip(&out.packets).take(399) {
            let columns = i32::from(32 / sensor.model.lasers() as u8);
            for p in out.points.iter_range(info.points.clone()) {
                let group = i32::from(p.column) / columns;
                let slot = usize::from(p.laser) + (i32::from(p.column) % columns) as usize * sensor.model.lasers();
                let true_ns =
                    packet.group_t_ns[group as usize] - packet.t_ns + i64::from(beams.beam(slot).expect("slot").dt_ns);
                // Stamps are whole µs: the pause, a difference of two, is good to 1 µs.
                let error = (i64::from(p.dt_ns) - true_ns).abs();
                assert!(error <= if packet.has_jump { 1_000 } else { 0 }, "{:?}: {error} ns", sensor.model);
            }
        }
    }
}

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

    #[test]
    fn arbitrary_payloads_are_counted_one_by_one(payloads in prop::collection::vec(
        prop_oneof![prop::collection::vec(any::<u8>(), 0..64), prop::collection::vec(any::<u8>(), 1206), prop::collection::vec(any::<u8>(), 512)], 1..8),
        model in prop::option::of(prop::sample::select(Model::ALL.to_vec()))) {
        let mut decoder = StreamDecoder::new(Settings { model, ..Settings::default() });
        let mut out = Decoded::default();
        for payload in &payloads {
            decoder.push(payload, RigNs(0), &mut out);
        }
        let counts = decoder.counts();
        let rejected: u64 = counts.rejected.values().sum();
        prop_assert_eq!(counts.data_packets + counts.position_packets + rejected, payloads.len() as u64);
    }

    /// Right flags, everything else arbitrary: azimuths, stamps and distances that no sensor would send.
    #[test]
    fn arbitrary_contents_decode_without_a_panic(
        azimuths in prop::collection::vec(prop::array::uniform12(any::<u16>()), 1..6),
        stamps in prop::collection::vec(any::<u32>(), 6), arrivals in prop::collection::vec(any::<i64>(), 6),
        mode in prop::sample::select(vec![0x37u8, 0x38, 0x39]), product in prop::sample::select(vec![0x21u8, 0x22, 0x24, 0x28]),
        raw in any::<u16>(),
    ) {
        let mut decoder = StreamDecoder::new(Settings::default());
        let mut out = Decoded::default();
        for (k, blocks) in azimuths.iter().enumerate() {
            let mut builder = DataPacketBuilder::new(Model::Vlp32c, ReturnMode::Strongest);
            builder.stamp(LidarTime(stamps[k])).factory_bytes(mode, product);
            for (block, azimuth) in blocks.iter().enumerate() {
                builder.block(block, *azimuth, &[(raw, 9); 32]);
            }
            decoder.push(&builder.build(), RigNs(arrivals[k]), &mut out);
        }
        decoder.finish(&mut out);
        prop_assert_eq!(decoder.counts().data_packets, azimuths.len() as u64);
        prop_assert!(out.points.azimuth_rad.iter().all(|a| (0.0..std::f32::consts::TAU).contains(a)));
        prop_assert!(out.points.x.iter().chain(&out.points.y).chain(&out.points.z).all(|v| v.is_finite() && v.abs() < 270.0));
    }
}

#[test]
fn directions_follow_the_head_and_not_the_block() {
    // VLP-32C, 600 rpm: laser 30 (+1.4°, fires 34.560 µs into the block) has turned 0.12442° further than the block's
    // azimuth: 3600 °/s × 34.56 µs. Block azimuths are rounded to 0.01°, so are the gaps: 0.015° covers both.
    let sensor = Sensor { start_deg: 359.0, ..Sensor::new(Model::Vlp32c, ReturnMode::Strongest) };
    let (_, out) = run(&sensor.packets(30, far), Settings { vertical_offsets: Some(false), ..Settings::default() });
    let mut seen = 0;
    for info in &out.packets {
        for p in out.points.iter_range(info.points.clone()).filter(|p| p.laser == 30) {
            let t_ns = f64::from(p.dt_ns) + info.index as f64 * 663_552.0;
            let want = (359.0 + 3_600.0 * t_ns * 1e-9 + 1.4).rem_euclid(360.0);
            let got = f64::from(p.azimuth_rad).to_degrees();
            let error = (got - want + 180.0).rem_euclid(360.0) - 180.0;
            assert!(error.abs() < 0.015, "{got} for {want}");
            // 1000 counts of 4 mm at elevation 10.333°.
            assert!((p.xyz[2] - 4.0 * libm::sin(10.333f64.to_radians()) as f32).abs() < 1e-6);
            assert!((p.range_m - 4.0).abs() < 1e-6);
            let from_xy = libm::atan2(f64::from(-p.xyz[1]), f64::from(p.xyz[0])).to_degrees().rem_euclid(360.0);
            assert!(((from_xy - got + 180.0).rem_euclid(360.0) - 180.0).abs() < 1e-4);
            seen += 1;
        }
    }
    assert_eq!(seen, 30 * 12);
}

#[test]
fn dual_returns_are_one_point_when_equal_and_last_first_when_not() {
    let returns = |slot: usize, _| match slot {
        0 => (500, 500),
        1 => (700, 300),
        2 => (700, 0),
        3 => (0, 300),
        _ => (0, 0),
    };
    let sensor = Sensor::new(Model::Vlp32c, ReturnMode::Dual);
    let (_, out) = run(&sensor.packets(1, returns), Settings::default());
    let first: Vec<(u8, f32, u8)> =
        (0..5).filter_map(|k| out.points.get(k)).map(|p| (p.laser, p.range_m, p.ret as u8)).collect();
    // Even block = last (2), odd block = strongest (1), both (3); 4 mm a count.
    assert_eq!(first, [(0, 2.0, 3), (1, 2.8, 2), (1, 1.2, 1), (2, 2.8, 2), (3, 1.2, 1)]);
    assert_eq!(out.points.len(), 5 * 6);
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
fn utc_of_the_first_firing_on_both_sides_of_the_hour() {
    // 09:59:59.990 UTC.
    let start = CivilTime { year: 2026, month: 11, day: 22, hour: 9, minute: 59, second: 59, nanosecond: 990_000_000 };
    let start = start.to_unix().expect("a date");
    let sensor = Sensor { start_us: 3_599_990_000, ..Sensor::new(Model::Vlp16, ReturnMode::Strongest) };
    let packets = sensor.packets(40, far);
    let mut decoder = StreamDecoder::new(Settings::default());
    let mut out = Decoded::default();
    let sentence = nmea::format_rmc(UnixNs(start.0 - 990_000_000), true);
    decoder.push(&position_packet(LidarTime(3_599_990_000), Pps::Locked, &sentence), RigNs(0), &mut out);
    for packet in &packets {
        decoder.push(&packet.bytes, RigNs(packet.t_ns), &mut out);
    }
    for (packet, info) in packets.iter().zip(&out.packets) {
        let utc = decoder.clock().utc(info.stamp.expect("a clock")).expect("locked");
        let error = utc - (start + Span(packet.t_ns));
        assert!(error.0.abs() <= 500, "{error}");
    }
}

#[test]
fn an_old_vlp16_that_says_hdl32e_is_warned_about_and_right_when_forced() {
    let sensor = Sensor::new(Model::Vlp16, ReturnMode::Strongest);
    let mut packets = sensor.packets(60, |slot, t| (1_000 + slot as u16 + (t / 100_000) as u16, 0));
    let (_, want) = run(&packets, Settings::default());
    for packet in &mut packets {
        packet.bytes[1205] = 0x21;
    }
    let (believed, _) = run(&packets, Settings::default());
    assert_eq!(believed.model(), Some(Model::Hdl32e));
    let mismatch = believed.period_mismatch().expect("1327 µs is no HDL-32E's period");
    assert_eq!(mismatch.fits, Some(Model::Vlp16));
    assert_eq!(believed.tracker().totals().lost, 0, "no losses by a period that is not the sensor's");
    let (forced, got) = run(&packets, Settings { model: Some(Model::Vlp16), ..Settings::default() });
    assert_eq!(forced.period_mismatch(), None);
    assert_eq!(got.points, want.points);
}

#[test]
fn products_that_are_not_decoded_are_refused_by_name() {
    let verdict = |build: &dyn Fn(&mut [u8; 1206])| {
        let mut bytes = DataPacketBuilder::new(Model::Vlp16, ReturnMode::Strongest).build();
        build(&mut bytes);
        let mut decoder = StreamDecoder::new(Settings::default());
        decoder.push(&bytes, RigNs(0), &mut Decoded::default());
        decoder.counts().rejected.keys().next().map(ToString::to_string).unwrap_or_default()
    };
    assert!(verdict(&|b| b[1205] = 0xA1).contains("VLS-128"));
    // A VLS-128's four banks, whatever the byte says.
    assert!(verdict(&|b| b[201] = 0xCC).contains("VLS-128"));
    assert!(verdict(&|b| b[1205] = 0x23).contains("VLP-32A/B"));
    assert!(verdict(&|b| b[1205] = 0x77).contains("0x77"));
    assert!(verdict(&|b| b[1204] = 0x30).contains("0x30"));
    assert!(verdict(&|b| b[0] = 0).contains("block 0"));
}

#[test]
fn a_second_sensor_on_the_port_is_counted_and_not_mixed_in() {
    let mut packets = Sensor::new(Model::Vlp16, ReturnMode::Strongest).packets(10, far);
    packets.insert(5, Sensor::new(Model::Vlp32c, ReturnMode::Strongest).packets(1, far).remove(0));
    let (decoder, out) = run(&packets, Settings::default());
    assert_eq!(out.packets.len(), 10);
    let other = Rejection::OtherModel { expected: Model::Vlp16, found: Model::Vlp32c };
    assert_eq!(decoder.counts().rejected.get(&other), Some(&1));
}

#[test]
fn a_stray_first_packet_does_not_decide_the_model() {
    let mut packets = Sensor::new(Model::Vlp32c, ReturnMode::Strongest).packets(1, far);
    packets.extend(Sensor::new(Model::Vlp16, ReturnMode::Strongest).packets(50, far));
    let (decoder, out) = run(&packets, Settings::default());
    assert_eq!(decoder.model(), Some(Model::Vlp16));
    // The stray, and all but the seven packets it took to find out.
    assert_eq!(out.packets.len(), 1 + 50 - 7);
    assert_eq!(decoder.tracker().totals().lost, 0);
}

#[test]
fn a_forced_model_that_the_packets_contradict_is_told() {
    let packets = Sensor::new(Model::Vlp16, ReturnMode::Strongest).packets(5, far);
    let forced = |model| run(&packets, Settings { model: Some(model), ..Settings::default() }).0.contradiction();
    assert_eq!(forced(Model::Vlp32c), Some(tumbled_velodyne::Product::Supported(Model::Vlp16)));
    assert_eq!(forced(Model::Vlp16), None);
}

/// Shifts the stamps and not the arrivals of all packets from `from` on.
fn set_clock(packets: &mut [Packet], from: usize, shift_us: i32) {
    for packet in packets.iter_mut().skip(from) {
        let stamp = u32::from_le_bytes(packet.bytes[1200..1204].try_into().expect("four bytes"));
        packet.bytes[1200..1204].copy_from_slice(&stamp.wrapping_add_signed(shift_us).to_le_bytes());
    }
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

/// Times of all points after the sensor's first firing, against the truth.
fn worst_time_error(sensor: &Sensor, packets: &[Packet], out: &Decoded) -> i64 {
    let beams = tumbled_velodyne::beams::BeamTable::new(sensor.model.spec().expect("built-in"), false);
    let lasers = sensor.model.lasers();
    let columns = 32 / lasers;
    let mut worst = 0;
    for info in &out.packets {
        let packet = &packets[info.index as usize];
        for p in out.points.iter_range(info.points.clone()) {
            let slot = usize::from(p.laser) + usize::from(p.column) % columns * lasers;
            let group_ns = packet.group_t_ns[usize::from(p.column) / columns] - packet.t_ns;
            worst = worst.max((i64::from(p.dt_ns) - group_ns - i64::from(beams.beam(slot).expect("slot").dt_ns)).abs());
        }
    }
    worst
}

#[test]
fn a_late_or_repeated_packet_with_a_jump_has_its_pause_too() {
    let sensor = Sensor {
        silent_deg: Some((91.0, 270.0)),
        start_deg: 271.0,
        ..Sensor::new(Model::Vlp32c, ReturnMode::Strongest)
    };
    let packets = sensor.packets(400, far);
    let mut swapped = packets.clone();
    for k in (0..398).filter(|k| packets[*k].has_jump) {
        swapped.swap(k, k + 1);
    }
    let (_, out) = run(&swapped, Settings::default());
    assert!(out.packets.iter().any(|info| info.azimuth_jump && info.order == Order::Late));
    // A pause by angle lies on the grid of firing cycles, so it is the pause itself, to the stamps' 1 µs.
    assert!(worst_time_error(&sensor, &swapped, &out) <= 1_000);
    let doubled: Vec<Packet> = packets.iter().flat_map(|packet| [packet.clone(), packet.clone()]).collect();
    let (decoder, out) = run(&doubled, Settings::default());
    assert_eq!(decoder.tracker().totals().duplicates, 400);
    assert!(worst_time_error(&sensor, &doubled, &out) <= 1_000);
}

#[test]
fn a_view_narrower_than_a_packet_pauses_more_than_once_in_it() {
    for (model, mode, view) in [
        (Model::Vlp16, ReturnMode::Strongest, 2.0),
        (Model::Vlp16, ReturnMode::Strongest, 4.0),
        (Model::Vlp32c, ReturnMode::Strongest, 1.0),
        (Model::Vlp32c, ReturnMode::Dual, 1.3),
    ] {
        let sensor = Sensor { silent_deg: Some((view, 0.0)), start_deg: 0.001, ..Sensor::new(model, mode) };
        let packets = sensor.packets(60, far);
        let (decoder, out) = run(&packets[..59], Settings::default());
        assert_eq!(decoder.tracker().totals().lost, 0, "{model} {view}°");
        // The pauses of a packet are shared out by the widths of its jumps, which are rounded to 0.02° of 360°.
        assert!(
            worst_time_error(&sensor, &packets, &out) <= 20_000,
            "{model} {view}°: {}",
            worst_time_error(&sensor, &packets, &out)
        );
    }
}

#[test]
fn hdl32e_stamps_of_the_last_firing_end_at_zero_in_both_return_modes() {
    use tumbled_velodyne::stream::StampReference;
    for mode in [ReturnMode::Strongest, ReturnMode::Dual] {
        let packets = Sensor::new(Model::Hdl32e, mode).packets(3, far);
        let settings = Settings { hdl32e_stamp: StampReference::LastFiring, ..Settings::default() };
        let (_, out) = run(&packets, settings);
        assert_eq!(out.points.dt_ns.iter().max(), Some(&0), "{mode}");
    }
}

#[test]
fn equal_distances_are_one_return_whatever_their_reflectivity() {
    let packets = Sensor::new(Model::Vlp16, ReturnMode::Dual).packets(1, far);
    let mut packet = packets[0].clone();
    packet.bytes[6] = 10; // even block, slot 0: the last return's reflectivity
    packet.bytes[106] = 20; // odd block: the strongest one's
    let (_, out) = run(&[packet], Settings::default());
    let first = out.points.get(0).expect("a point");
    assert_eq!((out.points.len(), first.intensity, first.ret as u8), (192, 20, 3));
}

#[test]
fn an_hdl64e_with_a_limited_view_has_its_pauses_too() {
    use tumbled_velodyne::hdl64::encode::{Hdl64Encoder, Said, Slot};
    use tumbled_velodyne::hdl64::{Calibration, Generation, Unit};
    let calibration = Calibration::parse(include_str!("../../../tests/captures/hdl64e-made.csv")).expect("64 lasers");
    let mut encoder = Hdl64Encoder::new(Generation::S2, &calibration, &Unit::default());
    let time = CivilTime { year: 2026, month: 11, day: 22, hour: 9, minute: 0, second: 0, nanosecond: 0 };
    let said = Said { time, gps: 0, temperature_c: 40, firmware: 7, warnings: 0 };
    // S2: a firing of both banks every 48 µs; 600 rpm; silent from 100° to 200°.
    let mut decoder = StreamDecoder::new(Settings { hdl64e_calibration: Some(calibration), ..Settings::default() });
    let mut out = Decoded::default();
    let (mut t_ns, mut truth) = (0i64, Vec::new());
    for _ in 0..800 {
        let mut firings = Vec::new();
        while firings.len() < 6 {
            let azimuth = (50.0 + 3_600.0 * t_ns as f64 * 1e-9).rem_euclid(360.0);
            if !(100.0..200.0).contains(&azimuth) {
                firings.push((t_ns, (azimuth * 100.0) as u16));
            }
            t_ns += 48_000;
        }
        let azimuths = core::array::from_fn(|block| firings[block / 2].1);
        let slots = [[Slot { raw: 5_000, intensity: 9 }; 32]; 12];
        let stamp = LidarTime((firings[0].0 / 1_000) as u32);
        decoder.push(&encoder.encode(stamp, &azimuths, &slots, &said), RigNs(t_ns), &mut out);
        truth.push(firings);
    }
    decoder.finish(&mut out);
    assert_eq!((out.packets.len(), decoder.tracker().totals().lost), (800, 0));
    assert!(decoder.tracker().totals().pauses >= 3);
    for info in &out.packets[2..799] {
        let firings = &truth[info.index as usize];
        for p in out.points.iter_range(info.points.clone()) {
            let cycle_ns = firings[usize::from(p.column)].0 - firings[0].0;
            // Within a cycle the lasers fire over 48 µs.
            let within = i64::from(p.dt_ns) - cycle_ns;
            assert!((-1_000..49_000).contains(&within), "packet {} column {}: {within} ns", info.index, p.column);
        }
    }
}

#[test]
fn numbers_of_packets_count_the_broken_ones_too() {
    let mut packets = Sensor::new(Model::Vlp16, ReturnMode::Strongest).packets(4, far);
    packets[1].bytes[0] = 0;
    let (_, out) = run(&packets, Settings::default());
    assert_eq!(out.packets.iter().map(|info| info.index).collect::<Vec<_>>(), [0, 2, 3]);
}

#[test]
fn a_steady_stream_does_not_allocate() {
    let sensor = Sensor {
        silent_deg: Some((91.0, 270.0)),
        start_deg: 271.0,
        ..Sensor::new(Model::Vlp32c, ReturnMode::Strongest)
    };
    let packets = sensor.packets(600, far);
    let mut decoder = StreamDecoder::new(Settings::default());
    let mut out = Decoded::default();
    let mut memory = None;
    for (k, packet) in packets.iter().enumerate() {
        if k % 76 == 0 {
            out.clear();
        }
        decoder.push(&packet.bytes, RigNs(packet.t_ns), &mut out);
        if k == 300 {
            memory = Some((out.points.x.as_ptr(), out.points.x.capacity(), out.packets.as_ptr()));
        }
    }
    // Columns that grew would lie elsewhere.
    assert_eq!(memory, Some((out.points.x.as_ptr(), out.points.x.capacity(), out.packets.as_ptr())));
}

#[test]
fn range_limits_leave_out_and_count() {
    let near_and_far = |slot: usize, _| (if slot == 0 { 50 } else { 1_000 }, 0); // 0.2 m and 4 m
    let packets = Sensor::new(Model::Vlp32c, ReturnMode::Strongest).packets(3, near_and_far);
    let settings = Settings { range_limits_m: Some(Model::Vlp32c.range_limits_m()), ..Settings::default() };
    let (decoder, out) = run(&packets, settings);
    assert_eq!((decoder.counts().out_of_range, out.points.len()), (36, 36 * 31));
    assert!(out.points.laser.iter().all(|laser| *laser != 0));
    assert_eq!(out.packets[2].points, 2 * 12 * 31..3 * 12 * 31);
}

#[test]
fn wrong_lengths_are_counted_by_length() {
    let mut decoder = StreamDecoder::new(Settings::default());
    let mut out = Decoded::default();
    for len in [0, 1205, 1207, 1205] {
        decoder.push(&vec![0; len], RigNs(0), &mut out);
    }
    assert_eq!(decoder.counts().rejected.get(&Rejection::Wire(WireError::Length { got: 1205 })), Some(&2));
    assert_eq!(decoder.counts().rejected.len(), 3);
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
