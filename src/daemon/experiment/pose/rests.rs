//! When a target rests, and where it is then.

use tumbled_core::TurntableSample;
use tumbled_model::{RigNs, Span};

use super::methods::Posed;

/// What turns less than this rests, rad/s: 0.5 °/s. The published steps are made at 5 °/s.
const SLOW: f64 = 0.5 / 180.0 * core::f64::consts::PI;
/// A rest lasts at least so long: filters need a part of it.
const SHORTEST: Span = Span(500_000_000);
/// Encoder readings this far from the first one of a rest are no longer of it, rad: 0.1°.
const STEPS_OFF: f64 = 0.1 / 180.0 * core::f64::consts::PI;

/// A time in which a target rests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rest {
    /// Its first instant.
    pub from: RigNs,
    /// Its last one.
    pub until: RigNs,
}

/// By rates of turning at times in their order.
pub fn by_rate(rates: impl Iterator<Item = (RigNs, f64)>) -> Vec<Rest> {
    let mut rests = Vec::new();
    let mut open: Option<Rest> = None;
    for (t, rate) in rates {
        if rate < SLOW {
            let from = open.map_or(t, |rest| rest.from);
            open = Some(Rest { from, until: t });
        } else {
            rests.extend(open.take());
        }
    }
    rests.extend(open);
    long(rests)
}

/// By a turntable's encoder; each with its angle, rad, the mean of the readings.
pub fn by_encoder(samples: &[TurntableSample]) -> Vec<(Rest, f64)> {
    let Some(sensor) = samples.first().map(|sample| &sample.sensor) else { return Vec::new() };
    let mut rests: Vec<(Rest, f64)> = Vec::new();
    let mut readings: Vec<(RigNs, f64)> = Vec::new();
    let close = |readings: &mut Vec<(RigNs, f64)>, rests: &mut Vec<(Rest, f64)>| {
        if let (Some((from, _)), Some((until, _))) = (readings.first(), readings.last())
            && *until - *from >= SHORTEST
        {
            let mean = readings.iter().map(|(_, angle)| angle).sum::<f64>() / readings.len() as f64;
            rests.push((Rest { from: *from, until: *until }, mean));
        }
        readings.clear();
    };
    for sample in samples.iter().filter(|sample| sample.sensor == *sensor && sample.is_truth) {
        if readings.first().is_some_and(|(_, angle)| (sample.angle_rad - angle).abs() > STEPS_OFF) {
            close(&mut readings, &mut rests);
        }
        readings.push((sample.t, sample.angle_rad));
    }
    close(&mut readings, &mut rests);
    rests
}

fn long(rests: Vec<Rest>) -> Vec<Rest> {
    rests.into_iter().filter(|rest| rest.until - rest.from >= SHORTEST).collect()
}

impl Rest {
    /// What was said last while it rested; `None`: nothing.
    pub fn last(&self, poses: &[Posed]) -> Option<Posed> {
        poses.iter().rfind(|pose| pose.t >= self.from && pose.t <= self.until).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    #[test]
    fn rests_are_where_the_rate_is_small_for_half_a_second() {
        // Rests of 1 s, moves of 1 s at 10°/s, a slow instant of 0.1 s within the first move.
        let rate = |ms: i64| match ms {
            1_400..1_500 => 0.0,
            _ if (ms / 1_000) % 2 == 1 => 10f64.to_radians(),
            _ => 1e-4,
        };
        let rests = by_rate((0..5_000).step_by(10).map(|ms| (RigNs(ms * MS), rate(ms))));
        let found: Vec<(i64, i64)> = rests.iter().map(|rest| (rest.from.0 / MS, rest.until.0 / MS)).collect();
        assert_eq!(found, [(0, 990), (2_000, 2_990), (4_000, 4_990)]);
    }
}
