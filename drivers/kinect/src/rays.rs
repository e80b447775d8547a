//! The camera as a table: the ray of every pixel.

use crate::frame::WIDTH;
use crate::image::Image;
use crate::intrinsics::{Intrinsics, IntrinsicsError};

/// x/z and y/z of the ray through every pixel, distortion removed. A pixel whose ray is not known has NaN in both.
#[derive(Clone, Debug)]
pub struct RayTable {
    x: Image<f32>,
    y: Image<f32>,
    report: UndistortReport,
}

/// How well the distortion could be removed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UndistortReport {
    /// Pixels whose ray is not known: they give no points. A calibration with more than a few is not fit for use.
    pub pixels_without_ray: u32,
    /// Of the other pixels the farthest from its place when distorted again, px.
    pub worst_residual_px: f64,
    /// The most rounds of Newton's method one of them took.
    pub most_rounds: u32,
}

impl RayTable {
    /// The rays of a camera. Takes some 0.1 s with distortion: once per calibration, not per frame.
    ///
    /// # Errors
    /// [`IntrinsicsError`]: intrinsics that describe no camera.
    pub fn new(intrinsics: &Intrinsics) -> Result<Self, IntrinsicsError> {
        intrinsics.check()?;
        let mut report = UndistortReport::default();
        let (mut x, mut y) = (Image::filled(f32::NAN), Image::filled(f32::NAN));
        for (i, (x, y)) in x.pixels_mut().iter_mut().zip(y.pixels_mut()).enumerate() {
            let ray = intrinsics.ray((i % WIDTH) as f64, (i / WIDTH) as f64);
            if !ray.converged {
                report.pixels_without_ray += 1;
                continue;
            }
            (*x, *y) = (ray.x as f32, ray.y as f32);
            report.worst_residual_px = report.worst_residual_px.max(ray.residual_px);
            report.most_rounds = report.most_rounds.max(ray.rounds);
        }
        Ok(Self { x, y, report })
    }

    /// x/z by pixel; NaN = no ray.
    pub fn x(&self) -> &Image<f32> {
        &self.x
    }

    /// y/z by pixel; NaN = no ray.
    pub fn y(&self) -> &Image<f32> {
        &self.y
    }

    /// How well the distortion could be removed.
    pub fn report(&self) -> UndistortReport {
        self.report
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_of_the_factory_camera_by_hand() {
        let rays = RayTable::new(&Intrinsics::default()).expect("a camera");
        // Column 320, row 240 is the axis; column 0 is −320/575.8 = −0.555 748; row 479 is 239/575.8 = 0.415 075.
        assert_eq!((rays.x().at(320, 240), rays.y().at(320, 240)), (Some(0.0), Some(0.0)));
        assert!((rays.x().at(0, 100).unwrap() + 0.555_748).abs() < 1e-6);
        assert!((rays.y().at(100, 479).unwrap() - 0.415_075).abs() < 1e-6);
        assert_eq!(rays.report(), UndistortReport::default());
    }

    #[test]
    fn pixels_no_ray_reaches_are_reported_and_have_none() {
        // x' = x (1 − r²) never exceeds 2/(3√3) = 0.3849: pixels farther than 0.3849 · 575.8 = 221.6 px from the
        // centre are seen by no ray. Pixels within that circle: π · 221.6² = 154 273, less nothing (240 > 221.6).
        let rays = RayTable::new(&Intrinsics { k1: -1.0, ..Intrinsics::default() }).expect("a camera");
        let without = f64::from(rays.report().pixels_without_ray);
        assert!((without - (307_200.0 - 154_273.0)).abs() < 500.0, "{without} pixels without a ray");
        assert!(rays.x().at(0, 0).is_some_and(f32::is_nan) && rays.y().at(0, 0).is_some_and(f32::is_nan));
        assert!(rays.x().at(320, 100).is_some_and(f32::is_finite));
    }

    #[test]
    fn a_strong_calibration_is_inverted_to_the_last_pixel() {
        let report = RayTable::new(&Intrinsics::INFRARED).expect("a camera").report();
        assert_eq!(report.pixels_without_ray, 0);
        assert!(report.worst_residual_px <= 1e-9 && (1..=10).contains(&report.most_rounds), "{report:?}");
    }
}
