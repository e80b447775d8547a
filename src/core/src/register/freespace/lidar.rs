//! Free space of a LiDAR's bare points (method.md §3.4b, LiDAR side).

use super::angle::arc;
use super::camera::sight_axes;
use super::raster::{Raster, Ray};
use super::rings::{Direction, Rings};
use super::{Depths, Sightings, graded};
use crate::neighbours::{KdTree, Neighbours};
use crate::surface::four::{dot, indices};
use nalgebra::{Matrix3, Point3, Vector3};
use wide::f32x4;

/// A raster's cell, rad: 0.2°.
const CELL: f32 = 3.490_658_5e-3;
/// Returns that were due in an empty disc to call it empty.
const DUE: f64 = 5.0;
/// The radii of discs that are tried, m at the median range.
const RADII_M: [f64; 2] = [0.03, 0.12];
/// How many of them.
const RADII: u32 = 19;
/// Around the points the raster goes on so far, m at the median range.
const MARGIN_M: f32 = 0.3;
/// A place is covered within so many steps of a return.
const COVERED: f32 = 1.6;
/// Beyond an empty disc's radius the share of sky rises to 1 over this, m.
const SKY_RAMP_M: f32 = 0.03;
/// A row where no disc is ever sure to be empty.
const NEVER: f32 = 9.0;
/// The neighbour whose distance tells the density of points without rings.
const FOURTH: usize = 4;

/// A raster over arc along the rings and elevation.
#[derive(Clone, Debug)]
pub struct LidarMask {
    /// To axes in which x is about the mean sight and z is across the rings.
    axes: [Vector3<f32>; 3],
    /// Arc of a radian of azimuth.
    along: f32,
    raster: Raster,
    /// In each row: the radius of a disc in which returns were due, rad.
    sure: Vec<f32>,
    step: f32,
    rings: Option<Rings>,
}

impl LidarMask {
    /// From rays to the points (from the viewpoint, m). `None`: no rays, or they lie all around.
    pub fn build(rays: &[Vector3<f32>]) -> Option<Self> {
        let [across, over, sight] = sight_axes(rays)?;
        // Rings turn about z: keep it, and count azimuths from the mean sight.
        let mean = Direction::of(&sight, 0.0);
        let (sin, cos) = libm::sincos(mean.azimuth);
        let (sin, cos) = (sin as f32, cos as f32);
        let own = [Vector3::new(cos, sin, 0.0), Vector3::new(-sin, cos, 0.0), Vector3::z()];
        let directions = in_axes(rays, &own);
        let mean_elevation = directions.iter().map(|d| d.elevation).sum::<f64>() / directions.len().max(1) as f64;
        match Rings::find(&directions, mean_elevation) {
            Some(rings) => Self::over(rays, own, &directions, mean_elevation, Some(rings)),
            // Without rings no axis is special: along the sight the raster is least distorted.
            None => {
                let axes = [sight, across, over];
                Self::over(rays, axes, &in_axes(rays, &axes), 0.0, None)
            }
        }
    }

    fn over(
        rays: &[Vector3<f32>],
        axes: [Vector3<f32>; 3],
        directions: &[Direction],
        mean_elevation: f64,
        rings: Option<Rings>,
    ) -> Option<Self> {
        let along = libm::cos(mean_elevation);
        let mut ranges: Vec<f32> = rays.iter().map(|ray| ray.norm()).collect();
        let places: Vec<[f64; 2]> = directions.iter().map(|d| [d.azimuth * along, d.elevation]).collect();
        let density = if rings.is_some() { 0.0 } else { density(&places) };
        let step = rings.as_ref().map_or(1.0 / density.max(1e-6).sqrt(), |rings| rings.step_rad);
        let middle = ranges.len() / 2;
        let median = f64::from(*ranges.clone().select_nth_unstable_by(middle, f32::total_cmp).1);
        let [_, widest] = RADII_M;
        let reach = (f64::from(COVERED) * step).min(widest / median) as f32;
        let ray = |([u, v], range): (&[f64; 2], f32)| Ray {
            u: *u as f32,
            v: *v as f32,
            metric: [1.0, 0.0, 1.0],
            range,
            reach,
        };
        let placed: Vec<Ray> = places.iter().zip(ranges.drain(..)).map(ray).collect();
        let raster = Raster::build(&placed, CELL, MARGIN_M / median as f32)?;
        let expected = |elevation: f64, radius: f64| match &rings {
            Some(rings) => rings.expected(elevation, radius),
            None => density * core::f64::consts::PI * radius * radius,
        };
        let sure = raster.rows().map(|elevation| sure_radius(median, |q| expected(f64::from(elevation), q))).collect();
        Some(Self { axes, along: along as f32, raster, sure, step: step as f32, rings })
    }

    /// The rings, if the points lie on rings.
    pub fn rings(&self) -> Option<&Rings> {
        self.rings.as_ref()
    }

    /// What the LiDAR says of four places, given from the viewpoint, m.
    #[inline(always)]
    pub(crate) fn look_at_four(&self, ray: [f32x4; 3]) -> Sightings {
        let [x, y, z] = self.axes.map(|axis| dot(&[axis.x, axis.y, axis.z].map(f32x4::splat), &ray));
        let flat = x * x + y * y;
        let range = (flat + z * z).sqrt();
        let (row, in_rows) = self.raster.row(arc(z, flat.sqrt()));
        let around = self.raster.look_in_row(arc(y, x) * f32x4::splat(self.along), row);
        let sure = f32x4::new(indices(row).map(|row| self.sure.get(row).copied().unwrap_or(NEVER)));
        let near = f32x4::splat(COVERED * self.step);
        // Not a number has no direction.
        let is_place = in_rows & range.simd_eq(range);
        let known = is_place & (sure.simd_lt(f32x4::splat(NEVER)) | around.angle.simd_le(near));
        let widest = sure.fast_min(near).fast_max(f32x4::splat(0.6 * self.step));
        let is_covered = known & around.angle.simd_lt(widest);
        let sky = graded((around.angle - sure) * range * f32x4::splat(1.0 / SKY_RAMP_M));
        Sightings {
            known,
            front: is_covered & Depths::LIDAR.share(around.least - range),
            hidden: is_covered & Depths::LIDAR.share(range - around.greatest),
            // Where no disc is sure to be empty `sure` is so wide that this is 0.
            sky: is_covered.select(f32x4::ZERO, known & sky),
            behind_m: is_covered.select(range - around.nearest, f32x4::splat(f32::INFINITY)),
        }
    }
}

fn in_axes(rays: &[Vector3<f32>], [x, y, z]: &[Vector3<f32>; 3]) -> Vec<Direction> {
    let turn = Matrix3::from_rows(&[x.transpose(), y.transpose(), z.transpose()]);
    rays.iter().map(|ray| Direction::of(&(turn * ray), 0.0)).collect()
}

/// The least radius (rad) at which enough returns are due. They rise with the radius: halve the radii left.
fn sure_radius(median_range: f64, expected: impl Fn(f64) -> f64) -> f32 {
    let [least, most] = RADII_M;
    let radius = |k: u32| (least + (most - least) * f64::from(k) / f64::from(RADII - 1)) / median_range;
    let (mut from, mut to) = (0, RADII);
    while from < to {
        let middle = (from + to) / 2;
        if expected(radius(middle)) >= DUE {
            to = middle;
        } else {
            from = middle + 1;
        }
    }
    if from < RADII { radius(from) as f32 } else { NEVER }
}

/// Points a square radian, of the median distance of the fourth neighbour, a little below it.
fn density(places: &[[f64; 2]]) -> f64 {
    let points: Vec<Point3<f32>> = places.iter().map(|[u, v]| Point3::new(*u as f32, *v as f32, 0.0)).collect();
    let tree = KdTree::build(&points);
    let mut near = Neighbours::with_capacity(FOURTH + 1);
    let fourth = |point: &Point3<f32>| {
        tree.knn(point, FOURTH + 1, &mut near);
        near.get(FOURTH).map(|(_, squared)| f64::from(squared))
    };
    let mut squared: Vec<f64> = points.iter().filter_map(fourth).collect();
    squared.sort_by(f64::total_cmp);
    let median = squared.get(squared.len() / 2).copied().unwrap_or(f64::INFINITY).max(1e-12);
    0.7 * 4.0 / (core::f64::consts::PI * median)
}
