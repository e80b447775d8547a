//! The bodies of a scene and how they move, from its keys.

use super::config::{SceneConfig, SceneMotion, SceneProfile, Transform};
use super::error::SceneError;
use super::places;
use super::stage;
use crate::motion::orbit::ClohessyWiltshire;
use crate::motion::path::Walk;
use crate::motion::poses::Poses;
use crate::motion::profile::Profile;
use crate::motion::tumble::Tumble;
use crate::motion::turntable::Turntable;
use crate::motion::{Motion, Still, Superposed};
use crate::room::{self, Room};
use crate::shape::Mesh;
use crate::world::{Body, Role};
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use std::sync::Arc;
use tumbled_model::{RigNs, Span};

pub(super) fn bodies(config: &SceneConfig, mesh: Arc<Mesh>) -> Result<Vec<Body>, SceneError> {
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
pub(super) fn stops(config: &SceneMotion) -> Result<Option<Poses>, SceneError> {
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
        SceneProfile::BothWays { rates_dps, turns, rest_s, ramp_s } => Profile::BothWays {
            rates_rps: rates_dps.map(f64::to_radians),
            turn_rad: turns * core::f64::consts::TAU,
            rest: span(rest_s),
            ramp: span(ramp_s),
        },
        SceneProfile::Sinusoid { mean_dps, amplitude_deg, period_s } => Profile::Sinusoid {
            mean_rps: mean_dps.to_radians(),
            amplitude_rad: amplitude_deg.to_radians(),
            period: span(period_s),
        },
    }
}

/// Seconds as a span, to the nanosecond; what is no number is none.
pub(super) fn span(seconds: f64) -> Span {
    Span(libm::round(seconds * 1e9) as i64)
}
