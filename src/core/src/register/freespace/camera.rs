//! Free space of a camera's bare points (method.md §3.4b, camera side).

use super::raster::{Raster, Ray};
use super::{Depths, Sightings, graded};
use crate::surface::four::dot;
use nalgebra::Vector3;
use wide::f32x4;

/// A place is covered where a ray passes within so many spacings; there the least range counts.
const COVERED: f32 = 1.6;
/// Beyond, the share of sky rises to 1 over this, m.
const SKY_RAMP_M: f32 = 0.03;
/// Tangents of the half fields of view of a Kinect, 28.5° × 22°.
const VIEW: [f32; 2] = [0.542_956, 0.404_026];
/// A Kinect's cloud has its own axes where z is its mean sight within 40°: the cosine.
const OWN_AXES: f32 = 0.766_044;
/// The view of a camera with its own axes begins so far along z, m.
const NEAREST_M: f32 = 0.3;
/// Nothing is said of what is nearer along the mean sight, m.
const LEAST_DEPTH_M: f32 = 0.2;

/// A raster over the plane across the mean sight line.
#[derive(Clone, Debug)]
pub struct CameraMask {
    /// Axes of the raster, the mean sight line last.
    axes: [Vector3<f32>; 3],
    raster: Raster,
    spacing_m: f32,
    /// Whether the points' axes are a camera's, so that its field of view is known.
    own_axes: bool,
}

impl CameraMask {
    /// From rays to the points (from the viewpoint, m) and the points' spacing, m. `None`: no rays, or they do not lie
    /// on one side.
    pub fn build(rays: &[Vector3<f32>], spacing_m: f32) -> Option<Self> {
        let axes = sight_axes(rays)?;
        let [x, y, along] = axes;
        let mut ranges: Vec<f32> = rays.iter().map(|ray| ray.norm()).collect();
        let middle = ranges.len() / 2;
        let median = *ranges.select_nth_unstable_by(middle, f32::total_cmp).1;
        let on_plane = |ray: &Vector3<f32>| {
            let (range, depth) = (ray.norm(), ray.dot(&along));
            // Farther than 75° off the mean sight a plane across it is no picture.
            (depth > 0.25 * range).then(|| {
                let (u, v) = (ray.dot(&x) / depth, ray.dot(&y) / depth);
                let (w, square) = (1.0 + u * u + v * v, depth / range * (depth / range));
                // dθ² = (|d|² w − (u·d)²)/w², w = 1 + u² + v² = (range/depth)².
                let metric = [(w - u * u) / w * square, -2.0 * u * v / w * square, (w - v * v) / w * square];
                Ray { u, v, metric, range, reach: COVERED * spacing_m / range }
            })
        };
        let placed: Vec<Ray> = rays.iter().filter_map(on_plane).collect();
        let edge = (0.5 * spacing_m / median).max(0.002);
        // Beyond the raster the gap is wide enough for all sky there is.
        let widest = placed
            .iter()
            .map(|ray| (COVERED * spacing_m + 1.5 * SKY_RAMP_M) / ray.range * (1.0 + ray.u * ray.u + ray.v * ray.v));
        let margin = widest.fold(0.0, f32::max).min(0.25);
        let raster = Raster::build(&placed, edge, margin)?;
        Some(Self { axes, raster, spacing_m, own_axes: along.z > OWN_AXES })
    }

    /// What the camera says of four places, given from the viewpoint, m.
    #[inline(always)]
    pub(crate) fn look_at_four(&self, ray: [f32x4; 3]) -> Sightings {
        let [ax, ay, along] = self.axes.map(|axis| dot(&[axis.x, axis.y, axis.z].map(f32x4::splat), &ray));
        // Not a number is nowhere.
        let is_before = along.simd_ge(f32x4::splat(LEAST_DEPTH_M));
        let range = dot(&ray, &ray).sqrt();
        let inverse = f32x4::ONE / along;
        let (around, is_inside) = self.raster.look(ax * inverse, ay * inverse);
        // Off the raster no ray passes by.
        let gap = around.angle * range - f32x4::splat(COVERED * self.spacing_m);
        let gap = is_inside.select(gap, f32x4::splat(f32::INFINITY));
        let behind = range - around.least;
        let is_covered = gap.simd_lt(f32x4::ZERO) & is_before;
        // No ray passes by: the camera saw through, as far as it looked there.
        let is_through = self.in_view(&ray) & is_before;
        Sightings {
            known: is_covered | is_through,
            front: is_covered & Depths::CAMERA.share(-behind),
            hidden: is_covered & Depths::CAMERA.share(behind),
            // No gap, no sky.
            sky: is_through & graded(gap * f32x4::splat(1.0 / SKY_RAMP_M)),
            behind_m: is_covered.select(range - around.nearest, f32x4::splat(f32::INFINITY)),
        }
    }

    /// In the nominal field of view; of a cloud with other axes it is not known, and everything before the camera is.
    #[inline(always)]
    fn in_view(&self, [x, y, z]: &[f32x4; 3]) -> f32x4 {
        if !self.own_axes {
            return z.simd_eq(*z);
        }
        let [tx, ty] = VIEW.map(f32x4::splat);
        z.simd_gt(f32x4::splat(NEAREST_M)) & x.abs().simd_lt(*z * tx) & y.abs().simd_lt(*z * ty)
    }
}

/// Two axes across the mean direction of rays, and that direction.
pub(crate) fn sight_axes(rays: &[Vector3<f32>]) -> Option<[Vector3<f32>; 3]> {
    let mean: Vector3<f64> = rays.iter().map(|ray| ray.cast::<f64>().normalize()).sum();
    // All around: no direction is the mean one.
    let along = mean.try_normalize(0.1 * rays.len() as f64)?;
    let least = if along.x.abs() <= along.y.abs() && along.x.abs() <= along.z.abs() {
        Vector3::x()
    } else if along.y.abs() <= along.z.abs() {
        Vector3::y()
    } else {
        Vector3::z()
    };
    let x = least.cross(&along).normalize();
    let y = along.cross(&x);
    Some([x.cast(), y.cast(), along.cast()])
}
