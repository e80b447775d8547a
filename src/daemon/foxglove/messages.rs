//! Our data as Foxglove's messages.

use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{
    FrameTransform, FrameTransforms, Log, PackedElementField, PointCloud, Pose, Quaternion, RawImage, Timestamp,
    Vector3, log,
};

use tumbled_core::Gravity;
use tumbled_kinect::{HEIGHT, WIDTH};

use super::{DepthView, SensorPose, VIEW_POINTS};
use crate::stream::{CloudView, EventLine};

/// Bytes of a point: x, y, z and the intensity, four f32.
const POINT_BYTES: usize = 16;

/// Wall time as Foxglove's stamp. Before 1970 and after 2106 it is left out: the format cannot say it.
pub(super) fn timestamp(unix_ns: i64) -> Option<Timestamp> {
    let sec = u32::try_from(unix_ns.div_euclid(1_000_000_000)).ok()?;
    let nsec = u32::try_from(unix_ns.rem_euclid(1_000_000_000)).ok()?;
    Some(Timestamp::new(sec, nsec))
}

/// The same for the message's own stamp, which cannot be left out.
pub(super) fn log_time(unix_ns: i64) -> u64 {
    u64::try_from(unix_ns).unwrap_or(0)
}

/// A cloud of at most [`VIEW_POINTS`] points. Points that are not finite are left out; without intensity it is 0.
pub(super) fn point_cloud(cloud: &CloudView<'_>) -> PointCloud {
    let mut data = Vec::with_capacity(POINT_BYTES * cloud.len().min(VIEW_POINTS));
    for (point, intensity) in cloud.thinned_out(VIEW_POINTS) {
        for value in point.iter().chain(&[f32::from(intensity)]) {
            data.extend_from_slice(&value.to_le_bytes());
        }
    }
    let field =
        |name: &str, offset| PackedElementField { name: name.to_owned(), offset, r#type: NumericType::Float32 as i32 };
    PointCloud {
        timestamp: timestamp(cloud.unix.0),
        frame_id: cloud.frame.to_owned(),
        pose: Some(identity()),
        point_stride: POINT_BYTES as u32,
        fields: vec![field("x", 0), field("y", 4), field("z", 8), field("intensity", 12)],
        data: data.into(),
    }
}

/// Depth in mm, 0 where nothing was measured: ROS's 16UC1.
pub(super) fn depth_image(depth: &DepthView<'_>) -> RawImage {
    let mut data = vec![0; 2 * WIDTH * HEIGHT];
    for (&pixel, &z) in depth.pixel.iter().zip(depth.z) {
        let at = 2 * pixel as usize;
        if let Some(millimetres) = data.get_mut(at..at + 2) {
            millimetres.copy_from_slice(&((z * 1e3).round() as u16).to_le_bytes());
        }
    }
    RawImage {
        timestamp: timestamp(depth.unix.0),
        frame_id: depth.sensor.to_string(),
        width: WIDTH as u32,
        height: HEIGHT as u32,
        encoding: "16UC1".to_owned(),
        step: 2 * WIDTH as u32,
        data: data.into(),
    }
}

/// No turn and no shift.
pub(super) fn identity() -> Pose {
    Pose {
        position: Some(Vector3 { x: 0.0, y: 0.0, z: 0.0 }),
        orientation: Some(Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
    }
}

/// How the sensors are mounted, at an instant.
pub(super) fn transforms(poses: &[SensorPose], unix_ns: i64) -> FrameTransforms {
    let transform = |pose: &SensorPose| {
        let ([tx, ty, tz], [rx, ry, rz, rw]) = (pose.translation_m, pose.rotation_xyzw);
        FrameTransform {
            timestamp: timestamp(unix_ns),
            parent_frame_id: "rig".to_owned(),
            child_frame_id: pose.sensor.to_string(),
            translation: Some(Vector3 { x: tx, y: ty, z: tz }),
            rotation: Some(Quaternion { x: rx, y: ry, z: rz, w: rw }),
        }
    };
    FrameTransforms { transforms: poses.iter().map(transform).collect() }
}

/// An event as a line of the viewer's log.
pub(super) fn log_line(event: &EventLine) -> Log {
    let level = match event.level {
        Gravity::Info => log::Level::Info,
        Gravity::Warn => log::Level::Warning,
        Gravity::Error => log::Level::Error,
    };
    Log {
        timestamp: event.unix_ns.parse().ok().and_then(timestamp),
        level: level as i32,
        message: format!("{}: {}", event.kind, event.message),
        name: event.sensor.clone().unwrap_or_else(|| "rig".to_owned()),
        file: String::new(),
        line: 0,
    }
}

#[cfg(test)]
mod tests {
    use tumbled_model::{RigNs, SensorId, UnixNs};

    use super::*;
    use crate::stream::CloudKind;

    #[test]
    fn a_point_is_four_floats_and_what_is_not_finite_is_left_out() {
        let sensor = SensorId::from("front");
        let (x, y, z) = ([1.0, f32::NAN, 4.0], [-2.5, 0.0, 5.0], [3.0, 0.0, 6.0]);
        let cloud = CloudView {
            sensor: &sensor,
            kind: CloudKind::Lidar,
            epoch: 0,
            t: RigNs(0),
            unix: UnixNs(1_795_341_600_500_000_000),
            frame: "front",
            x: &x,
            y: &y,
            z: &z,
            intensity: Some(&[7, 8, 9]),
        };
        let message = point_cloud(&cloud);
        let values: Vec<f32> =
            message.data.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        assert_eq!(values, [1.0, -2.5, 3.0, 7.0, 4.0, 5.0, 6.0, 9.0]);
        assert_eq!((message.point_stride, message.frame_id.as_str()), (16, "front"));
        assert_eq!(message.timestamp, Some(Timestamp::new(1_795_341_600, 500_000_000)));
    }

    #[test]
    fn a_depth_image_is_millimetres_where_something_was_measured() {
        let sensor = SensorId::from("near");
        // The second row's third pixel, and the last one; a pixel that is none is left out.
        let (pixel, z) = ([642, 307_199, 307_200], [1.2344, 4.0, 1.0]);
        let image = depth_image(&DepthView { sensor: &sensor, unix: UnixNs(0), pixel: &pixel, z: &z });
        assert_eq!((image.width, image.height, image.step, image.encoding.as_str()), (640, 480, 1_280, "16UC1"));
        let depths = image.data.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]]));
        let found: Vec<(usize, u16)> = depths.enumerate().filter(|(_, depth)| *depth > 0).collect();
        assert_eq!(found, [(642, 1_234), (307_199, 4_000)]);
    }

    #[test]
    fn times_the_format_cannot_say_are_left_out() {
        // 2^32 s after 1970, and 1 ns before it.
        assert_eq!((timestamp(4_294_967_296 * 1_000_000_000), timestamp(-1)), (None, None));
        assert_eq!(timestamp(0), Some(Timestamp::new(0, 0)));
    }
}
