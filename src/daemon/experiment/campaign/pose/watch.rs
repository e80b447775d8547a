//! What a lane gives: the states that are scored, and when the target was what.

use tumbled_core::estimate::Mode;
use tumbled_model::{RigNs, SensorId};

use crate::cli::Failure;
use crate::evaluation::Gathered;
use crate::session::Step;
use crate::session::play::Listener;

/// Listens to a lane.
#[derive(Debug)]
pub struct Watch {
    /// As `tumbled evaluate` gathers.
    pub gathered: Gathered,
    /// Each epoch's time and mode.
    pub modes: Vec<(RigNs, Mode)>,
    /// When and with whose first sight the model of the target began, which is in force.
    pub first_sight: Option<(RigNs, SensorId)>,
}

impl Default for Watch {
    fn default() -> Self {
        Self { gathered: Gathered::new(Default::default()), modes: Vec::new(), first_sight: None }
    }
}

impl Listener for Watch {
    fn step(&mut self, step: &Step<'_>) -> Result<(), Failure> {
        for state in &step.outputs.states {
            let begins = state.mode == Mode::Acquiring
                && !matches!(self.modes.last(), Some((_, Mode::Acquiring | Mode::Lost | Mode::Predicted)));
            if begins {
                self.first_sight = Some((state.t, state.sensor.clone()));
            }
            self.modes.push((state.t, state.mode));
        }
        self.gathered.step(step)
    }
}

impl Watch {
    /// From the first epoch to the first that is tracked, s.
    pub fn acquired_s(&self) -> Option<f64> {
        let (first, _) = self.modes.first()?;
        self.tracked_after(*first)
    }

    /// From a time to the first epoch after it that is tracked, s.
    pub fn tracked_after(&self, from: RigNs) -> Option<f64> {
        let mut after = self.modes.iter().filter(|(t, mode)| *t >= from && *mode == Mode::Tracking);
        after.next().map(|(t, _)| (*t - from).as_secs_f64())
    }

    /// Epochs that were tracked between two times, and all epochs.
    pub fn tracked_between(&self, from: RigNs, until: RigNs) -> (usize, usize) {
        let within = || self.modes.iter().filter(|(t, _)| *t >= from && *t <= until);
        (within().filter(|(_, mode)| *mode == Mode::Tracking).count(), within().count())
    }
}
