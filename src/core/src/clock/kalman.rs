//! A mean-delay filter, for comparison: a Kalman filter over offset and skew that takes delay for two-sided noise.
//!
//! Its offset is late by the mean delay, which moves with the host's load; the hull's is not.

use super::hull::Pair;
use super::line::Line;

/// Random walk of the offset, ns²/s: 1 µs/√s.
const OFFSET_WALK: f64 = 1e6;
/// Random walk of the skew, 1/s: 0.02 ppm/√s.
const SKEW_WALK: f64 = 4e-16;
/// Skew before anything is known: 100 ppm, the tolerance of a cheap crystal.
const SKEW_SIGMA: f64 = 100e-6;

/// Offset (ns) and skew (1) at the newest pair, and their covariance.
#[derive(Clone, Copy, Debug)]
pub(super) struct MeanDelayFilter {
    x: i64,
    offset: f64,
    skew: f64,
    p_offset: f64,
    p_cross: f64,
    p_skew: f64,
    noise: f64,
}

impl MeanDelayFilter {
    /// Starts at the epoch's first pair, (0, 0), whose delay has the given standard deviation, ns.
    pub(super) fn new(arrival_sigma_ns: i64, skew: f64) -> Self {
        let noise = (arrival_sigma_ns as f64) * (arrival_sigma_ns as f64);
        Self { x: 0, offset: 0.0, skew, p_offset: noise, p_cross: 0.0, p_skew: SKEW_SIGMA * SKEW_SIGMA, noise }
    }

    /// Takes one pair; an older one than the newest is left out.
    pub(super) fn push(&mut self, pair: Pair) {
        if pair.x <= self.x {
            return;
        }
        let dx = (pair.x - self.x) as f64;
        let seconds = dx * 1e-9;
        self.x = pair.x;
        self.offset += self.skew * dx;
        self.p_offset += dx * (2.0 * self.p_cross + dx * self.p_skew) + OFFSET_WALK * seconds;
        self.p_cross += dx * self.p_skew;
        self.p_skew += SKEW_WALK * seconds;

        let residual = pair.y as f64 - self.offset;
        let variance = self.p_offset + self.noise;
        let (gain_offset, gain_skew) = (self.p_offset / variance, self.p_cross / variance);
        self.offset += gain_offset * residual;
        self.skew += gain_skew * residual;
        self.p_skew -= gain_skew * self.p_cross;
        self.p_cross *= 1.0 - gain_offset;
        self.p_offset *= 1.0 - gain_offset;
    }

    /// The clock as the filter has it.
    pub(super) fn line(&self) -> Line {
        Line { x: self.x, y: (self.offset + 0.5).floor() as i64, slope: self.skew }
    }

    /// Standard deviation of the offset as the filter believes it, ns.
    pub(super) fn sigma_ns(&self) -> i64 {
        self.p_offset.max(0.0).sqrt() as i64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_skewed_clock_without_delay_is_found() {
        let mut filter = MeanDelayFilter::new(300_000, 0.0);
        for i in 1..=3_000 {
            filter.push(Pair { x: i * 10_000_000, y: i * 500 }); // 500 ns in 10 ms: 50 ppm
        }
        let line = filter.line();
        assert!((line.slope - 50e-6).abs() < 0.5e-6, "{line:?}");
        assert!((line.y - 1_500_000).abs() < 2_000, "{line:?}");
    }
}
