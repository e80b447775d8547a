//! When the next tick and the next anchor are due.

use std::time::Duration;
use tumbled_model::{RigNs, Span};

/// Between ticks: the core's watchdogs see time pass to a tenth of a second.
pub(super) const TICK: Span = Span::from_micros(100_000);
/// Between anchors of the wall clock.
pub(super) const ANCHOR: Span = Span::from_micros(1_000_000);

/// What is due at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Due {
    pub(super) anchor: bool,
    pub(super) tick: bool,
}

/// Keeps the beat: anchors at 0, 1, 2, … s and ticks at 0.1, 0.2, … s of the session.
///
/// A beat that was missed is not made up for: a tick says that time has passed, and the next one says how far.
#[derive(Debug)]
pub(super) struct Metronome {
    next_tick: RigNs,
    next_anchor: RigNs,
}

impl Metronome {
    /// The beat from the session's start on.
    pub(super) fn new() -> Self {
        Self { next_tick: RigNs(TICK.0), next_anchor: RigNs(0) }
    }

    /// What is due at `now`; each is due once.
    pub(super) fn beat(&mut self, now: RigNs) -> Due {
        let due = Due { anchor: now >= self.next_anchor, tick: now >= self.next_tick };
        if due.anchor {
            self.next_anchor = next_multiple(now, ANCHOR);
        }
        if due.tick {
            self.next_tick = next_multiple(now, TICK);
        }
        due
    }

    /// How long until something is due.
    pub(super) fn until_next(&self, now: RigNs) -> Duration {
        let left = self.next_tick.min(self.next_anchor) - now;
        Duration::from_nanos(u64::try_from(left.0).unwrap_or(0))
    }
}

/// The first multiple of the period after `now`: late beats do not shift those that follow.
fn next_multiple(now: RigNs, period: Span) -> RigNs {
    RigNs((now.0.div_euclid(period.0) + 1).saturating_mul(period.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    #[test]
    fn ticks_come_each_tenth_and_anchors_each_second() {
        let mut metronome = Metronome::new();
        let (mut ticks, mut anchors) = (Vec::new(), Vec::new());
        for ms in 0..=2_050 {
            let due = metronome.beat(RigNs(ms * MS));
            ticks.extend(due.tick.then_some(ms));
            anchors.extend(due.anchor.then_some(ms));
        }
        assert_eq!(ticks, (1..=20).map(|tenth| tenth * 100).collect::<Vec<_>>());
        assert_eq!(anchors, [0, 1_000, 2_000]);
    }

    #[test]
    fn a_late_beat_comes_once_and_does_not_shift_the_next() {
        let mut metronome = Metronome::new();
        let late = metronome.beat(RigNs(357 * MS));
        assert_eq!(late, Due { anchor: true, tick: true });
        assert_eq!(metronome.beat(RigNs(399 * MS)), Due::default());
        // 400 ms − 399.5 ms.
        assert_eq!(metronome.until_next(RigNs(399 * MS + 500_000)), Duration::from_micros(500));
        assert!(metronome.beat(RigNs(400 * MS)).tick);
    }
}
