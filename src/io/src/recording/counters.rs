//! What went into a recording, by channel and by place of loss.

use std::collections::BTreeMap;
use tumbled_model::{Body, Event, LossPoint, RigNs, SensorId, Span};

use super::layout::{ChannelKey, payload_bytes, place_name};

/// What one channel carried.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ChannelCount {
    /// Events recorded.
    pub events: u64,
    /// Payload, bytes.
    pub bytes: u64,
    /// When the first arrived.
    pub first: Option<RigNs>,
    /// When the last arrived.
    pub last: Option<RigNs>,
    /// The longest time between two events.
    pub longest_gap: Span,
}

/// What a recording, or a part of it, holds.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Events of all channels.
    pub events: u64,
    /// By channel.
    pub channels: BTreeMap<ChannelKey, ChannelCount>,
    /// Packets, frames and chunks posted as lost, by sensor and place.
    pub lost: BTreeMap<(SensorId, LossPoint), u64>,
    /// `seq` of the first event.
    pub first_seq: Option<u64>,
    /// `seq` of the last event.
    pub last_seq: Option<u64>,
    /// When the last event arrived.
    pub last_arrived: Option<RigNs>,
    /// Events of the ledger that are not here: numbers that `seq` jumps over.
    pub missing_seqs: u64,
    /// Places where `seq` does not rise: in a good recording none.
    pub seq_disorder: u64,
}

impl Counters {
    /// Counts an event that follows those counted before.
    pub(crate) fn count(&mut self, channel: &ChannelKey, event: &Event) {
        self.events += 1;
        match self.last_seq {
            Some(last) if event.seq > last => {
                self.missing_seqs = self.missing_seqs.saturating_add(event.seq - last - 1);
            }
            Some(_) => self.seq_disorder += 1,
            None => {}
        }
        self.first_seq.get_or_insert(event.seq);
        self.last_seq = Some(event.seq);
        self.last_arrived = Some(event.arrived);
        // Not the entry API: it would clone the key for every packet.
        if !self.channels.contains_key(channel) {
            self.channels.insert(channel.clone(), ChannelCount::default());
        }
        let count = self.channels.get_mut(channel).expect("inserted above");
        count.events += 1;
        count.bytes += payload_bytes(&event.body) as u64;
        count.first.get_or_insert(event.arrived);
        if let Some(last) = count.last {
            count.longest_gap = count.longest_gap.max(event.arrived - last);
        }
        count.last = Some(event.arrived);
        if let Body::Gap { sensor, lost, place } = &event.body {
            *self.lost.entry((sensor.clone(), *place)).or_default() += u64::from(*lost);
        }
    }

    /// Everything posted as lost.
    pub fn lost_total(&self) -> u64 {
        self.lost.values().sum()
    }

    /// The end record of a part.
    pub(crate) fn to_metadata(&self) -> BTreeMap<String, String> {
        let mut map = BTreeMap::new();
        let mut put = |key: String, value: String| map.insert(key, value);
        put("events".to_owned(), self.events.to_string());
        put("missing_seqs".to_owned(), self.missing_seqs.to_string());
        let seqs = [("first_seq", self.first_seq), ("last_seq", self.last_seq)];
        for (key, seq) in seqs.into_iter().filter_map(|(key, seq)| Some((key, seq?))) {
            put(key.to_owned(), seq.to_string());
        }
        for (channel, count) in &self.channels {
            put(format!("channel.{channel}.events"), count.events.to_string());
            put(format!("channel.{channel}.bytes"), count.bytes.to_string());
            put(format!("channel.{channel}.longest_gap_ns"), count.longest_gap.0.to_string());
        }
        for ((sensor, place), lost) in &self.lost {
            put(format!("lost.{sensor}.{}", place_name(*place)), lost.to_string());
        }
        map
    }
}
