//! Rigid motion as twists: exponential, logarithm and adjoint of SE(3), safe at no rotation and at half a turn.
//!
//! A twist is ξ = (θ, ρ): rotation first, rad, then translation, m. `Exp(ξ) = (exp θ, V(θ) ρ)`. A covariance of a pose
//! has the same order. (Design note `method.md` §0; Barfoot, State Estimation for Robotics, ch. 7.)

use core::f64::consts::TAU;
use libm::{atan2, round, sin};
use nalgebra::{Isometry3, Matrix3, Matrix6, Quaternion, Translation3, UnitQuaternion, Vector3, Vector6};

/// Below this angle, rad, the coefficients come from their series: the next term is below 1e-16 there.
const SMALL: f64 = 1e-4;
/// Below this angle the coefficient of `V⁻¹` comes from its series: it cancels earlier than the others.
const SMALL_INVERSE: f64 = 1e-2;

/// Terms of a series at most: for two turns the next one is below 1e-16.
const MOST_TERMS: u32 = 60;

/// A rigid motion's twist.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Twist {
    /// θ: the rotation as a vector along its axis, of its angle's length, rad.
    pub rotation: Vector3<f64>,
    /// ρ: the translation part, m.
    pub translation: Vector3<f64>,
}

impl Twist {
    /// From its two parts, rad and m.
    pub const fn new(rotation: Vector3<f64>, translation: Vector3<f64>) -> Self {
        Self { rotation, translation }
    }

    /// From six numbers, θ first.
    pub fn from_vector(vector: &Vector6<f64>) -> Self {
        Self { rotation: vector.fixed_rows::<3>(0).into(), translation: vector.fixed_rows::<3>(3).into() }
    }

    /// As six numbers, θ first.
    pub fn vector(&self) -> Vector6<f64> {
        let (r, t) = (self.rotation, self.translation);
        Vector6::new(r.x, r.y, r.z, t.x, t.y, t.z)
    }

    /// `Exp(ξ)`: the motion.
    pub fn exp(&self) -> Isometry3<f64> {
        let translation = left_jacobian(&self.rotation) * self.translation;
        Isometry3::from_parts(Translation3::from(translation), exp_rotation(&self.rotation))
    }

    /// `Log(T)`: the twist of least angle whose motion it is. At half a turn the axis's sign is arbitrary.
    pub fn log(motion: &Isometry3<f64>) -> Self {
        let rotation = log_rotation(&motion.rotation);
        Self { rotation, translation: inverse_left_jacobian(&rotation) * motion.translation.vector }
    }
}

impl Twist {
    /// `J(ξ)`, the left Jacobian of SE(3): `Exp(ξ + δ) = Exp(J δ) Exp(ξ)` for small δ; its series `Σ adⁿ/(n+1)!`.
    pub fn left_jacobian(&self) -> Matrix6<f64> {
        let (turn, shift) = (skew(&self.rotation), skew(&self.translation));
        let mut ad = Matrix6::zeros();
        ad.fixed_view_mut::<3, 3>(0, 0).copy_from(&turn);
        ad.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn);
        ad.fixed_view_mut::<3, 3>(3, 0).copy_from(&shift);
        let mut term = Matrix6::identity();
        let mut sum = term;
        for n in 1..MOST_TERMS {
            term *= ad / f64::from(n + 1);
            sum += term;
            if term.amax() < f64::EPSILON {
                break;
            }
        }
        sum
    }
}

/// `[w]×`: the matrix of the cross product with `w` from the left.
pub fn skew(w: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -w.z, w.y, w.z, 0.0, -w.x, -w.y, w.x, 0.0)
}

/// The rotation by the vector's length about the vector, rad.
pub fn exp_rotation(theta: &Vector3<f64>) -> UnitQuaternion<f64> {
    let angle = theta.norm();
    let half = 0.5 * angle;
    // sin(a/2)/a; its series near 0.
    let scale = if angle < SMALL { 0.5 - angle * angle / 48.0 } else { sin(half) / angle };
    let vector = theta * scale;
    UnitQuaternion::new_normalize(Quaternion::new(libm::cos(half), vector.x, vector.y, vector.z))
}

/// The vector of least length that turns so, rad.
pub fn log_rotation(rotation: &UnitQuaternion<f64>) -> Vector3<f64> {
    // q and −q are one rotation: the one with w ≥ 0 has the least angle.
    let sign = if rotation.w < 0.0 { -1.0 } else { 1.0 };
    let (w, u) = (sign * rotation.w, rotation.imag() * sign);
    let length = u.norm();
    if length < 1e-8 { u * (2.0 / w) } else { u * (2.0 * atan2(length, w) / length) }
}

/// `V(θ)`, the left Jacobian of SO(3).
pub fn left_jacobian(theta: &Vector3<f64>) -> Matrix3<f64> {
    let (_, b, c) = coefficients(theta.norm());
    let cross = skew(theta);
    Matrix3::identity() + cross * b + cross * cross * c
}

/// `V⁻¹(θ)`, for angles below a full turn.
pub fn inverse_left_jacobian(theta: &Vector3<f64>) -> Matrix3<f64> {
    let angle = theta.norm();
    let square = angle * angle;
    let e = if angle < SMALL_INVERSE {
        1.0 / 12.0 + square / 720.0
    } else {
        let (a, b, _) = coefficients(angle);
        (1.0 - a / (2.0 * b)) / square
    };
    let cross = skew(theta);
    Matrix3::identity() - cross * 0.5 + cross * cross * e
}

/// `Ad(T)` for twists in the order (θ, ρ): `T Exp(ξ) T⁻¹ = Exp(Ad(T) ξ)`. A covariance moves by `Ad Σ Adᵀ`.
pub fn adjoint(motion: &Isometry3<f64>) -> Matrix6<f64> {
    let rotation = motion.rotation.to_rotation_matrix().into_inner();
    let mut adjoint = Matrix6::zeros();
    adjoint.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
    adjoint.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
    adjoint.fixed_view_mut::<3, 3>(3, 0).copy_from(&(skew(&motion.translation.vector) * rotation));
    adjoint
}

/// sin a / a, (1 − cos a)/a² and (a − sin a)/a³.
fn coefficients(angle: f64) -> (f64, f64, f64) {
    let square = angle * angle;
    if angle < SMALL {
        return (1.0 - square / 6.0, 0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0);
    }
    let half = sin(0.5 * angle) / (0.5 * angle);
    // 1 − cos a as 2 sin²(a/2): nothing cancels.
    (sin(angle) / angle, 0.5 * half * half, (angle - sin(angle)) / (square * angle))
}

/// The angle between two rotations, rad, 0..=π.
pub fn angle_between(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> f64 {
    let between = a.inverse() * b;
    2.0 * atan2(between.imag().norm(), between.w.abs())
}

/// How far a rotation turns about an axis of length 1, rad, −2π..=2π: a turn more or less is the same.
pub fn turned_about(rotation: &UnitQuaternion<f64>, axis: &Vector3<f64>) -> f64 {
    2.0 * atan2(rotation.imag().dot(axis), rotation.w)
}

/// Of the angles a turn apart the one in −π..=π, rad.
pub fn less_turns(angle: f64) -> f64 {
    angle - TAU * round(angle / TAU)
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::PI;
    use proptest::prelude::*;

    fn direction() -> impl Strategy<Value = Vector3<f64>> {
        (-1.0..1.0f64, 0.0..core::f64::consts::TAU).prop_map(|(z, a)| {
            Vector3::new(libm::cos(a) * libm::sqrt(1.0 - z * z), sin(a) * libm::sqrt(1.0 - z * z), z)
        })
    }

    fn twist() -> impl Strategy<Value = Twist> {
        let angle = prop_oneof![Just(0.0), Just(1e-12), Just(1e-5), 1e-3..1e-1, 0.1..3.0, Just(PI - 1e-6)];
        (direction(), angle, direction(), 0.0..5.0)
            .prop_map(|(axis, angle, way, length)| Twist { rotation: axis * angle, translation: way * length })
    }

    proptest! {
        #[test]
        fn log_undoes_exp_from_nothing_to_half_a_turn(twist in twist()) {
            let back = Twist::log(&twist.exp());
            // Near half a turn V⁻¹ amplifies rounding a little.
            prop_assert!((back.vector() - twist.vector()).norm() < 1e-9, "{twist:?} {back:?}");
        }

        #[test]
        fn exp_of_opposite_twists_are_inverses(twist in twist()) {
            let opposite = Twist::from_vector(&-twist.vector());
            let both = twist.exp() * opposite.exp();
            prop_assert!(both.translation.vector.norm() < 1e-12 && both.rotation.angle() < 1e-7);
        }

        #[test]
        fn adjoint_moves_a_twist_to_another_frame(place in twist(), step in twist()) {
            let motion = place.exp();
            let here = motion * step.exp() * motion.inverse();
            let there = Twist::from_vector(&(adjoint(&motion) * step.vector())).exp();
            prop_assert!((here.translation.vector - there.translation.vector).norm() < 1e-9);
            prop_assert!(angle_between(&here.rotation, &there.rotation) < 1e-7);
        }

        #[test]
        fn the_left_jacobian_and_its_inverse_are_inverses(twist in twist()) {
            let product = left_jacobian(&twist.rotation) * inverse_left_jacobian(&twist.rotation);
            prop_assert!((product - Matrix3::identity()).norm() < 1e-9);
        }

        #[test]
        fn a_step_beside_a_twist_is_the_left_jacobians_before_it(twist in twist(), way in direction(), turn in direction()) {
            let step = Twist::new(turn * 1e-6, way * 1e-6).vector();
            let there = Twist::from_vector(&(twist.vector() + step)).exp();
            let beside = Twist::from_vector(&(twist.left_jacobian() * step)).exp() * twist.exp();
            let off = Twist::log(&(there * beside.inverse())).vector().norm();
            prop_assert!(off < 1e-9, "{off:e}");
        }

        #[test]
        fn the_rotation_is_rodrigues(twist in twist()) {
            // exp θ = I + A[θ]× + B[θ]×², A = sin a/a, B = (1 − cos a)/a².
            let (a, b, _) = coefficients(twist.rotation.norm());
            let cross = skew(&twist.rotation);
            let expected = Matrix3::identity() + cross * a + cross * cross * b;
            let found = exp_rotation(&twist.rotation).to_rotation_matrix().into_inner();
            prop_assert!((found - expected).norm() < 1e-12);
        }
    }

    #[test]
    fn series_and_closed_form_meet_where_one_takes_over_from_the_other() {
        for angle in [SMALL, SMALL_INVERSE] {
            let axis = Vector3::new(0.6, 0.0, 0.8);
            let (below, above) = (axis * (angle * (1.0 - 1e-12)), axis * (angle * (1.0 + 1e-12)));
            assert!((left_jacobian(&below) - left_jacobian(&above)).norm() < 1e-11);
            assert!((inverse_left_jacobian(&below) - inverse_left_jacobian(&above)).norm() < 1e-11);
        }
    }

    #[test]
    fn a_quarter_turn_about_z_with_a_step_along_x_is_an_arc() {
        // θ = (0, 0, π/2), ρ = (1, 0, 0): V ρ = (sin a/a, (1 − cos a)/a, 0) = (2/π, 2/π, 0).
        let motion = Twist::new(Vector3::z() * (PI / 2.0), Vector3::x()).exp();
        assert!((motion.translation.vector - Vector3::new(2.0 / PI, 2.0 / PI, 0.0)).norm() < 1e-15);
    }
}
