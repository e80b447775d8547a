//! The host's clocks, sampled here and nowhere else.
//!
//! The session's timeline is the monotonic clock from the session's start. Wall time is read beside it, in one pair, so
//! that a kernel stamp (wall time) can be carried over and an anchor can be written. Tests script both clocks.

use std::sync::Arc;
use std::time::{Instant, SystemTime, UNIX_EPOCH};
use tumbled_model::{RigNs, Span, UnixNs};

/// Both host clocks at one instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HostSample {
    /// The monotonic clock: nanoseconds since an instant that stays the same for the clock's life.
    pub monotonic: Span,
    /// The wall clock.
    pub wall: UnixNs,
    /// How far apart the two readings may lie, nanoseconds: half the time the pair took.
    pub uncertainty: Span,
}

/// A host with a monotonic clock and a wall clock. The wall clock may step; the monotonic one never goes back.
pub trait HostClock: Send + Sync {
    /// Reads both clocks.
    fn sample(&self) -> HostSample;
}

/// The machine's own clocks: `CLOCK_MONOTONIC` and `CLOCK_REALTIME`.
#[derive(Clone, Copy, Debug)]
pub struct SystemClock {
    origin: Instant,
}

impl SystemClock {
    /// A clock whose monotonic zero is now.
    pub fn new() -> Self {
        Self { origin: Instant::now() }
    }
}

impl Default for SystemClock {
    fn default() -> Self {
        Self::new()
    }
}

/// A pair read within this time is good enough; undisturbed, it takes about 0.1 µs.
const GOOD_PAIR_NS: i64 = 2_000;
/// How often a pair is read again when the thread was interrupted within it.
const PAIR_ATTEMPTS: usize = 3;

impl HostClock for SystemClock {
    fn sample(&self) -> HostSample {
        let mut best = self.pair();
        for _ in 1..PAIR_ATTEMPTS {
            if best.uncertainty.0 * 2 <= GOOD_PAIR_NS {
                break;
            }
            let again = self.pair();
            if again.uncertainty <= best.uncertainty {
                best = again;
            }
        }
        best
    }
}

impl SystemClock {
    /// The wall clock between two readings of the monotonic one: it belongs to their middle.
    fn pair(&self) -> HostSample {
        let before = self.monotonic_ns();
        let wall = wall_ns(SystemTime::now());
        let after = self.monotonic_ns();
        HostSample {
            monotonic: Span(before + (after - before) / 2),
            wall: UnixNs(wall),
            uncertainty: Span((after - before + 1) / 2),
        }
    }

    fn monotonic_ns(&self) -> i64 {
        i64::try_from(self.origin.elapsed().as_nanos()).unwrap_or(i64::MAX)
    }
}

/// Nanoseconds since 1970; negative before it. Saturates in the year 2262.
fn wall_ns(time: SystemTime) -> i64 {
    match time.duration_since(UNIX_EPOCH) {
        Ok(since) => i64::try_from(since.as_nanos()).unwrap_or(i64::MAX),
        Err(before) => i64::try_from(before.duration().as_nanos()).map_or(i64::MIN, |ns| -ns),
    }
}

/// One instant of a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SessionInstant {
    /// On the session's timeline.
    pub rig: RigNs,
    /// Wall time at the same instant.
    pub wall: UnixNs,
    /// How far apart the two readings may lie.
    pub uncertainty: Span,
}

/// The session's timeline: the host's monotonic clock counted from the session's start. Clones share it.
#[derive(Clone)]
pub struct SessionClock {
    host: Arc<dyn HostClock>,
    start: Span,
}

impl SessionClock {
    /// A session that starts now, on the given host clock.
    pub fn start(host: Arc<dyn HostClock>) -> Self {
        let start = host.sample().monotonic;
        Self { host, start }
    }

    /// A session that starts now, on the machine's clocks.
    pub fn start_on_system() -> Self {
        Self::start(Arc::new(SystemClock::new()))
    }

    /// This instant on both timelines.
    pub fn now(&self) -> SessionInstant {
        let sample = self.host.sample();
        SessionInstant {
            rig: RigNs((sample.monotonic - self.start).0),
            wall: sample.wall,
            uncertainty: sample.uncertainty,
        }
    }
}

impl core::fmt::Debug for SessionClock {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("SessionClock").field("start", &self.start).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn the_session_starts_at_zero_and_never_goes_back() {
        let clock = SessionClock::start_on_system();
        let mut last = RigNs(0);
        for _ in 0..1_000 {
            let now = clock.now().rig;
            assert!(now >= last, "{now:?} after {last:?}");
            last = now;
        }
    }

    #[test]
    fn wall_times_count_from_1970_on_both_sides() {
        assert_eq!(wall_ns(UNIX_EPOCH + Duration::from_nanos(5)), 5);
        assert_eq!(wall_ns(UNIX_EPOCH - Duration::from_nanos(5)), -5);
    }
}
