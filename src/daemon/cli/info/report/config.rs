//! Which config the inputs were read with.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::config::{ConfigSource, Loaded};

/// The config the inputs were read with.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct UsedConfig {
    /// Where it comes from.
    pub origin: ConfigOrigin,
    /// The config file, or the recording whose config it is; null: built in.
    pub path: Option<String>,
    /// What --set put on top, in order.
    pub settings: Vec<String>,
}

/// Where a config comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ConfigOrigin {
    /// Built in.
    Default,
    /// The file that --config names.
    File,
    /// The recording that is read: the config it was made with.
    Recorded,
}

impl UsedConfig {
    pub(in crate::cli::info) fn new(loaded: &Loaded, settings: &[String]) -> Self {
        let (origin, path) = match &loaded.source {
            ConfigSource::Default => (ConfigOrigin::Default, None),
            ConfigSource::File(path) => (ConfigOrigin::File, Some(path)),
            ConfigSource::Recorded(path) => (ConfigOrigin::Recorded, Some(path)),
        };
        Self { origin, path: path.map(|path| path.display().to_string()), settings: settings.to_vec() }
    }
}

/// `recorded in run.mcap, with --set lidar.model=vlp-16`.
impl fmt::Display for UsedConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let path = self.path.as_deref().unwrap_or_default();
        match self.origin {
            ConfigOrigin::Default => f.write_str("built in")?,
            ConfigOrigin::File => f.write_str(path)?,
            ConfigOrigin::Recorded => write!(f, "recorded in {path}")?,
        }
        for (n, setting) in self.settings.iter().enumerate() {
            write!(f, "{} --set {setting}", if n == 0 { ", with" } else { "" })?;
        }
        Ok(())
    }
}
