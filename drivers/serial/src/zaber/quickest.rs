//! The quickest round trip of late.

use tumbled_model::Span;

/// A round trip may take so many times as long as the quickest.
const TIMES: i64 = 3;

/// Half round trips up to here are always admitted: at 20 °/s they are 0.006° of doubt, and on a pseudo-terminal the
/// quickest is so quick that three times it is nothing.
const ALWAYS: Span = Span::from_micros(500);

/// So many round trips are one block; the quickest of this block and of the one before counts. 10 s at 50 Hz: long
/// enough to have met a quick one, short enough to get used to another adapter latency.
const BLOCK: u32 = 500;

/// The running minimum of half round trips.
#[derive(Clone, Copy, Debug)]
pub(super) struct Quickest {
    before: Span,
    now: Span,
    in_block: u32,
}

impl Default for Quickest {
    fn default() -> Self {
        Self { before: Span(i64::MAX), now: Span(i64::MAX), in_block: 0 }
    }
}

impl Quickest {
    /// Takes a half round trip; whether it is quick enough for its middle to be believed.
    pub(super) fn admits(&mut self, half_rtt: Span) -> bool {
        if self.in_block == BLOCK {
            *self = Self { before: self.now, now: Span(i64::MAX), in_block: 0 };
        }
        self.in_block += 1;
        self.now = self.now.min(half_rtt);
        let quickest = self.before.min(self.now);
        half_rtt <= ALWAYS || half_rtt.0 <= quickest.0.saturating_mul(TIMES)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: i64) -> Span {
        Span::from_micros(1_000 * ms)
    }

    #[test]
    fn three_times_the_quickest_is_the_limit() {
        let mut quickest = Quickest::default();
        assert!(quickest.admits(ms(2)) && quickest.admits(ms(6)) && !quickest.admits(ms(7)));
        assert!(quickest.admits(ms(1)) && !quickest.admits(ms(4)));
    }

    #[test]
    fn a_line_that_became_slow_is_believed_again_after_two_blocks() {
        let mut quickest = Quickest::default();
        assert!(quickest.admits(ms(1)));
        // The block of the quick one ends after 500, and counts through the next 500.
        let refused = (0..1_200).filter(|_| !quickest.admits(ms(10))).count();
        assert_eq!(refused, 999);
    }
}
