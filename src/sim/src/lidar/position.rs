//! Position packets: what the sensor says of its pulse and its GPS receiver.

use super::{LidarModel, Packet};
use bytes::Bytes;
use serde::{Deserialize, Serialize};
use tumbled_model::{LidarTime, RigNs, UnixNs, nmea};
use tumbled_velodyne::encode::position_packet;
use tumbled_velodyne::position::Pps;

const SECOND_NS: i64 = 1_000_000_000;

/// A sentence has reached the sensor this long after the pulse that it names: receivers take 50 to 500 ms.
const SENTENCE_LATE_NS: i64 = 300_000_000;

/// What a sensor has of GPS.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Gps {
    /// No receiver.
    #[default]
    None,
    /// Sentences, and no pulse: the counter runs free.
    Sentence,
    /// Sentences and pulse. The clock has to be [`crate::clock::SimClock::locked`] for them to be true.
    Locked,
}

impl LidarModel {
    /// A position packet: the `index`-th since the session's start. `None` for a sensor that sends none, an HDL-64E.
    pub fn position(&self, index: u64) -> Option<Packet> {
        if self.hdl64.is_some() {
            return None;
        }
        let config = &self.config;
        let every_ns = config.position_every.0.max(1) as u64;
        let t = config.clock.instant(index.saturating_mul(every_ns).min(i64::MAX as u64 / 2) as i64);
        let stamp: LidarTime = config.clock.lidar(t);
        let (pps, sentence) = match config.gps {
            Gps::None => (Pps::Absent, String::new()),
            Gps::Sentence => (Pps::Absent, self.sentence(t)),
            Gps::Locked => (Pps::Locked, self.sentence(t)),
        };
        Some(Packet { t, end: t, bytes: Bytes::copy_from_slice(&position_packet(stamp, pps, &sentence)) })
    }

    /// The newest sentence that the sensor has.
    fn sentence(&self, t: RigNs) -> String {
        let heard_ns = self.config.unix_at_zero.0.saturating_add(t.0) - SENTENCE_LATE_NS;
        nmea::format_rmc(UnixNs(heard_ns.div_euclid(SECOND_NS) * SECOND_NS), true)
    }
}
