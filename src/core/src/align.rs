//! Epochs of several sensors to one order: by time, of equal times the camera first.
//!
//! An epoch goes out when no other sensor can still come with an earlier one: each says by its watermark what it is
//! past. So the order does not depend on whose data happened to arrive first. A sensor that is slow is waited for, a
//! while; one that is silent is not. What comes after its place is gone is counted and left out: nothing is reordered.

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

/// One sensor's epochs on their way into the common order.
#[derive(Debug, Default)]
struct Lane {
    ready: VecDeque<Epoch>,
    watermark: Option<RigNs>,
    /// The others do not wait for it.
    silent: bool,
    /// Its epochs before this time are left out.
    joins: Option<RigNs>,
}

/// Merges the sensors' epochs. Sensors are numbered in the order of ties.
#[derive(Debug)]
pub(crate) struct Aligner {
    lanes: Vec<Lane>,
    hold: Span,
    /// The newest tick: waiting is measured by it.
    now: RigNs,
    last: Option<(RigNs, usize)>,
    next_number: u64,
    /// By second of the epochs' times: what is complete when a second is reported.
    counts: BTreeMap<i64, Vec<AlignCounts>>,
}

impl Aligner {
    pub(crate) fn new(lanes: usize, hold: Span) -> Self {
        Self {
            lanes: (0..lanes).map(|_| Lane::default()).collect(),
            hold,
            now: RigNs(i64::MIN / 2),
            last: None,
            next_number: 0,
            counts: BTreeMap::new(),
        }
    }

    pub(crate) fn set_hold(&mut self, hold: Span) {
        self.hold = hold;
    }

    /// Takes a sensor's next epoch.
    pub(crate) fn offer(&mut self, lane: usize, epoch: Epoch) {
        if let Some(lane) = self.lanes.get_mut(lane) {
            lane.ready.push_back(epoch);
        }
    }

    /// No later epoch of this sensor will have an earlier time.
    pub(crate) fn pass(&mut self, lane: usize, watermark: Option<RigNs>) {
        if let Some(lane) = self.lanes.get_mut(lane) {
            lane.watermark = lane.watermark.max(watermark);
        }
    }

    /// A sensor fell silent, or is back since `t`.
    pub(crate) fn set_silent(&mut self, lane: usize, silent: bool, t: RigNs) {
        if let Some(lane) = self.lanes.get_mut(lane)
            && lane.silent != silent
        {
            lane.silent = silent;
            lane.joins = (!silent).then_some(t + JOINS_AFTER);
        }
    }

    /// Time has passed.
    pub(crate) fn tick(&mut self, now: RigNs) {
        self.now = self.now.max(now);
    }

    /// Gives out every epoch whose turn it is.
    pub(crate) fn release(&mut self, out: &mut Vec<Epoch>, left_out: &mut Vec<Epoch>) {
        while let Some(lane) = self.next(false) {
            self.give_out(lane, out, left_out);
        }
    }

    /// Gives out everything: nothing more comes.
    pub(crate) fn finish(&mut self, out: &mut Vec<Epoch>, left_out: &mut Vec<Epoch>) {
        while let Some(lane) = self.next(true) {
            self.give_out(lane, out, left_out);
        }
    }

    /// Counts of a sensor's epochs with times before `t`; complete when `t` lies a second back.
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

    /// The sensor whose epoch is next, if nothing earlier can come or it has waited long enough.
    fn next(&self, at_end: bool) -> Option<usize> {
        let fronts = self.lanes.iter().enumerate().filter_map(|(n, lane)| Some((lane.ready.front()?.t, n)));
        let (t, first) = fronts.min()?;
        let epoch = self.lanes.get(first)?.ready.front()?;
        let waited = at_end || self.now - epoch.span.1 >= self.hold;
        let others = self.lanes.iter().enumerate().filter(|(n, _)| *n != first);
        let passed = others.into_iter().all(|(n, lane)| {
            lane.silent
                || !lane.ready.is_empty()
                || lane.watermark.is_some_and(|watermark| watermark > t || (watermark == t && n > first))
        });
        (waited || passed).then_some(first)
    }

    fn give_out(&mut self, lane: usize, out: &mut Vec<Epoch>, left_out: &mut Vec<Epoch>) {
        let lanes = self.lanes.len();
        let Some(source) = self.lanes.get_mut(lane) else { return };
        let Some(mut epoch) = source.ready.pop_front() else { return };
        let joining = source.joins.is_some_and(|joins| epoch.t < joins);
        let late = self.last.is_some_and(|last| (epoch.t, lane) < last);
        let second = epoch.t.0.div_euclid(1_000_000_000);
        let counts = self.counts.entry(second).or_insert_with(|| vec![AlignCounts::default(); lanes]);
        let Some(counts) = counts.get_mut(lane) else { return };
        if joining || late {
            counts.joining += u64::from(joining);
            counts.late += u64::from(!joining);
            counts.points_left_out += epoch.scan.len() as u64;
            return left_out.push(epoch);
        }
        counts.epochs += 1;
        self.last = Some((epoch.t, lane));
        epoch.number = self.next_number;
        self.next_number += 1;
        out.push(epoch);
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
            Self(Aligner::new(2, HOLD), Vec::new(), Vec::new())
        }

        fn camera(&mut self, ms: i64) -> Vec<i64> {
            self.0.offer(CAMERA, epoch("near", ms));
            self.0.pass(CAMERA, Some(RigNs(ms * MS)));
            self.out()
        }

        fn lidar(&mut self, ms: i64) -> Vec<i64> {
            self.0.offer(LIDAR, epoch("front", ms));
            self.0.pass(LIDAR, Some(RigNs((ms + 15) * MS)));
            self.out()
        }

        fn tick(&mut self, ms: i64) -> Vec<i64> {
            self.0.tick(RigNs(ms * MS));
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
        assert_eq!(rig.tick(159), [0i64; 0]);
        assert_eq!(rig.tick(160), [10]);
        assert_eq!(rig.lidar(5), [0i64; 0], "its place is gone");
        assert_eq!(rig.0.counts_before(RigNs(1_000 * MS), LIDAR).late, 1);
        assert_eq!(rig.2.len(), 1);
    }

    #[test]
    fn a_silent_sensor_is_not_waited_for_and_joins_half_a_second_after_its_return() {
        let mut rig = Rig::new();
        rig.0.set_silent(LIDAR, true, RigNs(0));
        assert_eq!(rig.camera(3_000), [3_000]);
        rig.0.set_silent(LIDAR, false, RigNs(3_000 * MS));
        assert_eq!(rig.lidar(3_499), [0i64; 0]);
        assert_eq!(rig.camera(3_510), [3_510], "the LiDAR is past 3514");
        assert_eq!(rig.lidar(3_520), [0i64; 0]);
        assert_eq!(rig.camera(3_530), [3_520, 3_530]);
        let counts = rig.0.counts_before(RigNs(4_000 * MS), LIDAR);
        assert_eq!((counts.epochs, counts.joining, counts.late), (1, 1, 0));
    }
}
