//! One simulated session through several configs at once: it is simulated once, and never held.

use std::path::Path;

use tumbled_io::live::StopToken;
use tumbled_sim::scene::Scene;

use crate::cli::Failure;
use crate::session::Engine;
use crate::session::play::Listener;
use crate::simulation::rig::{self, Sensors, View};
use crate::simulation::{SimulatedLedger, truth};

/// A pipeline of its own, on one thread, and whoever wants what comes out of it.
#[derive(Debug)]
pub struct Lane<L> {
    engine: Engine,
    /// Has all that came out.
    pub listener: L,
}

impl<L: Listener> Lane<L> {
    /// The pipeline that `tumbled replay` of the scene would be with a view of its rig and `--set` settings; `name` is what
    /// messages call the config.
    ///
    /// # Errors
    /// Settings that the config does not take: exit code 2.
    pub fn new(
        scene: &Scene,
        view: (View, Sensors),
        settings: &[String],
        name: &str,
        listener: L,
    ) -> Result<Self, Failure> {
        let loaded = rig::loaded(scene, view, Path::new(name), settings)?;
        Ok(Self { engine: Engine::of_config(&loaded, false, 1)?, listener })
    }

    /// From here on the listener has the frames that show the target.
    pub fn keep_frames(&mut self) {
        self.engine.keep_frames();
    }

    /// Its core.
    pub fn engine(&self) -> &Engine {
        &self.engine
    }

    /// One hash over everything that came out.
    pub fn digest(&self) -> String {
        self.engine.checkpoint().outputs_digest()
    }
}

/// Plays a scene through all lanes; false when a stop came before the end.
///
/// # Errors
/// Those of the listeners.
pub fn play<L: Listener>(scene: &Scene, lanes: &mut [Lane<L>], stop: &StopToken) -> Result<bool, Failure> {
    for event in SimulatedLedger::new(scene.clone(), None) {
        if stop.is_stopped() {
            return Ok(false);
        }
        for lane in &mut *lanes {
            lane.listener.event(&event);
            lane.listener.step(&lane.engine.step(&event))?;
        }
    }
    for lane in lanes {
        lane.listener.step(&lane.engine.finish())?;
    }
    Ok(true)
}

/// The truth of a scene, as `tumbled evaluate` has it of a `truth.csv`.
///
/// # Errors
/// A scene without two instants: exit code 2.
pub fn truth(scene: &Scene) -> Result<crate::evaluation::score::Truth, Failure> {
    let samples: Vec<_> = truth::samples(scene).collect();
    let travel = crate::evaluation::interval::Travel::of_truth(&samples);
    let trajectory = tumbled_core::evaluate::Trajectory::new(samples).map_err(Failure::input)?;
    Ok(crate::evaluation::score::Truth::Poses(trajectory, travel))
}
