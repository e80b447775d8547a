//! UTC from a sensor whose counter a GPS receiver's pulse keeps.

use serde::{Deserialize, Serialize};
use tumbled_model::{RigNs, Span, UnixNs};
use tumbled_velodyne::clock::UtcState;

const S: i64 = 1_000_000_000;

/// A lock must have lasted so long: right after the pulse appears the sensor's minutes and seconds may still be set.
const TRUSTED_AFTER: i64 = 5 * S;
/// Position packets come many times a second; without one for so long nothing is known any more.
const FORGOTTEN_AFTER: i64 = 5 * S;
/// A change of the offset beyond this restarts the trust: one of the clocks was set. Mapping errors are far smaller.
const DISAGREEMENT: i64 = 1_000_000;

/// UTC of an instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct UtcReading {
    /// UTC. Early by the sensor's least delay, as mapped times are late by it.
    pub utc: UnixNs,
    /// One standard deviation, the least delay excluded.
    pub sigma: Span,
}

#[derive(Clone, Copy, Debug)]
struct Lock {
    since: RigNs,
    newest: RigNs,
    offset: i64,
    sigma: Span,
}

/// The offset between the rig's timeline and UTC, while a sensor vouches for it.
///
/// The sensor's hour + µs is UTC once its pulse input has been locked with a valid, agreeing sentence for 5 s; the
/// mapper says where on the rig's timeline that stamp lies; the difference is the offset.
#[derive(Clone, Copy, Debug, Default)]
pub struct UtcMap {
    lock: Option<Lock>,
    disagreements: u64,
}

impl UtcMap {
    /// A map that knows nothing yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes one stamp of the sensor: what its UTC state is, its UTC (`UtcClock::utc`), and where it was mapped to.
    pub fn update(&mut self, state: UtcState, utc: Option<UnixNs>, t: RigNs, sigma: Span) {
        let (UtcState::Locked, Some(utc)) = (state, utc) else {
            self.lock = None;
            return;
        };
        let offset = utc.0.saturating_sub(t.0);
        let held = self.lock.filter(|lock| t.0.saturating_sub(lock.newest.0) <= FORGOTTEN_AFTER);
        let agrees = held.is_none_or(|lock| offset.saturating_sub(lock.offset).saturating_abs() <= DISAGREEMENT);
        if !agrees {
            self.disagreements += 1;
        }
        let since = held.filter(|_| agrees).map_or(t, |lock| lock.since);
        self.lock = Some(Lock { since, newest: t, offset, sigma });
    }

    /// UTC at `t`; `None` unless a lock has lasted 5 s and `t` lies within 5 s of its newest stamp.
    pub fn utc(&self, t: RigNs) -> Option<UtcReading> {
        let lock = self.trusted()?;
        let away = t.0.saturating_sub(lock.newest.0).saturating_abs();
        (away <= FORGOTTEN_AFTER)
            .then(|| UtcReading { utc: UnixNs(t.0.saturating_add(lock.offset)), sigma: lock.sigma })
    }

    /// How much the host's wall clock is ahead of UTC, given its reading `wall` at `t`; `None` as in [`Self::utc`].
    pub fn wall_error(&self, t: RigNs, wall: UnixNs) -> Option<Span> {
        self.utc(t).map(|reading| wall - reading.utc)
    }

    /// How often the offset changed by more than 1 ms while locked.
    pub fn disagreements(&self) -> u64 {
        self.disagreements
    }

    fn trusted(&self) -> Option<&Lock> {
        self.lock.as_ref().filter(|lock| lock.newest.0.saturating_sub(lock.since.0) >= TRUSTED_AFTER)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UTC0: i64 = 1_795_321_341 * S; // 2026-11-22T04:22:21Z

    fn locked_for(map: &mut UtcMap, from_s: i64, to_s: i64, shift: i64) {
        for second in from_s..=to_s {
            let (t, utc) = (RigNs(second * S), UnixNs(UTC0 + second * S + shift));
            map.update(UtcState::Locked, Some(utc), t, Span(5_000));
        }
    }

    #[test]
    fn five_seconds_of_lock_make_it_utc() {
        let mut map = UtcMap::new();
        locked_for(&mut map, 0, 4, 0);
        assert_eq!(map.utc(RigNs(4 * S)), None);
        locked_for(&mut map, 5, 5, 0);
        let reading = UtcReading { utc: UnixNs(UTC0 + 5 * S + 7), sigma: Span(5_000) };
        assert_eq!(map.utc(RigNs(5 * S + 7)), Some(reading));
        assert_eq!(map.wall_error(RigNs(5 * S), UnixNs(UTC0 + 5 * S - 30_000_000)), Some(Span(-30_000_000)));
        assert_eq!(map.utc(RigNs(11 * S)), None, "6 s after the newest stamp");
    }

    #[test]
    fn a_lost_lock_counts_its_five_seconds_anew() {
        let mut map = UtcMap::new();
        locked_for(&mut map, 0, 10, 0);
        map.update(UtcState::Sentence, Some(UnixNs(UTC0 + 11 * S)), RigNs(11 * S), Span(5_000));
        assert_eq!(map.utc(RigNs(11 * S)), None);
        locked_for(&mut map, 12, 16, 0);
        assert_eq!(map.utc(RigNs(16 * S)), None);
        locked_for(&mut map, 17, 17, 0);
        assert!(map.utc(RigNs(17 * S)).is_some());
    }

    #[test]
    fn a_changed_offset_is_a_disagreement_and_not_believed_for_five_seconds() {
        let mut map = UtcMap::new();
        locked_for(&mut map, 0, 10, 0);
        locked_for(&mut map, 11, 15, 2_000_000);
        assert_eq!((map.utc(RigNs(15 * S)), map.disagreements()), (None, 1));
        locked_for(&mut map, 16, 16, 2_000_000);
        let reading = map.utc(RigNs(16 * S)).expect("five seconds");
        assert_eq!(reading.utc, UnixNs(UTC0 + 16 * S + 2_000_000));
    }
}
