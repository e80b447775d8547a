//! The acceptance campaign of pose and spin: simulated scenes over seeds, each through several configs.
//!
//! ```text
//!   scene, seed ─▶ simulated once ─▶ a lane for each config: the pipeline of `replay` ─▶ watch: states, modes
//!                                      └▶ interval by interval: the scores of `evaluate` ─▶ trials ─▶ figures ─▶ claims
//! ```
//!
//! * [`mod@file`]: what is measured and what it must reach, a TOML file with `kind = "pose"`; `pose` comes with the program;
//! * [`changes`]: scenes other than they are in their files; [`watch`]: what a lane gives;
//! * [`trial`]: a seed of a scene with a config, scored over an interval; [`runner`]: all of them;
//! * [`figure`]: what trials come to; [`verdict`]: held against the claims; [`report`]: for machines and for people.

pub mod changes;
pub mod figure;
pub mod file;
pub mod report;
pub mod runner;
pub mod trial;
pub mod verdict;
pub mod watch;

pub use file::PoseCampaignFile;
pub use report::PoseCampaignReport;
