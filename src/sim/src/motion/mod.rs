//! Where a body is at any instant, exactly.

use nalgebra::{Isometry3, Vector3};
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
