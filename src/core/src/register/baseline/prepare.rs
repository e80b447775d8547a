//! What every method here needs of a cloud: its finite points, a tree over them, planes.

use crate::neighbours::{KdTree, Neighbours};
use crate::register::check::{CheckedPoints, check_cloud};
use crate::register::{Cloud, RegisterError};
use crate::surface::least_eigenvector;
use crate::surface::noise::PointNoise;
use nalgebra::{Matrix3, Point3, Vector3};

/// Fewer points make no plane.
const LEAST_NEIGHBOURS: usize = 5;

/// A checked cloud with a tree.
pub(crate) struct Prepared {
    checked: CheckedPoints,
    tree: KdTree,
    noise: PointNoise,
    viewpoint: Option<Point3<f64>>,
}

/// First and second moments of a neighbourhood.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moments {
    /// The points' mean, m.
    pub(crate) mean: Point3<f64>,
    /// Their variances along the axes, falling, m².
    pub(crate) variances: [f64; 3],
    /// The axis of the least variance, a unit vector of either sign.
    pub(crate) normal: Vector3<f64>,
    /// How many points.
    pub(crate) count: usize,
    /// The farthest of them from the point asked for, m.
    pub(crate) reach_m: f64,
}

impl Moments {
    /// σ: root mean square distance from the mean, m.
    pub(crate) fn radius_m(&self) -> f64 {
        let [large, middle, small] = self.variances;
        (large + middle + small).sqrt()
    }

    /// Linear and planar shape factor, `(λ₁ − λ₂)/Σλ` and `2(λ₂ − λ₃)/Σλ`; what is missing to 1 is the spherical one.
    pub(crate) fn shape(&self) -> [f64; 2] {
        let [large, middle, small] = self.variances;
        let sum = large + middle + small;
        if sum > 0.0 { [(large - middle) / sum, 2.0 * (middle - small) / sum] } else { [0.0, 0.0] }
    }
}

/// Sums of offsets from one point: nothing cancels however far the cloud is.
struct Sums {
    about: Point3<f64>,
    sum: Vector3<f64>,
    square: Matrix3<f64>,
    count: usize,
    reach_sq: f64,
}

impl Sums {
    fn about(about: Point3<f64>) -> Self {
        Self { about, sum: Vector3::zeros(), square: Matrix3::zeros(), count: 0, reach_sq: 0.0 }
    }

    fn add(&mut self, point: &Point3<f32>) {
        let offset = point.cast::<f64>() - self.about;
        self.sum += offset;
        self.square += offset * offset.transpose();
        self.count += 1;
        self.reach_sq = self.reach_sq.max(offset.norm_squared());
    }

    /// `None`: too few points.
    fn moments(&self) -> Option<Moments> {
        if self.count < LEAST_NEIGHBOURS {
            return None;
        }
        let count = self.count as f64;
        let mean = self.sum / count;
        let c = self.square / count - mean * mean.transpose();
        let ([small, middle, large], normal) = least_eigenvector([c.m11, c.m12, c.m13, c.m22, c.m23, c.m33]);
        Some(Moments {
            mean: self.about + mean,
            variances: [large.max(0.0), middle.max(0.0), small.max(0.0)],
            normal,
            count: self.count,
            reach_m: self.reach_sq.sqrt(),
        })
    }
}

impl Prepared {
    /// Checks a cloud (`name`: `moving` or `reference`) and builds its tree.
    pub(crate) fn new(cloud: &Cloud, name: &'static str) -> Result<Self, RegisterError> {
        let checked = check_cloud(cloud, name)?;
        let tree = KdTree::build(&checked.points);
        let noise = PointNoise::of(cloud.sensor, cloud.viewpoint, &checked.points);
        Ok(Self { checked, tree, noise, viewpoint: cloud.viewpoint.map(|point| point.cast()) })
    }

    pub(crate) fn points(&self) -> &[Point3<f32>] {
        &self.checked.points
    }

    pub(crate) fn point(&self, index: u32) -> Option<Point3<f64>> {
        self.checked.points.get(index as usize).map(|point| point.cast())
    }

    pub(crate) fn tree(&self) -> &KdTree {
        &self.tree
    }

    /// The point nearest to a place, within a squared distance, m². `before` is the answer to the last question about the
    /// same point, or nothing: it is seldom far from the new one, and nothing farther than it need be looked at. The answer
    /// does not depend on it.
    pub(crate) fn nearest(&self, place: &Point3<f32>, max_sq: f32, before: &mut Option<u32>) -> Option<u32> {
        let known = before.and_then(|index| self.points().get(index as usize));
        // A little more than its distance, lest rounding hide the point itself.
        let bound = known.map_or(max_sq, |point| (1.000_01 * (point - place).norm_squared()).min(max_sq));
        let found = self.tree.nearest(place, bound).map(|(index, _)| index);
        *before = found.or(*before);
        found
    }

    pub(crate) fn centroid(&self) -> Point3<f64> {
        self.checked.centroid
    }

    /// Root mean square distance from the centroid, m.
    pub(crate) fn radius_m(&self) -> f64 {
        self.checked.radius_m
    }

    pub(crate) fn viewpoint(&self) -> Option<Point3<f64>> {
        self.viewpoint
    }

    /// Standard deviation of a point along its line of sight, m.
    pub(crate) fn noise_m(&self, point: &Point3<f64>) -> f64 {
        f64::from(self.noise.sigma_m(&point.cast()))
    }

    /// The moments of the `k` points nearest to `point`. `None`: there are fewer than five.
    pub(crate) fn nearest_moments(&self, point: &Point3<f32>, k: usize, scratch: &mut Neighbours) -> Option<Moments> {
        self.tree.knn(point, k, scratch);
        let mut sums = Sums::about(point.cast());
        for (index, _) in scratch.iter() {
            sums.add(self.points().get(index as usize)?);
        }
        sums.moments()
    }

    /// The moments of the points within a ball, m. `None`: there are fewer than five.
    pub(crate) fn ball_moments(&self, point: &Point3<f32>, radius_m: f64) -> Option<Moments> {
        let mut sums = Sums::about(point.cast());
        self.tree.within(point, (radius_m * radius_m) as f32, |index, _| {
            if let Some(neighbour) = self.points().get(index as usize) {
                sums.add(neighbour);
            }
        });
        sums.moments()
    }

    /// The unit normal at every point, from the `k` nearest to it, itself included.
    pub(crate) fn normals(&self, k: usize) -> Vec<Option<Vector3<f64>>> {
        let mut scratch = Neighbours::with_capacity(k);
        self.points().iter().map(|point| Some(self.nearest_moments(point, k, &mut scratch)?.normal)).collect()
    }

    /// Mean distance of a point from its nearest neighbour, m.
    pub(crate) fn mean_spacing_m(&self) -> f64 {
        let mut scratch = Neighbours::with_capacity(2);
        let mut sum = 0.0;
        for point in self.points() {
            self.tree.knn(point, 2, &mut scratch);
            sum += scratch.get(1).map_or(0.0, |(_, squared)| f64::from(squared).sqrt());
        }
        sum / self.points().len() as f64
    }
}
