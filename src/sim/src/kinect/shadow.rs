//! Where the projector does not shine.
//!
//! Projector and camera look along the same rows, the projector a baseline to the camera's right. A point in column u with
//! the parallax δ = f·b/z is in the projector's column u − δ; of all points in one of its columns the nearest, which has the
//! greatest δ, is lit. Left of a near edge the background is in columns that the near surface has taken: a band of
//! f·b·(1/z_near − 1/z_far) pixels.
//!
//! Only surfaces the camera sees are taken for obstacles; what it does not see casts no shadow.

use crate::kinect::optics::Optics;
use crate::kinect::raster::{NOTHING, SHADOWED};
use tumbled_kinect::WIDTH;

/// The projector's columns left of the image that are kept: a parallax of 144 px is a depth of 0.3 m.
const MARGIN: usize = 160;
/// A parallax beyond which a point is behind another and not beside it, px. A surface that turns faster than a pixel of
/// parallax a pixel is not lit at all.
const BEHIND_PX: f64 = 1.0;
/// Neighbours that differ less are one surface, and cover the columns between them, px.
const JOINED_PX: f64 = 0.75;

/// Marks the pixels of a row that the projector does not reach. `columns` is room to work in.
pub(super) fn cast(
    optics: &Optics,
    baseline_m: f64,
    v: usize,
    inverse_depth: &[f64],
    facet: &mut [u32],
    columns: &mut Vec<f64>,
) {
    let parallax_of_1_m = optics.fx * baseline_m;
    let parallax = |w: f64| parallax_of_1_m * w;
    let seen = || inverse_depth.iter().zip(facet.iter()).filter(|(_, facet)| **facet != NOTHING).map(|(w, _)| *w);
    let (low, high) = seen().fold((f64::MAX, 0.0_f64), |(low, high), w| (low.min(w), high.max(w)));
    if parallax(high) - parallax(low) <= BEHIND_PX {
        return;
    }
    let bent = optics.bent_row(v);
    let place = |u: usize, w: f64| {
        let column = match bent.and_then(|rays| rays.get(u)) {
            None => u as f64,
            Some([x, _]) => optics.fx * x + optics.cx,
        };
        // Rounded, as an index; a point too far out is at the border, where nothing else is.
        ((column - parallax(w) + (MARGIN as f64 + 0.5)).max(0.0) as usize).min(WIDTH + 2 * MARGIN - 1)
    };

    columns.clear();
    columns.resize(WIDTH + 2 * MARGIN, 0.0);
    let mut before: Option<(usize, f64)> = None;
    for (u, (&w, &number)) in inverse_depth.iter().zip(facet.iter()).enumerate() {
        if number == NOTHING {
            before = None;
            continue;
        }
        let (here, delta) = (place(u, w), parallax(w));
        let from = match before {
            Some((at, was)) if (was - delta).abs() <= JOINED_PX => at.min(here),
            _ => here,
        };
        for column in columns.get_mut(from..=here).into_iter().flatten() {
            *column = column.max(delta);
        }
        before = Some((here, delta));
    }
    for (u, (&w, number)) in inverse_depth.iter().zip(facet.iter_mut()).enumerate() {
        let nearest = columns.get(place(u, w)).copied().unwrap_or_default();
        if *number != NOTHING && nearest - parallax(w) > BEHIND_PX {
            *number |= SHADOWED;
        }
    }
}
