//! A camera's own error of depth over its image, as a low-order surface: what a calibration found, taken out again.
//!
//! ```text
//!   z = z_law + z_lawᵖ · Σ c_ij xⁱ yʲ,   x = u / 320 − 1,  y = v / 240 − 1,  i + j ≤ 3
//! ```
//! `p` = 0: an error of so many metres wherever the surface is. `p` = 2: an error of the disparity, which grows with the
//! square of the depth.

use crate::frame::{HEIGHT, WIDTH};

/// How many terms a surface has: 1, x, x², x³, y, xy, x²y, y², xy², y³.
pub const WARP_TERMS: usize = 10;
/// A surface that changes a depth of 2 m by more than this is no calibration's, m.
const MOST_M: f64 = 0.2;

/// A surface that is added to the depths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthWarp {
    /// The power of the depth that the surface is multiplied by: 0 or 2.
    pub power: u8,
    /// The factors of [`terms_at`](Self::terms_at), m^(1 − power).
    pub factors: [f64; WARP_TERMS],
}

/// A surface that is none.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WarpError {
    /// A power nothing is known of.
    #[error("power = {0}, expected 0 (an error in metres) or 2 (an error of the disparity)")]
    Power(u8),
    /// Factors that are no numbers, or that bend the picture beyond any camera.
    #[error("the surface changes a depth of 2 m by {0:.3} m somewhere in the picture, expected 0.2 at most")]
    Size(f64),
}

impl DepthWarp {
    /// The terms at a pixel: 1, x, x², x³, y, xy, x²y, y², xy², y³.
    pub fn terms_at(u: f64, v: f64) -> [f64; WARP_TERMS] {
        let (x, y) = (2.0 * u / WIDTH as f64 - 1.0, 2.0 * v / HEIGHT as f64 - 1.0);
        [1.0, x, x * x, x * x * x, y, x * y, x * x * y, y * y, x * y * y, y * y * y]
    }

    /// The surface at a pixel, m^(1 − power).
    pub fn at(&self, u: f64, v: f64) -> f64 {
        self.factors.iter().zip(Self::terms_at(u, v)).map(|(factor, term)| factor * term).sum()
    }

    /// Whether it can be a camera's.
    ///
    /// # Errors
    /// [`WarpError`]: an unknown power, or a surface beyond measure.
    pub fn check(&self) -> Result<(), WarpError> {
        let at_two_metres = match self.power {
            0 => 1.0,
            2 => 4.0,
            other => return Err(WarpError::Power(other)),
        };
        let places = (0..=16).flat_map(|v| (0..=16).map(move |u| (u * WIDTH / 16, v * HEIGHT / 16)));
        let sizes = places.map(|(u, v)| at_two_metres * self.at(u as f64, v as f64).abs());
        // A number that is none is beyond everything.
        let largest = sizes.fold(0.0, |most: f64, size| if size <= most { most } else { size });
        if largest <= MOST_M { Ok(()) } else { Err(WarpError::Size(largest)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_surface_has_its_terms_where_they_belong() {
        // At column 480, row 360: x = y = 1/2.
        let expected = [1.0, 0.5, 0.25, 0.125, 0.5, 0.25, 0.125, 0.25, 0.125, 0.125];
        assert_eq!(DepthWarp::terms_at(480.0, 360.0), expected);
        let mut factors = [0.0; WARP_TERMS];
        (factors[0], factors[7]) = (0.002, 0.004);
        assert!((DepthWarp { power: 0, factors }.at(480.0, 360.0) - 0.003).abs() < 1e-15);
    }

    #[test]
    fn surfaces_that_no_camera_has_are_refused() {
        let of =
            |power, constant| DepthWarp { power, factors: [constant, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0] };
        assert_eq!((of(0, 0.2).check(), of(2, 0.05).check()), (Ok(()), Ok(())));
        assert_eq!(of(1, 0.0).check(), Err(WarpError::Power(1)));
        assert_eq!(of(2, 0.06).check(), Err(WarpError::Size(0.24)));
        assert!(matches!(of(0, f64::NAN).check(), Err(WarpError::Size(_))));
    }
}
