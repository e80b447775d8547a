//! A turntable: the bytes on its line to angles with their times.
//!
//! ```text
//!   chunk ─ Speech: zaber listener │ line stream ─▶ reading ─▶ angle, rate, σ ─▶ TurntableSample
//!                                        └─ flags, following error ─▶ Truth
//! ```
//!
//! The chunks of both directions are all there is: a replay gives the samples of the live session.

mod errors;
mod health;
mod sample;
mod speech;
mod truth;

pub(crate) use errors::ErrorWatch;
pub use errors::TurntableErrors;
pub use health::{TruthState, TurntableHealth};
pub use sample::TurntableSample;

use crate::config::{CoreConfig, TurntableSetup};
use crate::health::{EpochHealth, LossHealth, PointHealth, SensorHealth, SensorKind, SensorState, age_ns};
use crate::lidar::Remark;
use crate::notice::{Gravity, NoticeKind};
use crate::vitals::Vitals;
use bytes::Bytes;
use sample::{Angles, Reading};
use speech::{Said, Speech};
use std::collections::BTreeMap;
use truth::Truth;
use tumbled_model::{RigNs, SensorId, SourceState};
use tumbled_serial::zaber::Scale;

/// The encoder's step in counts, where nobody says that it is coarser.
const STEP_COUNTS: u32 = 1;

/// One turntable's way through the core.
#[derive(Debug)]
pub(crate) struct TurntableChannel {
    id: SensorId,
    pub(crate) vitals: Vitals,
    speech: Speech,
    /// Counts of a turn by the config, which go before what the device says.
    configured_counts: Option<u32>,
    angles: Angles,
    truth: Truth,
    ready: Vec<TurntableSample>,
    newest: Option<TurntableSample>,
    samples: u64,
    samples_hz: f64,
    /// Samples and lines of no use a second ago.
    before: (u64, u64),
    unreadable: bool,
    said: Vec<Said>,
    remarks: Vec<Remark>,
}

impl TurntableChannel {
    pub(crate) fn new(setup: &TurntableSetup, config: &CoreConfig) -> Self {
        Self {
            id: setup.id.clone(),
            vitals: Vitals::default(),
            speech: Speech::new(setup, config.timing.clock),
            configured_counts: setup.counts_per_turn,
            angles: Angles::default(),
            truth: Truth::default(),
            ready: Vec::new(),
            newest: None,
            samples: 0,
            samples_hz: 0.0,
            before: (0, 0),
            unreadable: false,
            said: Vec::new(),
            remarks: Vec::new(),
        }
    }

    /// Takes a chunk of either side.
    pub(crate) fn chunk(&mut self, arrived: RigNs, bytes: &Bytes) {
        self.vitals.carried(bytes.len());
        let mut said = core::mem::take(&mut self.said);
        self.speech.chunk(arrived, bytes, &mut said);
        for said in said.drain(..) {
            match said {
                Said::Reading(reading) => self.take(&reading, arrived),
                Said::Begun => {
                    self.angles.begin();
                    self.note_truth(Truth::begin);
                }
                Said::FollowingError { at, counts } => {
                    if let Some(scale) = self.scale() {
                        let error_rad = scale.angle_rad(counts);
                        self.note_truth(|truth| truth.following(at, error_rad));
                    }
                }
                Said::ClockBegan => {
                    let message = format!("the clock of {} began anew: its times are being found again", self.id);
                    self.remarks.push((NoticeKind::ClockReset, Gravity::Warn, message));
                }
            }
        }
        self.said = said;
    }

    fn take(&mut self, reading: &Reading, arrived: RigNs) {
        self.vitals.fresh(arrived);
        self.note_truth(|truth| truth.reading(reading));
        let Some(scale) = self.scale() else { return };
        let is_truth = self.truth.doubt().is_none();
        if let Some(sample) = self.angles.sample(&self.id, reading, scale, is_truth) {
            self.samples += 1;
            self.newest = Some(sample.clone());
            self.ready.push(sample);
        }
    }

    fn scale(&self) -> Option<Scale> {
        let counts = self.configured_counts.or_else(|| self.speech.counts_per_turn())?;
        Scale::new(counts, STEP_COUNTS)
    }

    /// Lets something be learnt of the truth, and tells when that changes what it is worth.
    fn note_truth(&mut self, learn: impl FnOnce(&mut Truth)) {
        let before = self.truth.doubt().map(|doubt| doubt.cause);
        learn(&mut self.truth);
        let id = &self.id;
        let (gravity, message) = match self.truth.doubt() {
            Some(doubt) if before != Some(doubt.cause) => {
                let (cause, since_s) = (doubt.cause, doubt.since.0 as f64 * 1e-9);
                (Gravity::Error, format!("the angle of {id} is no truth from {since_s:.3} s on: {cause}"))
            }
            None if before.is_some() => (Gravity::Info, format!("the angle of {id} is truth again")),
            _ => return,
        };
        self.remarks.push((NoticeKind::Truth, gravity, message));
    }

    /// The samples since the last call.
    pub(crate) fn samples(&mut self) -> std::vec::Drain<'_, TurntableSample> {
        self.ready.drain(..)
    }

    /// What happened since the last call.
    pub(crate) fn remarks(&mut self) -> std::vec::Drain<'_, Remark> {
        self.remarks.drain(..)
    }

    /// Its source's state changed.
    pub(crate) fn source(&mut self, state: SourceState) {
        self.vitals.source(state);
        if state == SourceState::Opened {
            // Between two openings it may have been switched off, and count from anywhere.
            self.speech.begin();
            self.angles.begin();
        }
    }

    /// So many seconds are over since the last call.
    pub(crate) fn seconds(&mut self, seconds: i64) {
        self.vitals.seconds(seconds);
        let (samples, refused) = (self.samples, self.speech.refused());
        self.samples_hz = (samples - self.before.0) as f64 / seconds.max(1) as f64;
        self.unreadable = samples == self.before.0 && refused > self.before.1;
        self.before = (samples, refused);
    }

    /// What it was doing at `t`.
    pub(crate) fn state(&self, t: RigNs) -> SensorState {
        match self.vitals.state(t) {
            SensorState::Absent => SensorState::Absent,
            _ if self.unreadable => SensorState::Fault,
            state => state,
        }
    }

    fn truth_state(&self, t: RigNs) -> TruthState {
        match (&self.newest, self.truth.doubt()) {
            (None, _) => TruthState::Unknown,
            (Some(_), Some(_)) => TruthState::Invalid,
            (Some(_), None) if self.state(t) == SensorState::Live => TruthState::Valid,
            (Some(_), None) => TruthState::Stale,
        }
    }

    /// Its health at `t`, given everything that arrived before.
    pub(crate) fn health(&self, t: RigNs) -> SensorHealth {
        let (newest, doubt) = (self.newest.as_ref(), self.truth.doubt());
        let summed = self.vitals.lost.summed();
        let lost = match self.speech.lost_lines() {
            Some(lines) => LossHealth { total: lines, by_stamps: lines, ..summed },
            None => summed,
        };
        SensorHealth {
            id: self.id.to_string(),
            kind: SensorKind::Serial,
            state: self.state(t),
            received: self.vitals.received,
            bytes: self.vitals.bytes,
            rate_hz: self.vitals.rate_hz(),
            age_ns: age_ns(t, self.vitals.newest),
            lost,
            malformed: self.speech.malformed(),
            malformed_first: BTreeMap::new(),
            duplicates: 0,
            reordered: 0,
            points: PointHealth::default(),
            epochs: EpochHealth::default(),
            clock: self.speech.clock(t).map(Into::into),
            lidar: None,
            kinect: None,
            turntable: Some(TurntableHealth {
                device: self.speech.device(),
                counts_per_turn: self.scale().map(Scale::counts_per_turn),
                samples: self.samples,
                samples_hz: self.samples_hz,
                angle_deg: newest.map(|sample| sample.angle_rad.to_degrees()),
                sigma_deg: newest.map(|sample| sample.sigma_rad.to_degrees()),
                rate_dps: newest.map(|sample| sample.rate_rps.to_degrees()),
                half_rtt_ns: newest.and_then(|sample| sample.half_rtt).map(|half_rtt| half_rtt.0),
                moving: newest.and_then(|sample| sample.moving),
                referenced: self.truth.referenced(),
                refused: self.speech.refusals(),
                truth: self.truth_state(t),
                invalid_since_ns: doubt.map(|doubt| doubt.since.0),
                invalid_because: doubt.map(|doubt| doubt.cause.to_string()),
                errors: None,
            }),
        }
    }
}
