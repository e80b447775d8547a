//! The oracle: the full geometric product of G(4,1), 32 components, nothing clever.

use nalgebra::Quaternion;
use tumbled_core::cga::{Conformal, Motor};

/// Components over the products of the orthonormal e1, e2, e3, e+, e−; bit n of an index: the n-th is a factor.
#[derive(Clone, Debug)]
pub(crate) struct Multivector([f64; 32]);

const E1: usize = 1;
const E2: usize = 2;
const E3: usize = 4;
const PLUS: usize = 8;
const MINUS: usize = 16;

/// What the product of two basis blades is: its sign and its index. Sign: −1 per pair that has to change places, and −1
/// for e− squared.
fn blades(a: usize, b: usize) -> (f64, usize) {
    let mut swaps = 0;
    for shift in 1..5 {
        swaps += ((a >> shift) & b).count_ones();
    }
    let squares = u32::from(a & b & MINUS != 0);
    (if (swaps + squares) % 2 == 0 { 1.0 } else { -1.0 }, a ^ b)
}

impl Multivector {
    pub(crate) fn scalar(value: f64) -> Self {
        let mut components = [0.0; 32];
        components[0] = value;
        Self(components)
    }

    /// e0 = ½(e− − e+), e∞ = e− + e+.
    pub(crate) fn vector(x: &Conformal<f64>) -> Self {
        let mut v = Self::scalar(0.0);
        v.0[E1] = x.euclidean.x;
        v.0[E2] = x.euclidean.y;
        v.0[E3] = x.euclidean.z;
        v.0[PLUS] = x.infinity - 0.5 * x.origin;
        v.0[MINUS] = x.infinity + 0.5 * x.origin;
        v
    }

    /// `M = T R`, `R = w − (u₁ e2e3 + u₂ e3e1 + u₃ e1e2)`, `T = 1 − ½ t e∞`.
    pub(crate) fn motor(motor: &Motor) -> Self {
        let Quaternion { coords } = motor.rotor();
        let mut rotor = Self::scalar(coords.w);
        rotor.0[E2 | E3] = -coords.x;
        rotor.0[E1 | E3] = coords.y;
        rotor.0[E1 | E2] = -coords.z;
        let t = Self::vector(&Conformal::new(motor.translation(), 0.0, 0.0));
        let infinity = Self::vector(&Conformal::new(nalgebra::Vector3::zeros(), 0.0, 1.0));
        let translator = Self::scalar(1.0).plus(&t.times(&infinity).scaled(-0.5));
        translator.times(&rotor)
    }

    pub(crate) fn times(&self, other: &Self) -> Self {
        let mut product = Self::scalar(0.0);
        for (a, x) in self.0.iter().enumerate() {
            for (b, y) in other.0.iter().enumerate() {
                let (sign, blade) = blades(a, b);
                product.0[blade] += sign * x * y;
            }
        }
        product
    }

    pub(crate) fn plus(&self, other: &Self) -> Self {
        let mut sum = self.clone();
        for (to, value) in sum.0.iter_mut().zip(&other.0) {
            *to += value;
        }
        sum
    }

    pub(crate) fn scaled(&self, factor: f64) -> Self {
        Self(self.0.map(|component| component * factor))
    }

    /// Every blade's factors in the opposite order: of k factors k(k−1)/2 pairs change places.
    pub(crate) fn reversed(&self) -> Self {
        let mut reversed = self.clone();
        for (blade, component) in reversed.0.iter_mut().enumerate() {
            if matches!(blade.count_ones() % 4, 2 | 3) {
                *component = -*component;
            }
        }
        reversed
    }

    /// The symmetric part's scalar: `½(XY + YX)`, for vectors their inner product.
    pub(crate) fn inner(&self, other: &Self) -> f64 {
        let both = self.times(other).plus(&other.times(self)).scaled(0.5);
        both.0[0]
    }

    /// `M X M̃`.
    pub(crate) fn sandwich(&self, object: &Self) -> Self {
        self.times(object).times(&self.reversed())
    }

    /// The largest difference of any component.
    pub(crate) fn difference(&self, other: &Self) -> f64 {
        self.0.iter().zip(&other.0).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }
}

#[test]
fn the_basis_has_the_metric_of_conformal_space() {
    let unit = |n: usize| {
        let mut parts = [0.0; 5];
        parts[n] = 1.0;
        let [x, y, z, origin, infinity] = parts;
        Multivector::vector(&Conformal::new(nalgebra::Vector3::new(x, y, z), origin, infinity))
    };
    for a in 0..5 {
        for b in 0..5 {
            // Orthonormal e1, e2, e3; null e0 and e∞ with e0·e∞ = −1.
            let expected = match (a, b) {
                (3, 4) | (4, 3) => -1.0,
                _ if a == b && a < 3 => 1.0,
                _ => 0.0,
            };
            assert_eq!(unit(a).inner(&unit(b)), expected, "{a} {b}");
        }
    }
}
