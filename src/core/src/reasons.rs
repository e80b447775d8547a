//! From what is observed of the sensors to what a person should know and do.

use crate::clock::ClockState;
use crate::health::{Level, Reason, SensorHealth, SensorKind, SensorState};
use crate::turntable::TurntableHealth;
use std::collections::{BTreeMap, VecDeque};

/// So small a share of packets may be lost without a word.
const LOSS_SHARE: f64 = 0.001;
/// Over so many seconds: what was lost long ago is in the counts, and no reason to do something now.
const LOSS_SECONDS: usize = 10;
/// A turn that sweeps less of the region of interest is worth a word.
const LEAST_COVERAGE: f64 = 0.9;

/// Looks at the sensors once a second.
#[derive(Clone, Debug, Default)]
pub(crate) struct Observer {
    /// By sensor: what it had received and lost in the last seconds.
    seen: BTreeMap<String, VecDeque<Traffic>>,
}

/// What a sensor sent so far.
#[derive(Clone, Copy, Debug, Default)]
struct Traffic {
    received: u64,
    lost: u64,
    /// Of a Kinect's frames that were received: those with packets missing.
    damaged: u64,
}

impl Observer {
    /// Everything that is not as it should be in this second.
    pub(crate) fn observe(&mut self, sensors: &[SensorHealth]) -> Vec<Reason> {
        let mut reasons = Vec::new();
        for sensor in sensors {
            state(sensor, &mut reasons);
            let lately = self.lately(sensor);
            if sensor.state == SensorState::Live {
                loss(sensor, lately, &mut reasons);
                quality(sensor, &mut reasons);
            }
        }
        no_data(sensors, &mut reasons);
        reasons
    }

    /// What came and what was lost in the last [`LOSS_SECONDS`].
    fn lately(&mut self, sensor: &SensorHealth) -> Traffic {
        let damaged = sensor.kinect.map_or(0, |kinect| kinect.frames_with_loss);
        let now = Traffic { received: sensor.received, lost: sensor.lost.total, damaged };
        let seen = self.seen.entry(sensor.id.clone()).or_default();
        let before = seen.front().copied().unwrap_or_default();
        seen.push_back(now);
        if seen.len() > LOSS_SECONDS {
            seen.pop_front();
        }
        // A late packet takes its loss back.
        Traffic {
            received: now.received - before.received,
            lost: now.lost.saturating_sub(before.lost),
            damaged: now.damaged - before.damaged,
        }
    }
}

fn no_data(sensors: &[SensorHealth], reasons: &mut Vec<Reason>) {
    let measuring = |sensor: &&SensorHealth| sensor.kind != SensorKind::Serial;
    let any_live = sensors.iter().filter(measuring).any(|sensor| sensor.state == SensorState::Live);
    if !any_live && sensors.iter().any(|sensor| measuring(&sensor)) {
        reasons.push(Reason {
            level: Level::Failed,
            sensor: None,
            key: "no_data".to_owned(),
            message: "no sensor delivers data: `tumbled doctor` looks for the cause".to_owned(),
        });
    }
}

fn reason(sensor: &SensorHealth, key: &str, message: String) -> Reason {
    Reason { level: Level::Degraded, sensor: Some(sensor.id.clone()), key: key.to_owned(), message }
}

fn state(sensor: &SensorHealth, reasons: &mut Vec<Reason>) {
    let id = &sensor.id;
    let (key, message) = match (sensor.state, sensor.kind) {
        (SensorState::Live, _) => return,
        (SensorState::Absent, SensorKind::Lidar) => {
            ("absent", format!("{id} is not there: check its cable, its power and lidar.{id}.port"))
        }
        (SensorState::Absent, _) => ("absent", format!("{id} is not there: check its cable and its power")),
        (SensorState::Opening, SensorKind::Lidar) => (
            "opening",
            format!("{id} has sent nothing yet: check its power, its destination address and lidar.{id}.source"),
        ),
        (SensorState::Opening, _) => ("opening", format!("{id} is open and has sent nothing yet")),
        (SensorState::Stale, _) => {
            let age = sensor.age_ns.unwrap_or_default() as f64 * 1e-9;
            ("stale", format!("{id} has sent nothing for {age:.1} s: check its cable and its power"))
        }
        (SensorState::Fault, SensorKind::Kinect) => (
            "fault",
            format!("{id} is frozen, it sends the same frame again and again: unplug it and plug it in again"),
        ),
        (SensorState::Fault, SensorKind::Serial) => {
            ("fault", format!("nothing {id} sends can be read: check turntable.protocol and turntable.baud"))
        }
        (SensorState::Fault, SensorKind::Lidar) => (
            "fault",
            format!("{id} sends data that cannot be read: check lidar.{id}.model, or another sender on its port"),
        ),
    };
    reasons.push(reason(sensor, key, message));
}

fn loss(sensor: &SensorHealth, lately: Traffic, reasons: &mut Vec<Reason>) {
    let (id, Traffic { received, lost, damaged }) = (&sensor.id, lately);
    let sent = received + lost;
    if damaged as f64 > LOSS_SHARE * received as f64 {
        let message = format!(
            "{damaged} of {id}'s {received} frames of the last {LOSS_SECONDS} s lack USB packets, and are used without those \
             pixels: give it a USB controller of its own, and its receiver time"
        );
        reasons.push(reason(sensor, "usb", message));
    }
    if lost as f64 > LOSS_SHARE * sent as f64 {
        let share = 100.0 * lost as f64 / sent as f64;
        let here = sensor.lost.kernel + sensor.lost.queue;
        let place = if here > 0 { "on this machine too: give the receiver more buffer or time" } else { "on the way" };
        let what = if sensor.kind == SensorKind::Kinect { "frames" } else { "packets" };
        let message = format!("{lost} of {id}'s {what} were lost in the last {LOSS_SECONDS} s ({share:.2} %), {place}");
        reasons.push(reason(sensor, "loss", message));
    }
}

fn quality(sensor: &SensorHealth, reasons: &mut Vec<Reason>) {
    let id = &sensor.id;
    if let Some(clock) = sensor.clock.filter(|clock| clock.state == ClockState::Suspect) {
        let skew = clock.skew_ppm;
        reasons.push(reason(
            sensor,
            "clock",
            format!("{id}'s clock does not run evenly (skew {skew:+.0} ppm): its times may be wrong"),
        ));
    }
    if let Some(turntable) = &sensor.turntable {
        truth(sensor, turntable, reasons);
    }
    let Some(lidar) = &sensor.lidar else { return };
    if let Some(coverage) = lidar.coverage.filter(|coverage| *coverage < LEAST_COVERAGE) {
        let seen = 100.0 * coverage;
        reasons.push(reason(
            sensor,
            "blind",
            format!(
                "{id} sweeps {seen:.0} % of the region of interest: its field of view, or target.roi_center_m, is wrong"
            ),
        ));
    }
    if let Some(found) = &lidar.contradiction {
        reasons.push(reason(
            sensor,
            "model",
            format!("{id}'s packets say {found}: set lidar.{id}.model to what it is"),
        ));
    }
}

fn truth(sensor: &SensorHealth, turntable: &TurntableHealth, reasons: &mut Vec<Reason>) {
    let id = &sensor.id;
    if let (Some(why), Some(since)) = (&turntable.invalid_because, turntable.invalid_since_ns) {
        let since_s = since as f64 * 1e-9;
        reasons.push(reason(sensor, "truth", format!("{id}'s angle is no truth from {since_s:.1} s on: {why}")));
    }
    if turntable.counts_per_turn.is_none() {
        let message = format!("{id} has not said how many counts a turn has: set turntable.counts_per_turn");
        reasons.push(reason(sensor, "counts", message));
    }
}
