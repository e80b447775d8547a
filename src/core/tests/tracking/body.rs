//! A body of boxes, and what a depth camera and a LiDAR see of it.

use crate::chance::Chance;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use tumbled_core::track::{LidarReturn, Pixel, RigMotion, Shot, TrackFrame};
use tumbled_model::RigNs;
use tumbled_model::se3::Twist;

/// Boxes in the body's frame: (middle, half its sides), m.
pub(crate) struct Body(pub(crate) Vec<([f64; 3], [f64; 3])>);

impl Body {
    /// A bus of 0.5 × 0.6 × 0.7 m, two unlike panels 20 mm thick, and a box on one side: no symmetry.
    pub(crate) fn satellite() -> Self {
        Self(vec![
            ([0.0, 0.0, 0.0], [0.25, 0.30, 0.35]),
            ([0.60, 0.0, 0.05], [0.35, 0.20, 0.01]),
            ([-0.50, 0.05, 0.0], [0.25, 0.01, 0.18]),
            ([0.05, 0.36, 0.10], [0.12, 0.06, 0.15]),
        ])
    }

    /// One flat wall of 2 × 2 m, the body's x and y axes in it.
    pub(crate) fn wall() -> Self {
        Self(vec![([0.0, 0.0, 0.05], [1.0, 1.0, 0.05])])
    }

    /// How far along a ray (body frame) its first hit is, in the ray's lengths; none of a surface seen at less than 11.5°.
    fn cast(&self, from: &Point3<f64>, along: &Vector3<f64>) -> Option<f64> {
        // Past the body: nothing of it is 1.2 m from its origin, but for the wall's corners.
        let aside = from.coords.cross(along).norm_squared();
        if aside > 2.0 * along.norm_squared() {
            return None;
        }
        let mut first: Option<(f64, f64)> = None;
        for (middle, half) in &self.0 {
            let (mut enter, mut leave, mut cosine) = (0.0, f64::INFINITY, 0.0);
            for axis in 0..3 {
                let (offset, step) = (middle[axis] - from[axis], along[axis]);
                if step.abs() < 1e-12 {
                    if offset.abs() > half[axis] {
                        leave = -1.0;
                    }
                    continue;
                }
                let (a, b) = ((offset - half[axis]) / step, (offset + half[axis]) / step);
                if a.min(b) > enter {
                    (enter, cosine) = (a.min(b), step.abs() / along.norm());
                }
                leave = leave.min(a.max(b));
            }
            if enter > 0.0 && enter < leave && first.is_none_or(|(nearest, _)| enter < nearest) {
                first = Some((enter, cosine));
            }
        }
        first.filter(|(_, cosine)| *cosine > 0.2).map(|(distance, _)| distance)
    }
}

/// A depth camera at the rig's origin, z forward: every third pixel of a focal length of 580 px, noise along the ray.
pub(crate) fn camera(body: &Body, t_rig_body: &Isometry3<f64>, sigma_m: f64, chance: &mut Chance) -> TrackFrame {
    let inverse = t_rig_body.inverse();
    let middle = t_rig_body.translation.vector;
    let mut pixels = Vec::new();
    for row in -110..110 {
        for column in -110..110 {
            let slope = |step: i32, at: f64| f64::from(step) * 3.0 / 580.0 + at / middle.z;
            let ray = Vector3::new(slope(column, middle.x), slope(row, middle.y), 1.0);
            if let Some(depth) = body.cast(&(inverse * Point3::origin()), &(inverse * ray)) {
                let point = Point3::from(ray * (depth + sigma_m * chance.normal()));
                pixels.push(Pixel { point: point.cast(), sigma_m: sigma_m.max(1e-4) as f32 });
            }
        }
    }
    TrackFrame::of_kinect(Shot { sensor: 0, t: RigNs(0), viewpoint: Point3::origin() }, pixels)
}

/// A LiDAR of rings.
pub(crate) struct Rings {
    /// Where it stands; x forward, z up.
    pub(crate) t_rig_lidar: Isometry3<f64>,
    /// From ring to ring, rad.
    pub(crate) step_rad: f64,
    /// By how much each ring measures too long, m.
    pub(crate) biases_m: Vec<f64>,
    /// Of a range, m.
    pub(crate) sigma_m: f64,
}

impl Rings {
    /// Rings two thirds of a degree apart, 2 m from a body at (0, 0, 2.1), looking at it along a unit vector; up is −y.
    pub(crate) fn looking(forward: &Vector3<f64>, biases_m: Vec<f64>, sigma_m: f64) -> Self {
        let up = -Vector3::y();
        let axes = nalgebra::Rotation3::from_basis_unchecked(&[*forward, up.cross(forward), up]);
        let place = Vector3::new(0.0, 0.0, 2.1) - forward * 2.0;
        let t_rig_lidar = Isometry3::from_parts(Translation3::from(place), UnitQuaternion::from_rotation_matrix(&axes));
        Self { t_rig_lidar, step_rad: (2.0f64 / 3.0).to_radians(), biases_m, sigma_m }
    }

    /// 45° beside the camera.
    pub(crate) fn beside(biases_m: Vec<f64>, sigma_m: f64) -> Self {
        Self::looking(&Vector3::new(-1.0, 0.0, 1.0).normalize(), biases_m, sigma_m)
    }

    /// One crossing of a body that moves: a turn of 0.1 s, 0.2° from column to column, each at its own time about the
    /// epoch's. `motion`: what the tracker believes of the body's.
    pub(crate) fn crossing(
        &self,
        body: &Body,
        pose_at: impl Fn(f64) -> Isometry3<f64>,
        motion: &RigMotion,
        chance: &mut Chance,
    ) -> TrackFrame {
        let mut returns = Vec::new();
        for column in -150..150 {
            let azimuth = f64::from(column) * 0.2f64.to_radians();
            let dt_s = -azimuth / core::f64::consts::TAU * 0.1;
            let t_body_lidar = pose_at(dt_s).inverse() * self.t_rig_lidar;
            for (beam, bias) in self.biases_m.iter().enumerate() {
                let elevation = (beam as f64 - (self.biases_m.len() - 1) as f64 / 2.0) * self.step_rad;
                let (sin, cos) = libm::sincos(elevation);
                let ray = Vector3::new(cos * libm::cos(azimuth), cos * libm::sin(azimuth), sin);
                if let Some(range) = body.cast(&(t_body_lidar * Point3::origin()), &(t_body_lidar * ray)) {
                    let range = range + bias + self.sigma_m * chance.normal();
                    let point = (self.t_rig_lidar * Point3::from(ray * range)).cast();
                    returns.push(LidarReturn { point, beam: beam as u8, dt_s: dt_s as f32 });
                }
            }
        }
        let viewpoint = self.t_rig_lidar.translation.vector.into();
        TrackFrame::of_lidar(Shot { sensor: 1, t: RigNs(0), viewpoint }, returns, self.sigma_m.max(1e-3), motion)
    }
}

/// A turn at a steady rate about a tilted axis through the body's origin, 2.1 m in front of the camera.
pub(crate) struct Turn {
    /// Angular velocity, rad/s, rig axes.
    pub(crate) angular_rps: Vector3<f64>,
}

impl Turn {
    /// At so many degrees a second.
    pub(crate) fn at(degrees: f64) -> Self {
        Self { angular_rps: Vector3::new(0.25, -0.93, 0.27).normalize() * degrees.to_radians() }
    }

    /// The body's true pose, s after the start.
    pub(crate) fn pose(&self, t: f64) -> Isometry3<f64> {
        let first = UnitQuaternion::from_euler_angles(0.3, 0.5, 0.2);
        let rotation = UnitQuaternion::from_scaled_axis(self.angular_rps * t) * first;
        Isometry3::from_parts(Translation3::new(0.0, 0.0, 2.1), rotation)
    }

    /// What there is to believe of it.
    pub(crate) fn motion(&self) -> RigMotion {
        RigMotion { angular_rps: self.angular_rps, center: Point3::new(0.0, 0.0, 2.1), ..RigMotion::STILL }
    }
}

/// Degrees and millimetres by which a pose is off.
pub(crate) fn off(truth: &Isometry3<f64>, found: &Isometry3<f64>) -> (f64, f64) {
    let error = Twist::log(&(truth.inverse() * found));
    (error.rotation.norm().to_degrees(), error.translation.norm() * 1e3)
}
