//! Epochs of several sensors to one order: by time, of equal times the camera first.
//!
//! An epoch goes out when no other sensor can still come with an earlier one: each says by its watermark what it is
//! past. So the order does not depend on whose data happened to arrive first. A sensor that is slow is waited for, a
//! while; one that is silent is not. What comes after its place is gone is counted and left out: nothing is reordered.
//!
//! Nor does it depend on it what is left out. An epoch's place is gone when another has waited long enough at an instant
//! before the epoch came, by the arrivals, and that is judged when every event of before the instant is in. An epoch
//! that comes within the hold of its time cannot have lost its place, and goes out at once; a later one waits until
//! the instant after it is judged.

use crate::epoch::Epoch;
use std::collections::{BTreeMap, VecDeque};
use tumbled_model::{RigNs, Span};

/// From when a sensor that was silent takes part again: its data began to come in the tenth of a second before, all
/// events of that time are in 0.2 s later, a tick tells within 0.1 s, and the ledger may be that much out of order.
pub(crate) const JOINS_AFTER: Span = Span(500_000_000);

/// Epochs by what became of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct AlignCounts {
    /// Given out.
    pub(crate) epochs: u64,
    /// Too late: one with a later time had been given out.
    pub(crate) late: u64,
    /// Of a sensor that was just coming back from a silence.
    pub(crate) joining: u64,
    /// Points of the late and the joining ones.
    pub(crate) points_left_out: u64,
}

impl AlignCounts {
    fn add(&mut self, other: Self) {
        self.epochs += other.epochs;
        self.late += other.late;
        self.joining += other.joining;
        self.points_left_out += other.points_left_out;
    }
}

/// Epochs of one sensor that wait at most, for a ledger without ticks: 1.6 s of a Kinect, 10 MB each.
const MOST_WAITING: usize = 48;

/// An epoch that waits for its place.
#[derive(Debug)]
struct Ready {
    epoch: Epoch,
    /// When it was complete: the arrival of the event that made it so.
    by: RigNs,
}

/// One sensor's epochs on their way into the common order.
#[derive(Debug, Default)]
struct Lane {
    ready: VecDeque<Ready>,
    /// The newest arrival of an event that completed an epoch.
    by: Option<RigNs>,
    watermark: Option<RigNs>,
    /// The others do not wait for it.
    silent: bool,
    /// Of its epochs that are complete from an arrival on, those before a time are left out.
    joins: Option<(RigNs, RigNs)>,
}

/// Merges the sensors' epochs. Sensors are numbered in the order of ties.
#[derive(Debug)]
pub(crate) struct Aligner {
    lanes: Vec<Lane>,
    /// Whether a sensor has no other beside it that gives epochs.
    alone: bool,
    hold: Span,
    last: Option<(RigNs, usize)>,
    next_number: u64,
    /// By the second in which the epochs were complete: what was decided when a second is reported.
    counts: BTreeMap<i64, Vec<AlignCounts>>,
    left_out: Vec<Epoch>,
}

impl Aligner {
    /// For so many sensors, of which so many give epochs.
    pub(crate) fn new(lanes: usize, giving: usize, hold: Span) -> Self {
        Self {
            lanes: (0..lanes).map(|_| Lane::default()).collect(),
            alone: giving < 2,
            hold,
            last: None,
            next_number: 0,
            counts: BTreeMap::new(),
            left_out: Vec::new(),
        }
    }

    pub(crate) fn set_hold(&mut self, hold: Span) {
        self.hold = hold;
    }

    /// Takes a sensor's next epoch, complete with an event that arrived at `by`. `is_silent`: nobody waited for it then.
    pub(crate) fn offer(&mut self, number: usize, epoch: Epoch, by: RigNs, is_silent: bool) {
        let Some(lane) = self.lanes.get_mut(number) else { return };
        let by = lane.by.map_or(by, |newest| newest.max(by));
        lane.by = Some(by);
        if is_silent || lane.joins.is_some_and(|(from, joins)| by >= from && epoch.t < joins) {
            let points = epoch.scan.len() as u64;
            self.left_out.push(epoch);
            return self.count(
                number,
                by,
                AlignCounts { joining: 1, points_left_out: points, ..AlignCounts::default() },
            );
        }
        lane.ready.push_back(Ready { epoch, by });
    }

    /// No later epoch of this sensor will have an earlier time.
    pub(crate) fn pass(&mut self, lane: usize, watermark: Option<RigNs>) {
        if let Some(lane) = self.lanes.get_mut(lane) {
            lane.watermark = lane.watermark.max(watermark);
        }
    }

    /// A sensor that was silent sends again with an event that arrived at `from`; from the instant `t` on it is not silent
    /// any more.
    pub(crate) fn returns(&mut self, lane: usize, from: RigNs, t: RigNs) {
        if let Some(lane) = self.lanes.get_mut(lane) {
            lane.joins = Some((from, t + JOINS_AFTER));
        }
    }

    /// Whether a sensor is waited for, as judged at an instant.
    pub(crate) fn set_silent(&mut self, lane: usize, silent: bool) {
        if let Some(lane) = self.lanes.get_mut(lane) {
            lane.silent = silent;
        }
    }

    /// Gives out every epoch that nothing can come before any more.
    pub(crate) fn release(&mut self, out: &mut Vec<Epoch>, left_out: &mut Vec<Epoch>) {
        left_out.append(&mut self.left_out);
        while let Some((lane, _)) = self.first(None).filter(|(lane, front)| self.is_free(*lane, front)) {
            self.give_out(lane, out, left_out);
        }
        while self.lanes.iter().any(|lane| lane.ready.len() > MOST_WAITING)
            && let Some((lane, _)) = self.first(None)
        {
            self.give_out(lane, out, left_out);
        }
    }

    /// Gives out every epoch that had waited long enough at an instant, all events of before which are in.
    pub(crate) fn judge(&mut self, instant: RigNs, out: &mut Vec<Epoch>, left_out: &mut Vec<Epoch>) {
        while let Some((lane, front)) = self.first(Some(instant)) {
            let waited = instant - front.epoch.span.1 >= self.hold;
            if !waited && !self.others_passed(lane, front.epoch.t) {
                return;
            }
            self.give_out(lane, out, left_out);
        }
    }

    /// Gives out everything: nothing more comes.
    pub(crate) fn finish(&mut self, out: &mut Vec<Epoch>, left_out: &mut Vec<Epoch>) {
        left_out.append(&mut self.left_out);
        while let Some((lane, _)) = self.first(None) {
            self.give_out(lane, out, left_out);
        }
    }

    /// Counts of a sensor's epochs that were complete before `t`; decided when `t` lies a second back.
    pub(crate) fn counts_before(&mut self, t: RigNs, lane: usize) -> AlignCounts {
        let second = t.0.div_euclid(1_000_000_000);
        // What lies before is kept as one sum.
        while let Some((&first, _)) = self.counts.first_key_value()
            && let Some((&next, _)) = self.counts.iter().nth(1)
            && next < second
        {
            let oldest = self.counts.remove(&first).unwrap_or_default();
            for (sum, counts) in self.counts.entry(next).or_default().iter_mut().zip(oldest) {
                sum.add(counts);
            }
        }
        let mut sum = AlignCounts::default();
        for counts in self.counts.range(..second).filter_map(|(_, lanes)| lanes.get(lane)) {
            sum.add(*counts);
        }
        sum
    }

    /// The earliest epoch that waits, of those that were complete before an instant.
    fn first(&self, complete_before: Option<RigNs>) -> Option<(usize, &Ready)> {
        let fronts = self.lanes.iter().enumerate().filter_map(|(n, lane)| Some((n, lane.ready.front()?)));
        let fronts = fronts.filter(|(_, front)| complete_before.is_none_or(|instant| front.by < instant));
        fronts.min_by_key(|(n, front)| (front.epoch.t, *n))
    }

    /// Whether the earliest epoch of all may go out before the next instant is judged.
    fn is_free(&self, lane: usize, front: &Ready) -> bool {
        let in_time = self.alone || front.by - front.epoch.t <= self.hold;
        in_time && self.others_passed(lane, front.epoch.t)
    }

    /// Whether no other sensor can come with an epoch that belongs before this one.
    fn others_passed(&self, lane: usize, t: RigNs) -> bool {
        self.lanes.iter().enumerate().filter(|(n, _)| *n != lane).all(|(n, other)| {
            let behind = |time: RigNs| (time, n) > (t, lane);
            other.silent
                || match other.ready.front() {
                    Some(front) => behind(front.epoch.t),
                    None => other.watermark.is_some_and(behind),
                }
        })
    }

    fn give_out(&mut self, lane: usize, out: &mut Vec<Epoch>, left_out: &mut Vec<Epoch>) {
        let Some(source) = self.lanes.get_mut(lane) else { return };
        let Some(Ready { mut epoch, by }) = source.ready.pop_front() else { return };
        if self.last.is_some_and(|last| (epoch.t, lane) < last) {
            let points = epoch.scan.len() as u64;
            left_out.push(epoch);
            return self.count(lane, by, AlignCounts { late: 1, points_left_out: points, ..AlignCounts::default() });
        }
        self.count(lane, by, AlignCounts { epochs: 1, ..AlignCounts::default() });
        self.last = Some((epoch.t, lane));
        epoch.number = self.next_number;
        self.next_number += 1;
        out.push(epoch);
    }

    fn count(&mut self, lane: usize, by: RigNs, counts: AlignCounts) {
        let lanes = self.lanes.len();
        let second = by.0.div_euclid(1_000_000_000);
        let sums = self.counts.entry(second).or_insert_with(|| vec![AlignCounts::default(); lanes]);
        if let Some(sum) = sums.get_mut(lane) {
            sum.add(counts);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::epoch::{KinectScan, RigCloud, Scan, TimeBasis};
    use tumbled_model::SensorId;

    const MS: i64 = 1_000_000;
    const HOLD: Span = Span(150 * MS);
    const CAMERA: usize = 0;
    const LIDAR: usize = 1;

    fn epoch(sensor: &str, ms: i64) -> Epoch {
        let t = RigNs(ms * MS);
        Epoch {
            number: 0,
            sensor: SensorId::from(sensor),
            t,
            span: (t, t),
            sigma: Span(0),
            basis: TimeBasis::Arrival,
            arrived: t,
            scan: Scan::Kinect(KinectScan::default()),
            rig: RigCloud::default(),
        }
    }

    struct Rig(Aligner, Vec<Epoch>, Vec<Epoch>);

    impl Rig {
        fn new() -> Self {
            Self(Aligner::new(2, 2, HOLD), Vec::new(), Vec::new())
        }

        fn camera(&mut self, ms: i64) -> Vec<i64> {
            self.0.offer(CAMERA, epoch("near", ms), RigNs((ms + 30) * MS), false);
            self.0.pass(CAMERA, Some(RigNs(ms * MS)));
            self.out()
        }

        fn lidar(&mut self, ms: i64) -> Vec<i64> {
            self.lidar_by(ms, ms + 15)
        }

        fn lidar_by(&mut self, ms: i64, by_ms: i64) -> Vec<i64> {
            self.0.offer(LIDAR, epoch("front", ms), RigNs(by_ms * MS), false);
            self.0.pass(LIDAR, Some(RigNs((ms + 15) * MS)));
            self.out()
        }

        fn judge(&mut self, ms: i64) -> Vec<i64> {
            self.0.judge(RigNs(ms * MS), &mut self.1, &mut self.2);
            self.out()
        }

        fn out(&mut self) -> Vec<i64> {
            self.0.release(&mut self.1, &mut self.2);
            self.1.drain(..).map(|epoch| epoch.t.0 / MS).collect()
        }
    }

    #[test]
    fn an_epoch_waits_until_the_other_sensor_is_past_it() {
        let mut rig = Rig::new();
        assert_eq!(rig.camera(10), [0i64; 0]);
        assert_eq!(rig.lidar(5), [5, 10], "the LiDAR is past 20");
        assert_eq!(rig.lidar(50), [0i64; 0], "the camera may come with 40");
        assert_eq!(rig.camera(43), [43]);
        assert_eq!(rig.camera(77), [50], "77 waits for the LiDAR, which is past 65");
    }

    #[test]
    fn of_equal_times_the_camera_goes_first() {
        let mut rig = Rig::new();
        assert_eq!(rig.lidar(10), [0i64; 0]);
        assert_eq!(rig.camera(10), [10], "another frame of 10 would still go first");
        assert_eq!(rig.camera(43), [10]);
        let mut rig = Rig::new();
        rig.0.pass(LIDAR, Some(RigNs(10 * MS)));
        assert_eq!(rig.camera(10), [10], "a LiDAR epoch at 10 would come behind it");
    }

    #[test]
    fn a_sensor_that_does_not_come_is_waited_for_150_ms() {
        let mut rig = Rig::new();
        rig.camera(10);
        assert_eq!(rig.judge(159), [0i64; 0]);
        assert_eq!(rig.judge(160), [10]);
        assert_eq!(rig.lidar_by(5, 170), [0i64; 0], "its place may be gone");
        assert_eq!(rig.judge(200), [0i64; 0], "it is gone");
        assert_eq!(rig.0.counts_before(RigNs(1_000 * MS), LIDAR).late, 1);
        assert_eq!(rig.2.len(), 1);
    }

    #[test]
    fn an_epoch_that_came_before_the_instant_has_its_place_whenever_it_is_judged() {
        // The camera's epoch has waited long enough at 200 ms; the LiDAR's was complete at 199 ms, or at 200 ms.
        for (by, order, late) in [(199, vec![5, 10], 0), (200, vec![10], 1)] {
            for judged_first in [true, false] {
                let mut rig = Rig::new();
                let mut out = rig.camera(10);
                if judged_first && by == 200 {
                    out.extend(rig.judge(200));
                }
                out.extend(rig.lidar_by(5, by));
                out.extend(rig.judge(200));
                out.extend(rig.judge(300));
                assert_eq!((out, rig.2.len()), (order.clone(), late), "complete at {by} ms");
            }
        }
    }

    #[test]
    fn a_silent_sensor_is_not_waited_for_and_joins_half_a_second_after_its_return() {
        let mut rig = Rig::new();
        rig.0.set_silent(LIDAR, true);
        assert_eq!(rig.camera(3_000), [3_000]);
        rig.0.returns(LIDAR, RigNs(2_950 * MS), RigNs(3_000 * MS));
        assert_eq!(rig.lidar(3_499), [0i64; 0]);
        rig.0.set_silent(LIDAR, false);
        assert_eq!(rig.camera(3_510), [3_510], "the LiDAR is past 3514");
        assert_eq!(rig.lidar(3_520), [0i64; 0]);
        assert_eq!(rig.camera(3_530), [3_520, 3_530]);
        let counts = rig.0.counts_before(RigNs(4_000 * MS), LIDAR);
        assert_eq!((counts.epochs, counts.joining, counts.late), (1, 1, 0));
    }

    #[test]
    fn without_anyone_to_judge_no_more_than_48_epochs_wait() {
        let mut rig = Rig::new();
        let out: Vec<i64> = (0..100).flat_map(|n| rig.camera(33 * n)).collect();
        assert_eq!(out, (0..52).map(|n| 33 * n).collect::<Vec<_>>());
    }
}
