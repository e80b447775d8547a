//! A counter that wraps, made one that does not.

/// How far back a stamp may lie and still be a packet that was overtaken on the way, s. Farther back, the counter was
/// set or restarted.
const REORDERING_S: i64 = 1;

/// Past the wrap, how long a step may be and still be read as plain 32-bit counting, s: longer silences start anew.
const PAST_WRAP_STEP_S: i64 = 5;

/// Where a stamp lies against the newest accepted one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// The same stamp again.
    Same,
    /// Later by so many ticks, 1..=W/2.
    Ahead(i64),
    /// Earlier by so many ticks, less than 1 s: reordered.
    Behind(i64),
    /// Earlier by 1 s or more: the counter was set back or restarted.
    Jump,
}

/// The newest accepted stamp and the ticks counted up to it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Counter {
    wrap: i64,
    hz: i64,
    raw: u32,
    total: i64,
}

impl Counter {
    /// Starts at `raw`, which is also the first total.
    pub(super) fn new(wrap: i64, hz: i64, raw: u32) -> Self {
        Self { wrap, hz, raw, total: i64::from(raw) }
    }

    /// Ticks up to the newest accepted stamp, wraps counted.
    pub(super) fn total(&self) -> i64 {
        self.total
    }

    /// The signed shortest way from the newest accepted stamp to `raw`, ticks.
    pub(super) fn shortest(&self, raw: u32) -> i64 {
        // Sensors that were never synchronised count on past the hour and start again at 2³².
        let past_wrap = i64::from(raw.max(self.raw)) >= self.wrap;
        let plain = i64::from(raw.wrapping_sub(self.raw).cast_signed());
        if past_wrap && plain.abs() <= PAST_WRAP_STEP_S * self.hz {
            return plain;
        }
        let ahead = self.modulo(raw);
        if ahead > self.wrap / 2 { ahead - self.wrap } else { ahead }
    }

    /// Says where `raw` lies.
    pub(super) fn step(&self, raw: u32) -> Step {
        match self.shortest(raw) {
            0 => Step::Same,
            ahead @ 1.. => Step::Ahead(ahead),
            behind if -behind < REORDERING_S * self.hz => Step::Behind(-behind),
            _ => Step::Jump,
        }
    }

    /// Accepts `raw`, `ticks` later than the newest so far.
    pub(super) fn advance(&mut self, raw: u32, ticks: i64) {
        self.raw = raw;
        self.total = self.total.saturating_add(ticks);
    }

    /// Ticks from the newest accepted stamp to `raw` across a silence of `elapsed_ns`: the whole wraps that the counter
    /// alone cannot show are taken from the elapsed time.
    pub(super) fn across_silence(&self, raw: u32, elapsed_ns: i64) -> i64 {
        let (ahead, wrap) = (i128::from(self.modulo(raw)), i128::from(self.wrap));
        let elapsed = i128::from(elapsed_ns) * i128::from(self.hz) / 1_000_000_000;
        let wraps = (elapsed - ahead + wrap / 2).div_euclid(wrap);
        // |elapsed_ns| < 2⁶³ and hz < 1e9, so this fits; a counter faster than 1 GHz would saturate.
        i64::try_from(ahead + wrap * wraps).unwrap_or(i64::MAX)
    }

    /// (raw − newest) mod W, 0..W.
    fn modulo(&self, raw: u32) -> i64 {
        (i64::from(raw) - i64::from(self.raw)).rem_euclid(self.wrap)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const HOUR: i64 = 3_600_000_000;

    #[test]
    fn the_top_of_the_hour_is_a_step_like_any_other() {
        let counter = Counter::new(HOUR, 1_000_000, 3_599_999_900);
        assert_eq!(counter.step(563), Step::Ahead(663)); // 100 to the hour, 563 past it
        assert_eq!(Counter::new(HOUR, 1_000_000, 563).step(3_599_999_900), Step::Behind(663));
    }

    #[test]
    fn a_counter_past_the_hour_runs_on_to_two_to_the_32() {
        assert_eq!(Counter::new(HOUR, 1_000_000, 3_599_999_900).step(3_600_000_563), Step::Ahead(663));
        // 2³² − 4,294,967,200 = 96; 96 + 567 = 663.
        assert_eq!(Counter::new(HOUR, 1_000_000, 4_294_967_200).step(567), Step::Ahead(663));
    }

    #[test]
    fn one_second_back_is_a_jump_and_less_is_reordering() {
        let counter = Counter::new(1 << 32, 1_000_000, 5_000_000);
        assert_eq!(counter.step(4_000_001), Step::Behind(999_999));
        assert_eq!(counter.step(4_000_000), Step::Jump);
        assert_eq!(counter.step(5_000_000), Step::Same);
    }

    #[test]
    fn two_hours_of_silence_are_counted_in_wraps() {
        // 7200 s at 60 MHz = 432e9 ticks = 100 wraps (429,496,729,600) + 2,503,270,400.
        let counter = Counter::new(1 << 32, 60_000_000, 0);
        assert_eq!(counter.across_silence(2_503_270_400, 7_200_000_000_000), 432_000_000_000);
        // The arrival may be off by nearly half a wrap, 35 s.
        assert_eq!(counter.across_silence(2_503_270_400, 7_165_000_000_000), 432_000_000_000);
    }

    proptest! {
        #[test]
        fn silence_is_resolved_when_arrival_errs_by_less_than_half_a_wrap(
            start in 0..HOUR, ticks in 0i64..1_000_000_000_000, error in -1_799_000_000i64..1_799_000_000
        ) {
            let counter = Counter::new(HOUR, 1_000_000, start as u32);
            let raw = ((start + ticks) % HOUR) as u32;
            prop_assert_eq!(counter.across_silence(raw, (ticks + error) * 1_000), ticks);
        }

        #[test]
        fn arbitrary_stamps_lie_within_half_a_wrap(from in any::<u32>(), to in any::<u32>(), elapsed in any::<i64>()) {
            for (wrap, hz) in [(HOUR, 1_000_000), (1 << 32, 60_000_000)] {
                let counter = Counter::new(wrap, hz, from);
                prop_assert!(counter.shortest(to).abs() <= wrap / 2);
                let off = i128::from(counter.across_silence(to, elapsed)) - i128::from(elapsed) * i128::from(hz) / 1_000_000_000;
                prop_assert!(off.abs() <= i128::from(wrap / 2) + 1);
            }
        }
    }
}
