//! The config's Kinect as the calibration of its lens and depths needs it: the decoder's own geometry.

use tumbled_calib::depth_camera::{Camera, Lens, SURFACE_TERMS};
use tumbled_kinect::{DepthWarp, HEIGHT, Intrinsics, WIDTH};

use crate::decoding::kinect::intrinsics;

/// A Kinect with the config's lens.
#[derive(Clone, Copy, Debug)]
pub struct KinectCamera(Intrinsics);

impl KinectCamera {
    /// A camera.
    pub fn new(said: Intrinsics) -> Self {
        Self(said)
    }

    /// The config's.
    pub fn of(kinect: &crate::config::KinectConfig) -> Self {
        Self(intrinsics(kinect))
    }

    /// The lens it is said to have, whole.
    pub fn said(&self) -> Intrinsics {
        self.0
    }

    /// The decoder's intrinsics with a lens that was found; what no lens has stays.
    pub fn with(&self, lens: &Lens) -> Intrinsics {
        let Lens { fx, fy, cx, cy, k1, k2 } = *lens;
        Intrinsics { fx, fy, cx, cy, k1, k2, ..self.0 }
    }
}

impl Camera for KinectCamera {
    fn size(&self) -> [f64; 2] {
        [WIDTH as f64, HEIGHT as f64]
    }

    fn lens(&self) -> Lens {
        let Intrinsics { fx, fy, cx, cy, k1, k2, .. } = self.0;
        Lens { fx, fy, cx, cy, k1, k2 }
    }

    fn ray(&self, lens: &Lens, u: f64, v: f64) -> Option<[f64; 2]> {
        let ray = self.with(lens).ray(u, v);
        ray.converged.then_some([ray.x, ray.y])
    }

    fn pixel(&self, x: f64, y: f64) -> [f64; 2] {
        let (u, v) = self.0.pixel(x, y);
        [u, v]
    }

    fn terms(&self, u: f64, v: f64) -> [f64; SURFACE_TERMS] {
        DepthWarp::terms_at(u, v)
    }
}
