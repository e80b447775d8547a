//! How far a depth may be off.
//!
//! The device measures disparity, and its noise is nearly the same everywhere *in disparity*: about half a step. A step is
//! s·z² of depth, so the depth's standard deviation grows with the square of the distance:
//!
//! ```text
//!  σ_z = σ_steps(z) · s · z²
//! ```
//!
//! Across the ray a point is off by a share of a pixel, σ_u = σ_v, whose length is σ_u · z / f. A point's covariance is
//! J · diag(σ_u², σ_v², σ_z²) · Jᵀ with J = ∂(x, y, z)/∂(u, v, z). It is not white: neighbouring pixels share their
//! correlation window and correlate by 0.55–0.65, so an average over n neighbours is no better than that of about n/6.

use crate::law::ZeroPlane;

/// Noise in disparity at one depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisparitySigma {
    /// Depth, m.
    pub metres: f64,
    /// Standard deviation there, disparity steps, rounding included.
    pub steps: f64,
}

/// The noise of a depth camera. Holds for surfaces seen at less than about 60° of incidence; edges, black, shiny and
/// transparent surfaces are worse and are not in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseModel {
    /// s in Δz = s · z²: depth of one disparity step at 1 m, 1/m. [`ZeroPlane::step_per_metre`].
    pub step_per_metre: f64,
    /// Noise in disparity by depth, ascending; straight lines between, the ends' values beyond.
    pub disparity: [DisparitySigma; 6],
    /// Standard deviation across the ray, px, in each direction.
    pub lateral_px: f64,
}

impl Default for NoiseModel {
    /// * Steps at 0.8 to 2.75 m: measured on 13 047 smooth patches of 25 × 25 px of 50 real frames, a quadratic removed
    ///   (spread over a patch within one frame). At 4 m and beyond: 0.49–0.53 measured on one real frame from 2 to 7 m,
    ///   and the half step of Khoshelham & Elberink, Sensors 12(2), 2012.
    /// * Across: 0.8 px at perpendicular incidence, Nguyen, Izadi & Lovell, 3DIMPVT 2012.
    fn default() -> Self {
        let at = |metres, steps| DisparitySigma { metres, steps };
        Self {
            step_per_metre: ZeroPlane::default().step_per_metre(),
            disparity: [at(0.8, 0.56), at(1.25, 0.52), at(1.75, 0.47), at(2.25, 0.445), at(2.75, 0.45), at(4.0, 0.51)],
            lateral_px: 0.8,
        }
    }
}

impl NoiseModel {
    /// Standard deviation in disparity at a depth in metres, steps.
    pub fn disparity_steps(&self, metres: f64) -> f64 {
        let [first, .., last] = self.disparity;
        if metres <= first.metres {
            return first.steps;
        }
        for pair in self.disparity.windows(2) {
            if let &[near, far] = pair
                && metres <= far.metres
            {
                let share = (metres - near.metres) / (far.metres - near.metres);
                return near.steps + share * (far.steps - near.steps);
            }
        }
        last.steps
    }

    /// Standard deviation of a depth in metres, m.
    pub fn sigma_z(&self, metres: f64) -> f64 {
        self.disparity_steps(metres) * self.step_per_metre * metres * metres
    }

    /// Standard deviation across the ray at a depth in metres, for a focal length in pixels: m, in each direction.
    pub fn sigma_lateral(&self, metres: f64, focal_px: f64) -> f64 {
        self.lateral_px * metres / focal_px
    }

    /// Covariance of the point at depth `z` (m) on the ray (x/z, y/z), in the Kinect's frame, m². Distortion's own small
    /// slope is left out.
    pub fn covariance(&self, ray: [f64; 2], z: f64, focal_px: f64) -> [[f64; 3]; 3] {
        let across = self.sigma_lateral(z, focal_px);
        let (lateral, along) = (across * across, self.sigma_z(z) * self.sigma_z(z));
        // J's columns are (z/f, 0, 0), (0, z/f, 0) and the ray (x/z, y/z, 1).
        let [rx, ry] = ray;
        [
            [lateral + along * rx * rx, along * rx * ry, along * rx],
            [along * rx * ry, lateral + along * ry * ry, along * ry],
            [along * rx, along * ry, along],
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_at_the_measured_distances() {
        let model = NoiseModel::default();
        // The table measured on real frames: 1.5 mm at 1 m, 5.3 mm at 2 m, 11.7 mm at 3 m.
        for (metres, mm) in [(1.0, 1.5), (2.0, 5.3), (3.0, 11.7)] {
            let sigma = model.sigma_z(metres) * 1_000.0;
            assert!((sigma - mm).abs() < 0.06 * mm, "{sigma} mm at {metres} m, measured {mm}");
        }
    }

    #[test]
    fn steps_are_straight_between_the_knots_and_level_beyond() {
        let model = NoiseModel::default();
        let steps = [0.1, 0.8, 1.025, 2.25, 4.0, 9.0].map(|z| model.disparity_steps(z));
        // 1.025 m is half way from 0.8 to 1.25 m: (0.56 + 0.52) / 2 = 0.54.
        for (found, expected) in steps.iter().zip([0.56, 0.56, 0.54, 0.445, 0.51, 0.51]) {
            assert!((found - expected).abs() < 1e-12, "{steps:?}");
        }
    }

    #[test]
    fn covariance_of_a_point_on_the_axis_is_diagonal() {
        let model = NoiseModel::default();
        let c = model.covariance([0.0, 0.0], 2.0, 575.8);
        // 0.8 px · 2 m / 575.8 px = 2.779 mm.
        assert!((c[0][0].sqrt() - 2.779e-3).abs() < 1e-6 && c[0][0] == c[1][1]);
        assert_eq!(c[2][2], model.sigma_z(2.0) * model.sigma_z(2.0));
        assert_eq!((c[0][1], c[0][2], c[1][2]), (0.0, 0.0, 0.0));
    }

    #[test]
    fn covariance_follows_the_ray() {
        // Along (rx, ry, 1) the depth's variance moves x by rx and y by ry: cov(x, z) = rx·σ_z², cov(x, y) = rx·ry·σ_z².
        let model = NoiseModel::default();
        let c = model.covariance([0.5, -0.25], 3.0, 575.8);
        let along = c[2][2];
        assert!((c[0][2] - 0.5 * along).abs() < 1e-15 && (c[0][1] + 0.125 * along).abs() < 1e-15);
        assert!(
            (c[0][0] - 0.25 * along - model.sigma_lateral(3.0, 575.8) * model.sigma_lateral(3.0, 575.8)).abs() < 1e-15
        );
        for (i, row) in c.iter().enumerate() {
            for (j, &entry) in row.iter().enumerate() {
                assert_eq!(entry, c[j][i]);
            }
        }
    }
}
