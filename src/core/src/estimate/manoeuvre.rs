//! A motion that has changed: how much is known of it after fits beyond doubt were refused.
//!
//! Refused fits say how far off the prediction is, and by how much more from one to the next. A stage that stops is off by
//! more every frame; a sensor whose slow error has stepped, as when a side comes into view at the end of its range, is off by
//! the same. Both widen the pose; only what grows widens the motion. A sensor that is off while another one agrees with the
//! prediction is off alone, and no motion has changed.

use crate::ukf::Disturbance;
use nalgebra::{Isometry3, Vector3};
use tumbled_model::se3::Twist;
use tumbled_model::{RigNs, Span};

/// What may be unknown of a motion at most, one axis: m/s and rad/s (90°/s). So much is also said where nothing tells.
pub(super) const MOST: Disturbance =
    Disturbance { velocity_mps: 0.3, rate_rps: core::f64::consts::FRAC_PI_2, unnoticed_s: UNNOTICED_S };
/// And at least: 1°/s.
const LEAST: (f64, f64) = (0.01, 0.017);
/// So many times what is seen to grow, beyond such a share of what a fit is off: fits scatter.
const DOUBT: f64 = 2.0;
const SCATTER: f64 = 0.35;
/// So long it goes unnoticed, s: the frames that were refused.
const UNNOTICED_S: f64 = 0.1;
/// So long after it the motion may go on changing, from epoch to epoch by such a share of what is unknown of it.
pub(super) const UNSTEADY_FOR: Span = Span(400_000_000);
const UNSTEADY: (f64, f64) = (1.0 / 6.0, 1.0 / 9.0);
/// Refusals that are remembered.
const KEPT: usize = 8;

/// What every epoch adds to a disturbance while the motion may go on changing.
pub(super) fn going_on(disturbance: &Disturbance) -> Disturbance {
    let Disturbance { velocity_mps, rate_rps, .. } = disturbance;
    Disturbance { velocity_mps: velocity_mps * UNSTEADY.0, rate_rps: rate_rps * UNSTEADY.1, unnoticed_s: 0.0 }
}

/// Fits beyond doubt that were refused, in a row.
#[derive(Clone, Debug, Default)]
pub(super) struct Refusals {
    count: u32,
    /// Which sensor, when, and how far the fit was from the prediction: body axes.
    innovations: Vec<(usize, RigNs, Twist)>,
}

impl Refusals {
    /// One more.
    pub(super) fn push(&mut self, sensor: usize, t: RigNs, predicted: &Isometry3<f64>, fit: &Isometry3<f64>) {
        self.count += 1;
        if self.innovations.len() < KEPT {
            self.innovations.push((sensor, t, Twist::log(&(predicted.inverse() * fit))));
        }
    }

    /// The row is over.
    pub(super) fn clear(&mut self) {
        self.count = 0;
        self.innovations.clear();
    }

    /// Whether a sensor is among the refused.
    pub(super) fn has(&self, sensor: usize) -> bool {
        self.innovations.iter().any(|(refused, ..)| *refused == sensor)
    }

    /// How many.
    pub(super) const fn count(&self) -> u32 {
        self.count
    }

    /// What they leave unknown of the motion: by the first and the last of one sensor, for two sensors have different errors.
    pub(super) fn disturbance(&self) -> Disturbance {
        let pair = self.innovations.iter().rev().find_map(|last| {
            let (sensor, t, _) = last;
            self.innovations.iter().find(|(other, before, _)| other == sensor && before < t).map(|first| (first, last))
        });
        let Some(((_, from, first), (_, to, last))) = pair else { return MOST };
        let dt_s = (*to - *from).as_secs_f64();
        let unknown = |first: &Vector3<f64>, last: &Vector3<f64>, least: f64, most: f64| {
            let grown = (last - first).norm() - SCATTER * last.norm();
            (DOUBT * grown / dt_s).clamp(least, most)
        };
        let velocity_mps = unknown(&first.translation, &last.translation, LEAST.0, MOST.velocity_mps);
        let rate_rps = unknown(&first.rotation, &last.rotation, LEAST.1, MOST.rate_rps);
        let off = (last.translation.norm() / velocity_mps).max(last.rotation.norm() / rate_rps);
        Disturbance { velocity_mps, rate_rps, unnoticed_s: off.max(UNNOTICED_S) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(turn_deg: f64, shift_m: f64) -> Isometry3<f64> {
        Isometry3::new(Vector3::new(shift_m, 0.0, 0.0), Vector3::z() * turn_deg.to_radians())
    }

    /// Refusals 1/30 s apart.
    fn refused(off: &[(usize, f64, f64)]) -> Disturbance {
        let mut refusals = Refusals::default();
        for ((sensor, turn_deg, shift_m), frame) in off.iter().zip(1..) {
            let t = RigNs(frame * 33_333_333);
            refusals.push(*sensor, t, &Isometry3::identity(), &pose(*turn_deg, *shift_m));
        }
        refusals.disturbance()
    }

    #[test]
    fn what_grows_widens_the_motion_and_what_stays_the_pose_alone() {
        // A stage of 20°/s that has stopped: 0.67° more each frame. Of 1.33° in 67 ms 0.35 · 2° may be scatter; twice the rest.
        let stopped = refused(&[(0, 0.67, 0.0), (0, 1.33, 0.0), (0, 2.0, 0.0)]);
        assert!((stopped.rate_rps.to_degrees() - 18.9).abs() < 0.3, "{stopped:?}");
        // A step of 0.7°: as little as may be of the motion, and of the pose what it is off.
        let stepped = refused(&[(0, 0.7, 0.004), (0, 0.55, 0.003), (0, 0.7, 0.004)]);
        assert_eq!((stepped.velocity_mps, stepped.rate_rps), LEAST);
        let turn = stepped.rate_rps * stepped.unnoticed_s;
        assert!((turn.to_degrees() - 0.7).abs() < 0.01, "{stepped:?}");
    }

    #[test]
    fn two_sensors_are_not_held_against_each_other() {
        // Off by 2° against each other, and by the same each time.
        let stepped = refused(&[(0, 1.0, 0.0), (1, 3.0, 0.0), (0, 1.0, 0.0)]);
        assert_eq!(stepped.rate_rps, LEAST.1);
        assert_eq!(refused(&[(0, 1.0, 0.0), (1, 3.0, 0.0)]), MOST);
    }

    #[test]
    fn no_more_is_unknown_than_may_be() {
        let hit = refused(&[(0, 10.0, 0.0), (0, 60.0, 1.0), (0, 120.0, 2.0)]);
        assert_eq!((hit.velocity_mps, hit.rate_rps), (MOST.velocity_mps, MOST.rate_rps));
        let mut refusals = Refusals::default();
        for frame in 0..1000 {
            refusals.push(0, RigNs(frame), &Isometry3::identity(), &pose(1.0, 0.0));
        }
        assert_eq!((refusals.count(), refusals.innovations.len()), (1000, KEPT));
        refusals.clear();
        assert_eq!(refusals.disturbance(), MOST);
    }
}
