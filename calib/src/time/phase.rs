//! Phase against rate: where the target seems to be, against where the stage is, at several rates and both ways.
//!
//! Over whole turns the errors that depend on the attitude are the same in every run and fall into φ_0.

use super::runs::runs;
use super::{TimedAngle, student};
use tumbled_model::se3::less_turns;

/// What of a run's beginning is left out, s: the filter settles.
pub const SETTLE_S: f64 = 3.0;
/// Runs a line is laid through.
pub const LEAST_RUNS: usize = 3;
/// A turn with fewer states says nothing.
const LEAST_STATES: usize = 20;

/// A run at one rate.
#[derive(Clone, Debug, PartialEq)]
pub struct PhaseRun {
    /// rad/s, with its sign.
    pub rate_rps: f64,
    /// Whole turns used.
    pub turns: usize,
    /// States in them.
    pub states: usize,
    /// The mean phase, rad, of all runs less that of the line at rest.
    pub phase_rad: f64,
    /// What the line leaves of it, rad.
    pub residual_rad: f64,
}

/// How late a sensor's stamps are, by phases.
#[derive(Clone, Debug, PartialEq)]
pub struct Phase {
    /// Seconds by which the times are late still; add it to the offset they were made with.
    pub late_s: f64,
    /// One standard deviation: by the larger of the runs' scatter about the line and that from turn to turn, with what few
    /// runs are uncertain by.
    pub sigma_s: f64,
    /// The runs, in the order of time.
    pub runs: Vec<PhaseRun>,
}

/// Why phases tell no offset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NoPhase {
    /// No runs.
    #[error(
        "{found} runs of one rate with a whole turn, and {LEAST_RUNS} are the least: turn the stage at 5, 10 and 20 °/s, two \
         turns each way"
    )]
    FewRuns {
        /// Runs there are.
        found: usize,
    },
    /// One direction alone.
    #[error(
        "every run turns the same way: a late stamp then looks like another attitude of the target. Turn the stage back \
         at the same rates"
    )]
    OneDirection,
    /// The target was found in another frame between the runs.
    #[error("the phase jumps by {degrees}° between runs: the target was lost and found in another frame in between")]
    Jumps {
        /// Whole degrees.
        degrees: u32,
    },
}

/// A run's rate, mean phase, whole turns and states.
type Found = (f64, f64, usize, usize);

/// Phases of different runs are nearer to each other than this, rad: at 20 °/s half a second late are 20° between both ways.
const LARGEST_JUMP: f64 = 30.0 / 180.0 * core::f64::consts::PI;

/// Lays a line through the phases of all runs.
///
/// # Errors
/// [`NoPhase`], in words.
pub fn phase(samples: &[TimedAngle]) -> Result<Phase, NoPhase> {
    let reference = samples.iter().find(|sample| sample.state_rad.is_finite());
    let zero = reference.map_or(0.0, |sample| sample.state_rad - sample.encoder_rad);
    let mut found: Vec<Found> = Vec::new();
    let (mut between_turns, mut freedom) = (0.0, 0);
    for run in runs(samples) {
        let Some(run) = run.settled(SETTLE_S) else { continue };
        let turns: Vec<_> = run.turns().into_iter().filter(|turn| turn.len() >= LEAST_STATES).collect();
        let means: Vec<f64> = turns.iter().map(|turn| mean_phase(turn, zero)).collect();
        if means.is_empty() {
            continue;
        }
        let mean = means.iter().sum::<f64>() / means.len() as f64;
        between_turns += means.iter().map(|turn| (turn - mean) * (turn - mean)).sum::<f64>();
        freedom += means.len() - 1;
        let states = turns.iter().map(|turn| turn.len()).sum();
        found.push((run.rate_rps, mean, means.len(), states));
    }
    if found.len() < LEAST_RUNS {
        return Err(NoPhase::FewRuns { found: found.len() });
    }
    let one_way = |sign: f64| found.iter().all(|(rate, ..)| rate * sign > 0.0);
    if one_way(1.0) || one_way(-1.0) {
        return Err(NoPhase::OneDirection);
    }
    let phases = || found.iter().map(|(_, phase, ..)| *phase);
    let jump = phases().fold(f64::NEG_INFINITY, f64::max) - phases().fold(f64::INFINITY, f64::min);
    if jump > LARGEST_JUMP {
        return Err(NoPhase::Jumps { degrees: jump.to_degrees() as u32 });
    }
    // Weights by turns: a run of two has half the noise of one.
    let weight = |turns: usize| turns as f64;
    let total: f64 = found.iter().map(|(_, _, turns, _)| weight(*turns)).sum();
    let mean_of = |what: &dyn Fn(&Found) -> f64| found.iter().map(|run| weight(run.2) * what(run)).sum::<f64>() / total;
    let (mean_rate, mean_phase) = (mean_of(&|run| run.0), mean_of(&|run| run.1));
    let spread = total * mean_of(&|run| (run.0 - mean_rate) * (run.0 - mean_rate));
    let slope = total * mean_of(&|run| (run.0 - mean_rate) * (run.1 - mean_phase)) / spread;
    let at_rest = mean_phase - slope * mean_rate;
    let runs: Vec<PhaseRun> = found
        .iter()
        .map(|(rate_rps, phase, turns, states)| PhaseRun {
            rate_rps: *rate_rps,
            turns: *turns,
            states: *states,
            phase_rad: phase - at_rest,
            residual_rad: phase - at_rest - slope * rate_rps,
        })
        .collect();
    // Of one turn, either way.
    let left: f64 = runs.iter().map(|run| weight(run.turns) * run.residual_rad * run.residual_rad).sum();
    let line_freedom = runs.len() - 2;
    let by_line = (left / line_freedom as f64).sqrt() * student(line_freedom);
    let by_turns = if freedom > 0 { (between_turns / freedom as f64).sqrt() * student(freedom) } else { 0.0 };
    Ok(Phase { late_s: -slope, sigma_s: by_line.max(by_turns) / spread.sqrt(), runs })
}

fn mean_phase(turn: &[TimedAngle], zero: f64) -> f64 {
    let phase = |sample: &TimedAngle| less_turns(sample.state_rad - sample.encoder_rad - zero);
    turn.iter().map(phase).sum::<f64>() / turn.len() as f64
}
