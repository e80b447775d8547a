//! The machine that figures were measured on.

use std::fs;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What times depend on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Machine {
    /// The processor's name as the kernel has it; empty: it has none.
    pub processor: String,
    /// Processors that this process may use.
    pub processors: u64,
    /// Architecture and system, e.g. `x86_64-linux`.
    pub system: String,
    /// `release`, or `debug`: times of which mean nothing.
    pub build: String,
}

impl Machine {
    /// This one.
    pub fn this() -> Self {
        let facts = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let name = facts.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
        Self {
            processor: name.map(|(_, name)| name.trim().to_owned()).unwrap_or_default(),
            processors: std::thread::available_parallelism().map_or(1, usize::from) as u64,
            system: format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS),
            build: if cfg!(debug_assertions) { "debug" } else { "release" }.to_owned(),
        }
    }

    /// In one line.
    pub fn line(&self) -> String {
        let name = if self.processor.is_empty() { "unknown processor" } else { &self.processor };
        format!("{name}, {} processors, {}, {} build", self.processors, self.system, self.build)
    }
}
