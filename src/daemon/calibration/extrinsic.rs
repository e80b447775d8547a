//! What `calibrate extrinsic` found: as JSON, and as entries of the calibration file.

use nalgebra::Isometry3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_calib::fit::Covariance;
use tumbled_calib::{Extrinsic, Status};
use tumbled_core::estimate::Trust;

use super::gather::Pair;
use super::provenance::Provenance;
use super::standstill::Still;
use crate::config::RawKinectSigma;
use crate::config::calibration::{CalibratedTransform, RawCalibration};

/// What the rows of an extrinsic's covariance are.
pub const COVARIANCE_OF: [&str; 7] = [
    "rotation x, rad: R <- Exp(r) R, rig axes",
    "rotation y, rad",
    "rotation z, rad",
    "translation x, m: t <- t + d, rig axes",
    "translation y, m",
    "translation z, m",
    "depth scale of the Kinect, a share; 0 where it was not solved for",
];

/// What `tumbled calibrate extrinsic` found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled calibrate extrinsic --json")]
pub struct ExtrinsicReport {
    /// The verdict, the gates, the covariance, and what it was made from.
    pub provenance: Provenance,
    /// What was shown: `board 0.80 x 0.60 m`, `sphere of radius 0.250 m`.
    pub target: String,
    /// The LiDAR's id.
    pub lidar: String,
    /// The Kinect's id.
    pub kinect: String,
    /// The result; null: there is none, and the gates say why.
    pub result: Option<Placed>,
    /// The config's place of the Kinect in the LiDAR's frame, from which it began.
    pub start_t_lidar_kinect: TransformJson,
    /// The poses in the order of time.
    pub poses: Vec<PoseLine>,
    /// Odd poses against even ones; null: not to be had.
    pub split: Option<SplitJson>,
    /// Poses held back; null: not to be had.
    pub held_out: Option<HeldOutJson>,
    /// χ² over its degrees of freedom of the two sensors' disagreement: the covariance is scaled by it where it is above 1.
    pub chi_square_per_freedom: Option<f64>,
    /// The file that was written; null: none, because the result failed.
    pub written: Option<String>,
    /// Where what was there before is kept; null: nothing was.
    pub kept: Option<String>,
    /// What a person should know.
    pub warnings: Vec<String>,
}

/// A rigid transform.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TransformJson {
    /// Translation x, y, z, m.
    pub translation_m: [f64; 3],
    /// Rotation, a unit quaternion in the order x, y, z, w.
    pub rotation_xyzw: [f64; 4],
}

impl From<&Isometry3<f64>> for TransformJson {
    fn from(t: &Isometry3<f64>) -> Self {
        let (v, q) = (t.translation.vector, t.rotation);
        Self { translation_m: [v.x, v.y, v.z], rotation_xyzw: [q.i, q.j, q.k, q.w] }
    }
}

/// The result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Placed {
    /// Kinect coordinates into the rig's.
    pub t_rig_kinect: TransformJson,
    /// Kinect coordinates into the LiDAR's.
    pub t_lidar_kinect: TransformJson,
    /// The same rotation as angles, degrees: turn by the third about z, then by the second about the new y, then by the first
    /// about the new x.
    pub lidar_kinect_rpy_deg: [f64; 3],
    /// One standard deviation about the rig's axes, degrees.
    pub sigma_rotation_deg: [f64; 3],
    /// One standard deviation along the rig's axes, mm.
    pub sigma_translation_mm: [f64; 3],
    /// True depth over the depths measured with the config's own scale; null: not solved for.
    pub depth_scale: Option<f64>,
    /// Its standard deviation.
    pub sigma_depth_scale: Option<f64>,
}

/// A pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PoseLine {
    /// Counts from 0.
    pub number: usize,
    /// Session time of its beginning, s.
    pub from_s: f64,
    /// Session time of its end, s.
    pub until_s: f64,
    /// Frames it is the mean of.
    pub frames: usize,
    /// Why it is not used; null: it is.
    pub left_aside: Option<String>,
    /// The target's middle in the Kinect's frame, m; null: not seen by both.
    pub middle_m: Option<[f64; 3]>,
    /// The board's normal in the Kinect's frame; null: a sphere, or not seen.
    pub normal: Option<[f64; 3]>,
    /// The Kinect's points used.
    pub kinect_points: usize,
    /// The LiDAR's points used.
    pub lidar_points: usize,
    /// R.m.s. distance of the Kinect's points from the common surface, mm.
    pub kinect_rms_mm: Option<f64>,
    /// R.m.s. distance of the LiDAR's points from the common surface, mm.
    pub lidar_rms_mm: Option<f64>,
    /// Mean distance of the LiDAR's points beyond the surface that the Kinect alone saw, mm.
    pub offset_mm: Option<f64>,
    /// Between the two sensors' own planes, degrees; null: a sphere, or not seen.
    pub angle_deg: Option<f64>,
    /// The largest shift of a parameter when this pose is left out, in standard deviations.
    pub left_out_sigma: Option<f64>,
    /// How far the rotation turns when it is left out, degrees.
    pub left_out_deg: Option<f64>,
    /// How far the translation moves when it is left out, mm.
    pub left_out_mm: Option<f64>,
}

/// Two halves of the poses.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SplitJson {
    /// The largest difference of a parameter, in its standard deviations.
    pub sigma: f64,
    /// The rotations' difference, degrees.
    pub rotation_deg: f64,
    /// The translations' difference, mm.
    pub translation_mm: f64,
}

/// Poses held back.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HeldOutJson {
    /// How many.
    pub poses: usize,
    /// R.m.s. of the LiDAR's points beyond the surface the Kinect saw, mm.
    pub rms_mm: f64,
    /// Their mean, mm.
    pub mean_mm: f64,
}

/// The result in the rig's frame, with its covariance's rows.
pub(super) fn placed(
    t_lidar_camera: &Isometry3<f64>,
    covariance: &Covariance,
    depth_scale: Option<f64>,
    pair: &Pair<'_>,
) -> (Placed, Vec<Vec<f64>>) {
    let t_rig_lidar = pair.lidar.t_rig_lidar.isometry;
    let turn = t_rig_lidar.rotation.to_rotation_matrix().into_inner();
    let mut to_rig = nalgebra::SMatrix::<f64, 7, 7>::identity();
    to_rig.fixed_view_mut::<3, 3>(0, 0).copy_from(&turn);
    to_rig.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn);
    let covariance = to_rig * covariance * to_rig.transpose();
    let sigma = |n: usize| covariance.get((n, n)).copied().unwrap_or_default().max(0.0).sqrt();
    let (roll, pitch, yaw) = t_lidar_camera.rotation.euler_angles();
    let placed = Placed {
        t_rig_kinect: (&(t_rig_lidar * t_lidar_camera)).into(),
        t_lidar_kinect: t_lidar_camera.into(),
        lidar_kinect_rpy_deg: [roll, pitch, yaw].map(f64::to_degrees),
        sigma_rotation_deg: [0, 1, 2].map(|n| sigma(n).to_degrees()),
        sigma_translation_mm: [3, 4, 5].map(|n| 1e3 * sigma(n)),
        depth_scale,
        sigma_depth_scale: depth_scale.map(|_| sigma(6)),
    };
    let rows = covariance.row_iter().map(|row| row.iter().copied().collect()).collect();
    (placed, rows)
}

/// The report of a result; nothing is written yet.
pub fn report(
    found: &Extrinsic,
    stills: &[Still],
    pair: &Pair<'_>,
    target: String,
    mut provenance: Provenance,
) -> ExtrinsicReport {
    let placed = found.fit().map(|fit| placed(&fit.t_lidar_camera, &fit.covariance, fit.depth_scale, pair));
    if let Some((_, rows)) = &placed {
        provenance.covariance_of = COVARIANCE_OF.map(str::to_owned).to_vec();
        provenance.covariance.clone_from(rows);
    }
    if let Some(serial) = &pair.kinect.serial {
        provenance.serials.insert(pair.kinect.id.to_string(), serial.clone());
    }
    let agreement = found.agreement.as_ref();
    let seconds = |t: tumbled_model::RigNs| t.0 as f64 * 1e-9;
    let line = |(pose, still): (&tumbled_calib::PoseOutcome, &Still)| {
        let seen = pose.seen.as_ref();
        let left = agreement.and_then(|agreement| {
            agreement.left_out.iter().chain(&agreement.dropped).find(|left| left.pose == pose.number)
        });
        PoseLine {
            number: pose.number,
            from_s: seconds(still.from),
            until_s: seconds(still.until),
            frames: still.frames,
            left_aside: pose.left_aside.clone(),
            middle_m: seen.map(|seen| seen.middle.into()),
            normal: seen.and_then(|seen| seen.normal).map(Into::into),
            kinect_points: seen.map_or(0, |seen| seen.points.0),
            lidar_points: seen.map_or(0, |seen| seen.points.1),
            kinect_rms_mm: seen.map(|seen| seen.rms_mm.0),
            lidar_rms_mm: seen.map(|seen| seen.rms_mm.1),
            offset_mm: seen.map(|seen| seen.offset_mm),
            angle_deg: seen.and_then(|seen| seen.angle_deg),
            left_out_sigma: left.map(|left| left.shift_sigma),
            left_out_deg: left.map(|left| left.rotation_deg),
            left_out_mm: left.map(|left| left.translation_mm),
        }
    };
    ExtrinsicReport {
        provenance,
        target,
        lidar: pair.lidar.id.to_string(),
        kinect: pair.kinect.id.to_string(),
        result: placed.map(|(placed, _)| placed),
        start_t_lidar_kinect: (&found.start).into(),
        poses: found.poses.iter().zip(stills).map(line).collect(),
        split: agreement.and_then(|agreement| agreement.split).map(|split| SplitJson {
            sigma: split.sigma,
            rotation_deg: split.rotation_deg,
            translation_mm: split.translation_mm,
        }),
        held_out: agreement.and_then(|agreement| agreement.held_out).map(|held| HeldOutJson {
            poses: held.poses,
            rms_mm: held.rms_mm,
            mean_mm: held.mean_mm,
        }),
        chi_square_per_freedom: found.fit().map(|fit| fit.chi_square / fit.freedom.max(1) as f64),
        written: None,
        kept: None,
        warnings: Vec::new(),
    }
}

/// Puts the result into a calibration file's content; one that failed is not put there.
pub fn enter(file: &mut RawCalibration, report: &ExtrinsicReport, pair: &Pair<'_>) -> bool {
    let Some(result) = &report.result else { return false };
    if report.provenance.status == Status::Fail {
        return false;
    }
    enter_place(file, result, pair, pair.kinect.depth_scale);
    true
}

/// Puts a Kinect's place into a calibration file's content. `measured_with`: the depth scale that depths had been measured with.
pub(super) fn enter_place(file: &mut RawCalibration, result: &Placed, pair: &Pair<'_>, measured_with: f64) {
    // The Kinect is placed by the LiDAR: its place in the rig holds with the LiDAR's that it was found with.
    let lidar = file.lidar.entry(pair.lidar.id.to_string()).or_default();
    let of_lidar = TransformJson::from(&pair.lidar.t_rig_lidar.isometry);
    lidar.t_rig_lidar =
        Some(CalibratedTransform { translation_m: of_lidar.translation_m, rotation_xyzw: of_lidar.rotation_xyzw });
    let kinect = file.kinect.entry(pair.kinect.id.to_string()).or_default();
    kinect.serial = pair.kinect.serial.clone().or(kinect.serial.take());
    let TransformJson { translation_m, rotation_xyzw } = result.t_rig_kinect;
    kinect.t_rig_kinect = Some(CalibratedTransform { translation_m, rotation_xyzw });
    if let Some(scale) = result.depth_scale {
        kinect.depth_scale = Some(measured_with * scale);
    }
    let known = kinect.sigma.or(pair.kinect.sigma);
    let usual = Trust::default();
    let (time_offset_ms, depth_scale) =
        known.map_or((1e3 * usual.time_s, usual.depth_scale), |sigma| (sigma.time_offset_ms, sigma.depth_scale));
    let whole = |sigmas: [f64; 3]| sigmas.iter().map(|sigma| sigma * sigma).sum::<f64>().sqrt();
    kinect.sigma = Some(RawKinectSigma {
        rotation_deg: whole(result.sigma_rotation_deg),
        translation_m: 1e-3 * whole(result.sigma_translation_mm),
        time_offset_ms,
        depth_scale: result.sigma_depth_scale.unwrap_or(depth_scale),
    });
}
