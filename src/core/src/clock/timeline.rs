//! What was handed out, and what will be: lines in use, joined so that no later tick ever gets an earlier time.

use super::line::Line;
use std::collections::VecDeque;
use tumbled_model::{RigNs, Span};

/// How fast the handed-out time approaches a new line: 200 µs/s. It keeps the timeline's rate within 200 ppm of the
/// line's, which no rate measurement downstream notices.
const SLEW: f64 = 200e-6;

/// A change beyond 5 ms is taken at once: slewing would take longer than 25 s.
const STEP_NS: i64 = 5_000_000;

/// Lines remembered: with one change a second, or ten while acquiring, more than the 1 s within which a stamp may be
/// reordered.
const SEGMENTS: usize = 16;

/// A line in use from `from` on.
#[derive(Clone, Copy, Debug)]
struct Segment {
    /// Device time of its first use, ns.
    from: i64,
    /// The last time handed out before it: never less from here on.
    floor: i64,
    line: Line,
    /// How far above the line it starts, ns; shrinks by [`SLEW`].
    lag: f64,
}

/// An epoch's handed-out times.
#[derive(Clone, Debug)]
pub(super) struct Timeline {
    start: i64,
    floor: i64,
    segments: VecDeque<Segment>,
    /// The newest device time for which a time was handed out.
    horizon: Option<i64>,
    steps: u64,
    held: u64,
}

impl Timeline {
    pub(super) fn new() -> Self {
        let segments = VecDeque::with_capacity(SEGMENTS);
        Self { start: 0, floor: i64::MIN, segments, horizon: None, steps: 0, held: 0 }
    }

    /// Begins an epoch whose device time 0 arrived at `start`. Its times are not earlier than those of the last.
    pub(super) fn begin(&mut self, start: RigNs, line: Line) {
        if let Some(horizon) = self.horizon.take() {
            self.floor = self.at(horizon).0;
        }
        self.start = start.0;
        self.segments.clear();
        self.segments.push_back(Segment { from: 0, floor: self.floor, line, lag: 0.0 });
    }

    /// Goes over to another line after the newest time handed out: at once, or by slewing unless it is too far.
    pub(super) fn adopt(&mut self, line: Line, at_once: bool) {
        let Some(from) = self.horizon else {
            // Nothing was handed out yet, so nothing is to be joined.
            self.segments.clear();
            self.segments.push_back(Segment { from: 0, floor: self.floor, line, lag: 0.0 });
            return;
        };
        let floor = self.at(from).0;
        let lag = floor.saturating_sub(self.on(&line, from, 0.0));
        let far = lag.saturating_abs() > STEP_NS;
        if far && !at_once {
            self.steps += 1;
        }
        let lag = if far || at_once { 0.0 } else { lag as f64 };
        if self.segments.back().is_some_and(|last| last.from == from) || self.segments.len() == SEGMENTS {
            // A line that served for no tick gives its place up; else the oldest does.
            let served = self.segments.back().is_some_and(|last| last.from != from);
            if served {
                self.segments.pop_front()
            } else {
                self.segments.pop_back()
            };
        }
        self.segments.push_back(Segment { from, floor, line, lag });
    }

    /// The time of device time `x`, remembered as handed out.
    pub(super) fn hand_out(&mut self, x: i64) -> RigNs {
        let t = self.at(x);
        if let Some(last) = self.segments.back()
            && x >= last.from
            && self.on(&last.line, x, self.lag(last, x)) < last.floor
        {
            self.held += 1;
        }
        self.horizon = Some(self.horizon.map_or(x, |horizon| horizon.max(x)));
        t
    }

    /// The time of device time `x`.
    pub(super) fn at(&self, x: i64) -> RigNs {
        let in_use = self.segments.iter().rev().find(|segment| x >= segment.from);
        if let Some(segment) = in_use {
            return RigNs(self.on(&segment.line, x, self.lag(segment, x)).max(segment.floor));
        }
        // Before everything remembered: the oldest line as it stood at its start.
        self.segments.front().map_or(RigNs(self.start), |oldest| RigNs(self.on(&oldest.line, x, oldest.lag)))
    }

    /// How far the time handed out at `x` still is from the line that it slews to.
    pub(super) fn slewing(&self, x: i64) -> Span {
        Span(self.segments.back().map_or(0, |last| self.lag(last, x).abs() as i64))
    }

    /// Changes beyond 5 ms that were taken at once.
    pub(super) fn steps(&self) -> u64 {
        self.steps
    }

    /// Times handed out later than the line says, because an earlier tick had got one as late.
    pub(super) fn held(&self) -> u64 {
        self.held
    }

    fn lag(&self, segment: &Segment, x: i64) -> f64 {
        let slewed = SLEW * (x.saturating_sub(segment.from)).max(0) as f64;
        let left = (segment.lag.abs() - slewed).max(0.0);
        if segment.lag < 0.0 { -left } else { left }
    }

    fn on(&self, line: &Line, x: i64, lag: f64) -> i64 {
        self.start.saturating_add(x).saturating_add(line.at_plus(x, lag))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MS: i64 = 1_000_000;
    const S: i64 = 1_000 * MS;

    fn level(y: i64) -> Line {
        Line { x: 0, y, slope: 0.0 }
    }

    #[test]
    fn a_change_of_two_milliseconds_takes_ten_seconds() {
        let mut timeline = Timeline::new();
        timeline.begin(RigNs(0), level(0));
        timeline.hand_out(S);
        timeline.adopt(level(2 * MS), false);
        assert_eq!(timeline.at(S), RigNs(S));
        assert_eq!(timeline.at(6 * S), RigNs(6 * S + MS)); // 5 s · 200 µs/s = 1 ms of 2
        assert_eq!(timeline.slewing(6 * S), Span(MS));
        assert_eq!(timeline.at(11 * S), RigNs(11 * S + 2 * MS));
        assert_eq!((timeline.at(20 * S), timeline.steps()), (RigNs(20 * S + 2 * MS), 0));
    }

    #[test]
    fn a_step_back_waits_until_the_line_has_caught_up() {
        let mut timeline = Timeline::new();
        timeline.begin(RigNs(0), level(0));
        timeline.hand_out(S);
        timeline.adopt(level(-6 * MS), false);
        assert_eq!((timeline.hand_out(S + 5 * MS), timeline.steps(), timeline.held()), (RigNs(S), 1, 1));
        assert_eq!((timeline.hand_out(S + 7 * MS), timeline.held()), (RigNs(S + MS), 1));
        // A reordered tick keeps the time it would have had.
        assert_eq!(timeline.hand_out(S - MS), RigNs(S - MS));
    }

    #[test]
    fn a_new_epoch_is_not_earlier_than_the_last() {
        let mut timeline = Timeline::new();
        timeline.begin(RigNs(0), level(0));
        timeline.hand_out(10 * S);
        timeline.begin(RigNs(9 * S), level(0));
        assert_eq!(timeline.hand_out(0), RigNs(10 * S));
        assert_eq!(timeline.hand_out(2 * S), RigNs(11 * S));
    }

    proptest! {
        /// Any order of ticks within the remembered second, any lines within the skew limit: sorted by tick, the handed
        /// out times are sorted too.
        #[test]
        fn ticks_sorted_are_times_sorted(
            rounds in prop::collection::vec(
                (1i64..S, -20 * MS..20 * MS, -500e-6..500e-6, any::<bool>(), prop::collection::vec(0i64..900 * MS, 1..6)),
                1..40
            )
        ) {
            let mut timeline = Timeline::new();
            timeline.begin(RigNs(0), level(0));
            let mut handed = Vec::new();
            let mut newest = S;
            for (step, y, slope, at_once, backs) in rounds {
                newest += step;
                for back in backs {
                    let x = newest - back;
                    handed.push((x, timeline.hand_out(x)));
                }
                handed.push((newest, timeline.hand_out(newest)));
                newest += 100 * MS;
                timeline.adopt(Line { x: newest, y, slope }, at_once);
            }
            handed.sort_by_key(|pair| pair.0);
            prop_assert!(handed.is_sorted_by_key(|pair| pair.1), "{handed:?}");
        }
    }
}
