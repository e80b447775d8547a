//! A LiDAR's packets in the order they were sent.

use crate::epoch::TimeBasis;
use tumbled_model::{RigNs, Span};
use tumbled_velodyne::Points;
use tumbled_velodyne::heads::Heads;

/// Packets held back to let an overtaken one catch up: a switch may swap neighbours. 2 ms of a VLP-32C.
pub(crate) const DEPTH: usize = 3;

/// A decoded packet on the session's timeline.
#[derive(Clone, Debug)]
pub(crate) struct TimedPacket {
    /// Measurement time of its stamp.
    pub(crate) t: RigNs,
    pub(crate) sigma: Span,
    pub(crate) basis: TimeBasis,
    pub(crate) arrived: RigNs,
    pub(crate) heads: Heads,
    pub(crate) points: Points,
}

/// Holds the newest packets back and gives out the oldest of them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Reorder {
    /// By time, of equal times the first come first; at most [`DEPTH`] between calls.
    waiting: Vec<TimedPacket>,
    /// Buffers of packets that are done.
    spare: Vec<Points>,
    /// The newest time given out.
    released: Option<RigNs>,
}

impl Reorder {
    /// An empty buffer for a packet's points.
    pub(crate) fn buffer(&mut self) -> Points {
        let mut points = self.spare.pop().unwrap_or_default();
        points.clear();
        points
    }

    /// Gives a packet's buffer back.
    pub(crate) fn done(&mut self, packet: TimedPacket) {
        if self.spare.len() <= DEPTH {
            self.spare.push(packet.points);
        }
    }

    /// Whether a packet of this time still finds its place.
    pub(crate) fn has_place(&self, t: RigNs) -> bool {
        self.released.is_none_or(|released| t >= released)
    }

    /// Takes a packet in; gives the next one out when more than [`DEPTH`] wait.
    pub(crate) fn push(&mut self, packet: TimedPacket) -> Option<TimedPacket> {
        let place = self.waiting.partition_point(|other| other.t <= packet.t);
        self.waiting.insert(place, packet);
        if self.waiting.len() > DEPTH { self.pop() } else { None }
    }

    /// The oldest that waits: when nothing more is to come for a while.
    pub(crate) fn pop(&mut self) -> Option<TimedPacket> {
        if self.waiting.is_empty() {
            return None;
        }
        let packet = self.waiting.remove(0);
        self.released = Some(packet.t);
        Some(packet)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn packet(t: i64) -> TimedPacket {
        TimedPacket {
            t: RigNs(t),
            sigma: Span(0),
            basis: TimeBasis::Arrival,
            arrived: RigNs(t),
            heads: Heads::default(),
            points: Points::default(),
        }
    }

    fn drain(times: impl IntoIterator<Item = i64>) -> (Vec<i64>, Vec<i64>) {
        let (mut reorder, mut out, mut late) = (Reorder::default(), Vec::new(), Vec::new());
        for t in times {
            if reorder.has_place(RigNs(t)) {
                out.extend(reorder.push(packet(t)).map(|packet| packet.t.0));
            } else {
                late.push(t);
            }
        }
        out.extend(std::iter::from_fn(|| reorder.pop()).map(|packet| packet.t.0));
        (out, late)
    }

    #[test]
    fn a_packet_overtaken_by_three_takes_its_place() {
        assert_eq!(drain([1, 3, 4, 5, 2, 6]), (vec![1, 2, 3, 4, 5, 6], vec![]));
    }

    #[test]
    fn one_overtaken_by_more_is_late_when_its_place_is_gone() {
        // When 6 comes, 1, 3, 4, 5 have come before: 1 and 3 are given out.
        assert_eq!(drain([1, 3, 4, 5, 6, 2]), (vec![1, 3, 4, 5, 6], vec![2]));
    }

    proptest! {
        /// Whatever comes: nothing is lost without being called late, and nothing goes backwards.
        #[test]
        fn what_comes_out_is_sorted_and_complete(times in prop::collection::vec(0i64..50, 0..200)) {
            let (out, late) = drain(times.clone());
            prop_assert!(out.is_sorted());
            let mut all = [out, late].concat();
            all.sort_unstable();
            let mut sorted = times;
            sorted.sort_unstable();
            prop_assert_eq!(all, sorted);
        }
    }
}
