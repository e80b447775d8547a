//! The search over all rotations, or about a guess: many short descents, cut by what the sensors' lines of sight allow.
//! Method.md §3.3 and §3.4b.
//!
//! ```text
//!   starts ─▶ a glance: 24 probes, 3 steps, score, keep a fifth ─▶ descend (48 probes, wide kernel) ─▶ score, distinct
//!          ─▶ descend (96, narrower) ─▶ score, distinct ─▶ descend (all, up to the rim) ─▶ score, distinct
//!          ─▶ polish the best on the score ─▶ half and quarter turns
//! ```

use super::check::CheckedPoints;
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
    /// The share of the starts everywhere that survives the first cut, and the least number that does: of those about a
    /// guess so many survive.
    pub keep: (f64, usize),
    /// Different places after the wide descents.
    pub places: usize,
    /// Candidates after the narrow ones.
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
            places: 400,
            candidates: 60,
            polished: (8, 2),
        }
    }
}

/// A descent and what its end is scored by.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Stage {
    schedule: Schedule,
    /// Sparse points of the score.
    sparse: usize,
    /// Dense points of the score.
    dense: usize,
}

impl Stage {
    const fn new(probes: usize, steps: u32, [from_m, to_m]: [f32; 2], sparse: usize, dense: usize) -> Self {
        Self { schedule: Schedule { probes, steps, from_m, to_m, rim_m: f32::INFINITY }, sparse, dense }
    }

    /// The same, with probes that may leave their surface's rim only so far, m.
    fn within(self, rim_m: f32) -> Self {
        Self { schedule: Schedule { rim_m, ..self.schedule }, ..self }
    }
}

/// Sparse points used at most: more cost time and change nothing, for they are spread evenly.
const MOST: usize = 400;
/// Enough to tell the starts that lead nowhere.
const GLANCE: Stage = Stage::new(24, 3, [0.25, 0.17], 48, 48);
const WIDE: Stage = Stage::new(48, 4, [0.17, 0.12], 96, 96);
/// The same about a guess: there are so few starts that none is told by a glance.
const ABOUT: Stage = Stage::new(48, 6, [0.25, 0.12], 96, 96);
const NARROW: Stage = Stage::new(96, 8, [0.12, 0.05], 96, 192);
/// From a half or quarter turn of an answer.
const TURNED: Stage = Stage::new(96, 8, [0.15, 0.05], 96, 192);
const LAST: Stage = Stage::new(MOST, 6, [0.08, 0.045], MOST, PROBES);
/// Of a polished candidate, round by round: its samples are scored, first by few points, and steps descend with all.
const POLISHING: [Stage; 3] = [
    Stage::new(MOST, 3, [0.05, 0.04], 128, 96),
    Stage::new(MOST, 3, [0.05, 0.04], 128, 96),
    Stage::new(MOST, 3, [0.05, 0.04], MOST, 192),
];

/// Nearer than this, rad and m, two descents on their way come to the same place: 3° and 3 cm.
const MERGED: (f32, f32) = (3.0 / 180.0 * core::f32::consts::PI, 0.03);
/// A candidate that scores by so much less than the best after each round of polishing never becomes the best: a round
/// gains less, and its probability beside the best is below 1/1000.
const HOPELESS: [f32; 3] = [0.3, 0.2, 0.2];
/// A turned answer that scores by so much less than the best before its last descent; and how many of them there may be.
const TURNED_WORSE: f32 = 0.4;
const TURNED_MOST: usize = 12;

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
        let (share, least) = self.options.keep;
        let mut found = self.descents(&starts, &GLANCE);
        found.truncate(((starts.len() as f64 * share) as usize).max(least));
        let found = self.descents(&poses(&found), &WIDE);
        // Hundreds of starts come to the same place: from there one is enough.
        let mut found = self.narrowed(&distinct(&found, MERGED, self.options.places), self.options.polished.0);
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
        let mut found = self.descents(&starts, &ABOUT);
        found.truncate(self.options.keep.1);
        self.narrowed(&found, self.options.polished.1)
    }

    /// From the ends of wide descents to a few candidates, best first.
    fn narrowed(&self, wide: &[Candidate], polished: usize) -> Vec<Candidate> {
        let found = self.descents(&poses(wide), &NARROW);
        let found = distinct(&found, SAME, self.options.candidates);
        let found = self.descents(&poses(&found), &LAST.within(self.rim_m));
        self.polish(distinct(&found, SAME, usize::MAX), polished)
    }

    /// Descends from each pose and scores where it ended; best first.
    fn descents(&self, poses: &[Pose], stage: &Stage) -> Vec<Candidate> {
        let mut found = self.workers.map(poses, |pose| {
            let pose = descend(self.surface, &self.probes, pose, &stage.schedule);
            Candidate { pose, score: self.score(&pose, stage.sparse, stage.dense) }
        });
        sort(&mut found);
        found
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
        let is_new = |one: &Candidate, (angle, distance): (f32, f32)| {
            found.iter().take(TURNED_MOST).all(|other| !other.pose.is_near(&one.pose, angle, distance))
        };
        let least = found.first().map_or(f32::NEG_INFINITY, |best| best.score - TURNED_WORSE);
        let mut turned = distinct(&self.descents(&starts, &TURNED), MERGED, usize::MAX);
        turned.retain(|one| one.score > least && is_new(one, MERGED));
        turned.truncate(TURNED_MOST);
        let mut last = distinct(&self.descents(&poses(&turned), &LAST.within(self.rim_m)), SAME, usize::MAX);
        last.retain(|one| is_new(one, SAME));
        self.polish(last, 3)
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

    /// Improves the first `count` candidates on the score itself: samples about each, a few steps from the best. Those that
    /// come to the place of a better one are left out, those that fall far behind stay as they are. Best first.
    fn polish(&self, mut candidates: Vec<Candidate>, count: usize) -> Vec<Candidate> {
        let mut done = candidates.split_off(count.min(candidates.len()));
        for ((round, stage), margin) in (0..).zip(&POLISHING).zip(HOPELESS) {
            let mut better = self.workers.map(&candidates, |candidate| self.polished(candidate, round, stage));
            sort(&mut better);
            let least = better.first().map_or(0.0, |best| best.score - margin);
            let (hopeful, hopeless): (Vec<_>, Vec<_>) =
                distinct(&better, MERGED, usize::MAX).into_iter().partition(|candidate| candidate.score >= least);
            candidates = hopeful;
            done.extend(hopeless);
        }
        candidates.extend(done);
        sort(&mut candidates);
        candidates
    }

    /// The best of a candidate, samples about it, and steps from the best of these. Each round scatters less.
    fn polished(&self, candidate: &Candidate, round: i32, stage: &Stage) -> Candidate {
        const SAMPLES: usize = 24;
        const BEST: usize = 3;
        let Stage { schedule, sparse, dense } = stage.within(self.rim_m);
        let scale = libm::pow(0.6, f64::from(round));
        let offsets = starts::scatter(SAMPLES, round as usize * SAMPLES);
        let mut around: Vec<Candidate> = offsets
            .map(|(turn, step)| {
                let pose = candidate.pose.moved(&(turn * (SPREAD.0 * scale)), &(step * (SPREAD.1 * scale)));
                Candidate { pose, score: self.score(&pose, sparse, dense) }
            })
            .collect();
        sort(&mut around);
        let mut best = *candidate;
        for sample in around.iter().take(BEST) {
            let stepped = descend(self.surface, &self.probes, &sample.pose, &schedule);
            for pose in [sample.pose, stepped] {
                let score = self.score(&pose, MOST, PROBES);
                if score > best.score {
                    best = Candidate { pose, score };
                }
            }
        }
        best
    }

    /// How far, in root mean square, poses about this one go whose scores are as good: rad and m.
    pub(super) fn spread(&self, candidate: &Candidate) -> (f64, f64) {
        const SAMPLES: usize = 64;
        /// Dense points of their scores.
        const FLATNESS: usize = 192;
        /// Score to log weight.
        const SHARPNESS: f64 = 40.0;
        let offsets: Vec<_> = starts::scatter(SAMPLES, 0).collect();
        let scored = self.workers.map(&offsets, |(turn, step)| {
            let (turn, step) = (turn * SPREAD.0, step * SPREAD.1);
            let pose = candidate.pose.moved(&turn, &step);
            (f64::from(self.score(&pose, MOST, FLATNESS)), turn.norm_squared(), step.norm_squared())
        });
        let own = f64::from(self.score(&candidate.pose, MOST, FLATNESS));
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

fn poses(found: &[Candidate]) -> Vec<Pose> {
    found.iter().map(|candidate| candidate.pose).collect()
}

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
    /// Of a cloud's points.
    pub(super) fn of(points: &CheckedPoints, viewpoint: Option<&Point3<f32>>) -> Self {
        let (centroid, covariance) = (points.centroid, points.covariance);
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
