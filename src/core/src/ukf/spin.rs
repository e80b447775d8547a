//! What of the state is spin: axis, rate, the direction that a tumble keeps, and how well each is known.

use nalgebra::{Matrix3, Unit, Vector3};

/// The angular velocity has to exceed so many of its standard deviations, of the three axes together.
const LEAST_SIGMAS: f64 = 3.0;

/// How the target spins at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spin {
    /// The axis in rig axes, by the right hand.
    pub axis_rig: Unit<Vector3<f64>>,
    /// Rate about it, rad/s.
    pub rate_rps: f64,
    /// How far the axis is off, r.m.s. of the angle, rad.
    pub axis_sigma_rad: f64,
    /// Standard deviation of the rate, rad/s.
    pub rate_sigma_rps: f64,
}

/// The direction of the angular momentum: the one that a free tumble keeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Momentum {
    /// In rig axes.
    pub axis_rig: Unit<Vector3<f64>>,
    /// How far it is off, r.m.s. of the angle, rad.
    pub axis_sigma_rad: f64,
}

impl Spin {
    /// From the angular velocity in rig axes and its covariance; none where it could as well be no spin.
    pub(super) fn of(rate: &Vector3<f64>, covariance: &Matrix3<f64>) -> Option<Self> {
        let (axis, length, along, across) = split(rate, covariance)?;
        let rate_sigma_rps = libm::sqrt(along);
        // Noise alone is longer than three times all its axes' deviations together once in 10⁵ times.
        let sigma = libm::sqrt(along + across);
        (length > LEAST_SIGMAS * sigma).then(|| Self {
            axis_rig: axis,
            rate_rps: length,
            axis_sigma_rad: libm::sqrt(across) / length,
            rate_sigma_rps,
        })
    }
}

impl Momentum {
    /// From the momentum in rig axes, of any scale, and its covariance.
    pub(super) fn of(momentum: &Vector3<f64>, covariance: &Matrix3<f64>) -> Option<Self> {
        let (axis_rig, length, along, across) = split(momentum, covariance)?;
        let sigma = libm::sqrt(along + across);
        (length > LEAST_SIGMAS * sigma).then(|| Self { axis_rig, axis_sigma_rad: libm::sqrt(across) / length })
    }
}

/// A vector's direction and length; its variance along itself, and across, over both directions.
fn split(vector: &Vector3<f64>, covariance: &Matrix3<f64>) -> Option<(Unit<Vector3<f64>>, f64, f64, f64)> {
    let (axis, length) = Unit::try_new_and_get(*vector, f64::MIN_POSITIVE)?;
    let along = axis.dot(&(covariance * axis.into_inner())).max(0.0);
    Some((axis, length, along, (covariance.trace() - along).max(0.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axis_and_rate_have_the_sigmas_of_their_directions() {
        // ω = (0, 0, 0.1): σ along 0.002, across 0.003 and 0.004, together 0.005: 0.05 rad.
        let covariance = Matrix3::from_diagonal(&Vector3::new(9e-6, 16e-6, 4e-6));
        let spin = Spin::of(&Vector3::new(0.0, 0.0, 0.1), &covariance).expect("it spins");
        assert!((spin.rate_sigma_rps - 0.002).abs() < 1e-15 && (spin.axis_sigma_rad - 0.05).abs() < 1e-15);
        assert_eq!((spin.rate_rps, spin.axis_rig), (0.1, Vector3::z_axis()));
    }

    #[test]
    fn below_three_sigmas_nothing_spins() {
        // The three axes together: √3 · 1e-3.
        let covariance = Matrix3::identity() * 1e-6;
        assert!(Spin::of(&Vector3::new(0.00519, 0.0, 0.0), &covariance).is_none());
        assert!(Spin::of(&Vector3::new(0.00520, 0.0, 0.0), &covariance).is_some());
        assert!(Spin::of(&Vector3::zeros(), &covariance).is_none());
        assert!(Momentum::of(&Vector3::zeros(), &covariance).is_none());
    }
}
