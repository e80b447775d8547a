//! Depth images to points.

use crate::frame::{FIRST_INVALID_MM, PIXELS, WIDTH};
use crate::image::DepthImage;
use crate::intrinsics::{Intrinsics, IntrinsicsError};
use crate::noise::NoiseModel;
use crate::rays::RayTable;
use crate::warp::DepthWarp;

/// Points in the Kinect's frame (x right, y down, z forward, metres), a column per quantity, in the order of their pixels.
///
/// Made once and reused: it has room for every pixel from the start.
#[derive(Clone, Debug)]
pub struct Points {
    len: usize,
    x: Box<[f32]>,
    y: Box<[f32]>,
    z: Box<[f32]>,
    sigma_z: Box<[f32]>,
    pixel: Box<[u32]>,
}

impl Default for Points {
    fn default() -> Self {
        Self::new()
    }
}

impl Points {
    /// No points, and room for a frame's.
    pub fn new() -> Self {
        let column = || vec![0.0; PIXELS].into_boxed_slice();
        Self {
            len: 0,
            x: column(),
            y: column(),
            z: column(),
            sigma_z: column(),
            pixel: vec![0; PIXELS].into_boxed_slice(),
        }
    }

    /// How many points, 0..=307 200.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// To the right, m.
    pub fn x(&self) -> &[f32] {
        self.x.get(..self.len).unwrap_or_default()
    }

    /// Down, m.
    pub fn y(&self) -> &[f32] {
        self.y.get(..self.len).unwrap_or_default()
    }

    /// Forward, m; between 0 and 10.
    pub fn z(&self) -> &[f32] {
        self.z.get(..self.len).unwrap_or_default()
    }

    /// Standard deviation of z, m ([`NoiseModel`]). Across the ray it is `lateral_px · z / f`, a multiple of z and not stored.
    pub fn sigma_z(&self) -> &[f32] {
        self.sigma_z.get(..self.len).unwrap_or_default()
    }

    /// Appends the points of a run of pixels that all have one, their depths changed by `correct`, which gets the run's first
    /// pixel; what there is no room for is left out.
    fn append(
        &mut self,
        first_pixel: usize,
        (z, ray_x, ray_y): (&[f32], &[f32], &[f32]),
        noise: &[f32; NOISE_STEPS],
        correct: impl FnOnce(usize, &mut [f32]),
    ) {
        let room = self.len..self.len + z.len();
        let columns = (
            self.x.get_mut(room.clone()),
            self.y.get_mut(room.clone()),
            self.z.get_mut(room.clone()),
            self.sigma_z.get_mut(room.clone()),
            self.pixel.get_mut(room.clone()),
        );
        let (Some(to_x), Some(to_y), Some(to_z), Some(to_sigma), Some(to_pixel)) = columns else { return };
        to_z.copy_from_slice(z);
        correct(first_pixel, to_z);
        let z = &*to_z;
        to_x.iter_mut().zip(z.iter().zip(ray_x)).for_each(|(to, (z, ray))| *to = ray * z);
        to_y.iter_mut().zip(z.iter().zip(ray_y)).for_each(|(to, (z, ray))| *to = ray * z);
        for (to, &z) in to_sigma.iter_mut().zip(z) {
            // Below 10 m the centimetre is below 1000. By way of i32, which takes one instruction; never negative here.
            let centimetre = (z * STEPS_PER_METRE) as i32 as usize;
            *to = noise.get(centimetre.min(NOISE_STEPS - 1)).copied().unwrap_or_default() * z * z;
        }
        to_pixel.iter_mut().zip(first_pixel as u32..).for_each(|(to, pixel)| *to = pixel);
        self.len = room.end;
    }

    /// The pixel it was seen in: row × 640 + column. Ascending.
    pub fn pixel(&self) -> &[u32] {
        self.pixel.get(..self.len).unwrap_or_default()
    }
}

/// Steps of the table of σ_z / z²: a centimetre of depth each.
const STEPS_PER_METRE: f32 = 100.0;
const NOISE_STEPS: usize = 1_024;
/// Between these a corrected depth is kept, m: a millimetre from the ends of what is a depth.
const LEAST_M: f32 = 0.001;
const MOST_M: f32 = 9.999;

/// A camera's rays and noise, ready to turn its depth images into points.
#[derive(Clone, Debug)]
pub struct BackProjector {
    rays: RayTable,
    /// σ_z / z² (1/m) by centimetre of depth. Between two centimetres it changes by less than 0.2 %.
    noise: Box<[f32; NOISE_STEPS]>,
    /// What is added to the depths by pixel, and the power of the depth it is multiplied by.
    warp: Option<(Box<[f32]>, u8)>,
}

impl BackProjector {
    /// From a camera's intrinsics and noise. Computes both tables: once per calibration, not per frame.
    ///
    /// # Errors
    /// [`IntrinsicsError`]: intrinsics that describe no camera.
    pub fn new(intrinsics: &Intrinsics, noise: &NoiseModel) -> Result<Self, IntrinsicsError> {
        let rays = RayTable::new(intrinsics)?;
        let mut by_centimetre = Box::new([0.0; NOISE_STEPS]);
        for (i, sigma) in by_centimetre.iter_mut().enumerate() {
            let metres = (i as f64 + 0.5) / f64::from(STEPS_PER_METRE); // the middle of the centimetre
            *sigma = (noise.disparity_steps(metres) * noise.step_per_metre) as f32;
        }
        Ok(Self { rays, noise: by_centimetre, warp: None })
    }

    /// With a calibrated surface added to every depth. Computes a table: once per calibration, not per frame.
    #[must_use]
    pub fn warped(self, warp: &DepthWarp) -> Self {
        let surface = (0..PIXELS).map(|i| warp.at((i % WIDTH) as f64, (i / WIDTH) as f64) as f32).collect();
        Self { warp: Some((surface, warp.power)), ..self }
    }

    /// Takes the camera's warp out of the depths of a run of pixels.
    fn unwarp(&self, first_pixel: usize, z: &mut [f32]) {
        let Some((surface, power)) = &self.warp else { return };
        for (z, add) in z.iter_mut().zip(surface.get(first_pixel..).unwrap_or_default()) {
            let size = if *power == 2 { *z * *z } else { 1.0 };
            // A depth stays one, whatever the surface says at the ends of the range.
            *z = (*z + size * add).clamp(LEAST_M, MOST_M);
        }
    }

    /// The camera's rays, and how well its distortion could be removed.
    pub fn rays(&self) -> &RayTable {
        &self.rays
    }

    /// The points of a depth image, in the order of its pixels. Pixels without data and pixels without a ray give none.
    pub fn points(&self, depth: &DepthImage, out: &mut Points) {
        let (depth, ray_x, ray_y) = (depth.pixels(), self.rays.x().pixels(), self.rays.y().pixels());
        let mut pixels = depth.iter().zip(ray_x).map(|(&z, ray_x)| is_depth(z) && !ray_x.is_nan());
        out.len = 0;
        let mut end = 0;
        // Depth comes in long runs. A run is appended column by column, which goes several points at a time.
        while let Some(skipped) = pixels.position(|is_point| is_point) {
            let start = end + skipped;
            let more = pixels.position(|is_point| !is_point).unwrap_or(PIXELS - start - 1);
            end = start + 1 + more;
            let run = (depth.get(start..end), ray_x.get(start..end), ray_y.get(start..end));
            if let (Some(z), Some(ray_x), Some(ray_y)) = run {
                out.append(start, (z, ray_x, ray_y), &self.noise, |first, z| self.unwarp(first, z));
            }
            end += 1; // the pixel that ended the run is behind the iterator too
        }
    }
}

/// Whether a number is a depth: more than 0 and below 10 m. NaN is not.
fn is_depth(z: f32) -> bool {
    const FAR: f32 = FIRST_INVALID_MM as f32 / 1_000.0;
    z > 0.0 && z < FAR
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::sync::LazyLock;

    #[test]
    fn a_calibrated_surface_moves_points_along_their_rays() {
        let mut factors = [0.0; crate::warp::WARP_TERMS];
        (factors[0], factors[1]) = (0.004, 0.010);
        let mut depth = DepthImage::new();
        depth.pixels_mut()[240 * 640 + 480] = 2.0;
        depth.pixels_mut()[240 * 640 + 481] = 0.0005;
        for (power, size) in [(0, 1.0), (2, 4.0)] {
            let mut points = Points::new();
            factory().warped(&DepthWarp { power, factors }).points(&depth, &mut points);
            // x = 1/2 there: 4 mm and half of 10 mm, at a power of 2 four times that.
            let z = 2.0 + size * 0.009;
            assert!((f64::from(points.z()[0]) - z).abs() < 1e-6, "{}", points.z()[0]);
            assert!((f64::from(points.x()[0]) - 160.0 / 575.8 * z).abs() < 1e-6);
            assert!(points.len() == 2 && points.z()[1] >= 0.001);
        }
    }

    fn factory() -> BackProjector {
        BackProjector::new(&Intrinsics::default(), &NoiseModel::default()).expect("a camera")
    }

    #[test]
    fn a_point_by_hand() {
        let mut depth = DepthImage::new();
        depth.pixels_mut()[100 * 640 + 500] = 2.0;
        let mut points = Points::new();
        factory().points(&depth, &mut points);
        // x = (500 − 320) / 575.8 · 2 = 0.625217, y = (100 − 240) / 575.8 · 2 = −0.486280.
        assert_eq!((points.len(), points.pixel(), points.z()), (1, [64_500].as_slice(), [2.0].as_slice()));
        assert!((points.x()[0] - 0.625_217).abs() < 1e-6 && (points.y()[0] + 0.486_280).abs() < 1e-6);
    }

    #[test]
    fn only_depths_become_points() {
        let mut depth = DepthImage::filled(1.0);
        let not_depths = [0.0, -1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 10.0, 1e30];
        depth.pixels_mut()[..7].copy_from_slice(&not_depths);
        let mut points = Points::new();
        factory().points(&depth, &mut points);
        assert_eq!(points.len(), 307_200 - 7);
        assert_eq!(points.pixel()[0], 7);
    }

    #[test]
    fn a_frame_leaves_nothing_of_the_one_before() {
        let (projector, mut points) = (factory(), Points::new());
        projector.points(&DepthImage::filled(1.0), &mut points);
        projector.points(&DepthImage::new(), &mut points);
        assert!(points.is_empty());
        assert!(points.x().is_empty() && points.sigma_z().is_empty() && points.pixel().is_empty());
    }

    #[test]
    fn noise_of_a_point_is_the_models() {
        let depth = DepthImage::from_fn(|u, v| 0.4 + (v * 640 + u) as f32 * (9.5 / 307_200.0)); // 0.4 to 9.9 m
        let mut points = Points::new();
        factory().points(&depth, &mut points);
        for (&z, &sigma) in points.z().iter().zip(points.sigma_z()) {
            let model = NoiseModel::default().sigma_z(f64::from(z)) as f32;
            // The table's centimetres: at most 0.0005 steps of 0.445 off, 0.1 %.
            assert!((sigma / model - 1.0).abs() < 0.002, "{sigma} m, model {model} m at {z} m");
        }
    }

    #[test]
    fn pixels_without_a_ray_give_no_points() {
        // x' = x (1 − r²) folds at 221.6 px from the centre (see rays): the corner is seen by no ray.
        let folded = Intrinsics { k1: -1.0, ..Intrinsics::default() };
        let projector = BackProjector::new(&folded, &NoiseModel::default()).expect("a camera");
        let mut points = Points::new();
        projector.points(&DepthImage::filled(1.0), &mut points);
        assert_eq!(points.len(), 307_200 - projector.rays().report().pixels_without_ray as usize);
        assert!(points.x().iter().all(|x| x.is_finite()) && points.pixel()[0] > 0);
    }

    #[test]
    fn a_point_is_seen_where_it_came_from() {
        let camera = Intrinsics { k1: -0.1, k2: 0.05, p1: 0.001, p2: -0.002, ..Intrinsics::default() };
        let projector = BackProjector::new(&camera, &NoiseModel::default()).expect("a camera");
        let mut points = Points::new();
        projector.points(&DepthImage::from_fn(|u, v| 0.5 + ((u * v) % 997) as f32 * 0.005), &mut points);
        assert_eq!(points.len(), 307_200);
        for i in (0..points.len()).step_by(101) {
            let [x, y, z] = [points.x()[i], points.y()[i], points.z()[i]].map(f64::from);
            let (u, v) = camera.pixel(x / z, y / z);
            let pixel = points.pixel()[i];
            // f32 rays: 6e-8 of 0.56 of 576 px is 2e-5 px; twice that for the product and the quotient.
            assert!((u - f64::from(pixel % 640)).abs() < 1e-4 && (v - f64::from(pixel / 640)).abs() < 1e-4);
        }
    }

    static FACTORY: LazyLock<BackProjector> = LazyLock::new(factory);

    proptest! {
        #[test]
        fn runs_of_any_length_give_each_pixel_its_point(
            pattern in proptest::collection::vec(prop_oneof![Just(0.0f32), 0.3f32..9.9], 1..200)
        ) {
            let depth = DepthImage::from_fn(|u, v| pattern[(v * 640 + u) % pattern.len()]);
            let mut points = Points::new();
            let projector = &*FACTORY;
            projector.points(&depth, &mut points);
            let with_depth = depth.pixels().iter().enumerate().filter(|(_, z)| **z > 0.0);
            prop_assert_eq!(points.len(), with_depth.clone().count());
            for ((pixel, &z), i) in with_depth.zip(0..) {
                prop_assert_eq!((points.pixel()[i] as usize, points.z()[i]), (pixel, z));
                prop_assert_eq!(points.x()[i], projector.rays().x().pixels()[pixel] * z);
                prop_assert_eq!(points.y()[i], projector.rays().y().pixels()[pixel] * z);
            }
        }
    }
}
