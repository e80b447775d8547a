//! Boxes seen by a pinhole camera and by rings: what the sensors of these tests see is known exactly.

use crate::register::cloud::{Cloud, DepthView, RangeView, SensorKind, View};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Elevations of a VLP-32C, degrees, rising.
const ELEVATIONS: [f32; 32] = [
    -25.0, -15.639, -11.31, -8.843, -7.254, -6.148, -5.333, -4.667, -4.0, -3.667, -3.333, -3.0, -2.667, -2.333, -2.0,
    -1.667, -1.333, -1.0, -0.667, -0.333, 0.0, 0.333, 0.667, 1.0, 1.333, 1.667, 2.333, 3.333, 4.667, 7.0, 10.333, 15.0,
];
/// Of the camera.
pub(crate) const FOCAL_PX: f32 = 590.0;
const WIDTH: usize = 640;
const HEIGHT: usize = 480;

/// A box: its place in the body, and half its edges, m.
pub(crate) struct Block {
    pub(crate) place: Isometry3<f64>,
    pub(crate) half: Vector3<f64>,
}

/// A body of boxes.
pub(crate) struct Body(pub(crate) Vec<Block>);

impl Body {
    /// A satellite: a bus, two panels of different size and tilt, a payload beside.
    pub(crate) fn satellite() -> Self {
        let block = |at: [f64; 3], half: [f64; 3], tilt: f64| Block {
            place: Isometry3::from_parts(
                Translation3::from(Vector3::from(at)),
                UnitQuaternion::from_axis_angle(&Vector3::y_axis(), tilt),
            ),
            half: Vector3::from(half),
        };
        Self(vec![
            block([0.0, 0.0, 0.0], [0.20, 0.225, 0.25], 0.0),
            block([0.0, 0.53, 0.0], [0.18, 0.225, 0.0075], 0.21),
            block([0.0, -0.475, 0.02], [0.15, 0.17, 0.0075], -0.35),
            block([-0.10, 0.12, 0.30], [0.06, 0.05, 0.05], 0.0),
        ])
    }

    /// One plate across the x axis of its frame, 1 cm thick, with its front at x = 0, and half its edges along y and z.
    pub(crate) fn plate(y: f64, z: f64) -> Self {
        let place = Isometry3::translation(0.005, 0.0, 0.0);
        Self(vec![Block { place, half: Vector3::new(0.005, y, z) }])
    }

    /// How far along a unit ray the first surface is, in the body's frame.
    fn hit(&self, from: &Point3<f64>, along: &Vector3<f64>) -> Option<f64> {
        let hits = self.0.iter().filter_map(|block| {
            let (from, along) = (block.place.inverse() * from, block.place.rotation.inverse() * along);
            let (mut near, mut far) = (0.0f64, f64::INFINITY);
            for axis in 0..3 {
                let (a, b) =
                    ((-block.half[axis] - from[axis]) / along[axis], (block.half[axis] - from[axis]) / along[axis]);
                near = near.max(a.min(b));
                far = far.min(a.max(b));
            }
            (near < far && near > 0.0).then_some(near)
        });
        hits.min_by(f64::total_cmp)
    }
}

/// A random number source for noise.
pub(crate) struct Chance(ChaCha8Rng);

impl Chance {
    pub(crate) fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// 0..1.
    pub(crate) fn uniform(&mut self) -> f64 {
        f64::from(self.0.next_u32()) / 4_294_967_296.0
    }

    /// Of standard normal distribution, nearly: twelve uniform ones.
    pub(crate) fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }

    pub(crate) fn direction(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal()).normalize()
    }
}

/// The camera's depth image of a body, with a Kinect's noise times `noise`.
pub(crate) fn depth_image(body: &Body, t_camera_body: &Isometry3<f64>, noise: f64, chance: &mut Chance) -> DepthView {
    let t_body_camera = t_camera_body.inverse();
    let eye = t_body_camera * Point3::origin();
    let center = [(WIDTH as f32 - 1.0) / 2.0, (HEIGHT as f32 - 1.0) / 2.0];
    let mut z_m = vec![0.0f32; WIDTH * HEIGHT];
    for (pixel, z) in z_m.iter_mut().enumerate() {
        let (u, v) = ((pixel % WIDTH) as f32, (pixel / WIDTH) as f32);
        let ray = Vector3::new((u - center[0]) / FOCAL_PX, (v - center[1]) / FOCAL_PX, 1.0).cast::<f64>();
        let unit = ray.normalize();
        // Around the body there is nothing: most pixels need no boxes.
        let closest =
            (eye.coords - (t_body_camera.rotation * unit) * (t_body_camera.rotation * unit).dot(&eye.coords)).norm();
        if closest > 0.9 {
            continue;
        }
        if let Some(range) = body.hit(&eye, &(t_body_camera.rotation * unit)) {
            let depth = range / ray.norm();
            *z = (depth + noise * 1.425e-3 * depth * depth * chance.normal()) as f32;
        }
    }
    DepthView { width: WIDTH, height: HEIGHT, focal_px: [FOCAL_PX; 2], center_px: center, z_m }
}

/// Every `step`-th pixel each way as a cloud.
pub(crate) fn points_of(image: &DepthView, step: usize) -> Vec<Point3<f32>> {
    let pixels = (0..image.height).step_by(step).flat_map(|v| (0..image.width).step_by(step).map(move |u| (u, v)));
    pixels
        .filter_map(|(u, v)| {
            let z = image.z_m[v * image.width + u];
            let x = (u as f32 - image.center_px[0]) / image.focal_px[0] * z;
            let y = (v as f32 - image.center_px[1]) / image.focal_px[1] * z;
            (z > 0.0).then(|| Point3::new(x, y, z))
        })
        .collect()
}

/// The LiDAR's range image of a body: 60° of azimuth forward, 0.2° a step; with noise of 15 mm times `noise`, and 10 mm
/// a ring.
pub(crate) fn range_image(body: &Body, t_lidar_body: &Isometry3<f64>, noise: f64, chance: &mut Chance) -> RangeView {
    let t_body_lidar = t_lidar_body.inverse();
    let eye = t_body_lidar * Point3::origin();
    let elevations_rad: Vec<f32> = ELEVATIONS.iter().map(|e| e.to_radians()).collect();
    let (first_azimuth_rad, azimuth_step_rad) = ((-30f32).to_radians(), 0.2f32.to_radians());
    let mut range_m = Vec::new();
    for &elevation in &elevations_rad {
        let bias = 0.010 * noise * chance.normal();
        for column in 0..301 {
            let azimuth = first_azimuth_rad + column as f32 * azimuth_step_rad;
            let ray = t_body_lidar.rotation * direction(azimuth, elevation).cast::<f64>();
            let range = body.hit(&eye, &ray).map(|range| range + bias + 0.015 * noise * chance.normal());
            range_m.push(range.map_or(f32::INFINITY, |range| range as f32));
        }
    }
    RangeView { elevations_rad, first_azimuth_rad, azimuth_step_rad, range_m }
}

pub(crate) fn direction(azimuth: f32, elevation: f32) -> Vector3<f32> {
    let (cos_e, sin_e) = (libm::cosf(elevation), libm::sinf(elevation));
    Vector3::new(cos_e * libm::cosf(azimuth), cos_e * libm::sinf(azimuth), sin_e)
}

/// The returns as points.
pub(crate) fn returns_of(image: &RangeView) -> Vec<Point3<f32>> {
    let columns = image.range_m.len() / image.elevations_rad.len();
    let place = |(k, &range): (usize, &f32)| {
        let azimuth = image.first_azimuth_rad + (k % columns) as f32 * image.azimuth_step_rad;
        let elevation = image.elevations_rad[k / columns];
        range.is_finite().then(|| Point3::from(direction(azimuth, elevation) * range))
    };
    image.range_m.iter().enumerate().filter_map(place).collect()
}

/// A sensor `distance` before the body in a direction of it, rolled; the optical axis through the body's origin.
/// Camera axes: x right, y down, z forward.
pub(crate) fn camera_at(from: &Vector3<f64>, distance: f64, roll: f64) -> Isometry3<f64> {
    let z = -from.normalize();
    let up = if z.z.abs() < 0.95 { Vector3::z() } else { Vector3::x() };
    let x = z.cross(&up).normalize();
    let rows = Matrix3::from_rows(&[x.transpose(), z.cross(&x).transpose(), z.transpose()]);
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), roll) * Rotation3::from_matrix_unchecked(rows);
    Isometry3::from_parts(Translation3::new(0.0, 0.0, distance), UnitQuaternion::from_rotation_matrix(&turn))
}

/// The same with a LiDAR's axes: x forward, y left, z up.
pub(crate) fn lidar_at(from: &Vector3<f64>, distance: f64, roll: f64) -> Isometry3<f64> {
    let axes = Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    Isometry3::from_parts(Translation3::identity(), turn) * camera_at(from, distance, roll)
}

/// A random share of the points.
pub(crate) fn thinned(points: Vec<Point3<f32>>, count: usize, chance: &mut Chance) -> Vec<Point3<f32>> {
    let mut keyed: Vec<(f64, Point3<f32>)> = points.into_iter().map(|point| (chance.uniform(), point)).collect();
    keyed.sort_by(|a, b| a.0.total_cmp(&b.0));
    keyed.into_iter().take(count).map(|(_, point)| point).collect()
}

/// A body seen by both sensors.
pub(crate) struct Pair {
    /// A bare Kinect cloud of about 2 600 points at 2 m.
    pub(crate) dense: Cloud,
    /// The same with its image.
    pub(crate) dense_organised: Cloud,
    /// A bare LiDAR cloud of at most 358 points.
    pub(crate) sparse: Cloud,
    /// The same with its image.
    pub(crate) sparse_organised: Cloud,
    /// LiDAR to camera.
    pub(crate) truth: Isometry3<f64>,
}

/// The satellite from random places, the sights some degrees apart.
pub(crate) fn pair(seed: u64, apart_deg: f64, points: usize) -> Pair {
    let mut chance = Chance::new(seed);
    let body = Body::satellite();
    loop {
        let from = chance.direction();
        let axis = nalgebra::Unit::new_normalize(from.cross(&chance.direction()));
        let other = UnitQuaternion::from_axis_angle(&axis, apart_deg.to_radians()) * from;
        let camera = camera_at(&from, 1.8 + 0.8 * chance.uniform(), 6.3 * chance.uniform());
        let lidar = lidar_at(&other, 3.0 + 1.5 * chance.uniform(), 6.3 * chance.uniform());
        let image = depth_image(&body, &camera, 1.0, &mut chance);
        let ranges = range_image(&body, &lidar, 1.0, &mut chance);
        let (dense, sparse) = (points_of(&image, 6), returns_of(&ranges));
        if dense.len() < 900 || sparse.len() < points {
            continue;
        }
        let cloud = |sensor, points, view| Cloud { sensor, points, viewpoint: Some(Point3::origin()), view };
        let sparse = thinned(sparse, points, &mut chance);
        return Pair {
            dense: cloud(SensorKind::Kinect, dense.clone(), View::Bare),
            dense_organised: cloud(SensorKind::Kinect, dense, View::Depth(image)),
            sparse: cloud(SensorKind::Lidar, sparse.clone(), View::Bare),
            sparse_organised: cloud(SensorKind::Lidar, sparse, View::Ranges(ranges)),
            truth: camera * lidar.inverse(),
        };
    }
}
