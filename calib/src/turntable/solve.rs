//! The least squares behind [`super::turntable`]: Gauss and Newton over eleven parameters, weighted by the scatter.

use nalgebra::{Isometry3, SMatrix, SVector, Unit, UnitQuaternion, Vector3, Vector6};
use tumbled_model::se3::{exp_rotation, log_rotation};

use super::{TurnedPose, TurntableFit, across};

/// Tilts 2, offsets 2, rotation at the first angle 3, place 3, gain 1.
const PARAMETERS: usize = 11;
type Step = SVector<f64, PARAMETERS>;
type Information = SMatrix<f64, PARAMETERS, PARAMETERS>;

/// The rounds of weights, and of steps in each.
const WEIGHTS: usize = 4;
const STEPS: usize = 12;
/// Beyond so many σ a pose counts less (Huber).
const HUBER: f64 = 2.0;

/// Where the search is.
#[derive(Clone, Debug)]
struct State {
    axis: Unit<Vector3<f64>>,
    point: Vector3<f64>,
    angle0: f64,
    gain: f64,
    pose0: Isometry3<f64>,
}

/// What the search found.
#[derive(Clone, Debug)]
pub(super) struct Solved {
    state: State,
    covariance: Information,
    scatter: (f64, f64),
}

impl State {
    fn moved(&self, step: &Step) -> Self {
        let [first, second] = across(&self.axis);
        let part = |n: usize| step.get(n).copied().unwrap_or_default();
        let vector = |n: usize| Vector3::new(part(n), part(n + 1), part(n + 2));
        let tilt = exp_rotation(&(first * part(0) + second * part(1)));
        let place = self.pose0.translation.vector + vector(7);
        Self {
            axis: Unit::new_normalize(tilt * self.axis.into_inner()),
            point: self.point + first * part(2) + second * part(3),
            angle0: self.angle0,
            gain: self.gain + part(10),
            pose0: Isometry3::from_parts(place.into(), exp_rotation(&vector(4)) * self.pose0.rotation),
        }
    }

    /// The pose less what the parameters say: rotation vector, rad, and offset, m, rig axes.
    fn residual(&self, pose: &TurnedPose) -> (Vector3<f64>, Vector3<f64>) {
        let turned = UnitQuaternion::from_axis_angle(&self.axis, self.gain * (pose.angle_rad - self.angle0));
        let rotation = pose.t_rig_target.rotation * (turned * self.pose0.rotation).inverse();
        let place = self.point + turned * (self.pose0.translation.vector - self.point);
        (log_rotation(&rotation), pose.t_rig_target.translation.vector - place)
    }

    /// Root of the mean square along one axis.
    fn scatter(&self, poses: &[TurnedPose]) -> (f64, f64) {
        let (mut rotation, mut place) = (0.0, 0.0);
        for (turned, offset) in poses.iter().map(|pose| self.residual(pose)) {
            rotation += turned.norm_squared();
            place += offset.norm_squared();
        }
        // Of six residuals a pose, eleven parameters in all.
        let count = (3.0 * poses.len() as f64 - PARAMETERS as f64 / 2.0).max(1.0);
        ((rotation / count).sqrt(), (place / count).sqrt())
    }
}

/// Searches from an axis and a gain that are nearly right.
pub(super) fn solve(poses: &[TurnedPose], axis: Unit<Vector3<f64>>, gain: f64) -> Option<Solved> {
    let first = poses.first()?;
    let places = poses.iter().map(|pose| pose.t_rig_target.translation.vector);
    let point = places.sum::<Vector3<f64>>() / poses.len() as f64;
    let mut state = State { axis, point, angle0: first.angle_rad, gain, pose0: first.t_rig_target };
    let mut scatter = (0.5_f64.to_radians(), 0.005);
    let mut information = Information::zeros();
    for _ in 0..WEIGHTS {
        for _ in 0..STEPS {
            let (normal, gradient) = normal_equations(&state, poses, scatter);
            let step = normal.cholesky()?.solve(&gradient);
            state = state.moved(&step);
            information = normal;
            if step.norm() < 1e-10 {
                break;
            }
        }
        let found = state.scatter(poses);
        // Made poses without noise have none.
        scatter = (found.0.max(1e-7), found.1.max(1e-7));
    }
    let covariance = information.cholesky()?.inverse();
    let is_finite = covariance.iter().all(|value| value.is_finite()) && state.point.iter().all(|v| v.is_finite());
    is_finite.then_some(Solved { state, covariance, scatter })
}

fn normal_equations(state: &State, poses: &[TurnedPose], scatter: (f64, f64)) -> (Information, Step) {
    const DELTA: f64 = 1e-6;
    let shifted = |n: usize, by: f64| {
        let mut step = Step::zeros();
        step.iter_mut().skip(n).take(1).for_each(|part| *part = by);
        state.moved(&step)
    };
    let sides: [(State, State); PARAMETERS] = core::array::from_fn(|n| (shifted(n, DELTA), shifted(n, -DELTA)));
    let scaled = |state: &State, pose: &TurnedPose| {
        let (rotation, place) = state.residual(pose);
        let (r, p) = (rotation / scatter.0, place / scatter.1);
        Vector6::new(r.x, r.y, r.z, p.x, p.y, p.z)
    };
    let (mut normal, mut gradient) = (Information::zeros(), Step::zeros());
    for pose in poses {
        let residual = scaled(state, pose);
        let columns: [Vector6<f64>; PARAMETERS] = core::array::from_fn(|n| {
            let Some((plus, minus)) = sides.get(n) else { return Vector6::zeros() };
            (scaled(minus, pose) - scaled(plus, pose)) / (2.0 * DELTA)
        });
        let jacobian = SMatrix::<f64, 6, PARAMETERS>::from_columns(&columns);
        let size = residual.norm() / 6.0_f64.sqrt();
        let weight = if size > HUBER { HUBER / size } else { 1.0 };
        normal += jacobian.transpose() * jacobian * weight;
        gradient += jacobian.transpose() * residual * weight;
    }
    (normal, gradient)
}

impl Solved {
    /// In the terms of the result, with the covariance of so many independent poses.
    pub(super) fn finish(self, poses: &[TurnedPose], independent: usize, span_rad: f64) -> TurntableFit {
        let Self { state, covariance, scatter } = self;
        let inflation = poses.len() as f64 / independent.max(1) as f64;
        let a = state.axis;
        // Up, or lying: along x, or y.
        let lead = [a.z, a.x, a.y].into_iter().find(|part| part.abs() > 0.1).unwrap_or(1.0);
        let sign = if lead < 0.0 { -1.0 } else { 1.0 };
        let axis = Unit::new_unchecked(a.into_inner() * sign);
        // The point nearest to the origin moves with the axis' tilt: its lever along the axis.
        let along = state.point.dot(&axis);
        let point_m = state.point - axis.scale(along);
        let own = across(&a);
        let told = across(&axis);
        // A change of (tilt, offset) in the search's directions, as the result's.
        let mut map = SMatrix::<f64, 4, PARAMETERS>::zeros();
        for (column, direction) in own.iter().enumerate() {
            let tilted = direction.cross(&axis);
            for (row, tell) in told.iter().enumerate() {
                set(&mut map, row, column, direction.dot(tell));
                // δp = −along·δa, across the axis; a itself turns by direction × axis.
                set(&mut map, row + 2, column, -along * tilted.dot(tell));
                set(&mut map, row + 2, column + 2, direction.dot(tell));
            }
        }
        let inflated = covariance * inflation;
        let gain_sigma = inflated.get((10, 10)).copied().unwrap_or_default().max(0.0).sqrt();
        TurntableFit {
            axis,
            point_m,
            angle0_rad: state.angle0,
            sign,
            gain: state.gain,
            gain_sigma,
            t_rig_target0: state.pose0,
            covariance: map * inflated * map.transpose(),
            poses: poses.len(),
            independent,
            span_rad,
            scatter,
            residuals: poses.iter().map(|pose| state.residual(pose)).collect(),
        }
    }
}

fn set(map: &mut SMatrix<f64, 4, PARAMETERS>, row: usize, column: usize, value: f64) {
    if let Some(entry) = map.get_mut((row, column)) {
        *entry = value;
    }
}
