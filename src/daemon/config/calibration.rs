//! The calibration file: what a calibration found, per sensor id, laid over the config.
//!
//! ```toml
//! [lidar.front]
//! t_rig_lidar = { translation_m = [0.0, 0.0, 1.1], rotation_xyzw = [0.0, 0.0, 0.0, 1.0] }
//! time_offset_ms = 1.5
//! [kinect.near]
//! intrinsics = { fx = 580.1, fy = 579.6, cx = 318.2, cy = 242.9 }
//! sigma = { rotation_deg = 0.2, translation_m = 0.004, time_offset_ms = 2.0, depth_scale = 0.003 }
//! ```
//! A transform or intrinsics given here replaces the one in the config whole: half a calibrated rotation with half a
//! drawn one would be neither. So they are complete here, and distortion left out is none.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::files::{FileFault, FileShelf, RigFile};
use super::names::check_names;
use super::origin::{Layer, Origin, SourceText};
use super::problem::Problem;
use super::raw::{RawDepthWarp, RawKinectSigma, RawLidarSigma};
use super::shape::Shape;
use super::tree::{Entry, Node, Step, Value};

/// A calibration file as written.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RawCalibration {
    /// Calibrated LiDARs by their ids in the config.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub lidar: BTreeMap<String, CalibratedLidar>,
    /// Calibrated Kinects by their ids in the config.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub kinect: BTreeMap<String, CalibratedKinect>,
    /// The turntable's axis.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub turntable: Option<CalibratedTurntable>,
    /// How it was found, per command of `calibrate`; anything, not read here.
    pub provenance: BTreeMap<String, serde_json::Value>,
}

/// What a calibration found about the turntable.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CalibratedTurntable {
    /// The axis, rig axes, length 1; the target turns about it counter-clockwise where the encoder's angle grows, times `sign`.
    pub axis: [f64; 3],
    /// The axis' point nearest to the rig's origin, rig frame, m.
    pub point_m: [f64; 3],
    /// The encoder's angle that the rest of the calibration counts from, rad.
    pub angle0_rad: f64,
    /// 1, or -1 where the encoder counts against the axis.
    pub sign: f64,
    /// Angle turned over the encoder's angle; 1 where its units per turn are right.
    pub gain: f64,
    /// Covariance of the axis' two tilts, rad², and of the point's two offsets, m², across the axis: 4 x 4.
    pub covariance: [[f64; 4]; 4],
}

/// What a calibration found about one LiDAR.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CalibratedLidar {
    /// Mounting: lidar coordinates into rig coordinates.
    pub t_rig_lidar: Option<CalibratedTransform>,
    /// Milliseconds by which the stamps are late: measurement time = mapped stamp - offset.
    #[schemars(range(min = -3_600_000.0, max = 3_600_000.0))]
    pub time_offset_ms: Option<f64>,
    /// How far the two may be off: one standard deviation.
    pub sigma: Option<RawLidarSigma>,
}

/// What a calibration found about one Kinect.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CalibratedKinect {
    /// The serial number of the camera it was found with: another one is refused.
    pub serial: Option<String>,
    /// Mounting: depth-camera coordinates into rig coordinates.
    pub t_rig_kinect: Option<CalibratedTransform>,
    /// Milliseconds by which the stamps are late: measurement time = mapped stamp - offset.
    #[schemars(range(min = -3_600_000.0, max = 3_600_000.0))]
    pub time_offset_ms: Option<f64>,
    /// Pinhole model and distortion of the depth camera.
    pub intrinsics: Option<CalibratedIntrinsics>,
    /// True depth over the depth law's: every depth is multiplied by it.
    #[schemars(range(min = 0.5, max = 2.0))]
    pub depth_scale: Option<f64>,
    /// The camera's own error of depth over its image, added to the scaled depth of every point.
    pub depth_warp: Option<RawDepthWarp>,
    /// How far mounting, offset and scale may be off: one standard deviation.
    pub sigma: Option<RawKinectSigma>,
}

/// A complete rigid transform.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CalibratedTransform {
    /// Translation x, y, z, m.
    pub translation_m: [f64; 3],
    /// Rotation, a unit quaternion in the order x, y, z, w.
    pub rotation_xyzw: [f64; 4],
}

/// A complete pinhole model; distortion left out is none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CalibratedIntrinsics {
    /// Focal length along u, pixels.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub fx: f64,
    /// Focal length along v, pixels.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub fy: f64,
    /// Principal point, u, pixels.
    pub cx: f64,
    /// Principal point, v, pixels.
    pub cy: f64,
    /// Radial distortion, second order.
    #[serde(default)]
    pub k1: f64,
    /// Radial distortion, fourth order.
    #[serde(default)]
    pub k2: f64,
    /// Tangential distortion, first coefficient.
    #[serde(default)]
    pub p1: f64,
    /// Tangential distortion, second coefficient.
    #[serde(default)]
    pub p2: f64,
    /// Radial distortion, sixth order.
    #[serde(default)]
    pub k3: f64,
}

/// Reads the calibration file `rig.calibration` names and lays it over the config; gives the file back.
///
/// `root` has its defaults filled in, so that every sensor has its id. A recorded config has had its calibration laid
/// over it before it was recorded, and then `--set`: laying it over once more would undo that, so its file is only kept.
pub(super) fn apply_calibration(
    root: &mut Node,
    shelf: &mut FileShelf,
    problems: &mut Vec<Problem>,
) -> Option<RigFile> {
    const KEY: &str = "rig.calibration";
    let named_by = [Step::Key("rig".to_owned()), Step::Key("calibration".to_owned())];
    let name = root.text_at(&named_by).filter(|name| !name.is_empty())?;
    let origin = root.origin_at(&named_by).clone();
    shelf.note(name, &origin);
    let found = shelf.take(KEY, name, &origin);
    if origin.layer() == Layer::Recorded {
        return found.ok();
    }
    let unusable = |reason: String| {
        let message = format!("the calibration file cannot be read: {reason}");
        let help = "correct the path (a relative one starts at the file it stands in), or leave `calibration` out \
                    to use the transforms, offsets and intrinsics of the config";
        Problem::error(&origin, Some(KEY.to_owned()), message).with_help(help)
    };
    let file = match found {
        Ok(file) => file,
        Err(FileFault::Absent(reason) | FileFault::Unreadable(reason)) => {
            problems.push(unusable(reason));
            return None;
        }
    };
    let text = match file.text() {
        Ok(text) => text.to_owned(),
        Err(fault) => {
            problems.push(unusable(format!("{}: {fault}", file.place)));
            return None;
        }
    };
    let source = SourceText::file(Layer::Calibration, &origin.directory().join(name), text);
    lay_over(root, &source, problems);
    Some(file)
}

/// Lays what a calibration says over the config.
fn lay_over(root: &mut Node, source: &std::sync::Arc<SourceText>, problems: &mut Vec<Problem>) {
    let read_before = problems.len();
    let mut calibration = Node::parse(source, problems);
    if problems.len() > read_before {
        return;
    }
    let mut findings = check_names(&calibration, &Shape::of(&schemars::schema_for!(RawCalibration)));
    problems.append(&mut findings.problems);
    findings.faulty.iter().for_each(|path| calibration.remove(path));
    for section in ["lidar", "kinect"] {
        let Some(Value::Table(sensors)) = calibration.entry(section).map(|entry| entry.node.value.clone()) else {
            continue;
        };
        for sensor in sensors {
            apply_sensor(root, section, sensor, source, problems);
        }
    }
}

/// Replaces what one sensor's table names in the config's table of that sensor.
fn apply_sensor(
    root: &mut Node,
    section: &str,
    sensor: Entry,
    source: &std::sync::Arc<SourceText>,
    problems: &mut Vec<Problem>,
) {
    let Value::Table(root_entries) = &mut root.value else { return };
    let Some(list) = root_entries.iter_mut().find(|entry| entry.name == section) else { return };
    // A list or table of the wrong type is reported with the names and types.
    let (Value::List(elements), Value::Table(found)) = (&mut list.node.value, sensor.node.value) else { return };
    let id_of = |node: &Node| node.text_at(&[Step::Key("id".to_owned())]).map(str::to_owned);
    let ids: Vec<String> = elements.iter().filter_map(id_of).collect();
    let Some(element) = elements.iter_mut().find(|element| id_of(element).as_ref() == Some(&sensor.name)) else {
        let message = format!("`{}` is not the id of a [[{section}]] of the config", sensor.name);
        let help = match ids.as_slice() {
            [] => format!("the config has no [[{section}]]"),
            ids => format!("its ids are {}", ids.iter().map(|id| format!("`{id}`")).collect::<Vec<_>>().join(", ")),
        };
        let origin = match sensor.origin {
            Origin::Default => Origin::new(source, 0..0),
            written => written,
        };
        problems.push(Problem::error(&origin, Some(format!("{section}.{}", sensor.name)), message).with_help(help));
        return;
    };
    let Value::Table(entries) = &mut element.value else { return };
    if let Some(problem) = other_serial(entries, &found, &format!("{section}.{}.serial", sensor.name)) {
        problems.push(problem);
        return;
    }
    for replacement in found {
        entries.retain(|entry| entry.name != replacement.name);
        entries.push(replacement);
    }
}

/// What is wrong where a calibration was found with another camera than the config has. Where the config leaves the
/// serial number open, the calibration's is taken over: then another camera is not opened.
fn other_serial(config: &[Entry], calibration: &[Entry], key: &str) -> Option<Problem> {
    let serial = |entries: &[Entry]| {
        let entry = entries.iter().find(|entry| entry.name == "serial")?;
        let Value::Text(serial) = &entry.node.value else { return None };
        (!serial.is_empty()).then(|| (serial.clone(), entry.origin.clone()))
    };
    let ((wanted, _), (found, origin)) = (serial(config)?, serial(calibration)?);
    if wanted == found {
        return None;
    }
    let message = format!(
        "the calibration was made with the Kinect of serial number \"{found}\", the config has \"{wanted}\": where one \
         camera sits and what its lens is like says nothing of another"
    );
    let help =
        "calibrate this camera (`tumbled calibrate extrinsic`), name its own calibration file, or correct `serial`";
    Some(Problem::error(&origin, Some(key.to_owned()), message).with_help(help))
}
