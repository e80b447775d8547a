//! What each pixel sees: the nearest triangle and its exact depth.

use crate::kinect::facets::{Cone, Facet};
use crate::kinect::optics::Optics;
use core::ops::Range;
use tumbled_kinect::WIDTH;

/// No triangle.
pub(super) const NOTHING: u32 = u32::MAX;
/// Set in a pixel's triangle where the projector does not shine.
pub(super) const SHADOWED: u32 = 1 << 31;

/// Whether there is a surface to measure: something, and lit.
pub(super) fn lit(facet: u32) -> bool {
    facet & SHADOWED == 0
}

/// Some rows of the image.
pub(super) struct Band<'a> {
    /// The first one's number.
    pub(super) first: usize,
    /// 1/z by pixel, 1/m; 0 = nothing.
    pub(super) inverse_depth: &'a mut [f64],
    /// Which triangle by pixel; [`NOTHING`], or with [`SHADOWED`].
    pub(super) facet: &'a mut [u32],
}

/// Draws the triangles into the band.
pub(super) fn draw(band: &mut Band<'_>, facets: &[Facet], optics: &Optics) {
    let rows = band.first..band.first + band.facet.len() / WIDTH;
    for (facet, number) in facets.iter().zip(0u32..) {
        for v in facet.rows.start.max(rows.start)..facet.rows.end.min(rows.end) {
            let Some(cone) = facet.cone(v) else { continue };
            let at = (v - rows.start) * WIDTH;
            let (Some(depths), Some(numbers)) =
                (band.inverse_depth.get_mut(at..at + WIDTH), band.facet.get_mut(at..at + WIDTH))
            else {
                continue;
            };
            match optics.bent_row(v) {
                None => straight(&cone, number, optics, v, depths, numbers),
                Some(rays) => bent(&cone, number, &facet.columns, rays, depths, numbers),
            }
        }
    }
}

/// A row without distortion: along it every side is a straight line in u, so that the pixels inside are an interval.
fn straight(cone: &Cone, number: u32, optics: &Optics, v: usize, depths: &mut [f64], numbers: &mut [u32]) {
    let y = (v as f64 - optics.cy) / optics.fy;
    let line = |e: &nalgebra::Vector3<f64>| (e.x / optics.fx, e.y * y + e.z - e.x * optics.cx / optics.fx);
    let (mut low, mut high) = (0.0_f64, WIDTH as f64 - 1.0);
    for side in &cone.sides {
        let (slope, value) = line(side);
        // A billionth of a pixel: a pixel on the edge of two triangles belongs to one of them at least.
        if slope > 0.0 {
            low = low.max(-value / slope - 1e-9);
        } else if slope < 0.0 {
            high = high.min(-value / slope + 1e-9);
        } else if value < 0.0 {
            return;
        }
    }
    let (low, high) = (low.ceil(), high.floor());
    if low > high {
        return;
    }
    let span = low as usize..high as usize + 1;
    let (slope, value) = line(&cone.inverse_depth);
    let (Some(depths), Some(numbers)) = (depths.get_mut(span.clone()), numbers.get_mut(span)) else { return };
    let mut u = low;
    for (depth, facet) in depths.iter_mut().zip(numbers) {
        let here = value + slope * u;
        if here > *depth {
            (*depth, *facet) = (here, number);
        }
        u += 1.0;
    }
}

/// A row with distortion: every pixel that may be inside is asked.
fn bent(cone: &Cone, number: u32, columns: &Range<usize>, rays: &[[f64; 2]], depths: &mut [f64], numbers: &mut [u32]) {
    let (Some(rays), Some(depths), Some(numbers)) =
        (rays.get(columns.clone()), depths.get_mut(columns.clone()), numbers.get_mut(columns.clone()))
    else {
        return;
    };
    for ((&[x, y], depth), facet) in rays.iter().zip(depths).zip(numbers) {
        let inside = cone.sides.iter().all(|e| e.x * x + e.y * y + e.z >= 0.0); // false for a ray that is not known
        let here = cone.inverse_depth_at([x, y]);
        if inside && here > *depth {
            (*depth, *facet) = (here, number);
        }
    }
}
