//! The default method: search, judge, refine, and say how sure it is.

use super::check::{CheckedPoints, check_cloud, check_prior};
use super::freespace::FreeSpace;
use super::freespace::rings::{Direction, Rings};
use super::modes::{Candidate, OTHER, distinct, probabilities, sort};
use super::refine::{Probe, RefineOptions, RefinePrior, Refined, refine};
use super::score::{PROBES, Parts, Scorer, Weights};
use super::search::{Search, SearchOptions, Sight, angle_between_sights};
use super::{Cloud, Doubt, Mode, Prior, RegisterError, Registration, SensorKind};
use crate::surface::noise::{BEAM_SCATTER_M, PointNoise};
use crate::surface::{Surface, SurfaceOptions, farthest_points};
use crate::workers::Workers;
use nalgebra::{Isometry3, Matrix6, Point3, Vector3};
use tumbled_model::se3::{adjoint, angle_between, exp_rotation, log_rotation};

/// Settings of the default method.
#[derive(Clone, Debug, PartialEq)]
pub struct CgaOptions {
    /// The search.
    pub search: SearchOptions,
    /// Whether patches may be spheres (else planes).
    pub curvature: bool,
    /// Whether lines of sight count.
    pub free_space: bool,
    /// When a result is a measurement.
    pub acceptance: Acceptance,
}

impl Default for CgaOptions {
    fn default() -> Self {
        Self { search: SearchOptions::default(), curvature: true, free_space: true, acceptance: Acceptance::default() }
    }
}

/// When a result is a measurement. Method.md §3.4b and §4.6; a campaign fixes the numbers by the share of wrong accepted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Acceptance {
    /// Least probability of the mode.
    pub probability: f64,
    /// Least share of points on the surface.
    pub support: f64,
    /// Largest spread of poses as good, degrees.
    pub spread_deg: f64,
    /// Largest shares of points that the other sensor would have seen: of those in front of what it saw, and of all with
    /// those where it saw nothing.
    pub violated: (f64, f64),
    /// Largest standard deviations, of the three axes together: rotation, degrees, and translation at the centroid, m.
    pub sigma: (f64, f64),
    /// Least information of the weakest direction, relative to the median's.
    pub information: f64,
    /// Largest residuals, in what noise explains.
    pub residuals: f64,
    /// Largest angle between the sights of a result without a prior, degrees.
    pub sights_deg: f64,
}

impl Default for Acceptance {
    fn default() -> Self {
        Self {
            probability: 0.98,
            support: 0.4,
            spread_deg: 4.0,
            violated: (0.04, 0.08),
            sigma: (4.5, 0.03),
            information: 1e-3,
            residuals: 1.35,
            sights_deg: 70.0,
        }
    }
}

/// Log odds for a score's unit, at 358 sparse points; grows with the root of their number (method.md §3.4b).
const BETA: f64 = 35.0;
const BETA_POINTS: f64 = 358.0;

/// Registers the moving cloud onto the reference.
///
/// # Errors
/// [`RegisterError`]: clouds or a prior that cannot be registered with.
pub fn cga(
    moving: &Cloud,
    reference: &Cloud,
    prior: Option<&Prior>,
    options: &CgaOptions,
    workers: &Workers,
) -> Result<Registration, RegisterError> {
    let (checked_moving, checked_reference) = (check_cloud(moving, "moving")?, check_cloud(reference, "reference")?);
    prior.map(check_prior).transpose()?;
    // The denser cloud is the surface.
    let swapped = checked_moving.points.len() > checked_reference.points.len();
    let (sparse, dense) = if swapped { (reference, moving) } else { (moving, reference) };
    let (probes, surface) =
        if swapped { (checked_reference, checked_moving) } else { (checked_moving, checked_reference) };
    let guess = prior.map(|prior| to_surface(prior, swapped));
    let answer = Problem { sparse, dense, probes: &probes, whole: &surface, options, workers }.solve(guess.as_ref());
    Ok(if swapped { inverted(answer) } else { answer })
}

/// The prior in the direction of the search: probes to surface.
fn to_surface(prior: &Prior, swapped: bool) -> RefinePrior {
    let guess = &prior.t_reference_moving;
    let transform = if swapped { guess.inverse() } else { *guess };
    RefinePrior { transform, sigma: (prior.sigma_rotation_rad, prior.sigma_translation_m) }
}

/// The same answer for the clouds' other order.
fn inverted(answer: Registration) -> Registration {
    let back = answer.t_reference_moving.inverse();
    // (Exp(ξ) T)⁻¹ = Exp(−Ad(T⁻¹) ξ) T⁻¹.
    let adjoint = adjoint(&back);
    let covariance = adjoint * answer.covariance * adjoint.transpose();
    let alternatives = answer
        .alternatives
        .iter()
        .map(|mode| Mode { t_reference_moving: mode.t_reference_moving.inverse(), ..*mode })
        .collect();
    Registration {
        t_reference_moving: back,
        covariance: (covariance + covariance.transpose()) * 0.5,
        alternatives,
        ..answer
    }
}

/// A sparse cloud to be laid on a dense one.
struct Problem<'a> {
    sparse: &'a Cloud,
    dense: &'a Cloud,
    probes: &'a CheckedPoints,
    whole: &'a CheckedPoints,
    options: &'a CgaOptions,
    workers: &'a Workers,
}

impl Problem<'_> {
    /// Probes to surface.
    fn solve(&self, guess: Option<&RefinePrior>) -> Registration {
        let options = self.options;
        let surface_options = SurfaceOptions { curved: options.curvature, ..SurfaceOptions::default() };
        let surface = Surface::build(self.dense, &surface_options);
        let weights = if options.free_space { Weights::SIGHTS_STRICT } else { Weights::SUPPORT };
        let scorer = Scorer::new(&surface, self.dense, self.sparse, weights);
        let (points, centroid) = (spread_first(&self.probes.points), self.probes.centroid);
        let search =
            Search::new(&surface, &scorer, points, centroid, self.sparse.viewpoint, &options.search, self.workers);
        let sparse = Sight::of(self.probes, self.sparse.viewpoint.as_ref());
        let dense = Sight::of(self.whole, self.dense.viewpoint.as_ref());
        let found = match guess {
            None => search.everywhere(&sparse, &dense),
            Some(guess) => self.within(search.near(&guess.transform), guess),
        };
        self.conclude(&search, &scorer, &surface, found, guess, (&sparse, &dense))
    }

    /// Scores with what the guess says: its log density, in units of the score.
    fn within(&self, mut found: Vec<Candidate>, guess: &RefinePrior) -> Vec<Candidate> {
        let beta = self.beta();
        for candidate in &mut found {
            let pose = candidate.pose.isometry(&self.probes.centroid);
            let turn = angle_between(&pose.rotation, &guess.transform.rotation) / guess.sigma.0;
            let shift = (pose * self.probes.centroid - guess.transform * self.probes.centroid).norm() / guess.sigma.1;
            candidate.score -= (0.5 * (turn * turn + shift * shift) / beta) as f32;
        }
        sort(&mut found);
        found
    }

    /// Log odds of a unit of the score.
    fn beta(&self) -> f64 {
        BETA * libm::sqrt(self.probes.points.len() as f64 / BETA_POINTS)
    }

    /// Refines the best candidate and says how sure it is.
    fn conclude(
        &self,
        search: &Search<'_>,
        scorer: &Scorer<'_>,
        surface: &Surface,
        found: Vec<Candidate>,
        guess: Option<&RefinePrior>,
        (sparse, dense): (&Sight, &Sight),
    ) -> Registration {
        let modes = distinct(&found, OTHER, 8);
        let Some(best) = modes.first().copied() else { return nothing_found() };
        let chances = probabilities(&modes, self.beta());
        let (spread_rad, _) = search.spread(&best);
        let refined = self.refined(search, scorer, surface, &best, guess);
        let placed = refined.transform;
        let centroid = &self.probes.centroid;
        let parts = self.parts(search, scorer, &[placed, best.pose.isometry(centroid)]);
        let widening = self.widening(&parts);
        let alternatives = modes.iter().zip(&chances).skip(1).map(|(mode, chance)| Mode {
            t_reference_moving: mode.pose.isometry(centroid),
            score: f64::from(mode.score),
            probability: *chance,
        });
        let mut answer = Registration {
            t_reference_moving: placed,
            covariance: refined.covariance(centroid, widening),
            accepted: false,
            doubts: Vec::new(),
            score: f64::from(best.score),
            gap: modes.get(1).map(|second| f64::from(best.score - second.score)),
            probability: chances.first().copied().unwrap_or(1.0),
            inliers: refined.inliers,
            rmse_m: refined.rmse_m,
            weakest: refined.weakest(self.probes.radius_m),
            iterations: refined.iterations,
            alternatives: alternatives.collect(),
        };
        let sights = angle_between_sights(sparse, dense, &placed.rotation).to_degrees();
        answer.doubts = self.doubts(&answer, &refined, &parts, spread_rad.to_degrees(), sights, guess.is_some());
        answer.accepted = answer.doubts.is_empty();
        answer
    }

    /// What lines of sight say of the answer: they contradict it only if no pose does better that is as good by the noise.
    fn parts(&self, search: &Search<'_>, scorer: &Scorer<'_>, poses: &[Isometry3<f64>]) -> Parts {
        let of = |pose: &Isometry3<f64>| scorer.parts(&pose.into(), search.points(), PROBES);
        let score = |parts: &Parts| parts.score(scorer.weights());
        poses.iter().map(of).max_by(|a, b| score(a).total_cmp(&score(b))).unwrap_or_default()
    }

    /// The best candidate refined; as it was where the refinement led to what lines of sight contradict.
    fn refined(
        &self,
        search: &Search<'_>,
        scorer: &Scorer<'_>,
        surface: &Surface,
        best: &Candidate,
        guess: Option<&RefinePrior>,
    ) -> Refined {
        /// A refinement that costs more than this of the score has left the place: the noise of a score is a third of it.
        const COST: f64 = 0.1;
        /// The share of the searched pose in the answer. Its errors are other ones: lines of sight feel the silhouette, the
        /// least squares feel what lies on surfaces.
        const SEARCHED: f64 = 0.3;
        let noise = PointNoise::of(self.sparse.sensor, self.sparse.viewpoint, &self.probes.points);
        let rings = scorer.sparse_sights().and_then(FreeSpace::rings).zip(self.sparse.viewpoint.as_ref());
        let probe = |point: &Point3<f32>| match rings.and_then(|(rings, from)| beam(rings, from, point)) {
            Some(beam) => Probe { point: point.cast(), sigma_m: BEAM_SCATTER_M, beam: Some(beam) },
            None => Probe { point: point.cast(), sigma_m: f64::from(noise.sigma_m(point)), beam: None },
        };
        let probes: Vec<Probe> = self.probes.points.iter().map(probe).collect();
        let to_m = match self.sparse.sensor {
            SensorKind::Lidar => 0.045,
            SensorKind::Kinect => 0.03,
        };
        let (curvature, rim_m) = (self.options.curvature, search.rim_m());
        let options = RefineOptions { from_m: 0.06, to_m, curvature, rim_m, ..RefineOptions::default() };
        let start = best.pose.isometry(&self.probes.centroid);
        let viewpoint = self.sparse.viewpoint.map(|viewpoint| viewpoint.cast());
        let refined = refine(surface, &probes, viewpoint.as_ref(), &start, guess, &options);
        let score = |pose: &Isometry3<f64>| scorer.score(&pose.into(), search.points(), PROBES);
        if score(&refined.transform) >= score(&start) - COST {
            let transform = between(&refined.transform, &start, &self.probes.centroid, SEARCHED);
            return Refined { transform, ..refined };
        }
        let here = RefineOptions { iterations: 0, from_m: to_m, ..options };
        refine(surface, &probes, viewpoint.as_ref(), &start, guess, &here)
    }

    /// Where little of the sparse cloud lies on the surface, what lies there is less independent than it seems.
    fn widening(&self, parts: &Parts) -> f64 {
        let lacking = ((0.7 - parts.support) / 0.3).clamp(0.0, 1.0);
        1.0 + lacking
    }

    fn doubts(
        &self,
        answer: &Registration,
        refined: &Refined,
        parts: &Parts,
        spread_deg: f64,
        sights_deg: f64,
        guessed: bool,
    ) -> Vec<Doubt> {
        let limits = &self.options.acceptance;
        let mut doubts = Vec::new();
        if parts.support < limits.support {
            doubts.push(Doubt::Support { found: parts.support, needed: limits.support });
        }
        if answer.probability < limits.probability {
            doubts.push(Doubt::Ambiguous { probability: answer.probability });
        }
        if answer.weakest.1 < limits.information {
            doubts.push(Doubt::Degenerate { information: answer.weakest.1 });
        }
        if spread_deg > limits.spread_deg {
            doubts.push(Doubt::Vague { spread_deg });
        }
        let (in_front, all) = limits.violated;
        if parts.in_front() > in_front || parts.violated() > all {
            doubts.push(Doubt::LinesOfSight { violated: parts.violated() });
        }
        let sigma = refined.sigma(self.widening(parts));
        if sigma.0.to_degrees() > limits.sigma.0 || sigma.1 > limits.sigma.1 {
            doubts.push(Doubt::Uncertain { rotation_deg: sigma.0.to_degrees(), translation_m: sigma.1 });
        }
        if refined.rmse_m > limits.residuals * refined.expected_m {
            doubts.push(Doubt::Residuals { found_m: refined.rmse_m, expected_m: refined.expected_m });
        }
        if !guessed && sights_deg > limits.sights_deg {
            doubts.push(Doubt::FarSights { angle_deg: sights_deg });
        }
        doubts
    }
}

/// From one pose a share of the way to another: the centroid's image goes straight, the rotation the shortest way.
fn between(from: &Isometry3<f64>, to: &Isometry3<f64>, centroid: &Point3<f64>, share: f64) -> Isometry3<f64> {
    let turn = log_rotation(&(to.rotation * from.rotation.inverse()));
    let rotation = exp_rotation(&(turn * share)) * from.rotation;
    let center = (from * centroid).coords.lerp(&(to * centroid).coords, share);
    Isometry3::from_parts((center - rotation * centroid.coords).into(), rotation)
}

/// The beam of a point that lies on rings, and its line of sight from the viewpoint.
fn beam(rings: &Rings, from: &Point3<f32>, point: &Point3<f32>) -> Option<(usize, Vector3<f64>)> {
    let ray = point - from;
    Some((rings.of(Direction::of(&ray, 0.0).elevation)?, ray.cast::<f64>().try_normalize(1e-6)?))
}

/// The points that are spread the widest first, as many as a search uses.
fn spread_first(points: &[Point3<f32>]) -> Vec<Point3<f32>> {
    farthest_points(points, Search::MOST).into_iter().filter_map(|index| points.get(index as usize).copied()).collect()
}

/// No start led anywhere: every score was no number.
fn nothing_found() -> Registration {
    Registration {
        t_reference_moving: Isometry3::identity(),
        covariance: Matrix6::identity() * 1e9,
        accepted: false,
        doubts: vec![Doubt::NotConverged { iterations: 0 }],
        score: 0.0,
        gap: None,
        probability: 0.0,
        inliers: 0.0,
        rmse_m: 0.0,
        weakest: (nalgebra::Vector6::zeros(), 0.0),
        iterations: 0,
        alternatives: Vec::new(),
    }
}
