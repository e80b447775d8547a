//! How long the core's steps take: a histogram of the last minute, for health.

use std::time::{Duration, Instant};

use tumbled_model::Body;

use crate::stream::StepHealth;

/// Buckets to an octave: a percentile is told to within 19 %.
const PER_OCTAVE: usize = 4;
/// From 1 µs to 16 s.
const BUCKETS: usize = 24 * PER_OCTAVE;
/// Two windows of this make the last minute.
const WINDOW: Duration = Duration::from_secs(30);

/// Steps told apart.
const NAMES: [&str; 3] = ["lidar packet", "depth frame", "other event"];

/// The durations of the core's steps.
#[derive(Debug)]
pub struct StepTimes {
    windows: [[Histogram; NAMES.len()]; 2],
    turned: Instant,
}

impl StepTimes {
    /// No steps yet.
    pub fn new() -> Self {
        Self { windows: Default::default(), turned: Instant::now() }
    }

    /// Adds the step of an event.
    pub fn add(&mut self, body: &Body, took: Duration) {
        if self.turned.elapsed() >= WINDOW {
            self.turned = Instant::now();
            self.windows.swap(0, 1);
            self.windows[0] = Default::default();
        }
        let kind = match body {
            Body::LidarPacket { .. } => 0,
            Body::DepthFrame { .. } => 1,
            _ => 2,
        };
        self.windows[0][kind].add(took);
    }

    /// What they took in the last half to whole minute; steps that did not happen are left out.
    pub fn report(&self) -> Vec<StepHealth> {
        let [now, before] = &self.windows;
        let all = NAMES.iter().zip(now.iter().zip(before)).map(|(name, (now, before))| (name, now.with(before)));
        all.filter(|(_, steps)| steps.count > 0)
            .map(|(name, steps)| StepHealth {
                name: (*name).to_owned(),
                p50_ms: whole_us(steps.percentile_ms(0.5)),
                p99_ms: whole_us(steps.percentile_ms(0.99)),
                max_ms: whole_us(steps.max.as_secs_f64() * 1e3),
            })
            .collect()
    }
}

/// People read it: no clock tells more.
fn whole_us(ms: f64) -> f64 {
    (ms * 1e3).round() / 1e3
}

impl Default for StepTimes {
    fn default() -> Self {
        Self::new()
    }
}

/// Durations of a whole session.
#[derive(Clone, Debug)]
pub(super) struct Histogram {
    buckets: [u32; BUCKETS],
    count: u64,
    max: Duration,
}

impl Default for Histogram {
    fn default() -> Self {
        Self { buckets: [0; BUCKETS], count: 0, max: Duration::ZERO }
    }
}

impl Histogram {
    pub(super) fn add(&mut self, took: Duration) {
        let micros = took.as_secs_f64() * 1e6;
        let bucket = (micros.max(1.0).log2() * PER_OCTAVE as f64) as usize;
        self.buckets[bucket.min(BUCKETS - 1)] += 1;
        self.count += 1;
        self.max = self.max.max(took);
    }

    fn with(&self, other: &Self) -> Self {
        let mut sum = self.clone();
        sum.buckets.iter_mut().zip(&other.buckets).for_each(|(count, more)| *count += more);
        sum.count += other.count;
        sum.max = sum.max.max(other.max);
        sum
    }

    /// The percentile, if anything was added.
    pub(super) fn known_percentile_ms(&self, share: f64) -> Option<f64> {
        (self.count > 0).then(|| self.percentile_ms(share))
    }

    /// The upper bound of the bucket in which the percentile lies, and no more than the longest.
    fn percentile_ms(&self, share: f64) -> f64 {
        let rank = (share * self.count as f64).ceil() as u64;
        let mut seen = 0;
        let reached = |count: &u32| {
            seen += u64::from(*count);
            seen >= rank
        };
        let bucket = self.buckets.iter().position(reached).unwrap_or(BUCKETS - 1);
        let upper_us = ((bucket + 1) as f64 / PER_OCTAVE as f64).exp2();
        (upper_us * 1e-3).min(self.max.as_secs_f64() * 1e3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_right_to_a_quarter_of_an_octave() {
        let mut steps = StepTimes::new();
        for micros in 1..=1_000 {
            steps.add(&Body::Tick, Duration::from_micros(micros));
        }
        let [report] = steps.report().try_into().expect("one kind");
        // The half: 500 µs, told as at most 2^0.25 = 1.19 times that; 99 %: 990 µs; the longest: 1 ms.
        assert!((0.5..=0.595).contains(&report.p50_ms), "{}", report.p50_ms);
        assert!((0.99..=1.0).contains(&report.p99_ms), "{}", report.p99_ms);
        assert_eq!((report.name.as_str(), report.max_ms), ("other event", 1.0));
    }
}
