//! The published filter, for comparison: scaled sigma points of the error twistor through motion and observation.
//!
//! Twelve states: the error twistor of pose, velocity, angular velocity. The body is taken to be alike in all directions
//! and to turn about its frame's origin. Points `T̂ Exp(±√(α²n) column)` with a centre point, whose weight is negative:
//! the covariance is a plain sum, and may fail to be one.

use super::dynamics::{Deviation, Kinematics};
use super::measurement::Innovation;
use super::root::{Root, entry, product};
use super::sigma::{NOISE_ROWS, mean, noise_rows};
use super::state::{CENTER, Setup, State};
use nalgebra::{DMatrix, Matrix6, SMatrix, SVector, Vector6};

const N: usize = 12;
const ALPHA_SQUARED: f64 = 0.25;
const BETA: f64 = 2.0;
/// λ + n, with κ = 0.
const SPREAD: f64 = ALPHA_SQUARED * N as f64;

type Covariance = SMatrix<f64, N, N>;

/// Weight of a point in the mean; the first is the centre's.
fn weight(index: usize) -> f64 {
    if index == 0 { (SPREAD - N as f64) / SPREAD } else { 0.5 / SPREAD }
}

/// Weight of a point in a covariance.
fn covariance_weight(index: usize) -> f64 {
    if index == 0 { weight(0) + 1.0 - ALPHA_SQUARED + BETA } else { weight(index) }
}

/// The centre and a pair of points for each state.
fn points(state: &State) -> Vec<Kinematics> {
    let root = state.root.rows();
    let wide = libm::sqrt(SPREAD);
    let pairs = (0..N).flat_map(|row| {
        let by = Deviation::from_fn(|column, _| if column < N { entry(root, row, column) * wide } else { 0.0 });
        [state.target.plus(&by), state.target.plus(&-by)]
    });
    core::iter::once(state.target).chain(pairs).collect()
}

/// The points' mean after `dt` s, and the covariance with the motion's noise.
pub(super) fn spread(setup: &Setup, state: &State, dt: f64) -> (Kinematics, Root) {
    let orbit = setup.options.orbit(dt);
    let points: Vec<Kinematics> = points(state).iter().map(|point| point.moved(&orbit, dt)).collect();
    let mean = mean(points.first().unwrap_or(&state.target), &points, weight);
    let mut noise = DMatrix::zeros(NOISE_ROWS, N);
    noise_rows(setup, &mean, dt, &mut noise, 0);
    let mut covariance: Covariance = product(&noise, 0, &noise, 0);
    for (index, point) in points.iter().enumerate() {
        let deviation: SVector<f64, N> = point.minus(&mean).fixed_rows::<N>(0).into();
        covariance += deviation * deviation.transpose() * covariance_weight(index);
    }
    (mean, root_of(&covariance))
}

/// The state after a pose, and the normalised innovation squared; none where the covariance fails.
pub(super) fn update(setup: &Setup, state: &State, innovation: &Innovation, widened: f64) -> Option<(State, f64)> {
    let deviations: Vec<SVector<f64, N>> =
        points(state).iter().map(|point| point.minus(&state.target).fixed_rows::<N>(0).into()).collect();
    let seen = |deviation: &SVector<f64, N>| -> Vector6<f64> { deviation.fixed_rows::<6>(0).into() };
    let mut expected = Vector6::zeros();
    for (index, deviation) in deviations.iter().enumerate() {
        expected += seen(deviation) * weight(index);
    }
    let mut spread: Matrix6<f64> = innovation.noise * widened;
    let mut mixed = SMatrix::<f64, N, 6>::zeros();
    for (index, deviation) in deviations.iter().enumerate() {
        let shown = seen(deviation) - expected;
        spread += shown * shown.transpose() * covariance_weight(index);
        mixed += deviation * shown.transpose() * covariance_weight(index);
    }
    let factor = spread.cholesky()?;
    let surprise = innovation.twist - expected;
    let gain = factor.solve(&mixed.transpose()).transpose();
    let covariance: Covariance = state.root.covariance::<N, N>(0, 0) - gain * spread * gain.transpose();
    let mut after = state.clone();
    after.root = root_of(&covariance);
    after.correct(&setup.layout, (gain * surprise).as_slice());
    Some((after, surprise.dot(&factor.solve(&surprise))))
}

/// The root of a covariance; of one that is none, numbers that no check lets pass.
fn root_of(covariance: &Covariance) -> Root {
    let symmetric = (covariance + covariance.transpose()) * 0.5;
    let factor = symmetric.cholesky().map_or_else(|| Covariance::repeat(f64::NAN), |factor| factor.l());
    let upper = factor.transpose();
    Root::of(DMatrix::from_column_slice(CENTER, CENTER, upper.as_slice()))
}
