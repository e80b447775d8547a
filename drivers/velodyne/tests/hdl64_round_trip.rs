//! What the encoder writes, the decoder reads: S1, S2, S3, single and dual, calibration from a file and from the stream.

use std::f64::consts::{PI, TAU};
use tumbled_model::{CivilTime, LidarTime};
use tumbled_velodyne::hdl64::encode::{Said, Slot, Slots, stream};
use tumbled_velodyne::hdl64::in_stream::{self, PACKETS, STREAM_LEN};
use tumbled_velodyne::hdl64::{
    Beams, Calibration, Generation, Hdl64Decoder, Hdl64Encoder, Hdl64Packet, InStreamError, LASERS, LaserCalibration,
    Unit,
};
use tumbled_velodyne::{DataPacket, LidarPoint, Points, Return};

const SAID: Said = Said {
    time: CivilTime { year: 2026, month: 11, day: 22, hour: 8, minute: 30, second: 59, nanosecond: 0 },
    gps: b'A',
    temperature_c: 31,
    firmware: 227,
    warnings: 0x60,
};

/// A table like a real one, in the units of the stream: 0.01° and mm.
fn calibration() -> Calibration {
    let mut lasers = [LaserCalibration::default(); LASERS];
    for (id, laser) in (0i32..).zip(lasers.iter_mut()) {
        let deg = |cdeg: i32| f64::from(cdeg) * PI / 18_000.0;
        let mm = |mm: i32| f64::from(mm) / 1000.0;
        *laser = LaserCalibration {
            rotation_rad: deg((id * 37) % 19 * 50 - 450),
            vertical_rad: deg(150 - id * 41),
            distance_m: mm(1000 + id * 7),
            distance_x_m: mm(1030 + id * 6),
            distance_y_m: mm(1020 + id * 8),
            vertical_offset_m: mm(200 - id),
            horizontal_offset_m: mm(if id % 2 == 0 { 26 } else { -26 }),
            focal_distance_m: mm(15_000 + id * 10),
            focal_slope: 1.2,
            min_intensity: 10,
            max_intensity: 250,
            enabled: true,
        };
    }
    Calibration::new(lasers).expect("plausible")
}

fn unit() -> Unit {
    Unit {
        noise_upper: 24,
        noise_lower: 25,
        calibrated: Some(CivilTime { year: 2016, month: 11, day: 15, hour: 12, minute: 47, second: 47, nanosecond: 0 }),
        humidity_percent: 25,
        rpm: 600,
        view_from_cdeg: 0,
        view_to_cdeg: 36_000,
        hours: 2685,
        source_ip: [192, 168, 3, 43],
        destination_ip: [192, 168, 3, 255],
        return_mode: 0,
        warnings: 0,
        power: 0xA0,
    }
}

/// Block azimuths of a packet whose first is `start`, at `step` cdeg per firing.
fn azimuths(generation: Generation, dual: bool, start: u16, step: u16) -> [u16; 12] {
    let mut azimuths = [0; 12];
    for (block, azimuth) in (0u8..).zip(azimuths.iter_mut()) {
        *azimuth = (start + step * u16::from(generation.cycle(dual, block))) % 36_000;
    }
    azimuths
}

fn decode(decoder: &mut Hdl64Decoder, bytes: &[u8]) -> (Hdl64Packet, Vec<LidarPoint>) {
    let mut points = Points::default();
    let packet = decoder.decode(&DataPacket::new(bytes).expect("1206 bytes"), &mut points).expect("valid");
    assert_eq!(packet.points, points.len());
    (packet, points.iter_range(0..points.len()).collect())
}

/// A wall all round at a distance that differs by laser and block, met by the rays at their own firing times, comes back
/// where it was.
fn world_comes_back(generation: Generation, step_cdeg: u16, start_cdeg: u16) {
    let calibration = calibration();
    let beams = Beams::new(&calibration);
    let mut encoder = Hdl64Encoder::new(generation, &calibration, &unit());
    let mut decoder = Hdl64Decoder::new(Some(calibration.clone())).with_generation(generation);
    let azimuths = azimuths(generation, false, start_cdeg, step_cdeg);
    let rad_per_ns = f64::from(step_cdeg) * TAU / 36_000.0 / f64::from(generation.cycle_ns());
    let mut slots: Slots = [[Slot::default(); 32]; 12];
    let mut truth = Vec::new();
    for block in 0u8..12 {
        for slot in 0u8..32 {
            let lower = generation.banks()[usize::from(block)] == tumbled_velodyne::Bank::Lower;
            let laser = slot + if lower { 32 } else { 0 };
            let at = generation.firing_ns(false, block, slot).expect("32 slots");
            let after = at - generation.firing_ns(false, block, 0).expect("slot 0");
            let azimuth = f64::from(azimuths[usize::from(block)]) * TAU / 36_000.0 + f64::from(after) * rad_per_ns;
            let range = 3.0 + f64::from(laser) * 0.7 + f64::from(block) * 4.0;
            let raw = beams.raw(laser, azimuth, range).expect("within reach");
            let ray = beams.ray(laser, azimuth).expect("64 lasers");
            slots[usize::from(block)][usize::from(slot)] = Slot { raw, intensity: 100 };
            truth.push((laser, at, azimuth, range, ray, block / 2));
        }
    }
    let (packet, points) = decode(&mut decoder, &encoder.encode(LidarTime(7), &azimuths, &slots, &SAID));
    assert_eq!((packet.points, packet.azimuth_jump, packet.dual), (384, false, false));
    for (point, (laser, at, azimuth, range, ray, column)) in points.iter().zip(truth) {
        assert_eq!((point.laser, point.dt_ns, point.column, point.ret), (laser, at, column, Return::Strongest));
        assert_eq!(point.ring, calibration.rings()[usize::from(laser)]);
        // Half a count is 1 mm; inside the 25.04 m jump (|D − Dx| below 40 mm here) the count is the next possible.
        let slack = if (range - 26.0).abs() < 1.0 { 0.04 } else { 0.001_01 };
        assert!((f64::from(point.range_m) - range).abs() < slack, "{point:?} {range}");
        let beam = azimuth - calibration.lasers()[usize::from(laser)].rotation_rad;
        assert!(angle(f64::from(point.azimuth_rad) - beam).abs() < 1e-6, "{point:?} {beam}");
        assert!((0.0..TAU as f32).contains(&point.azimuth_rad));
        // Off the ray by no more than half of |Dx − Dy|, 20 mm + 2 mm per laser extrapolated, and the range's error.
        for ((p, o), u) in point.xyz.into_iter().zip(ray.origin).zip(ray.direction) {
            assert!((f64::from(p) - (o + range * u)).abs() < 0.08, "{point:?} {ray:?}");
        }
    }
}

fn angle(rad: f64) -> f64 {
    (rad + PI).rem_euclid(TAU) - PI
}

#[test]
fn a_world_cast_along_the_rays_comes_back_s1() {
    world_comes_back(Generation::S1, 11, 35_950);
}

#[test]
fn a_world_cast_along_the_rays_comes_back_s2() {
    world_comes_back(Generation::S2, 17, 35_950);
}

#[test]
fn a_world_cast_along_the_rays_comes_back_s3() {
    world_comes_back(Generation::S3, 41, 100);
}

#[test]
fn an_intensity_out_of_focus_is_raised_and_held() {
    // Laser 0: f = 15 m, slope 1.2; at 5000 counts |(1 − 15/131)² − (1 − 5000/65535)²|
    // = |0.784098829 − 0.853231155| = 0.069132326, times 256 · 1.2 = 21.24. 230 + 21.24 is held at 250, 0 + … is 21.
    let mut slots: Slots = [[Slot::default(); 32]; 12];
    slots[0][0] = Slot { raw: 5000, intensity: 0 };
    slots[2][0] = Slot { raw: 5000, intensity: 100 };
    slots[4][0] = Slot { raw: 5000, intensity: 240 };
    let mut encoder = Hdl64Encoder::new(Generation::S2, &calibration(), &unit());
    let bytes = encoder.encode(LidarTime(0), &azimuths(Generation::S2, false, 0, 17), &slots, &SAID);
    let (_, points) = decode(&mut Hdl64Decoder::new(Some(calibration())), &bytes);
    assert_eq!(points.iter().map(|p| p.intensity).collect::<Vec<_>>(), [21, 121, 250]);
}

#[test]
fn dual_return_gives_one_point_for_equal_counts_and_two_for_different_ones() {
    let mut slots: Slots = [[Slot::default(); 32]; 12];
    let slot = |raw: u16, intensity: u8| Slot { raw, intensity };
    // Firing 1 is blocks 4 (upper, strongest), 5 (lower, strongest), 6 (upper, last), 7 (lower, last).
    (slots[4][0], slots[6][0]) = (slot(2000, 90), slot(2000, 90)); // the same
    (slots[4][1], slots[6][1]) = (slot(2000, 90), slot(3000, 30)); // two
    slots[4][2] = slot(2000, 90); // the strongest alone
    slots[7][5] = slot(3000, 30); // lower bank, the last alone
    let mut encoder = Hdl64Encoder::new(Generation::S3, &calibration(), &unit());
    let azimuths = azimuths(Generation::S3, true, 1000, 21);
    let bytes = encoder.encode(LidarTime(0), &azimuths, &slots, &SAID);
    let mut decoder = Hdl64Decoder::new(Some(calibration())).with_generation(Generation::S3);
    let (packet, points) = decode(&mut decoder, &bytes);
    assert_eq!((packet.dual, packet.firings, packet.period_ns), (true, 3, 172_800));
    // 57.6 µs for firing 1; slots 0, 1, 2, 5: 0, 1.3, 2.5, 7.2 + 1.3 µs.
    let found: Vec<_> = points.iter().map(|p| (p.laser, p.ret, p.dt_ns, p.column)).collect();
    let expected = [
        (0, Return::Both, 57_600, 1),
        (1, Return::Last, 58_900, 1),
        (1, Return::Strongest, 58_900, 1),
        (2, Return::Strongest, 60_100, 1),
        (37, Return::Last, 66_100, 1),
    ];
    assert_eq!(found, expected);
    assert!(points[1].range_m > points[2].range_m);
    // A head that stands still shows no pairs: the mode stays what it was.
    let (still, _) = decode(&mut decoder, &encoder.encode(LidarTime(173), &[500; 12], &slots, &SAID));
    assert!(still.dual);
}

#[test]
fn a_head_that_stands_still_is_no_dual_return() {
    let slots: Slots = [[Slot { raw: 1000, intensity: 5 }; 32]; 12];
    let mut encoder = Hdl64Encoder::new(Generation::S2, &calibration(), &unit());
    let bytes = encoder.encode(LidarTime(0), &[500; 12], &slots, &SAID);
    let (packet, points) = decode(&mut Hdl64Decoder::new(Some(calibration())), &bytes);
    assert_eq!((packet.dual, points.len(), packet.azimuth_jump), (false, 384, false));
}

#[test]
fn a_jump_in_azimuth_is_marked_and_keeps_out_of_the_rate() {
    let slots: Slots = [[Slot { raw: 1000, intensity: 5 }; 32]; 12];
    let mut encoder = Hdl64Encoder::new(Generation::S2, &calibration(), &unit());
    let mut azimuths = azimuths(Generation::S2, false, 9000, 17);
    azimuths[6..].iter_mut().for_each(|a| *a += 18_000);
    let bytes = encoder.encode(LidarTime(0), &azimuths, &slots, &SAID);
    let (packet, points) = decode(&mut Hdl64Decoder::new(Some(calibration())), &bytes);
    assert!(packet.azimuth_jump);
    // Laser 31 of block 4 fires 45.66 µs into a turn of 17 cdeg per 48 µs.
    let last = points.iter().find(|p| p.column == 2 && p.laser == 31).expect("all slots are filled");
    let beam = (9034.0 + 17.0 * 45.66 / 48.0) * TAU / 36_000.0 - calibration().lasers()[31].rotation_rad;
    assert!(angle(f64::from(last.azimuth_rad) - beam).abs() < 1e-6);
}

/// Runs packets through a decoder without a calibration; `lose` says which are lost. How many packets until it is there.
fn run(generation: Generation, dual: bool, lose: impl Fn(usize) -> bool) -> (Option<usize>, Hdl64Decoder, u32) {
    let mut encoder = Hdl64Encoder::new(generation, &calibration(), &unit());
    encoder.skip(1234); // not from the start of the cycle
    let mut decoder = Hdl64Decoder::new(None);
    let slots: Slots = [[Slot { raw: 1000, intensity: 50 }; 32]; 12];
    let period = u64::from(generation.period_ns(dual).unsigned_abs());
    let mut lost = 0;
    for n in 0..3 * PACKETS {
        if lose(n) {
            encoder.skip(1);
            continue;
        }
        // From shortly before the hour, over it.
        let us = (u64::from(LidarTime::HOUR_US) - 500_000 + n as u64 * period / 1000) % u64::from(LidarTime::HOUR_US);
        let azimuths = azimuths(generation, dual, (n * 97 % 36_000) as u16, 17);
        let bytes = encoder.encode(LidarTime(us as u32), &azimuths, &slots, &SAID);
        let (packet, _) = decode(&mut decoder, &bytes);
        lost += u32::from(packet.lost);
        if packet.calibration_completed {
            assert!(!packet.uncalibrated && packet.points > 0);
            return (Some(n + 1), decoder, lost);
        }
        assert!(packet.uncalibrated && packet.points == 0);
    }
    (None, decoder, lost)
}

/// The stream's units are the calibration's, so nothing is lost; slopes of 1.2 = 12 · 0.1.
fn assert_same(found: &Calibration) {
    for (found, expected) in found.lasers().iter().zip(calibration().lasers()) {
        let numbers = |l: &LaserCalibration| {
            [
                l.rotation_rad,
                l.vertical_rad,
                l.distance_m,
                l.distance_x_m,
                l.distance_y_m,
                l.vertical_offset_m,
                l.horizontal_offset_m,
                l.focal_distance_m,
                l.focal_slope,
            ]
        };
        for (f, e) in numbers(found).into_iter().zip(numbers(expected)) {
            assert!((f - e).abs() < 1e-12, "{found:?} {expected:?}");
        }
        assert_eq!((found.min_intensity, found.max_intensity), (10, 250));
    }
}

#[test]
fn the_calibration_in_the_stream_is_there_after_4160_packets() {
    for (generation, dual) in [(Generation::S2, false), (Generation::S3, false), (Generation::S3, true)] {
        let (after, decoder, lost) = run(generation, dual, |_| false);
        // The last of the 16 types to come first is a carrier or up to nine others behind one.
        let after = after.expect("complete");
        assert!((PACKETS - 9..=PACKETS).contains(&after), "{generation:?} {after}");
        assert_eq!((lost, decoder.generation()), (0, Some(generation)));
        assert_same(decoder.calibration().expect("complete"));
        assert_eq!(decoder.unit(), Some(&unit()));
        let time = decoder.status().date_time().expect("260 cycles");
        assert_eq!((time.year, time.hour, time.second), (2026, 8, 59));
    }
}

#[test]
fn lost_packets_cost_the_bytes_they_carried_until_the_next_cycle_and_no_more() {
    // Every 50th lost and a gap of 150: 83 + 147 holes, filled in the second cycle but for those that fall on the same
    // place again: 50 and 4160 share 10, so place n is lost again only when n + 4160 is a multiple of 50, which it is not.
    let gap = 1000..1150;
    let (after, decoder, lost) = run(Generation::S3, false, |n| n % 50 == 49 || gap.contains(&n));
    let after = after.expect("complete in the second cycle");
    assert!((PACKETS + 1..=2 * PACKETS).contains(&after), "{after}");
    assert_same(decoder.calibration().expect("complete"));
    let withheld = (0..after).filter(|n| n % 50 == 49 || gap.contains(n)).count();
    assert_eq!(lost as usize, withheld);
}

#[test]
fn a_gap_too_long_to_count_starts_over() {
    let (after, decoder, _) = run(Generation::S2, false, |n| (2000..3000).contains(&n));
    let after = after.expect("complete");
    assert!((3000 + PACKETS - 9..=3000 + PACKETS + 1).contains(&after), "{after}");
    assert_same(decoder.calibration().expect("complete"));
}

#[test]
fn a_stream_may_start_anywhere_and_must_end_right() {
    for generation in [Generation::S2, Generation::S3] {
        let s3 = generation == Generation::S3;
        let mut bytes = stream(generation, &calibration(), &unit());
        // The start marker itself lies across the end of the buffer.
        bytes.rotate_left(3);
        let found = in_stream::parse(&bytes, s3).expect("a calibration");
        assert_same(&found.calibration);
        assert_eq!(found.unit, unit());
        // One wrong byte: laser 0's vertical angle (offset 8, 5 after rotating). Only the S3's checksum sees it.
        bytes[5] ^= 1;
        match (s3, in_stream::parse(&bytes, s3)) {
            (true, Err(InStreamError::Checksum { .. })) | (false, Ok(_)) => {}
            (_, other) => panic!("{other:?}"),
        }
    }
    assert_eq!(in_stream::parse(&[0; STREAM_LEN], false), Err(InStreamError::Start));
}

#[test]
fn the_checksum_is_that_of_the_polynomial_0x8005() {
    // CRC-16/UMTS (poly 0x8005, init 0, not reflected) of "123456789" is 0xFEE8; here: one group whose bytes 1..10 are
    // it and all else 0, with its bytes 10..21 zero: the register runs on over 11 + 63 · 20 zeros.
    let mut register = 0xFEE8u32;
    for _ in 0..8 * (11 + 63 * 20) {
        register = if register & 0x8000 != 0 { (register << 1 ^ 0x8005) & 0xFFFF } else { register << 1 };
    }
    let mut bytes = [0u8; STREAM_LEN];
    bytes[..5].copy_from_slice(b"UNIT#");
    bytes[8..17].copy_from_slice(b"123456789");
    match in_stream::parse(&bytes, true) {
        Err(InStreamError::Checksum { found: 0, expected }) => assert_eq!(u32::from(expected), register),
        other => panic!("{other:?}"),
    }
}

#[test]
fn an_early_s2_with_text_for_status_is_timed_from_its_end() {
    let slots: Slots = [[Slot { raw: 1000, intensity: 50 }; 32]; 12];
    let mut bytes = Hdl64Encoder::new(Generation::S2, &calibration(), &unit()).encode(
        LidarTime(0),
        &azimuths(Generation::S2, false, 0, 17),
        &slots,
        &SAID,
    );
    bytes[1200..].copy_from_slice(b"\x00\x20DegC");
    let (packet, points) = decode(&mut Hdl64Decoder::new(Some(calibration())), &bytes);
    assert_eq!((packet.generation, packet.settled, packet.stamped), (Generation::S2, true, false));
    // The last laser fires at 5 · 48 + 7 · 6 + 3.66 = 285.66 µs of 288.
    assert_eq!((points[0].dt_ns, points[383].dt_ns), (-288_000, -2_340));
}
