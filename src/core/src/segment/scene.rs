//! Small made-up epochs for the tests of this module.

use crate::epoch::{Epoch, KinectScan, LidarScan, RigCloud, Scan, TimeBasis};
use tumbled_kinect::{BackProjector, Image, Intrinsics, NoiseModel, Points};
use tumbled_model::{RigNs, Span};
use tumbled_velodyne::LidarPoint;

/// The first `count` numbers.
pub(super) fn everything(count: usize) -> Vec<u32> {
    (0..count as u32).collect()
}

/// Points of a depth image, m; 0: none.
pub(super) fn depth_points(of: impl Fn(usize, usize) -> f32) -> Points {
    let projector = BackProjector::new(&Intrinsics::default(), &NoiseModel::default()).expect("a camera");
    let mut points = Points::new();
    projector.points(&Image::from_fn(of), &mut points);
    points
}

/// A LiDAR's epoch of places; all of them in the region of interest.
pub(super) fn epoch_of(places: &[[f32; 3]]) -> Epoch {
    let mut scan = LidarScan::default();
    for [x, y, z] in places {
        let range_m = (x * x + y * y + z * z).sqrt();
        scan.points.push(lidar_point([*x, *y, *z], range_m, 0));
    }
    epoch(Scan::Lidar(Box::new(scan)), places)
}

/// A Kinect's epoch: the camera at the rig's origin, looking along its x; all points in the region of interest.
pub(super) fn kinect_epoch(of: impl Fn(usize, usize) -> f32) -> Epoch {
    let points = depth_points(of);
    let columns = points.x().iter().zip(points.y()).zip(points.z());
    let places: Vec<[f32; 3]> = columns.map(|((x, y), z)| [*z, -*x, -*y]).collect();
    epoch(Scan::Kinect(KinectScan { points, ..KinectScan::default() }), &places)
}

/// A wall across the x axis as a LiDAR with so many rings sees it, ± 5° wide.
pub(super) fn lidar_wall(rings: u8, spacing_rad: f32, distance_m: f32) -> LidarScan {
    let mut scan = LidarScan::default();
    for column in 0..51u8 {
        let azimuth = (f32::from(column) / 25.0 - 1.0) * 0.087;
        for ring in 0..rings {
            let elevation = (f32::from(ring) - f32::from(rings - 1) / 2.0) * spacing_rad;
            // A ball about the sensor: every point at the same range.
            let (c, s) = (libm::cosf(elevation), libm::sinf(elevation));
            let way = [c * libm::cosf(azimuth), c * libm::sinf(azimuth), s];
            scan.points.push(lidar_point(way.map(|w| w * distance_m), distance_m, ring));
        }
    }
    scan
}

/// A square across the x axis, a point a centimetre.
pub(super) fn square([x, y, z]: [f32; 3], half: f32) -> Vec<[f32; 3]> {
    let side = (half * 200.0) as usize;
    (0..=side)
        .flat_map(|i| (0..=side).map(move |j| [x, y - half + i as f32 * 0.01, z - half + j as f32 * 0.01]))
        .collect()
}

fn lidar_point(xyz: [f32; 3], range_m: f32, ring: u8) -> LidarPoint {
    let ret = tumbled_velodyne::Return::Strongest;
    LidarPoint { xyz, range_m, azimuth_rad: 0.0, dt_ns: 0, intensity: 0, laser: ring, ring, column: 0, ret }
}

fn epoch(scan: Scan, places: &[[f32; 3]]) -> Epoch {
    let column = |axis: usize| places.iter().map(|place| place[axis]).collect();
    Epoch {
        number: 0,
        sensor: scan.kind().into(),
        t: RigNs(0),
        span: (RigNs(0), RigNs(0)),
        sigma: Span(0),
        basis: TimeBasis::Arrival,
        arrived: RigNs(0),
        scan,
        rig: RigCloud { x: column(0), y: column(1), z: column(2), in_roi: vec![true; places.len()] },
    }
}
