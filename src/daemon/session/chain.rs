//! A hash chain over what went into the core and what came out of it: two runs are the same to the bit exactly if their
//! chains are.
//!
//! Beside the hash of the config and the rig's files, five run through a session: of the ledger's events as they are
//! recorded, and of the core's epochs, states, notices and health. Once a second, where the core tells its health, their values are a checkpoint; a recording keeps them, and
//! `tumbled verify` and `tumbled replay --digest` compute them anew.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::estimate::TargetState;
use tumbled_core::{CoreHealth, Epoch, KinectScan, LidarScan, Notice, Scan, TimeBasis};
use tumbled_io::recording::layout::encode;
use tumbled_io::recording::results::CHECKPOINTS;
use tumbled_io::recording::{AttachedFile, ChannelKey, ResultKind, ResultMessage};
use tumbled_model::{Event, RigNs, UnixNs};
use xxhash_rust::xxh3::xxh3_128;
use zerocopy::IntoBytes;

use crate::stream::{StateLine, StreamOrigin};

/// Hex digits of a published hash: 128 bits tell any two runs apart.
const HEX_DIGITS: usize = 32;

/// The chain's values after a stretch of the session.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Checkpoint {
    /// The last event that went in.
    pub seq: u64,
    /// Rig time of the health that it follows, or of the session's end, ns.
    pub t_ns: i64,
    /// Events so far.
    pub events: u64,
    /// Epochs so far.
    pub epochs: u64,
    /// Of the config and the rig's files that the session began with.
    pub rig: String,
    /// Of the events, raw bytes and arrivals included.
    pub ledger: String,
    /// Of the epochs: times, points, everything.
    pub epoch: String,
    /// Of the target's states; empty in a recording of a version that made none, which agrees with any.
    #[serde(default)]
    pub state: String,
    /// Of the notices.
    pub notice: String,
    /// Of the core's health.
    pub health: String,
}

impl Checkpoint {
    /// The fields that differ from another's, first what comes first on the way through the core.
    pub fn differences(&self, other: &Self) -> Vec<&'static str> {
        let fields = [
            ("rig", self.rig == other.rig),
            ("seq", self.seq == other.seq),
            ("events", self.events == other.events),
            ("ledger", self.ledger == other.ledger),
            ("epochs", self.epochs == other.epochs && self.epoch == other.epoch),
            ("states", self.state == other.state || self.state.is_empty() || other.state.is_empty()),
            ("notices", self.notice == other.notice),
            ("health", self.health == other.health),
            ("t_ns", self.t_ns == other.t_ns),
        ];
        fields.into_iter().filter(|(_, same)| !same).map(|(name, _)| name).collect()
    }

    /// With what follows from the events alone: of a recording that is not of the whole session.
    pub fn of_events_alone(self) -> Self {
        let nothing = String::new;
        Self { epochs: 0, epoch: nothing(), state: nothing(), notice: nothing(), health: nothing(), ..self }
    }

    /// Whether it holds nothing of what came out.
    pub fn is_of_events_alone(&self) -> bool {
        [&self.epoch, &self.state, &self.notice, &self.health].iter().all(|hash| hash.is_empty())
    }

    /// How checkpoints stand in a recording.
    pub fn kind() -> ResultKind {
        let schema = schemars::schema_for!(Self);
        ResultKind { topic: CHECKPOINTS, schema_name: "tumbled.Checkpoint", schema: schema.as_value().to_string() }
    }

    /// As a message of a recording.
    pub fn to_message(&self) -> ResultMessage {
        let json = serde_json::to_vec(self).unwrap_or_default();
        ResultMessage { topic: CHECKPOINTS.to_owned(), t: RigNs(self.t_ns), seq: self.seq, json: json.into() }
    }

    /// From a message of a recording; `None`: it is no checkpoint that this version knows.
    pub fn from_message(message: &ResultMessage) -> Option<Self> {
        (message.topic == CHECKPOINTS).then(|| serde_json::from_slice(&message.json).ok()).flatten()
    }

    /// One hash over what came out: equal for a live session and its replay, and for any interleaving of the sensors.
    pub fn outputs_digest(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        for part in [&self.epoch, &self.state, &self.notice, &self.health] {
            hasher.update(part.as_bytes());
        }
        hex(&hasher)
    }
}

/// One hash over a config and the files it names: what the core was told of the rig.
pub fn rig_digest(config: &str, files: &[AttachedFile]) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&(config.len() as u64).to_le_bytes()).update(config.as_bytes());
    for file in files {
        hasher.update(file.key.as_bytes()).update(&[0]).update(file.file.blake3.as_bytes());
    }
    hex(&hasher)
}

/// The running hashes.
#[derive(Clone, Debug, Default)]
pub struct Chain {
    rig: String,
    ledger: blake3::Hasher,
    epoch: blake3::Hasher,
    state: blake3::Hasher,
    notice: blake3::Hasher,
    health: blake3::Hasher,
    events: u64,
    epochs: u64,
    seq: u64,
    message: Vec<u8>,
}

impl Chain {
    /// A chain of a session on the rig of a [`rig_digest`].
    pub fn new(rig: String) -> Self {
        Self { rig, ..Self::default() }
    }

    /// An event went in.
    pub fn event(&mut self, event: &Event) {
        self.events += 1;
        self.seq = event.seq;
        self.message.clear();
        // Whose it is: the message alone holds what it is.
        if let Some(channel) = ChannelKey::of(&event.body) {
            self.message.extend_from_slice(channel.to_string().as_bytes());
        }
        self.message.push(0);
        encode(event, &mut self.message);
        let length = self.message.len() as u64;
        self.ledger.update(&length.to_le_bytes()).update(&self.message);
    }

    /// An epoch came out.
    pub fn epoch(&mut self, epoch: &Epoch) {
        self.epochs += 1;
        hash_epoch(epoch, &mut self.epoch);
    }

    /// A state of the target came out.
    pub fn state(&mut self, state: &TargetState) {
        let line = StateLine::of_epoch(StreamOrigin::Replay, state, UnixNs(0));
        let line = serde_json::to_string(&line).unwrap_or_else(|error| error.to_string());
        self.state.update(line.as_bytes()).update(b"\n");
    }

    /// A notice came out.
    pub fn notice(&mut self, notice: &Notice) {
        let Notice { t, sensor, gravity, kind, message } = notice;
        let sensor = sensor.as_ref().map_or("", |sensor| sensor.as_str());
        let line = format!("{}\0{sensor}\0{gravity:?}\0{kind:?}\0{message}\n", t.0);
        self.notice.update(line.as_bytes());
    }

    /// Health came out.
    pub fn health(&mut self, health: &CoreHealth) {
        let line = serde_json::to_string(health).unwrap_or_else(|error| error.to_string());
        self.health.update(line.as_bytes()).update(b"\n");
    }

    /// The values so far, at rig time `t_ns`.
    pub fn checkpoint(&self, t_ns: i64) -> Checkpoint {
        Checkpoint {
            seq: self.seq,
            t_ns,
            events: self.events,
            epochs: self.epochs,
            rig: self.rig.clone(),
            ledger: hex(&self.ledger),
            epoch: hex(&self.epoch),
            state: hex(&self.state),
            notice: hex(&self.notice),
            health: hex(&self.health),
        }
    }
}

fn hex(hasher: &blake3::Hasher) -> String {
    let mut text = hasher.finalize().to_hex().to_string();
    text.truncate(HEX_DIGITS);
    text
}

/// Every field of an epoch. Destructured, so that a new field is not forgotten.
fn hash_epoch(epoch: &Epoch, into: &mut blake3::Hasher) {
    let Epoch { number, sensor, t, span, sigma, basis, arrived, scan, rig } = epoch;
    let basis = match basis {
        TimeBasis::Arrival => 0u8,
        TimeBasis::Device(state) => 1 + *state as u8,
    };
    into.update(&number.to_le_bytes()).update(sensor.as_str().as_bytes()).update(&[0, basis]);
    for time in [t.0, span.0.0, span.1.0, sigma.0, arrived.0] {
        into.update(&time.to_le_bytes());
    }
    match scan {
        Scan::Kinect(KinectScan { points, loss }) => {
            into.update(&loss.packets.to_le_bytes()).update(&loss.pixels.to_le_bytes());
            columns(into, [points.x(), points.y(), points.z(), points.sigma_z()]);
            column(into, points.pixel().as_bytes());
        }
        Scan::Lidar(scan) => {
            let LidarScan { stamp, points, crossing, coverage, packets } = scan.as_ref();
            let tumbled_velodyne::Points {
                x,
                y,
                z,
                range_m,
                azimuth_rad,
                dt_ns,
                intensity,
                laser,
                ring,
                column: of_packet,
                ret,
            } = points;
            into.update(&stamp.0.to_le_bytes()).update(&coverage.to_bits().to_le_bytes());
            for count in [crossing.start as u64, crossing.end as u64, u64::from(*packets)] {
                into.update(&count.to_le_bytes());
            }
            columns(into, [x, y, z, range_m, azimuth_rad]);
            column(into, dt_ns.as_bytes());
            for bytes in [intensity, laser, ring, of_packet] {
                column(into, bytes);
            }
            let ret: Vec<u8> = ret.iter().map(|ret| *ret as u8).collect();
            column(into, &ret);
        }
    }
    columns(into, [&rig.x, &rig.y, &rig.z]);
    column(into, rig.in_roi.as_bytes());
}

fn columns<const N: usize>(into: &mut blake3::Hasher, columns: [&[f32]; N]) {
    columns.into_iter().for_each(|values| column(into, values.as_bytes()));
}

/// A column by its length and a fast hash: ten megabytes a frame go through here.
fn column(into: &mut blake3::Hasher, bytes: &[u8]) {
    into.update(&(bytes.len() as u64).to_le_bytes()).update(&xxh3_128(bytes).to_le_bytes());
}
