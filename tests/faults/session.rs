//! A session of the made-up rig with faults by script, played through the core: deterministic, faster than the clock.

use tumbled::session::{Engine, setup};
use tumbled_core::health::SensorState;
use tumbled_core::{CoreConfig, CoreHealth, Epoch, Notice, NoticeKind, Scan, SensorHealth, Workers};
use tumbled_model::{Body, Event};
use tumbled_sim::faults::{FaultCounts, FaultInjector, FaultScript, FaultTruth};
use xxhash_rust::xxh3::Xxh3;

use tumbled::cli::Failure;

use crate::support::rig::Rig;

pub(super) const MS: i64 = 1_000_000;
pub(super) const S: i64 = 1_000 * MS;

/// An epoch as it was given out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Seen {
    pub(super) lidar: bool,
    /// Its time, ns.
    pub(super) t: i64,
    pub(super) points: usize,
    /// It saw the region of interest from end to end; turns that were cut short did not.
    pub(super) whole: bool,
    /// Of its points' coordinates in the rig, bit by bit.
    pub(super) digest: u64,
}

/// What came of a session.
pub(super) struct Played {
    pub(super) epochs: Vec<Seen>,
    pub(super) notices: Vec<Notice>,
    pub(super) health: Vec<CoreHealth>,
    pub(super) sensors: Vec<SensorHealth>,
    /// What had been done to it.
    pub(super) truth: FaultTruth,
}

/// The built-in rig: the LiDAR `front` and the Kinect `near`.
pub(super) fn both() -> CoreConfig {
    let config = tumbled::config::load(None, &[]).expect("the built-in config").config;
    setup::core_config(&config).expect("a core")
}

/// So many seconds of the rig, with these sensors' data.
pub(super) fn seconds(seconds: i64, lidar: bool, kinect: bool) -> impl Iterator<Item = Event> {
    seconds_of(Rig::new(80, 60), seconds, lidar, kinect)
}

/// The same of a rig whose Kinect sees another target.
pub(super) fn seconds_of(rig: Rig, seconds: i64, lidar: bool, kinect: bool) -> impl Iterator<Item = Event> {
    let events = rig.take_while(move |event| event.arrived.0 < seconds * S);
    events.filter(move |event| match event.body {
        Body::LidarPacket { .. } => lidar,
        Body::DepthFrame { .. } => kinect,
        _ => true,
    })
}

/// Plays a ledger with faults; no script: none.
pub(super) fn play(events: impl Iterator<Item = Event>, script: &str, config: CoreConfig) -> Played {
    let script: FaultScript = toml::from_str(script).expect("a fault script");
    let mut events = FaultInjector::new(events, script).expect("faults that mean something");
    let no_config = Box::new(|_: &str| Err(Failure::input("no changed config here")));
    let mut engine = Engine::new(config, String::new(), Workers::none(), no_config);
    let (mut epochs, mut notices, mut health) = (Vec::new(), Vec::new(), Vec::new());
    for event in events.by_ref() {
        let outputs = engine.step(&event).outputs;
        epochs.extend(outputs.epochs.iter().map(seen));
        notices.extend(outputs.notices.iter().cloned());
        health.extend(outputs.health.iter().cloned());
    }
    let outputs = engine.finish().outputs;
    epochs.extend(outputs.epochs.iter().map(seen));
    notices.extend(outputs.notices.iter().cloned());
    health.extend(outputs.health.iter().cloned());
    Played { epochs, notices, health, sensors: engine.sensors(), truth: events.truth().clone() }
}

fn seen(epoch: &Epoch) -> Seen {
    let mut digest = Xxh3::new();
    for column in [&epoch.rig.x, &epoch.rig.y, &epoch.rig.z] {
        column.iter().for_each(|value| digest.update(&value.to_bits().to_le_bytes()));
    }
    let lidar = matches!(epoch.scan, Scan::Lidar(_));
    let whole = match &epoch.scan {
        Scan::Lidar(scan) => scan.coverage > 0.9,
        Scan::Kinect(_) => true,
    };
    Seen { whole, lidar, t: epoch.t.0, points: epoch.rig.len(), digest: digest.digest() }
}

impl Played {
    /// The epochs of one sensor.
    pub(super) fn of(&self, lidar: bool) -> Vec<&Seen> {
        self.epochs.iter().filter(|epoch| epoch.lidar == lidar).collect()
    }

    /// How many of them have a time in between, ns.
    pub(super) fn between(&self, lidar: bool, from: i64, to: i64) -> usize {
        self.of(lidar).iter().filter(|epoch| (from..to).contains(&epoch.t)).count()
    }

    /// That no epoch is earlier than the one before it.
    pub(super) fn assert_in_order(&self) {
        assert!(self.epochs.is_sorted_by_key(|epoch| epoch.t), "times went back");
    }

    pub(super) fn sensor(&self, id: &str) -> &SensorHealth {
        self.sensors.iter().find(|sensor| sensor.id == id).expect("a sensor of the rig")
    }

    pub(super) fn done(&self, id: &str) -> FaultCounts {
        self.truth.sensors.get(id).copied().unwrap_or_default()
    }

    /// What was told of a kind, of a sensor.
    pub(super) fn told(&self, id: &str, kind: NoticeKind) -> Vec<&Notice> {
        let of = |notice: &&Notice| notice.kind == kind && notice.sensor.as_ref().is_some_and(|s| s.as_str() == id);
        self.notices.iter().filter(of).collect()
    }

    /// When (ns) a sensor's state was told to have become another; the first is that of its first datum.
    pub(super) fn states(&self, id: &str) -> Vec<(i64, SensorState)> {
        let all =
            [SensorState::Absent, SensorState::Opening, SensorState::Live, SensorState::Stale, SensorState::Fault];
        let becomes = |notice: &&Notice| {
            let named = |state: &SensorState| notice.message.starts_with(&format!("{id} is {} ", state.name()));
            all.into_iter().find(named).map(|state| (notice.t.0, state))
        };
        self.told(id, NoticeKind::SensorState).iter().filter_map(becomes).collect()
    }
}
