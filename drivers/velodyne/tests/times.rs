//! When each point was measured, and where the head stood then.

mod support;

use support::streams::{far, run, sensors, worst_time_error};
use support::synth::{Packet, Sensor};
use tumbled_model::{CivilTime, LidarTime, RigNs, Span, UnixNs, nmea};
use tumbled_velodyne::encode::position_packet;
use tumbled_velodyne::position::Pps;
use tumbled_velodyne::stream::{Decoded, Settings, StreamDecoder};
use tumbled_velodyne::track::Order;
use tumbled_velodyne::{Model, ReturnMode};

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
