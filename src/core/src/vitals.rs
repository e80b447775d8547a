//! What every sensor's events have in common: how many, how much, when the last came, what was lost on the way.

use crate::health::{LossHealth, SensorState};
use tumbled_model::{LossPoint, RigNs, SourceState, Span};

/// Data are missing when none came for so long: 450 packets of a VLP-32C, nine frames of a Kinect.
const STALE_AFTER: Span = Span(300_000_000);
/// A slow source is given so many of its usual intervals.
const STALE_INTERVALS: i64 = 3;

/// One sensor's pulse, as the ledger has it.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Vitals {
    pub(crate) received: u64,
    pub(crate) bytes: u64,
    pub(crate) newest: Option<RigNs>,
    pub(crate) lost: LossHealth,
    /// Usual time from one datum to the next, ns: a running mean over some ten.
    interval_ns: i64,
    source: Option<SourceState>,
    /// `received` at the newest whole second, for the rate.
    received_before: u64,
    rate_hz: f64,
}

impl Vitals {
    /// A datum came.
    pub(crate) fn datum(&mut self, arrived: RigNs, bytes: usize) {
        self.carried(bytes);
        self.fresh(arrived);
    }

    /// Something came that is no datum by itself: a question on a serial line, a part of a reply.
    pub(crate) fn carried(&mut self, bytes: usize) {
        self.received += 1;
        self.bytes += bytes as u64;
    }

    /// What came makes a datum.
    pub(crate) fn fresh(&mut self, arrived: RigNs) {
        if let Some(newest) = self.newest {
            let interval_ns = (arrived - newest).0.clamp(0, 10_000_000_000);
            self.interval_ns += (interval_ns - self.interval_ns) / 8;
        }
        self.newest = self.newest.max(Some(arrived));
    }

    /// Its source's state changed.
    pub(crate) fn source(&mut self, state: SourceState) {
        self.source = Some(state);
    }

    /// Something was lost.
    pub(crate) fn gap(&mut self, place: LossPoint, lost: u32) {
        self.lost.add(place, u64::from(lost));
    }

    /// So many seconds are over since the last call.
    pub(crate) fn seconds(&mut self, seconds: i64) {
        self.rate_hz = (self.received - self.received_before) as f64 / seconds.max(1) as f64;
        self.received_before = self.received;
    }

    /// Data a second, over the last whole second.
    pub(crate) fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// What it was doing at `t`, given everything that came before.
    pub(crate) fn state(&self, t: RigNs) -> SensorState {
        if matches!(self.source, Some(SourceState::Lost | SourceState::Closed)) {
            return SensorState::Absent;
        }
        let patience = Span((STALE_INTERVALS * self.interval_ns).max(STALE_AFTER.0));
        match (self.newest, self.source) {
            (Some(newest), _) if t - newest <= patience => SensorState::Live,
            (Some(_), _) => SensorState::Stale,
            (None, Some(_)) => SensorState::Opening,
            (None, None) => SensorState::Absent,
        }
    }

    /// Whether others still wait for it at `t`: it may have data on their way.
    pub(crate) fn may_come(&self, t: RigNs, silent_after: Span) -> bool {
        let gone = matches!(self.source, Some(SourceState::Lost | SourceState::Closed));
        !gone && t - self.newest.unwrap_or_default() <= silent_after
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    #[test]
    fn a_sensor_is_live_from_its_first_datum_until_300_ms_after_its_last() {
        let mut vitals = Vitals::default();
        assert_eq!(vitals.state(RigNs(0)), SensorState::Absent);
        vitals.source(SourceState::Opened);
        assert_eq!(vitals.state(RigNs(0)), SensorState::Opening);
        (0..30).for_each(|n| vitals.datum(RigNs(n * MS), 1_206));
        assert_eq!(vitals.state(RigNs(329 * MS)), SensorState::Live);
        assert_eq!(vitals.state(RigNs(330 * MS)), SensorState::Stale);
        vitals.source(SourceState::Lost);
        assert_eq!(vitals.state(RigNs(30 * MS)), SensorState::Absent);
    }

    #[test]
    fn a_camera_of_one_frame_a_second_is_not_stale_between_frames() {
        let mut vitals = Vitals::default();
        (0..20).for_each(|n| vitals.datum(RigNs(n * 1_000 * MS), 614_400));
        assert_eq!(vitals.state(RigNs(20_900 * MS)), SensorState::Live);
        assert_eq!(vitals.state(RigNs(23_000 * MS)), SensorState::Stale);
    }
}
