//! What a sensor sees of an empty room.

use super::voxels::{Voxels, half_around};
use crate::epoch::Epoch;

/// A background voxel's edge, m: above the noise of both sensors in a room.
const EDGE_M: f32 = 0.05;
/// What a voxel was seen to hold in fewer epochs is a fleck, not the room.
const LEAST_EPOCHS: u32 = 2;
/// Voxels there may be: the surfaces of a hall of 650 m². More are not learned.
const MOST_VOXELS: usize = 1 << 18;

/// Learns a room for one sensor, in the rig's frame.
#[derive(Clone, Debug)]
pub(super) struct Learning {
    voxels: Voxels,
    /// By voxel: the epochs it was seen in, and the last of them.
    seen: Vec<(u32, u32)>,
    epochs: u32,
    full: bool,
}

/// What was learned of a room with one sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Learned {
    /// Epochs looked at.
    pub epochs: u32,
    /// Voxels of 5 cm that hold the room: those seen in two epochs or more.
    pub voxels: u32,
    /// Whether there was more than is kept: then a part of the room is not known.
    pub is_cut: bool,
}

impl Learning {
    pub(super) fn new() -> Self {
        Self { voxels: Voxels::new(EDGE_M), seen: Vec::new(), epochs: 0, full: false }
    }

    /// Takes the points of an epoch that may be looked at.
    pub(super) fn observe(&mut self, epoch: &Epoch, candidates: &[u32]) {
        self.epochs = self.epochs.saturating_add(1);
        for number in candidates {
            let Some(place) = epoch.rig.place(*number) else { continue };
            let key = self.voxels.key(place);
            if self.voxels.len() == MOST_VOXELS && self.voxels.find(key).is_none() {
                self.full = true;
                continue;
            }
            let voxel = self.voxels.number(key) as usize;
            if voxel == self.seen.len() {
                self.seen.push((0, 0));
            }
            if let Some((count, last)) = self.seen.get_mut(voxel).filter(|(_, last)| *last != self.epochs) {
                (*count, *last) = (*count + 1, self.epochs);
            }
        }
    }

    /// The room as far as it is known.
    pub(super) fn background(&self) -> (Background, Learned) {
        let mut near = Voxels::new(EDGE_M);
        let mut voxels = 0;
        for (key, _) in self.voxels.keys().iter().zip(&self.seen).filter(|(_, (count, _))| *count >= LEAST_EPOCHS) {
            voxels += 1;
            with_neighbours(&mut near, *key);
        }
        (Background { near }, Learned { epochs: self.epochs, voxels, is_cut: self.full })
    }
}

/// A learned room.
#[derive(Clone, Debug)]
pub(super) struct Background {
    /// Its voxels and those around them.
    near: Voxels,
}

impl Background {
    /// An empty room.
    pub(super) fn nothing() -> Self {
        Self { near: Voxels::new(EDGE_M) }
    }

    /// Takes the voxels of some places and those around them. Returns whether they could be kept.
    pub(super) fn add(&mut self, places: impl Iterator<Item = [f32; 3]>) -> bool {
        for place in places {
            if self.near.len() >= MOST_VOXELS {
                return false;
            }
            let key = self.near.key(place);
            with_neighbours(&mut self.near, key);
        }
        true
    }

    /// Leaves out of `candidates` the points in voxels of the room and next to them. Returns how many.
    pub(super) fn remove(&self, epoch: &Epoch, candidates: &mut Vec<u32>) -> u32 {
        if self.near.len() == 0 {
            return 0;
        }
        let before = candidates.len();
        candidates.retain(|number| {
            epoch.rig.place(*number).is_some_and(|place| self.near.find(self.near.key(place)).is_none())
        });
        (before - candidates.len()) as u32
    }
}

fn with_neighbours(near: &mut Voxels, key: u64) {
    near.number(key);
    for offset in half_around() {
        near.number(key.wrapping_add_signed(offset));
        near.number(key.wrapping_add_signed(-offset));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::segment::scene::{epoch_of, everything};

    /// A wall at x = 3.01 m, a point a centimetre, moved along x.
    fn wall(by: f32) -> Vec<[f32; 3]> {
        (0..10_000).map(|n| [3.01 + by, (n / 100) as f32 * 0.01, (n % 100) as f32 * 0.01]).collect()
    }

    fn learned(clouds: &[Vec<[f32; 3]>]) -> (Background, Learned) {
        let mut learning = Learning::new();
        for cloud in clouds {
            learning.observe(&epoch_of(cloud), &everything(cloud.len()));
        }
        learning.background()
    }

    #[test]
    fn the_room_and_what_touches_it_go_and_what_stands_before_it_stays() {
        let (background, learned) = learned(&[wall(0.0), wall(0.01), wall(0.0)]);
        // A wall of a square metre, on voxel borders in y and z: 20 × 20.
        assert_eq!(learned, Learned { epochs: 3, voxels: 400, is_cut: false });
        // The wall's voxels are 3.00..3.05 m, those around 2.95..3.10 m. An object at 2.9 m is free of it.
        let mut cloud = wall(0.005);
        cloud.extend([[2.96, 0.5, 0.5], [2.9, 0.5, 0.5], [3.11, 0.5, 0.5]]);
        let mut candidates = everything(cloud.len());
        assert_eq!(background.remove(&epoch_of(&cloud), &mut candidates), 10_001);
        assert_eq!(candidates, [10_001, 10_002]);
    }

    #[test]
    fn a_fleck_of_one_epoch_is_not_the_room() {
        let fleck = vec![[1.0, 1.0, 1.0]; 5];
        let (background, learned) = learned(&[fleck.clone(), wall(0.0), wall(0.0)]);
        assert_eq!(learned.voxels, 400);
        let mut candidates = vec![0];
        background.remove(&epoch_of(&fleck), &mut candidates);
        assert_eq!(candidates, [0]);
    }

    #[test]
    fn more_than_can_be_kept_is_said() {
        let line = |from: usize| (from..from + 150_000).map(|n| [n as f32 * 0.0501, 0.0, 0.0]).collect::<Vec<_>>();
        let (_, learned) = learned(&[line(0), line(150_000)]);
        assert!(learned.is_cut);
    }
}
