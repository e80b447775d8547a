//! Each point of a synthetic LiDAR by the firing that made it.

use super::devices::{FIRING_NS, Way, firing_of};
use std::collections::BTreeSet;
use tumbled_core::{Epoch, LidarScan, Scan};
use tumbled_velodyne::Model;
use tumbled_velodyne::beams::BeamTable;

/// Firings are numbered modulo so many.
const FIRINGS: i64 = 60_000;

/// Which points were given out, and how far their times are off.
pub(crate) struct Tally {
    way: Way,
    beams: BeamTable,
    /// No firing's number comes again: times, whatever was done to the clock, are not needed to tell them apart.
    short: bool,
    /// Firing and laser.
    pub(crate) seen: BTreeSet<(i64, u8)>,
    /// Points given out again.
    pub(crate) twice: u64,
    pub(crate) points: u64,
    pub(crate) epochs: u64,
    /// Times against the truth, ns: least and greatest error.
    pub(crate) errors: (i64, i64),
}

impl Tally {
    pub(crate) fn new(way: Way) -> Self {
        let beams = BeamTable::new(Model::Vlp32c.spec().expect("built in"), false);
        Self {
            way,
            beams,
            short: false,
            seen: BTreeSet::new(),
            twice: 0,
            points: 0,
            epochs: 0,
            errors: (i64::MAX, i64::MIN),
        }
    }

    /// For a session of less than 3.3 s.
    pub(crate) fn of_a_short_session(way: Way) -> Self {
        Self { short: true, ..Self::new(way) }
    }

    /// Counts an epoch's points, and checks what every epoch must be.
    pub(crate) fn see(&mut self, epoch: &Epoch) {
        let Scan::Lidar(scan) = &epoch.scan else { return };
        self.epochs += 1;
        self.points += scan.points.len() as u64;
        assert_eq!(epoch.rig.len(), scan.points.len());
        assert!(
            scan.crossing.end <= scan.points.len() && scan.crossing.start <= scan.crossing.end,
            "{:?}",
            scan.crossing
        );
        assert!((0.0..=1.0).contains(&scan.coverage), "coverage {}", scan.coverage);
        assert!(epoch.span.0 <= epoch.span.1, "{:?}", epoch.span);
        for (n, firing) in self.firings(scan).into_iter().enumerate() {
            let laser = scan.points.laser[n];
            self.twice += u64::from(!self.seen.insert((firing, laser)));
            let t = scan.stamp.0 + i64::from(scan.points.dt_ns[n]);
            let truth = self.way.rig(firing * FIRING_NS) + self.after_firing(laser);
            self.errors = (self.errors.0.min(t - truth), self.errors.1.max(t - truth));
            let last = self.after_firing(31) + 1;
            assert!(epoch.span.0.0 <= t && t <= epoch.span.1.0 + last, "{t} is not in {:?}", epoch.span);
        }
    }

    /// The firing of each of a scan's points.
    pub(crate) fn firings(&self, scan: &LidarScan) -> Vec<i64> {
        let t = |n: usize| scan.stamp.0 + i64::from(scan.points.dt_ns[n]) - self.way.start_ns;
        let firing = |(n, range_m): (usize, &f32)| {
            let modulo = firing_of(*range_m);
            if self.short {
                return modulo;
            }
            let turns = (t(n) / FIRING_NS - modulo + FIRINGS / 2).div_euclid(FIRINGS);
            modulo + turns * FIRINGS
        };
        scan.points.range_m.iter().enumerate().map(firing).collect()
    }

    fn after_firing(&self, laser: u8) -> i64 {
        i64::from(self.beams.beam(usize::from(laser)).expect("a slot").dt_ns)
    }
}
