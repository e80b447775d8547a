//! Reading the real captures and the expected points beside them, for tests only.
#![allow(dead_code, reason = "each test binary uses its part")]

pub(crate) mod streams;
pub(crate) mod synth;

use std::path::PathBuf;
use tumbled_model::RigNs;
use tumbled_velodyne::LidarPoint;

/// A file of the shared captures, or `None` with a line that says the test is skipped.
pub(crate) fn capture(name: &str) -> Option<Vec<u8>> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/velodyne")).join(name);
    match std::fs::read(&path) {
        Ok(bytes) => Some(bytes),
        Err(_) => {
            println!("skipped: ../shared/data/velodyne/{name} is not there");
            None
        }
    }
}

/// UDP payloads of a classic little-endian pcap of Ethernet frames: host stamp, destination port, payload.
pub(crate) fn udp(pcap: &[u8]) -> Vec<(RigNs, u16, &[u8])> {
    let word = |at: usize| u32::from_le_bytes(pcap[at..at + 4].try_into().expect("four bytes"));
    let ns_per_fraction = match word(0) {
        0xa1b2_c3d4 => 1_000,
        0xa1b2_3c4d => 1,
        other => panic!("not a little-endian pcap: {other:#x}"),
    };
    let mut packets = Vec::new();
    let mut at = 24;
    while at + 16 <= pcap.len() {
        let (seconds, fraction, len) = (word(at), word(at + 4), word(at + 8) as usize);
        let frame = &pcap[at + 16..at + 16 + len];
        let udp = 14 + usize::from(frame[14] & 15) * 4;
        let port = u16::from_be_bytes([frame[udp + 2], frame[udp + 3]]);
        let stamp = i64::from(seconds) * 1_000_000_000 + i64::from(fraction) * ns_per_fraction;
        packets.push((RigNs(stamp), port, &frame[udp + 8..]));
        at += 16 + len;
    }
    packets
}

/// One 24-byte record of a `.pts` file.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Expected {
    pub(crate) xyz: [f32; 3],
    pub(crate) dt_ns: i32,
    pub(crate) packet: u16,
    pub(crate) column: u8,
    pub(crate) ring: u8,
    pub(crate) intensity: u8,
    pub(crate) ret: u8,
    pub(crate) jump: bool,
}

pub(crate) fn expected(pts: &[u8]) -> Vec<Expected> {
    assert_eq!(pts.len() % 24, 0);
    pts.chunks_exact(24)
        .map(|r| {
            let f = |at: usize| f32::from_le_bytes(r[at..at + 4].try_into().expect("four bytes"));
            Expected {
                xyz: [f(0), f(4), f(8)],
                dt_ns: i32::from_le_bytes(r[12..16].try_into().expect("four bytes")),
                packet: u16::from_le_bytes([r[16], r[17]]),
                column: r[18],
                ring: r[19],
                intensity: r[20],
                ret: r[21],
                jump: u16::from_le_bytes([r[22], r[23]]) & 1 == 1,
            }
        })
        .collect()
}

/// Largest differences over all points; fields that must be equal are compared by [`compare`].
#[derive(Debug, Default)]
pub(crate) struct Worst {
    pub(crate) azimuth_deg: f64,
    pub(crate) range_m: f64,
    pub(crate) z_m: f64,
    pub(crate) xyz_m: f64,
    pub(crate) dt_ns: i64,
    pub(crate) intensity: u8,
}

/// Compares point by point; rings, columns, returns and packet numbers must be equal. `judge` says for which expected
/// points the geometry and the time count.
pub(crate) fn compare(
    got: &[(u64, LidarPoint, bool)],
    want: &[Expected],
    height: impl Fn(&LidarPoint) -> f64,
    judge: impl Fn(&Expected) -> (bool, bool),
) -> Worst {
    assert_eq!(got.len(), want.len(), "number of points");
    let mut worst = Worst::default();
    for (k, ((packet, p, jump), e)) in got.iter().zip(want).enumerate() {
        let fields = |what: &str, a: u64, b: u64| assert_eq!(a, b, "{what} of point {k}: {p:?} against {e:?}");
        fields("packet", *packet % 65_536, u64::from(e.packet));
        fields("column", u64::from(p.column), u64::from(e.column));
        fields("ring", u64::from(p.ring), u64::from(e.ring));
        fields("return", p.ret as u64, u64::from(e.ret));
        fields("jump flag", u64::from(*jump), u64::from(e.jump));
        worst.intensity = worst.intensity.max(p.intensity.abs_diff(e.intensity));
        let (geometry, time) = judge(e);
        if geometry {
            let [x, y, z] = e.xyz.map(f64::from);
            let [gx, gy, gz] = p.xyz.map(f64::from);
            let turn = (libm::atan2(gy, gx) - libm::atan2(y, x)).to_degrees().rem_euclid(360.0);
            worst.azimuth_deg = worst.azimuth_deg.max(turn.min(360.0 - turn));
            let h = height(p);
            let range = |x: f64, y: f64, z: f64| (x * x + y * y + (z - h) * (z - h)).sqrt();
            worst.range_m = worst.range_m.max((range(gx, gy, gz) - range(x, y, z)).abs());
            worst.z_m = worst.z_m.max((gz - z).abs());
            let d = [gx - x, gy - y, gz - z];
            worst.xyz_m = worst.xyz_m.max(d.iter().map(|v| v * v).sum::<f64>().sqrt());
        }
        if time {
            worst.dt_ns = worst.dt_ns.max((i64::from(p.dt_ns) - i64::from(e.dt_ns)).abs());
        }
    }
    worst
}
