//! What hangs together: points in cells that touch, by a corner or more.

use super::voxels::{Voxels, half_around};
use nalgebra::Point3;

/// Points that hang together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cluster {
    /// How many points.
    pub(super) points: u32,
    /// How many cells: its size, however far it is away.
    pub(super) cells: u32,
    /// The corners of its box, m, rig axes.
    pub(super) low: [f32; 3],
    /// See `low`.
    pub(super) high: [f32; 3],
    /// Sum of its points' ranges, m.
    ranges: f64,
}

impl Cluster {
    const NONE: Self = Self { points: 0, cells: 0, low: [f32::INFINITY; 3], high: [f32::NEG_INFINITY; 3], ranges: 0.0 };

    /// The mean distance of its points from the sensor, m.
    pub(super) fn range_m(&self) -> f64 {
        self.ranges / f64::from(self.points.max(1))
    }

    /// The longest side of its box, m.
    pub(super) fn length_m(&self) -> f64 {
        self.high.iter().zip(&self.low).map(|(high, low)| f64::from(high - low)).fold(0.0, f64::max)
    }

    /// The distance between two clusters' boxes, m; 0: they overlap.
    pub(super) fn gap_m(&self, other: &Self) -> f64 {
        let axes = self.low.iter().zip(&self.high).zip(other.low.iter().zip(&other.high));
        let gap = |((low, high), (other_low, other_high)): ((&f32, &f32), (&f32, &f32))| {
            f64::from((other_low - high).max(low - other_high).max(0.0))
        };
        libm::sqrt(axes.map(gap).map(|gap| gap * gap).sum())
    }
}

/// Finds clusters; made once and reused.
#[derive(Clone, Debug)]
pub(super) struct Clusters {
    voxels: Voxels,
    /// By cell: a cell of the same cluster with no higher number; after the search the cluster.
    parent: Vec<u32>,
    /// By point, in the order given: its cell.
    home: Vec<u32>,
    list: Vec<Cluster>,
}

impl Clusters {
    pub(super) fn new() -> Self {
        Self { voxels: Voxels::new(1.0), parent: Vec::new(), home: Vec::new(), list: Vec::new() }
    }

    /// Finds the clusters of points, each given with its range, m. Points in cells of this edge, m, that touch are of one
    /// cluster: points nearer than an edge always, farther than two edges (along an axis) never.
    pub(super) fn find(&mut self, points: impl Iterator<Item = ([f32; 3], f32)> + Clone, edge: f32) {
        self.voxels.reset(edge);
        self.home.clear();
        for (place, _) in points.clone() {
            let number = self.voxels.number(self.voxels.key(place));
            self.home.push(number);
        }
        self.link();
        self.describe(points);
    }

    /// The clusters in the order of their first points.
    pub(super) fn list(&self) -> &[Cluster] {
        &self.list
    }

    /// The cluster of each point, in the order given.
    pub(super) fn of_points(&self) -> impl Iterator<Item = usize> + '_ {
        self.home.iter().map(|cell| self.parent.get(*cell as usize).map_or(0, |cluster| *cluster as usize))
    }

    /// The middle of each cell, and its cluster.
    pub(super) fn cells(&self) -> impl Iterator<Item = (Point3<f64>, usize)> + '_ {
        let clusters = self.parent.iter().map(|cluster| *cluster as usize);
        self.voxels.keys().iter().map(|key| self.voxels.middle(*key)).zip(clusters)
    }

    fn link(&mut self) {
        self.parent.clear();
        self.parent.extend(0..self.voxels.len() as u32);
        let around = half_around();
        for number in 0..self.voxels.len() {
            let Some(key) = self.voxels.keys().get(number).copied() else { continue };
            for offset in around {
                if let Some(other) = self.voxels.find(key.wrapping_add_signed(offset)) {
                    self.join(number as u32, other);
                }
            }
        }
    }

    /// The first cell of the cluster; paths are halved on the way.
    fn root(&mut self, mut cell: u32) -> u32 {
        loop {
            let parent = self.parent.get(cell as usize).copied().unwrap_or(cell);
            if parent == cell {
                return cell;
            }
            let above = self.parent.get(parent as usize).copied().unwrap_or(parent);
            if let Some(held) = self.parent.get_mut(cell as usize) {
                *held = above;
            }
            cell = above;
        }
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        if let Some(parent) = self.parent.get_mut(a.max(b) as usize) {
            *parent = a.min(b);
        }
    }

    /// Numbers the clusters and sums up what they are.
    fn describe(&mut self, points: impl Iterator<Item = ([f32; 3], f32)>) {
        self.list.clear();
        // A cell's parent has no higher number: it is a cluster's number already when its turn comes.
        for cell in 0..self.parent.len() {
            let parent = self.parent.get(cell).map_or(cell, |parent| *parent as usize);
            let cluster = if parent == cell {
                self.list.push(Cluster::NONE);
                self.list.len() as u32 - 1
            } else {
                self.parent.get(parent).copied().unwrap_or_default()
            };
            if let Some(held) = self.parent.get_mut(cell) {
                *held = cluster;
            }
            if let Some(cluster) = self.list.get_mut(cluster as usize) {
                cluster.cells += 1;
            }
        }
        for ((place, range), cell) in points.zip(&self.home) {
            let cluster = self.parent.get(*cell as usize).and_then(|cluster| self.list.get_mut(*cluster as usize));
            let Some(cluster) = cluster else { continue };
            cluster.points += 1;
            cluster.ranges += f64::from(range);
            for ((low, high), c) in cluster.low.iter_mut().zip(&mut cluster.high).zip(place) {
                (*low, *high) = (low.min(c), high.max(c));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn found(places: &[[f32; 3]], edge: f32) -> (Vec<usize>, Vec<Cluster>) {
        let mut clusters = Clusters::new();
        clusters.find(places.iter().map(|place| (*place, 2.0)), edge);
        (clusters.of_points().collect(), clusters.list().to_vec())
    }

    #[test]
    fn clusters_are_numbered_by_their_first_points_and_measured() {
        let (of, list) = found(&[[0.01, 0.0, 0.0], [1.0, 0.0, 0.0], [0.05, 0.03, 0.0], [1.0, 0.04, 0.2]], 0.05);
        assert_eq!(of, [0, 1, 0, 2]);
        assert_eq!(list.iter().map(|cluster| cluster.points).collect::<Vec<_>>(), [2, 1, 1]);
        assert!((list[0].length_m() - 0.04).abs() < 1e-6 && list[0].range_m() == 2.0);
        // Boxes 0.95 m apart along x; 0.04 m and 0.20 m along y and z.
        assert!((list[0].gap_m(&list[1]) - 0.95).abs() < 1e-6);
        assert!((list[1].gap_m(&list[2]) - libm::sqrt(0.0416)).abs() < 1e-6);
    }

    proptest! {
        /// Against all pairs: nearer than an edge is together; apart by two edges along an axis from everyone is alone.
        #[test]
        fn near_points_are_together_and_lonely_ones_alone(
            places in prop::collection::vec((0.0..1.5f32, 0.0..1.5f32, 0.0..1.5f32), 1..60),
        ) {
            let places: Vec<[f32; 3]> = places.into_iter().map(|(x, y, z)| [x, y, z]).collect();
            let (of, list) = found(&places, 0.1);
            let most = |a: &[f32; 3], b: &[f32; 3]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            for (i, a) in places.iter().enumerate() {
                let mut alone = true;
                for (j, b) in places.iter().enumerate().filter(|(j, _)| *j != i) {
                    alone &= most(a, b) > 0.2001;
                    prop_assert!(most(a, b) > 0.0999 || of[i] == of[j]);
                }
                prop_assert!(!alone || list[of[i]].points == 1);
            }
            prop_assert_eq!(list.iter().map(|cluster| cluster.points as usize).sum::<usize>(), places.len());
        }
    }
}
