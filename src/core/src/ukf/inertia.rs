//! An unknown body's inertia: `J = exp(S)`, S symmetric without trace.
//!
//! Rotation free of torque knows the inertia up to its scale: five numbers. The body's axes are whatever the first cloud
//! gave it, so two ratios of principal moments would not do. Whatever the five numbers are, J is positive definite.

use nalgebra::{Matrix3, SVector};

/// The inertia tensor and its inverse, up to a common scale; body axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Inertia {
    pub(super) tensor: Matrix3<f64>,
    pub(super) inverse: Matrix3<f64>,
}

impl Inertia {
    /// From the coordinates of S in an orthogonal basis whose members all have the length √2: the prior prefers no axis.
    pub(super) fn new(s: &SVector<f64, 5>) -> Self {
        let third = s[1] / SQRT_3;
        let logarithm = Matrix3::new(s[0] + third, s[2], s[3], s[2], third - s[0], s[4], s[3], s[4], -2.0 * third);
        Self { tensor: exponential(&logarithm), inverse: exponential(&-logarithm) }
    }
}

const SQRT_3: f64 = 1.732_050_807_568_877_2;
/// Terms of the series: at a norm of 1/4 the next is below 1e-16.
const TERMS: u32 = 11;

/// The matrix exponential by its series, of a fraction of the matrix, squared again.
fn exponential(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    let mut halvings = 0;
    let mut scaled = *matrix;
    while scaled.norm() > 0.25 && halvings < 32 {
        scaled *= 0.5;
        halvings += 1;
    }
    let mut term = Matrix3::identity();
    let mut sum = term;
    for k in 1..=TERMS {
        term = term * scaled / f64::from(k);
        sum += term;
    }
    for _ in 0..halvings {
        sum *= sum;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn it_is_symmetric_positive_of_determinant_one(s in proptest::array::uniform5(-1.5..1.5f64)) {
            let inertia = Inertia::new(&SVector::from(s));
            prop_assert!((inertia.tensor * inertia.inverse - Matrix3::identity()).norm() < 1e-11);
            // det exp S = exp(tr S) = 1.
            prop_assert!((inertia.tensor.determinant() - 1.0).abs() < 1e-11);
            prop_assert!((inertia.tensor - inertia.tensor.transpose()).norm() < 1e-12);
            prop_assert!(inertia.tensor.cholesky().is_some());
        }
    }

    #[test]
    fn along_its_own_axes_it_is_the_exponential_of_each() {
        // s = (a, 0, …): J = diag(eᵃ, e⁻ᵃ, 1).
        let inertia = Inertia::new(&SVector::from([0.4, 0.0, 0.0, 0.0, 0.0]));
        let expected = Matrix3::from_diagonal(&[libm::exp(0.4), libm::exp(-0.4), 1.0].into());
        assert!((inertia.tensor - expected).norm() < 1e-14);
    }
}
