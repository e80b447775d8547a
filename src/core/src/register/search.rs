//! The search over all rotations, or about a guess: many short descents, cut by what the sensors' lines of sight allow.
//! Method.md §3.3 and §3.4b.
//!
//! ```text
//!   starts ─▶ descend (48 probes, wide kernel) ─▶ score, keep a fifth ─▶ descend (96, narrower) ─▶ score, distinct
//!          ─▶ descend (all, up to the rim) ─▶ score, distinct ─▶ polish the best on the score ─▶ half and quarter turns
//! ```

use super::descend::{Probes, Schedule, descend};
use super::modes::{Candidate, SAME, distinct, sort};
use super::pose::Pose;
use super::score::{PROBES, Scorer};
use super::starts;
use crate::surface::Surface;
use crate::workers::Workers;
use nalgebra::{Isometry3, Matrix3, Point3, UnitQuaternion, Vector3};

/// How a search goes.
#[derive(Clone, Debug, PartialEq)]
pub struct SearchOptions {
    /// Rotations of a search over all of SO(3).
    pub rotations: usize,
    /// Where the centroids are laid on each other, in sight-line corrections: 0 as they are, 1 each moved back by its
    /// cloud's depth. Two views of a body have two centroids (method.md §3.3).
    pub shifts: Vec<f64>,
    /// Starts about a guess, and how far they turn from it, rad.
    pub ball: (usize, f64),
    /// The share of the starts that survives the first cut, and the least number that does.
    pub keep: (f64, usize),
    /// Candidates after the second cut.
    pub candidates: usize,
    /// Candidates that are polished, of a search over everything and of one about a guess.
    pub polished: (usize, usize),
}

impl Default for SearchOptions {
    fn default() -> Self {
        Self {
            rotations: 1500,
            shifts: vec![0.0, 0.5, 1.0],
            ball: (96, 15.0 / 180.0 * core::f64::consts::PI),
            keep: (0.2, 24),
            candidates: 60,
            polished: (8, 2),
        }
    }
}

/// Sparse points of the first descents, and of the second.
const FIRST: usize = 48;
const SECOND: usize = 96;
/// Sparse points of everything after: more cost time and change nothing, for they are spread evenly.
const MOST: usize = 400;
/// Dense points of the scores at the cuts.
const DENSE_AT_CUTS: [usize; 2] = [96, 192];

const WIDE: Schedule = Schedule { probes: FIRST, steps: 6, from_m: 0.25, to_m: 0.12, rim_m: f32::INFINITY };
const NARROW: Schedule = Schedule { probes: SECOND, steps: 8, from_m: 0.12, to_m: 0.05, rim_m: f32::INFINITY };
/// From a half or quarter turn of an answer.
const TURNED: Schedule = Schedule { probes: SECOND, steps: 8, from_m: 0.15, to_m: 0.05, rim_m: f32::INFINITY };
const LAST: Schedule = Schedule { probes: MOST, steps: 6, from_m: 0.08, to_m: 0.045, rim_m: f32::INFINITY };
const POLISHING: Schedule = Schedule { probes: MOST, steps: 3, from_m: 0.05, to_m: 0.04, rim_m: f32::INFINITY };

/// One search of a sparse cloud's pose on a dense cloud's surface.
pub(super) struct Search<'a> {
    surface: &'a Surface,
    scorer: &'a Scorer<'a>,
    options: &'a SearchOptions,
    workers: &'a Workers,
    probes: Probes,
    /// The sparse points, evenly spread first.
    points: Vec<Point3<f32>>,
    /// How far beyond the surface's points a probe may lie along it, m.
    rim_m: f32,
}

impl<'a> Search<'a> {
    /// `points`: the sparse cloud's, finite, the widest spread first ([`crate::surface::farthest_points`]).
    pub(super) fn new(
        surface: &'a Surface,
        scorer: &'a Scorer<'a>,
        mut points: Vec<Point3<f32>>,
        centroid: Point3<f64>,
        viewpoint: Option<Point3<f32>>,
        options: &'a SearchOptions,
        workers: &'a Workers,
    ) -> Self {
        points.truncate(MOST);
        let probes = Probes::new(&points, centroid, viewpoint);
        Self { surface, scorer, options, workers, probes, points, rim_m: 2.0 * surface.spacing_m() + 0.01 }
    }

    /// The most points a search uses.
    pub(super) const MOST: usize = MOST;

    /// The sparse points in use.
    pub(super) fn points(&self) -> &[Point3<f32>] {
        &self.points
    }

    /// How far beyond the surface's points a probe may lie along it, m.
    pub(super) fn rim_m(&self) -> f64 {
        self.rim_m.into()
    }

    /// Candidates from everywhere, best first. `sparse` and `dense`: where the clouds lie.
    pub(super) fn everywhere(&self, sparse: &Sight, dense: &Sight) -> Vec<Candidate> {
        let centers = self.options.shifts.iter().map(|shift| (*shift, dense.corrected(*shift)));
        let starts: Vec<Pose> = centers
            .flat_map(|(shift, center)| {
                // The sparse cloud's corrected centroid lies `along` from its centroid.
                let along = sparse.direction * (shift * sparse.depth_m);
                starts::everywhere(self.options.rotations)
                    .map(move |rotation| Pose::new(&rotation, center.coords - rotation * along))
            })
            .collect();
        let mut found = self.winnowed(&starts, self.options.polished.0);
        let turned = self.turned(&found, sparse, dense);
        found.extend(turned);
        sort(&mut found);
        distinct(&found, SAME, usize::MAX)
    }

    /// Candidates about a guess, best first.
    pub(super) fn near(&self, guess: &Isometry3<f64>) -> Vec<Candidate> {
        let pose = Pose::of(guess, &self.probes.centroid);
        let (count, radius_rad) = self.options.ball;
        let starts: Vec<Pose> =
            starts::ball(count, radius_rad).map(|turn| pose.moved(&turn, &Vector3::zeros())).collect();
        self.winnowed(&starts, self.options.polished.1)
    }

    /// The cuts from many starts to a few candidates, best first.
    fn winnowed(&self, starts: &[Pose], polished: usize) -> Vec<Candidate> {
        let options = self.options;
        let [few, more] = DENSE_AT_CUTS;
        let mut all = self.descents(starts, &WIDE, SECOND, few);
        sort(&mut all);
        let kept = ((starts.len() as f64 * options.keep.0) as usize).max(options.keep.1);
        let best: Vec<Pose> = all.iter().take(kept).map(|candidate| candidate.pose).collect();
        let mut all = self.descents(&best, &NARROW, SECOND, more);
        sort(&mut all);
        let best: Vec<Pose> = distinct(&all, SAME, options.candidates).iter().map(|candidate| candidate.pose).collect();
        let mut all = self.descents(&best, &Schedule { rim_m: self.rim_m, ..LAST }, MOST, PROBES);
        sort(&mut all);
        let mut all = distinct(&all, SAME, usize::MAX);
        self.polish(&mut all, polished);
        sort(&mut all);
        all
    }

    /// Descends from each pose and scores where it ended.
    fn descents(&self, poses: &[Pose], schedule: &Schedule, sparse: usize, dense: usize) -> Vec<Candidate> {
        self.workers.map(poses, |pose| {
            let pose = descend(self.surface, &self.probes, pose, schedule);
            Candidate { pose, score: self.score(&pose, sparse, dense) }
        })
    }

    /// The score of a pose by the first `sparse` points and `dense` points of the surface.
    pub(super) fn score(&self, pose: &Pose, sparse: usize, dense: usize) -> f32 {
        let points = self.points.get(..sparse).unwrap_or(&self.points);
        self.scorer.score(&pose.placement(&self.probes.centroid), points, dense) as f32
    }

    /// Half and quarter turns of the two best answers: what a body of boxes is confused by. A gap says nothing before they
    /// were tried.
    fn turned(&self, found: &[Candidate], sparse: &Sight, dense: &Sight) -> Vec<Candidate> {
        let mut starts = Vec::new();
        for base in found.iter().take(2) {
            let (middle, axes) = self.principal(&base.pose, sparse, dense);
            // About the middle of what was seen, and about where the body's own may be.
            for middle in [middle, middle + dense.direction * dense.depth_m] {
                for turn in starts::confusions(&axes) {
                    let matrix = turn.to_rotation_matrix().into_inner();
                    let center = matrix * (base.pose.center.cast::<f64>() - middle) + middle;
                    let rotation = matrix * base.pose.rotation.cast::<f64>();
                    starts.push(Pose { rotation: rotation.cast(), center: center.cast() });
                }
            }
        }
        let poses: Vec<Pose> = self.workers.map(&starts, |start| descend(self.surface, &self.probes, start, &TURNED));
        let mut all = self.descents(&poses, &Schedule { rim_m: self.rim_m, ..LAST }, MOST, PROBES);
        sort(&mut all);
        self.polish(&mut all, 3);
        all
    }

    /// The middle and the principal axes of both clouds together.
    fn principal(&self, pose: &Pose, sparse: &Sight, dense: &Sight) -> (Vector3<f64>, [Vector3<f64>; 3]) {
        let rotation = pose.rotation.cast::<f64>();
        let middle = (pose.center.cast::<f64>() + dense.centroid.coords) * 0.5;
        let apart = pose.center.cast::<f64>() - dense.centroid.coords;
        // Of two clouds of equal weight: the mean of their covariances and what lies between their centroids.
        let covariance = (rotation * sparse.covariance * rotation.transpose() + dense.covariance) * 0.5
            + apart * apart.transpose() * 0.25;
        let eigen = covariance.symmetric_eigen();
        let axis = |index| eigen.eigenvectors.column(index).into_owned();
        (middle, [axis(0), axis(1), axis(2)])
    }

    /// Improves the first `count` candidates on the score itself: samples about each, a few steps from the best.
    fn polish(&self, candidates: &mut [Candidate], count: usize) {
        let first: Vec<Candidate> = candidates.iter().take(count).copied().collect();
        let better = self.workers.map(&first, |candidate| self.polished(candidate));
        for (candidate, better) in candidates.iter_mut().zip(better) {
            *candidate = better;
        }
    }

    fn polished(&self, candidate: &Candidate) -> Candidate {
        const ROUNDS: usize = 3;
        const SAMPLES: usize = 24;
        const BEST: usize = 3;
        let schedule = Schedule { rim_m: self.rim_m, ..POLISHING };
        let mut best = *candidate;
        let mut scale = 1.0;
        for round in 0..ROUNDS {
            let offsets = starts::scatter(SAMPLES, round * SAMPLES);
            let mut around: Vec<Candidate> = offsets
                .map(|(turn, step)| {
                    let pose = best.pose.moved(&(turn * (SPREAD.0 * scale)), &(step * (SPREAD.1 * scale)));
                    Candidate { pose, score: self.score(&pose, MOST, DENSE_AT_CUTS[1]) }
                })
                .collect();
            sort(&mut around);
            for sample in around.iter().take(BEST) {
                let stepped = descend(self.surface, &self.probes, &sample.pose, &schedule);
                for pose in [sample.pose, stepped] {
                    let score = self.score(&pose, MOST, PROBES);
                    if score > best.score {
                        best = Candidate { pose, score };
                    }
                }
            }
            scale *= 0.6;
        }
        best
    }

    /// How far, in root mean square, poses about this one go whose scores are as good: rad and m.
    pub(super) fn spread(&self, candidate: &Candidate) -> (f64, f64) {
        const SAMPLES: usize = 64;
        /// Score to log weight.
        const SHARPNESS: f64 = 40.0;
        let offsets: Vec<_> = starts::scatter(SAMPLES, 0).collect();
        let scored = self.workers.map(&offsets, |(turn, step)| {
            let (turn, step) = (turn * SPREAD.0, step * SPREAD.1);
            let pose = candidate.pose.moved(&turn, &step);
            (f64::from(self.score(&pose, MOST, DENSE_AT_CUTS[1])), turn.norm_squared(), step.norm_squared())
        });
        let own = f64::from(self.score(&candidate.pose, MOST, DENSE_AT_CUTS[1]));
        let best = scored.iter().map(|(score, ..)| *score).fold(own, f64::max);
        let mut sums = [libm::exp(SHARPNESS * (own - best)), 0.0, 0.0];
        for (score, turn, step) in scored {
            let weight = libm::exp(SHARPNESS * (score - best));
            let [all, turns, steps] = &mut sums;
            *all += weight;
            *turns += weight * turn;
            *steps += weight * step;
        }
        let [all, turns, steps] = sums;
        (libm::sqrt(turns / all), libm::sqrt(steps / all))
    }
}

/// The scatter of samples about a pose: each axis of rotation, rad (5°), and of translation, m.
const SPREAD: (f64, f64) = (5.0 / 180.0 * core::f64::consts::PI, 0.03);

/// Where a cloud lies, as its sensor sees it.
#[derive(Clone, Debug)]
pub(super) struct Sight {
    /// The mean of its points, m.
    pub(super) centroid: Point3<f64>,
    /// Their covariance, m².
    pub(super) covariance: Matrix3<f64>,
    /// From the sensor to the centroid, of length 1; nothing where nobody knows the sensor's place.
    pub(super) direction: Vector3<f64>,
    /// How far behind the seen points' centroid the body's own may lie: the lesser of the spreads across and along, m.
    pub(super) depth_m: f64,
}

impl Sight {
    /// Of finite points.
    pub(super) fn of(points: &[Point3<f32>], viewpoint: Option<&Point3<f32>>) -> Self {
        let count = points.len().max(1) as f64;
        let centroid =
            Point3::from(points.iter().map(|point| point.coords.cast::<f64>()).sum::<Vector3<f64>>() / count);
        let mut covariance = Matrix3::zeros();
        for point in points {
            let offset = point.cast::<f64>() - centroid;
            covariance += offset * offset.transpose();
        }
        covariance /= count;
        let direction = viewpoint
            .and_then(|from| (centroid - from.cast::<f64>()).try_normalize(1e-6))
            .unwrap_or_else(Vector3::zeros);
        let along = direction.dot(&(covariance * direction));
        let across = (covariance.trace() - along) * 0.5;
        Self { centroid, covariance, direction, depth_m: libm::sqrt(across.min(along).max(0.0)) }
    }

    /// The centroid, moved back along the sight by a share of the depth.
    pub(super) fn corrected(&self, shift: f64) -> Point3<f64> {
        self.centroid + self.direction * (shift * self.depth_m)
    }
}

/// The angle between two sights of one body after a pose, rad.
pub(super) fn angle_between_sights(sparse: &Sight, dense: &Sight, rotation: &UnitQuaternion<f64>) -> f64 {
    libm::acos((rotation * sparse.direction).dot(&dense.direction).clamp(-1.0, 1.0))
}
