//! CLOUD: measured points, thinned out for viewers.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::{Epoch, RigCloud, Scan};
use tumbled_model::{RigNs, SensorId, UnixNs};

use super::class::Class;
use super::hello::StreamOrigin;

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

/// A cloud as it was measured: borrowed, not thinned out. The columns are equally long.
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
    /// x of each point, m.
    pub x: &'a [f32],
    /// y of each point, m.
    pub y: &'a [f32],
    /// z of each point, m.
    pub z: &'a [f32],
    /// Calibrated reflectivity of each point, 0 to 255, where the sensor has it.
    pub intensity: Option<&'a [u8]>,
}

impl<'a> CloudView<'a> {
    /// An epoch's points in the rig's frame; `unix` is the wall time at the epoch's.
    pub fn of_epoch(epoch: &'a Epoch, unix: UnixNs) -> Self {
        let (kind, intensity) = match &epoch.scan {
            Scan::Lidar(scan) => (CloudKind::Lidar, Some(scan.points.intensity.as_slice())),
            Scan::Kinect(_) => (CloudKind::Kinect, None),
        };
        let RigCloud { x, y, z, .. } = &epoch.rig;
        Self { sensor: &epoch.sensor, kind, epoch: epoch.number, t: epoch.t, unix, frame: "rig", x, y, z, intensity }
    }

    /// How many points.
    pub fn len(&self) -> usize {
        self.x.len().min(self.y.len()).min(self.z.len())
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Every so many-th point has to be taken for at most `max` of them; at least 1.
    pub fn decimation(&self, max: usize) -> usize {
        self.len().div_ceil(max.max(1)).max(1)
    }

    /// Every [`CloudView::decimation`]-th point with its intensity (0 without). Those that are not finite are left out.
    pub fn thinned_out(&self, max: usize) -> impl Iterator<Item = ([f32; 3], u8)> + use<'a> {
        let intensity = self.intensity.unwrap_or_default();
        let points = self.x.iter().zip(self.y).zip(self.z).enumerate().step_by(self.decimation(max));
        points
            .map(move |(index, ((x, y), z))| ([*x, *y, *z], intensity.get(index).copied().unwrap_or(0)))
            .filter(|(point, _)| point.iter().all(|coordinate| coordinate.is_finite()))
    }
}

impl CloudLine {
    /// The line of a cloud with at most `max` points. Points that are not finite are left out.
    pub fn new(origin: StreamOrigin, cloud: &CloudView<'_>, max: usize) -> Self {
        let (xyz_m, intensity): (Vec<_>, Vec<_>) =
            cloud.thinned_out(max).map(|(point, intensity)| (point.map(to_millimetre), intensity)).unzip();
        Self {
            class: Class::Cloud,
            origin,
            epoch: cloud.epoch,
            sensor: cloud.sensor.to_string(),
            kind: cloud.kind,
            t_ns: cloud.t.0,
            unix_ns: cloud.unix.0.to_string(),
            frame: cloud.frame.to_owned(),
            points_total: cloud.len() as u64,
            decimation: cloud.decimation(max) as u64,
            xyz_m,
            intensity: cloud.intensity.map(|_| intensity),
        }
    }
}

/// Rounded, so that a coordinate takes 5 or 6 characters instead of 10.
pub(super) fn to_millimetre(metres: f32) -> f32 {
    (metres * 1_000.0).round() / 1_000.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(xyz: &[[f32; 3]], intensity: Option<&[u8]>, max: usize) -> CloudLine {
        let sensor = SensorId::from("front");
        let column = |axis: usize| xyz.iter().map(|point| point[axis]).collect::<Vec<_>>();
        let (x, y, z) = (column(0), column(1), column(2));
        let cloud = CloudView {
            sensor: &sensor,
            kind: CloudKind::Lidar,
            epoch: 3,
            t: RigNs(5),
            unix: UnixNs(1_795_341_600_000_000_005),
            frame: "rig",
            x: &x,
            y: &y,
            z: &z,
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
    fn an_empty_cloud_is_a_line_of_its_own() {
        let empty = line(&[], None, 0);
        assert_eq!((empty.points_total, empty.decimation, empty.xyz_m.len()), (0, 1, 0));
    }

    #[test]
    fn an_epochs_points_are_those_in_the_rigs_frame() {
        let mut scan = tumbled_core::LidarScan::default();
        scan.points.intensity = vec![9];
        let epoch = Epoch {
            number: 4,
            sensor: SensorId::from("front"),
            t: RigNs(5),
            span: (RigNs(0), RigNs(9)),
            sigma: tumbled_model::Span(1),
            basis: tumbled_core::TimeBasis::Arrival,
            arrived: RigNs(10),
            scan: Scan::Lidar(Box::new(scan)),
            rig: RigCloud { x: vec![1.0], y: vec![2.0], z: vec![3.0], in_roi: vec![true] },
        };
        let view = CloudView::of_epoch(&epoch, UnixNs(7));
        assert_eq!(view.thinned_out(10).collect::<Vec<_>>(), [([1.0, 2.0, 3.0], 9)]);
        assert_eq!((view.frame, view.epoch, view.unix), ("rig", 4, UnixNs(7)));
    }

    #[test]
    fn a_line_of_the_default_size_is_about_fifty_kilobytes() {
        // 2 000 points of three 6-character numbers, commas and brackets: 2 000 × (3 × 6 + 5) = 46 kB, and 4 each for
        // the intensity.
        let xyz: Vec<[f32; 3]> = (0..57_600).map(|i| [9.0 + i as f32 * 1e-4, -7.123, 3.456_7]).collect();
        let line = line(&xyz, Some(&vec![100; 57_600]), 2_000);
        let bytes = serde_json::to_string(&line).expect("JSON").len();
        assert!(line.xyz_m.len() <= 2_000 && bytes < 64_000, "{} points, {bytes} bytes", line.xyz_m.len());
    }
}
