//! What the sensors saw besides points: depth images and range images with their misses.

use tumbled_core::register::{DepthView, RangeView};
use tumbled_kinect::{DepthImage, HEIGHT, Intrinsics, WIDTH};
use tumbled_velodyne::Points;
use tumbled_velodyne::models::ModelSpec;

/// The azimuths that a turn's range image spans, to either side of straight ahead, degrees.
pub const HALF_SPAN_DEG: f64 = 30.0;

/// A depth image as registration takes it: of a camera without distortion.
pub fn depth_view(depth: &DepthImage, camera: &Intrinsics) -> DepthView {
    DepthView {
        width: WIDTH,
        height: HEIGHT,
        focal_px: [camera.fx as f32, camera.fy as f32],
        center_px: [camera.cx as f32, camera.cy as f32],
        z_m: depth.pixels().to_vec(),
    }
}

/// The range image of a crossing in which every firing between the span's ends was recorded: what has no point is a miss.
/// `step_deg` from firing to firing, `range_m` to the target: beams do not leave at one height, so their elevations as
/// seen from the origin depend on it.
pub fn range_view(points: &Points, spec: &ModelSpec, has_heights: bool, step_deg: f64, range_m: f64) -> RangeView {
    let mut elevations: Vec<f64> = spec.elevation_deg.iter().map(|degrees| degrees.to_radians()).collect();
    elevations.sort_by(f64::total_cmp);
    let height = |elevation: f64| if has_heights { -1e-3 * spec.focal_mm * elevation.tan() } else { 0.0 };
    let seen = |elevation: &f64| (elevation + height(*elevation) * elevation.cos() / range_m) as f32;
    let (first, step) = (-HALF_SPAN_DEG.to_radians(), step_deg.to_radians());
    let columns = (2.0 * HALF_SPAN_DEG / step_deg).floor() as usize;
    let mut range = vec![f32::INFINITY; elevations.len() * columns];
    for point in points.iter_range(0..points.len()) {
        let [x, y, z] = point.xyz;
        let column = ((f64::from(y.atan2(x)) - first) / step).round();
        if (0.0..columns as f64).contains(&column) {
            let cell = usize::from(point.ring) * columns + column as usize;
            if let Some(nearest) = range.get_mut(cell) {
                *nearest = nearest.min((x * x + y * y + z * z).sqrt());
            }
        }
    }
    RangeView {
        elevations_rad: elevations.iter().map(seen).collect(),
        first_azimuth_rad: first as f32,
        azimuth_step_rad: step as f32,
        range_m: range,
    }
}
