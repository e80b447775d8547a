//! The keys of a scene file.

use super::places::{ScenePose, SceneViews, upright};
use super::target::SceneTarget;
use crate::clock::SimClock;
use crate::faults::Fault;
use crate::kinect::KinectParameters;
use crate::lidar::{Gps, LidarParameters, View};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A scene: what there is to see, how it moves, who looks at it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled scene")]
pub struct SceneConfig {
    /// Its name: stands in recordings.
    pub name: String,
    /// What it is for, one line.
    pub about: String,
    /// Everything random follows from it.
    pub seed: u64,
    /// How long it lasts, s.
    pub duration_s: f64,
    /// Wall time at its start, ns since 1970-01-01 UTC: not this machine's, so that the same seed gives the same bytes.
    pub unix_ns_at_zero: i64,
    /// What is measured.
    pub target: SceneTarget,
    /// How it moves.
    pub motion: SceneMotion,
    /// What goes wrong with the turntable under it; left out: nothing.
    #[serde(default)]
    pub stage: Option<SceneStage>,
    /// What stands around it; left out: nothing.
    #[serde(default)]
    pub room: Option<SceneRoom>,
    /// A person who walks by; left out: nobody.
    #[serde(default)]
    pub intruder: Option<SceneWalk>,
    /// The LiDARs.
    #[serde(default)]
    pub lidar: Vec<SceneLidar>,
    /// The Kinects.
    #[serde(default)]
    pub kinect: Vec<SceneKinect>,
    /// Where the target is looked for: centre, rig frame, m.
    pub roi_center_m: [f64; 3],
    /// Its radius, m.
    pub roi_radius_m: f64,
    /// What an operator's calibration is off by.
    #[serde(default)]
    pub operator: OperatorErrors,
    /// What goes wrong on the way to the host; the scene's seed decides every chance.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fault: Vec<Fault>,
    /// What an experiment makes of the sensors' clouds; left out: nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub experiment: Option<SceneExperiment>,
}

/// What an experiment makes of the sensors' clouds before it counts and registers points. The simulation does not use it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneExperiment {
    /// Points within this distance of the target's place are kept, m.
    pub crop_radius_m: f64,
    /// The edge of the cubes, aligned with the rig's axes, in each of which the Kinect's points become their mean, m.
    pub kinect_voxel_m: f64,
    /// The same for a LiDAR's turn, m.
    pub lidar_voxel_m: f64,
}

/// A rigid transform.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Transform {
    /// Translation x, y, z, m.
    pub translation_m: [f64; 3],
    /// Rotation, a unit quaternion in the order x, y, z, w.
    pub rotation_xyzw: [f64; 4],
}

impl Default for Transform {
    fn default() -> Self {
        Self { translation_m: [0.0; 3], rotation_xyzw: [0.0, 0.0, 0.0, 1.0] }
    }
}

impl Transform {
    /// As a transform; a quaternion of no length is no rotation.
    pub fn isometry(&self) -> Isometry3<f64> {
        let [x, y, z, w] = self.rotation_xyzw;
        let rotation = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 0.0).unwrap_or_default();
        let [x, y, z] = self.translation_m;
        Isometry3::from_parts(Translation3::new(x, y, z), rotation)
    }
}

impl From<&Isometry3<f64>> for Transform {
    fn from(isometry: &Isometry3<f64>) -> Self {
        let (translation, rotation) = (isometry.translation.vector, isometry.rotation);
        Self {
            translation_m: [translation.x, translation.y, translation.z],
            rotation_xyzw: [rotation.i, rotation.j, rotation.k, rotation.w],
        }
    }
}

/// How the target moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum SceneMotion {
    /// It stands on a turntable.
    Turntable {
        /// The axis, rig axes; need not have length 1.
        axis: [f64; 3],
        /// A point on the axis, rig frame, m.
        center_m: [f64; 3],
        /// The target's frame into the stage's.
        #[serde(default)]
        mount: Transform,
        /// How the stage turns.
        profile: SceneProfile,
    },
    /// It tumbles freely, about a point that drifts as neighbouring orbits do.
    Tumble {
        /// Principal moments of inertia about the target's axes, in any unit: only their ratios count.
        inertia: [f64; 3],
        /// Rates about the target's axes at the start, °/s.
        rates_dps: [f64; 3],
        /// The target's pose at the start.
        start: Transform,
        /// The orbit's mean motion, rad/s; 0: it drifts on a straight line.
        #[serde(default)]
        mean_motion_rps: f64,
        /// Its velocity at the start, rig axes, m/s.
        #[serde(default)]
        velocity_mps: [f64; 3],
    },
    /// It rests in poses, one after the other, and moves smoothly between.
    Poses {
        /// The attitude that the poses are turned against: a unit quaternion in the order x, y, z, w; left out: the rig's
        /// axes.
        #[serde(default = "upright")]
        upright_xyzw: [f64; 4],
        /// A rest, s.
        rest_s: f64,
        /// A move, s.
        move_s: f64,
        /// The poses; in the last one it stays.
        poses: Vec<ScenePose>,
    },
    /// It rests in steps about several axes, at several places, and moves smoothly between.
    Views(SceneViews),
    /// It does not move.
    Still {
        /// Its pose.
        pose: Transform,
    },
}

/// How a stage turns.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum SceneProfile {
    /// Always at one rate.
    Constant {
        /// °/s.
        rate_dps: f64,
    },
    /// From one rate to another.
    Ramp {
        /// Before, °/s.
        from_dps: f64,
        /// After, °/s.
        to_dps: f64,
        /// When the change begins, s.
        begins_s: f64,
        /// How long it takes, s.
        lasts_s: f64,
    },
    /// Stops and runs in turn.
    StopAndGo {
        /// Of a run, °/s.
        rate_dps: f64,
        /// A stop, s.
        stop_s: f64,
        /// A run, s.
        go_s: f64,
        /// Its speeding up, and its slowing down, s.
        ramp_s: f64,
    },
    /// Moves of one angle with rests between.
    Steps {
        /// A move, °: the published experiments have 22.5.
        step_deg: f64,
        /// A rest, s.
        rest_s: f64,
        /// A move, s.
        move_s: f64,
        /// Its speeding up, and its slowing down, s.
        ramp_s: f64,
        /// Moves in all.
        count: u32,
    },
    /// At each rate forwards and back again, with rests: what `calibrate time` asks for.
    BothWays {
        /// °/s; 0: none.
        rates_dps: [f64; 3],
        /// Turns of a move.
        turns: f64,
        /// A rest, s.
        rest_s: f64,
        /// A move's speeding up, and its slowing down, s.
        ramp_s: f64,
    },
    /// To and fro.
    Sinusoid {
        /// An even turning besides, °/s.
        mean_dps: f64,
        /// To either side, °.
        amplitude_deg: f64,
        /// s.
        period_s: f64,
    },
}

/// What goes wrong with a turntable and the line to it. The target goes where the table truly goes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SceneStage {
    /// Noise of the encoder, one standard deviation, counts; a turn has 768 000.
    pub noise_counts: f64,
    /// How likely something happens to a reply: it is dropped, late, cut, has a wrong bit or id, or noise before it.
    pub mishap_probability: f64,
    /// The table is held; the stage notices.
    pub stall: Vec<SceneStall>,
    /// The table slips; the stage does not notice.
    pub slip: Vec<SceneSlip>,
}

/// A time in which the table is held. It goes on behind by what it lost.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneStall {
    /// From when, s.
    pub from_s: f64,
    /// Until when, s.
    pub until_s: f64,
}

/// A slip of the table.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneSlip {
    /// When, s.
    pub at_s: f64,
    /// How far it falls behind, °.
    pub angle_deg: f64,
}

/// What stands around the target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneRoom {
    /// The middle of the floor, rig frame, m.
    pub floor_m: [f64; 3],
    /// Length along x, along y, and height, m.
    pub size_m: [f64; 3],
    /// A stage's plate under the target: its radius, m; left out: none.
    #[serde(default)]
    pub stage_radius_m: Option<f64>,
    /// How far below the axis' point the plate is, m.
    #[serde(default)]
    pub stage_below_m: f64,
    /// A round stand that goes where the target goes, from the floor to the target's origin: its radius, m; left out: none.
    #[serde(default)]
    pub stand_radius_m: Option<f64>,
}

/// A person's way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneWalk {
    /// Points of the way, rig frame, m.
    pub points_m: Vec<[f64; 3]>,
    /// m/s.
    pub speed_mps: f64,
    /// When it begins, s.
    pub begins_s: f64,
}

/// A LiDAR.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneLidar {
    /// Its name in the rig.
    pub id: String,
    /// `vlp-32c`, `vlp-16` or `hdl-64e`.
    pub model: String,
    /// `strongest`, `last` or `dual`.
    #[serde(default = "strongest")]
    pub returns: String,
    /// Turns a minute.
    pub rpm: u32,
    /// Where it looks.
    #[serde(default)]
    pub view: View,
    /// Mounting, the truth.
    #[serde(default)]
    pub t_rig_lidar: Transform,
    /// Its clock.
    #[serde(default)]
    pub clock: SimClock,
    /// Its receiver.
    #[serde(default)]
    pub gps: Gps,
    /// How well it measures.
    #[serde(default)]
    pub parameters: LidarParameters,
}

fn strongest() -> String {
    "strongest".to_owned()
}

/// A Kinect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneKinect {
    /// Its name in the rig.
    pub id: String,
    /// Mounting, the truth: the depth camera's frame into the rig's.
    pub t_rig_kinect: Transform,
    /// Its clock.
    #[serde(default)]
    pub clock: SimClock,
    /// From a frame's middle to the instant it leaves the sensor, s.
    #[serde(default = "latency")]
    pub latency_s: f64,
    /// How well it measures.
    #[serde(default)]
    pub parameters: KinectParameters,
}

/// Half an exposure and the way over the bus: 242 packets of 125 µs, the first of which leaves at once.
fn latency() -> f64 {
    0.034
}

/// What an operator's calibration is off by: standard deviations, drawn by the seed. A rotation's and a translation's are of
/// the whole, not of each axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct OperatorErrors {
    /// Of a mounting's rotation, °.
    pub rotation_deg: f64,
    /// Of its translation, m.
    pub translation_m: f64,
    /// Of a time offset, s.
    pub time_s: f64,
    /// Of a Kinect's depth scale, a share of it.
    pub depth_scale: f64,
}

impl Default for OperatorErrors {
    fn default() -> Self {
        Self { rotation_deg: 0.2, translation_m: 0.004, time_s: 0.002, depth_scale: 0.003 }
    }
}
