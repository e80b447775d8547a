//! What the two sensors saw of one pose in which nothing moved.

use nalgebra::{Point3, Vector3};

/// A depth camera's view: its mean over the frames of the pose, by pixel.
#[derive(Clone, Debug, Default)]
pub struct CameraView {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Points in the camera's frame, row by row, m; not finite where there is none.
    pub points: Vec<[f32; 3]>,
}

impl CameraView {
    /// The point of a pixel; `None`: there is none.
    pub fn point(&self, column: usize, row: usize) -> Option<Point3<f64>> {
        if column >= self.width {
            return None;
        }
        let [x, y, z] = *self.points.get(row * self.width + column)?;
        (z.is_finite() && z > 0.0).then(|| Point3::new(f64::from(x), f64::from(y), f64::from(z)))
    }
}

/// A LiDAR's point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LidarPoint {
    /// In the LiDAR's frame, m.
    pub xyz: [f32; 3],
    /// Which beam, from the lowest.
    pub ring: u8,
}

impl LidarPoint {
    /// Where it is.
    pub fn point(&self) -> Point3<f64> {
        Point3::from(self.xyz.map(f64::from))
    }
}

/// One pose.
#[derive(Clone, Debug, Default)]
pub struct View {
    /// What the camera saw.
    pub camera: CameraView,
    /// What the LiDAR saw in all turns of the pose.
    pub lidar: Vec<LidarPoint>,
}

/// A measured point with the noise of its range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ranged {
    /// In its sensor's frame, m.
    pub point: Point3<f64>,
    /// One standard deviation along the ray, m, before the scale that the residuals tell.
    pub sigma_m: f64,
}

impl Ranged {
    /// The ray to it, length 1.
    pub fn ray(&self) -> Vector3<f64> {
        self.point.coords / self.point.coords.norm().max(f64::MIN_POSITIVE)
    }

    /// A Kinect's: σ grows with the square of the depth (1.5e-3 z², widely published), here along the ray.
    pub fn of_camera(point: Point3<f64>) -> Self {
        let stretch = point.coords.norm() / point.z.max(0.1);
        Self { point, sigma_m: camera_sigma_m(point.z) * stretch }
    }

    /// A LiDAR's.
    pub fn of_lidar(point: Point3<f64>) -> Self {
        Self { point, sigma_m: LIDAR_SIGMA_M }
    }
}

/// One standard deviation of a LiDAR's range, m: data sheets say ±30 mm typical.
pub const LIDAR_SIGMA_M: f64 = 0.020;

/// One standard deviation of a Kinect's depth at a depth, m.
pub fn camera_sigma_m(z_m: f64) -> f64 {
    1.5e-3 * z_m * z_m
}
