//! A cloud as a surface: at every point an anchored unit sphere (method.md §1: a plane where it is not curved), its
//! noise, and a grid that finds the nearest such patch with one look.
//!
//! ```text
//!   cloud ─▶ k nearest of every point ─▶ local fit: mean, normal, curvature, shape ─▶ towards the viewpoint
//!                                                                                        │
//!                 look-up grid of the nearest patch ◀── patches (32 bytes) + details ◀───┘
//! ```
//!
//! * [`patch`]: one patch, for the search and for the refinement; [`noise`]: what a sensor's points scatter;
//! * [`sampling`]: farthest point sampling.

pub(crate) mod four;
mod local;
mod lookup;
pub mod noise;
mod orient;
pub mod patch;
pub mod sampling;

pub(crate) use local::{Local, least_eigenvector};
pub use patch::{Detail, Patch, Shape};
pub use sampling::farthest_points;

use crate::neighbours::each_knn;
use crate::register::cloud::Cloud;
use four::FourPatches;
use lookup::Lookup;
use nalgebra::Point3;
use noise::PointNoise;
use wide::f32x4;

/// Least spacing, m: closer points are the same to every sensor, and all distances are in spacings.
const LEAST_SPACING_M: f32 = 1e-3;
/// Spacing over the median distance of nearest neighbours: near the square root of a point's share of the area
/// (method.md §3.4b).
const SPACING: f32 = 1.2;

/// A rim's point is farther from its neighbours' mean than this, in spacings.
const RIM: f64 = 0.9;

/// How a surface is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceOptions {
    /// Points of a neighbourhood, the point itself among them (method.md §10).
    pub neighbours: usize,
    /// Whether a patch may be curved; otherwise all are planes.
    pub curved: bool,
    /// Edge of the look-up grid's cells, m.
    pub cell_m: f32,
    /// How far from the points the grid still answers, m.
    pub margin_m: f32,
}

impl Default for SurfaceOptions {
    fn default() -> Self {
        Self { neighbours: 20, curved: true, cell_m: 0.025, margin_m: 0.25 }
    }
}

/// A cloud's surface, in the cloud's frame. Patches number the cloud's finite points in their order.
#[derive(Clone, Debug)]
pub struct Surface {
    points: Vec<Point3<f32>>,
    patches: Vec<Patch>,
    details: Vec<Detail>,
    lookup: Lookup,
    spacing_m: f32,
}

impl Surface {
    /// From a cloud of any number of points; those that are not finite are left out. O(n) for points on surfaces.
    pub fn build(cloud: &Cloud, options: &SurfaceOptions) -> Self {
        let finite = |point: &&Point3<f32>| point.iter().all(|c| c.is_finite());
        let points: Vec<Point3<f32>> = cloud.points.iter().filter(finite).copied().collect();
        let noise = PointNoise::of(cloud.sensor, cloud.viewpoint, &points);
        let mut details = vec![Detail::NONE; points.len()];
        let mut steps = Vec::with_capacity(points.len());
        each_knn(&points, options.neighbours, |near| {
            steps.push(near.nearest);
            let point = Point3::from(near.point);
            if let Some(detail) = details.get_mut(near.index as usize) {
                *detail = Detail::new(&point, &Local::fit(near, options.curved), noise.sigma_m(&point));
            }
        });
        match cloud.viewpoint {
            Some(viewpoint) => orient::towards(&viewpoint, &mut details),
            None => orient::consistently(&points, &mut details),
        }
        let patches: Vec<Patch> = details.iter().map(Detail::patch).collect();
        let lookup = Lookup::build(&points, options.cell_m, options.margin_m);
        Self { points, patches, details, lookup, spacing_m: spacing(steps) }
    }

    /// The finite points, m.
    pub fn points(&self) -> &[Point3<f32>] {
        &self.points
    }

    /// The patch at each point.
    pub fn patches(&self) -> &[Patch] {
        &self.patches
    }

    /// What the refinement wants to know of each point.
    pub fn details(&self) -> &[Detail] {
        &self.details
    }

    /// 1.2 × the median distance of nearest neighbours, m; at least 1 mm.
    pub fn spacing_m(&self) -> f32 {
        self.spacing_m
    }

    /// Whether a point lies on the rim of what was seen: its neighbours lie to one side of it. Of neighbours all about it the
    /// mean is within half a spacing; of those that fill half a disc it is 4/(3π) of the disc's radius away, 1.5 spacings of
    /// twenty.
    pub fn is_rim(&self, index: usize) -> bool {
        let (Some(point), Some(detail)) = (self.points.get(index), self.details.get(index)) else { return false };
        let away = detail.mean - point.cast::<f64>();
        let along = away - detail.normal * away.dot(&detail.normal);
        along.norm() > RIM * f64::from(self.spacing_m)
    }

    /// The patch near a place: the nearest to the middle of the place's cell. `None`: the place is outside the grid
    /// (farther than the margin from the points' box), or not a number.
    ///
    /// Where the surface is within half a cell, the patch is the nearest to the middle of the cell exactly: at most 1.74 cells
    /// (4.3 cm) farther from the place than the nearest. Farther from the surface cells share an answer two by two by
    /// two, and the patch found may be up to 7.5 cells farther, in practice one.
    #[inline]
    pub fn look(&self, place: &[f32; 3]) -> Option<&Patch> {
        self.patches.get(self.lookup.index(place)?)
    }

    /// The patches near four places, as [`look`](Self::look) finds them.
    #[inline(always)]
    pub(crate) fn look_at_four(&self, places: &[f32x4; 3]) -> FourPatches {
        FourPatches::look(&self.patches, &self.lookup, places)
    }

    /// Edge of the grid's cells, m: as asked for, or larger where the cloud is too large for such cells.
    pub fn cell_m(&self) -> f32 {
        self.lookup.cell_m()
    }
}

/// The spacing of points, m: 1.2 × the median distance of nearest neighbours, at least 1 mm. What
/// [`Surface::spacing_m`] says of a surface, without making one.
pub fn spacing_m(points: &[Point3<f32>]) -> f32 {
    let finite = |point: &&Point3<f32>| point.iter().all(|c| c.is_finite());
    let points: Vec<Point3<f32>> = points.iter().filter(finite).copied().collect();
    let mut steps = Vec::with_capacity(points.len());
    each_knn(&points, 2, |near| steps.push(near.nearest));
    spacing(steps)
}

/// From squared distances of nearest neighbours.
fn spacing(mut squared: Vec<f32>) -> f32 {
    let middle = squared.len() / 2;
    if middle == 0 {
        return LEAST_SPACING_M;
    }
    let median = squared.select_nth_unstable_by(middle, f32::total_cmp).1.sqrt();
    if median.is_finite() { (SPACING * median).max(LEAST_SPACING_M) } else { LEAST_SPACING_M }
}

#[cfg(test)]
mod tests;
