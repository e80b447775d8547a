//! Which points of an epoch are the target's.
//!
//! ```text
//!   epoch ─▶ where to look ─▶ flying pixels ─▶ learned room ─▶ large planes ─▶ clusters ─▶ the target's
//! ```
//!
//! * where to look: the region of interest, or everything up to 8 m; around the target's expected place when it is tracked;
//! * `flying`: pixels of a Kinect between two surfaces;
//! * `background`: what was there when the room was empty, learned on command ([`Segmenter::learn`]);
//! * `planes`: floors and walls that go on beyond the place where the target is;
//! * `clusters`, `spacing`: what hangs together, by the distance between a LiDAR's rings;
//! * `target`: which of it is the target, and whether something else could be taken for it.
//!
//! The same epoch gives the same points on every machine; nothing is remembered from epoch to epoch but the learned rooms, and
//! what was found to stand beside the target ([`Segmenter::stands`]).

mod background;
mod clusters;
mod flying;
mod planes;
#[cfg(test)]
mod scene;
mod spacing;
mod target;
#[cfg(test)]
mod tests;
mod voxels;

pub use background::Learned;

use crate::config::RegionOfInterest;
use crate::epoch::{Epoch, Scan};
use background::{Background, Learning};
use clusters::Clusters;
use flying::FlyingPixels;
use nalgebra::{Point3, Vector3};
use planes::{Large, PlaneFinder};
use std::collections::BTreeMap;
use tumbled_model::SensorId;

/// Without a region: what is farther away is not looked at, m.
const FARTHEST_M: f32 = 8.0;
/// Fewer points of a Kinect are no target.
const LEAST_KINECT: u32 = 30;
/// Fewer points of a LiDAR are no target.
const LEAST_LIDAR: u32 = 5;
/// The surroundings of the expected target that are looked at, in radii of the sphere in which it is.
const SURROUNDINGS: f64 = 1.5;

/// Where the target is looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Search {
    /// In this region: the one by which the epochs' `in_roi` was made. The largest cluster near its middle.
    Region(RegionOfInterest),
    /// Without a region: the nearest cluster of 0.2 to 3 m.
    Nearest,
    /// All that the sensors see is the target: a scene that stands still around a rig that moves.
    Everything,
}

/// Where the target is expected, from the prediction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expectation {
    /// The middle of the target, rig frame, m.
    pub center: Point3<f64>,
    /// How far the target may reach from there, m, above 0: the model's radius and three standard deviations of the place.
    pub radius_m: f64,
}

/// What of an epoch is the target's. Made once and filled again and again.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Segment {
    /// The target's points: numbers of the epoch's points, ascending. Empty: no target is seen.
    pub indices: Vec<u32>,
    /// Whether something else could be taken for the target, or touches it.
    pub ambiguous: bool,
    /// What lies next to the target's largest piece, and touches it nowhere.
    pub beside: Vec<Beside>,
    /// Where the other points went.
    pub counts: SegmentCounts,
}

/// A thing next to the target's largest piece that touches it nowhere: a panel whose yoke is not seen, or a stand.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Beside {
    /// Its points: numbers of the epoch's points, ascending.
    pub indices: Vec<u32>,
    /// Whether they are among the target's: all of it is where the target is expected.
    pub is_taken: bool,
    /// Whether it is as near to the target as a panel is behind its yoke.
    pub is_near: bool,
}

impl Segment {
    /// Leaves the points of some of the things beside the target out of it; they are told by whether to leave each out.
    pub fn without(&mut self, mut is_left_out: impl FnMut(usize) -> bool) {
        for number in 0..self.beside.len() {
            let Some(beside) = self.beside.get(number).filter(|beside| beside.is_taken && is_left_out(number)) else {
                continue;
            };
            let before = self.indices.len();
            self.indices.retain(|index| beside.indices.binary_search(index).is_err());
            let left = (before - self.indices.len()) as u32;
            (self.counts.others, self.counts.target) = (self.counts.others + left, self.counts.target - left);
        }
    }
}

/// Where an epoch's points went. Every point that was looked at is in one of the others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SegmentCounts {
    /// Looked at: in the region, and around the expected place.
    pub looked_at: u32,
    /// Left out: pixels of a Kinect between two surfaces.
    pub flying: u32,
    /// Left out: in or next to what the room holds when it is empty.
    pub background: u32,
    /// Left out: on planes that go on beyond the place of the target.
    pub planes: u32,
    /// Left out: of other clusters, or beyond where the target can be.
    pub others: u32,
    /// The target's.
    pub target: u32,
}

/// A place around a centre, m.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sphere {
    center: Point3<f64>,
    radius_m: f64,
}

impl Sphere {
    fn holds(&self, place: [f32; 3]) -> bool {
        let offset: Vector3<f64> = Vector3::from(place.map(f64::from)) - self.center.coords;
        offset.norm_squared() <= self.radius_m * self.radius_m
    }
}

/// Tells the target's points from the others. One for all sensors of a rig.
#[derive(Clone, Debug)]
pub struct Segmenter {
    search: Search,
    learning: BTreeMap<SensorId, Learning>,
    rooms: BTreeMap<SensorId, Background>,
    /// What was seen to stand still beside a target that turned: alike for all sensors.
    standing: Background,
    flying: FlyingPixels,
    planes: PlaneFinder,
    clusters: Clusters,
}

impl Segmenter {
    /// Knows no room yet.
    pub fn new(search: Search) -> Self {
        Self {
            search,
            learning: BTreeMap::new(),
            rooms: BTreeMap::new(),
            standing: Background::nothing(),
            flying: FlyingPixels::new(),
            planes: PlaneFinder::new(),
            clusters: Clusters::new(),
        }
    }

    /// Takes an epoch of the empty room. From the first one until [`Segmenter::learned`] the old room is still left out.
    pub fn learn(&mut self, epoch: &Epoch) {
        let mut candidates = Vec::new();
        self.look(epoch, None, &mut candidates);
        self.learning.entry(epoch.sensor.clone()).or_insert_with(Learning::new).observe(epoch, &candidates);
    }

    /// Ends the learning: what the sensors that took part saw is their room from now on. Says what was learned, by sensor.
    pub fn learned(&mut self) -> BTreeMap<SensorId, Learned> {
        let mut report = BTreeMap::new();
        for (sensor, learning) in core::mem::take(&mut self.learning) {
            let (room, learned) = learning.background();
            self.rooms.insert(sensor.clone(), room);
            report.insert(sensor, learned);
        }
        report
    }

    /// Whether a room was learned.
    pub fn knows_a_room(&self) -> bool {
        !self.rooms.is_empty()
    }

    /// Takes over what another one learned.
    pub fn take_over(&mut self, other: Self) {
        (self.rooms, self.standing) = (other.rooms, other.standing);
    }

    /// Takes places of a thing that stands still, rig frame, m: no sensor's points there are the target's from now on.
    /// Returns whether it could be kept.
    pub fn stands(&mut self, places: impl Iterator<Item = [f32; 3]>) -> bool {
        self.standing.add(places)
    }

    /// Forgets every room, what stands beside the target, and what was being learned.
    pub fn forget(&mut self) {
        self.learning.clear();
        self.rooms.clear();
        self.standing = Background::nothing();
    }

    /// Fills `segment` with the target's points of an epoch. With an expectation: where the target is tracked; without:
    /// where it is looked for.
    pub fn segment(&mut self, epoch: &Epoch, expected: Option<&Expectation>, segment: &mut Segment) {
        let at = expected.map(|expected| Sphere { center: expected.center, radius_m: expected.radius_m });
        let around = at.map(|at| Sphere { radius_m: SURROUNDINGS * at.radius_m, ..at });
        let (candidates, mut counts) = (&mut segment.indices, SegmentCounts::default());
        self.look(epoch, around.as_ref(), candidates);
        counts.looked_at = candidates.len() as u32;
        let (mut edge, mut least) = (spacing::LEAST_M, LEAST_KINECT);
        match &epoch.scan {
            Scan::Kinect(scan) => counts.flying = self.flying.remove(&scan.points, candidates),
            Scan::Lidar(scan) => (edge, least) = (spacing::of_rings(scan, candidates), LEAST_LIDAR),
        }
        if let Some(room) = self.rooms.get(&epoch.sensor) {
            counts.background = room.remove(epoch, candidates);
        }
        counts.background += self.standing.remove(epoch, candidates);
        if let Some(large) = self.large(around) {
            counts.planes = self.without_planes(epoch, candidates, edge, large);
        }
        let points = candidates.iter().map(|number| {
            let place = epoch.rig.place(*number).unwrap_or_default();
            (place, range(&epoch.scan, *number).unwrap_or_default())
        });
        self.clusters.find(points, edge);
        let choice = match &at {
            Some(at) => target::expected(&self.clusters, at, least),
            None => target::first_sight(&self.clusters, &self.search, least),
        };
        let before = candidates.len();
        segment.beside.clear();
        for cluster in &choice.beside {
            let is_taken = choice.is_target.get(*cluster).copied().unwrap_or_default();
            let points = candidates.iter().zip(self.clusters.of_points()).filter(|(_, of)| of == cluster);
            let list = self.clusters.list();
            let pair = choice.first.and_then(|first| Some((list.get(first)?, list.get(*cluster)?)));
            let is_near = pair.is_some_and(|(first, other)| first.gap_m(other) < target::BESIDE_M);
            segment.beside.push(Beside { indices: points.map(|(number, _)| *number).collect(), is_taken, is_near });
        }
        let mut clusters = self.clusters.of_points();
        candidates.retain(|number| {
            let cluster = clusters.next();
            let is_target = cluster.and_then(|cluster| choice.is_target.get(cluster)).copied().unwrap_or_default();
            is_target && at.is_none_or(|at| epoch.rig.place(*number).is_some_and(|place| at.holds(place)))
        });
        counts.others = (before - candidates.len()) as u32;
        counts.target = candidates.len() as u32;
        (segment.ambiguous, segment.counts) = (choice.ambiguous, counts);
    }

    /// The points that may be the target's by their place alone.
    fn look(&self, epoch: &Epoch, around: Option<&Sphere>, candidates: &mut Vec<u32>) {
        candidates.clear();
        let numbers = 0..epoch.rig.len() as u32;
        match self.search {
            Search::Region(_) => {
                candidates
                    .extend(numbers.zip(&epoch.rig.in_roi).filter(|(_, inside)| **inside).map(|(number, _)| number));
            }
            Search::Nearest | Search::Everything => {
                let near = |number: &u32| range(&epoch.scan, *number).is_some_and(|range| range <= FARTHEST_M);
                candidates.extend(numbers.filter(near));
            }
        }
        let is_there =
            |place: [f32; 3]| place.iter().all(|c| c.is_finite()) && around.is_none_or(|around| around.holds(place));
        candidates.retain(|number| epoch.rig.place(*number).is_some_and(is_there));
    }

    /// What planes are the room's.
    fn large(&self, around: Option<Sphere>) -> Option<Large> {
        match (self.search, around) {
            (Search::Everything, _) => None,
            (_, Some(around)) => Some(Large::CutsThrough(around)),
            (Search::Region(region), None) => {
                Some(Large::CutsThrough(Sphere { center: region.center.coords, radius_m: region.radius_m }))
            }
            (Search::Nearest, None) => Some(Large::LongerThan(target::LONGEST_M)),
        }
    }

    fn without_planes(&mut self, epoch: &Epoch, candidates: &mut Vec<u32>, edge: f32, large: Large) -> u32 {
        let places = candidates.iter().filter_map(|number| epoch.rig.place(*number));
        let planes = self.planes.find(places, edge, large);
        let before = candidates.len();
        if !planes.is_empty() {
            candidates.retain(|number| {
                epoch.rig.place(*number).is_some_and(|place| !planes.iter().any(|plane| plane.holds(place)))
            });
        }
        (before - candidates.len()) as u32
    }
}

/// How far a point is from its sensor, m.
fn range(scan: &Scan, number: u32) -> Option<f32> {
    let number = number as usize;
    match scan {
        Scan::Lidar(scan) => scan.points.range_m.get(number).copied(),
        Scan::Kinect(scan) => {
            let (x, y, z) = (scan.points.x().get(number)?, scan.points.y().get(number)?, scan.points.z().get(number)?);
            Some((x * x + y * y + z * z).sqrt())
        }
    }
}
