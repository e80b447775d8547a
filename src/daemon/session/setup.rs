//! From the config to what the core has to know of the rig.

use std::sync::Arc;

use nalgebra::Vector3;
use tumbled_core::estimate::{EstimateSettings, NamedPoint, TargetMotionKind, TargetSearch, Trust};
use tumbled_core::ukf::FilterMethod;
use tumbled_core::{ClockMode, CoreConfig, KinectSetup, LidarSetup, RegionOfInterest, Timing, TurntableSetup};
use tumbled_model::{SensorId, Span};

use crate::cli::Failure;
use crate::config::calibration::RawCalibration;
use crate::config::{
    self, BackgroundName, ClockMethod, Config, FilterMethodName, MotionName, PointOfInterest, TurntableConfig,
    TurntableProtocol,
};
use crate::decoding::{kinect, lidar};

/// The turntable's name among the sensors.
pub const TURNTABLE: &str = "turntable";

/// The core's view of a rig.
///
/// # Errors
/// A calibration or a depth table that cannot be used: exit code 2.
pub fn core_config(config: &Config) -> Result<CoreConfig, Failure> {
    let lidars = config.lidars.iter().map(|sensor| {
        let mut decoder = lidar::settings(sensor)?;
        let (min, max) = (sensor.range_min_m.unwrap_or(0.0), sensor.range_max_m.unwrap_or(f64::INFINITY));
        let limited = sensor.range_min_m.is_some() || sensor.range_max_m.is_some();
        decoder.range_limits_m = limited.then_some((min as f32, max as f32));
        let (id, t_rig_lidar, time_offset) = (sensor.id.clone(), sensor.t_rig_lidar, sensor.time_offset);
        Ok(LidarSetup { id, decoder, t_rig_lidar, time_offset })
    });
    let kinects = config.kinects.iter().map(|sensor| {
        let (table, projector) = (kinect::depth_table(sensor)?, kinect::projector(sensor)?);
        let (id, t_rig_kinect, time_offset) = (sensor.id.clone(), sensor.t_rig_kinect, sensor.time_offset);
        Ok(KinectSetup { id, table, projector, t_rig_kinect, time_offset })
    });
    Ok(CoreConfig {
        lidars: lidars.collect::<Result<_, Failure>>()?,
        kinects: kinects.collect::<Result<_, Failure>>()?,
        turntables: config.turntable.iter().map(turntable).collect(),
        turntable_axis: turntable_axis(config)?,
        roi: RegionOfInterest { center: config.target.roi_center, radius_m: config.target.roi_radius_m },
        timing: Timing {
            clock: match config.time.clock {
                ClockMethod::Hull => ClockMode::Hull,
                ClockMethod::Kalman => ClockMode::Kalman,
                ClockMethod::Arrival => ClockMode::Arrival,
            },
            hold: config.time.hold,
            silent_after: config.time.silent_after,
        },
        estimate: estimate(config),
        ignore_skips: false,
    })
}

/// How well sensors are known is what the config says; of the others what an operator reaches is believed.
fn estimate(config: &Config) -> EstimateSettings {
    let lidars = config.lidars.iter().filter_map(|sensor| {
        let sigma = sensor.sigma?;
        Some((sensor.id.clone(), trust(sigma.rotation_deg, sigma.translation_m, sigma.time_offset_ms, 0.0)))
    });
    let kinects = config.kinects.iter().filter_map(|sensor| {
        let sigma = sensor.sigma?;
        let trust = trust(sigma.rotation_deg, sigma.translation_m, sigma.time_offset_ms, sigma.depth_scale);
        Some((sensor.id.clone(), trust))
    });
    EstimateSettings {
        search: match config.target.search {
            config::TargetSearch::Region => TargetSearch::Region,
            config::TargetSearch::Nearest => TargetSearch::Nearest,
            config::TargetSearch::Everything => TargetSearch::Everything,
        },
        background: match config.target.background {
            BackgroundName::None => None,
            BackgroundName::Start => Some(Span((config.target.background_s * 1e9).round() as i64)),
        },
        method: match config.filter.method {
            FilterMethodName::Ours => FilterMethod::Cubature,
            FilterMethodName::Paper => FilterMethod::Paper,
        },
        motion: match config.filter.motion {
            MotionName::Auto => TargetMotionKind::Auto,
            MotionName::FixedAxis => TargetMotionKind::FixedAxis,
            MotionName::Tumble => TargetMotionKind::Tumble,
        },
        mean_motion_rps: config.filter.mean_motion_rps,
        orbit_center_m: config.filter.orbit_center_m,
        known: config.target.saved.as_ref().map(|saved| Arc::new(saved.target.surfels.clone())),
        points: config.points_of_interest.iter().map(point).collect(),
        trust: lidars.chain(kinects).collect(),
    }
}

fn point(point: &PointOfInterest) -> NamedPoint {
    NamedPoint { name: point.name.clone(), position_m: point.position.coords.coords }
}

fn trust(rotation_deg: f64, translation_m: f64, time_ms: f64, depth_scale: f64) -> Trust {
    Trust { rotation_rad: rotation_deg.to_radians(), translation_m, time_s: time_ms * 1e-3, depth_scale }
}

/// The turntable's axis by the calibration file, in the sense in which the encoder grows.
fn turntable_axis(config: &Config) -> Result<Option<Vector3<f64>>, Failure> {
    let Some(file) = &config.calibration else { return Ok(None) };
    let problem = |error: String| Failure::input(format!("the calibration file {}: {error}", file.place));
    let text = file.text().map_err(|error| problem(error.to_string()))?;
    let calibration: RawCalibration = toml::from_str(text).map_err(|error| problem(error.to_string()))?;
    Ok(calibration.turntable.map(|turntable| Vector3::from(turntable.axis) * turntable.sign))
}

fn turntable(turntable: &TurntableConfig) -> TurntableSetup {
    TurntableSetup {
        id: SensorId::from(TURNTABLE),
        protocol: match turntable.protocol {
            TurntableProtocol::Zaber => tumbled_core::TurntableProtocol::Zaber,
            TurntableProtocol::Line => tumbled_core::TurntableProtocol::Line,
        },
        baud: turntable.baud,
        counts_per_turn: turntable.counts_per_turn,
    }
}
