//! A real HDL-64E S1 against velodyne-decoder 3.1.0, point by point.

use std::f64::consts::PI;
use tumbled_velodyne::hdl64::{Calibration, Firmware, Generation, Hdl64Decoder};
use tumbled_velodyne::{DataPacket, LidarPoint, Points};

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/velodyne");

/// A file of the data folder, or `None` and a line that says so.
fn file(name: &str) -> Option<Vec<u8>> {
    let found = std::fs::read(format!("{DATA}/{name}")).ok();
    if found.is_none() {
        println!("skipped: ../shared/data/velodyne/{name} is not there");
    }
    found
}

/// UDP payloads of 1206 bytes of a little-endian pcap: 24 bytes of file header; per packet 16 of header with the
/// captured length at 8, then 42 of Ethernet, IP and UDP.
fn payloads(pcap: &[u8]) -> Vec<&[u8]> {
    let mut payloads = Vec::new();
    let mut rest = &pcap[24..];
    while rest.len() >= 16 {
        let length = u32::from_le_bytes(rest[8..12].try_into().expect("four bytes")) as usize;
        let (packet, behind) = rest[16..].split_at(length);
        if packet.len() == 42 + 1206 {
            payloads.push(&packet[42..]);
        }
        rest = behind;
    }
    payloads
}

/// A record of 24 bytes: x, y, z f32; dt i32; packet u16; column, ring, intensity, return u8; flags u16.
struct Expected {
    xyz: [f64; 3],
    dt_ns: i32,
    packet: u16,
    column: u8,
    ring: u8,
    intensity: u8,
    ret: u8,
}

fn expected(pts: &[u8]) -> Vec<Expected> {
    let record = |r: &[u8; 24]| {
        let four = |at: usize| [r[at], r[at + 1], r[at + 2], r[at + 3]];
        Expected {
            xyz: [0, 4, 8].map(|at| f64::from(f32::from_le_bytes(four(at)))),
            dt_ns: i32::from_le_bytes(four(12)),
            packet: u16::from_le_bytes([r[16], r[17]]),
            column: r[18],
            ring: r[19],
            intensity: r[20],
            ret: r[21],
        }
    };
    pts.as_chunks::<24>().0.iter().map(record).collect()
}

#[test]
fn every_point_of_the_first_fifty_packets_is_where_velodyne_decoder_has_it() {
    let (Some(pcap), Some(pts), Some(csv)) =
        (file("hdl64e_s1_600rpm_a.pcap"), file("hdl64e_s1_600rpm_a.vd310.pts"), file("hdl64e_calibration.csv"))
    else {
        return;
    };
    let calibration = Calibration::parse(std::str::from_utf8(&csv).expect("text")).expect("the factory table");
    let mut decoder = Hdl64Decoder::new(Some(calibration));
    let mut found: Vec<(u16, LidarPoint)> = Vec::new();
    let mut points = Points::default();
    for (index, payload) in (0u16..50).zip(payloads(&pcap)) {
        points.clear();
        let packet =
            decoder.decode(&DataPacket::new(payload).expect("1206 bytes"), &mut points).expect("a data packet");
        assert_eq!((packet.generation, packet.stamped, packet.dual), (Generation::S1, false, false));
        assert!(packet.settled && !packet.uncalibrated && !packet.azimuth_jump);
        assert_eq!((packet.firings, packet.period_ns, packet.points), (12, 384_000, points.len()));
        found.extend(points.iter_range(0..points.len()).map(|point| (index, point)));
    }
    let expected = expected(&pts);
    assert_eq!((found.len(), expected.len()), (18_364, 18_364));

    let (mut range_m, mut azimuth_deg, mut dt_ns, mut height_m) = (0.0f64, 0.0f64, 0, 0.0f64);
    for (at, ((packet, found), expected)) in found.iter().zip(&expected).enumerate() {
        assert_eq!(*packet, expected.packet, "point {at}");
        assert_eq!(
            (found.column, found.ring, found.ret as u8),
            (expected.column, expected.ring, expected.ret),
            "point {at}"
        );
        assert!(found.intensity.abs_diff(expected.intensity) <= 1, "point {at}");
        let [x, y, z] = found.xyz.map(f64::from);
        let [ex, ey, ez] = expected.xyz;
        range_m = range_m.max(((x * x + y * y + z * z).sqrt() - (ex * ex + ey * ey + ez * ez).sqrt()).abs());
        height_m = height_m.max((z - ez).abs());
        let turn = (libm::atan2(-y, x) - libm::atan2(-ey, ex) + 3.0 * PI).rem_euclid(2.0 * PI) - PI;
        azimuth_deg = azimuth_deg.max(turn.abs().to_degrees());
        dt_ns = dt_ns.max((found.dt_ns - expected.dt_ns).abs());
    }
    println!(
        "18364 points: range within {:.3} mm, height {:.3} mm, azimuth {azimuth_deg:.4}°, time {:.3} µs",
        range_m * 1e3,
        height_m * 1e3,
        f64::from(dt_ns) * 1e-3
    );
    // Range and height need no time: what is left is f32 and the azimuth's share in the two-point correction.
    assert!(range_m <= 1e-4 && height_m <= 1e-4, "{range_m} {height_m}");
    // velodyne-decoder lets blocks last 24.8 or 49.6 µs by the encoder's steps of 0.09°; here all last 32 µs. Twelve
    // blocks then differ by up to a block in time and by a step in azimuth.
    assert!(azimuth_deg <= 0.1, "{azimuth_deg}");
    assert!(dt_ns <= 22_300, "{dt_ns}");
}

#[test]
fn the_whole_capture_is_an_s1_with_text_for_status() {
    let Some(pcap) = file("hdl64e_s1_600rpm_a.pcap") else { return };
    let mut decoder = Hdl64Decoder::new(None);
    let mut points = Points::default();
    let payloads = payloads(&pcap);
    assert_eq!(payloads.len(), 153);
    for payload in payloads {
        let packet =
            decoder.decode(&DataPacket::new(payload).expect("1206 bytes"), &mut points).expect("a data packet");
        // An S1 sends no calibration: without a file there are no points.
        assert!(packet.uncalibrated && !packet.stamped && packet.points == 0 && points.is_empty());
    }
    let status = decoder.status();
    assert_eq!(decoder.generation(), Some(Generation::S1));
    assert_eq!(status.firmware, Some(Firmware::Text(*b"v25c")));
    // 0x204F and 0x2051 in turn: 32.31 and 32.32 °C. The turns go from 0x0C21 to 0x0C22 as the azimuth passes 0.
    assert!(status.temperature_c.is_some_and(|t| (32.3..32.4).contains(&t)), "{status:?}");
    assert_eq!(status.turns, Some(0x0C22));
}
