//! Prediction: cubature points through the motion, in square-root form.
//!
//! The n states of the target go through `2n` points of equal weight, `T̂ Exp(±√n column)`. What the sensors' states have
//! in common with them goes along with each point; the rest of theirs is linear and kept as it is. All deviations and the
//! noise's are stacked and turned to a triangle once.

use super::dynamics::{Deviation, Kinematics};
use super::options::FilterMethod;
use super::paper;
use super::root::{Root, entry, put};
use super::state::{RATE, Setup, State, VELOCITY};
use nalgebra::{DMatrix, Vector3};
use tumbled_model::RigNs;
use tumbled_model::se3::skew;

/// Rounds of the mean on the group.
const ROUNDS: u32 = 5;
/// A mean that moves less than this has settled.
const SETTLED: f64 = 1e-10;
/// A target slower than this still leaves a sensor's slow error behind: it drifts, rad/s.
const LEAST_RATE: f64 = 0.01;

/// The state at another time, later or earlier; the noise grows either way.
pub(super) fn predict(setup: &Setup, state: &State, t: RigNs) -> State {
    if t == state.t {
        return state.clone();
    }
    let dt = (t - state.t).as_secs_f64();
    let mut after = mean_at(setup, state, t);
    after.root = match setup.options.method {
        FilterMethod::Cubature => {
            let (target, root) = spread(setup, state, &after.target, dt);
            after.target = target;
            root
        }
        FilterMethod::Paper => {
            let (target, root) = paper::spread(setup, state, dt);
            after.target = target;
            root
        }
    };
    after
}

/// The most likely state at another time, its covariance that of the state it comes from.
pub(super) fn mean_at(setup: &Setup, state: &State, t: RigNs) -> State {
    let dt = (t - state.t).as_secs_f64();
    let orbit = setup.options.orbit(dt);
    let mut after = State { t, target: state.target.moved(&orbit, dt).normalized(), ..state.clone() };
    let kept = libm::exp(-forgetting(setup, state, dt));
    for sensor in &mut after.sensors {
        sensor.slow *= kept;
    }
    after
}

/// How many correlation angles the target turns.
fn forgetting(setup: &Setup, state: &State, dt: f64) -> f64 {
    state.target.rate.norm().max(LEAST_RATE) * dt.abs() / setup.options.correlation_angle_rad
}

/// The points' mean and the predicted covariance.
fn spread(setup: &Setup, state: &State, center: &Kinematics, dt: f64) -> (Kinematics, Root) {
    let layout = &setup.layout;
    let (core, width) = (layout.core, layout.width);
    let orbit = setup.options.orbit(dt);
    let before = state.root.rows();
    let wide = libm::sqrt(core as f64);
    let points: Vec<Kinematics> = (0..core)
        .flat_map(|row| {
            let by =
                Deviation::from_fn(|column, _| if column < core { entry(before, row, column) * wide } else { 0.0 });
            [state.target.plus(&by), state.target.plus(&-by)]
        })
        .map(|point| point.moved(&orbit, dt))
        .collect();
    let weight = 0.5 / core as f64;
    let mean = mean(center, &points, |_| weight);

    let sensors = width - core;
    let slow = 6 * layout.all().len();
    let height = 2 * core + NOISE_ROWS + sensors + slow;
    let mut rows = DMatrix::zeros(height, width);
    let share = libm::sqrt(weight);
    for (row, point) in points.iter().enumerate() {
        let deviation = point.minus(&mean);
        for (column, value) in deviation.iter().take(core).enumerate() {
            put(&mut rows, row, column, value * share);
        }
        let side = if row % 2 == 0 { share * wide } else { -share * wide };
        for column in core..width {
            put(&mut rows, row, column, entry(before, row / 2, column) * side);
        }
    }
    noise_rows(setup, &mean, dt, &mut rows, 2 * core);
    let below = 2 * core + NOISE_ROWS;
    rows.view_mut((below, core), (sensors, sensors)).copy_from(&before.view((core, core), (sensors, sensors)));
    let turns = forgetting(setup, state, dt);
    let (kept, renewed) = (libm::exp(-turns), libm::sqrt(-libm::expm1(-2.0 * turns)));
    let mut row = below + sensors;
    for (slots, prior) in layout.all().iter().zip(&setup.priors) {
        for (axis, sigma) in prior.sigma_b.iter().enumerate() {
            let mut column = rows.column_mut(slots.slow + axis);
            column *= kept;
            if let Some(entry) = column.get_mut(row) {
                *entry = sigma * renewed;
            }
            row += 1;
        }
    }
    (mean, Root::of(rows))
}

/// The mean of points: on the group for the pose, of numbers for the rest.
pub(super) fn mean(from: &Kinematics, points: &[Kinematics], weight: impl Fn(usize) -> f64) -> Kinematics {
    let mut mean = *from;
    for _ in 0..ROUNDS {
        let mut step = Deviation::zeros();
        for (index, point) in points.iter().enumerate() {
            step += point.minus(&mean) * weight(index);
        }
        mean = mean.plus(&step);
        if step.norm() < SETTLED {
            break;
        }
    }
    mean.normalized()
}

/// Rows that [`noise_rows`] writes.
pub(super) const NOISE_ROWS: usize = 12;

/// The deviations that white accelerations make in `dt`: of place and velocity, of attitude and rate.
pub(super) fn noise_rows(setup: &Setup, target: &Kinematics, dt: f64, rows: &mut DMatrix<f64>, first: usize) {
    let dt = dt.abs();
    // The root of [[dt³/3, dt²/2], [dt²/2, dt]].
    let place = libm::sqrt(dt * dt * dt / 3.0);
    let (along, aside) = (0.5 * libm::sqrt(3.0 * dt), 0.5 * libm::sqrt(dt));
    let (linear, angular) = (setup.options.q_acceleration, setup.options.q_angular);
    let from_rig = target.pose.rotation.inverse();
    // The body turns about its centre of mass: its origin is displaced by −θ × c.
    let arm = skew(&target.center);
    for axis in 0..3 {
        let unit = Vector3::ith(axis, 1.0);
        let row = first + 4 * axis;
        put(rows, row, axis, angular * place);
        for (k, value) in (arm * unit * (angular * place)).iter().enumerate() {
            put(rows, row, 3 + k, *value);
        }
        put(rows, row, RATE + axis, angular * along);
        put(rows, row + 1, RATE + axis, angular * aside);
        for (k, value) in (from_rig * unit * (linear * place)).iter().enumerate() {
            put(rows, row + 2, 3 + k, *value);
        }
        put(rows, row + 2, VELOCITY + axis, linear * along);
        put(rows, row + 3, VELOCITY + axis, linear * aside);
    }
}
