//! What a recorded ledger holds, as reports of several commands tell it: channels, losses, parts.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_io::recording::layout::place_name;
use tumbled_io::recording::{Counters, PartEnd, PartInfo, RecordingInfo};

/// What a ledger holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LedgerReport {
    /// Events of all channels.
    pub events: u64,
    /// `seq` of the first event; null: there is none.
    pub first_seq: Option<u64>,
    /// `seq` of the last event.
    pub last_seq: Option<u64>,
    /// When the last event arrived, ns on the session's timeline.
    pub last_t_ns: Option<i64>,
    /// Numbers that `seq` jumps over: events of the session that are not here.
    pub missing_seqs: u64,
    /// The channels, by kind and sensor.
    pub channels: Vec<ChannelReport>,
    /// What is posted as lost, by sensor and place.
    pub lost: Vec<LossReport>,
}

/// One channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ChannelReport {
    /// Its topic.
    pub channel: String,
    /// Events.
    pub events: u64,
    /// Payload, bytes.
    pub bytes: u64,
    /// Events a second from its first to its last; null for fewer than two.
    pub rate_hz: Option<f64>,
    /// The longest time between two events, seconds.
    pub longest_gap_s: f64,
}

/// Something posted as lost.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LossReport {
    /// Whose data.
    pub sensor: String,
    /// Where: kernel, queue, usb, recorder, capture.
    pub place: String,
    /// Packets, frames or chunks.
    pub count: u64,
}

/// One part of a recording.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PartReport {
    /// The file.
    pub path: PathBuf,
    /// Its number in the recording, from 0.
    pub part: u32,
    /// Its size, bytes.
    pub file_bytes: u64,
    /// It has its end record and its index: other programs open it as it is.
    pub finished: bool,
    /// Why its recorder stopped before it was told to; null: it did not, or nothing says so.
    pub stopped: Option<String>,
    /// Events read from it.
    pub events: u64,
    /// Events that were recorded in it and cannot be read; null: it has no end record to tell.
    pub events_lost: Option<u64>,
    /// Bytes that damage affects; of a chunk the file ends in, some were read all the same.
    pub damaged_bytes: u64,
    /// The damage, place by place; the first 64.
    pub damage: Vec<DamageReport>,
}

/// A place that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DamageReport {
    /// Offset in the file.
    pub byte: u64,
    /// Bytes it affects: the damaged record's, or all from there to the file's end.
    pub bytes: u64,
    /// What is wrong.
    pub detail: String,
}

impl From<&Counters> for LedgerReport {
    fn from(counters: &Counters) -> Self {
        let channels = counters.channels.iter().map(|(key, count)| {
            let span = count.first.zip(count.last).map_or(0.0, |(first, last)| (last - first).as_secs_f64());
            let intervals = count.events.saturating_sub(1) as f64;
            ChannelReport {
                channel: key.to_string(),
                events: count.events,
                bytes: count.bytes,
                rate_hz: (span > 0.0).then_some(intervals / span),
                longest_gap_s: count.longest_gap.as_secs_f64(),
            }
        });
        let lost = counters.lost.iter().map(|((sensor, place), count)| LossReport {
            sensor: sensor.to_string(),
            place: place_name(*place).to_owned(),
            count: *count,
        });
        Self {
            events: counters.events,
            first_seq: counters.first_seq,
            last_seq: counters.last_seq,
            last_t_ns: counters.last_arrived.map(|arrived| arrived.0),
            missing_seqs: counters.missing_seqs,
            channels: channels.collect(),
            lost: lost.collect(),
        }
    }
}

impl From<&PartInfo> for PartReport {
    fn from(part: &PartInfo) -> Self {
        let damage = part.damage.iter().map(|damage| DamageReport {
            byte: damage.offset,
            bytes: damage.bytes,
            detail: damage.detail.clone(),
        });
        Self {
            path: part.path.clone(),
            part: part.number,
            file_bytes: part.file_bytes,
            finished: part.finished && part.events_recorded.is_some(),
            stopped: match &part.end {
                Some(PartEnd::Stopped { reason }) => Some(reason.clone()),
                _ => None,
            },
            events: part.events_read,
            events_lost: part.events_lost(),
            damaged_bytes: part.damaged_bytes,
            damage: damage.collect(),
        }
    }
}

/// The parts of a recording.
pub fn parts(info: &RecordingInfo) -> Vec<PartReport> {
    info.parts.iter().map(Into::into).collect()
}

/// One line a channel: events, rate, longest silence, payload, and what of its sensor is posted as lost.
pub fn table(report: &LedgerReport) -> Vec<String> {
    let width = report.channels.iter().map(|channel| channel.channel.chars().count()).max().unwrap_or(0);
    let channel = |channel: &ChannelReport| {
        let name = &channel.channel;
        let rate = channel.rate_hz.map_or_else(|| "-".to_owned(), |rate| format!("{rate:.1}"));
        let gap = format!("{:.1}", channel.longest_gap_s * 1e3);
        let megabytes = format!("{:.3}", channel.bytes as f64 / 1e6);
        format!("{name:<width$} {:>9} events {rate:>9} Hz  longest gap {gap:>9} ms {megabytes:>11} MB", channel.events)
    };
    let loss = |loss: &LossReport| format!("lost, as posted: {} of {} ({})", loss.count, loss.sensor, loss.place);
    report.channels.iter().map(channel).chain(report.lost.iter().map(loss)).collect()
}
