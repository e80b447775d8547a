//! The turns of a LiDAR's head, counted.

use tumbled_model::{LidarTime, RigNs};
use tumbled_velodyne::azimuth::forward_cdeg;
use tumbled_velodyne::stream::PacketInfo;
use tumbled_velodyne::track::Order;

/// A turn, 0.01°.
const TURN_CDEG: i64 = 36_000;

const HOUR_NS: i64 = LidarTime::HOUR_US as i64 * 1_000;

/// Counts the turns of the head by the packets' first azimuths, from the first packet's.
#[derive(Debug, Default)]
pub(super) struct Turns {
    turned_cdeg: i64,
    newest: Option<Newest>,
}

/// The packet that came farthest.
#[derive(Clone, Copy, Debug)]
struct Newest {
    first_cdeg: u16,
    stamp: Option<LidarTime>,
    arrived: RigNs,
}

impl Turns {
    /// Turns so far, the one under way included.
    pub(super) fn seen(&self) -> i64 {
        self.turned_cdeg / TURN_CDEG + 1
    }

    /// The turn a packet lies in, from 0; `rpm` is the head's speed by all packets so far, if known.
    ///
    /// The azimuths tell the angle but for whole turns; across a gap these follow from speed and stamps. A packet that
    /// is late or comes a second time lies less than a turn back and moves nothing.
    pub(super) fn of(&mut self, packet: &PacketInfo, rpm: Option<f64>) -> u64 {
        let (first_cdeg, _) = packet.azimuth_cdeg;
        let now = Newest { first_cdeg, stamp: packet.stamp, arrived: packet.arrived };
        let Some(newest) = self.newest else {
            self.newest = Some(now);
            return 0;
        };
        if let Order::Duplicate | Order::Late = packet.order {
            let back_cdeg = i64::from(forward_cdeg(first_cdeg, newest.first_cdeg));
            return turn_at(self.turned_cdeg - back_cdeg);
        }
        let step_cdeg = i64::from(forward_cdeg(newest.first_cdeg, first_cdeg));
        let whole_turns = match (rpm, newest.span_to(&now)) {
            (Some(rpm), Some(span_ns)) if matches!(packet.order, Order::Next { .. }) => {
                let turns = rpm / 60e9 * span_ns as f64 - step_cdeg as f64 / TURN_CDEG as f64;
                turns.round().max(0.0) as i64
            }
            _ => 0,
        };
        if packet.order == Order::Doubtful {
            // The head stands where it says; its stamp is no measure for what follows.
            return turn_at(self.turned_cdeg + step_cdeg);
        }
        self.turned_cdeg += step_cdeg + whole_turns * TURN_CDEG;
        self.newest = Some(now);
        turn_at(self.turned_cdeg)
    }
}

fn turn_at(turned_cdeg: i64) -> u64 {
    (turned_cdeg / TURN_CDEG).max(0) as u64
}

impl Newest {
    /// Device time to a later packet, ns, its whole hours told by the arrivals; `None` without stamps.
    fn span_to(&self, later: &Self) -> Option<i64> {
        let short = later.stamp?.since(self.stamp?).0;
        let by_arrival = (later.arrived - self.arrived).0;
        let hours = (by_arrival - short).saturating_add(HOUR_NS / 2).div_euclid(HOUR_NS);
        Some(short + hours.max(0) * HOUR_NS)
    }
}
