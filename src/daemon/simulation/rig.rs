//! The config of a simulated rig.

use core::fmt::Write;
use std::path::Path;

use bytes::Bytes;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_io::recording::{AttachedFile, Origin, RecordingHeader};
use tumbled_model::Span;
use tumbled_sim::scene::{LidarUnit, Scene, Transform};

use crate::config::{self, ConfigError, Loaded, Recorded, show};

/// Whose view of the rig it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum View {
    /// What an operator would have: mountings and offsets off by what a calibration leaves.
    #[default]
    Operator,
    /// The truth.
    Truth,
}

/// Which sensors of a rig a config has; data of the others are left aside.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Sensors {
    /// All.
    #[default]
    All,
    /// The Kinects alone.
    Kinect,
    /// The LiDARs alone.
    Lidar,
}

/// The config that an operator of a scene's rig would have, loaded; `name` is what messages call it.
///
/// # Errors
/// `settings` that the config does not take.
pub fn operators(scene: &Scene, name: &Path, settings: &[String]) -> Result<Loaded, ConfigError> {
    loaded(scene, (View::Operator, Sensors::All), name, settings)
}

/// A view of a scene's rig as a config, loaded; `name` is what messages call it.
///
/// # Errors
/// `settings` that the config does not take.
pub fn loaded(
    scene: &Scene,
    (view, sensors): (View, Sensors),
    name: &Path,
    settings: &[String],
) -> Result<Loaded, ConfigError> {
    let mut partial = scene.clone();
    match sensors {
        Sensors::All => {}
        Sensors::Kinect => (partial.config.lidar, partial.lidars) = (Vec::new(), Vec::new()),
        Sensors::Lidar => (partial.config.kinect, partial.kinects) = (Vec::new(), Vec::new()),
    }
    let scene = &partial;
    let attach = |(n, lidar): (usize, &LidarUnit)| {
        let text = lidar.db_xml.as_ref()?;
        let content = Bytes::copy_from_slice(text.as_bytes());
        Some(AttachedFile::new(&format!("lidar.{}.calibration", lidar.id), &calibration_file(scene, n), content))
    };
    let files = scene.lidars.iter().enumerate().filter_map(attach).collect();
    let header = RecordingHeader { config: toml(scene, view), files, ..RecordingHeader::default() };
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

/// The file of an HDL-64E's calibration beside the config: `db.xml`, of further LiDARs with their names.
pub fn calibration_file(scene: &Scene, lidar: usize) -> String {
    match scene.lidars.get(lidar) {
        Some(unit) if lidar > 0 => format!("db-{}.xml", unit.id),
        _ => "db.xml".to_owned(),
    }
}

/// The config of a scene's rig, TOML. An operator's states how far it may be off.
pub fn toml(scene: &Scene, view: View) -> String {
    let config = &scene.config;
    let mounting = |sensor: &str, truth: &Transform| match view {
        View::Operator => scene.operators_mounting(sensor, truth),
        View::Truth => *truth,
    };
    let offset_ms = |sensor: &str, late: Span| match view {
        View::Operator => 1e3 * scene.operators_time_s(sensor, late.as_secs_f64()),
        View::Truth => 1e3 * late.as_secs_f64(),
    };
    let depth_scale = |sensor: &str, truth: f64| match view {
        View::Operator => scene.operators_depth_scale(sensor, truth),
        View::Truth => truth,
    };
    let errors = config.operator;
    let sigma = |more: &str| match view {
        View::Operator => format!(
            "sigma = {{ rotation_deg = {:?}, translation_m = {:?}, time_offset_ms = {:?}{more} }}\n",
            errors.rotation_deg,
            errors.translation_m,
            1e3 * errors.time_s
        ),
        View::Truth => String::new(),
    };
    let mut text = format!("# {}: {}\n", config.name, config.about);
    if config.lidar.is_empty() {
        text.push_str("lidar = []\n");
    }
    if config.kinect.is_empty() {
        text.push_str("kinect = []\n");
    }
    let mut line = |arguments: core::fmt::Arguments<'_>| text.write_fmt(arguments).unwrap_or_default();
    line(format_args!("\n[rig]\nname = {}\n", toml::Value::from(config.name.as_str())));
    let [x, y, z] = config.roi_center_m;
    line(format_args!("\n[target]\nroi_center_m = [{x:?}, {y:?}, {z:?}]\nroi_radius_m = {:?}\n", config.roi_radius_m));
    for (n, (lidar, unit)) in config.lidar.iter().zip(&scene.lidars).enumerate() {
        let placed = transform(&mounting(&lidar.id, &lidar.t_rig_lidar));
        let offset_ms = offset_ms(&lidar.id, unit.late());
        line(format_args!("\n[[lidar]]\nid = \"{}\"\nmodel = \"{}\"\n", lidar.id, lidar.model));
        if unit.db_xml.is_some() {
            line(format_args!("calibration = \"{}\"\n", calibration_file(scene, n)));
        }
        line(format_args!("t_rig_lidar = {placed}\ntime_offset_ms = {offset_ms:.4}\n{}", sigma("")));
    }
    for (kinect, unit) in config.kinect.iter().zip(&scene.kinects) {
        let placed = transform(&mounting(&kinect.id, &kinect.t_rig_kinect));
        let offset_ms = offset_ms(&kinect.id, unit.late());
        let scale = depth_scale(&kinect.id, 1.0 / kinect.parameters.depth_scale);
        line(format_args!("\n[[kinect]]\nid = \"{}\"\n", kinect.id));
        line(format_args!("t_rig_kinect = {placed}\ntime_offset_ms = {offset_ms:.4}\ndepth_scale = {scale:.6}\n"));
        line(format_args!("{}", sigma(&format!(", depth_scale = {:?}", errors.depth_scale))));
    }
    if scene.stage().is_some() {
        line(format_args!("\n[turntable]\nport = \"/dev/rig/turntable\"\nprotocol = \"zaber\"\n"));
    }
    text
}

fn transform(transform: &Transform) -> String {
    let Transform { translation_m, rotation_xyzw } = transform;
    format!("{{ translation_m = {translation_m:?}, rotation_xyzw = {rotation_xyzw:?} }}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulation::scenes;

    #[test]
    fn a_scene_may_have_any_name() {
        let mut config = scenes::load("demo").expect("a scene").config;
        config.name = r#"the "2nd" bus, C:\bus"#.to_owned();
        let scene = Scene::build(config).expect("a scene");
        let loaded = operators(&scene, Path::new("rig.toml"), &[]).expect("a config");
        assert_eq!(loaded.config.name, scene.config.name);
    }
}
