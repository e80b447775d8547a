//! Where a body is at any instant, exactly.
//!
//! * [`Still`], [`path::Drifting`], [`path::Walk`]: rooms, floating things, people;
//! * [`poses::Poses`]: from pose to pose with rests;
//! * [`turntable::Turntable`]: a stage with a [`profile::Profile`];
//! * [`tumble::Tumble`]: free of torque; [`orbit::ClohessyWiltshire`]: neighbouring orbits;
//! * [`Superposed`]: the way of one with the attitude of another; [`repeated::Repeated`]: one that starts over.

mod elliptic;
pub mod orbit;
pub mod path;
pub mod poses;
pub mod profile;
pub mod repeated;
pub mod tumble;
pub mod turntable;

use nalgebra::{Isometry3, Translation3, Vector3};
use std::sync::Arc;
use tumbled_model::RigNs;

/// A body's state at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyState {
    /// The body's frame into the rig's.
    pub t_rig_body: Isometry3<f64>,
    /// Velocity of the body frame's origin, rig axes, m/s.
    pub velocity_mps: Vector3<f64>,
    /// Angular velocity, rig axes, rad/s.
    pub angular_velocity_rps: Vector3<f64>,
}

/// A motion: the state at any instant of the session, computed without memory, so that every sensor may ask at its own
/// times, in any order, from any thread.
pub trait Motion: Send + Sync + core::fmt::Debug {
    /// The state at `t`.
    fn state(&self, t: RigNs) -> BodyState;
}

/// A body that stays where it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Still(
    /// Its frame into the rig's.
    pub Isometry3<f64>,
);

impl Motion for Still {
    fn state(&self, _t: RigNs) -> BodyState {
        BodyState { t_rig_body: self.0, velocity_mps: Vector3::zeros(), angular_velocity_rps: Vector3::zeros() }
    }
}

/// The way of one motion with the attitude of another: a target that drifts and tumbles. The attitude's own place (its
/// origin's swing about a centre of mass, for one) is added to the way.
#[derive(Clone, Debug)]
pub struct Superposed {
    /// Moves the origin; how it turns is not used.
    pub path: Arc<dyn Motion>,
    /// Turns the body; a centre of mass at the rig's origin stays on the path.
    pub attitude: Arc<dyn Motion>,
}

impl Motion for Superposed {
    fn state(&self, t: RigNs) -> BodyState {
        let (path, turning) = (self.path.state(t), self.attitude.state(t));
        BodyState {
            t_rig_body: Translation3::from(path.t_rig_body.translation.vector) * turning.t_rig_body,
            velocity_mps: path.velocity_mps + turning.velocity_mps,
            angular_velocity_rps: turning.angular_velocity_rps,
        }
    }
}

fn seconds(t: RigNs) -> f64 {
    t.0 as f64 * 1e-9
}

#[cfg(test)]
mod tests;
