//! How the core sees itself and its sensors, once a second of the session's time.
//!
//! All of it rests on the ledger: a replay tells the same health. Counts of a second's report are of the events that
//! arrived before that second, however the sensors' events lay among each other.

use crate::clock::{ClockMode, ClockReport, ClockState};
use crate::notice::Gravity;
use crate::turntable::TurntableHealth;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use tumbled_model::{LossPoint, RigNs};

/// The core's part of health.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CoreHealth {
    /// The second it speaks of, ns on the session's timeline.
    pub t_ns: i64,
    /// The worst of the reasons.
    pub level: Level,
    /// What is not as it should be, and what to do about it, a sentence each.
    pub reasons: Vec<Reason>,
    /// The sensors: Kinects, LiDARs, serial devices.
    pub sensors: Vec<SensorHealth>,
    /// The host's wall clock.
    pub wall: WallHealth,
}

/// How well things stand.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// As it should be.
    #[default]
    Ok,
    /// Measurements go on, with less.
    Degraded,
    /// No sensor delivers.
    Failed,
}

/// Something that is not as it should be.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Reason {
    /// How bad it is.
    pub level: Level,
    /// Whose; null: the session's.
    pub sensor: Option<String>,
    /// What, for machines: `stale`, `absent`, `fault`, `loss`, `usb`, `clock`, `blind`; the shell's `source`: why a device gives nothing.
    pub key: String,
    /// What, and what to do, for people.
    pub message: String,
}

/// What a sensor is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SensorState {
    /// Nothing of it was ever seen, or its source lost it.
    #[default]
    Absent,
    /// Its source is open; no data yet.
    Opening,
    /// Data come.
    Live,
    /// Data came and have stopped.
    Stale,
    /// Data come and cannot be used: frozen, or none of them readable.
    Fault,
}

impl SensorState {
    /// The word in health and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Absent => "absent",
            Self::Opening => "opening",
            Self::Live => "live",
            Self::Stale => "stale",
            Self::Fault => "fault",
        }
    }

    /// How much attention a change to it asks for.
    pub const fn gravity(self) -> Gravity {
        match self {
            Self::Live | Self::Opening => Gravity::Info,
            Self::Stale | Self::Absent => Gravity::Warn,
            Self::Fault => Gravity::Error,
        }
    }
}

/// What kind of sensor it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SensorKind {
    /// A depth camera.
    Kinect,
    /// A scanning LiDAR.
    Lidar,
    /// A turntable on a serial port.
    Serial,
}

/// One sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SensorHealth {
    /// Its name in the config.
    pub id: String,
    /// What it is.
    pub kind: SensorKind,
    /// What it is doing.
    pub state: SensorState,
    /// Packets, frames or chunks that came.
    pub received: u64,
    /// Their payload, bytes.
    pub bytes: u64,
    /// Of them in the last second.
    pub rate_hz: f64,
    /// Since the newest came, ns; null: none came.
    pub age_ns: Option<i64>,
    /// What was lost.
    pub lost: LossHealth,
    /// Data that could not be read, by what is wrong with them: `length`, `block_flag`, … A few words whatever comes.
    pub malformed: BTreeMap<String, u64>,
    /// By the same words: what exactly was wrong with the first of them.
    pub malformed_first: BTreeMap<String, String>,
    /// Data that came twice; used once.
    pub duplicates: u64,
    /// Data that came after later ones; frames also whose time is nearer to the one before than a sensor's period allows.
    pub reordered: u64,
    /// Points by what became of them: `decoded` is the sum of the others and of those on their way.
    pub points: PointHealth,
    /// Epochs, up to a second ago.
    pub epochs: EpochHealth,
    /// Its clock; null: it has none, or nothing came yet.
    pub clock: Option<ClockHealth>,
    /// What only a LiDAR has.
    pub lidar: Option<LidarHealth>,
    /// What only a Kinect has.
    pub kinect: Option<KinectHealth>,
    /// What only a turntable has.
    pub turntable: Option<TurntableHealth>,
}

/// Losses of one sensor, in packets, frames or chunks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LossHealth {
    /// All, each counted once: by the sensor's stamps where these can tell, else where it was noticed.
    pub total: u64,
    /// What the stamps say was sent and never came; includes what was lost on this host.
    pub by_stamps: u64,
    /// In the kernel's socket buffer.
    pub kernel: u64,
    /// In the queue to the ledger.
    pub queue: u64,
    /// On the USB.
    pub usb: u64,
    /// Missing in the recording that is replayed, not in the session it is of.
    pub recorder: u64,
    /// Missing in the capture file.
    pub capture: u64,
}

impl LossHealth {
    /// The same with the places' sum as the total: for sensors without stamps that tell more.
    pub(crate) fn summed(self) -> Self {
        Self { total: self.kernel + self.queue + self.usb + self.recorder + self.capture, ..self }
    }

    /// Notes what was lost at a place.
    pub(crate) fn add(&mut self, place: LossPoint, lost: u64) {
        let count = match place {
            LossPoint::Kernel => &mut self.kernel,
            LossPoint::Queue => &mut self.queue,
            LossPoint::Usb => &mut self.usb,
            LossPoint::Recorder => &mut self.recorder,
            _ => &mut self.capture,
        };
        *count += lost;
    }
}

/// Points of one sensor by what became of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointHealth {
    /// All points decoded.
    pub decoded: u64,
    /// In an epoch of this sensor.
    pub in_epochs: u64,
    /// Of packets that came twice.
    pub duplicate: u64,
    /// Of packets that came after their place was gone.
    pub late: u64,
    /// Of data whose time could not be told.
    pub untimed: u64,
    /// Of scans that the live session shed.
    pub shed: u64,
}

/// Epochs of one sensor that were complete before the last second, by what became of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EpochHealth {
    /// Given out.
    pub given_out: u64,
    /// Left out: a later one of another sensor had been given out.
    pub late: u64,
    /// Left out: the sensor was coming back from a silence.
    pub joining: u64,
    /// Points of those left out.
    pub points_left_out: u64,
    /// Scans that the live session shed, up to now.
    pub shed_scans: u64,
}

/// A device's clock.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ClockHealth {
    /// `acquiring`, `locked`, `holdover`, `lost` or `suspect`.
    #[schemars(with = "String")]
    pub state: ClockState,
    /// `hull`, `arrival` or `kalman`.
    #[schemars(with = "String")]
    pub mode: ClockMode,
    /// Rig time minus device time at the newest stamp, ns.
    pub offset_ns: i64,
    /// How much slower than the host it runs, ppm.
    pub skew_ppm: f64,
    /// One standard deviation of mapped times, ns.
    pub sigma_ns: i64,
    /// Times it began anew.
    pub resets: u64,
    /// Changes of more than 5 ms.
    pub steps: u64,
    /// Stamps that did not fit.
    pub doubtful: u64,
}

impl From<ClockReport> for ClockHealth {
    fn from(report: ClockReport) -> Self {
        Self {
            state: report.state,
            mode: report.mode,
            offset_ns: report.offset.0,
            skew_ppm: report.skew_ppm,
            sigma_ns: report.sigma.0,
            resets: report.counts.resets.total(),
            steps: report.counts.steps,
            doubtful: report.counts.doubtful,
        }
    }
}

/// What only a LiDAR has.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LidarHealth {
    /// The model, once known.
    pub model: Option<String>,
    /// The return mode, once known.
    pub return_mode: Option<String>,
    /// Turns a minute, once known.
    pub rpm: Option<f64>,
    /// What its stamps have to do with UTC.
    pub utc: String,
    /// UTC at `t_ns` by the sensor, ns since 1970 as a decimal string; null unless its pulse has been locked for 5 s.
    pub utc_ns: Option<String>,
    /// How much of the region of interest the last turn swept, 0..=1.
    pub coverage: Option<f64>,
    /// Crossings of the region that nothing was received of.
    pub missed_crossings: u64,
    /// Points in the region of interest in the last turn.
    pub points_in_roi: u64,
    /// What the packets say they are, where the config says otherwise.
    pub contradiction: Option<String>,
}

/// What only a Kinect has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct KinectHealth {
    /// Frames that repeat the one before: not used.
    pub repeated: u64,
    /// Of them at a stretch, up to now.
    pub repeated_in_a_row: u64,
    /// Frames with lost USB packets: used without those pixels.
    pub frames_with_loss: u64,
    /// Pixels that were lost so.
    pub lost_pixels: u64,
    /// Points in the region of interest in the last frame.
    pub points_in_roi: u64,
}

/// The host's wall clock.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WallHealth {
    /// Wall time at `t_ns`, ns since 1970-01-01 UTC as a decimal string; null: the ledger has no anchors.
    pub unix_ns: Option<String>,
    /// Times it was set by more than 1 ms.
    pub steps: u64,
    /// The newest step, ns; positive = forward.
    pub last_step_ns: Option<i64>,
}

/// A reason has to hold for so many reports before it is told, and to be gone for as many before it is not: a lost
/// packet makes no flicker.
const HYSTERESIS: u32 = 2;

/// Turns what is observed each second into reasons that neither flicker nor stick.
#[derive(Clone, Debug, Default)]
pub(crate) struct Judge {
    held: BTreeMap<(Option<String>, String), Held>,
}

/// A reason and for how many seconds on end it has held, or not.
#[derive(Clone, Debug)]
struct Held {
    seen: u32,
    missed: u32,
    told: bool,
    reason: Reason,
}

impl Judge {
    /// Takes what holds in this second; gives what is to be told.
    pub(crate) fn judge(&mut self, observed: Vec<Reason>) -> Vec<Reason> {
        for held in self.held.values_mut() {
            held.missed += 1;
        }
        for reason in observed {
            let key = (reason.sensor.clone(), reason.key.clone());
            let fresh = Held { seen: 0, missed: 1, told: false, reason: reason.clone() };
            let held = self.held.entry(key).or_insert(fresh);
            held.seen += u32::from(held.missed > 0);
            held.missed = 0;
            held.reason = reason;
        }
        for held in self.held.values_mut() {
            held.seen = if held.missed > 0 { 0 } else { held.seen };
            held.told = if held.told { held.missed < HYSTERESIS } else { held.seen >= HYSTERESIS };
        }
        self.held.retain(|_, held| held.told || held.seen > 0);
        self.held.values().filter(|held| held.told).map(|held| held.reason.clone()).collect()
    }
}

/// The worst of some reasons.
pub(crate) fn worst(reasons: &[Reason]) -> Level {
    reasons.iter().map(|reason| reason.level).max().unwrap_or_default()
}

/// How old something is.
pub(crate) fn age_ns(now: RigNs, newest: Option<RigNs>) -> Option<i64> {
    newest.map(|newest| (now - newest).0.max(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stale() -> Reason {
        Reason {
            level: Level::Degraded,
            sensor: Some("front".to_owned()),
            key: "stale".to_owned(),
            message: "no packets".to_owned(),
        }
    }

    #[test]
    fn a_reason_is_told_from_its_second_second_to_its_second_absence() {
        let mut judge = Judge::default();
        let told: Vec<usize> = [true, false, true, true, true, false, true, false, false, true]
            .into_iter()
            .map(|holds| judge.judge(if holds { vec![stale()] } else { Vec::new() }).len())
            .collect();
        assert_eq!(told, [0, 0, 0, 1, 1, 1, 1, 1, 0, 0]);
    }
}
