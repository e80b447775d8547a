//! The core's own beat: instants a tenth of a second apart, at which states are judged, and each second health.
//!
//! An instant is judged once every event that arrived before it is surely in: when a tick from [`LATENESS_NS`] later
//! comes. A sensor may be past the instant by then; so whenever its events step over instants that are not judged yet,
//! what it was like at each of them is kept. That makes the judgement independent of how the sensors' events interleave.

use crate::health::{SensorHealth, SensorState};
use std::collections::VecDeque;
use tumbled_model::RigNs;

/// From instant to instant, ns.
pub(crate) const BEAT_NS: i64 = 100_000_000;
/// Instants to a second.
pub(crate) const BEATS_PER_SECOND: i64 = 10;
/// How far the ledger may be out of order: events of two sensors that arrived further apart are in that order.
pub(crate) const LATENESS_NS: i64 = 200_000_000;
/// A silence of the ledger beyond this is not judged beat by beat: nobody was there.
const LONGEST_PAUSE_BEATS: i64 = 600;
/// Kept at most for one sensor, runs of instants at which it was the same as one: each second, and each change between.
const KEPT: usize = 128;

/// Instants that a sensor's event steps over.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Steps {
    /// The last of them.
    pub(crate) newest: i64,
    /// Those that are not judged yet.
    pub(crate) unjudged: core::ops::RangeInclusive<i64>,
}

/// One sensor just before an instant.
#[derive(Clone, Debug)]
pub(crate) struct Pulse {
    pub(crate) state: SensorState,
    pub(crate) may_come: bool,
    /// At whole seconds.
    pub(crate) health: Option<Box<SensorHealth>>,
}

impl Pulse {
    /// Whether one stands for both.
    fn is_like(&self, other: &Self) -> bool {
        let same = (self.state, self.may_come) == (other.state, other.may_come);
        same && self.health.is_none() && other.health.is_none()
    }
}

/// Which instants were judged, and what is kept for those that were not.
#[derive(Debug)]
pub(crate) struct Beat {
    /// The next instant to judge, in beats from 0.
    next: i64,
    /// By sensor: up to which instant (inclusive) a pulse holds, and the pulse.
    kept: Vec<VecDeque<(i64, Pulse)>>,
    /// By sensor: its events have stepped over the instants before this one.
    stepped: Vec<i64>,
}

impl Beat {
    pub(crate) fn new(sensors: usize) -> Self {
        Self { next: 0, kept: vec![VecDeque::new(); sensors], stepped: vec![0; sensors] }
    }

    /// Called ahead of an event of a sensor that arrived at `arrived`: the instants that it is the first to step over. Keep
    /// the sensor's pulses of those that are not judged yet with [`Beat::keep`], in their order.
    pub(crate) fn steps_over(&mut self, sensor: usize, arrived: RigNs) -> Option<Steps> {
        // An event exactly at an instant is behind it.
        let newest = arrived.0.div_euclid(BEAT_NS);
        let stepped = self.stepped.get_mut(sensor)?;
        if newest < *stepped {
            return None;
        }
        let first = (*stepped).max(self.next).max(newest - LONGEST_PAUSE_BEATS);
        *stepped = newest + 1;
        Some(Steps { newest, unjudged: first..=newest })
    }

    /// Keeps what a sensor was like just before an instant.
    pub(crate) fn keep(&mut self, sensor: usize, instant: i64, pulse: Pulse) {
        let Some(kept) = self.kept.get_mut(sensor) else { return };
        if let Some((until, last)) = kept.back_mut()
            && last.is_like(&pulse)
        {
            *until = instant;
            return;
        }
        if kept.len() == KEPT {
            kept.pop_front();
        }
        kept.push_back((instant, pulse));
    }

    /// The instants that no tick will let be judged any more, when the ledger has ended at `now`.
    pub(crate) fn left(&self, now: RigNs) -> core::ops::RangeInclusive<i64> {
        let last = now.0.div_euclid(BEAT_NS);
        self.next.max(last - LONGEST_PAUSE_BEATS)..=last
    }

    /// The next instant that a tick of this arrival lets be judged.
    pub(crate) fn due(&mut self, tick: RigNs) -> Option<i64> {
        let judged = tick.0.saturating_sub(LATENESS_NS).div_euclid(BEAT_NS);
        if judged - self.next > LONGEST_PAUSE_BEATS {
            self.next = judged;
        }
        if self.next > judged {
            return None;
        }
        self.next += 1;
        Some(self.next - 1)
    }

    /// What was kept of a sensor for an instant; `None`: it has not gone past it, ask the sensor itself.
    pub(crate) fn take(&mut self, sensor: usize, instant: i64) -> Option<Pulse> {
        let kept = self.kept.get_mut(sensor)?;
        while kept.front().is_some_and(|(until, _)| *until < instant) {
            kept.pop_front();
        }
        kept.front().map(|(_, pulse)| pulse.clone())
    }
}

/// The time of an instant.
pub(crate) fn time(instant: i64) -> RigNs {
    RigNs(instant.saturating_mul(BEAT_NS))
}

/// Whether an instant is a whole second.
pub(crate) fn is_second(instant: i64) -> bool {
    instant % BEATS_PER_SECOND == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    fn pulse(state: SensorState) -> Pulse {
        Pulse { state, may_come: true, health: None }
    }

    #[test]
    fn an_instant_is_judged_when_nothing_of_before_can_come_any_more() {
        let mut beat = Beat::new(1);
        assert_eq!(beat.due(RigNs(199 * MS)), None);
        assert_eq!(
            (beat.due(RigNs(300 * MS)), beat.due(RigNs(300 * MS)), beat.due(RigNs(300 * MS))),
            (Some(0), Some(1), None)
        );
    }

    #[test]
    fn what_a_sensor_was_like_at_each_instant_is_kept_when_it_steps_over() {
        let mut beat = Beat::new(1);
        assert_eq!(beat.steps_over(0, RigNs(50 * MS)), Some(Steps { newest: 0, unjudged: 0..=0 }));
        beat.keep(0, 0, pulse(SensorState::Absent));
        assert_eq!(beat.steps_over(0, RigNs(99 * MS)), None);
        assert_eq!(beat.steps_over(0, RigNs(450 * MS)), Some(Steps { newest: 4, unjudged: 1..=4 }));
        for instant in 1..=4 {
            beat.keep(0, instant, pulse(if instant < 3 { SensorState::Live } else { SensorState::Stale }));
        }
        let states: Vec<_> = (0..6).map(|instant| beat.take(0, instant).map(|pulse| pulse.state)).collect();
        let (absent, live, stale) = (Some(SensorState::Absent), Some(SensorState::Live), Some(SensorState::Stale));
        assert_eq!(states, [absent, live, live, stale, stale, None]);
    }

    #[test]
    fn instants_that_were_judged_before_the_event_came_need_no_pulse() {
        let mut beat = Beat::new(1);
        while beat.due(RigNs(400 * MS)).is_some() {}
        // 0, 0.1 and 0.2 s are judged; an event from 0.15 s steps over the first two, one from 0.31 s over 0.3 s too.
        let steps = beat.steps_over(0, RigNs(150 * MS)).expect("the first");
        assert!(steps.newest == 1 && steps.unjudged.is_empty());
        assert_eq!(beat.steps_over(0, RigNs(310 * MS)), Some(Steps { newest: 3, unjudged: 3..=3 }));
    }

    #[test]
    fn a_year_without_events_is_not_judged_beat_by_beat() {
        let mut beat = Beat::new(1);
        let year = RigNs(365 * 86_400 * 1_000 * MS);
        let first = beat.due(year);
        assert_eq!(first, Some((year.0 - LATENESS_NS) / BEAT_NS));
        assert_eq!(beat.due(year), None);
    }
}
