//! Drift of two satellites in neighbouring orbits.

use super::{BodyState, Motion};
use nalgebra::{Isometry3, Translation3, Vector3};
use tumbled_model::RigNs;

/// The motion of a target relative to the rig on a circular orbit (Clohessy and Wiltshire 1960), in closed form, for
/// any mean motion down to none, where it is a straight line.
///
/// Hill's frame: x away from the planet, y along the orbit, z along its normal. The body keeps that frame's axes:
/// [`super::Superposed`] gives it an attitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClohessyWiltshire {
    /// Hill's frame into the rig's; its origin is the point that stays.
    pub t_rig_hill: Isometry3<f64>,
    /// The orbit's mean motion, rad/s: 0.00113 in a low orbit of the Earth.
    pub mean_motion_rps: f64,
    /// Where the body's origin is at the session's start, Hill's frame, m.
    pub position_m: Vector3<f64>,
    /// Its velocity then, Hill's frame, m/s.
    pub velocity_mps: Vector3<f64>,
}

impl ClohessyWiltshire {
    /// Position, m, and velocity, m/s, in Hill's frame.
    pub fn relative(&self, t: RigNs) -> (Vector3<f64>, Vector3<f64>) {
        let (n, seconds) = (self.mean_motion_rps, super::seconds(t));
        let angle = n * seconds;
        let (s, c) = libm::sincos(angle);
        let half = angle / 2.0;
        // sin(nt)/n and (1 − cos(nt))/n, whole at n = 0; 1 − cos by half angles, which keeps its digits.
        let s_n = seconds * sinc(angle);
        let sinc_half = sinc(half);
        let v_n = seconds * half * sinc_half * sinc_half;
        let versine = v_n * n;
        let (p, v) = (&self.position_m, &self.velocity_mps);
        let position = Vector3::new(
            (1.0 + 3.0 * versine) * p.x + s_n * v.x + 2.0 * v_n * v.y,
            6.0 * (s - angle) * p.x + p.y - 2.0 * v_n * v.x + (4.0 * s_n - 3.0 * seconds) * v.y,
            c * p.z + s_n * v.z,
        );
        let velocity = Vector3::new(
            3.0 * n * s * p.x + c * v.x + 2.0 * s * v.y,
            -6.0 * n * versine * p.x - 2.0 * s * v.x + (1.0 - 4.0 * versine) * v.y,
            -n * s * p.z + c * v.z,
        );
        (position, velocity)
    }
}

/// sin(x)/x, 1 at 0.
fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { libm::sin(x) / x }
}

impl Motion for ClohessyWiltshire {
    fn state(&self, t: RigNs) -> BodyState {
        let (position, velocity) = self.relative(t);
        BodyState {
            t_rig_body: self.t_rig_hill * Translation3::from(position),
            velocity_mps: self.t_rig_hill.rotation * velocity,
            angular_velocity_rps: Vector3::zeros(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn start(mean_motion_rps: f64) -> ClohessyWiltshire {
        ClohessyWiltshire {
            t_rig_hill: Isometry3::identity(),
            mean_motion_rps,
            position_m: Vector3::new(0.4, -2.0, 0.3),
            velocity_mps: Vector3::new(0.01, -0.02, 0.015),
        }
    }

    /// Hill's equations themselves: x¨ = 3n²x + 2n·y˙, y¨ = −2n·x˙, z¨ = −n²z, by Runge and Kutta's fourth order.
    fn integrated(motion: &ClohessyWiltshire, seconds: f64, steps: u32) -> (Vector3<f64>, Vector3<f64>) {
        let n = motion.mean_motion_rps;
        let rates = |(p, v): (Vector3<f64>, Vector3<f64>)| {
            (v, Vector3::new(3.0 * n * n * p.x + 2.0 * n * v.y, -2.0 * n * v.x, -n * n * p.z))
        };
        let ahead =
            |a: (Vector3<f64>, Vector3<f64>), b: (Vector3<f64>, Vector3<f64>), h: f64| (a.0 + b.0 * h, a.1 + b.1 * h);
        let h = seconds / f64::from(steps);
        let mut state = (motion.position_m, motion.velocity_mps);
        for _ in 0..steps {
            let k1 = rates(state);
            let k2 = rates(ahead(state, k1, h / 2.0));
            let k3 = rates(ahead(state, k2, h / 2.0));
            let k4 = rates(ahead(state, k3, h));
            for (k, weight) in [(k1, 1.0), (k2, 2.0), (k3, 2.0), (k4, 1.0)] {
                state = ahead(state, k, h * weight / 6.0);
            }
        }
        state
    }

    #[test]
    fn the_closed_form_is_what_hills_equations_integrate_to() {
        // A low orbit, a made-up fast one that comes round in 63 s, and hardly any.
        for n in [0.00113, 0.1, 1e-7] {
            let motion = start(n);
            for seconds in [1, 30, 200] {
                let exact = motion.relative(RigNs(seconds * 1_000_000_000));
                let found = integrated(&motion, seconds as f64, 20_000);
                let off = (exact.0 - found.0).amax().max((exact.1 - found.1).amax());
                assert!(off < 1e-10, "n = {n}, {seconds} s: {off}");
            }
        }
    }

    #[test]
    fn without_mean_motion_it_is_a_straight_line_and_small_ones_lead_there() {
        let t = RigNs(100_000_000_000);
        let line = start(0.0).position_m + start(0.0).velocity_mps * 100.0;
        assert!((start(0.0).relative(t).0 - line).amax() < 1e-15);
        // The first terms in n: n·v·t² = 1e-12 · 0.02 · 10⁴ m.
        let near = start(1e-12).relative(t).0;
        assert!((near - line).amax() < 1e-9 && near != line);
    }

    #[test]
    fn hills_frame_may_stand_anywhere() {
        let t_rig_hill = Isometry3::new(Vector3::new(3.0, 0.0, 1.0), Vector3::new(0.0, 0.0, 0.5));
        let motion = ClohessyWiltshire { t_rig_hill, ..start(0.00113) };
        let (position, velocity) = start(0.00113).relative(RigNs(7_000_000_000));
        let state = motion.state(RigNs(7_000_000_000));
        assert!(
            (state.t_rig_body.translation.vector - (t_rig_hill * nalgebra::Point3::from(position)).coords).norm()
                < 1e-15
        );
        assert!((state.velocity_mps - t_rig_hill.rotation * velocity).norm() < 1e-15);
    }
}
