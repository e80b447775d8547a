//! CLOUD: measured points, thinned out for viewers.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_model::{RigNs, SensorId, UnixNs};

use super::class::Class;
use super::hello::StreamOrigin;

/// Points of a CLOUD line unless the config says otherwise: about 50 kB.
pub const CLOUD_POINTS: usize = 2_000;

/// The most the config may ask for: about 0.5 MB a line.
pub const CLOUD_POINTS_MAX: usize = 20_000;

/// What measured a cloud.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum CloudKind {
    /// A Velodyne LiDAR.
    Lidar,
    /// A Kinect's depth camera.
    Kinect,
}

/// One cloud of one sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "tumbled stream: CLOUD")]
pub struct CloudLine {
    /// CLOUD.
    pub class: Class,
    /// Where the data come from.
    pub origin: StreamOrigin,
    /// The epoch the cloud belongs to.
    pub epoch: u64,
    /// The sensor's id.
    pub sensor: String,
    /// What measured it.
    pub kind: CloudKind,
    /// The instant the points stand for, ns on the session's timeline.
    pub t_ns: i64,
    /// The same as wall time, ns since 1970-01-01 UTC as a decimal string.
    pub unix_ns: String,
    /// The frame of the coordinates.
    pub frame: String,
    /// Points before they were thinned out.
    pub points_total: u64,
    /// Every so many-th point is here.
    pub decimation: u64,
    /// x, y, z, m, rounded to millimetres.
    pub xyz_m: Vec<[f32; 3]>,
    /// Calibrated reflectivity of each point, 0 to 255, as the sensor gives it; LiDAR only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub intensity: Option<Vec<u8>>,
}

/// A cloud as it was measured: borrowed, not thinned out.
#[derive(Clone, Copy, Debug)]
pub struct CloudView<'a> {
    /// The sensor.
    pub sensor: &'a SensorId,
    /// What measured it.
    pub kind: CloudKind,
    /// The epoch the cloud belongs to.
    pub epoch: u64,
    /// The instant the points stand for.
    pub t: RigNs,
    /// The same as wall time.
    pub unix: UnixNs,
    /// The frame of the coordinates: `rig`, or the sensor's id for its own.
    pub frame: &'a str,
    /// x, y, z, m.
    pub xyz: &'a [[f32; 3]],
    /// Calibrated reflectivity of each point, 0 to 255; as long as `xyz`, or it is left out.
    pub intensity: Option<&'a [u8]>,
}

impl CloudView<'_> {
    /// Every so many-th point has to be taken for at most `max` of them; at least 1.
    pub fn decimation(&self, max: usize) -> usize {
        self.xyz.len().div_ceil(max.max(1)).max(1)
    }
}

impl CloudLine {
    /// The line of a cloud with at most `max` points (at most [`CLOUD_POINTS_MAX`]). Points that are not finite are left
    /// out.
    pub fn new(origin: StreamOrigin, cloud: &CloudView<'_>, max: usize) -> Self {
        let decimation = cloud.decimation(max.min(CLOUD_POINTS_MAX));
        let intensity = cloud.intensity.filter(|intensity| intensity.len() == cloud.xyz.len());
        let mut xyz_m = Vec::with_capacity(cloud.xyz.len() / decimation + 1);
        let mut kept_intensity = intensity.map(|_| Vec::with_capacity(cloud.xyz.len() / decimation + 1));
        for (index, point) in cloud.xyz.iter().enumerate().step_by(decimation) {
            if !point.iter().all(|coordinate| coordinate.is_finite()) {
                continue;
            }
            xyz_m.push(point.map(to_millimetre));
            if let (Some(kept), Some(value)) = (&mut kept_intensity, intensity.and_then(|all| all.get(index))) {
                kept.push(*value);
            }
        }
        Self {
            class: Class::Cloud,
            origin,
            epoch: cloud.epoch,
            sensor: cloud.sensor.to_string(),
            kind: cloud.kind,
            t_ns: cloud.t.0,
            unix_ns: cloud.unix.0.to_string(),
            frame: cloud.frame.to_owned(),
            points_total: cloud.xyz.len() as u64,
            decimation: decimation as u64,
            xyz_m,
            intensity: kept_intensity,
        }
    }
}

/// Rounded, so that a coordinate takes 5 or 6 characters instead of 10.
fn to_millimetre(metres: f32) -> f32 {
    (metres * 1_000.0).round() / 1_000.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(xyz: &[[f32; 3]], intensity: Option<&[u8]>, max: usize) -> CloudLine {
        let sensor = SensorId::from("front");
        let cloud = CloudView {
            sensor: &sensor,
            kind: CloudKind::Lidar,
            epoch: 3,
            t: RigNs(5),
            unix: UnixNs(1_795_341_600_000_000_005),
            frame: "rig",
            xyz,
            intensity,
        };
        CloudLine::new(StreamOrigin::Replay, &cloud, max)
    }

    #[test]
    fn every_kth_point_is_kept_with_its_own_intensity() {
        let xyz: Vec<[f32; 3]> = (0..10).map(|i| [i as f32, 0.0, 0.0]).collect();
        let intensity: Vec<u8> = (0..10).map(|i| 10 * i).collect();
        // 10 points, at most 4: every third (ceil 10/4), that is 0, 3, 6 and 9.
        let line = line(&xyz, Some(&intensity), 4);
        assert_eq!((line.points_total, line.decimation), (10, 3));
        assert_eq!(line.xyz_m.iter().map(|point| point[0]).collect::<Vec<_>>(), [0.0, 3.0, 6.0, 9.0]);
        assert_eq!(line.intensity, Some(vec![0, 30, 60, 90]));
    }

    #[test]
    fn coordinates_are_written_in_millimetres_and_unix_time_as_text() {
        let text = serde_json::to_string(&line(&[[1.234_56, -0.000_4, 12.0]], None, 2_000)).expect("JSON");
        assert_eq!(
            text,
            r#"{"class":"CLOUD","origin":"replay","epoch":3,"sensor":"front","kind":"lidar","t_ns":5,"#.to_owned()
                + r#""unix_ns":"1795341600000000005","frame":"rig","points_total":1,"decimation":1,"xyz_m":[[1.235,-0.0,12.0]]}"#
        );
    }

    #[test]
    fn points_that_are_not_finite_are_left_out_with_their_intensity() {
        let line = line(&[[f32::NAN, 0.0, 0.0], [1.0, 2.0, 3.0], [0.0, f32::INFINITY, 0.0]], Some(&[7, 8, 9]), 2_000);
        assert_eq!((line.points_total, line.xyz_m, line.intensity), (3, vec![[1.0, 2.0, 3.0]], Some(vec![8])));
    }

    #[test]
    fn an_empty_cloud_is_a_line_of_its_own_and_a_wrong_intensity_is_left_out() {
        let empty = line(&[], None, 0);
        assert_eq!((empty.points_total, empty.decimation, empty.xyz_m.len()), (0, 1, 0));
        assert_eq!(line(&[[0.0; 3]; 2], Some(&[1]), 2_000).intensity, None);
    }

    #[test]
    fn a_line_of_the_default_size_is_about_fifty_kilobytes() {
        // 2 000 points of three 6-character numbers, commas and brackets: 2 000 × (3 × 6 + 5) = 46 kB, and 4 each for
        // the intensity.
        let xyz: Vec<[f32; 3]> = (0..57_600).map(|i| [9.0 + i as f32 * 1e-4, -7.123, 3.456_7]).collect();
        let line = line(&xyz, Some(&vec![100; 57_600]), CLOUD_POINTS);
        let bytes = serde_json::to_string(&line).expect("JSON").len();
        assert!(line.xyz_m.len() <= CLOUD_POINTS && bytes < 64_000, "{} points, {bytes} bytes", line.xyz_m.len());
    }
}
