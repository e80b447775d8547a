//! What a sensor's pose says: `Z = Exp(e) T Exp(b) Exp(n)`, e about the target's nominal centre, b and n in the body.

use super::options::{CalibrationTreatment, FilterMethod, PoseMeasurement};
use super::root::add_mapped;
use super::state::{Setup, State};
use crate::register::SensorKind;
use core::f64::consts::PI;
use nalgebra::{DMatrix, Isometry3, Matrix6, Vector6};
use tumbled_model::Twist;
use tumbled_model::se3::adjoint;

/// By how much the residuals' noise understates a pose's scatter from frame to frame.
const WHITE_FACTOR: f64 = 1.5;
/// What no frame's pose is better than: rotation, rad, and translation, m.
const WHITE_FLOOR: (f64, f64) = (0.05 / 180.0 * PI, 0.0005);
/// The same where the slow error is not a state: for it all.
const SLOW_FLOOR: (f64, f64) = (0.3 / 180.0 * PI, 0.003);
/// Residuals of a frame that count as one where the slow error is not a state.
const SLOW_FACTOR: (f64, f64) = (8.0, 4.0);
/// What is known of a pose anyhow: a radian and a metre. Keeps a weak pose's covariance finite.
const LEAST_INFORMATION: f64 = 1.0;
/// A sensor's pace before it has shown it, s between epochs.
const FIRST_PACE_S: f64 = 0.1;
/// A target slower than this is taken to turn so, rad/s.
const LEAST_RATE: f64 = 0.02;

/// The twist from the target's pose to the pose at which a sensor's points fit the model: body axes.
pub(super) fn bias(setup: &Setup, state: &State, sensor: usize) -> Vector6<f64> {
    let (Some(prior), Some(known)) = (setup.priors.get(sensor), state.sensors.get(sensor)) else {
        return Vector6::zeros();
    };
    to_body(state, &prior.nominal) * known.constant + known.slow + late(state) * known.late_s
}

/// `Ad(T⁻¹ T_c)`: from the axes of a sensor's constant error to the body's.
fn to_body(state: &State, nominal: &Isometry3<f64>) -> Matrix6<f64> {
    adjoint(&state.target.pose.inv_mul(nominal))
}

/// What a second of lateness does to a pose: it is that of a second before.
fn late(state: &State) -> Vector6<f64> {
    -Twist::new(state.target.rate, state.target.origin_velocity()).vector()
}

/// A pose against the state.
pub(super) struct Innovation {
    /// `Log((T̂ Exp(bias))⁻¹ Z)`.
    pub(super) twist: Vector6<f64>,
    /// Covariance of the pose's own noise.
    pub(super) noise: Matrix6<f64>,
    /// The state's deviations as the pose would show them: the root's rows times Hᵀ.
    pub(super) seen: DMatrix<f64>,
}

/// A pose against the state of its time; none for one that is no pose of a known sensor.
pub(super) fn innovation(setup: &Setup, state: &State, z: &PoseMeasurement) -> Option<Innovation> {
    let prior = setup.priors.get(z.sensor)?;
    let is_finite =
        z.pose.translation.vector.iter().chain(z.pose.rotation.coords.iter()).all(|value| value.is_finite());
    if !is_finite || z.information.iter().any(|value| !value.is_finite()) {
        return None;
    }
    let expected = state.target.pose * Twist::from_vector(&bias(setup, state, z.sensor)).exp();
    let root = state.root.rows();
    let mut seen = root.columns(0, 6).into_owned();
    if let Some(slots) = setup.layout.slots(z.sensor) {
        let map = to_body(state, &prior.nominal);
        for (into, first) in [(0, 0), (3, 0), (3, 3)] {
            let block = map.fixed_view::<3, 3>(into, first).into_owned();
            add_mapped(&mut seen, into, root, slots.constant + first, &block);
        }
        let late = late(state);
        for (axis, late) in late.iter().enumerate() {
            seen.column_mut(axis).axpy(1.0, &root.column(slots.slow + axis), 1.0);
            if let Some(time) = slots.time {
                seen.column_mut(axis).axpy(*late, &root.column(time), 1.0);
            }
        }
    }
    let twist = Twist::log(&expected.inv_mul(&z.pose)).vector();
    Some(Innovation { twist, noise: noise(setup, state, z)?, seen })
}

/// Covariance of a pose's own noise; none where its information is none.
fn noise(setup: &Setup, state: &State, z: &PoseMeasurement) -> Option<Matrix6<f64>> {
    let prior = setup.priors.get(z.sensor)?;
    let symmetric = (z.information + z.information.transpose()) * 0.5;
    let formal = (symmetric + Matrix6::identity() * LEAST_INFORMATION).cholesky()?.inverse();
    let floored = |factor: f64, (rotation, translation): (f64, f64)| {
        let (r, t) = (rotation * rotation, translation * translation);
        formal * factor + Matrix6::from_diagonal(&Vector6::new(r, r, r, t, t, t))
    };
    let factor = if prior.kind == SensorKind::Kinect { SLOW_FACTOR.0 } else { SLOW_FACTOR.1 };
    Some(match (setup.options.method, setup.options.calibration) {
        (FilterMethod::Paper, _) => floored(factor, SLOW_FLOOR),
        (FilterMethod::Cubature, CalibrationTreatment::Estimated) => floored(WHITE_FACTOR, WHITE_FLOOR),
        (FilterMethod::Cubature, CalibrationTreatment::Inflated) => {
            let map = to_body(state, &prior.nominal);
            let constant = map * Matrix6::from_diagonal(&prior.sigma_e.map(|sigma| sigma * sigma)) * map.transpose();
            (floored(factor, SLOW_FLOOR) + constant) * repeated(setup, state, z)
        }
    })
}

/// How many poses of this sensor say the same: as many as it makes while its slow error stays, both ways.
fn repeated(setup: &Setup, state: &State, z: &PoseMeasurement) -> f64 {
    let last = state.sensors.get(z.sensor).and_then(|sensor| sensor.last);
    let pace = last.map(|last| (z.t - last).as_secs_f64()).filter(|pace| *pace > 0.0).unwrap_or(FIRST_PACE_S);
    let rate = state.target.rate.norm().max(LEAST_RATE);
    1.0 + 2.0 * setup.options.correlation_angle_rad / (rate * pace)
}
