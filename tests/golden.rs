//! Golden captures: small files made by the project's own encoders, and what every field of their decoding must be.
//!
//! A capture lies in `tests/captures`, its golden beside it in `tests/golden`: the number of packets and points, a
//! 64-bit digest of every column (so that a failure says which field moved) and the first and last point to read.
//! `cargo test --test main -- --ignored regenerate` makes both anew; the diff then says what changed.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use tumbled_io::capture::{self, Routing};
use tumbled_kinect::{
    BackProjector, DepthImage, DepthTable, Intrinsics, MmImage, NoiseModel, Points as KinectPoints, RawDisparity,
    RawImage, ZeroPlane, decode_metres, decode_mm, encode_raw,
};
use tumbled_model::{Body, DepthEncoding, LidarTime, PacketMask};
use tumbled_velodyne::encode::position_packet;
use tumbled_velodyne::hdl64::encode::{Hdl64Encoder, Said, Slot};
use tumbled_velodyne::hdl64::{Calibration, Generation, Unit};
use tumbled_velodyne::position::Pps;
use tumbled_velodyne::stream::{Decoded, Settings, StreamDecoder};
use tumbled_velodyne::{Model, ReturnMode};
use xxhash_rust::xxh3::xxh3_64;

use crate::support::pcap::{Datagram, write_pcap};
use crate::support::repository;
use crate::synth::Sensor;

/// What a capture must decode to.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Golden {
    /// Records of the capture: data packets or frames.
    records: usize,
    points: usize,
    /// Digest of each column, little-endian bytes in order.
    digests: BTreeMap<String, String>,
    first: String,
    last: String,
}

/// The captures with a LiDAR in them.
const LIDARS: [(&str, Option<Generation>); 9] = [
    ("vlp32c-strongest-600rpm-fov180", None),
    ("vlp32c-dual-1200rpm", None),
    ("vlp16-last-300rpm-hour", None),
    ("vlp16-dual-600rpm", None),
    ("vlp16-hi-res-strongest-600rpm", None),
    ("hdl32e-strongest-700rpm", None),
    ("hdl64e-s1-600rpm", Some(Generation::S1)),
    ("hdl64e-s2-600rpm", Some(Generation::S2)),
    ("hdl64e-s3-dual-600rpm", Some(Generation::S3)),
];

const KINECT: &str = "kinect-slope";

/// A wavy room: distance by laser and time, some slots without a return, two returns here and there. Counts only: no
/// floating point stands between the capture and its bytes.
fn room(slot: usize, t_ns: i64) -> (u16, u16) {
    let wave = (t_ns / 55_296 * 7 + slot as i64 * 131) % 997;
    match (t_ns / 46_080 + slot as i64) % 11 {
        0 => (0, 0),
        1 => (3_000 + wave as u16, 900),
        2 => (3_000 + wave as u16, 0),
        _ => (1_500 + wave as u16, 1_500 + wave as u16),
    }
}

fn made(name: &str) -> Vec<Datagram> {
    let sensor = |model, mode, rpm| Sensor { rpm, start_deg: 356.0, ..Sensor::new(model, mode) };
    let (sensor, n) = match name {
        "vlp32c-strongest-600rpm-fov180" => {
            let wide = sensor(Model::Vlp32c, ReturnMode::Strongest, 600.0);
            (Sensor { start_deg: 80.0, silent_deg: Some((91.0, 270.0)), ..wide }, 16)
        }
        "vlp32c-dual-1200rpm" => (sensor(Model::Vlp32c, ReturnMode::Dual, 1_200.0), 10),
        "vlp16-last-300rpm-hour" => {
            (Sensor { start_us: 3_599_995_000, ..sensor(Model::Vlp16, ReturnMode::Last, 300.0) }, 10)
        }
        "vlp16-dual-600rpm" => (sensor(Model::Vlp16, ReturnMode::Dual, 600.0), 10),
        "vlp16-hi-res-strongest-600rpm" => (sensor(Model::Vlp16HiRes, ReturnMode::Strongest, 600.0), 10),
        "hdl32e-strongest-700rpm" => (sensor(Model::Hdl32e, ReturnMode::Strongest, 700.0), 10),
        other => return made_hdl64e(other),
    };
    let mut datagrams: Vec<Datagram> = sensor
        .packets(n, room)
        .into_iter()
        .map(|packet| Datagram {
            t_ns: packet.group_t_ns.last().copied().unwrap_or(0) + 80_000,
            port: 2368,
            payload: packet.bytes.to_vec(),
        })
        .collect();
    // The receiver's last second before the hour: 09:59:59 on 22 November 2026.
    let sentence = "$GPRMC,095959.00,A,,,,,,,221126,,,N*67\r\n";
    let payload = position_packet(sensor.stamp(1_000_000), Pps::Locked, sentence).to_vec();
    datagrams.insert(2, Datagram { t_ns: datagrams[1].t_ns, port: 8308, payload });
    datagrams
}

fn made_hdl64e(name: &str) -> Vec<Datagram> {
    let generation = LIDARS.iter().find(|(known, _)| *known == name).and_then(|(_, g)| *g).expect("an HDL-64E");
    let dual = name.contains("dual");
    let calibration = Calibration::parse(&hdl64e_calibration()).expect("64 lasers");
    let mut encoder = Hdl64Encoder::new(generation, &calibration, &Unit::default());
    let time =
        tumbled_model::CivilTime { year: 2026, month: 11, day: 22, hour: 9, minute: 59, second: 59, nanosecond: 0 };
    let said = Said { time, gps: b'A', temperature_c: 41, firmware: 7, warnings: 0 };
    let period_ns = i64::from(generation.period_ns(dual));
    (0..10i64)
        .map(|k| {
            let cycles = i64::from(generation.cycles_per_packet(dual));
            let azimuths = core::array::from_fn(|block| {
                let firing = k * cycles + i64::from(generation.cycle(dual, block as u8));
                ((35_900 + firing * 18) % 36_000) as u16
            });
            let slots = core::array::from_fn(|block| {
                core::array::from_fn(|slot| {
                    let (first, second) = room(slot, (k * 12 + block as i64) * 57_600);
                    let raw = if dual && block % 4 >= 2 { second } else { first };
                    Slot { raw, intensity: (raw / 16) as u8 }
                })
            });
            let stamp = LidarTime(1_000_000 + (k * period_ns / 1_000) as u32);
            let payload = encoder.encode(stamp, &azimuths, &slots, &said).to_vec();
            Datagram { t_ns: k * period_ns + 400_000, port: 2368, payload }
        })
        .collect()
}

/// A made-up factory calibration: every column different from laser to laser, two-point correction in half of them.
fn hdl64e_calibration() -> String {
    let mut text = String::from(
        "laser_id,rot_correction,vert_correction,dist_correction,dist_correction_x,dist_correction_y,\
         vert_offset_correction,horiz_offset_correction,focal_distance,focal_slope,min_intensity,max_intensity\n",
    );
    for laser in 0..64 {
        let k = f64::from(laser);
        let (two_x, two_y) = if laser % 2 == 0 { (1.21 + 0.001 * k, 1.19 + 0.002 * k) } else { (0.0, 0.0) };
        text.push_str(&format!(
            "{laser},{:.4},{:.4},{:.3},{two_x:.3},{two_y:.3},{:.3},{:.3},{:.1},{:.1},{},{}\n",
            -0.09 + 0.003 * k,
            0.03 - 0.0072 * k,
            1.15 + 0.002 * k,
            0.2 - 0.001 * k,
            if laser % 2 == 0 { 0.026 } else { -0.026 },
            10.0 + 0.1 * k,
            1.0 + 0.01 * k,
            laser % 40,
            255 - laser % 7,
        ));
    }
    text
}

fn lidar_golden(name: &str, generation: Option<Generation>) -> Golden {
    let path = repository().join(format!("tests/captures/{name}.pcap"));
    let calibration = generation.map(|_| {
        let text = fs::read_to_string(repository().join("tests/captures/hdl64e-made.csv")).expect("calibration");
        Calibration::parse(&text).expect("64 lasers")
    });
    let mut decoder = StreamDecoder::new(Settings {
        hdl64e_calibration: calibration,
        vertical_offsets: Some(true),
        ..Settings::default()
    });
    let mut out = Decoded::default();
    let captures = vec![capture::open(&path, &Routing::default()).expect("own capture")];
    for event in capture::merge(captures).expect("own capture") {
        let event = event.expect("own capture");
        if let Body::LidarPacket { bytes, .. } = &event.body {
            decoder.push(bytes, event.arrived, &mut out);
        }
    }
    decoder.finish(&mut out);

    let mut digests = Digests::default();
    let p = &out.points;
    digests.add("x", p.x.iter().flat_map(|v| v.to_le_bytes()));
    digests.add("y", p.y.iter().flat_map(|v| v.to_le_bytes()));
    digests.add("z", p.z.iter().flat_map(|v| v.to_le_bytes()));
    digests.add("range_m", p.range_m.iter().flat_map(|v| v.to_le_bytes()));
    digests.add("azimuth_rad", p.azimuth_rad.iter().flat_map(|v| v.to_le_bytes()));
    digests.add("dt_ns", p.dt_ns.iter().flat_map(|v| v.to_le_bytes()));
    digests.add("intensity", p.intensity.iter().copied());
    digests.add("laser", p.laser.iter().copied());
    digests.add("ring", p.ring.iter().copied());
    digests.add("column", p.column.iter().copied());
    digests.add("return", p.ret.iter().map(|v| *v as u8));
    // Everything about the packets, as text: index, arrival, stamp, points, mode, azimuths, jump, pause, order, UTC.
    let packets: Vec<String> = out
        .packets
        .iter()
        .map(|info| format!("{info:?} {:?}", info.stamp.and_then(|stamp| decoder.clock().utc(stamp))))
        .collect();
    digests.add("packets", packets.join("\n").into_bytes());
    digests.add("totals", format!("{:?} {:?}", decoder.tracker().totals(), decoder.counts()).into_bytes());
    let point = |k: usize| format!("{:?}", out.points.get(k).expect("points"));
    Golden {
        records: out.packets.len(),
        points: out.points.len(),
        digests: digests.0,
        first: point(0),
        last: point(out.points.len() - 1),
    }
}

/// A slope from 0.6 m to 4 m with a step in it, no data at the rim, and codes beyond the law.
fn kinect_frame() -> RawImage {
    RawImage::from_fn(|u, v| match (u, v) {
        (632.., _) => RawDisparity::NO_DATA,
        (0..20, 0..20) => RawDisparity(1_054 + (u * v) as u16 % 900),
        _ if (200..300).contains(&u) && (100..300).contains(&v) => RawDisparity(640 + (u + v) as u16 % 9),
        _ => RawDisparity(700 + (v * 300 / 480) as u16 + (u % 3) as u16),
    })
}

fn kinect_golden(encoding: DepthEncoding) -> Golden {
    let path = repository().join(format!("tests/captures/{KINECT}.raw11.png"));
    let record =
        capture::open(&path, &Routing::default()).expect("own capture").next().expect("a frame").expect("whole");
    let Body::DepthFrame { bytes, encoding: DepthEncoding::Raw11, .. } = &record.body else {
        panic!("a raw frame, by its name: {:?}", record.body.sensor());
    };
    let codes = bytes.chunks_exact(2).map(|c| RawDisparity(u16::from_le_bytes([c[0], c[1]]))).collect::<Vec<_>>();
    let image = RawImage::from_fn(|u, v| codes[v * 640 + u]);
    let frame = encode_raw(&image, encoding).expect("eleven bits");
    let mut lost = PacketMask::NONE;
    for packet in [0, 100, 101, 241] {
        lost.mark_lost(packet);
    }
    let table = DepthTable::from_law(&ZeroPlane::default());
    let (mut depth, mut mm, mut points) = (DepthImage::new(), MmImage::new(), KinectPoints::new());
    decode_metres(encoding, &frame, &lost, &table, &mut depth).expect("a whole frame");
    decode_mm(encoding, &frame, &lost, &table, &mut mm).expect("a whole frame");
    let distorted = Intrinsics { k1: -0.26, k2: 0.9, p1: -0.0007, p2: 0.005, k3: -1.2, ..Intrinsics::default() };
    BackProjector::new(&distorted, &NoiseModel::default()).expect("a camera").points(&depth, &mut points);
    let mut digests = Digests::default();
    digests.add("metres", depth.pixels().iter().flat_map(|v| v.to_le_bytes()));
    digests.add("mm", mm.pixels().iter().flat_map(|v| v.to_le_bytes()));
    digests.add("x", points.x().iter().flat_map(|v| v.to_le_bytes()));
    digests.add("y", points.y().iter().flat_map(|v| v.to_le_bytes()));
    digests.add("z", points.z().iter().flat_map(|v| v.to_le_bytes()));
    digests.add("sigma_z", points.sigma_z().iter().flat_map(|v| v.to_le_bytes()));
    digests.add("pixel", points.pixel().iter().flat_map(|v| v.to_le_bytes()));
    let point = |k: usize| {
        let xyz = [points.x()[k], points.y()[k], points.z()[k]];
        format!("{xyz:?} sigma_z {:?} pixel {}", points.sigma_z()[k], points.pixel()[k])
    };
    Golden { records: 1, points: points.len(), digests: digests.0, first: point(0), last: point(points.len() - 1) }
}

#[derive(Default)]
struct Digests(BTreeMap<String, String>);

impl Digests {
    fn add(&mut self, name: &str, bytes: impl IntoIterator<Item = u8>) {
        let bytes: Vec<u8> = bytes.into_iter().collect();
        self.0.insert(name.to_owned(), format!("{:016x}", xxh3_64(&bytes)));
    }
}

fn golden_path(name: &str) -> PathBuf {
    repository().join(format!("tests/golden/{name}.json"))
}

fn assert_golden(name: &str, got: &Golden) {
    let text = fs::read_to_string(golden_path(name)).expect("a golden file");
    let want: Golden = serde_json::from_str(&text).expect("a golden");
    let moved: Vec<_> = got.digests.iter().filter(|(name, digest)| want.digests.get(*name) != Some(*digest)).collect();
    assert!(*got == want, "{name}: moved: {moved:?}\ngot {got:#?}\nwant {want:#?}");
}

#[test]
fn every_field_of_every_lidar_capture_is_as_recorded() {
    for (name, generation) in LIDARS {
        assert_golden(name, &lidar_golden(name, generation));
    }
}

#[test]
fn a_kinect_frame_is_the_same_packed_and_unpacked() {
    assert_golden(KINECT, &kinect_golden(DepthEncoding::Packed11));
    assert_golden(KINECT, &kinect_golden(DepthEncoding::Raw11));
}

#[test]
fn the_encoders_still_make_the_captures() {
    for (name, _) in LIDARS {
        let stored = fs::read(repository().join(format!("tests/captures/{name}.pcap"))).expect("a capture");
        assert!(stored == write_pcap(&made(name)), "{name}: the encoder makes other bytes");
    }
}

#[test]
#[ignore = "writes the golden captures and their digests anew"]
fn regenerate() {
    let captures = repository().join("tests/captures");
    fs::write(captures.join("hdl64e-made.csv"), hdl64e_calibration()).expect("writes");
    let golden = |name: &str, golden: &Golden| {
        let text = serde_json::to_string_pretty(golden).expect("JSON");
        fs::write(golden_path(name), text + "\n").expect("writes");
    };
    for (name, generation) in LIDARS {
        fs::write(captures.join(format!("{name}.pcap")), write_pcap(&made(name))).expect("writes");
        golden(name, &lidar_golden(name, generation));
    }
    let pixels: Vec<u8> = kinect_frame().pixels().iter().flat_map(|code| code.0.to_be_bytes()).collect();
    let mut png_bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut png_bytes, 640, 480);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    encoder.write_header().and_then(|mut w| w.write_image_data(&pixels)).expect("writes a PNG");
    fs::write(captures.join(format!("{KINECT}.raw11.png")), png_bytes).expect("writes");
    golden(KINECT, &kinect_golden(DepthEncoding::Packed11));
}
