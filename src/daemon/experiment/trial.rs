//! One registration of a pair, held against the truth.

use std::time::Instant;

use nalgebra::{Isometry3, Matrix6, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::Workers;
use tumbled_core::register::{Cloud, Method, MethodOptions, Prior, Registration, register};
use tumbled_model::Twist;
use tumbled_model::se3::{angle_between, exp_rotation};
use tumbled_sim::noise::Noise;

use super::pairs::Pair;
use super::symmetry;

/// A registration is right within so many degrees
pub const RIGHT_DEG: f64 = 5.0;
/// and metres at the moving cloud's centroid (issue 6).
pub const RIGHT_M: f64 = 0.05;

/// What a registration begins with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Start {
    /// Nothing: methods that iterate begin with the centroids laid on each other.
    #[default]
    Global,
    /// The truth turned by so much about a random axis, and moved by so much at the moving cloud's centroid.
    Prior {
        /// Degrees.
        rotation_deg: f64,
        /// m.
        translation_m: f64,
    },
}

impl Start {
    /// 10° and 10 cm, as the acceptance figures have it.
    pub const PRIOR: Self = Self::Prior { rotation_deg: 10.0, translation_m: 0.1 };

    /// In words: `global`, `10 deg / 10 cm`.
    pub fn name(&self) -> String {
        match self {
            Self::Global => "global".to_owned(),
            Self::Prior { rotation_deg, translation_m } => {
                format!("{rotation_deg} deg / {} cm", (1e4 * translation_m).round() / 100.0)
            }
        }
    }

    /// The prior of a pair, the same for every method; `None`: global, or nobody knows the truth.
    pub fn prior(&self, pair: &Pair, seed: u64) -> Option<Prior> {
        let Self::Prior { rotation_deg, translation_m } = *self else { return None };
        let truth = pair.truth?;
        let mut noise = Noise::new(seed, "pair.prior", pair.index);
        let rotation = exp_rotation(&(direction(&mut noise) * rotation_deg.to_radians())) * truth.rotation;
        let centre = centroid(&pair.moving);
        let there = truth * centre + direction(&mut noise) * translation_m;
        let pose = Isometry3::from_parts((there - rotation * centre).into(), rotation);
        // A vector of length a and of any direction has a standard deviation of a/√3 along each axis.
        let each = 1.0 / 3f64.sqrt();
        Some(Prior {
            t_reference_moving: pose,
            sigma_rotation_rad: (rotation_deg.to_radians() * each).max(1e-3),
            sigma_translation_m: (translation_m * each).max(1e-3),
        })
    }
}

/// The method of a name.
///
/// # Errors
/// The names there are.
pub fn method_named(name: &str) -> Result<Method, String> {
    let names: Vec<&str> = Method::ALL.iter().map(|method| method.name()).collect();
    Method::of_name(name).ok_or_else(|| format!("expected one of {}", names.join(", ")))
}

/// What came of one registration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Trial {
    /// The pair's number.
    pub pair: u64,
    /// The share of the LiDAR's points that the Kinect sees; null: unknown.
    pub overlap: Option<f64>,
    /// Between the sights, degrees; null: unknown.
    pub sights_deg: Option<f64>,
    /// The truth is known; otherwise nothing is right, and there are no errors.
    pub judged: bool,
    /// Off the truth, degrees; null: refused, or not judged.
    pub rotation_error_deg: Option<f64>,
    /// Off the truth at the moving cloud's centroid, m.
    pub translation_error_m: Option<f64>,
    /// Root mean square distance of the moving points from where they truly are, m.
    pub point_error_m: Option<f64>,
    /// Within 5° and 5 cm of the truth.
    pub right: bool,
    /// Within 5° and 5 cm of a pose in which the target looks as it does: a symmetric one has several.
    pub right_up_to_symmetry: bool,
    /// The method says it may be used.
    pub accepted: bool,
    /// Why not; null: accepted.
    pub reason: Option<String>,
    /// The method's score.
    pub score: Option<f64>,
    /// By how much the best other mode scores less.
    pub gap: Option<f64>,
    /// Share of the sparse cloud's points on the surface.
    pub inliers: Option<f64>,
    /// Their root mean square distance from it, m.
    pub rmse_m: Option<f64>,
    /// The error's square in units of the covariance: 6 in the mean if that is right; null: no covariance.
    pub nees: Option<f64>,
    /// Other modes.
    pub alternatives: u64,
    /// One of them is right.
    pub alternative_right: bool,
    /// Iterations of the refinement.
    pub iterations: u32,
    /// Wall time from loaded clouds to the result, ms. Measured, and the only figure here that is not reproducible.
    pub time_ms: f64,
}

/// Registers a pair on this thread, and compares.
pub fn run(pair: &Pair, method: Method, start: &Start, seed: u64, options: &MethodOptions) -> Trial {
    let prior = start.prior(pair, seed);
    let began = Instant::now();
    let found = register(&pair.moving, &pair.reference, method, prior.as_ref(), options, &Workers::none());
    let time_ms = 1e3 * began.elapsed().as_secs_f64();
    let mut trial = Trial {
        pair: pair.index,
        overlap: pair.overlap,
        sights_deg: pair.sights_deg,
        judged: pair.truth.is_some(),
        rotation_error_deg: None,
        translation_error_m: None,
        point_error_m: None,
        right: false,
        right_up_to_symmetry: false,
        accepted: false,
        reason: None,
        score: None,
        gap: None,
        inliers: None,
        rmse_m: None,
        nees: None,
        alternatives: 0,
        alternative_right: false,
        iterations: 0,
        time_ms,
    };
    match found {
        Ok(found) => trial.compare(pair, &found),
        Err(error) => trial.reason = Some(error.to_string()),
    }
    trial
}

impl Trial {
    fn compare(&mut self, pair: &Pair, found: &Registration) {
        let pose = &found.t_reference_moving;
        if let Some(truth) = &pair.truth {
            let error = Error::of(pair, pose, truth);
            self.rotation_error_deg = finite(error.rotation_deg);
            self.translation_error_m = finite(error.translation_m);
            self.point_error_m = finite(point_error_m(&pair.moving, pose, truth));
            self.right = error.is_right();
            let symmetric = nearest_truth(pair, truth, pose);
            self.right_up_to_symmetry = self.right || Error::of(pair, pose, &symmetric).is_right();
            self.nees = nees(pose, &found.covariance, truth);
            let modes = found.alternatives.iter().map(|mode| &mode.t_reference_moving);
            self.alternative_right = modes.into_iter().any(|mode| Error::of(pair, mode, truth).is_right());
        }
        self.accepted = found.accepted;
        self.reason = reason(found);
        self.score = finite(found.score);
        self.gap = found.gap.and_then(finite);
        self.inliers = finite(found.inliers);
        self.rmse_m = finite(found.rmse_m);
        self.alternatives = found.alternatives.len() as u64;
        self.iterations = found.iterations;
    }

    /// Accepted and wrong: what must not happen.
    pub fn is_wrong_but_accepted(&self) -> bool {
        self.judged && self.accepted && !self.right
    }
}

/// The doubts of a registration in one sentence; `None`: accepted.
pub fn reason(found: &Registration) -> Option<String> {
    let doubts: Vec<String> = found.doubts.iter().map(ToString::to_string).collect();
    match (found.accepted, doubts.is_empty()) {
        (true, _) => None,
        (false, true) => Some("not accepted".to_owned()),
        (false, false) => Some(doubts.join("; ")),
    }
}

/// How far a pose is from the truth.
struct Error {
    rotation_deg: f64,
    translation_m: f64,
}

impl Error {
    fn of(pair: &Pair, pose: &Isometry3<f64>, truth: &Isometry3<f64>) -> Self {
        let centre = centroid(&pair.moving);
        Self {
            rotation_deg: angle_between(&pose.rotation, &truth.rotation).to_degrees(),
            translation_m: (pose * centre - truth * centre).norm(),
        }
    }

    fn is_right(&self) -> bool {
        self.rotation_deg < RIGHT_DEG && self.translation_m < RIGHT_M
    }
}

/// The truth, or the pose nearest to the one found in which a symmetric target looks the same.
fn nearest_truth(pair: &Pair, truth: &Isometry3<f64>, pose: &Isometry3<f64>) -> Isometry3<f64> {
    let Some((kind, t_kinect_body)) = &pair.body else { return *truth };
    let found = t_kinect_body.inverse() * truth.inverse() * pose * t_kinect_body;
    truth * t_kinect_body * symmetry::nearest(*kind, &found) * t_kinect_body.inverse()
}

/// The mean of a cloud's points.
pub fn centroid(cloud: &Cloud) -> Point3<f64> {
    let sum: Vector3<f64> = cloud.points.iter().map(|point| point.coords.cast::<f64>()).sum();
    Point3::from(sum / cloud.points.len().max(1) as f64)
}

fn point_error_m(cloud: &Cloud, pose: &Isometry3<f64>, truth: &Isometry3<f64>) -> f64 {
    let off = |point: &Point3<f32>| {
        let point = point.cast::<f64>();
        (pose * point - truth * point).norm_squared()
    };
    (cloud.points.iter().map(off).sum::<f64>() / cloud.points.len().max(1) as f64).sqrt()
}

/// `ξᵀ Σ⁻¹ ξ` with `truth = Exp(ξ) pose`; `None`: no covariance that can be inverted.
fn nees(pose: &Isometry3<f64>, covariance: &Matrix6<f64>, truth: &Isometry3<f64>) -> Option<f64> {
    let error = Twist::log(&(truth * pose.inverse())).vector();
    covariance.cholesky().map(|root| error.dot(&root.solve(&error))).and_then(finite)
}

fn finite(number: f64) -> Option<f64> {
    number.is_finite().then_some(number)
}

/// Evenly over the sphere.
fn direction(noise: &mut Noise) -> Vector3<f64> {
    let mut number = || noise.normal();
    Vector3::new(number(), number(), number()).try_normalize(1e-9).unwrap_or_else(Vector3::x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion};
    use tumbled_core::register::{SensorKind, View};
    use tumbled_sim::target::TargetKind;

    fn truth() -> Isometry3<f64> {
        let turn = UnitQuaternion::from_euler_angles(0.4, -1.0, 2.0);
        Isometry3::from_parts(Translation3::new(0.3, -0.1, 2.0), turn)
    }

    fn pair(kind: TargetKind) -> Pair {
        let points = (0..27).map(|n| Point3::new((n % 3) as f32, (n / 3 % 3) as f32, (n / 9) as f32 + 1.0)).collect();
        let cloud =
            |points| Cloud { sensor: SensorKind::Kinect, points, viewpoint: Some(Point3::origin()), view: View::Bare };
        let t_kinect_body = Isometry3::translation(1.0, 1.0, 2.0);
        Pair {
            index: 3,
            moving: cloud(points),
            reference: cloud(Vec::new()),
            truth: Some(truth()),
            body: Some((kind, t_kinect_body)),
            overlap: None,
            sights_deg: None,
        }
    }

    #[test]
    fn a_prior_is_off_by_exactly_what_it_says() {
        let pair = pair(TargetKind::BoxBus);
        assert_eq!(Start::Global.prior(&pair, 1), None);
        let prior = Start::PRIOR.prior(&pair, 1).expect("a prior");
        let error = Error::of(&pair, &prior.t_reference_moving, &truth());
        assert!((error.rotation_deg - 10.0).abs() < 1e-9 && (error.translation_m - 0.1).abs() < 1e-12);
        assert_ne!(Start::PRIOR.prior(&pair, 2), Some(prior));
        assert_eq!(Start::PRIOR.name(), "10 deg / 10 cm");
    }

    /// Σ = (0.01)² I and an error of 0.02 about one axis: (0.02/0.01)² = 4.
    #[test]
    fn nees_is_the_error_in_units_of_the_covariance() {
        let pose = truth();
        let off = Twist::new(Vector3::z() * 0.02, Vector3::zeros()).exp();
        let found = nees(&pose, &(Matrix6::identity() * 1e-4), &(off * pose)).expect("a covariance");
        assert!((found - 4.0).abs() < 1e-9, "{found}");
        assert_eq!(nees(&pose, &Matrix6::zeros(), &pose), None);
    }

    #[test]
    fn a_quarter_turn_of_a_cube_is_wrong_but_looks_right() {
        for (kind, looks_right) in [(TargetKind::Cube, true), (TargetKind::BoxBus, false)] {
            let pair = pair(kind);
            let (_, t_kinect_body) = pair.body.expect("a body");
            let quarter = UnitQuaternion::from_scaled_axis(Vector3::y() * core::f64::consts::FRAC_PI_2);
            let pose = truth() * t_kinect_body * quarter * t_kinect_body.inverse();
            let error = Error::of(&pair, &pose, &truth());
            assert!((error.rotation_deg - 90.0).abs() < 1e-9 && !error.is_right());
            assert_eq!(Error::of(&pair, &pose, &nearest_truth(&pair, &truth(), &pose)).is_right(), looks_right);
        }
    }

    /// A turn of 2° about an axis through the centroid leaves it where it is.
    #[test]
    fn position_is_judged_at_the_moving_clouds_centroid() {
        let pair = pair(TargetKind::BoxBus);
        let centre = centroid(&pair.moving);
        assert!((centre - Point3::new(1.0, 1.0, 2.0)).norm() < 1e-12);
        let there = truth() * centre;
        let turn = UnitQuaternion::from_scaled_axis(Vector3::x() * 2f64.to_radians());
        let pose = Translation3::from(there.coords) * turn * Translation3::from(-there.coords) * truth();
        let error = Error::of(&pair, &pose, &truth());
        assert!((error.rotation_deg - 2.0).abs() < 1e-9 && error.translation_m < 1e-12 && error.is_right());
    }
}
