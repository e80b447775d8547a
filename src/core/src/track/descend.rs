//! Gauss–Newton of a frame to the visible part of the model: each round the nearest surfel of every point, planes and their
//! noise, a kernel that narrows (method.md §7, 3a).

use super::bins::Bins;
use super::fit::{Fit, System};
use super::frame::TrackFrame;
use super::surfels::Surfels;
use crate::register::SensorKind;
use nalgebra::{Isometry3, Matrix3, Point3, Vector3, Vector6};
use tumbled_model::se3::Twist;

/// Rounds at most.
const ROUNDS: u32 = 10;
/// Before so many rounds nothing settles: the kernel still narrows.
const EARLIEST: u32 = 3;
/// The kernel's first and last scale, m, by how much it narrows from round to round.
const KINECT_KERNEL_M: (f64, f64) = (0.04, 0.02);
const LIDAR_KERNEL_M: (f64, f64) = (0.06, 0.035);
const NARROWING: f64 = 0.75;
/// A point farther than so many kernels from the model is on no part of it, and never if farther than the reach, m.
const REJECT: f64 = 1.5;
pub(super) const REACH_M: f32 = 0.035;
/// What a surfel is off besides its noise, m: the surface between them is not flat.
const ROUGH_M: f64 = 0.002;
/// Weight of offsets along the surface: directions that no plane holds stay near the start.
const TANGENTIAL: f64 = 0.02;
/// A step shorter than this, rad and m each, is the last.
const SETTLED: f64 = 2e-5;
/// Points that have moved less than this since their surfels were looked for, m, keep them.
const KEPT_M: f64 = 5e-4;
/// No surfel.
const NONE: u32 = u32::MAX;

/// A surfel as the descent wants it.
#[derive(Clone, Copy, Debug)]
struct Facet {
    position: Point3<f64>,
    normal: Vector3<f64>,
    variance: f64,
}

/// The visible part of the model, ready to be looked up, and what the rounds need: kept from frame to frame.
#[derive(Clone, Debug, Default)]
pub(super) struct Scene {
    facets: Vec<Facet>,
    bins: Bins,
    matched: Vec<u32>,
}

/// A point on the model: its residual along the normal, m, and the normal, both at the final pose (body axes).
pub(super) struct Match {
    pub(super) number: usize,
    pub(super) residual_m: f64,
    pub(super) normal: Vector3<f64>,
}

impl Scene {
    /// Takes the surfels of the numbers given.
    pub(super) fn fill(&mut self, surfels: &Surfels, numbers: &[u32]) {
        self.facets.clear();
        for &number in numbers {
            let at = number as usize;
            let columns = (surfels.positions.get(at), surfels.normals.get(at), surfels.weights.get(at));
            if let (Some(position), Some(normal), Some(weight)) = columns {
                let variance = 1.0 / weight.max(1.0) + ROUGH_M * ROUGH_M;
                self.facets.push(Facet { position: *position, normal: *normal, variance });
            }
        }
        self.bins.fill(self.facets.iter().map(|facet| place(&facet.position)), REACH_M);
    }

    /// Registers a frame from a pose. `points`: the frame's, rig frame, corrected.
    pub(super) fn descend(&mut self, frame: &TrackFrame, points: &[Point3<f64>], start: &Isometry3<f64>) -> Fit {
        let (first, last) = match frame.kind() {
            SensorKind::Kinect => KINECT_KERNEL_M,
            SensorKind::Lidar => LIDAR_KERNEL_M,
        };
        let origin = start.translation.vector;
        let arm = points.iter().map(|point| (point.coords - origin).norm_squared()).fold(0.0, f64::max).sqrt();
        let mut pose = start.inverse();
        let (mut kernel, mut rounds, mut settled, mut moved) = (first, 0, false, f64::INFINITY);
        let system = loop {
            let is_fresh = moved > KEPT_M;
            if is_fresh {
                self.look_up(points, &pose);
                moved = 0.0;
            }
            let system = self.system(points, frame.sigma_m(), &pose, kernel);
            if rounds == ROUNDS || settled {
                break system;
            }
            rounds += 1;
            let pull = Vector6::from_iterator(system.torque.iter().chain(system.force.iter()).copied());
            let matrix = system.descent(TANGENTIAL) + nalgebra::Matrix6::identity() * 1e-6;
            let Some(step) = matrix.cholesky().map(|factor| -factor.solve(&pull)) else { break system };
            let step = Twist::from_vector(&step);
            pose = step.exp() * pose;
            let (turn, shift) = (step.rotation.norm(), step.translation.norm());
            moved += turn * arm + shift;
            settled = rounds > EARLIEST && turn < SETTLED && shift < SETTLED;
            kernel = (kernel * NARROWING).max(last);
        };
        Fit {
            t_rig_target: pose.inverse(),
            information: system.information(),
            inliers: system.inliers,
            used: points.len(),
            rmse_m: (system.squares / system.inliers.max(1) as f64).sqrt(),
            weakest: system.weakest(),
            rounds,
            settled,
            evidence: Vec::new(),
        }
    }

    /// The nearest surfel of every point.
    fn look_up(&mut self, points: &[Point3<f64>], pose: &Isometry3<f64>) {
        let (rotation, translation) = parts(pose);
        self.matched.clear();
        for point in points {
            let moved = Point3::from(rotation * point.coords + translation);
            let found = self.bins.nearest(place(&moved), REACH_M * REACH_M);
            self.matched.push(found.map_or(NONE, |(number, _)| number));
        }
    }

    fn system(&self, points: &[Point3<f64>], sigma_m: &[f64], pose: &Isometry3<f64>, kernel: f64) -> System {
        let (rotation, translation) = parts(pose);
        let most = (REJECT * kernel).min(f64::from(REACH_M));
        let (most, narrow) = (most * most, 1.0 / (kernel * kernel));
        let mut sums = System::new();
        for ((point, sigma), &matched) in points.iter().zip(sigma_m).zip(&self.matched) {
            let Some(facet) = self.facets.get(matched as usize) else { continue };
            let at = rotation * point.coords + translation;
            let offset = at - facet.position.coords;
            if offset.norm_squared() > most {
                continue;
            }
            let normal = &facet.normal;
            let residual = offset.dot(normal);
            let ease = 1.0 + residual * residual * narrow;
            let weight = 1.0 / (ease * ease * (sigma * sigma + facet.variance));
            let lever = at.cross(normal);
            let row = Vector6::new(lever.x, lever.y, lever.z, normal.x, normal.y, normal.z);
            sums.planes += row * (row * weight).transpose();
            let pull = (normal * residual * (1.0 - TANGENTIAL) + offset * TANGENTIAL) * weight;
            sums.torque += at.cross(&pull);
            sums.force += pull;
            sums.weight += weight;
            let weighted = at * weight;
            sums.moment += weighted;
            sums.second += at * weighted.transpose();
            sums.squares += residual * residual;
            sums.inliers += 1;
        }
        sums
    }

    /// The points on the model at the pose of the last descent.
    pub(super) fn matches(&self, points: &[Point3<f64>], t_rig_target: &Isometry3<f64>) -> impl Iterator<Item = Match> {
        let (rotation, translation) = parts(&t_rig_target.inverse());
        points.iter().zip(&self.matched).enumerate().filter_map(move |(number, (point, &matched))| {
            let facet = self.facets.get(matched as usize)?;
            let offset = rotation * point.coords + translation - facet.position.coords;
            Some(Match { number, residual_m: offset.dot(&facet.normal), normal: facet.normal })
        })
    }
}

fn parts(pose: &Isometry3<f64>) -> (Matrix3<f64>, Vector3<f64>) {
    (pose.rotation.to_rotation_matrix().into_inner(), pose.translation.vector)
}

fn place(point: &Point3<f64>) -> [f32; 3] {
    point.coords.cast::<f32>().into()
}
