//! A target that moves as it does, and sensors that are off as they are: written without the filter's own motion.

use crate::chance::Chance;
use core::f64::consts::PI;
use nalgebra::{Isometry3, Matrix3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};
use tumbled_core::ukf::{Estimate, Filter, FilterOptions, Motion, PoseMeasurement, SensorPrior, StatedUncertainty};
use tumbled_model::se3::{exp_rotation, log_rotation};
use tumbled_model::{RigNs, Span, Twist};

pub(crate) const DEGREE: f64 = PI / 180.0;

/// Steps of the truth, s.
const STEP_S: f64 = 1.0 / 600.0;

/// The truth at one time.
#[derive(Clone, Copy)]
pub(crate) struct Moment {
    pub(crate) t: f64,
    pub(crate) pose: Isometry3<f64>,
    /// Of the frame's origin, rig axes.
    pub(crate) velocity: Vector3<f64>,
    /// Rig axes.
    pub(crate) rate: Vector3<f64>,
    /// Angular momentum over the inertia's scale, rig axes.
    pub(crate) momentum: Vector3<f64>,
}

/// A target's motion, sampled every 1/600 s.
pub(crate) struct Truth {
    moments: Vec<Moment>,
}

/// What the truth does.
#[derive(Clone, Copy)]
struct Scene {
    pub(crate) seconds: f64,
    pub(crate) rate_rps: f64,
    /// White accelerations, m/s^1.5 and rad/s^1.5.
    pub(crate) noise: (f64, f64),
    /// Inertia about the principal axes; alike for a fixed axis.
    pub(crate) inertia: [f64; 3],
}

impl Truth {
    fn new(scene: &Scene, chance: &mut Chance) -> Self {
        let principal = exp_rotation(&(chance.vector() * 1.2)).to_rotation_matrix().into_inner();
        let inertia = principal * Matrix3::from_diagonal(&scene.inertia.into()) * principal.transpose();
        let inverse = inertia.try_inverse().expect("an inertia");
        let mut rotation = exp_rotation(&(chance.vector() * 1.5));
        let mut rate = if scene.inertia[0] == scene.inertia[2] {
            chance.direction().into_inner() * scene.rate_rps
        } else {
            // Well off every principal axis.
            principal * Vector3::new(0.35, 0.8, 0.48).normalize() * scene.rate_rps
        };
        let center = chance.direction().into_inner() * (0.02 + 0.03 * chance.share());
        let mut place = Vector3::new(0.0, 0.0, 1.0);
        let mut velocity = Vector3::zeros();
        let acceleration = |w: &Vector3<f64>| -(inverse * w.cross(&(inertia * w)));
        let root = STEP_S.sqrt();
        let steps = (scene.seconds / STEP_S) as usize + 10;
        let moments = (0..steps)
            .map(|step| {
                let origin = place - rotation * center;
                let moment = Moment {
                    t: step as f64 * STEP_S,
                    pose: Isometry3::from_parts(Translation3::from(origin), rotation),
                    velocity: velocity - rotation * rate.cross(&center),
                    rate: rotation * rate,
                    momentum: rotation * (inertia * rate),
                };
                // Midpoint of a step of 1/600 s at 0.35 rad/s: (h ω)³ = 2e-10 rad a step, 1e-6 in all.
                let middle = rate + acceleration(&rate) * (0.5 * STEP_S);
                rotation = UnitQuaternion::new_normalize((rotation * exp_rotation(&(middle * STEP_S))).into_inner());
                rate += acceleration(&middle) * STEP_S + chance.vector() * (scene.noise.1 * root);
                place += velocity * STEP_S;
                velocity += chance.vector() * (scene.noise.0 * root);
                moment
            })
            .collect();
        Self { moments }
    }

    pub(crate) fn at(&self, t: f64) -> Moment {
        let index = (t / STEP_S).max(0.0) as usize;
        let moment = self.moments[index.min(self.moments.len() - 1)];
        let dt = t - moment.t;
        let place = moment.pose.translation.vector + moment.velocity * dt;
        let rotation = exp_rotation(&(moment.rate * dt)) * moment.pose.rotation;
        Moment { t, pose: Isometry3::from_parts(Translation3::from(place), rotation), ..moment }
    }
}

/// A sensor with its errors.
pub(crate) struct Sensor {
    pub(crate) prior: SensorPrior,
    pub(crate) constant: Vector6<f64>,
    slow: Vector6<f64>,
    late_s: f64,
    /// Of the noise of one frame.
    pub(crate) noise: Vector6<f64>,
    last: Option<Isometry3<f64>>,
}

impl Sensor {
    fn new(prior: SensorPrior, noise: Vector6<f64>, chance: &mut Chance) -> Self {
        Self {
            constant: chance.twist(&prior.sigma_e),
            slow: chance.twist(&prior.sigma_b),
            late_s: prior.sigma_time_s * chance.normal(),
            prior,
            noise,
            last: None,
        }
    }

    /// A Kinect in front of the target and a LiDAR 45° beside it.
    pub(crate) fn pair(chance: &mut Chance) -> Vec<Self> {
        let stated = StatedUncertainty::default();
        let at = |turn: f64| {
            let axes = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), turn);
            Isometry3::from_parts(Translation3::new(0.0, 0.0, 1.0), axes)
        };
        let (r, t) = (0.1 * DEGREE, 0.0015);
        let kinect = Self::new(SensorPrior::kinect(at(0.0), 2.5, &stated), Vector6::new(r, r, r, t, t, t), chance);
        let (r, t) = (0.25 * DEGREE, 0.003);
        let lidar = Self::new(SensorPrior::lidar(at(0.8), 2.5, &stated), Vector6::new(r, r, r, t, t, t), chance);
        vec![kinect, lidar]
    }

    /// What it makes of the target at the time it says.
    pub(crate) fn pose(&mut self, truth: &Truth, t: f64, sensor: usize, chance: &mut Chance) -> PoseMeasurement {
        let pose = truth.at(t - self.late_s).pose;
        if let Some(last) = self.last.replace(pose) {
            let angle = log_rotation(&(last.rotation.inverse() * pose.rotation)).norm();
            let kept = libm::exp(-angle / (30.0 * DEGREE));
            self.slow = self.slow * kept + chance.twist(&self.prior.sigma_b) * (1.0 - kept * kept).sqrt();
        }
        let nominal = self.prior.nominal;
        let exp = |twist: &Vector6<f64>| Twist::from_vector(twist).exp();
        let moved = nominal * exp(&self.constant) * nominal.inverse();
        // The filter takes 1.5 (H + 1)⁻¹ + (0.05°, 0.5 mm)² for the noise: the H that makes it this sensor's.
        let floor = Vector6::new(0.05 * DEGREE, 0.05 * DEGREE, 0.05 * DEGREE, 5e-4, 5e-4, 5e-4);
        let information = self.noise.zip_map(&floor, |noise, floor| 1.5 / (noise * noise - floor * floor) - 1.0);
        PoseMeasurement {
            t: RigNs(0) + Span((t * 1e9).round() as i64),
            sensor,
            pose: moved * pose * exp(&self.slow) * exp(&chance.twist(&self.noise)),
            information: Matrix6::from_diagonal(&information),
        }
    }
}

/// All poses of a Kinect at `hz` and a LiDAR at 10 Hz, in order.
fn poses(sensors: &mut [Sensor], truth: &Truth, seconds: f64, hz: f64, chance: &mut Chance) -> Vec<PoseMeasurement> {
    let mut all = Vec::new();
    let mut times: Vec<(f64, usize)> = (0..(seconds * hz) as u32).map(|k| (0.02 + f64::from(k) / hz, 0)).collect();
    times.extend((0..(seconds * 10.0) as u32).map(|k| (0.045 + f64::from(k) / 10.0, 1)));
    times.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (t, index) in times {
        if let Some(sensor) = sensors.get_mut(index) {
            all.push(sensor.pose(truth, t, index, chance));
        }
    }
    all
}

/// The truth's own scene for these options.
fn scene(options: &FilterOptions, seconds: f64, rate_dps: f64) -> Scene {
    let inertia = if options.motion == Motion::FreeTumble { [1.0, 1.25, 1.6] } else { [1.0; 3] };
    let noise = (options.q_acceleration, options.q_angular);
    Scene { seconds, rate_rps: rate_dps * DEGREE, noise, inertia }
}

/// Error of an estimate in the twelve numbers of its covariance.
pub(crate) fn error(estimate: &Estimate, truth: &Moment) -> nalgebra::SVector<f64, 12> {
    let mut error = nalgebra::SVector::<f64, 12>::zeros();
    let twist = Twist::log(&estimate.t_rig_target.inv_mul(&truth.pose)).vector();
    error.fixed_rows_mut::<6>(0).copy_from(&twist);
    error.fixed_rows_mut::<3>(6).copy_from(&(truth.velocity - estimate.velocity_mps));
    let rate = estimate.t_rig_target.rotation * estimate.angular_velocity_rps;
    error.fixed_rows_mut::<3>(9).copy_from(&(truth.rate - rate));
    error
}

/// Normalised estimation error squared.
pub(crate) fn nees(estimate: &Estimate, truth: &Moment) -> f64 {
    let error = error(estimate, truth);
    let factor = estimate.covariance.cholesky().expect("a covariance is positive");
    error.dot(&factor.solve(&error))
}

/// A truth, its sensors, and their poses in order.
pub(crate) struct Run {
    pub(crate) truth: Truth,
    pub(crate) priors: Vec<SensorPrior>,
    /// e of each sensor.
    pub(crate) constant: Vec<Vector6<f64>>,
    /// How late each sensor's stamps are, s.
    pub(crate) late_s: Vec<f64>,
    pub(crate) poses: Vec<PoseMeasurement>,
}

/// The poses that make a start: of a second and a third.
pub(crate) const WINDOW: usize = 54;

impl Run {
    /// A Kinect at 30 Hz and a LiDAR at 10 Hz.
    pub(crate) fn new(options: &FilterOptions, seconds: f64, rate_dps: f64, seed: u64) -> Self {
        let mut chance = Chance::new(seed);
        let truth = Truth::new(&scene(options, seconds, rate_dps), &mut chance);
        let mut sensors = Sensor::pair(&mut chance);
        let poses = poses(&mut sensors, &truth, seconds, 30.0, &mut chance);
        Self {
            truth,
            priors: sensors.iter().map(|sensor| sensor.prior).collect(),
            constant: sensors.iter().map(|sensor| sensor.constant).collect(),
            late_s: sensors.iter().map(|sensor| sensor.late_s).collect(),
            poses,
        }
    }

    /// The filter after the window, and the poses that are left.
    pub(crate) fn start(&self, options: FilterOptions) -> (Filter, &[PoseMeasurement]) {
        let (window, rest) = self.poses.split_at(WINDOW);
        (Filter::start(options, self.priors.clone(), window).expect("a start"), rest)
    }

    /// The truth at the time of a pose.
    pub(crate) fn at(&self, z: &PoseMeasurement) -> Moment {
        self.truth.at((z.t - RigNs(0)).as_secs_f64())
    }
}
