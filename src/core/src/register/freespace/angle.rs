//! Arcs by a polynomial: quick, and the same bits on every machine.

use core::f32::consts::{FRAC_PI_2, PI};
use wide::f32x4;

/// Largest error of `arc`, rad: 1/300 of a raster's cell, 5 µm at 2 m.
pub const ARC_ERROR: f32 = 1.2e-5;

/// The angles of four (x, y) from the x axis, −π..=π, like `atan2(y, x)` with an error of at most [`ARC_ERROR`]; 0 at
/// the origin.
#[inline(always)]
pub(crate) fn arc(y: f32x4, x: f32x4) -> f32x4 {
    let (ax, ay) = (x.abs(), y.abs());
    let is_steep = ax.simd_lt(ay);
    let (low, high) = (is_steep.select(ax, ay), is_steep.select(ay, ax));
    let ratio = (low / high) & high.simd_gt(f32x4::ZERO);
    // atan on 0..=1 by an odd polynomial (Abramowitz & Stegun 4.4.49: error at most 1e-5).
    let s = ratio * ratio;
    // In pairs: the processor works on several terms at a time.
    let [a0, a1, a2, a3, a4] = [0.999_866, 0.330_299_5, 0.180_141, 0.085_133, 0.020_835_1].map(f32x4::splat);
    let (f, low, middle) = (s * s, a0 - a1 * s, a2 - a3 * s);
    let first = ratio * (low + f * (middle + f * a4));
    let quarter = is_steep.select(f32x4::splat(FRAC_PI_2) - first, first);
    let half = x.simd_lt(f32x4::ZERO).select(f32x4::splat(PI) - quarter, quarter);
    y.simd_lt(f32x4::ZERO).select(-half, half)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Of one place, in every lane.
    fn arc(y: f32, x: f32) -> f32 {
        let [a, b, c, d] = super::arc(f32x4::splat(y), f32x4::splat(x)).to_array();
        assert_eq!([a, a, a], [b, c, d]);
        a
    }

    proptest! {
        #[test]
        fn the_arc_is_the_arctangent_to_its_stated_error(turns in -0.49999..0.49999f64, length in 1e-3..1e3f64) {
            let angle = turns * core::f64::consts::TAU;
            let (y, x) = ((length * libm::sin(angle)) as f32, (length * libm::cos(angle)) as f32);
            prop_assert!((f64::from(arc(y, x)) - libm::atan2(f64::from(y), f64::from(x))).abs() <= f64::from(ARC_ERROR));
        }
    }

    #[test]
    fn the_arc_of_the_axes_and_of_nothing() {
        for (y, x, expected) in
            [(0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.0, FRAC_PI_2), (-2.0, 0.0, -FRAC_PI_2), (0.0, -1.0, PI)]
        {
            assert!((arc(y, x) - expected).abs() <= ARC_ERROR);
        }
    }
}
