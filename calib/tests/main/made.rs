//! Made views: a depth camera and a LiDAR that look at a board or a sphere, and at a wall behind it.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use tumbled_calib::{CameraView, LidarPoint, View};

/// Half of a Kinect's picture.
const WIDTH: usize = 320;
const HEIGHT: usize = 240;
const FOCAL: f64 = 288.0;

/// What is looked at, in the camera's frame.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Thing {
    /// A rectangle: its middle, its attitude (z its normal), its sides, m.
    Board(Isometry3<f64>, [f64; 2]),
    /// A sphere: its middle, its radius, m.
    Sphere(Point3<f64>, f64),
}

/// How well it is seen.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Making {
    pub(crate) seed: u64,
    /// Of a LiDAR's range, m.
    pub(crate) lidar_sigma_m: f64,
    /// Of a depth of 1 m, m; it grows with its square.
    pub(crate) camera_sigma: f64,
    /// Measured depth over true depth.
    pub(crate) depth_scale: f64,
    /// Share of points that lie anywhere within 0.3 m of where they should.
    pub(crate) outliers: f64,
}

impl Default for Making {
    fn default() -> Self {
        // The mean of some frames.
        Self { seed: 1, lidar_sigma_m: 0.02, camera_sigma: 5e-4, depth_scale: 1.0, outliers: 0.0 }
    }
}

struct Noise(ChaCha8Rng);

impl Noise {
    fn uniform(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Sum of twelve: normal enough.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// Range along a ray, from a place, both in the camera's frame; what stands 3.5 m before the camera is the wall.
fn range(thing: &Thing, from: &Point3<f64>, ray: &Vector3<f64>) -> Option<f64> {
    let target = match thing {
        Thing::Board(pose, [long, short]) => {
            let (origin, way) = (pose.inverse() * from, pose.rotation.inverse() * ray);
            let range = -origin.z / way.z;
            let hit = origin + way * range;
            (range > 0.0 && hit.x.abs() < 0.5 * long && hit.y.abs() < 0.5 * short).then_some(range)
        }
        Thing::Sphere(centre, radius) => {
            let toward = centre - from;
            let along = toward.dot(ray);
            let inside = radius * radius - toward.norm_squared() + along * along;
            (inside > 0.0 && along > 0.0).then(|| along - inside.sqrt())
        }
    };
    let wall = (3.5 - from.z) / ray.z;
    target.or((ray.z > 0.0 && wall > 0.0).then_some(wall))
}

/// The place of the camera in the LiDAR's frame: beside it and looking along its x.
pub(crate) fn truth() -> Isometry3<f64> {
    let optical = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(0.5, -0.5, 0.5, -0.5));
    let off = UnitQuaternion::from_scaled_axis(Vector3::new(0.02, -0.03, 0.015));
    Isometry3::from_parts(Translation3::new(0.03, 0.28, -0.05), off * optical)
}

/// What a drawing says of it.
pub(crate) fn drawing() -> Isometry3<f64> {
    let optical = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(0.5, -0.5, 0.5, -0.5));
    Isometry3::from_parts(Translation3::new(0.0, 0.3, 0.0), optical)
}

pub(crate) fn views(things: &[Thing], making: &Making) -> Vec<View> {
    let mut noise = Noise(ChaCha8Rng::seed_from_u64(making.seed));
    things.iter().map(|thing| view(thing, making, &mut noise)).collect()
}

fn view(thing: &Thing, making: &Making, noise: &mut Noise) -> View {
    let mut camera = CameraView { width: WIDTH, height: HEIGHT, points: Vec::new() };
    for row in 0..HEIGHT {
        for column in 0..WIDTH {
            let way = Vector3::new((column as f64 - 160.0) / FOCAL, (row as f64 - 120.0) / FOCAL, 1.0);
            let stretch = way.norm();
            let point = range(thing, &Point3::origin(), &(way / stretch)).map(|range| {
                let z = range / stretch;
                let mut z = z * making.depth_scale + making.camera_sigma * z * z * noise.normal();
                if noise.uniform() < making.outliers {
                    z += 0.6 * noise.uniform() - 0.3;
                }
                way * z
            });
            camera.points.push(point.map_or([f32::NAN; 3], |p| [p.x as f32, p.y as f32, p.z as f32]));
        }
    }
    let t_camera_lidar = truth().inverse();
    let mut lidar = Vec::new();
    for ring in 0..24_u8 {
        for step in 0..600 {
            let (elevation, azimuth) = ((f64::from(ring) - 12.0) * 0.012, (f64::from(step) - 300.0) * 0.0035 / 1.5);
            let ray = Vector3::new(
                libm::cos(elevation) * libm::cos(azimuth),
                libm::cos(elevation) * libm::sin(azimuth),
                libm::sin(elevation),
            );
            let from = t_camera_lidar * Point3::origin();
            let Some(range) = range(thing, &from, &(t_camera_lidar.rotation * ray)) else { continue };
            let mut range = range + making.lidar_sigma_m * noise.normal();
            if noise.uniform() < making.outliers {
                range += 0.6 * noise.uniform() - 0.3;
            }
            let p = ray * range;
            lidar.push(LidarPoint { xyz: [p.x as f32, p.y as f32, p.z as f32], ring });
        }
    }
    View { camera, lidar }
}

/// Boards of 0.8 x 0.6 m, 1.3 to 2.6 m away, leaning to `tilt_deg` about both axes.
pub(crate) fn boards(count: usize, tilt_deg: f64) -> Vec<Thing> {
    let leans = [(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (0.7, 0.7), (-0.7, 0.7), (0.7, -0.7)];
    let board = |n: usize| {
        let (a, b) = leans[n % leans.len()];
        let tilt = tilt_deg.to_radians() * if n < leans.len() { 1.0 } else { 0.8 };
        let z = 1.3 + 1.3 * (n as f64 * 0.618).fract();
        let aside = 0.25 * z;
        let (x, y) = (aside * ((n as f64 * 0.38).fract() - 0.5), 0.6 * aside * ((n as f64 * 0.73).fract() - 0.5));
        let attitude = UnitQuaternion::from_scaled_axis(Vector3::new(a * tilt, b * tilt, 0.1));
        Thing::Board(Isometry3::from_parts(Translation3::new(x, y, z), attitude), [0.8, 0.6])
    };
    (0..count).map(board).collect()
}
