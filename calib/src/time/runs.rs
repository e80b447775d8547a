//! Runs of one rate in an encoder's angles.

use core::f64::consts::TAU;

use super::TimedAngle;

/// The rate is the encoder's difference over so long, s.
const STEP_S: f64 = 0.5;
/// A rate that differs by more from the run's is another run's.
const EVEN: f64 = 0.03;
/// What turns more slowly rests, rad/s: 0.5 °/s.
const LEAST_RATE: f64 = 0.5 / 360.0 * TAU;
/// A gap in the states ends a run, s.
const LONGEST_GAP_S: f64 = 1.0;

/// A stretch of samples at one rate.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Run<'a> {
    pub(super) samples: &'a [TimedAngle],
    /// rad/s, by the run's ends.
    pub(super) rate_rps: f64,
}

impl<'a> Run<'a> {
    fn of(samples: &'a [TimedAngle]) -> Option<Self> {
        let (first, last) = (samples.first()?, samples.last()?);
        let took = last.t_s - first.t_s;
        (took > 0.0).then(|| Self { samples, rate_rps: (last.encoder_rad - first.encoder_rad) / took })
    }

    /// Without its beginning, in which a filter settles, s.
    pub(super) fn settled(self, settle_s: f64) -> Option<Self> {
        let from = self.samples.first()?.t_s + settle_s;
        Self::of(self.samples.get(self.samples.partition_point(|sample| sample.t_s < from)..)?)
    }

    /// Its last whole turns, one by one, in the order of time; empty: it has none.
    pub(super) fn turns(&self) -> Vec<&'a [TimedAngle]> {
        let Some(last) = self.samples.last() else { return Vec::new() };
        let behind = |sample: &TimedAngle| (last.encoder_rad - sample.encoder_rad).abs();
        let count = self.samples.first().map_or(0, |first| (behind(first) / TAU) as usize);
        let at = |turns: usize| self.samples.partition_point(|sample| behind(sample) > TAU * turns as f64);
        let turn = |n: usize| self.samples.get(at(n + 1)..at(n)).unwrap_or_default();
        (0..count).rev().map(turn).collect()
    }
}

/// The runs of one rate, in the order of time; rests are none.
pub(super) fn runs(samples: &[TimedAngle]) -> Vec<Run<'_>> {
    let rates: Vec<Option<f64>> = samples.iter().map(|sample| rate(samples, sample.t_s)).collect();
    let mut runs = Vec::new();
    let mut begin: Option<(usize, f64)> = None;
    let mut close = |from: usize, to: usize| runs.extend(samples.get(from..to).and_then(Run::of));
    for (n, (sample, rate)) in samples.iter().zip(&rates).enumerate() {
        let gap = n.checked_sub(1).and_then(|before| samples.get(before));
        let broken = gap.is_some_and(|before| sample.t_s - before.t_s > LONGEST_GAP_S);
        let moving = rate.filter(|rate| rate.abs() >= LEAST_RATE);
        let goes_on = begin.zip(moving).is_some_and(|((_, of), rate)| (rate - of).abs() <= EVEN * of.abs() && !broken);
        if !goes_on {
            if let Some((from, _)) = begin.take() {
                close(from, n);
            }
            begin = moving.map(|rate| (n, rate));
        }
    }
    if let Some((from, _)) = begin {
        close(from, samples.len());
    }
    runs
}

/// The encoder's rate about a time, rad/s; `None`: at the ends and in gaps.
fn rate(samples: &[TimedAngle], t_s: f64) -> Option<f64> {
    let from = samples.partition_point(|sample| sample.t_s < t_s - STEP_S / 2.0);
    let to = samples.partition_point(|sample| sample.t_s <= t_s + STEP_S / 2.0).checked_sub(1)?;
    let (a, b) = (samples.get(from)?, samples.get(to)?);
    let took = b.t_s - a.t_s;
    (took > STEP_S / 2.0).then(|| (b.encoder_rad - a.encoder_rad) / took)
}
