//! A cloud that is to be registered: points, where they were seen from, and what was seen besides points.

use nalgebra::Point3;

/// What made a cloud: how its noise grows, and which way its points lie dense.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorKind {
    /// Few accurate points on rings.
    Lidar,
    /// Many points on a grid, noise growing with the range's square.
    Kinect,
}

/// Points as one sensor saw them.
#[derive(Clone, Debug)]
pub struct Cloud {
    /// What made it.
    pub sensor: SensorKind,
    /// The points, m, in the frame the viewpoint is in.
    pub points: Vec<Point3<f32>>,
    /// Where the sensor stood. `None`: nobody knows (a fused or moved cloud); then its lines of sight say nothing.
    pub viewpoint: Option<Point3<f32>>,
    /// What the sensor saw besides these points.
    pub view: View,
}

/// What a sensor saw, the rays without a return included. Its own frame: the viewpoint is its origin, its axes are the
/// points'.
#[derive(Clone, Debug, Default)]
pub enum View {
    /// Nothing but the points: free space is inferred from them (method.md §3.4b).
    #[default]
    Bare,
    /// A depth image: x right, y down, z forward.
    Depth(DepthView),
    /// A turn of rings: x forward, y left, z up.
    Ranges(RangeView),
}

/// A depth image with its misses.
#[derive(Clone, Debug)]
pub struct DepthView {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Focal lengths x, y, px.
    pub focal_px: [f32; 2],
    /// Principal point x, y, px; pixel centres at integers.
    pub center_px: [f32; 2],
    /// Depth along z, m, row by row; 0: no return.
    pub z_m: Vec<f32>,
}

/// A LiDAR's range image with its misses.
#[derive(Clone, Debug)]
pub struct RangeView {
    /// Elevation of each ring, rad, rising.
    pub elevations_rad: Vec<f32>,
    /// Azimuth of the first column, counter-clockwise from above, rad.
    pub first_azimuth_rad: f32,
    /// From column to column, rad, above 0.
    pub azimuth_step_rad: f32,
    /// Range, m, ring by ring; infinite: fired, and nothing came back; NaN: not fired, or not known.
    pub range_m: Vec<f32>,
}
