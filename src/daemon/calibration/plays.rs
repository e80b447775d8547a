//! Inputs played through the core, once for each changed config, with the turntable's angles beside the states.

use std::f64::consts::TAU;
use std::path::PathBuf;
use std::sync::Arc;

use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;
use tumbled_core::estimate::{Mode, Validity};
use tumbled_core::evaluate::{EncoderSample, EstimateSample, angle_at};
use tumbled_io::live::StopToken;

use crate::cli::Failure;
use crate::config::Config;
use crate::decoding::Inputs;
use crate::evaluation::Gathered;
use crate::evaluation::interval::Travel;
use crate::evaluation::score::{self, Truth};
use crate::session::play::{Listener, play};
use crate::session::{Engine, Pace, Speed, Step};
use crate::simulation::scenes;

/// What a config is changed to before a play.
pub type Change = Arc<dyn Fn(&mut Config) + Send + Sync>;

/// A play's outcome.
#[derive(Debug)]
pub struct Played {
    /// The states.
    pub gathered: Gathered,
    /// Root mean square distance of the registered points from the model, m, over the tracked epochs; `None`: none was.
    pub residual_rms_m: Option<f64>,
    /// What a person should know of the inputs.
    pub warnings: Vec<String>,
    /// Nothing of the inputs was missing.
    pub complete: bool,
}

/// The states, and the points' residuals besides.
struct Watch {
    gathered: Gathered,
    squares: f64,
    epochs: u64,
}

impl Listener for Watch {
    fn step(&mut self, step: &Step<'_>) -> Result<(), Failure> {
        for state in &step.outputs.states {
            if state.mode == Mode::Tracking && state.validity != Validity::Invalid && state.inputs.rmse_m.is_finite() {
                self.squares += state.inputs.rmse_m * state.inputs.rmse_m;
                self.epochs += 1;
            }
        }
        self.gathered.step(step)
    }
}

/// Plays inputs once for each change, `threads` plays at a time (0: one for each processor); `None`: a stop came.
///
/// # Errors
/// Inputs or a changed config that cannot be used: exit code 2.
pub fn play_all(
    inputs: &[PathBuf],
    config: &Config,
    changes: &[Change],
    threads: usize,
    stop: &StopToken,
) -> Result<Option<Vec<Played>>, Failure> {
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} plays  {eta} left");
    let progress =
        ProgressBar::new(changes.len() as u64).with_style(style.unwrap_or_else(|_error| ProgressStyle::default_bar()));
    let one = |change: &Change| {
        let played = play_one(inputs, config, change, stop)?;
        progress.inc(1);
        Ok(played)
    };
    progress.tick();
    let pool = scenes::pool(threads)?;
    let played: Result<Vec<_>, Failure> = pool.install(|| changes.par_iter().map(one).collect());
    progress.finish_and_clear();
    Ok(played?.into_iter().collect())
}

fn play_one(paths: &[PathBuf], config: &Config, change: &Change, stop: &StopToken) -> Result<Option<Played>, Failure> {
    let mut engine = Engine::of_changed(config, Arc::clone(change), 1)?;
    // The inputs are read with the config as it is: which data are there does not depend on the change.
    let mut inputs = Inputs::open_ledger(paths, config, 1)?;
    let gathered = Gathered::new(inputs.epoch().unwrap_or_default());
    let mut watch = Watch { gathered, squares: 0.0, epochs: 0 };
    let mut pace = Pace::new(Speed::Max, stop.clone());
    if !play(&mut inputs, &mut engine, &mut watch, &mut pace)? {
        return Ok(None);
    }
    let residual_rms_m = (watch.epochs > 0).then(|| (watch.squares / watch.epochs as f64).sqrt());
    let (warnings, complete) = (inputs.warnings(), !inputs.data_lost());
    Ok(Some(Played { gathered: watch.gathered, residual_rms_m, warnings, complete }))
}

impl Played {
    /// The encoder's angles.
    ///
    /// # Errors
    /// There are none, or none is truth: exit code 2.
    pub fn encoder(&self, warnings: &mut Vec<String>) -> Result<Vec<EncoderSample>, Failure> {
        match score::turntable(&self.gathered, warnings)? {
            (Truth::Encoder(samples, _), _) => Ok(samples),
            (Truth::Poses(..), _) => Ok(Vec::new()),
        }
    }

    /// How far the encoder's times may be off, s, one standard deviation of what is the same for all of them: half a round
    /// trip is the most.
    pub fn encoder_sigma_s(&self) -> f64 {
        let of = |sample: &tumbled_core::TurntableSample| match sample.half_rtt {
            Some(half) => half.as_secs_f64() / 3.0_f64.sqrt(),
            None => sample.t_sigma.as_secs_f64(),
        };
        let count = self.gathered.turntable.len().max(1) as f64;
        self.gathered.turntable.iter().map(of).sum::<f64>() / count
    }

    /// The states with the encoder's angle, after the first turn of the stage, in which the model of the target is made;
    /// where less than two turns are tracked, all, and a warning says so.
    pub fn turned(&self, encoder: &[EncoderSample], warnings: &mut Vec<String>) -> Vec<(&EstimateSample, f64)> {
        let travel = Travel::of_encoder(encoder);
        let states = &self.gathered.estimates;
        let Some((first, last)) = states.first().zip(states.last()) else { return Vec::new() };
        let turned = travel.between(first.t, last.t);
        let from = travel.after(first.t, TAU).filter(|_| turned >= 1.95 * TAU);
        if from.is_none() {
            warnings.push(format!(
                "tracked over {:.2} turns of the stage: the first one, in which the model of the target is made, is used too. \
                 Two turns and more are better",
                turned / TAU
            ));
        }
        let used = states.iter().filter(|state| from.is_none_or(|from| state.t >= from));
        used.filter_map(|state| Some((state, angle_at(encoder, state.t)?))).collect()
    }
}
