//! The config of a simulated rig.

use core::fmt::Write;
use std::path::Path;

use tumbled_io::recording::{Origin, RecordingHeader};
use tumbled_sim::scene::{Scene, Transform};

use crate::config::{self, ConfigError, Loaded, Recorded, show};

/// Whose view of the rig it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View {
    /// What an operator would have: mountings and offsets off by what a calibration leaves.
    Operator,
    /// The truth.
    Truth,
}

/// The config that an operator of a scene's rig would have, loaded; `name` is what messages call it.
///
/// # Errors
/// `settings` that the config does not take.
pub fn operators(scene: &Scene, name: &Path, settings: &[String]) -> Result<Loaded, ConfigError> {
    let header = RecordingHeader { config: toml(scene, View::Operator), ..RecordingHeader::default() };
    config::load_recorded(Recorded { path: name.to_owned(), header }, settings)
}

/// What a recording of a scene says of itself.
pub fn header(scene: &Scene, loaded: &Loaded, program: &str) -> RecordingHeader {
    RecordingHeader {
        session: format!("sim-{}-{}", scene.config.name, scene.config.seed),
        origin: Origin::Simulated,
        program: program.to_owned(),
        unix_at_zero: scene.unix_at_zero(),
        config: show::text(&loaded.tree, false),
        files: loaded.config.attachments(),
        ..RecordingHeader::default()
    }
}

/// The config of a scene's rig, TOML.
pub fn toml(scene: &Scene, view: View) -> String {
    let config = &scene.config;
    let mounting = |sensor: &str, truth: &Transform| match view {
        View::Operator => scene.operators_mounting(sensor, truth),
        View::Truth => *truth,
    };
    // A mapped stamp is that of the last packet, and late by the least delay of the way besides.
    let offset_s = |sensor: &str, truth_s: f64| match view {
        View::Operator => scene.operators_time_s(sensor, truth_s),
        View::Truth => truth_s,
    };
    let mut text = format!("# {}: {}\n", config.name, config.about);
    if config.lidar.is_empty() {
        text.push_str("lidar = []\n");
    }
    if config.kinect.is_empty() {
        text.push_str("kinect = []\n");
    }
    let mut line = |arguments: core::fmt::Arguments<'_>| text.write_fmt(arguments).unwrap_or_default();
    line(format_args!("\n[rig]\nname = \"{}\"\n", config.name));
    let [x, y, z] = config.roi_center_m;
    line(format_args!("\n[target]\nroi_center_m = [{x:?}, {y:?}, {z:?}]\nroi_radius_m = {:?}\n", config.roi_radius_m));
    for lidar in &config.lidar {
        let placed = transform(&mounting(&lidar.id, &lidar.t_rig_lidar));
        let offset_ms = 1e3 * offset_s(&lidar.id, LIDAR_LATE_S);
        line(format_args!("\n[[lidar]]\nid = \"{}\"\nmodel = \"{}\"\n", lidar.id, lidar.model));
        line(format_args!("t_rig_lidar = {placed}\ntime_offset_ms = {offset_ms:.4}\n"));
    }
    for kinect in &config.kinect {
        let placed = transform(&mounting(&kinect.id, &kinect.t_rig_kinect));
        let offset_ms = 1e3 * offset_s(&kinect.id, kinect.latency_s + KINECT_LATE_S);
        line(format_args!("\n[[kinect]]\nid = \"{}\"\n", kinect.id));
        line(format_args!("t_rig_kinect = {placed}\ntime_offset_ms = {offset_ms:.4}\n"));
    }
    text
}

/// What no arrival is faster than, after a packet's first firing: 12 · 55.296 µs of firing and 0.06 ms on the wire.
const LIDAR_LATE_S: f64 = 0.7e-3;
/// The same, after a frame has left: 0.3 ms, and half of the 2 ms between two looks of the host.
const KINECT_LATE_S: f64 = 1.3e-3;

fn transform(transform: &Transform) -> String {
    let Transform { translation_m, rotation_xyzw } = transform;
    format!("{{ translation_m = {translation_m:?}, rotation_xyzw = {rotation_xyzw:?} }}")
}
