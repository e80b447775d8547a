//! A body that turns free of torque.
//!
//! Euler's equations in closed form: the rates are Jacobi's elliptic functions, so that energy and the momentum's
//! length hold to rounding at any instant. The attitude is built on the momentum: two of its three angles are where the
//! momentum lies in the body, which the rates say exactly; the third, the precession about the momentum, is an integral
//! over one half of the rates' period, kept in a table. Landau and Lifshitz, Mechanics, § 37.

use super::elliptic::Amplitude;
use super::{BodyState, Motion};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
use thiserror::Error;
use tumbled_model::RigNs;

/// Free tumbling about a centre of mass that stays. [`super::Superposed`] moves it.
#[derive(Clone, Debug)]
pub struct Tumble {
    /// Body frame, m.
    centre_of_mass: Point3<f64>,
    /// The same point, rig frame.
    centre_rig: Point3<f64>,
    spin: Spin,
}

/// Why a tumble cannot be.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum TumbleError {
    /// Every moment of inertia is more than nothing, and at most the sum of the two others.
    #[error(
        "moments of inertia {0:?}: no body has these; each must be above zero and at most the sum of the two others \
         (their unit does not matter)"
    )]
    Inertia([f64; 3]),
    /// Rates are numbers.
    #[error("body rates {0:?} rad/s: expected finite numbers")]
    Rates([f64; 3]),
}

#[derive(Clone, Debug)]
enum Spin {
    /// About a principal axis: the rate does not change.
    Even {
        attitude: UnitQuaternion<f64>,
        rates_rps: Vector3<f64>,
    },
    Wobble(Box<Wobble>),
}

impl Tumble {
    /// From the principal moments of inertia about the body's axes (any unit: only their ratios count), the rates about
    /// the body's axes at the session's start, rad/s, the pose then, and the centre of mass in the body's frame, m.
    ///
    /// # Errors
    /// [`TumbleError`].
    pub fn new(
        inertia: Vector3<f64>,
        rates_rps: Vector3<f64>,
        start: Isometry3<f64>,
        centre_of_mass: Point3<f64>,
    ) -> Result<Self, TumbleError> {
        let sum = inertia.sum();
        let possible = |moment: &f64| *moment > 0.0 && 2.0 * moment <= sum * (1.0 + 1e-12);
        if !sum.is_finite() || !inertia.iter().all(possible) {
            return Err(TumbleError::Inertia(inertia.into()));
        }
        if !rates_rps.iter().all(|rate| rate.is_finite()) {
            return Err(TumbleError::Rates(rates_rps.into()));
        }
        // A scale free of units; nothing below depends on it.
        let inertia = inertia / sum;
        let momentum = inertia.component_mul(&rates_rps);
        let even = momentum.cross(&rates_rps).norm() <= 1e-14 * momentum.norm() * rates_rps.norm();
        let spin = if even {
            Spin::Even { attitude: start.rotation, rates_rps }
        } else {
            Spin::Wobble(Box::new(Wobble::new(inertia, rates_rps, start.rotation)))
        };
        Ok(Self { centre_of_mass, centre_rig: start * centre_of_mass, spin })
    }
}

impl Motion for Tumble {
    fn state(&self, t: RigNs) -> BodyState {
        let (attitude, rates_rps) = match &self.spin {
            Spin::Even { attitude, rates_rps } => (attitude * turn_by(rates_rps * super::seconds(t)), *rates_rps),
            Spin::Wobble(wobble) => wobble.at(super::seconds(t)),
        };
        let angular_velocity_rps = attitude * rates_rps;
        let arm = -(attitude * self.centre_of_mass.coords);
        BodyState {
            t_rig_body: Isometry3::from_parts((self.centre_rig + arm).into(), attitude),
            velocity_mps: angular_velocity_rps.cross(&arm),
            angular_velocity_rps,
        }
    }
}

/// A rotation vector as a rotation.
fn turn_by(vector: Vector3<f64>) -> UnitQuaternion<f64> {
    let angle = vector.norm();
    if angle == 0.0 {
        return UnitQuaternion::identity();
    }
    let (sin, cos) = libm::sincos(angle / 2.0);
    UnitQuaternion::new_unchecked(nalgebra::Quaternion::from_parts(cos, vector * (sin / angle)))
}

/// Steps of the table over half a period. The interpolation's error goes with the sixth power of the step: below 1e-11
/// rad even where the half period is fifty units long, which is as near to the unstable axis as numbers come.
const STEPS: usize = 1_024;
/// The complement 1 − m is never taken smaller: rates would differ by this part only.
const NEAREST_TO_UNSTABLE: f64 = 1e-24;
/// Gauss and Legendre's five places in 0..1 and their weights (Abramowitz and Stegun, table 25.4).
const GAUSS: [(f64, f64); 5] = [
    (0.046_910_077_030_668_0, 0.118_463_442_528_094_54),
    (0.230_765_344_947_158_45, 0.239_314_335_249_683_24),
    (0.5, 0.284_444_444_444_444_44),
    (0.769_234_655_052_841_5, 0.239_314_335_249_683_24),
    (0.953_089_922_969_332, 0.118_463_442_528_094_54),
];

/// A tumble whose rates change. Axes 1, 2, 3 are the body's, reordered: 2 has the middle moment, and the rates circle
/// about 3, which has the greatest or the least.
#[derive(Clone, Debug)]
struct Wobble {
    /// The body's axes into 1, 2, 3.
    t_axes_body: Rotation3<f64>,
    inertia: Vector3<f64>,
    /// The rates are these times cn, sn and dn.
    amplitudes_rps: Vector3<f64>,
    complement: f64,
    /// Units of τ per second, and τ at the session's start.
    tau_per_s: f64,
    tau_start: f64,
    half_period: f64,
    table: Vec<Node>,
    /// The momentum's frame (z along it, x along the line of nodes at precession 0) into the rig's.
    t_rig_momentum: Rotation3<f64>,
}

/// Elliptic amplitude and precession at a step, with their first and second derivatives by τ, times the step and its
/// square.
#[derive(Clone, Copy, Debug)]
struct Node {
    amplitude: [f64; 3],
    precession: [f64; 3],
}

/// A body's axis with its moment and rate.
type Axis = (f64, f64, Vector3<f64>);

impl Wobble {
    fn new(inertia: Vector3<f64>, rates_rps: Vector3<f64>, attitude: UnitQuaternion<f64>) -> Self {
        let mut axes: [Axis; 3] = [
            (inertia.x, rates_rps.x, Vector3::x()),
            (inertia.y, rates_rps.y, Vector3::y()),
            (inertia.z, rates_rps.z, Vector3::z()),
        ];
        axes.sort_by(|a, b| a.0.total_cmp(&b.0));
        let [least, middle, greatest] = axes;
        // L² − 2E·I of the middle axis: its sign says about which end the rates circle.
        let excess = |end: Axis| end.0 * (end.0 - middle.0) * end.1 * end.1;
        let about = excess(greatest) + excess(least);
        let (mut one, three) = if about >= 0.0 { (least, greatest) } else { (greatest, least) };
        if one.2.cross(&middle.2).dot(&three.2) < 0.0 {
            one = (one.0, -one.1, -one.2);
        }
        let ((i1, w1, _), (i2, w2, _), (i3, w3, _)) = (one, middle, three);
        // 2E·I₃ − L² and L² − 2E·I₁, free of cancellation; both change sign with the order of the axes.
        let below = i1 * (i3 - i1) * w1 * w1 + i2 * (i3 - i2) * w2 * w2;
        let above = i2 * (i2 - i1) * w2 * w2 + i3 * (i3 - i1) * w3 * w3;
        let complement = ((i3 - i1) * about / ((i3 - i2) * above)).clamp(NEAREST_TO_UNSTABLE, 1.0);
        let amplitudes_rps = Vector3::new(
            (below / (i1 * (i3 - i1))).sqrt(),
            (below / (i2 * (i3 - i2))).sqrt().copysign(w3 * (i3 - i2)),
            (above / (i3 * (i3 - i1))).sqrt().copysign(w3),
        );
        let mut wobble = Self {
            t_axes_body: Rotation3::from_matrix_unchecked(
                Matrix3::from_columns(&[one.2, middle.2, three.2]).transpose(),
            ),
            inertia: Vector3::new(i1, i2, i3),
            amplitudes_rps,
            complement,
            tau_per_s: ((i3 - i2) * above / (i1 * i2 * i3)).sqrt(),
            tau_start: 0.0,
            half_period: 0.0,
            table: Vec::with_capacity(STEPS + 1),
            t_rig_momentum: Rotation3::identity(),
        };
        let amplitude = Amplitude::new(complement);
        wobble.half_period = 2.0 * amplitude.quarter;
        wobble.tau_start = argument(&amplitude, libm::atan2(w2 / amplitudes_rps.y, w1 / amplitudes_rps.x));
        wobble.tabulate(&amplitude);
        let (t_momentum_body, _) = wobble.in_momentum_frame(0.0);
        wobble.t_rig_momentum = attitude.to_rotation_matrix() * t_momentum_body.inverse();
        wobble
    }

    fn tabulate(&mut self, amplitude: &Amplitude) {
        let step = self.half_period / STEPS as f64;
        let mut precession = 0.0;
        for n in 0..=STEPS {
            let begin = n as f64 * step;
            let (sin, cos) = libm::sincos(amplitude.at(begin));
            let dn = self.dn(sin, cos);
            let (rate, slope) = self.precession_rate(sin, cos);
            self.table.push(Node {
                amplitude: [amplitude.at(begin), step * dn, -step * step * (1.0 - self.complement) * sin * cos],
                precession: [precession, step * rate, step * step * slope * 2.0 * sin * cos * dn],
            });
            for (place, weight) in GAUSS {
                let (sin, cos) = libm::sincos(amplitude.at(begin + place * step));
                precession += step * weight * self.precession_rate(sin, cos).0;
            }
        }
    }

    /// dn by sn and cn.
    fn dn(&self, sin: f64, cos: f64) -> f64 {
        (cos * cos + self.complement * sin * sin).sqrt()
    }

    /// How fast the line of nodes turns about the momentum, rad per unit of τ, and how that changes with sn².
    fn precession_rate(&self, sin: f64, cos: f64) -> (f64, f64) {
        let (inertia, a) = (&self.inertia, &self.amplitudes_rps);
        let (one, two) = (inertia.x * a.x * a.x, inertia.y * a.y * a.y);
        let (part, part_slope) = (one * cos * cos + two * sin * sin, two - one);
        let (one, two) = (one * inertia.x, two * inertia.y);
        let (whole, whole_slope) = (one * cos * cos + two * sin * sin, two - one);
        // |L| from the state at sn = 0.
        let momentum = (one + inertia.z * inertia.z * a.z * a.z).sqrt() / self.tau_per_s;
        (momentum * part / whole, momentum * (part_slope * whole - part * whole_slope) / (whole * whole))
    }

    /// The body's attitude in the momentum's frame, and its rates about its own axes.
    fn in_momentum_frame(&self, seconds: f64) -> (Rotation3<f64>, Vector3<f64>) {
        let tau = self.tau_start + self.tau_per_s * seconds;
        let halves = (tau / self.half_period).floor();
        let place = (tau / self.half_period - halves) * STEPS as f64;
        let step = (place as usize).min(STEPS - 1);
        let (Some(from), Some(to), Some(end)) = (self.table.get(step), self.table.get(step + 1), self.table.last())
        else {
            return (Rotation3::identity(), Vector3::zeros());
        };
        let weights = weights(place - step as f64);
        let (mut sin, mut cos) = libm::sincos(between(&weights, &from.amplitude, &to.amplitude));
        if halves.rem_euclid(2.0) == 1.0 {
            (sin, cos) = (-sin, -cos);
        }
        let [half_turn, ..] = end.precession;
        let precession = half_turn * halves + between(&weights, &from.precession, &to.precession);
        let rates = self.amplitudes_rps.component_mul(&Vector3::new(cos, sin, self.dn(sin, cos)));
        let along = self.inertia.component_mul(&rates).normalize();
        let nodes = Vector3::new(along.y, -along.x, 0.0).normalize();
        let (sin, cos) = libm::sincos(precession);
        let up = along.cross(&nodes);
        let rows = [nodes * cos - up * sin, nodes * sin + up * cos, along];
        let t_momentum_axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&rows).transpose());
        (t_momentum_axes * self.t_axes_body, self.t_axes_body.inverse() * rates)
    }

    fn at(&self, seconds: f64) -> (UnitQuaternion<f64>, Vector3<f64>) {
        let (t_momentum_body, rates) = self.in_momentum_frame(seconds);
        (UnitQuaternion::from_rotation_matrix(&(self.t_rig_momentum * t_momentum_body)), rates)
    }
}

/// The τ of an amplitude in −π..π, by halving: the amplitude only grows.
fn argument(amplitude: &Amplitude, angle: f64) -> f64 {
    let (mut low, mut high) = (-2.0 * amplitude.quarter, 2.0 * amplitude.quarter);
    for _ in 0..80 {
        let middle = (low + high) / 2.0;
        if amplitude.at(middle) < angle { low = middle } else { high = middle }
    }
    (low + high) / 2.0
}

/// Hermite's polynomials of the fifth degree: what the value, slope and curvature at the begin and at the end count at
/// `u` between 0 and 1.
fn weights(u: f64) -> [[f64; 3]; 2] {
    let cube = u * u * u;
    let end = cube * (10.0 + u * (-15.0 + 6.0 * u));
    let begin = [1.0 - end, u + cube * (-6.0 + u * (8.0 - 3.0 * u)), u * u * 0.5 + cube * (-1.5 + u * (1.5 - 0.5 * u))];
    [begin, [end, cube * (-4.0 + u * (7.0 - 3.0 * u)), cube * (0.5 + u * (-1.0 + 0.5 * u))]]
}

fn between([begin, end]: &[[f64; 3]; 2], from: &[f64; 3], to: &[f64; 3]) -> f64 {
    let sum = |weights: &[f64; 3], values: &[f64; 3]| weights.iter().zip(values).map(|(w, v)| w * v).sum::<f64>();
    sum(begin, from) + sum(end, to)
}

#[cfg(test)]
#[path = "tumble_tests.rs"]
mod tests;
