//! The `tumbled` program, as a library so that its tests and documentation reach every part.
//!
//! * [`calibration`]: what `calibrate` finds, as files and pages;
//! * [`cli`]: the commands, one file each, and what they share: arguments, outcomes, exit codes, output;
//! * [`clouds`]: files of points;
//! * [`config`]: one TOML file to a checked rig;
//! * [`decoding`]: inputs and a config to decoded sensor data;
//! * [`evaluation`]: the states of a session held against the truth;
//! * [`experiment`]: the published experiments and the acceptance campaign;
//! * [`foxglove`]: the bridge to Foxglove and Lichtblick;
//! * [`geometry_file`]: what reading files of points and of surfaces shares;
//! * [`quantity`]: durations and sizes as people write them;
//! * [`stream`]: the state stream to whoever connects;
//! * [`telemetry`]: the state as UDP datagrams;
//! * [`web`]: the operator's page and the metrics;
//! * [`schema`]: the JSON Schemas of everything the commands print as JSON.
#![forbid(unsafe_code)]

pub mod calibration;
pub mod cli;
pub mod clouds;
pub mod config;
pub mod control;
pub mod decoding;
pub mod evaluation;
pub mod experiment;
pub mod foxglove;
pub mod geometry_file;
pub mod limits;
pub mod quantity;
pub mod reconstruction;
pub mod schema;
pub mod session;
pub mod simulation;
pub mod stream;
pub mod target;
pub mod telemetry;
pub mod unix_socket;
pub mod vary;
pub mod web;
