//! Motion of a point near a circular orbit: Clohessy and Wiltshire's equations, solved exactly.
//!
//! `ẍ − 2nẏ − 3n²x = 0`, `ÿ + 2nẋ = 0`, `z̈ + n²z = 0`, with x radially out, y along the track, z along the normal.

use nalgebra::{Matrix3, Vector3};

/// Below this angle `n t` the coefficients come from their series.
const SMALL: f64 = 1e-3;

/// Position and velocity from one time to another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ClohessyWiltshire {
    place_of_place: Matrix3<f64>,
    place_of_velocity: Matrix3<f64>,
    velocity_of_place: Matrix3<f64>,
    velocity_of_velocity: Matrix3<f64>,
    /// The orbit's point of reference.
    center: Vector3<f64>,
}

impl ClohessyWiltshire {
    /// Over `dt` s at mean motion `n`, rad/s; `n` = 0 is uniform motion. `dt` may be negative.
    pub(super) fn new(n: f64, dt: f64) -> Self {
        let angle = n * dt;
        let (s, k) = libm::sincos(angle);
        let half = libm::sin(0.5 * angle);
        // 1 − k: nothing cancels.
        let versed = 2.0 * half * half;
        let square = angle * angle;
        let (sine_n, versed_n, rest) = if angle.abs() < SMALL {
            let cubic = -angle * square / 6.0 * (1.0 - square / 20.0);
            (dt * (1.0 - square / 6.0), 0.5 * angle * dt * (1.0 - square / 12.0), cubic)
        } else {
            (s / n, versed / n, s - angle)
        };
        Self {
            place_of_place: Matrix3::new(1.0 + 3.0 * versed, 0.0, 0.0, 6.0 * rest, 1.0, 0.0, 0.0, 0.0, k),
            place_of_velocity: Matrix3::new(
                sine_n,
                2.0 * versed_n,
                0.0,
                -2.0 * versed_n,
                4.0 * sine_n - 3.0 * dt,
                0.0,
                0.0,
                0.0,
                sine_n,
            ),
            velocity_of_place: Matrix3::new(3.0 * n * s, 0.0, 0.0, -6.0 * n * versed, 0.0, 0.0, 0.0, 0.0, -n * s),
            velocity_of_velocity: Matrix3::new(k, 2.0 * s, 0.0, -2.0 * s, 1.0 - 4.0 * versed, 0.0, 0.0, 0.0, k),
            center: Vector3::zeros(),
        }
    }

    /// About a point of reference, m, which is the origin otherwise.
    pub(super) fn about(self, center: [f64; 3]) -> Self {
        Self { center: center.into(), ..self }
    }

    /// Where a point at `place`, m, with `velocity`, m/s, is then, and how it moves.
    pub(super) fn moved(&self, place: &Vector3<f64>, velocity: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let place = place - self.center;
        (
            self.center + self.place_of_place * place + self.place_of_velocity * velocity,
            self.velocity_of_place * place + self.velocity_of_velocity * velocity,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
        (-size..size, -size..size, -size..size).prop_map(|(x, y, z)| Vector3::new(x, y, z))
    }

    proptest! {
        #[test]
        fn two_steps_are_one(n in 0.0..2e-3f64, a in -300.0..300.0f64, b in -300.0..300.0f64, p in vector(10.0), v in vector(0.1)) {
            let (p1, v1) = ClohessyWiltshire::new(n, a).moved(&p, &v);
            let (p2, v2) = ClohessyWiltshire::new(n, b).moved(&p1, &v1);
            let (p3, v3) = ClohessyWiltshire::new(n, a + b).moved(&p, &v);
            prop_assert!((p2 - p3).norm() < 1e-10 && (v2 - v3).norm() < 1e-10, "{} {}", (p2 - p3).norm(), (v2 - v3).norm());
        }

        #[test]
        fn it_solves_its_differential_equations(n in 0.0..2e-3f64, p in vector(10.0), v in vector(0.1)) {
            let rate = |p: &Vector3<f64>, v: &Vector3<f64>| {
                (*v, Vector3::new(2.0 * n * v.y + 3.0 * n * n * p.x, -2.0 * n * v.x, -n * n * p.z))
            };
            // Runge–Kutta of order four, 600 steps of 0.1 s: its own error is (n h)⁴, below 1e-15.
            let (mut x, mut w, h) = (p, v, 0.1);
            for _ in 0..600 {
                let (a1, b1) = rate(&x, &w);
                let (a2, b2) = rate(&(x + a1 * (h / 2.0)), &(w + b1 * (h / 2.0)));
                let (a3, b3) = rate(&(x + a2 * (h / 2.0)), &(w + b2 * (h / 2.0)));
                let (a4, b4) = rate(&(x + a3 * h), &(w + b3 * h));
                x += (a1 + a2 * 2.0 + a3 * 2.0 + a4) * (h / 6.0);
                w += (b1 + b2 * 2.0 + b3 * 2.0 + b4) * (h / 6.0);
            }
            let (found, speed) = ClohessyWiltshire::new(n, 60.0).moved(&p, &v);
            prop_assert!((found - x).norm() < 1e-10 && (speed - w).norm() < 1e-10, "{}", (found - x).norm());
        }
    }

    #[test]
    fn about_another_place_the_same_motion_takes_place_there() {
        let (n, dt, center) = (0.02, 20.0, [2.5, 0.1, -0.1]);
        let (p, v) = (Vector3::new(0.1, -0.2, 0.3), Vector3::new(0.004, -0.002, 0.004));
        let at_origin = ClohessyWiltshire::new(n, dt).moved(&p, &v);
        let there = ClohessyWiltshire::new(n, dt).about(center).moved(&(p + Vector3::from(center)), &v);
        assert!((there.0 - Vector3::from(center) - at_origin.0).norm() < 1e-12);
        assert!((there.1 - at_origin.1).norm() < 1e-12);
        // A point that rests at the place of reference stays; 2.5 m radially out it would be driven off.
        let rest = Vector3::zeros();
        assert_eq!(
            ClohessyWiltshire::new(n, dt).about(center).moved(&Vector3::from(center), &rest).0,
            Vector3::from(center)
        );
        assert!(
            (ClohessyWiltshire::new(n, dt).moved(&Vector3::from(center), &rest).0 - Vector3::from(center)).norm() > 0.5
        );
    }

    #[test]
    fn without_an_orbit_motion_is_uniform_and_series_meets_closed_form() {
        let (p, v) = (Vector3::new(1.0, -2.0, 0.5), Vector3::new(0.01, 0.02, -0.03));
        let (found, speed) = ClohessyWiltshire::new(0.0, 4.5).moved(&p, &v);
        assert!((found - (p + v * 4.5)).norm() < 1e-15 && speed == v);
        let near = |n: f64| ClohessyWiltshire::new(n, 4.5).moved(&p, &v);
        assert!((near(1e-12).0 - found).norm() < 1e-9);
        let (below, above) = (near(SMALL / 4.5 * (1.0 - 1e-12)), near(SMALL / 4.5 * (1.0 + 1e-12)));
        assert!((below.0 - above.0).norm() < 1e-11 && (below.1 - above.1).norm() < 1e-11);
    }
}
