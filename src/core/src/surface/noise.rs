//! What a sensor's points scatter along its line of sight (method.md §5). Rounded figures of the registration's own:
//! rough is good enough here, for they only weigh points against each other.

use crate::register::cloud::SensorKind;
use nalgebra::{Point3, Vector3};

/// Kinect: σ of depth over the depth's square, 1/m. Half a disparity step of 1/8 px at f = 580 px and a base of 75 mm.
pub const KINECT_PER_M: f32 = 1.425e-3;
/// LiDAR: σ of a range, m: 15 mm of scatter and 10 mm of bias from beam to beam.
pub const LIDAR_M: f32 = 0.018;
/// The bias of a beam, m, and a range's scatter beside it (method.md §5): what [`LIDAR_M`] is made of.
pub const BEAM_BIAS_M: f64 = 0.010;
/// See [`BEAM_BIAS_M`].
pub const BEAM_SCATTER_M: f64 = 0.015;
/// Depth assumed of a Kinect's points whose viewpoint nobody knows, m: the middle of its useful range.
const UNKNOWN_DEPTH_M: f32 = 2.5;
/// As many points as averaging pays for: neighbours' errors are correlated (method.md §5).
pub const INDEPENDENT: f64 = 6.0;

/// The scatter of one cloud's points.
#[derive(Clone, Copy, Debug)]
pub struct PointNoise {
    sensor: SensorKind,
    /// Viewpoint and mean sight line: a Kinect's noise grows with the depth, not with the range.
    sight: Option<(Point3<f32>, Vector3<f32>)>,
}

impl PointNoise {
    /// Of a cloud.
    pub fn of(sensor: SensorKind, viewpoint: Option<Point3<f32>>, points: &[Point3<f32>]) -> Self {
        let mean = |from: Point3<f32>| {
            let sum: Vector3<f32> = points.iter().filter_map(|point| (point - from).try_normalize(1e-6)).sum();
            sum.try_normalize(1e-6).map(|along| (from, along))
        };
        Self { sensor, sight: viewpoint.and_then(mean) }
    }

    /// Standard deviation of a point along its sight, m.
    pub fn sigma_m(&self, point: &Point3<f32>) -> f32 {
        match self.sensor {
            SensorKind::Lidar => LIDAR_M,
            SensorKind::Kinect => {
                let depth = self.sight.map_or(UNKNOWN_DEPTH_M, |(from, along)| (point - from).dot(&along));
                KINECT_PER_M * depth * depth
            }
        }
    }
}
