//! How the target moves: its centre of mass on an orbit, its attitude free of torque.

use super::clohessy_wiltshire::ClohessyWiltshire;
use super::inertia::Inertia;
use nalgebra::{Isometry3, SVector, Translation3, UnitQuaternion, Vector3};
use tumbled_model::Twist;
use tumbled_model::se3::exp_rotation;

/// The most angle that one step of the integration turns, rad.
const STEP_RAD: f64 = 0.1;
/// The most steps of one integration: 1000 rad of turning; what lies farther takes longer steps.
const MOST_STEPS: f64 = 10_000.0;

/// A difference of two [`Kinematics`]: body twist θ 3, ρ 3; velocity 3, rate 3, centre of mass 3, inertia 5.
pub(super) type Deviation = SVector<f64, 20>;

/// The target's pose and motion and what governs them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Kinematics {
    /// Target to rig.
    pub(super) pose: Isometry3<f64>,
    /// Of the centre of mass, rig axes, m/s.
    pub(super) velocity: Vector3<f64>,
    /// Angular velocity, body axes, rad/s.
    pub(super) rate: Vector3<f64>,
    /// Place of the centre of mass in the target's frame, m.
    pub(super) center: Vector3<f64>,
    /// The inertia's logarithm: see [`Inertia`].
    pub(super) inertia: SVector<f64, 5>,
}

impl Kinematics {
    /// After `dt` s, which is also what `orbit` spans.
    pub(super) fn moved(&self, orbit: &ClohessyWiltshire, dt: f64) -> Self {
        let arm = self.pose.rotation * self.center;
        let (place, velocity) = orbit.moved(&(self.pose.translation.vector + arm), &self.velocity);
        let (rotation, rate) = turned(&self.pose.rotation, &self.rate, &self.inertia, dt);
        let origin = place - rotation * self.center;
        Self { pose: Isometry3::from_parts(Translation3::from(origin), rotation), velocity, rate, ..*self }
    }

    /// Displaced: the pose by a body twist, the rest by addition.
    pub(super) fn plus(&self, by: &Deviation) -> Self {
        let twist = Twist::from_vector(&by.fixed_rows::<6>(0).into());
        Self {
            pose: self.pose * twist.exp(),
            velocity: self.velocity + by.fixed_rows::<3>(6),
            rate: self.rate + by.fixed_rows::<3>(9),
            center: self.center + by.fixed_rows::<3>(12),
            inertia: self.inertia + by.fixed_rows::<5>(15),
        }
    }

    /// What displaces `from` to here.
    pub(super) fn minus(&self, from: &Self) -> Deviation {
        let mut deviation = Deviation::zeros();
        deviation.fixed_rows_mut::<6>(0).copy_from(&Twist::log(&from.pose.inv_mul(&self.pose)).vector());
        deviation.fixed_rows_mut::<3>(6).copy_from(&(self.velocity - from.velocity));
        deviation.fixed_rows_mut::<3>(9).copy_from(&(self.rate - from.rate));
        deviation.fixed_rows_mut::<3>(12).copy_from(&(self.center - from.center));
        deviation.fixed_rows_mut::<5>(15).copy_from(&(self.inertia - from.inertia));
        deviation
    }

    /// Velocity of the target frame's origin, body axes, m/s: `Rᵀv − ω × c`.
    pub(super) fn origin_velocity(&self) -> Vector3<f64> {
        self.pose.rotation.inverse() * self.velocity - self.rate.cross(&self.center)
    }

    /// Its quaternion of length 1 again.
    pub(super) fn normalized(mut self) -> Self {
        self.pose.rotation = UnitQuaternion::new_normalize(self.pose.rotation.into_inner());
        self
    }
}

/// Attitude and rate after `dt` s without torque.
fn turned(
    rotation: &UnitQuaternion<f64>,
    rate: &Vector3<f64>,
    inertia: &SVector<f64, 5>,
    dt: f64,
) -> (UnitQuaternion<f64>, Vector3<f64>) {
    // A body alike in all directions keeps its rate: exact, without steps.
    if inertia.iter().all(|number| *number == 0.0) {
        return (rotation * exp_rotation(&(rate * dt)), *rate);
    }
    let inertia = Inertia::new(inertia);
    let steps = libm::ceil(rate.norm() * dt.abs() / STEP_RAD).clamp(1.0, MOST_STEPS);
    let h = dt / steps;
    let acceleration = |w: Vector3<f64>| -(inertia.inverse * w.cross(&(inertia.tensor * w)));
    let (mut rotation, mut rate) = (*rotation, *rate);
    for _ in 0..steps as u32 {
        let k1 = acceleration(rate);
        let k2 = acceleration(rate + k1 * (0.5 * h));
        let k3 = acceleration(rate + k2 * (0.5 * h));
        let k4 = acceleration(rate + k3 * h);
        let after = rate + (k1 + (k2 + k3) * 2.0 + k4) * (h / 6.0);
        let middle = rate + (k1 * 5.0 + (k2 + k3) * 4.0 - k4) * (h / 24.0);
        // Magnus: Simpson's mean of the rate and the first commutator. Order four.
        let turn = (rate + middle * 4.0 + after) * (h / 6.0) + rate.cross(&after) * (h * h / 12.0);
        rotation *= exp_rotation(&turn);
        rate = after;
    }
    (rotation, rate)
}

#[cfg(test)]
mod tests;
