//! Arguments that several commands share.

use std::path::PathBuf;

use clap::Args;
use tumbled_io::capture;

use super::{Failure, render};
use crate::config::{self, Loaded, Recorded};
use crate::simulation::{rig, scene_of, scenes};

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
