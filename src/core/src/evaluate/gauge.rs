//! The body frame of an estimate is its own choice: the constant transform between it and the truth's.

use nalgebra::{Isometry3, Vector6};
use tumbled_model::Twist;

/// Rounds of the mean.
const ROUNDS: u32 = 5;
/// Settled: a mean shorter than this, rad and m together.
const SETTLED: f64 = 1e-12;

/// The gauge G that leaves no mean body twist of the error: estimate ≈ truth · G. Pairs of truth and estimate; `None`: no
/// pair.
pub(super) fn mean_gauge<'a>(
    pairs: impl Iterator<Item = (&'a Isometry3<f64>, &'a Isometry3<f64>)> + Clone,
) -> Option<Isometry3<f64>> {
    // From one of the pairs: the frames may be half a turn apart, and twists are averaged where they are small.
    let (truth, estimate) = pairs.clone().next()?;
    let mut gauge = truth.inverse() * estimate;
    for _ in 0..ROUNDS {
        let (mut sum, mut count) = (Vector6::zeros(), 0.0);
        for (truth, estimate) in pairs.clone() {
            sum += Twist::log(&((truth * gauge).inverse() * estimate)).vector();
            count += 1.0;
        }
        let mean = sum / count;
        gauge *= Twist::from_vector(&mean).exp();
        if mean.norm() < SETTLED {
            break;
        }
    }
    Some(gauge)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::made_up::{other_frame, turntable_pose};
    use nalgebra::Vector3;

    #[test]
    fn the_gauge_is_found_from_poses_that_scatter_about_it() {
        let truth: Vec<_> = (0..100).map(|n| turntable_pose(0.2 * f64::from(n))).collect();
        // Body twists that cancel by pairs.
        let error = |n: usize| {
            let sign = if n.is_multiple_of(2) { 1.0 } else { -1.0 };
            Twist::new(Vector3::new(0.01, -0.02, 0.005) * sign, Vector3::new(0.003, 0.0, -0.002) * sign).exp()
        };
        let estimates: Vec<_> = truth.iter().enumerate().map(|(n, pose)| pose * other_frame() * error(n)).collect();
        let found = mean_gauge(truth.iter().zip(&estimates)).expect("pairs");
        let off = Twist::log(&(other_frame().inverse() * found));
        assert!(off.vector().norm() < 1e-9, "{off:?}");
    }

    #[test]
    fn nothing_has_no_gauge() {
        assert_eq!(mean_gauge(core::iter::empty()), None);
    }
}
