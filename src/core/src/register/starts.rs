//! Where a search begins: rotations spread over all of SO(3), or over a ball about a guess.

use core::f64::consts::{PI, SQRT_2, TAU};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// ψ of the super-Fibonacci spiral: the positive root of ψ⁴ = ψ + 4. (Alexa, Super-Fibonacci Spirals, CVPR 2022.)
const PSI: f64 = 1.533_751_168_755_204_3;

/// The golden ratio's fractional part: successive multiples of it fall evenly.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// `count` rotations spread evenly over all of SO(3): for 1500 of them the nearest is at most about 20° away.
pub(super) fn everywhere(count: usize) -> impl Iterator<Item = UnitQuaternion<f64>> {
    (0..count).map(move |index| {
        let s = index as f64 + 0.5;
        let t = s / count as f64;
        let (alpha, beta) = (TAU * s / SQRT_2, TAU * s / PSI);
        let (r, rest) = (libm::sqrt(t), libm::sqrt(1.0 - t));
        let (sa, ca, sb, cb) = (libm::sin(alpha), libm::cos(alpha), libm::sin(beta), libm::cos(beta));
        UnitQuaternion::new_normalize(Quaternion::new(rest * cb, r * sa, r * ca, rest * sb))
    })
}

/// `count` rotation vectors spread evenly over a ball of `radius_rad`; the first is none.
pub(super) fn ball(count: usize, radius_rad: f64) -> impl Iterator<Item = Vector3<f64>> {
    (0..count).map(move |index| {
        if index == 0 {
            return Vector3::zeros();
        }
        let n = index as f64;
        let fraction = |x: f64| x - libm::floor(x);
        // The radius by the cube root of an even number, the direction by a spiral: both low-discrepancy, so no seed.
        let radius = radius_rad * libm::cbrt((n - 0.5) / (count as f64 - 1.0));
        let z = 1.0 - 2.0 * fraction(n * GOLDEN);
        let azimuth = TAU * fraction(n * (SQRT_2 - 1.0));
        let across = libm::sqrt((1.0 - z * z).max(0.0));
        Vector3::new(across * libm::cos(azimuth), across * libm::sin(azimuth), z) * radius
    })
}

/// `count` pairs of a turn and a step, each of six numbers a standard normal one, low-discrepancy, from the `first`-th on.
pub(super) fn scatter(count: usize, first: usize) -> impl Iterator<Item = (Vector3<f64>, Vector3<f64>)> {
    // Additive recurrence by the powers of the root of x⁷ = x + 1 (Roberts 2018): even in six dimensions.
    const ROOT: f64 = 1.112_775_684_278_705_5;
    let mut steps = [0.0; 6];
    let mut power = 1.0;
    for step in &mut steps {
        power /= ROOT;
        *step = power;
    }
    (first + 1..=first + count).map(move |index| {
        let even = steps.map(|step| {
            let value = 0.5 + step * index as f64;
            value - libm::floor(value)
        });
        let [a, b, c, d, e, f] = even;
        // Box and Muller: two even numbers to two normal ones.
        let pair = |u: f64, v: f64| {
            let radius = libm::sqrt(-2.0 * libm::log(1.0 - u));
            (radius * libm::cos(TAU * v), radius * libm::sin(TAU * v))
        };
        let ((a, b), (c, d), (e, f)) = (pair(a, b), pair(c, d), pair(e, f));
        (Vector3::new(a, b, c), Vector3::new(d, e, f))
    })
}

/// The half and quarter turns about three axes: what box-like bodies are confused by.
pub(super) fn confusions(axes: &[Vector3<f64>; 3]) -> impl Iterator<Item = UnitQuaternion<f64>> {
    let turns = [PI, 0.5 * PI, -0.5 * PI];
    axes.iter().flat_map(move |axis| turns.map(|angle| tumbled_model::se3::exp_rotation(&(axis * angle))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use tumbled_model::se3::angle_between;

    #[test]
    fn every_rotation_has_one_of_1500_within_21_degrees() {
        let grid: Vec<_> = everywhere(1500).collect();
        // Any rotations do for the question; these lie between the grid's own: another count's spiral.
        let worst = everywhere(4001)
            .map(|rotation| grid.iter().map(|near| angle_between(near, &rotation)).fold(PI, f64::min))
            .fold(0.0, f64::max);
        assert!(worst.to_degrees() < 21.0, "{}", worst.to_degrees());
    }

    #[test]
    fn psi_is_the_root_it_is_said_to_be() {
        assert!((PSI * PSI * PSI * PSI - PSI - 4.0).abs() < 1e-14);
    }

    #[test]
    fn the_ball_holds_its_rotations_evenly() {
        let all: Vec<_> = ball(97, 0.25).collect();
        assert_eq!(all.first(), Some(&Vector3::zeros()));
        assert!(all.iter().all(|v| v.norm() <= 0.25));
        // An even ball has 1/8 of its points within half its radius, and its mean at its centre.
        let inner = all.iter().filter(|v| v.norm() < 0.125).count();
        assert!((10..=15).contains(&inner), "{inner}");
        let mean = all.iter().sum::<Vector3<f64>>() / 97.0;
        assert!(mean.norm() < 0.02, "{mean}");
    }

    #[test]
    fn the_scatter_is_normal_in_each_of_its_numbers() {
        let root = 1.112_775_684_278_705_5_f64;
        assert!((root * root * root * root * root * root * root - root - 1.0).abs() < 1e-12);
        let all: Vec<_> = scatter(2_000, 5).collect();
        for axis in 0..3 {
            for column in [
                all.iter().map(|(turn, _)| turn[axis]).collect::<Vec<_>>(),
                all.iter().map(|(_, step)| step[axis]).collect(),
            ] {
                let mean = column.iter().sum::<f64>() / 2_000.0;
                let variance = column.iter().map(|value| value * value).sum::<f64>() / 2_000.0;
                // Random numbers would be within 0.02 and 0.03 in one deviation.
                assert!(mean.abs() < 0.02 && (variance - 1.0).abs() < 0.05, "{mean} {variance}");
            }
        }
        assert_eq!(scatter(2, 7).next(), scatter(9, 0).nth(7));
    }

    #[test]
    fn confusions_are_nine_and_proper() {
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        let all: Vec<_> = confusions(&axes).collect();
        assert_eq!(all.len(), 9);
        for (a, one) in all.iter().enumerate() {
            assert!(one.angle() > 1.5);
            for other in all.iter().skip(a + 1) {
                assert!(angle_between(one, other) > 1.5);
            }
        }
    }
}
