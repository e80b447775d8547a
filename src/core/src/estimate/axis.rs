//! Whether a target turns about an axis that stays: by the rotations between poses of one sensor.
//!
//! A sensor's constant errors turn every axis alike and its slow ones are small beside a turn of 20°: what is left moves by a
//! degree. A free body's axis goes round its momentum by more, unless it spins about a principal axis, where there is
//! nothing to tell.

use nalgebra::{UnitQuaternion, Vector3};
use std::collections::VecDeque;
use tumbled_model::se3::log_rotation;

/// Between two poses whose rotation is an axis, rad: 20°. Slow errors of 0.3° are 1° of it then.
const TURN_RAD: f64 = 20.0 / 180.0 * core::f64::consts::PI;
/// Axes that are held against each other: half a turn of the target.
const AXES: usize = 9;
/// Farther apart than this two axes are not one, rad: 5° for a Kinect; 12° for a LiDAR, whose first crossings lie more than a
/// degree off while its beams' biases are not known.
const APART_RAD: [f64; 2] = [12.0 / 180.0 * core::f64::consts::PI, 5.0 / 180.0 * core::f64::consts::PI];
/// So many axes must lie that far from the first.
const WITNESSES: usize = 2;

/// The axes that one sensor has seen.
#[derive(Clone, Debug)]
pub(super) struct AxisTest {
    apart_rad: f64,
    from: Option<UnitQuaternion<f64>>,
    axes: VecDeque<Vector3<f64>>,
}

impl AxisTest {
    /// Of a Kinect or a LiDAR.
    pub(super) fn new(is_kinect: bool) -> Self {
        let [lidar, kinect] = APART_RAD;
        Self { apart_rad: if is_kinect { kinect } else { lidar }, from: None, axes: VecDeque::new() }
    }

    /// Takes a pose's rotation, target to rig. True: the axis does not stay.
    pub(super) fn moves(&mut self, rotation: &UnitQuaternion<f64>) -> bool {
        let Some(from) = self.from else {
            self.from = Some(*rotation);
            return false;
        };
        let turn = log_rotation(&(rotation * from.inverse()));
        let Some(axis) = (turn.norm() >= TURN_RAD).then(|| turn.normalize()) else { return false };
        self.from = Some(*rotation);
        self.axes.push_back(axis);
        if self.axes.len() > AXES {
            self.axes.pop_front();
        }
        let Some(first) = self.axes.front() else { return false };
        let apart = |axis: &&Vector3<f64>| libm::acos(axis.dot(first).clamp(-1.0, 1.0)) > self.apart_rad;
        self.axes.iter().filter(apart).count() >= WITNESSES
    }

    /// A turn that was not the target's own: what was seen before says nothing of what follows.
    pub(super) fn forget(&mut self) {
        self.from = None;
        self.axes.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tumbled_model::se3::exp_rotation;

    /// Whether the test ever says so while a body of transverse inertia 1 and axial 1.4 turns by `degrees` in steps of 1°, its
    /// momentum along z and its axis `cone` degrees from it.
    fn says(cone: f64, degrees: u32) -> bool {
        let mut test = AxisTest::new(true);
        let mut rotation = exp_rotation(&(Vector3::y() * cone.to_radians()));
        (0..degrees).any(|_| {
            // Precession about the momentum, and the spin about the body's axis that is left beside it.
            let about_momentum = exp_rotation(&(Vector3::z() * 1f64.to_radians()));
            let spin = -0.4 / 1.4 * libm::cos(cone.to_radians()) * 1f64.to_radians();
            rotation = about_momentum * rotation * exp_rotation(&(Vector3::z() * spin));
            test.moves(&rotation)
        })
    }

    #[test]
    fn a_fixed_axis_stays_and_a_nutating_one_does_not() {
        assert!(!says(0.0, 720));
        // The rotation's axis lies 0.4/1.4 of the cone's sine off the momentum: 30° make it go round a circle of some 10°.
        assert!(says(30.0, 360));
    }

    #[test]
    fn constant_errors_of_a_sensor_do_not_move_an_axis() {
        let mut test = AxisTest::new(true);
        let wrong = exp_rotation(&Vector3::new(0.01, -0.02, 0.005));
        assert!((0..720).all(|n| !test.moves(&(wrong * exp_rotation(&(Vector3::z() * f64::from(n).to_radians()))))));
    }
}
