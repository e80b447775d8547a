//! The infrared camera: which ray each pixel sees along.

use tumbled_kinect::{HEIGHT, Intrinsics, IntrinsicsError, PIXELS, WIDTH};

/// The camera as the rasteriser needs it. A pixel whose ray is not known (distortion fitted on the middle of the image
/// and folding at its border) sees nothing: its ray is NaN.
#[derive(Clone, Debug)]
pub(super) struct Optics {
    pub(super) fx: f64,
    pub(super) fy: f64,
    pub(super) cx: f64,
    pub(super) cy: f64,
    /// x/z and y/z by pixel, where the lens distorts.
    bent: Option<Box<[[f64; 2]]>>,
    /// How far a pixel lies from where a camera without distortion would see its ray, at most, px.
    pub(super) margin_px: f64,
    /// x/z and y/z of all rays: lower bounds, upper bounds.
    pub(super) bounds: [[f64; 2]; 2],
}

impl Optics {
    pub(super) fn new(camera: &Intrinsics) -> Result<Self, IntrinsicsError> {
        camera.check()?;
        let Intrinsics { fx, fy, cx, cy, .. } = *camera;
        let straight = [camera.k1, camera.k2, camera.k3, camera.p1, camera.p2].iter().all(|k| *k == 0.0);
        let mut optics = Self { fx, fy, cx, cy, bent: None, margin_px: 0.0, bounds: [[0.0; 2]; 2] };
        if !straight {
            optics.bend(camera);
        }
        // Half a pixel more than the outermost centres.
        let margin = optics.margin_px + 0.5;
        let (right, bottom) = (WIDTH as f64 - 1.0 + margin, HEIGHT as f64 - 1.0 + margin);
        optics.bounds = [[(-margin - cx) / fx, (-margin - cy) / fy], [(right - cx) / fx, (bottom - cy) / fy]];
        Ok(optics)
    }

    fn bend(&mut self, camera: &Intrinsics) {
        let mut rays = Vec::with_capacity(PIXELS);
        for v in 0..HEIGHT {
            for u in 0..WIDTH {
                let ray = camera.ray(u as f64, v as f64);
                if !ray.converged {
                    rays.push([f64::NAN; 2]);
                    continue;
                }
                let (du, dv) = (self.fx * ray.x + self.cx - u as f64, self.fy * ray.y + self.cy - v as f64);
                self.margin_px = self.margin_px.max(du.abs()).max(dv.abs());
                rays.push([ray.x, ray.y]);
            }
        }
        self.bent = Some(rays.into_boxed_slice());
    }

    /// The rays of a row with distortion; `None`: the camera has none.
    pub(super) fn bent_row(&self, v: usize) -> Option<&[[f64; 2]]> {
        self.bent.as_ref()?.get(v * WIDTH..(v + 1) * WIDTH)
    }

    /// x/z and y/z of a pixel's ray.
    pub(super) fn ray(&self, u: usize, v: usize) -> [f64; 2] {
        match &self.bent {
            None => [(u as f64 - self.cx) / self.fx, (v as f64 - self.cy) / self.fy],
            Some(rays) => rays.get(v * WIDTH + u).copied().unwrap_or([f64::NAN; 2]),
        }
    }
}
