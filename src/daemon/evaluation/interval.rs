//! From when on states are scored: after the first revolution, in which the model of the target is made.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use tumbled_core::evaluate::{EncoderSample, TruthSample};
use tumbled_model::RigNs;

/// A target that turns less, rad, is at rest: 5°.
pub const AT_REST: f64 = 5.0 / 360.0 * TAU;

/// How far something has turned, rad, at times in their order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Travel(Vec<(RigNs, f64)>);

impl Travel {
    /// By the true rates, trapezoids.
    pub fn of_truth(samples: &[TruthSample]) -> Self {
        let mut travel = 0.0;
        let mut last: Option<&TruthSample> = None;
        let steps = samples.iter().map(|sample| {
            if let Some(last) = last.replace(sample) {
                let rate = |w: &Vector3<f64>| w.norm();
                let mean = 0.5 * (rate(&last.angular_velocity_rps) + rate(&sample.angular_velocity_rps));
                travel += mean * (sample.t - last.t).as_secs_f64();
            }
            (sample.t, travel)
        });
        Self(steps.collect())
    }

    /// By the encoder, to and fro.
    pub fn of_encoder(samples: &[EncoderSample]) -> Self {
        let mut travel = 0.0;
        let mut last: Option<f64> = None;
        let steps = samples.iter().map(|sample| {
            travel += last.replace(sample.angle_rad).map_or(0.0, |last| (sample.angle_rad - last).abs());
            (sample.t, travel)
        });
        Self(steps.collect())
    }

    /// How far it has turned until `t`; before the first time 0.
    fn until(&self, t: RigNs) -> f64 {
        let next = self.0.partition_point(|(at, _)| *at <= t);
        next.checked_sub(1).and_then(|before| self.0.get(before)).map_or(0.0, |(_, travel)| *travel)
    }

    /// How far it turns between two times, rad.
    pub fn between(&self, from: RigNs, to: RigNs) -> f64 {
        self.until(to) - self.until(from)
    }

    /// When it has turned by `angle`, rad, since `from`; `None`: it never has.
    pub fn after(&self, from: RigNs, angle: f64) -> Option<RigNs> {
        let wanted = self.until(from) + angle;
        let reached = self.0.partition_point(|(_, travel)| *travel < wanted);
        self.0.get(reached).map(|(t, _)| (*t).max(from))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;

    use super::*;

    const S: i64 = 1_000_000_000;

    #[test]
    fn a_revolution_at_20_degrees_a_second_is_over_18_seconds_after_it_began() {
        let rate = 20.0 / 360.0 * TAU;
        let sample = |n: i64| TruthSample {
            t: RigNs(n * S / 10),
            t_rig_target: Isometry3::identity(),
            angular_velocity_rps: Vector3::z() * -rate,
        };
        let truth = Travel::of_truth(&(0..=300).map(sample).collect::<Vec<_>>());
        let angle = |n: i64| EncoderSample { t: RigNs(n * S / 10), angle_rad: 3.0 - rate * n as f64 / 10.0 };
        let encoder = Travel::of_encoder(&(0..=300).map(angle).collect::<Vec<_>>());
        for travel in [truth, encoder] {
            let end = travel.after(RigNs(2 * S), TAU).expect("reached");
            // To the next sample.
            assert!((end.0 - 20 * S).abs() <= S / 10, "{end:?}");
            assert_eq!(travel.after(RigNs(15 * S), TAU), None, "30 s end before 33 s");
            assert!((travel.between(RigNs(0), RigNs(30 * S)) - 30.0 * rate).abs() < 1e-9);
        }
    }

    #[test]
    fn what_rests_does_not_turn() {
        let rest = Travel::of_encoder(&[EncoderSample { t: RigNs(0), angle_rad: 1.0 }; 2]);
        assert_eq!((rest.after(RigNs(0), TAU), rest.between(RigNs(0), RigNs(S)) < AT_REST), (None, true));
    }
}
