//! What the host's wall clock said, for people and file names. No measurement's time rests on it.

use std::collections::VecDeque;
use tumbled_model::{RigNs, Span, UnixNs};

/// A change of the offset between two anchors beyond this is a step, ns.
const STEP_NS: i64 = 1_000_000;
/// What the kernel slews its wall clock by at most (adjtimex: 500 ppm); allowed on top for anchors more than 1 s apart.
const KERNEL_SLEW: f64 = 500e-6;
/// Anchors remembered, one a second: more than any hold-back of data.
const ANCHORS: usize = 16;

#[derive(Clone, Copy, Debug)]
struct Anchor {
    rig: RigNs,
    unix: UnixNs,
    /// Steps up to this anchor, and the newest of them.
    steps: u64,
    last_step: Option<Span>,
}

impl Anchor {
    fn offset(&self) -> i64 {
        self.unix.0.saturating_sub(self.rig.0)
    }

    /// By how much the wall clock was set since another anchor, if it was.
    fn step_since(&self, last: &Self) -> Option<Span> {
        let change = self.offset().saturating_sub(last.offset());
        let apart = self.rig.0.saturating_sub(last.rig.0).saturating_sub(1_000_000_000).max(0);
        let slewed = (apart as f64 * KERNEL_SLEW) as i64;
        (change.saturating_abs() > STEP_NS.saturating_add(slewed)).then_some(Span(change))
    }
}

/// Wall time beside the rig's timeline, from the ledger's anchors.
#[derive(Clone, Debug, Default)]
pub struct WallClock {
    anchors: VecDeque<Anchor>,
    steps: u64,
    last_step: Option<Span>,
}

impl WallClock {
    /// A wall clock without anchors.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes an anchor: wall time `unix` at `rig`. Returns the step when the wall clock was set since the last one.
    ///
    /// Anchors come in order; one that is not later than the last replaces it.
    pub fn anchor(&mut self, rig: RigNs, unix: UnixNs) -> Option<Span> {
        while self.anchors.back().is_some_and(|last| last.rig >= rig) || self.anchors.len() >= ANCHORS {
            if self.anchors.back().is_some_and(|last| last.rig >= rig) {
                self.anchors.pop_back();
            } else {
                self.anchors.pop_front();
            }
        }
        let anchor = Anchor { rig, unix, steps: self.steps, last_step: self.last_step };
        let last = self.anchors.back().copied();
        let step = last.and_then(|last| anchor.step_since(&last));
        if step.is_some() {
            self.steps += 1;
            self.last_step = step;
        }
        self.anchors.push_back(Anchor { steps: self.steps, last_step: self.last_step, ..anchor });
        step
    }

    /// Wall time at `t` by the newest anchor at or before it (before all of them: by the oldest); `None` without anchors.
    ///
    /// By that rule a datum gets the same wall time whether a later anchor was read before or after it.
    pub fn unix(&self, t: RigNs) -> Option<UnixNs> {
        let anchor = self.until(t).or(self.anchors.front())?;
        Some(UnixNs(t.0.saturating_add(anchor.offset())))
    }

    /// The same; without anchors by the wall time at the session's start.
    pub fn unix_or_from(&self, t: RigNs, unix_at_zero: UnixNs) -> UnixNs {
        self.unix(t).unwrap_or(unix_at_zero + Span(t.0))
    }

    /// How often the wall clock was set, by the anchors up to `t`.
    pub fn steps_until(&self, t: RigNs) -> u64 {
        self.until(t).map_or(0, |anchor| anchor.steps)
    }

    /// The newest step of the anchors up to `t`; positive = set forward.
    pub fn last_step_until(&self, t: RigNs) -> Option<Span> {
        self.until(t).and_then(|anchor| anchor.last_step)
    }

    /// The newest anchor at or before `t`.
    fn until(&self, t: RigNs) -> Option<&Anchor> {
        self.anchors.iter().rev().find(|anchor| anchor.rig <= t)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: i64 = 1_000_000_000;

    #[test]
    fn an_hour_is_a_step_and_half_a_millisecond_is_the_kernel_slewing() {
        let mut wall = WallClock::new();
        assert_eq!(wall.anchor(RigNs(0), UnixNs(100 * S)), None);
        assert_eq!(wall.anchor(RigNs(S), UnixNs(101 * S + 500_000)), None);
        assert_eq!(wall.anchor(RigNs(2 * S), UnixNs(3_702 * S + 500_000)), Some(Span(3_600 * S)));
        assert_eq!(wall.anchor(RigNs(3 * S), UnixNs(103 * S)), Some(Span(-3_600 * S - 500_000)));
        assert_eq!(
            (wall.steps_until(RigNs(3 * S)), wall.last_step_until(RigNs(3 * S))),
            (2, Some(Span(-3_600 * S - 500_000)))
        );
        // What was known at 2 s, whatever was read since.
        assert_eq!((wall.steps_until(RigNs(3 * S - 1)), wall.steps_until(RigNs(2 * S - 1))), (1, 0));
    }

    #[test]
    fn ten_seconds_without_anchors_may_slew_by_what_the_kernel_can() {
        let mut wall = WallClock::new();
        wall.anchor(RigNs(0), UnixNs(0));
        // 1 ms + 9 s · 500 ppm = 5.5 ms.
        assert_eq!(wall.anchor(RigNs(10 * S), UnixNs(10 * S + 5_400_000)), None);
        assert!(wall.anchor(RigNs(20 * S), UnixNs(20 * S + 11_000_000)).is_some());
    }

    #[test]
    fn a_datum_from_before_a_step_keeps_the_wall_time_of_then() {
        let mut wall = WallClock::new();
        assert_eq!(wall.unix(RigNs(5)), None);
        wall.anchor(RigNs(10 * S), UnixNs(110 * S));
        wall.anchor(RigNs(11 * S), UnixNs(3_711 * S));
        assert_eq!(wall.unix(RigNs(10 * S + 7)), Some(UnixNs(110 * S + 7)));
        assert_eq!(wall.unix(RigNs(11 * S)), Some(UnixNs(3_711 * S)));
        assert_eq!(wall.unix(RigNs(9 * S)), Some(UnixNs(109 * S)));
    }

    #[test]
    fn a_day_of_anchors_needs_the_room_of_sixteen() {
        let mut wall = WallClock::new();
        for second in 0..86_400 {
            wall.anchor(RigNs(second * S), UnixNs(second * S));
        }
        assert_eq!(wall.anchors.len(), ANCHORS);
        // Out of order: all that are not earlier make way.
        wall.anchor(RigNs(0), UnixNs(0));
        assert_eq!(wall.anchors.len(), 1);
    }
}
