//! Candidates, best first; which of them are one, and how probable each mode is.

use super::pose::Pose;
use core::cmp::Ordering;

/// A pose and its score.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Candidate {
    /// The pose.
    pub(super) pose: Pose,
    /// How well it explains what both sensors saw.
    pub(super) score: f32,
}

/// Nearer than this, rad and m, two candidates have come to the same place: 4.5° and 5 cm.
pub(super) const SAME: (f32, f32) = (4.5 / 180.0 * core::f32::consts::PI, 0.05);
/// Farther than this, rad or m, they are different answers: 11.5° and 15 cm.
pub(super) const OTHER: (f32, f32) = (11.5 / 180.0 * core::f32::consts::PI, 0.15);

/// Best first; of equal scores the one found first.
pub(super) fn sort(candidates: &mut [Candidate]) {
    candidates.sort_by(|a, b| b.score.partial_cmp(&a.score).unwrap_or(Ordering::Equal));
}

/// Of sorted candidates the best of each place, `most` at most.
pub(super) fn distinct(candidates: &[Candidate], (angle_rad, distance_m): (f32, f32), most: usize) -> Vec<Candidate> {
    let mut kept: Vec<Candidate> = Vec::with_capacity(most.min(candidates.len()));
    for candidate in candidates {
        if kept.len() == most {
            break;
        }
        if !kept.iter().any(|other| other.pose.is_near(&candidate.pose, angle_rad, distance_m)) {
            kept.push(*candidate);
        }
    }
    kept
}

/// Probabilities of modes from their scores, of which each tenth is worth `beta`/10 in log odds.
pub(super) fn probabilities(modes: &[Candidate], beta: f64) -> Vec<f64> {
    let best = modes.iter().map(|mode| f64::from(mode.score)).fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = modes.iter().map(|mode| libm::exp(beta * (f64::from(mode.score) - best))).collect();
    let sum: f64 = weights.iter().sum();
    weights.into_iter().map(|weight| weight / sum).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{UnitQuaternion, Vector3};

    fn candidate(turn_deg: f64, x_m: f64, score: f32) -> Candidate {
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn_deg.to_radians());
        Candidate { pose: Pose::new(&rotation, Vector3::new(x_m, 0.0, 3.0)), score }
    }

    #[test]
    fn candidates_of_one_place_count_once_and_the_best_stands_for_them() {
        let mut all =
            [candidate(4.0, 0.0, 0.5), candidate(0.0, 0.0, 0.9), candidate(0.0, 0.06, 0.7), candidate(5.0, 0.0, 0.6)];
        sort(&mut all);
        let kept = distinct(&all, SAME, 10);
        // 4° is the same place as 0°; 6 cm and 5° are others.
        assert_eq!(kept.iter().map(|one| one.score).collect::<Vec<_>>(), [0.9, 0.7, 0.6]);
        assert_eq!(distinct(&all, SAME, 2).len(), 2);
    }

    #[test]
    fn two_modes_that_score_alike_are_equally_probable() {
        let modes = [candidate(0.0, 0.0, 1.0), candidate(180.0, 0.0, 1.0)];
        assert_eq!(probabilities(&modes, 35.0), [0.5, 0.5]);
        // A lead of 0.1 at 35 a unit: 1/(1 + exp(−3.5)) = 0.9707.
        let modes = [candidate(0.0, 0.0, 1.0), candidate(180.0, 0.0, 0.9)];
        let found = probabilities(&modes, 35.0);
        assert!((found[0] - 0.970_687_8).abs() < 1e-5, "{found:?}");
    }
}
