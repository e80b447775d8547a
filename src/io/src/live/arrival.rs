//! From the kernel's receive stamp, which is wall time, to the session's timeline.

use super::clock::SessionInstant;
use tumbled_model::{RigNs, Span, UnixNs};

/// A change of (wall − monotonic) beyond this is a step of the wall clock: both clocks are slewed alike, so their
/// difference changes by steps alone, and one pair is read within microseconds.
const STEP: Span = Span::from_micros(1_000);

/// A datagram waits in the socket buffer for less than this; an older stamp is taken for a wall-clock step.
const MAX_AGE: Span = Span(1_000_000_000);

/// When a datagram arrived, and how that is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Arrival {
    /// On the session's timeline; never before an earlier datagram of the same socket, never after now.
    pub at: RigNs,
    /// From the kernel's stamp; otherwise it is the instant of reading, which is later by the time in the buffer.
    pub by_kernel: bool,
}

/// Carries one socket's kernel stamps over to the session's timeline.
///
/// `arrived = now − (wall now − stamp)`, both clocks read right after the datagram. A step of the wall clock between
/// stamp and reading would move the result. So a stamp counts only when it gives an instant that is possible: within
/// the last second, not in the future, not before the socket's previous datagram (the kernel queues in order). Datagrams
/// that waited through a step are read with the difference of before it. Where neither or both fit, the instant of
/// reading stands: late by a little, wrong by nothing.
#[derive(Clone, Debug, Default)]
pub struct ArrivalClock {
    /// Wall minus session time at the last datagram.
    difference: Option<i64>,
    /// The difference before the latest step, and when that was noticed.
    before_step: Option<(i64, RigNs)>,
    last: Option<RigNs>,
    steps: u64,
}

impl ArrivalClock {
    /// When the datagram that was just read arrived. `now`: sampled right after reading.
    pub fn arrival(&mut self, now: SessionInstant, stamp: Option<UnixNs>) -> Arrival {
        let difference = now.wall.0.wrapping_sub(now.rig.0);
        self.notice_step(now.rig, difference);
        let arrival = match stamp.and_then(|stamp| self.possible(now.rig, difference, stamp)) {
            Some(at) => Arrival { at, by_kernel: true },
            None => Arrival { at: now.rig, by_kernel: false },
        };
        self.last = Some(arrival.at);
        arrival
    }

    /// Steps of the wall clock noticed so far.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    fn notice_step(&mut self, now: RigNs, difference: i64) {
        if let Some(before) = self.difference
            && difference.abs_diff(before) > STEP.0.unsigned_abs()
        {
            self.steps += 1;
            self.before_step = Some((before, now));
        }
        self.difference = Some(difference);
        self.before_step = self.before_step.filter(|(_, noticed)| now - *noticed <= MAX_AGE);
    }

    /// The one instant that the stamp can mean.
    fn possible(&self, now: RigNs, difference: i64, stamp: UnixNs) -> Option<RigNs> {
        let fits = |difference: i64| {
            let at = RigNs(stamp.0.checked_sub(difference)?);
            let earliest = self.last.unwrap_or(RigNs(i64::MIN / 2));
            // A pair of readings is not exact: what misses by less than a step is brought to the bound.
            let possible = at <= now + STEP && now - at <= MAX_AGE && at + STEP >= earliest;
            possible.then(|| at.min(now).max(earliest.min(now)))
        };
        match (fits(difference), self.before_step.and_then(|(before, _)| fits(before))) {
            (Some(at), None) | (None, Some(at)) => Some(at),
            (Some(_), Some(_)) | (None, None) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Wall time at session time 0.
    const EPOCH: i64 = 1_795_000_000_000_000_000;
    const MS: i64 = 1_000_000;

    fn now(rig: i64, step: i64) -> SessionInstant {
        SessionInstant { rig: RigNs(rig), wall: UnixNs(EPOCH + rig + step), uncertainty: Span(50) }
    }

    fn stamp(rig: i64, step: i64) -> Option<UnixNs> {
        Some(UnixNs(EPOCH + rig + step))
    }

    fn kernel(at: i64) -> Arrival {
        Arrival { at: RigNs(at), by_kernel: true }
    }

    #[test]
    fn a_stamp_gives_the_instant_before_the_wait() {
        // Stamped at 5 ms, read at 7 ms.
        assert_eq!(ArrivalClock::default().arrival(now(7 * MS, 0), stamp(5 * MS, 0)), kernel(5 * MS));
    }

    #[test]
    fn without_a_stamp_the_instant_of_reading_stands() {
        let arrival = ArrivalClock::default().arrival(now(7 * MS, 0), None);
        assert_eq!(arrival, Arrival { at: RigNs(7 * MS), by_kernel: false });
    }

    #[test]
    fn a_step_by_an_hour_moves_no_arrival() {
        for hour in [3_600_000 * MS, -3_600_000 * MS] {
            let mut clock = ArrivalClock::default();
            assert_eq!(clock.arrival(now(10 * MS, 0), stamp(9 * MS, 0)), kernel(9 * MS));
            // Stamped before the step, read after it; then stamped and read after it.
            assert_eq!(clock.arrival(now(12 * MS, hour), stamp(11 * MS, 0)), kernel(11 * MS));
            assert_eq!(clock.arrival(now(14 * MS, hour), stamp(13 * MS, hour)), kernel(13 * MS));
            assert_eq!(clock.steps(), 1);
        }
    }

    #[test]
    fn a_backlog_through_a_half_second_step_keeps_its_own_times() {
        for step in [500 * MS, -500 * MS] {
            let mut clock = ArrivalClock::default();
            assert_eq!(clock.arrival(now(10 * MS, 0), stamp(10 * MS, 0)), kernel(10 * MS));
            // 20 datagrams, one a millisecond from 11 ms on, the clock stepping at 21 ms, all read from 40 ms on.
            for i in 0..20 {
                let sent = (11 + i) * MS;
                let at_stamp = if i < 10 { 0 } else { step };
                assert_eq!(clock.arrival(now(40 * MS + i, step), stamp(sent, at_stamp)), kernel(sent), "datagram {i}");
            }
        }
    }

    #[test]
    fn an_impossible_stamp_gives_way_to_the_instant_of_reading() {
        let read = |at| Arrival { at: RigNs(at), by_kernel: false };
        let mut clock = ArrivalClock::default();
        // In the future by 2 ms; older than a second; before the previous datagram by 3 ms.
        assert_eq!(clock.arrival(now(5_000 * MS, 0), stamp(5_002 * MS, 0)), read(5_000 * MS));
        assert_eq!(clock.arrival(now(7_000 * MS, 0), stamp(5_900 * MS, 0)), read(7_000 * MS));
        assert_eq!(clock.arrival(now(7_010 * MS, 0), stamp(6_997 * MS, 0)), read(7_010 * MS));
    }

    proptest! {
        #[test]
        fn arrivals_keep_their_order_and_lie_in_the_past_whatever_the_stamps(
            readings in prop::collection::vec((0i64..2_000_000_000, any::<i64>(), prop::option::of(any::<i64>())), 1..50)
        ) {
            let mut clock = ArrivalClock::default();
            let (mut rig, mut last) = (0, RigNs(0));
            for (pause, wall, stamp) in readings {
                rig += pause;
                let now = SessionInstant { rig: RigNs(rig), wall: UnixNs(wall), uncertainty: Span(0) };
                let arrival = clock.arrival(now, stamp.map(UnixNs));
                prop_assert!(arrival.at >= last && arrival.at <= now.rig);
                last = arrival.at;
            }
        }

        #[test]
        fn one_step_of_any_size_never_makes_an_arrival_earlier_than_the_truth(
            step in -7_200_000_000_000i64..7_200_000_000_000,
            waits in prop::collection::vec(0i64..300_000, 40),
        ) {
            // A datagram every 0.66 ms, read after the given wait; the step falls in the middle of the run.
            let mut clock = ArrivalClock::default();
            let stepped = 20 * 663_552;
            for (i, wait) in (0i64..).zip(waits) {
                let sent = i * 663_552;
                let read = sent + wait;
                let wall = |t: i64| if t >= stepped { step } else { 0 };
                let arrival = clock.arrival(now(read, wall(read)), stamp(sent, wall(sent)));
                // At most a step too small to be told (1 ms) and never later than the reading.
                prop_assert!(arrival.at.0 >= sent - STEP.0 && arrival.at.0 <= read, "{arrival:?} for {sent}..{read}");
            }
        }
    }
}
