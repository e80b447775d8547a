//! Arguments that several commands share.

use std::path::PathBuf;

use clap::Args;
use tumbled_io::capture;

use super::{Failure, render};
use crate::config::{self, Config, Loaded, Recorded};
use crate::decoding::Inputs;
use crate::simulation::{faults, rig, scene_of, scenes};

/// Where the config comes from.
#[derive(Clone, Debug, Default, Args)]
pub struct ConfigArgs {
    /// The rig's config; without it a recording's own, else the built-in defaults: one LiDAR `front`, one Kinect `near`.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Overrides one key, e.g. lidar.port=2369 (every LiDAR), lidar.front.port=2369 (one); repeatable.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub settings: Vec<String>,
}

impl ConfigArgs {
    /// Loads the config; its warnings go to stderr.
    ///
    /// # Errors
    /// [`Failure::Config`] with every problem.
    pub fn load(&self) -> Result<Loaded, Failure> {
        let loaded = config::load(self.config.as_deref(), &self.settings)?;
        loaded.warnings.iter().for_each(render::warning);
        Ok(loaded)
    }
}

impl InputArgs {
    /// Loads the config the inputs are read with: the one given; for one recording alone the one it was made with; else
    /// the built-in one. Its warnings go to stderr.
    ///
    /// # Errors
    /// [`Failure::Config`] with every problem.
    pub fn load(&self) -> Result<Loaded, Failure> {
        if let (None, [input]) = (&self.config.config, self.inputs.as_slice())
            && let Some(name) = scene_of(input)
        {
            return Ok(rig::operators(&scenes::load(name)?, input, &self.config.settings)?);
        }
        let lone = if self.config.config.is_none() { capture::lone_recording(&self.inputs) } else { None };
        let (Some(header), Some(path)) = (lone, self.inputs.first()) else { return self.config.load() };
        let recorded = Recorded { path: path.clone(), header };
        let loaded = config::load_recorded(recorded, &self.config.settings)?;
        loaded.warnings.iter().for_each(render::warning);
        Ok(loaded)
    }
}

impl InputArgs {
    /// Whether a simulated scene is read.
    pub fn is_scene(&self) -> bool {
        self.inputs.iter().any(|input| scene_of(input).is_some())
    }
}

/// Captures, and the config to read them with.
#[derive(Clone, Debug, Args)]
pub struct InputArgs {
    /// Captures: files or folders; several are merged by host time.
    #[arg(value_name = "INPUT", required = true)]
    pub inputs: Vec<PathBuf>,
    /// The config to read them with.
    #[command(flatten)]
    pub config: ConfigArgs,
}

/// Faults on purpose.
#[derive(Clone, Debug, Default, Args)]
pub struct FaultArgs {
    /// Let go wrong what a fault file says: loss, delay, reboots, unplugging and more; its name, or one of the program's
    /// (lost-target, bad-lines). What comes out is a rehearsal and says `simulated`.
    #[arg(long, value_name = "FILE")]
    pub faults: Option<PathBuf>,
}

impl FaultArgs {
    /// Whether any are asked for.
    pub fn asked_for(&self) -> bool {
        self.faults.is_some()
    }

    /// The inputs with the faults asked for.
    ///
    /// # Errors
    /// A fault file that is none, or of sensors that the rig does not have: exit code 2.
    pub fn inject(&self, inputs: Inputs, config: &Config) -> Result<Inputs, Failure> {
        let Some(path) = &self.faults else { return Ok(inputs) };
        let inputs = inputs.with_faults(faults::read_for(path, &faults::sensors(config))?)?;
        tracing::warn!(
            "FAULTS of {} are injected: a rehearsal and no measurement; it is compared with nothing recorded",
            path.display()
        );
        Ok(inputs)
    }

    /// What a person should know of them at the end.
    pub fn warning(&self, inputs: &Inputs) -> Option<String> {
        let (path, truth) = (self.faults.as_ref()?.display(), inputs.faults()?);
        Some(if faults::any_done(truth) {
            format!(
                "the faults of {path} were injected: this is not the session of the inputs, whose checkpoints were not compared"
            )
        } else {
            format!("the faults of {path} did nothing: no item fell into their windows")
        })
    }
}
