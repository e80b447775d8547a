//! From a scene's keys to bodies, sensors and lines.

use super::config::{SceneConfig, SceneKinect, SceneLidar, SceneMotion, SceneProfile, Transform};
use super::places;
use super::stage;
use crate::clock::SimClock;
use crate::faults::{FaultError, FaultScript};
use crate::kinect::{KinectModel, ModelError};
use crate::lidar::{Head, LidarConfig, LidarError, LidarModel, made_calibration_of};
use crate::motion::orbit::ClohessyWiltshire;
use crate::motion::path::Walk;
use crate::motion::poses::{Poses, Stop};
use crate::motion::profile::Profile;
use crate::motion::tumble::{Tumble, TumbleError};
use crate::motion::turntable::Turntable;
use crate::motion::{Motion, Still, Superposed};
use crate::noise::Noise;
use crate::room::{self, Room};
use crate::shape::Mesh;
use crate::transport::Transport;
use crate::world::{Body, Role, World};
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use std::sync::Arc;
use thiserror::Error;
use tumbled_kinect::Intrinsics;
use tumbled_model::{RigNs, SensorId, Span, UnixNs};
use tumbled_velodyne::hdl64::Generation;
use tumbled_velodyne::hdl64::calibration::{Calibration, CalibrationError};
use tumbled_velodyne::{Model, ReturnMode};

/// Why a scene cannot be built.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A word that names nothing.
    #[error("{key} is {found:?}: expected one of {expected}")]
    Word {
        /// The key.
        key: String,
        /// What it says.
        found: String,
        /// What it may say.
        expected: &'static str,
    },
    /// A number out of range.
    #[error("{key} is {found}: expected {expected}")]
    Number {
        /// The key.
        key: &'static str,
        /// What it says.
        found: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// Neither `shape` nor `mesh`, or both.
    #[error("target: `shape` or `mesh` expected, one of the two")]
    OneSurface,
    /// A file's mesh that nobody has read.
    #[error("target.mesh is {0:?}: the file has not been read")]
    NoMesh(String),
    /// Two sizes, or a unit where there is no file.
    #[error("target.scale is for a `mesh` without `size_m`: leave one of them out")]
    OneScale,
    /// A target of a size that none has.
    #[error(
        "the target is {size_m} m long and reaches {far_m} m from its origin, expected 0.01 to 20 m and at most 40 m: \
        give it scale = 0.001 if its file is in millimetres, or size_m; center = true if its origin lies far away"
    )]
    Size {
        /// Its longest side.
        size_m: f64,
        /// Its farthest corner.
        far_m: f64,
    },
    /// A fault with a number that means nothing.
    #[error(transparent)]
    Fault(#[from] FaultError),
    /// A tumble that cannot be.
    #[error("motion: {0}")]
    Tumble(#[from] TumbleError),
    /// Faults of a stage where there is none.
    #[error("[stage] is there and motion.kind is not \"turntable\": put the target on one, or leave [stage] out")]
    NoTurntable,
    /// A made calibration that is none.
    #[error("lidar {id}: {error}")]
    Calibration {
        /// Whose.
        id: String,
        /// Why.
        error: CalibrationError,
    },
    /// A LiDAR that cannot be.
    #[error("lidar {id}: {error}")]
    Lidar {
        /// Which.
        id: String,
        /// Why.
        error: LidarError,
    },
    /// A Kinect that cannot be.
    #[error("kinect {id}: {error}")]
    Kinect {
        /// Which.
        id: String,
        /// Why.
        error: ModelError,
    },
}

/// A Kinect of a scene.
#[derive(Clone, Debug)]
pub struct KinectUnit {
    /// Its name.
    pub id: SensorId,
    /// The device.
    pub model: KinectModel,
    /// Its clock.
    pub clock: SimClock,
    /// From a frame's middle to the instant it leaves.
    pub latency: Span,
    /// Its way to the host.
    pub line: Transport,
}

impl KinectUnit {
    /// What a frame's mapped stamp is later than its middle: its own latency, and the least delay of its line.
    pub fn late(&self) -> Span {
        self.latency + self.line.least()
    }
}

/// A LiDAR of a scene.
#[derive(Clone, Debug)]
pub struct LidarUnit {
    /// Its name.
    pub id: SensorId,
    /// The device.
    pub model: LidarModel,
    /// An HDL-64E's factory calibration, as Velodyne's `db.xml`; the others have none.
    pub db_xml: Option<Arc<str>>,
    /// Its way to the host.
    pub line: Transport,
}

impl LidarUnit {
    /// What a packet's mapped stamp is later than its first firing: the packet is sent when it is full, and its line has a
    /// least delay.
    pub fn late(&self) -> Span {
        self.model.packet_span() + self.line.least()
    }
}

/// A scene, ready to be simulated.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The keys it was built from.
    pub config: SceneConfig,
    /// The target's surface in its own frame.
    pub surface: Arc<Mesh>,
    /// What there is to see.
    pub world: World,
    /// The LiDARs.
    pub lidars: Vec<LidarUnit>,
    /// The Kinects.
    pub kinects: Vec<KinectUnit>,
}

impl Scene {
    /// Builds a scene whose target is one of the simulator's own.
    ///
    /// # Errors
    /// [`SceneError`]: keys that describe no scene, or one whose target is in a file.
    pub fn build(config: SceneConfig) -> Result<Self, SceneError> {
        Self::build_with(config, None)
    }

    /// Builds a scene; `brought`: the surface in the file that the scene names, in that file's unit.
    ///
    /// # Errors
    /// [`SceneError`]: keys that describe no scene.
    pub fn build_with(config: SceneConfig, brought: Option<Mesh>) -> Result<Self, SceneError> {
        let in_range = config.duration_s.is_finite() && config.duration_s > 0.0 && config.duration_s <= 1e6;
        if !in_range {
            let expected = "more than 0 s, at most 1e6 s";
            return Err(SceneError::Number { key: "duration_s", found: config.duration_s, expected });
        }
        let lidars = config.lidar.iter().map(|lidar| lidar_unit(lidar, &config)).collect::<Result<_, _>>()?;
        let kinects = config.kinect.iter().map(kinect_unit).collect::<Result<_, _>>()?;
        check_faults(&config)?;
        check_experiment(&config)?;
        let surface = Arc::new(config.target.surface(brought)?);
        let world = World::new(bodies(&config, Arc::clone(&surface))?);
        Ok(Self { config, surface, world, lidars, kinects })
    }

    /// The scene's own faults.
    pub fn faults(&self) -> FaultScript {
        script(&self.config)
    }

    /// The rests of a motion that has some: where the target is, from when until when.
    pub fn rests(&self) -> Vec<Stop> {
        stops(&self.config.motion).ok().flatten().map(|poses| poses.stops().to_vec()).unwrap_or_default()
    }

    /// How long it lasts.
    pub fn duration(&self) -> Span {
        span(self.config.duration_s)
    }

    /// Wall time at its start.
    pub fn unix_at_zero(&self) -> UnixNs {
        UnixNs(self.config.unix_ns_at_zero)
    }

    /// The turntable under the target, if there is one.
    pub fn stage(&self) -> Option<Turntable> {
        match &self.config.motion {
            SceneMotion::Turntable { axis, center_m, mount, profile } => turntable(axis, center_m, mount, profile).ok(),
            SceneMotion::Tumble { .. }
            | SceneMotion::Still { .. }
            | SceneMotion::Poses { .. }
            | SceneMotion::Views(_) => None,
        }
    }

    /// A mounting as an operator would have it: the truth, turned and moved by what a calibration leaves.
    pub fn operators_mounting(&self, sensor: &str, truth: &Transform) -> Transform {
        let errors = self.config.operator;
        let mut noise = Noise::new(self.config.seed, &format!("operator.{sensor}"), 0);
        let mut vector = |sigma: f64| Vector3::from_fn(|_, _| noise.normal() * sigma);
        // The standard deviations are of the whole: a third of the variance for each axis.
        let share = 1.0 / 3f64.sqrt();
        let turned = UnitQuaternion::from_scaled_axis(vector(errors.rotation_deg.to_radians() * share));
        let moved = Translation3::from(vector(errors.translation_m * share));
        let truth = truth.isometry();
        let off =
            Isometry3::from_parts(Translation3::from(moved.vector + truth.translation.vector), turned * truth.rotation);
        Transform::from(&off)
    }

    /// A Kinect's depth scale (true depth over measured depth) as an operator would have it: the truth and what a
    /// calibration leaves.
    pub fn operators_depth_scale(&self, sensor: &str, truth: f64) -> f64 {
        let mut noise = Noise::new(self.config.seed, &format!("operator.{sensor}.depth_scale"), 0);
        truth * (1.0 + noise.normal() * self.config.operator.depth_scale)
    }

    /// A time offset as an operator would have it, s: the truth and what a calibration leaves.
    pub fn operators_time_s(&self, sensor: &str, truth_s: f64) -> f64 {
        truth_s
            + Noise::new(self.config.seed, &format!("operator.{sensor}.time"), 0).normal() * self.config.operator.time_s
    }
}

fn script(config: &SceneConfig) -> FaultScript {
    FaultScript { seed: config.seed, fault: config.fault.clone() }
}

fn check_faults(config: &SceneConfig) -> Result<(), SceneError> {
    script(config).check()?;
    let sensors = || config.lidar.iter().map(|lidar| &lidar.id).chain(config.kinect.iter().map(|kinect| &kinect.id));
    // The stage is on the line of a motion that has one, whatever its bytes are called there.
    let known = |name: &String| name == STAGE || sensors().any(|id| id == name);
    let named = config.fault.iter().zip(1..).filter_map(|(fault, number)| Some((fault.sensor.as_ref()?, number)));
    for (name, number) in named {
        if !known(name) {
            let key = format!("fault {number}: sensor");
            return Err(SceneError::Word { key, found: name.clone(), expected: "the id of a sensor of the scene" });
        }
    }
    Ok(())
}

/// What a stage is called among the sensors.
const STAGE: &str = "turntable";

fn check_experiment(config: &SceneConfig) -> Result<(), SceneError> {
    let Some(experiment) = &config.experiment else { return Ok(()) };
    for (key, found) in [
        ("experiment.crop_radius_m", experiment.crop_radius_m),
        ("experiment.kinect_voxel_m", experiment.kinect_voxel_m),
        ("experiment.lidar_voxel_m", experiment.lidar_voxel_m),
    ] {
        if !(found.is_finite() && found > 0.0) {
            return Err(SceneError::Number { key, found, expected: "a finite number above 0" });
        }
    }
    Ok(())
}

fn bodies(config: &SceneConfig, mesh: Arc<Mesh>) -> Result<Vec<Body>, SceneError> {
    let target = match stage::faulty_motion(config)? {
        Some(motion) => motion,
        None => motion(&config.motion)?,
    };
    let mut bodies = vec![Body { role: Role::Target, mesh, motion: Arc::clone(&target) }];
    if let Some(room) = config.room {
        bodies.push(Room { floor: Point3::from(room.floor_m), size_m: Vector3::from(room.size_m) }.body());
        if let (Some(radius), SceneMotion::Turntable { center_m, .. }) = (room.stage_radius_m, &config.motion) {
            let top = Point3::from(*center_m) - Vector3::z() * room.stage_below_m;
            bodies.push(room::stage(top, radius, room.floor_m[2]));
        }
        if let Some(radius) = room.stand_radius_m {
            bodies.push(room::stand(target, radius, room.size_m[2]));
        }
    }
    if let Some(walk) = &config.intruder {
        let points: Vec<Point3<f64>> = walk.points_m.iter().map(|point| Point3::from(*point)).collect();
        let begins = RigNs(span(walk.begins_s).0);
        bodies.push(room::person(Arc::new(Walk::new(&points, walk.speed_mps, begins))));
    }
    Ok(bodies)
}

pub(super) fn turntable(
    axis: &[f64; 3],
    center_m: &[f64; 3],
    mount: &Transform,
    profile: &SceneProfile,
) -> Result<Turntable, SceneError> {
    let vector = Vector3::from(*axis);
    let expected = "an axis of a length above 0";
    let none = SceneError::Number { key: "motion.axis", found: vector.norm(), expected };
    let axis = Unit::try_new(vector, 0.0).ok_or(none)?;
    let (centre, mount, profile) = (Point3::from(*center_m), mount.isometry(), profile_of(profile));
    Ok(Turntable { axis, centre, mount, start_rad: 0.0, profile })
}

fn motion(config: &SceneMotion) -> Result<Arc<dyn Motion>, SceneError> {
    Ok(match config {
        SceneMotion::Turntable { axis, center_m, mount, profile } => {
            Arc::new(turntable(axis, center_m, mount, profile)?)
        }
        SceneMotion::Still { pose } => Arc::new(Still(pose.isometry())),
        SceneMotion::Poses { .. } | SceneMotion::Views(_) => Arc::new(stops(config)?.unwrap_or_default()),
        SceneMotion::Tumble { inertia, rates_dps, start, mean_motion_rps, velocity_mps } => {
            let start = start.isometry();
            let rates = Vector3::from(*rates_dps).map(f64::to_radians);
            let turning = Isometry3::from_parts(Translation3::identity(), start.rotation);
            let attitude = Tumble::new(Vector3::from(*inertia), rates, turning, Point3::origin())?;
            let path = ClohessyWiltshire {
                t_rig_hill: Isometry3::from_parts(start.translation, UnitQuaternion::identity()),
                mean_motion_rps: *mean_motion_rps,
                position_m: Vector3::zeros(),
                velocity_mps: Vector3::from(*velocity_mps),
            };
            Arc::new(Superposed { path: Arc::new(path), attitude: Arc::new(attitude) })
        }
    })
}

/// The poses of a motion that rests; `None`: it does not.
fn stops(config: &SceneMotion) -> Result<Option<Poses>, SceneError> {
    let upright = |rotation_xyzw| Transform { rotation_xyzw, ..Transform::default() }.isometry().rotation;
    match config {
        SceneMotion::Poses { upright_xyzw, rest_s, move_s, poses } => {
            places::poses(upright(*upright_xyzw), poses, *rest_s, *move_s).map(Some)
        }
        SceneMotion::Views(views) => places::views(views, upright(views.upright_xyzw)).map(Some),
        SceneMotion::Turntable { .. } | SceneMotion::Tumble { .. } | SceneMotion::Still { .. } => Ok(None),
    }
}

fn profile_of(profile: &SceneProfile) -> Profile {
    match *profile {
        SceneProfile::Constant { rate_dps } => Profile::Constant { rate_rps: rate_dps.to_radians() },
        SceneProfile::Ramp { from_dps, to_dps, begins_s, lasts_s } => Profile::Ramp {
            from_rps: from_dps.to_radians(),
            to_rps: to_dps.to_radians(),
            begins: RigNs(span(begins_s).0),
            lasts: span(lasts_s),
        },
        SceneProfile::StopAndGo { rate_dps, stop_s, go_s, ramp_s } => Profile::StopAndGo {
            rate_rps: rate_dps.to_radians(),
            stop: span(stop_s),
            go: span(go_s),
            ramp: span(ramp_s),
        },
        SceneProfile::Steps { step_deg, rest_s, move_s, ramp_s, count } => Profile::Steps {
            step_rad: step_deg.to_radians(),
            rest: span(rest_s),
            moving: span(move_s),
            ramp: span(ramp_s),
            count,
        },
        SceneProfile::Sinusoid { mean_dps, amplitude_deg, period_s } => Profile::Sinusoid {
            mean_rps: mean_dps.to_radians(),
            amplitude_rad: amplitude_deg.to_radians(),
            period: span(period_s),
        },
    }
}

fn lidar_unit(lidar: &SceneLidar, scene: &SceneConfig) -> Result<LidarUnit, SceneError> {
    let failed = |error| SceneError::Lidar { id: lidar.id.clone(), error };
    let word = |key: &str, found: &str, expected| SceneError::Word {
        key: format!("lidar.{}.{key}", lidar.id),
        found: found.to_owned(),
        expected,
    };
    let mode = match lidar.returns.as_str() {
        "strongest" => ReturnMode::Strongest,
        "last" => ReturnMode::Last,
        "dual" => ReturnMode::Dual,
        other => return Err(word("returns", other, "strongest, last, dual")),
    };
    let mut db_xml = None;
    let head = match lidar.model.as_str() {
        "vlp-32c" => Head::BuiltIn(Model::Vlp32c),
        "vlp-16" => Head::BuiltIn(Model::Vlp16),
        "hdl-64e" => {
            let calibration_of = |error| SceneError::Calibration { id: lidar.id.clone(), error };
            let made = made_calibration_of(&lidar.id, scene.seed).map_err(calibration_of)?;
            let text = made.to_db_xml();
            // What the file says is what the head has, to the last bit.
            let calibration = Box::new(Calibration::parse(&text).map_err(calibration_of)?);
            db_xml = Some(Arc::from(text));
            // An S2 has no dual return.
            let generation = if mode == ReturnMode::Dual { Generation::S3 } else { Generation::S2 };
            Head::Hdl64e { generation, calibration }
        }
        other => return Err(word("model", other, "vlp-32c, vlp-16, hdl-64e")),
    };
    let config = LidarConfig {
        id: lidar.id.clone(),
        head,
        mode,
        rpm: lidar.rpm,
        start_azimuth_deg: 0.0,
        view: lidar.view,
        vertical_offsets: None,
        t_rig_lidar: lidar.t_rig_lidar.isometry(),
        clock: lidar.clock.clone(),
        gps: lidar.gps,
        // A hundred a second would be as real and tell nothing more.
        position_every: Span(100_000_000),
        unix_at_zero: UnixNs(scene.unix_ns_at_zero),
        parameters: lidar.parameters,
    };
    let model = LidarModel::new(config).map_err(failed)?;
    Ok(LidarUnit { id: SensorId::from(lidar.id.as_str()), model, db_xml, line: Transport::UDP })
}

fn kinect_unit(kinect: &SceneKinect) -> Result<KinectUnit, SceneError> {
    let mounting = kinect.t_rig_kinect.isometry();
    let model = KinectModel::new(&kinect.id, &Intrinsics::default(), mounting, kinect.parameters)
        .map_err(|error| SceneError::Kinect { id: kinect.id.clone(), error })?;
    let id = SensorId::from(kinect.id.as_str());
    let (clock, latency) = (kinect.clock.clone(), span(kinect.latency_s));
    Ok(KinectUnit { id, model, clock, latency, line: Transport::KINECT })
}

/// Seconds as a span, to the nanosecond; what is no number is none.
pub(super) fn span(seconds: f64) -> Span {
    Span(libm::round(seconds * 1e9) as i64)
}
