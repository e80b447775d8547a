//! What the numbers and words of a scene may be: what no scene can have is refused before anything is built from it.

use super::config::{
    SceneConfig, SceneExperiment, SceneKinect, SceneMotion, SceneProfile, SceneRoom, SceneWalk, Transform,
};
use super::error::SceneError;
use crate::clock::SimClock;
use crate::turntable;

/// What a number may be, and how a message says it.
#[derive(Clone, Copy)]
struct Limits {
    least: f64,
    most: f64,
    told: &'static str,
}

const PLACE_M: Limits = Limits { least: -1e3, most: 1e3, told: "-1000 to 1000 m" };
const LENGTH_M: Limits = Limits { least: f64::MIN_POSITIVE, most: 1e3, told: "more than 0, at most 1000 m" };
const DEPTH_M: Limits = Limits { least: 0.0, most: 1e3, told: "0 to 1000 m" };
const SPEED_MPS: Limits = Limits { least: -100.0, most: 100.0, told: "-100 to 100 m/s" };
const WALK_MPS: Limits = Limits { least: 0.0, most: 100.0, told: "0 to 100 m/s" };
const RATE_DPS: Limits = Limits { least: -36e3, most: 36e3, told: "-36000 to 36000 degrees a second" };
const ANGLE_DEG: Limits = Limits { least: -36e3, most: 36e3, told: "-36000 to 36000 degrees" };
const TIME_S: Limits = Limits { least: 0.0, most: 1e6, told: "0 to 1e6 s" };
const LASTING_S: Limits = Limits { least: 1e-9, most: 1e6, told: "more than 0 s, at most 1e6 s" };
const MEAN_MOTION_RPS: Limits = Limits { least: 0.0, most: 1.0, told: "0 to 1 rad/s" };
/// A quartz stays within ±100.
const SKEW_PPM: Limits = Limits { least: -1e4, most: 1e4, told: "-10000 to 10000 ppm" };
/// Thirty years: sums with the session's times stay far from the type's end.
const COUNTER_NS: Limits = Limits { least: -1e18, most: 1e18, told: "-1e18 to 1e18 ns" };
const UNIX_NS: Limits = Limits { least: 0.0, most: 4e18, told: "0 to 4e18 ns, the years 1970 to 2096" };
const LATENCY_S: Limits = Limits { least: 0.0, most: 10.0, told: "0 to 10 s" };
/// As far from 1 as a config's quaternions may be.
const UNIT: Limits = Limits { least: 1.0 - 1e-6, most: 1.0 + 1e-6, told: "1, the parts in the order x, y, z, w" };

/// Looks at everything that is not looked at where it is used.
pub(super) fn check(config: &SceneConfig) -> Result<(), SceneError> {
    words(config)?;
    number("duration_s", config.duration_s, LASTING_S)?;
    number("unix_ns_at_zero", config.unix_ns_at_zero as f64, UNIX_NS)?;
    each("roi_center_m", &config.roi_center_m, PLACE_M)?;
    number("roi_radius_m", config.roi_radius_m, LENGTH_M)?;
    motion(&config.motion)?;
    config.room.as_ref().map_or(Ok(()), room)?;
    config.intruder.as_ref().map_or(Ok(()), intruder)?;
    for lidar in &config.lidar {
        transform(
            ["lidar.t_rig_lidar.translation_m", "length of lidar.t_rig_lidar.rotation_xyzw"],
            &lidar.t_rig_lidar,
        )?;
        clock(&lidar.clock)?;
    }
    config.kinect.iter().try_for_each(kinect)?;
    let errors = &config.operator;
    number("operator.rotation_deg", errors.rotation_deg, Limits { least: 0.0, most: 180.0, told: "0 to 180" })?;
    number("operator.translation_m", errors.translation_m, Limits { least: 0.0, most: 10.0, told: "0 to 10 m" })?;
    number("operator.time_s", errors.time_s, Limits { least: 0.0, most: 60.0, told: "0 to 60 s" })?;
    number("operator.depth_scale", errors.depth_scale, Limits { least: 0.0, most: 0.1, told: "0 to 0.1" })?;
    config.experiment.as_ref().map_or(Ok(()), experiment)
}

fn number(key: &'static str, found: f64, limits: Limits) -> Result<(), SceneError> {
    // False for what is no number.
    match (limits.least..=limits.most).contains(&found) {
        true => Ok(()),
        false => Err(SceneError::Number { key, found, expected: limits.told }),
    }
}

fn each(key: &'static str, found: &[f64], limits: Limits) -> Result<(), SceneError> {
    found.iter().try_for_each(|found| number(key, *found, limits))
}

/// What goes into file names, configs and recordings as it stands.
fn words(config: &SceneConfig) -> Result<(), SceneError> {
    let line = |key: &str, found: &str, most: usize, expected| {
        let fits = !found.is_empty() && found.chars().count() <= most && !found.chars().any(char::is_control);
        let refused = || SceneError::Word { key: key.to_owned(), found: found.chars().take(most).collect(), expected };
        if fits { Ok(()) } else { Err(refused()) }
    };
    line("name", &config.name, 100, "a line of 1 to 100 characters")?;
    line("about", &config.about, 1_000, "a line of 1 to 1000 characters")?;
    let mut seen = vec![turntable::SENSOR];
    let lidars = config.lidar.iter().map(|lidar| ("lidar.id", &lidar.id));
    for (key, id) in lidars.chain(config.kinect.iter().map(|kinect| ("kinect.id", &kinect.id))) {
        if seen.contains(&id.as_str()) {
            let expected = "an id that no other sensor has; `turntable` is the stage's";
            return Err(SceneError::Word { key: key.to_owned(), found: id.clone(), expected });
        }
        seen.push(id);
    }
    Ok(())
}

/// `keys`: what messages call its translation, and the length of its quaternion.
fn transform([translation, length]: [&'static str; 2], transform: &Transform) -> Result<(), SceneError> {
    each(translation, &transform.translation_m, PLACE_M)?;
    rotation(length, &transform.rotation_xyzw)
}

fn rotation(key: &'static str, xyzw: &[f64; 4]) -> Result<(), SceneError> {
    number(key, libm::sqrt(xyzw.iter().map(|part| part * part).sum()), UNIT)
}

fn motion(config: &SceneMotion) -> Result<(), SceneError> {
    match config {
        SceneMotion::Turntable { axis, center_m, mount, profile: turning } => {
            each("motion.axis", axis, Limits { least: -1e3, most: 1e3, told: "-1000 to 1000" })?;
            each("motion.center_m", center_m, PLACE_M)?;
            transform(["motion.mount.translation_m", "length of motion.mount.rotation_xyzw"], mount)?;
            profile(turning)
        }
        SceneMotion::Tumble { inertia: _, rates_dps, start, mean_motion_rps, velocity_mps } => {
            each("motion.rates_dps", rates_dps, RATE_DPS)?;
            transform(["motion.start.translation_m", "length of motion.start.rotation_xyzw"], start)?;
            number("motion.mean_motion_rps", *mean_motion_rps, MEAN_MOTION_RPS)?;
            each("motion.velocity_mps", velocity_mps, SPEED_MPS)
        }
        SceneMotion::Still { pose } => {
            transform(["motion.pose.translation_m", "length of motion.pose.rotation_xyzw"], pose)
        }
        SceneMotion::Poses { upright_xyzw, .. } => rotation("length of motion.upright_xyzw", upright_xyzw),
        SceneMotion::Views(views) => rotation("length of motion.upright_xyzw", &views.upright_xyzw),
    }
}

fn profile(profile: &SceneProfile) -> Result<(), SceneError> {
    match *profile {
        SceneProfile::Constant { rate_dps } => number("motion.profile.rate_dps", rate_dps, RATE_DPS),
        SceneProfile::Ramp { from_dps, to_dps, begins_s, lasts_s } => {
            number("motion.profile.from_dps", from_dps, RATE_DPS)?;
            number("motion.profile.to_dps", to_dps, RATE_DPS)?;
            number("motion.profile.begins_s", begins_s, TIME_S)?;
            number("motion.profile.lasts_s", lasts_s, TIME_S)
        }
        SceneProfile::StopAndGo { rate_dps, stop_s, go_s, ramp_s } => {
            number("motion.profile.rate_dps", rate_dps, RATE_DPS)?;
            number("motion.profile.stop_s", stop_s, TIME_S)?;
            number("motion.profile.go_s", go_s, LASTING_S)?;
            number("motion.profile.ramp_s", ramp_s, TIME_S)
        }
        SceneProfile::Steps { step_deg, rest_s, move_s, ramp_s, count: _ } => {
            number("motion.profile.step_deg", step_deg, ANGLE_DEG)?;
            number("motion.profile.rest_s", rest_s, TIME_S)?;
            number("motion.profile.move_s", move_s, LASTING_S)?;
            number("motion.profile.ramp_s", ramp_s, TIME_S)
        }
        SceneProfile::BothWays { rates_dps, turns, rest_s, ramp_s } => {
            each("motion.profile.rates_dps", &rates_dps, RATE_DPS)?;
            number("motion.profile.turns", 360.0 * turns, ANGLE_DEG)?;
            number("motion.profile.rest_s", rest_s, TIME_S)?;
            number("motion.profile.ramp_s", ramp_s, TIME_S)
        }
        SceneProfile::Sinusoid { mean_dps, amplitude_deg, period_s } => {
            number("motion.profile.mean_dps", mean_dps, RATE_DPS)?;
            number("motion.profile.amplitude_deg", amplitude_deg, ANGLE_DEG)?;
            number("motion.profile.period_s", period_s, LASTING_S)
        }
    }
}

fn room(room: &SceneRoom) -> Result<(), SceneError> {
    let SceneRoom { floor_m, size_m, stage_radius_m, stage_below_m, stand_radius_m } = room;
    each("room.floor_m", floor_m, PLACE_M)?;
    each("room.size_m", size_m, LENGTH_M)?;
    each("room.stage_radius_m", stage_radius_m.as_slice(), LENGTH_M)?;
    number("room.stage_below_m", *stage_below_m, DEPTH_M)?;
    each("room.stand_radius_m", stand_radius_m.as_slice(), LENGTH_M)
}

fn intruder(walk: &SceneWalk) -> Result<(), SceneError> {
    let points = Limits { least: 1.0, most: 1e4, told: "1 to 10000" };
    number("number of intruder.points_m", walk.points_m.len() as f64, points)?;
    walk.points_m.iter().try_for_each(|point| each("intruder.points_m", point, PLACE_M))?;
    number("intruder.speed_mps", walk.speed_mps, WALK_MPS)?;
    number("intruder.begins_s", walk.begins_s, TIME_S)
}

fn kinect(kinect: &SceneKinect) -> Result<(), SceneError> {
    let keys = ["kinect.t_rig_kinect.translation_m", "length of kinect.t_rig_kinect.rotation_xyzw"];
    transform(keys, &kinect.t_rig_kinect)?;
    number("kinect.latency_s", kinect.latency_s, LATENCY_S)?;
    clock(&kinect.clock)
}

fn clock(clock: &SimClock) -> Result<(), SceneError> {
    number("clock.offset_ns", clock.offset_ns as f64, COUNTER_NS)?;
    number("clock.skew_ppm", clock.skew_ppm, SKEW_PPM)?;
    if let Some(warm_up) = &clock.warm_up {
        number("clock.warm_up.ppm", warm_up.ppm, SKEW_PPM)?;
        number("clock.warm_up.tau_s", warm_up.tau_s, LASTING_S)?;
    }
    let mut after = -f64::INFINITY;
    for reset in &clock.resets {
        let ascending =
            Limits { least: after, most: 1e18, told: "no earlier than the reset before it, at most 1e18 ns" };
        number("clock.resets.at_ns", reset.at_ns as f64, ascending)?;
        number("clock.resets.to_ns", reset.to_ns as f64, COUNTER_NS)?;
        after = reset.at_ns as f64;
    }
    Ok(())
}

fn experiment(experiment: &SceneExperiment) -> Result<(), SceneError> {
    number("experiment.crop_radius_m", experiment.crop_radius_m, LENGTH_M)?;
    number("experiment.kinect_voxel_m", experiment.kinect_voxel_m, LENGTH_M)?;
    number("experiment.lidar_voxel_m", experiment.lidar_voxel_m, LENGTH_M)
}
