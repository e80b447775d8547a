//! Free space of a depth image with its misses (method.md §3.4).

use super::{Depths, Sightings};
use crate::register::cloud::DepthView;
use crate::surface::four::{indices, whole};
use wide::f32x4;

/// Side of the window in which the least depth counts, px: noise along a silhouette never does.
const WINDOW: usize = 9;
/// One entry for so many pixels each way.
const STEP: usize = 4;
/// From an entry's first pixel to the first of its window: the window's middle is the entry's.
const BEFORE: usize = 2;
/// Nothing is said of what is nearer than this along the axis, m.
const NEAREST_M: f32 = 0.3;
/// Pixels at the image's rim of which nothing is said.
const RIM: f32 = 2.0;

/// Windows of an image at most: their numbers are whole as floats.
const MOST_WINDOWS: usize = 1 << 24;

/// What a window of pixels says.
#[derive(Clone, Copy, Debug)]
struct Window {
    /// The least depth, m; infinite: all is sky; NaN: a pixel is not known.
    least: f32,
    /// The middle's own depth; infinite: sky; NaN: not known.
    middle: f32,
}

impl Window {
    const UNKNOWN: Self = Self { least: f32::NAN, middle: f32::NAN };
}

/// The least depth around every fourth pixel.
#[derive(Clone, Debug)]
pub struct DepthMask {
    focal: [f32; 2],
    center: [f32; 2],
    size: [f32; 2],
    columns: usize,
    windows: Vec<Window>,
}

impl DepthMask {
    /// From an image. `None`: it has not the number of pixels it says, or is smaller than a window,
    /// or larger than any camera's.
    pub fn build(view: &DepthView) -> Option<Self> {
        let (width, height) = (view.width, view.height);
        if width.checked_mul(height)? != view.z_m.len() || width < WINDOW || height < WINDOW {
            return None;
        }
        let [fx, fy] = view.focal_px;
        if !(fx > 0.0 && fy > 0.0) {
            return None;
        }
        let columns = width.div_ceil(STEP);
        if columns * height.div_ceil(STEP) > MOST_WINDOWS {
            return None;
        }
        let mut windows = Vec::with_capacity(columns * height.div_ceil(STEP));
        let mut band = vec![0.0f32; width];
        for top in (0..height).step_by(STEP) {
            let rows = top.saturating_sub(BEFORE)..(top + WINDOW - BEFORE).min(height);
            least_of_rows(view, rows, &mut band);
            let middles = view.z_m.chunks_exact(width).nth((top + BEFORE).min(height - 1))?;
            for left in (0..width).step_by(STEP) {
                let window = band.get(left.saturating_sub(BEFORE)..(left + WINDOW - BEFORE).min(width))?;
                let middle = *middles.get((left + BEFORE).min(width - 1))?;
                windows.push(Window { least: window.iter().copied().fold(f32::INFINITY, least), middle: seen(middle) });
            }
        }
        Some(Self {
            focal: view.focal_px,
            center: view.center_px,
            size: [width as f32, height as f32],
            columns,
            windows,
        })
    }

    /// What the camera says of four places in its own frame (z forward), m.
    #[inline(always)]
    pub(crate) fn look_at_four(&self, [x, y, z]: [f32x4; 3]) -> Sightings {
        let [fx, fy] = self.focal.map(f32x4::splat);
        let [cx, cy] = self.center.map(|center| f32x4::splat(center + 0.5));
        let [width, height] = self.size.map(|size| f32x4::splat(size - RIM));
        let inverse = f32x4::ONE / z;
        // Pixel centres are at integers.
        let (u, v) = (x * inverse * fx + cx, y * inverse * fy + cy);
        let rim = f32x4::splat(RIM);
        let in_view = z.simd_gt(f32x4::splat(NEAREST_M))
            & (u.simd_ge(rim) & v.simd_ge(rim))
            & (u.simd_lt(width) & v.simd_lt(height));
        let step = |pixel: f32x4| whole((pixel & in_view) * f32x4::splat(1.0 / STEP as f32));
        let entries = indices(step(v) * f32x4::splat(self.columns as f32) + step(u));
        let four = entries.map(|entry| self.windows.get(entry).unwrap_or(&Window::UNKNOWN));
        let (least, middle) =
            (f32x4::new(four.map(|window| window.least)), f32x4::new(four.map(|window| window.middle)));
        Sightings::of_image(in_view, [z, least, middle], Depths::CAMERA, f32x4::ONE)
    }

    #[cfg(test)]
    pub(crate) fn look(&self, place: [f32; 3]) -> super::Sighting {
        self.look_at_four(place.map(f32x4::splat)).first()
    }
}

/// The least depth of each column over rows.
fn least_of_rows(view: &DepthView, rows: core::ops::Range<usize>, band: &mut [f32]) {
    band.fill(f32::INFINITY);
    for row in view.z_m.chunks_exact(view.width).skip(rows.start).take(rows.len()) {
        for (to, &z) in band.iter_mut().zip(row) {
            *to = least(*to, seen(z));
        }
    }
}

/// No return is infinitely far; what is no depth at all is not known.
#[inline]
fn seen(z: f32) -> f32 {
    if z == 0.0 {
        f32::INFINITY
    } else if z > 0.0 {
        z
    } else {
        f32::NAN
    }
}

/// The lesser; NaN where either is.
#[inline]
fn least(a: f32, b: f32) -> f32 {
    if a.is_nan() || a < b { a } else { b }
}
