//! Our reconstruction of the published method: shells about the centroids, a descriptor of feature spheres, one closed
//! form.
//!
//! ```text
//!   clouds ─▶ subtract centroids ─▶ farthest point samples of the sparse cloud
//!                                     │  each: points of the dense cloud at the same distance from the centroid (shell)
//!                                     │        of those, the one whose descriptor is nearest, if it is near enough (gate)
//!                                     ▼
//!                              m pairs: sample point ↔ feature sphere of the dense cloud ─▶ motor in closed form
//! ```
//!
//! The steps are the paper's; its text has lost the equations, so every quantity in them is an option here, with the
//! default that reads the text most plainly ([`options`]). Nothing is added to make it succeed: on partial views the
//! centroids of the two clouds are 6 to 20 cm apart and most patches of a box are alike, so most pairs are wrong, and the
//! answer says so. `rounds` above 1 and `polish` are ours, off unless asked for. (Design note `method.md` §2.4, §3.1, §3.2.)

mod descriptor;
mod match_points;
pub mod options;
mod sample;

pub use options::{Candidate, Entries, Neighbourhood, PaperOptions, Sampled, ShellTolerance, SphereReading, Weighting};

use super::baseline::prepare::Prepared;
use super::baseline::verdict::{LEAST_INFORMATION, PairFit, covariance, judge, residuals, weakest};
use super::baseline::{IterationOptions, gicp};
use super::{Cloud, Doubt, Prior, RegisterError, Registration};
use crate::cga::{AlignmentError, PointPair, align};
use match_points::{Matcher, Pairs};
use nalgebra::{Isometry3, Matrix6, Translation3};

/// Pairs below which nothing is solved: three fix a motor, the fourth can contradict it.
const LEAST_PAIRS: usize = 4;
/// A neighbourhood's centre lies this share of its radius from its point, r.m.s.: 0 on open surfaces, 0.42 at their rims.
const CENTER_OFFSET: f64 = 0.25;

/// Registers with the reconstruction of the published method. It takes no prior: the centroids are its start.
///
/// The answer's covariance comes from the residuals of the pairs, wrong ones included; score, inliers and r.m.s. from the
/// clouds, as for every method. `gap` is `None` and `probability` 1: one pose is all it makes.
///
/// # Errors
/// Clouds that are none.
pub fn cga_paper(moving: &Cloud, reference: &Cloud, options: &PaperOptions) -> Result<Registration, RegisterError> {
    let (prepared_moving, prepared_reference) =
        (Prepared::new(moving, "moving")?, Prepared::new(reference, "reference")?);
    let found = solve(&prepared_moving, &prepared_reference, options);
    if let Some(polish) = options.polish {
        return polished(moving, reference, &found, &polish);
    }
    let verdict = judge(&found.pose, &prepared_moving, &prepared_reference);
    let mut registration = verdict.registration(found.pose, found.rounds, found.doubts);
    registration.covariance = found.covariance;
    Ok(registration)
}

/// What the pairs gave.
struct Solved {
    /// Moving to reference.
    pose: Isometry3<f64>,
    covariance: Matrix6<f64>,
    rounds: u32,
    doubts: Vec<Doubt>,
}

fn solve(moving: &Prepared, reference: &Prepared, options: &PaperOptions) -> Solved {
    let swapped = options.sampled == Sampled::Sparser && moving.points().len() < reference.points().len();
    let (samples_of, spheres_of) = if swapped { (moving, reference) } else { (reference, moving) };
    let mut matcher = Matcher::new(samples_of, spheres_of, options);
    // Sphere cloud to sample cloud: at first centroid to centroid.
    let mut pose: Isometry3<f64> = Translation3::from(samples_of.centroid() - spheres_of.centroid()).into();
    let (mut doubts, mut rounds) = (Vec::new(), 0);
    let mut pairs = Pairs::default();
    for round in 0..options.rounds.max(1) {
        let found = if round == 0 { matcher.by_shells() } else { matcher.by_place(&pose) };
        if found.pairs.len() < LEAST_PAIRS {
            doubts.push(Doubt::Pairs { found: found.pairs.len(), needed: LEAST_PAIRS });
            break;
        }
        rounds += 1;
        match align(&found.pairs, &[]) {
            Ok(alignment) => pose = alignment.motor.isometry().inverse(),
            Err(AlignmentError::Rotation { separation, .. }) => {
                doubts.push(Doubt::Degenerate { information: separation });
                break;
            }
            Err(_) => {
                doubts.push(Doubt::Degenerate { information: 0.0 });
                break;
            }
        }
        pairs = found;
    }
    let pose = if swapped { pose.inverse() } else { pose };
    let (covariance, doubt) = believe(&pose, &pairs, swapped, [spheres_of, reference], options);
    doubts.extend(doubt);
    Solved { pose, covariance, rounds, doubts }
}

/// The covariance that the pairs' residuals give, about the pairs' centroid, and the doubts they raise.
fn believe(
    pose: &Isometry3<f64>,
    pairs: &Pairs,
    swapped: bool,
    [spheres_of, reference]: [&Prepared; 2],
    options: &PaperOptions,
) -> (Matrix6<f64>, Vec<Doubt>) {
    let radius = spheres_of.radius_m();
    let count = pairs.pairs.len();
    if count < LEAST_PAIRS {
        // Nothing is known but that the bodies lie on each other.
        return (covariance(&Matrix6::zeros(), &reference.centroid(), radius), Vec::new());
    }
    // In the reference's frame, where the pose takes the moving side.
    let sides = |pair: &PointPair| if swapped { (pair.point, pair.center) } else { (pair.center, pair.point) };
    let fit = PairFit::of(pairs.pairs.iter().map(|pair| {
        let (moving, target) = sides(pair);
        (pose * moving, target, pair.weight)
    }));
    let offset = CENTER_OFFSET * pairs.reach_m;
    let noise = spheres_of.noise_m(&spheres_of.centroid());
    let expected_m = (pairs.tolerance_m * pairs.tolerance_m + offset * offset + noise * noise).sqrt();
    let mut doubts: Vec<Doubt> = residuals(fit.rms_m, expected_m).into_iter().collect();
    let (_, held) = weakest(&fit.information, radius);
    if held < LEAST_INFORMATION {
        doubts.push(Doubt::Degenerate { information: held });
    }
    let needed = options.pairs.min(options.samples) / 2;
    if count < needed {
        doubts.push(Doubt::Pairs { found: count, needed });
    }
    (fit.covariance(noise, radius), doubts)
}

/// The pose as the start of another method, whose answer it then is.
fn polished(
    moving: &Cloud,
    reference: &Cloud,
    found: &Solved,
    polish: &IterationOptions,
) -> Result<Registration, RegisterError> {
    let prior = Prior { t_reference_moving: found.pose, sigma_rotation_rad: 1.0, sigma_translation_m: 1.0 };
    let mut registration = gicp(moving, reference, Some(&prior), polish)?;
    registration.iterations += found.rounds;
    Ok(registration)
}
