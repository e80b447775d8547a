//! STATE: the target's pose and motion.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::Epoch;
use tumbled_core::estimate::{Mode, StateReason, TargetMotion, TargetState, Validity};
use tumbled_model::{RigNs, UnixNs};

use super::class::Class;
use super::cloud::CloudKind;
use super::hello::StreamOrigin;

/// Where the target is and how it moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "tumbled stream: STATE")]
pub struct StateLine {
    /// STATE.
    pub class: Class,
    /// Where the data come from.
    pub origin: StreamOrigin,
    /// Whether it was measured or predicted to now.
    pub kind: StateKind,
    /// The epoch it follows.
    pub epoch: u64,
    /// Its time, ns on the session's timeline.
    pub t_ns: i64,
    /// The same as wall time, ns since 1970-01-01 UTC as a decimal string.
    pub unix_ns: String,
    /// How much is known.
    pub mode: Mode,
    /// How far it may be trusted.
    pub validity: Validity,
    /// Why it is not fully valid.
    pub reasons: Vec<StateReason>,
    /// The frame of what follows: `rig`.
    pub frame: String,
    /// Of the target frame's origin, m; null: nobody knows.
    pub position_m: Option<[f64; 3]>,
    /// Target coordinates to rig coordinates, x, y, z, w; null: nobody knows.
    pub rotation_xyzw: Option<[f64; 4]>,
    /// Of the target frame's origin, m/s; null: nobody knows.
    pub velocity_mps: Option<[f64; 3]>,
    /// rad/s; null: nobody knows.
    pub angular_velocity_rps: Option<[f64; 3]>,
    /// The spin; null: it does not spin more than noise.
    pub spin: Option<SpinLine>,
    /// 12 × 12: body twist of the pose (rotation, rad, then translation, m), velocity and angular velocity in rig axes;
    /// null: nobody knows.
    pub covariance: Option<Vec<[f64; 12]>>,
    /// The innovation's normalised square, of six degrees of freedom; null: nothing was measured.
    pub nis: Option<f64>,
    /// What the epoch gave; null in predicted states.
    pub inputs: Option<InputsLine>,
    /// Other poses that explain what was seen.
    pub alternatives: u32,
    /// Predicted states of a tracked target: since it was last measured, ms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured_ms_ago: Option<f64>,
    /// How long it took; only where there is a live session. The last key: each client's count of lost lines comes into it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delivery: Option<Delivery>,
}

/// How old a state is, and where the time went.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Delivery {
    /// From its time to when it was handed over, ms.
    pub age_ms: f64,
    /// Where the time went.
    pub latency_ms: Latency,
    /// Data lines dropped before it because this client was behind: what stands beside `seq`.
    #[serde(default, skip_serializing)]
    pub dropped: u64,
}

/// Where the time from mid-exposure, or the middle of a crossing, to the hand-over went.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Latency {
    /// To the end of the exposure or the crossing, ms.
    pub readout: f64,
    /// Until the host had the last of it, ms.
    pub transport: f64,
    /// Until the core came to it: for other sensors, and for the core, ms.
    pub wait: f64,
    /// In the core, ms.
    pub compute: f64,
    /// All of it, ms.
    pub total: f64,
}

/// What a state is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum StateKind {
    /// Of a measurement epoch.
    Epoch,
    /// Predicted to the time it was sent.
    Predicted,
}

/// A spin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SpinLine {
    /// The axis, of length 1, rig axes, right-handed.
    pub axis: [f64; 3],
    /// The rate, degrees a second, above 0.
    pub rate_dps: f64,
    /// One standard deviation of the axis, degrees.
    pub axis_sigma_deg: f64,
    /// One standard deviation of the rate, degrees a second.
    pub rate_sigma_dps: f64,
}

/// What an epoch gave.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct InputsLine {
    /// The kind of the sensor.
    pub sensor: CloudKind,
    /// The Kinect's points of the target.
    pub kinect_points: u32,
    /// The LiDAR's points of the target.
    pub lidar_points: u32,
    /// The share of the registered points that lie on the model, 0..=1.
    pub inliers: f64,
    /// Root mean square distance of these from it, m.
    pub rmse_m: f64,
}

impl StateLine {
    /// The line of an epoch's state; `unix` is the wall time of its time.
    pub fn of_epoch(origin: StreamOrigin, state: &TargetState, unix: UnixNs) -> Self {
        let (inputs, points) = (&state.inputs, state.inputs.points);
        let (sensor, kinect_points, lidar_points) =
            if inputs.is_kinect { (CloudKind::Kinect, points, 0) } else { (CloudKind::Lidar, 0, points) };
        let motion = state.motion.as_ref();
        Self {
            class: Class::State,
            origin,
            kind: StateKind::Epoch,
            epoch: state.epoch,
            t_ns: state.t.0,
            unix_ns: unix.0.to_string(),
            mode: state.mode,
            validity: state.validity,
            reasons: state.reasons.clone(),
            frame: "rig".to_owned(),
            position_m: motion.map(|motion| motion.t_rig_target.translation.vector.into()),
            rotation_xyzw: motion.map(|motion| motion.t_rig_target.rotation.coords.into()),
            velocity_mps: motion.map(|motion| motion.velocity_mps.into()),
            angular_velocity_rps: motion.map(|motion| motion.angular_velocity_rps.into()),
            spin: motion.and_then(spin),
            covariance: motion.map(covariance),
            nis: state.nis,
            inputs: Some(InputsLine {
                sensor,
                kinect_points,
                lidar_points,
                inliers: inputs.inliers,
                rmse_m: inputs.rmse_m,
            }),
            alternatives: state.alternatives,
            measured_ms_ago: None,
            delivery: None,
        }
    }

    /// The line of a state predicted to `state.t`, of which `unix` is the wall time; `measured`: when the target was last.
    pub fn of_prediction(origin: StreamOrigin, state: &TargetState, measured: Option<RigNs>, unix: UnixNs) -> Self {
        // Whole microseconds, as in deliveries.
        let measured_ms_ago = measured.map(|measured| ((state.t - measured).0 as f64 * 1e-3).round() * 1e-3);
        let line = Self::of_epoch(origin, state, unix);
        Self { kind: StateKind::Predicted, inputs: None, measured_ms_ago, ..line }
    }

    /// With what its delivery took.
    pub fn delivered(self, delivery: Option<Delivery>) -> Self {
        Self { delivery, ..self }
    }
}

impl Delivery {
    /// Of an epoch that the core took up at `begun` and handed over at `now`, both on the session's timeline.
    pub fn new(epoch: &Epoch, begun: RigNs, now: RigNs) -> Self {
        let ms = |from: RigNs, to: RigNs| ((to - from).0 as f64 * 1e-3).round() * 1e-3;
        let latency_ms = Latency {
            readout: ms(epoch.t, epoch.span.1),
            transport: ms(epoch.span.1, epoch.arrived),
            wait: ms(epoch.arrived, begun),
            compute: ms(begun, now),
            total: ms(epoch.t, now),
        };
        Self { age_ms: latency_ms.total, latency_ms, dropped: 0 }
    }
}

fn spin(motion: &TargetMotion) -> Option<SpinLine> {
    motion.spin.map(|spin| SpinLine {
        axis: spin.axis.into(),
        rate_dps: spin.rate_rps.to_degrees(),
        axis_sigma_deg: spin.axis_sigma_rad.to_degrees(),
        rate_sigma_dps: spin.rate_sigma_rps.to_degrees(),
    })
}

fn covariance(motion: &TargetMotion) -> Vec<[f64; 12]> {
    motion.covariance.row_iter().map(|row| core::array::from_fn(|column| row[column])).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, SMatrix, Translation3, UnitQuaternion, Vector3};
    use tumbled_core::estimate::{SpinState, StateInputs};
    use tumbled_model::SensorId;

    use super::*;

    fn state(motion: Option<TargetMotion>) -> TargetState {
        TargetState {
            epoch: 3,
            t: RigNs(100_000_000),
            sensor: SensorId::from("near"),
            mode: if motion.is_some() { Mode::Tracking } else { Mode::NoTarget },
            validity: Validity::Degraded,
            reasons: vec![StateReason::OneSensor],
            motion,
            nis: Some(5.5),
            inputs: StateInputs { is_kinect: true, points: 812, inliers: 0.9, rmse_m: 0.004 },
            alternatives: 0,
        }
    }

    #[test]
    fn a_state_is_told_in_the_rigs_frame_with_rates_in_degrees() {
        let motion = TargetMotion {
            t_rig_target: Isometry3::from_parts(Translation3::new(2.0, 0.0, 0.5), UnitQuaternion::identity()),
            velocity_mps: Vector3::new(0.0, 0.1, 0.0),
            angular_velocity_rps: Vector3::new(0.0, 0.0, 20.0_f64.to_radians()),
            covariance: SMatrix::identity(),
            spin: Some(SpinState {
                axis: Vector3::z(),
                rate_rps: 20.0_f64.to_radians(),
                axis_sigma_rad: 0.1_f64.to_radians(),
                rate_sigma_rps: 0.01_f64.to_radians(),
            }),
            momentum: None,
        };
        let line = StateLine::of_epoch(StreamOrigin::Replay, &state(Some(motion)), UnixNs(9));
        let json: serde_json::Value = serde_json::to_value(&line).expect("JSON");
        assert_eq!(json["class"], "STATE");
        assert_eq!(json["kind"], "epoch");
        assert_eq!((&json["mode"], &json["validity"]), (&"tracking".into(), &"degraded".into()));
        assert_eq!(json["reasons"][0], "one_sensor");
        assert_eq!(json["position_m"][0], 2.0);
        assert_eq!(json["rotation_xyzw"], serde_json::json!([0.0, 0.0, 0.0, 1.0]));
        assert!((json["spin"]["rate_dps"].as_f64().expect("a rate") - 20.0).abs() < 1e-9);
        assert_eq!((&json["inputs"]["kinect_points"], &json["inputs"]["lidar_points"]), (&812.into(), &0.into()));
        assert_eq!(json["covariance"][11][11], 1.0);
    }

    #[test]
    fn what_nobody_knows_is_null() {
        let line = StateLine::of_epoch(StreamOrigin::Live, &state(None), UnixNs(9));
        let json: serde_json::Value = serde_json::to_value(&line).expect("JSON");
        for key in ["position_m", "rotation_xyzw", "velocity_mps", "angular_velocity_rps", "spin", "covariance"] {
            assert!(json[key].is_null(), "{key}");
        }
        assert_eq!(json["mode"], "no_target");
    }
}
