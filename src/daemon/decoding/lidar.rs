//! The config's words for a LiDAR, as the decoder's settings.

use tumbled_velodyne::Model;
use tumbled_velodyne::hdl64::Calibration;
use tumbled_velodyne::stream::{Settings, StampReference};

use crate::cli::Failure;
use crate::config::{Hdl32eStamp, LidarConfig, LidarModel, Switch};

/// The decoder's settings. No range limits: these are the pipeline's.
///
/// # Errors
/// An HDL-64E calibration that cannot be understood: exit code 2.
pub fn settings(lidar: &LidarConfig) -> Result<Settings, Failure> {
    Ok(Settings {
        model: forced_model(lidar.model),
        vertical_offsets: match lidar.vertical_offsets {
            Switch::Auto => None,
            Switch::On => Some(true),
            Switch::Off => Some(false),
        },
        hdl32e_stamp: match lidar.hdl32e_stamp {
            Hdl32eStamp::First => StampReference::FirstFiring,
            Hdl32eStamp::Last => StampReference::LastFiring,
        },
        hdl64e_calibration: hdl64e_calibration(lidar)?,
        range_limits_m: None,
    })
}

/// The model a config forces; `None`: the packets' own word is taken.
pub fn forced_model(model: LidarModel) -> Option<Model> {
    match model {
        LidarModel::Auto => None,
        LidarModel::Vlp32c => Some(Model::Vlp32c),
        LidarModel::Vlp16 => Some(Model::Vlp16),
        LidarModel::Vlp16HiRes => Some(Model::Vlp16HiRes),
        LidarModel::Hdl32e => Some(Model::Hdl32e),
        LidarModel::Hdl64e => Some(Model::Hdl64e),
    }
}

fn hdl64e_calibration(lidar: &LidarConfig) -> Result<Option<Calibration>, Failure> {
    let Some(file) = &lidar.calibration else { return Ok(None) };
    let problem = |error: String| Failure::input(format!("the calibration {}: {error}", file.place));
    let text = file.text().map_err(|error| problem(error.to_string()))?;
    Calibration::parse(text).map(Some).map_err(|error| problem(error.to_string()))
}
