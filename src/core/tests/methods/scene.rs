//! A body of boxes, seen by a camera and by a LiDAR: ray by ray, with noise by seed.

use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use tumbled_core::register::{Cloud, Prior, Registration, SensorKind, View};
use tumbled_model::se3::{angle_between, exp_rotation};

/// Draws by seed.
pub(crate) struct Chance(ChaCha8Rng);

impl Chance {
    pub(crate) fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// 0..1.
    pub(crate) fn share(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Of variance 1: twelve uniforms less their mean.
    pub(crate) fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.share()).sum::<f64>() - 6.0
    }

    pub(crate) fn direction(&mut self) -> Vector3<f64> {
        let z = 2.0 * self.share() - 1.0;
        let (sin, cos) = libm::sincos(core::f64::consts::TAU * self.share());
        let across = (1.0 - z * z).sqrt();
        Vector3::new(across * cos, across * sin, z)
    }
}

/// A box: its pose in the body's frame and its half edges, m.
struct Block {
    t_block_body: Isometry3<f64>,
    half: Vector3<f64>,
}

impl Block {
    fn new(at: [f64; 3], edges: [f64; 3], turn_deg: f64) -> Self {
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), turn_deg.to_radians());
        let pose = Isometry3::from_parts(Translation3::new(at[0], at[1], at[2]), rotation);
        Self { t_block_body: pose.inverse(), half: Vector3::from(edges) * 0.5 }
    }

    /// How far along the ray it is entered.
    fn hit(&self, origin: &Point3<f64>, way: &Vector3<f64>) -> Option<f64> {
        let (o, d) = (self.t_block_body * origin, self.t_block_body * way);
        let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
        for axis in 0..3 {
            let (a, b) = ((-self.half[axis] - o[axis]) / d[axis], (self.half[axis] - o[axis]) / d[axis]);
            (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
        }
        (enter < leave && enter > 0.0).then_some(enter)
    }
}

/// A satellite of 1.3 m: a body, two unequal panels, and things that break its symmetries.
fn satellite() -> Vec<Block> {
    vec![
        Block::new([0.0, 0.0, 0.0], [0.40, 0.45, 0.50], 0.0),
        Block::new([0.0, 0.53, 0.0], [0.36, 0.45, 0.015], 12.0),
        Block::new([0.0, -0.475, 0.02], [0.30, 0.34, 0.015], -20.0),
        Block::new([-0.10, 0.12, 0.30], [0.12, 0.10, 0.10], 0.0),
        Block::new([-0.23, -0.10, -0.12], [0.06, 0.14, 0.10], 0.0),
        Block::new([0.12, -0.12, 0.35], [0.03, 0.03, 0.20], 0.0),
    ]
}

fn cast(blocks: &[Block], origin: &Point3<f64>, way: &Vector3<f64>) -> Option<f64> {
    blocks.iter().filter_map(|block| block.hit(origin, way)).min_by(f64::total_cmp)
}

/// Two views of the satellite and the truth.
pub(crate) struct Pair {
    /// Dense, z forward.
    pub(crate) kinect: Cloud,
    /// Sparse, x forward.
    pub(crate) lidar: Cloud,
    pub(crate) t_lidar_kinect: Isometry3<f64>,
}

/// Looking along −`from` at the body's origin from `distance`: x right, y down, z forward.
fn looking(from: &Vector3<f64>, distance: f64, roll: f64) -> Isometry3<f64> {
    let z = -from;
    let x = z.cross(&if z.z.abs() < 0.95 { Vector3::z() } else { Vector3::x() }).normalize();
    let y = z.cross(&x);
    let rows = nalgebra::Matrix3::from_rows(&[x.transpose(), y.transpose(), z.transpose()]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rows));
    let roll = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll);
    Isometry3::from_parts(Translation3::new(0.0, 0.0, distance), roll * rotation)
}

/// Sights `apart_deg` apart. About 2600 and 360 points.
pub(crate) fn pair(seed: u64, apart_deg: f64) -> Pair {
    let mut chance = Chance::new(seed);
    let from = chance.direction();
    let across = from.cross(&chance.direction()).normalize();
    let other = exp_rotation(&(across * apart_deg.to_radians())) * from;
    let t_kinect_body = looking(&from, 2.0 + 0.4 * chance.share(), core::f64::consts::TAU * chance.share());
    let t_camera_body = looking(&other, 3.0 + chance.share(), core::f64::consts::TAU * chance.share());
    let axes = nalgebra::Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
    let turned = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    let t_lidar_body = Isometry3::from_parts(Translation3::identity(), turned) * t_camera_body;
    let blocks = satellite();
    Pair {
        kinect: kinect(&blocks, &t_kinect_body, &mut chance),
        lidar: lidar(&blocks, &t_lidar_body, &mut chance),
        t_lidar_kinect: t_lidar_body * t_kinect_body.inverse(),
    }
}

/// Rays of every fifth or so pixel of a Kinect, as many as give about 2650 points; noise 1.425e-3 z².
fn kinect(blocks: &[Block], t_kinect_body: &Isometry3<f64>, chance: &mut Chance) -> Cloud {
    let back = t_kinect_body.inverse();
    let origin = back * Point3::origin();
    let ways = |step: usize| {
        let places = (-240..240).step_by(step).flat_map(move |v| (-320..320).step_by(step).map(move |u| (u, v)));
        places.map(|(u, v)| Vector3::new(f64::from(u) / 590.0, f64::from(v) / 590.0, 1.0))
    };
    let seen =
        |step| ways(step).filter_map(|way| Some(way * cast(blocks, &origin, &(back * way))?)).collect::<Vec<_>>();
    // The hits of a coarse raster say how fine the right one is.
    let coarse = 8;
    let step = (coarse as f64 * (seen(coarse).len() as f64 / 2650.0).sqrt()).round().max(1.0) as usize;
    let noisy = seen(step).into_iter().map(|at| at * (1.0 + 1.425e-3 * at.z * chance.normal()));
    cloud(SensorKind::Kinect, noisy)
}

/// Rings of a VLP-32C every 0.2°, thinned to 358 returns; noise 2 cm.
fn lidar(blocks: &[Block], t_lidar_body: &Isometry3<f64>, chance: &mut Chance) -> Cloud {
    const RINGS_DEG: [f64; 30] = [
        -15.639, -11.31, -8.843, -7.254, -6.148, -5.333, -4.667, -4.0, -3.667, -3.333, -3.0, -2.667, -2.333, -2.0,
        -1.667, -1.333, -1.0, -0.667, -0.333, 0.0, 0.333, 0.667, 1.0, 1.333, 1.667, 2.333, 3.333, 4.667, 7.0, 10.333,
    ];
    let back = t_lidar_body.inverse();
    let origin = back * Point3::origin();
    let mut seen = Vec::new();
    for ring in RINGS_DEG {
        for column in -100..100 {
            let (sin_e, cos_e) = libm::sincos(ring.to_radians());
            let (sin_a, cos_a) = libm::sincos((f64::from(column) * 0.2).to_radians());
            let way = Vector3::new(cos_e * cos_a, cos_e * sin_a, sin_e);
            if let Some(range) = cast(blocks, &origin, &(back * way)) {
                seen.push(way * (range + 0.02 * chance.normal()));
            }
        }
    }
    while seen.len() > 358 {
        let index = (chance.share() * seen.len() as f64) as usize;
        seen.remove(index);
    }
    cloud(SensorKind::Lidar, seen.into_iter())
}

pub(crate) fn cloud(sensor: SensorKind, points: impl Iterator<Item = Vector3<f64>>) -> Cloud {
    let points = points.map(|at| Point3::from(at).cast::<f32>()).collect();
    Cloud { sensor, points, viewpoint: Some(Point3::origin()), view: View::Bare }
}

/// Points of the whole surface, both sides of everything, as nobody sees it: for what holds in the ideal case only.
pub(crate) fn whole_surface(seed: u64, count: usize) -> Vec<Point3<f32>> {
    let mut chance = Chance::new(seed);
    let blocks = satellite();
    let mut points = Vec::with_capacity(count);
    while points.len() < count {
        let origin = Point3::from(chance.direction() * 3.0);
        let aim = Point3::from(chance.direction() * (0.8 * chance.share()));
        let way = (aim - origin).normalize();
        points.extend(cast(&blocks, &origin, &way).map(|range| (origin + way * range).cast::<f32>()));
    }
    points
}

/// The cloud moved, its viewpoint with it.
pub(crate) fn moved(cloud: &Cloud, motion: &Isometry3<f64>) -> Cloud {
    let place = |point: &Point3<f32>| (motion * point.cast::<f64>()).cast::<f32>();
    Cloud {
        points: cloud.points.iter().map(place).collect(),
        viewpoint: cloud.viewpoint.as_ref().map(place),
        ..cloud.clone()
    }
}

pub(crate) fn centroid(cloud: &Cloud) -> Point3<f64> {
    let sum: Vector3<f64> = cloud.points.iter().map(|point| point.coords.cast::<f64>()).sum();
    Point3::from(sum / cloud.points.len() as f64)
}

/// A prior off by these, rad and m at the moving cloud's centroid.
pub(crate) fn prior(chance: &mut Chance, truth: &Isometry3<f64>, moving: &Cloud, angle: f64, length: f64) -> Prior {
    let rotation = exp_rotation(&(chance.direction() * angle)) * truth.rotation;
    let center = centroid(moving);
    let there = truth * center + chance.direction() * length;
    let pose = Isometry3::from_parts((there - rotation * center).into(), rotation);
    Prior { t_reference_moving: pose, sigma_rotation_rad: angle.max(0.01), sigma_translation_m: length.max(0.01) }
}

/// Rotation error, degrees, and error at the moving cloud's centroid, m.
pub(crate) fn errors(found: &Registration, truth: &Isometry3<f64>, moving: &Cloud) -> (f64, f64) {
    let center = centroid(moving);
    let angle = angle_between(&found.t_reference_moving.rotation, &truth.rotation).to_degrees();
    (angle, (found.t_reference_moving * center - truth * center).norm())
}

/// Within 5° and 5 cm.
pub(crate) fn right(found: &Registration, truth: &Isometry3<f64>, moving: &Cloud) -> bool {
    let (angle, length) = errors(found, truth, moving);
    angle < 5.0 && length < 0.05
}

/// `ξᵀ Σ⁻¹ ξ` with `truth = Exp(ξ) found`: 6 on average if the covariance is right.
pub(crate) fn nees(found: &Registration, truth: &Isometry3<f64>) -> f64 {
    let error = tumbled_model::Twist::log(&(truth * found.t_reference_moving.inverse())).vector();
    error.dot(&found.covariance.cholesky().expect("a covariance").solve(&error))
}
