//! Motions that are made up, seen by a camera and a LiDAR that are displaced as their priors say.

use super::{FittedPose, Smoothed, smooth};
use crate::ukf::{SensorPrior, StatedUncertainty};
use nalgebra::{Isometry3, Matrix6, Vector3, Vector6};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use tumbled_model::{RigNs, Twist};

const DEGREE: f64 = core::f64::consts::PI / 180.0;
/// Where the target is.
const CENTER: Vector3<f64> = Vector3::new(2.2, 0.1, -0.2);
/// Of a pose's own noise, one axis: rad and m.
const NOISE: (f64, f64) = (0.2 * DEGREE, 0.002);

/// Normal deviates: a sum of twelve uniform ones.
struct Dice(ChaCha8Rng);

impl Dice {
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| f64::from(self.0.next_u32()) / f64::from(u32::MAX)).sum::<f64>() - 6.0
    }

    fn twist(&mut self, sigma: &Vector6<f64>) -> Isometry3<f64> {
        Twist::from_vector(&sigma.map(|sigma| sigma * self.normal())).exp()
    }
}

fn squared(x: f64) -> f64 {
    x * x
}

fn both(rotation: f64, translation: f64) -> Vector6<f64> {
    Vector6::new(rotation, rotation, rotation, translation, translation, translation)
}

fn priors() -> Vec<SensorPrior> {
    let (stated, nominal) = (StatedUncertainty::default(), Isometry3::from_parts(CENTER.into(), Default::default()));
    vec![SensorPrior::kinect(nominal, 2.2, &stated), SensorPrior::lidar(nominal, 2.2, &stated)]
}

/// About an axis 0.2 m from the target's origin, at 20 °/s.
fn turntable(t_s: f64) -> Isometry3<f64> {
    let turn = Twist::new(axis() * (RATE * t_s), Vector3::zeros()).exp();
    Isometry3::from_parts(CENTER.into(), Default::default()) * turn * Isometry3::translation(0.2, 0.0, 0.05)
}

const RATE: f64 = 20.0 * DEGREE;

fn axis() -> Vector3<f64> {
    Vector3::new(0.1, -0.2, 1.0).normalize()
}

/// A session of `seconds`: a frame of the camera every 150 ms, of the LiDAR every 250 ms.
struct Session {
    poses: Vec<FittedPose>,
    truth: Vec<Isometry3<f64>>,
    displacements: Vec<Isometry3<f64>>,
}

impl Session {
    fn new(seed: u64, seconds: f64, motion: &dyn Fn(f64) -> Isometry3<f64>) -> Self {
        let mut dice = Dice(ChaCha8Rng::seed_from_u64(seed));
        let center = Isometry3::from_parts(CENTER.into(), Default::default());
        let displacements: Vec<_> =
            priors().iter().map(|prior| center * dice.twist(&prior.sigma_e) * center.inverse()).collect();
        let information = Matrix6::from_diagonal(&both(NOISE.0, NOISE.1).map(|sigma| 1.0 / (sigma * sigma)));
        let (mut poses, mut truth) = (Vec::new(), Vec::new());
        for (sensor, step_s) in [(0, 0.15), (1, 0.25)] {
            for n in 0..(seconds / step_s) as u32 {
                let t_s = f64::from(n) * step_s;
                let seen = displacements[sensor] * motion(t_s) * dice.twist(&both(NOISE.0, NOISE.1));
                let t = RigNs((t_s * 1e9) as i64);
                poses.push(FittedPose { t, sensor, t_rig_target: seen, information: Some(information) });
                truth.push(motion(t_s));
            }
        }
        Self { poses, truth, displacements }
    }

    fn smoothed(&self) -> Smoothed {
        smooth(&self.poses, &priors()).expect("a motion")
    }

    /// Root mean square of how far poses are off where their sensors see the target, rad and m.
    fn off<'a>(&self, poses: impl Iterator<Item = &'a Isometry3<f64>>) -> (f64, f64) {
        let (mut turn, mut shift, mut count) = (0.0, 0.0, 0.0);
        for ((pose, truth), given) in poses.zip(&self.truth).zip(&self.poses) {
            let off = (self.displacements[given.sensor] * truth).inv_mul(pose);
            turn += squared(off.rotation.angle());
            shift += off.translation.vector.norm_squared();
            count += 1.0;
        }
        ((turn / count).sqrt(), (shift / count).sqrt())
    }
}

#[test]
fn axis_and_rate_of_a_turntable_are_as_far_off_as_they_say() {
    // 20 seeds: 20 rates and 40 components of axes. Of 20 squares of normal deviates the mean is 1 ± 0.32, of 40 it is
    // 1 ± 0.22: bounds at four of those, and below as much again for σ that is told of the middle and not of the mean.
    let (mut rates, mut axes, mut most) = (0.0, 0.0, 0.0_f64);
    let across = [axis().cross(&Vector3::x()).normalize(), axis().cross(&Vector3::y()).normalize()];
    for seed in 0..20 {
        let smoothed = Session::new(seed, 18.0, &turntable).smoothed();
        let spin = smoothed.spin;
        assert!(smoothed.liberty < 1e-3, "{}", smoothed.liberty);
        assert!(spin.wander_rad < 0.1 * DEGREE, "{}", spin.wander_rad);
        rates += squared((spin.rate_rps.norm() - RATE) / spin.sigma_rate_rps) / 20.0;
        for direction in &across {
            axes += squared(spin.rate_rps.normalize().dot(direction) / spin.sigma_axis_rad) / 40.0;
        }
        most = most.max((spin.rate_rps.norm() - RATE).abs() / DEGREE);
    }
    assert!((0.1..2.3).contains(&rates), "rates' squares {rates}");
    assert!((0.1..1.9).contains(&axes), "axes' squares {axes}");
    assert!(most < 0.02, "{most} °/s");
}

#[test]
fn frames_are_placed_much_nearer_than_each_alone() {
    for seed in 0..4 {
        let session = Session::new(seed, 18.0, &turntable);
        let single = session.off(session.poses.iter().map(|pose| &pose.t_rig_target));
        let smoothed = session.smoothed();
        let placed = session.off(smoothed.placed.iter());
        // Both sensors' displacements are measured against one motion: what they share stays, the motion's own gauge.
        let shared = smoothed.displacements[0].inv_mul(&session.displacements[0]);
        assert!(placed.0 < 0.35 * single.0 + shared.rotation.angle(), "{placed:?} {single:?}");
        let apart = |of: &[Isometry3<f64>]| of[0].inverse() * of[1];
        let off = apart(&session.displacements).inv_mul(&apart(&smoothed.displacements));
        assert!(off.rotation.angle() < 0.15 * DEGREE, "{}", off.rotation.angle() / DEGREE);
    }
}

/// A free body with moments of inertia 1, 1.6 and 2.1, 15 °/s: the attitude by small steps.
fn tumble() -> impl Fn(f64) -> Isometry3<f64> {
    let inertia = Vector3::new(1.0, 1.6, 2.1);
    let mut rate = Vector3::new(5.0, 14.0, 3.0) * DEGREE;
    let mut pose = Isometry3::from_parts(CENTER.into(), Default::default());
    let step_s = 1e-3;
    let mut path = vec![pose];
    for _ in 0..40_000 {
        pose *= Twist::new(rate * step_s, Vector3::zeros()).exp();
        let torque = -rate.cross(&inertia.component_mul(&rate));
        rate += torque.component_div(&inertia) * step_s;
        path.push(pose);
    }
    move |t_s| path[(t_s / step_s).round() as usize]
}

#[test]
fn a_tumble_is_given_more_liberty_and_smoothed_all_the_same() {
    let motion = tumble();
    for seed in 0..3 {
        let session = Session::new(seed, 30.0, &motion);
        let smoothed = session.smoothed();
        assert!(smoothed.liberty > 1e-4, "{}", smoothed.liberty);
        let single = session.off(session.poses.iter().map(|pose| &pose.t_rig_target));
        let shared = smoothed.displacements[0].inv_mul(&session.displacements[0]).rotation.angle();
        let placed = session.off(smoothed.placed.iter());
        assert!(placed.0 < 0.7 * single.0 + shared, "{placed:?} {single:?} {shared}");
        assert!(smoothed.spin.wander_rad > 5.0 * DEGREE);
    }
}

#[test]
fn outliers_and_frames_without_a_fit_change_little() {
    let clean = Session::new(7, 18.0, &turntable);
    let mut session = Session::new(7, 18.0, &turntable);
    for (n, pose) in session.poses.iter_mut().enumerate() {
        if n % 20 == 3 {
            pose.t_rig_target *= Twist::new(Vector3::new(5.0, -3.0, 4.0) * DEGREE, Vector3::new(0.05, 0.0, 0.1)).exp();
        }
        if n % 20 == 13 {
            pose.t_rig_target = Isometry3::identity();
            pose.information = None;
        }
    }
    let (with, without) = (session.smoothed(), clean.smoothed());
    assert!((with.spin.rate_rps - without.spin.rate_rps).norm() < 0.02 * DEGREE);
    let off = with.placed.iter().zip(&without.placed).map(|(a, b)| a.inv_mul(b).rotation.angle()).fold(0.0, f64::max);
    assert!(off < 0.12 * DEGREE, "{}", off / DEGREE);
}

#[test]
fn the_order_of_the_frames_changes_nothing() {
    let session = Session::new(3, 9.0, &turntable);
    let smoothed = session.smoothed();
    let mut turned = session.poses.clone();
    // The camera's frames stand first, and at times they share they stay first.
    turned.sort_by_key(|pose| (pose.t, pose.sensor));
    let again = smooth(&turned, &priors()).expect("a motion");
    // The middle of the path is a sum in the order given: it rounds otherwise.
    assert!((again.spin.rate_rps - smoothed.spin.rate_rps).norm() < 1e-9);
    let find = |t, sensor| session.poses.iter().position(|pose| (pose.t, pose.sensor) == (t, sensor)).expect("given");
    for (pose, place) in turned.iter().zip(&again.placed) {
        let off = place.inv_mul(&smoothed.placed[find(pose.t, pose.sensor)]);
        assert!(off.rotation.angle() < 1e-7 && off.translation.vector.norm() < 1e-9);
    }
}

#[test]
fn a_scatter_greater_than_the_points_noise_says_is_found() {
    let mut session = Session::new(11, 18.0, &turntable);
    for pose in &mut session.poses {
        // Claims a third of its noise.
        pose.information = pose.information.map(|information| information * 9.0);
    }
    let scatter = session.smoothed().scatter;
    // 120 and 72 frames of six numbers: ± 3 %, and what Student's weights make of it.
    assert!(scatter.iter().all(|scatter| (2.3..3.6).contains(scatter)), "{scatter:?}");
}

#[test]
fn too_little_is_no_motion() {
    let session = Session::new(1, 1.0, &turntable);
    assert_eq!(smooth(&[], &priors()), None);
    assert_eq!(smooth(&session.poses[..3], &priors()), None);
    assert_eq!(smooth(&session.poses, &priors()[..1]), None, "a sensor nobody knows");
    let at_once: Vec<_> = session.poses.iter().map(|pose| FittedPose { t: RigNs(5), ..*pose }).collect();
    assert_eq!(smooth(&at_once, &priors()), None);
    let blind: Vec<_> = session.poses.iter().map(|pose| FittedPose { information: None, ..*pose }).collect();
    assert_eq!(smooth(&blind, &priors()), None);
}
