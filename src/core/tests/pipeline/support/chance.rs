//! Seeded chance.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// The same seed gives the same numbers on every machine.
pub(crate) struct Chance(ChaCha8Rng);

impl Chance {
    pub(crate) fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// 0..n.
    pub(crate) fn below(&mut self, n: u64) -> u64 {
        self.0.next_u64() % n.max(1)
    }

    /// −limit..=limit.
    pub(crate) fn around(&mut self, limit: i64) -> i64 {
        self.below(2 * limit as u64 + 1) as i64 - limit
    }

    /// True in `share` of a million cases.
    pub(crate) fn happens(&mut self, ppm: u64) -> bool {
        self.below(1_000_000) < ppm
    }

    /// A delay that is never negative and mostly small: exponential with this mean, ns, at most ten times it.
    pub(crate) fn delay(&mut self, mean_ns: i64) -> i64 {
        let uniform = ((self.0.next_u64() >> 11) + 1) as f64 / (1u64 << 53) as f64;
        ((-libm::log(uniform) * mean_ns as f64) as i64).min(10 * mean_ns)
    }
}
