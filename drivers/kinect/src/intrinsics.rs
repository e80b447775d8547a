//! The depth camera: a pinhole with Brown–Conrady distortion.
//!
//! Pixel centres lie at whole u, v. A point (x, y, 1) on the plane at depth 1 is seen at
//!
//! ```text
//!  r² = x² + y²,  L = 1 + k1·r² + k2·r⁴ + k3·r⁶
//!  x' = x·L + 2·p1·x·y + p2·(r² + 2x²)      u = fx·x' + cx
//!  y' = y·L + p1·(r² + 2y²) + 2·p2·x·y      v = fy·y' + cy
//! ```
//!
//! (Brown, "Close-range camera calibration", 1971; the order k1 k2 p1 p2 k3 is that of the usual calibration tools.)
//! Calibrate on infrared images and mind that the depth image lies a few pixels beside them: see `docs/kinect.md`.

/// Rounds of Newton's method before a pixel is given up. From a start at the distorted point four or five are usual.
const MOST_ROUNDS: u32 = 30;
/// How close to the pixel an undistorted point must land when it is distorted again, pixels.
const TOLERANCE_PX: f64 = 1e-9;
/// Places between the axis and a ray at which the distortion is looked at for folds.
const FOLD_SAMPLES: u32 = 16;

/// Focal lengths and principal point in pixels of the 640 × 480 image, and distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Focal length across, px.
    pub fx: f64,
    /// Focal length down, px.
    pub fy: f64,
    /// Principal point, column.
    pub cx: f64,
    /// Principal point, row.
    pub cy: f64,
    /// Radial distortion, r².
    pub k1: f64,
    /// Radial distortion, r⁴.
    pub k2: f64,
    /// Tangential distortion.
    pub p1: f64,
    /// Tangential distortion.
    pub p2: f64,
    /// Radial distortion, r⁶.
    pub k3: f64,
}

impl Default for Intrinsics {
    /// The factory's: f = 575.8 px follows from the zero plane (120 / 0.1042 / 2), the centre is the image's, no
    /// distortion. libfreenect and OpenNI compute with these.
    fn default() -> Self {
        Self { fx: 575.8, fy: 575.8, cx: 320.0, cy: 240.0, k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0 }
    }
}

/// Intrinsics that describe no camera.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum IntrinsicsError {
    /// A focal length that is none.
    #[error("{name} = {found} px, expected 100 to 10000: the Kinect's depth camera has about 580")]
    FocalLength {
        /// `fx` or `fy`.
        name: &'static str,
        /// What was given.
        found: f64,
    },
    /// A number that is none.
    #[error("{name} = {found}, expected a finite number: 0 stands for no distortion")]
    NotFinite {
        /// Which parameter.
        name: &'static str,
        /// What was given.
        found: f64,
    },
}

/// A pixel without its distortion, and how well that is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Undistorted {
    /// x/z of the ray through the pixel.
    pub x: f64,
    /// y/z of the ray through the pixel.
    pub y: f64,
    /// How far from the pixel the ray lands when it is distorted again, px.
    pub residual_px: f64,
    /// Rounds of Newton's method it took.
    pub rounds: u32,
    /// Whether the ray is to be used: it lands within 1e-9 px, and the distortion does not fold the image over there.
    pub converged: bool,
}

impl Intrinsics {
    /// Whether these are a camera's.
    ///
    /// # Errors
    /// [`IntrinsicsError`]: the first parameter that cannot be.
    pub fn check(&self) -> Result<(), IntrinsicsError> {
        for (name, found) in [("fx", self.fx), ("fy", self.fy)] {
            if !(100.0..=10_000.0).contains(&found) {
                return Err(IntrinsicsError::FocalLength { name, found });
            }
        }
        let others = [
            ("cx", self.cx),
            ("cy", self.cy),
            ("k1", self.k1),
            ("k2", self.k2),
            ("p1", self.p1),
            ("p2", self.p2),
            ("k3", self.k3),
        ];
        match others.into_iter().find(|(_, found)| !found.is_finite()) {
            Some((name, found)) => Err(IntrinsicsError::NotFinite { name, found }),
            None => Ok(()),
        }
    }

    /// Where the camera sees the direction (x, y, 1): column and row, px. Directions outside the image are given as well.
    pub fn pixel(&self, x: f64, y: f64) -> (f64, f64) {
        let (x, y) = self.distort(x, y);
        (self.fx * x + self.cx, self.fy * y + self.cy)
    }

    /// The direction (x, y, 1) that is seen at column `u`, row `v`.
    ///
    /// Without distortion this is exact. With it the equations have no closed inverse: Newton's method from the distorted
    /// point, a step halved until it brings an improvement. Strong distortion fitted on the middle of the image may have no
    /// answer at its border; that is said, not guessed over.
    pub fn ray(&self, u: f64, v: f64) -> Undistorted {
        let (target_x, target_y) = ((u - self.cx) / self.fx, (v - self.cy) / self.fy);
        let (mut x, mut y) = (target_x, target_y);
        let residual_px = |x: f64, y: f64| {
            let (dx, dy) = self.distort(x, y);
            let (du, dv) = (self.fx * (dx - target_x), self.fy * (dy - target_y));
            (du * du + dv * dv).sqrt()
        };
        let mut residual = residual_px(x, y);
        let mut rounds = 0;
        while residual > TOLERANCE_PX && rounds < MOST_ROUNDS {
            rounds += 1;
            let (dx, dy) = self.distort(x, y);
            let [[a, b], [c, d]] = self.jacobian(x, y);
            let det = a * d - b * c;
            let (ex, ey) = (target_x - dx, target_y - dy);
            let (step_x, step_y) = ((d * ex - b * ey) / det, (a * ey - c * ex) / det);
            let mut share = 1.0;
            let mut improved = false;
            while share > 1e-3 && !improved {
                let next = residual_px(x + share * step_x, y + share * step_y);
                improved = next < residual; // false for NaN, which a vanishing determinant brings
                if improved {
                    (x, y, residual) = (x + share * step_x, y + share * step_y, next);
                }
                share /= 2.0;
            }
            if !improved {
                break;
            }
        }
        let converged = residual <= TOLERANCE_PX && self.unfolded_to(x, y);
        Undistorted { x, y, residual_px: residual, rounds, converged }
    }

    /// Whether the distortion keeps its sense from the axis out to (x, y): its derivatives, which are symmetric, are
    /// positive definite all the way. Beyond the first fold there are further solutions that land on the pixel as well, and
    /// no lens has them.
    fn unfolded_to(&self, x: f64, y: f64) -> bool {
        (1..=FOLD_SAMPLES).all(|i| {
            let share = f64::from(i) / f64::from(FOLD_SAMPLES);
            let [[a, b], [c, d]] = self.jacobian(share * x, share * y);
            a > 0.0 && a * d - b * c > 0.0
        })
    }

    fn distort(&self, x: f64, y: f64) -> (f64, f64) {
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let dx = x * radial + 2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x);
        let dy = y * radial + self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y;
        (dx, dy)
    }

    /// Derivatives of [`distort`](Self::distort): rows x', y'; columns x, y.
    fn jacobian(&self, x: f64, y: f64) -> [[f64; 2]; 2] {
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let slope = self.k1 + r2 * (2.0 * self.k2 + r2 * 3.0 * self.k3); // dL/dr²
        let mixed = 2.0 * (x * y * slope + self.p1 * x + self.p2 * y);
        [
            [radial + 2.0 * x * x * slope + 2.0 * self.p1 * y + 6.0 * self.p2 * x, mixed],
            [mixed, radial + 2.0 * y * y * slope + 6.0 * self.p1 * y + 2.0 * self.p2 * x],
        ]
    }
}

#[cfg(test)]
impl Intrinsics {
    /// A published calibration of a Kinect's infrared camera (Burrus), strong in all five terms.
    pub(crate) const INFRARED: Self = Self {
        fx: 594.214,
        fy: 591.041,
        cx: 339.308,
        cy: 242.739,
        k1: -0.26386,
        k2: 0.99967,
        p1: -0.00076,
        p2: 0.00504,
        k3: -1.30536,
    };
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn distortion_by_hand() {
        // x = 0.3, y = 0.4: r² = 0.25. L = 1 + 0.1·0.25 + 0.2·0.0625 + 0.4·0.015625 = 1.04375.
        // x' = 0.313125 + 2·0.01·0.12 + 0.02·(0.25 + 0.18) = 0.313125 + 0.0024 + 0.0086 = 0.324125
        // y' = 0.4175 + 0.01·(0.25 + 0.32) + 2·0.02·0.12 = 0.4175 + 0.0057 + 0.0048 = 0.428
        let camera =
            Intrinsics { fx: 500.0, fy: 600.0, cx: 320.0, cy: 240.0, k1: 0.1, k2: 0.2, p1: 0.01, p2: 0.02, k3: 0.4 };
        let (u, v) = camera.pixel(0.3, 0.4);
        assert!(
            (u - (320.0 + 500.0 * 0.324_125)).abs() < 1e-9 && (v - (240.0 + 600.0 * 0.428)).abs() < 1e-9,
            "{u} {v}"
        );
    }

    #[test]
    fn without_distortion_a_ray_is_a_division() {
        let ray = Intrinsics::default().ray(600.0, 40.0);
        assert_eq!((ray.x, ray.y, ray.rounds), (280.0 / 575.8, -200.0 / 575.8, 0));
        assert!(ray.converged);
    }

    #[test]
    fn derivatives_are_those_of_the_distortion() {
        let (x, y, h) = (0.31, -0.22, 1e-6);
        let analytic = Intrinsics::INFRARED.jacobian(x, y);
        let (right, left) = (Intrinsics::INFRARED.distort(x + h, y), Intrinsics::INFRARED.distort(x - h, y));
        let (down, up) = (Intrinsics::INFRARED.distort(x, y + h), Intrinsics::INFRARED.distort(x, y - h));
        let central = [[right.0 - left.0, down.0 - up.0], [right.1 - left.1, down.1 - up.1]];
        for (a, c) in analytic.iter().flatten().zip(central.iter().flatten()) {
            assert!((a - c / (2.0 * h)).abs() < 1e-8, "{analytic:?}");
        }
    }

    #[test]
    fn a_folded_image_is_not_converged() {
        // x' = x (1 − r²) reaches 0.385 at r = 0.577 and then falls: column 620 (0.521) is seen by no ray.
        let folded = Intrinsics { k1: -1.0, ..Intrinsics::default() };
        assert!(!folded.ray(620.0, 240.0).converged);
        // With k2 = 0.25, x' = x (1 − r² + r⁴/4) peaks at r = 0.632 (0.404), falls to 0 at r = 1.414 and rises again: it
        // does pass 0.521, between r = 1.75 and 1.76, but no lens looks there.
        let twice = Intrinsics { k2: 0.25, ..folded };
        assert!(twice.pixel(1.75, 0.0).0 < 620.0 && twice.pixel(1.76, 0.0).0 > 620.0);
        assert!(!twice.ray(620.0, 240.0).converged);
        assert!(folded.ray(420.0, 240.0).converged);
    }

    #[test]
    fn parameters_of_no_camera_are_refused_by_name() {
        let flat = Intrinsics { fy: 0.0, ..Intrinsics::default() };
        assert_eq!(flat.check(), Err(IntrinsicsError::FocalLength { name: "fy", found: 0.0 }));
        let infinite = Intrinsics { k3: f64::INFINITY, ..Intrinsics::default() };
        assert_eq!(infinite.check(), Err(IntrinsicsError::NotFinite { name: "k3", found: f64::INFINITY }));
        assert_eq!(Intrinsics::INFRARED.check(), Ok(()));
    }

    proptest! {
        #[test]
        fn the_published_infrared_calibration_inverts_over_the_whole_image(u in 0.0f64..639.0, v in 0.0f64..479.0) {
            let ray = Intrinsics::INFRARED.ray(u, v);
            prop_assert!(ray.converged, "{:?}", ray);
            let (u_again, v_again) = Intrinsics::INFRARED.pixel(ray.x, ray.y);
            prop_assert!((u - u_again).abs() < 2e-9 && (v - v_again).abs() < 2e-9);
        }

        #[test]
        fn the_ray_found_is_the_one_that_was_distorted(
            x in -0.55f64..0.55, y in -0.42f64..0.42, k1 in -0.2f64..0.2, k2 in -0.1f64..0.1,
            p1 in -0.01f64..0.01, p2 in -0.01f64..0.01, k3 in -0.05f64..0.05,
        ) {
            let camera = Intrinsics { k1, k2, p1, p2, k3, ..Intrinsics::default() };
            let (u, v) = camera.pixel(x, y);
            let ray = camera.ray(u, v);
            prop_assert!(ray.converged);
            prop_assert!((ray.x - x).abs() < 1e-10 && (ray.y - y).abs() < 1e-10, "{:?} for {} {}", ray, x, y);
        }

        #[test]
        fn any_parameters_end_in_an_answer(numbers in any::<[f64; 9]>(), u in any::<f64>(), v in any::<f64>()) {
            let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = numbers;
            let ray = Intrinsics { fx, fy, cx, cy, k1, k2, p1, p2, k3 }.ray(u, v);
            prop_assert!(!ray.converged || ray.residual_px <= 1e-9);
        }
    }
}
