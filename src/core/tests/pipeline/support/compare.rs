//! Everything the core gave out, in a form that two runs can be compared by, field by field.

use tumbled_core::{Epoch, KinectScan, LidarScan, Outputs, RigCloud, Scan};

/// What a run gave out: one line a field, columns of points as a digest.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Record {
    pub(crate) epochs: Vec<Vec<(&'static str, String)>>,
    pub(crate) notices: Vec<String>,
    pub(crate) health: Vec<String>,
}

impl Record {
    /// Takes note of what is in `out`.
    pub(crate) fn take(&mut self, out: &Outputs) {
        self.epochs.extend(out.epochs.iter().map(fields));
        // Debug prints every field, and of every float the shortest digits that stand for its bits.
        self.notices.extend(out.notices.iter().map(|notice| format!("{notice:?}")));
        self.health.extend(out.health.iter().map(|health| format!("{health:?}")));
    }

    /// The first difference to another run.
    pub(crate) fn difference(&self, other: &Self) -> Option<String> {
        for (n, (a, b)) in self.epochs.iter().zip(&other.epochs).enumerate() {
            let differing: Vec<_> = a.iter().zip(b).filter(|(a, b)| a != b).collect();
            if !differing.is_empty() || a.len() != b.len() {
                return Some(format!("epoch {n}: {differing:?}\n of {a:?}\n and {b:?}"));
            }
        }
        let first = |what: &str, a: &[String], b: &[String]| {
            let differs =
                a.iter().zip(b).position(|(a, b)| a != b).or((a.len() != b.len()).then(|| a.len().min(b.len())));
            differs.map(|n| format!("{what} {n} of {} and {}:\n {:?}\n {:?}", a.len(), b.len(), a.get(n), b.get(n)))
        };
        if self.epochs.len() != other.epochs.len() {
            return Some(format!("{} epochs and {}", self.epochs.len(), other.epochs.len()));
        }
        first("notice", &self.notices, &other.notices).or_else(|| first("health", &self.health, &other.health))
    }
}

/// Every field of an epoch. The structs are taken apart, so that a new field does not compile until it is compared.
fn fields(epoch: &Epoch) -> Vec<(&'static str, String)> {
    let Epoch { number, sensor, t, span, sigma, basis, arrived, scan, rig } = epoch;
    let RigCloud { x, y, z, in_roi } = rig;
    let mut fields = vec![
        ("number", number.to_string()),
        ("sensor", sensor.to_string()),
        ("t", t.0.to_string()),
        ("span", format!("{}..{}", span.0.0, span.1.0)),
        ("sigma", sigma.0.to_string()),
        ("basis", format!("{basis:?}")),
        ("arrived", arrived.0.to_string()),
        ("rig.x", floats(x)),
        ("rig.y", floats(y)),
        ("rig.z", floats(z)),
        ("rig.in_roi", digest(in_roi.iter().map(|inside| u64::from(*inside)))),
    ];
    match scan {
        Scan::Kinect(KinectScan { points, loss }) => fields.extend([
            ("points.x", floats(points.x())),
            ("points.y", floats(points.y())),
            ("points.z", floats(points.z())),
            ("points.sigma_z", floats(points.sigma_z())),
            ("points.pixel", digest(points.pixel().iter().map(|pixel| u64::from(*pixel)))),
            ("loss", format!("{loss:?}")),
        ]),
        Scan::Lidar(scan) => {
            let LidarScan { stamp, points, crossing, coverage, packets } = scan.as_ref();
            let tumbled_velodyne::Points { x, y, z, range_m, azimuth_rad, dt_ns, intensity, laser, ring, column, ret } =
                points;
            let bytes = |column: &[u8]| digest(column.iter().map(|byte| u64::from(*byte)));
            fields.extend([
                ("stamp", stamp.0.to_string()),
                ("crossing", format!("{crossing:?}")),
                ("coverage", coverage.to_bits().to_string()),
                ("packets", packets.to_string()),
                ("points.x", floats(x)),
                ("points.y", floats(y)),
                ("points.z", floats(z)),
                ("points.range_m", floats(range_m)),
                ("points.azimuth_rad", floats(azimuth_rad)),
                ("points.dt_ns", digest(dt_ns.iter().map(|dt_ns| i64::from(*dt_ns) as u64))),
                ("points.intensity", bytes(intensity)),
                ("points.laser", bytes(laser)),
                ("points.ring", bytes(ring)),
                ("points.column", bytes(column)),
                ("points.ret", digest(ret.iter().map(|ret| *ret as u64))),
            ]);
        }
    }
    fields
}

fn floats(column: &[f32]) -> String {
    digest(column.iter().map(|value| u64::from(value.to_bits())))
}

/// Length and hash (FNV-1a, by words) of a column.
fn digest(column: impl ExactSizeIterator<Item = u64>) -> String {
    let len = column.len();
    let hash = column
        .fold(0xcbf2_9ce4_8422_2325u64, |hash, word| (hash ^ word).wrapping_mul(0x0100_0000_01b3).rotate_left(29));
    format!("{len}:{hash:016x}")
}

#[test]
fn a_single_bit_of_a_column_is_a_difference() {
    let mut points = tumbled_velodyne::Points::default();
    let point = tumbled_velodyne::LidarPoint {
        xyz: [1.0, 2.0, 3.0],
        range_m: 4.0,
        azimuth_rad: 0.5,
        dt_ns: 7,
        intensity: 8,
        laser: 9,
        ring: 10,
        column: 11,
        ret: tumbled_velodyne::Return::Last,
    };
    points.push(point);
    let epoch = |points| Epoch {
        number: 0,
        sensor: "front".into(),
        t: tumbled_model::RigNs(0),
        span: (tumbled_model::RigNs(0), tumbled_model::RigNs(0)),
        sigma: tumbled_model::Span(0),
        basis: tumbled_core::TimeBasis::Arrival,
        arrived: tumbled_model::RigNs(0),
        scan: Scan::Lidar(Box::new(LidarScan { points, ..LidarScan::default() })),
        rig: RigCloud::default(),
    };
    let record = |points| {
        let mut record = Record::default();
        let mut out = Outputs::default();
        out.epochs.push(epoch(points));
        record.take(&out);
        record
    };
    let before = record(points.clone());
    assert_eq!(before.difference(&record(points.clone())), None);
    points.z[0] = f32::from_bits(points.z[0].to_bits() ^ 1);
    let difference = before.difference(&record(points)).expect("a bit");
    assert!(difference.contains("points.z"), "{difference}");
}
