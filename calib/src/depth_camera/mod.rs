//! A depth camera's lens and depths, from boards that a LiDAR sees too.
//!
//! ```text
//!   boards in both sensors ─ samples (patches, edges, LiDAR points) ─ solve (place, scale, surface, lens; planes unknown)
//!       ─ the model that the data bear (BIC) ─ folds: held-out map, jackknife σ ─ gates
//! ```
//! * `state`: the unknowns, and which of them a model has; `samples`: what of a board is measured;
//! * `solve`: Gauss–Newton over all of them; `map`: held-out residuals over the picture, and in time; `verdict`: the gates.

mod map;
mod samples;
mod solve;
mod state;
mod verdict;

use nalgebra::Isometry3;

use crate::board::{BoardSize, Located, locate};
use crate::coverage::Spread;
use crate::extrinsic::PoseOutcome;
use crate::fit::{Covariance, Unsolved};
use crate::gate::Gate;
use crate::view::View;

use samples::Shown;
use solve::{Noise, Solved};

pub use map::{Drift, MAP, Map};
pub use state::{Camera, Lens, Model, SURFACE_TERMS, State, UNKNOWNS};

/// Every so-manieth board is held back in turn.
const FOLDS: usize = 5;
/// A lens is another than the config's from so many standard deviations on: of five folds, so Student's tails.
const LENS_SIGMA: f64 = 5.0;
/// A board this many times farther from its plane than boards usually are was not flat, or moved.
const OUTLIER: f64 = 4.0;
/// A richer model has to be better by this in the criterion (Kass and Raftery 1995: "strong" evidence from 6 on).
const BETTER: f64 = 6.0;

/// A model that was tried.
#[derive(Clone, Debug, PartialEq)]
pub struct Tried {
    /// Which.
    pub model: Model,
    /// The sum of its residuals' squares in their noise, robust.
    pub cost: f64,
    /// The Bayesian information criterion: the least is the best.
    pub criterion: f64,
}

/// The result.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// The model that the data bear.
    pub model: Model,
    /// Its values.
    pub state: State,
    /// One standard deviation of each unknown: rotation (rad, `R ← Exp(r) R` in the LiDAR's frame), translation (m), scale, surface,
    /// fx fy cx cy k1 k2, edges. The larger of what the noise tells and what leaving out fifths of the boards does. `None`: not solved for.
    pub sigma: [Option<f64>; UNKNOWNS],
    /// Of rotation, translation and scale, with those deviations.
    pub covariance: Covariance,
    /// Noise of the depth over what is usual, and of edges, px.
    pub noise: (f64, f64),
    /// Held-out residuals with the scale alone, and with the model.
    pub maps: (Map, Map),
    /// How the depths move in time.
    pub drift: Option<Drift>,
}

/// What a calibration came to.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthCalibration {
    /// Where it began.
    pub start: Isometry3<f64>,
    /// The result; `None`: there is none, and the gates say why.
    pub found: Option<Found>,
    /// The models that were tried.
    pub tried: Vec<Tried>,
    /// The poses in their order: which are used.
    pub poses: Vec<PoseOutcome>,
    /// How the boards' normals are spread.
    pub spread: Spread,
    /// What was asked of it.
    pub gates: Vec<Gate>,
}

/// Calibrates. The views' depths are the device's own law, without scale or surface; `seconds`: when each pose was.
pub fn calibrate(
    views: &[View],
    seconds: &[f64],
    size: &BoardSize,
    start: &Isometry3<f64>,
    camera: &dyn Camera,
) -> DepthCalibration {
    let (mut poses, boards, t) = match locate(views, size, start) {
        Ok(Located { poses, boards, t }) => (poses, boards, t),
        Err(failed) => {
            let (poses, spread, error) = *failed;
            let gates = verdict::without(&poses, &spread, error);
            return DepthCalibration { start: *start, found: None, tried: Vec::new(), poses, spread, gates };
        }
    };
    let all = samples::samples(&boards, views, size, camera);
    let mut used: Vec<&Shown> = all.iter().collect();
    let chosen = choose(&mut used, &mut poses, camera, &t);
    let spread = Spread::of_normals(&used.iter().map(|board| board.plane.normal).collect::<Vec<_>>());
    let (solved, tried) = match chosen {
        Ok(chosen) => chosen,
        Err(error) => {
            let gates = verdict::without(&poses, &spread, error);
            return DepthCalibration { start: *start, found: None, tried: Vec::new(), poses, spread, gates };
        }
    };
    let found = checked(solved, &used, seconds, camera, &t);
    let depths: Vec<f64> = used.iter().map(|board| board.middle.z).collect();
    let gates = verdict::gates(&found, &poses, &spread, &depths, start, &camera.lens());
    DepthCalibration { start: *start, found: Some(found), tried, poses, spread, gates }
}

/// The models that are compared, a richer one after those it holds.
fn candidates() -> Vec<Model> {
    let of = |order, power| Model { order, power, ..Model::SCALE };
    vec![Model::SCALE, of(2, 0), of(2, 2), of(3, 0), of(3, 2)]
}

/// The model that the data bear, by the criterion with the noise of the richest; boards that fit none are left aside.
fn choose(
    used: &mut Vec<&Shown>,
    poses: &mut [PoseOutcome],
    camera: &dyn Camera,
    t: &Isometry3<f64>,
) -> Result<(Solved, Vec<Tried>), Unsolved> {
    let richest = Model { order: 3, power: 0, pinhole: true, radial: true };
    let mut first = solve::solve(used, camera, richest, t, None)?;
    let misfits: Vec<f64> = used.iter().enumerate().map(|(n, board)| first.misfit(n, board, camera)).collect();
    let mut sorted = misfits.clone();
    sorted.sort_by(f64::total_cmp);
    let usual = sorted.get(sorted.len() / 2).copied().unwrap_or(1.0);
    let fits: Vec<bool> = misfits.iter().map(|misfit| *misfit <= OUTLIER * usual.max(1.0)).collect();
    if fits.iter().any(|fits| !fits) {
        for (board, misfit) in used.iter().zip(&misfits).filter(|(_, misfit)| **misfit > OUTLIER * usual.max(1.0)) {
            if let Some(pose) = poses.get_mut(board.number) {
                let why = format!("it is off its plane by {misfit:.0} times the noise: it moved, or it is not flat");
                pose.left_aside = Some(why);
            }
        }
        let mut keep = fits.iter();
        used.retain(|_| keep.next().copied().unwrap_or(true));
        first = solve::solve(used, camera, richest, t, None)?;
    }
    let noise: Noise = first.noise;
    let samples = solve::samples_of(used);
    let mut tried = Vec::new();
    let mut best: Option<Solved> = None;
    let consider = |model: Model, best: &mut Option<Solved>, tried: &mut Vec<Tried>| {
        let Ok(solved) = solve::solve(used, camera, model, t, Some(noise)) else { return };
        let criterion = solved.criterion(samples);
        tried.push(Tried { model, cost: solved.cost, criterion });
        if best.as_ref().is_none_or(|before| criterion < before.criterion(samples) - BETTER) {
            *best = Some(solved);
        }
    };
    for model in candidates() {
        consider(model, &mut best, &mut tried);
    }
    // The lens on top of the best surface, then its distortion on top of the lens.
    for radial in [false, true] {
        let Some(before) = best.clone() else { break };
        consider(Model { pinhole: true, radial, ..before.model }, &mut best, &mut tried);
        if best.as_ref().is_some_and(|best| best.model != before.model && !lens_moved(best, used, camera, t)) {
            best = Some(before);
        }
    }
    Ok((best.ok_or(Unsolved::Degenerate)?, tried))
}

/// The solutions without each fifth of the boards.
fn folds(used: &[&Shown], camera: &dyn Camera, model: Model, t: &Isometry3<f64>, noise: Noise) -> Vec<Option<Solved>> {
    (0..FOLDS).map(|n| solve::solve(&fold(used, n, false), camera, model, t, Some(noise)).ok()).collect()
}

/// The boards of a fold: those held back, or the others.
fn fold<'a>(used: &[&'a Shown], fold: usize, held: bool) -> Vec<&'a Shown> {
    used.iter().enumerate().filter(|(n, _)| (n % FOLDS == fold) == held).map(|(_, board)| *board).collect()
}

/// Whether the lens that was added last is another than the config's beyond what the boards disagree about it. The criterion
/// counts every place on an edge as if it were alone, and would take a lens for what a few boards have in common.
fn lens_moved(solved: &Solved, used: &[&Shown], camera: &dyn Camera, t: &Isometry3<f64>) -> bool {
    let without: Vec<Solved> = folds(used, camera, solved.model, t, solved.noise).into_iter().flatten().collect();
    let (sigma, _) = jackknife(solved, &without);
    let added = if solved.model.radial { state::LENS + 4..state::EDGE } else { state::LENS..state::LENS + 4 };
    added.into_iter().any(|unknown| {
        let sigma = sigma.get(unknown).copied().flatten().unwrap_or(f64::INFINITY);
        solved.state.moved(unknown).abs() > LENS_SIGMA * sigma
    })
}

/// The result with what boards that were held back say of it.
fn checked(solved: Solved, used: &[&Shown], seconds: &[f64], camera: &dyn Camera, t: &Isometry3<f64>) -> Found {
    let (plain, folds) =
        (folds(used, camera, Model::SCALE, t, solved.noise), folds(used, camera, solved.model, t, solved.noise));
    let map = |folds: &[Option<Solved>]| {
        let held = folds.iter().enumerate().filter_map(|(n, solved)| Some((n, &solved.as_ref()?.state)));
        map::map(held.flat_map(|(n, state)| fold(used, n, true).into_iter().map(move |board| (board, state))), camera)
    };
    let maps = (map(&plain), map(&folds));
    let (sigma, covariance) = jackknife(&solved, &folds.into_iter().flatten().collect::<Vec<_>>());
    let drift = map::drift(&solved, used, seconds, camera);
    let noise = (solved.noise.patch, solved.noise.edge);
    Found { model: solved.model, state: solved.state, sigma, covariance, noise, maps, drift }
}

/// Deviations by leaving out fifths of the boards, where they are larger than what the noise tells: what varies from board to board is in
/// no patch's noise.
fn jackknife(solved: &Solved, folds: &[Solved]) -> ([Option<f64>; UNKNOWNS], Covariance) {
    let count = folds.len() as f64;
    let value = |state: &State, unknown: usize| match unknown {
        0..6 => {
            let shift = crate::fit::difference(&state.t_lidar_camera, &solved.state.t_lidar_camera, 0.0);
            shift.get(unknown).copied().unwrap_or_default()
        }
        _ => state.moved(unknown),
    };
    let mut factor = [1.0_f64; UNKNOWNS];
    let sigma = core::array::from_fn(|unknown| {
        let formal = solved.sigma.get(unknown).copied().flatten()?;
        if folds.len() < 2 {
            return Some(formal);
        }
        let values: Vec<f64> = folds.iter().map(|fold| value(&fold.state, unknown)).collect();
        let mean = values.iter().sum::<f64>() / count;
        let squares: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
        let told = (squares * (count - 1.0) / count).sqrt().max(formal);
        if let (Some(factor), true) = (factor.get_mut(unknown), formal > 0.0) {
            *factor = told / formal;
        }
        Some(told)
    });
    let [a, b, c, d, e, f, g, ..] = factor;
    let stretch = Covariance::from_diagonal(&nalgebra::SVector::from([a, b, c, d, e, f, g]));
    (sigma, stretch * solved.covariance * stretch)
}
