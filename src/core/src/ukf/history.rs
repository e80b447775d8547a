//! The last two seconds, so that a late pose can be taken in its place.

use super::gate::{Used, Verdict, is_lost, step};
use super::options::PoseMeasurement;
use super::state::{Setup, State};
use crate::register::SensorKind;
use std::collections::VecDeque;
use tumbled_model::{RigNs, Span};

/// How late a pose may be.
const MEMORY: Span = Span(2_000_000_000);
/// The most states remembered: four sensors at their full pace leave half of it free.
const MOST: usize = 512;

/// Of poses of one time a Kinect's comes first, then a LiDAR's, then by number.
type Place = (RigNs, u8, usize);

/// States after each pose, in the poses' order.
#[derive(Clone, Debug)]
pub(super) struct History {
    /// Before the first pose remembered.
    base: (Place, State),
    entries: VecDeque<Entry>,
}

#[derive(Clone, Debug)]
struct Entry {
    place: Place,
    pose: PoseMeasurement,
    /// After the pose.
    state: State,
}

impl History {
    pub(super) fn new(state: State) -> Self {
        Self { base: ((state.t, 0, 0), state), entries: VecDeque::new() }
    }

    /// The last state.
    pub(super) fn last(&self) -> &State {
        self.entries.back().map_or(&self.base.1, |entry| &entry.state)
    }

    /// Changes the last state; of a late pose the change is undone.
    pub(super) fn change(&mut self, change: impl FnOnce(&mut State)) {
        change(self.entries.back_mut().map_or(&mut self.base.1, |entry| &mut entry.state));
    }

    /// The state from which a time is predicted: the last that is not after it, else the first.
    pub(super) fn before(&self, t: RigNs) -> &State {
        let after = self.entries.partition_point(|entry| entry.place.0 <= t);
        self.after(after)
    }

    /// The state after so many of the poses.
    fn after(&self, poses: usize) -> &State {
        poses.checked_sub(1).and_then(|last| self.entries.get(last)).map_or(&self.base.1, |entry| &entry.state)
    }

    /// Takes a pose in its place and every later one again.
    pub(super) fn insert(&mut self, setup: &Setup, z: &PoseMeasurement) -> Verdict {
        let rank = match setup.priors.get(z.sensor).map(|prior| prior.kind) {
            Some(SensorKind::Kinect) => 0,
            Some(SensorKind::Lidar) => 1,
            None => return self.untaken(Used::Unusable),
        };
        let place = (z.t, rank, z.sensor);
        let newest = self.entries.back().map_or(self.base.0, |entry| entry.place);
        if place < self.base.0 || z.t < newest.0 - MEMORY {
            return self.untaken(Used::TooOld);
        }
        let at = self.entries.partition_point(|entry| entry.place <= place);
        let (state, mut verdict) = step(setup, self.after(at), z);
        if verdict.used == Used::Unusable {
            return self.untaken(Used::Unusable);
        }
        let later = self.entries.split_off(at);
        self.entries.push_back(Entry { place, pose: *z, state });
        for Entry { place, pose, .. } in later {
            let state = step(setup, self.last(), &pose).0;
            self.entries.push_back(Entry { place, pose, state });
        }
        verdict.lost = is_lost(self.last());
        self.forget();
        verdict
    }

    /// Drops what no pose can need.
    fn forget(&mut self) {
        let horizon = self.entries.back().map_or(self.base.0.0, |entry| entry.place.0) - MEMORY;
        while self.entries.len() > MOST || self.entries.front().is_some_and(|first| first.place.0 < horizon) {
            let Some(first) = self.entries.pop_front() else { return };
            self.base = (first.place, first.state);
        }
    }

    fn untaken(&self, used: Used) -> Verdict {
        Verdict { nis: None, used, lost: is_lost(self.last()) }
    }
}
