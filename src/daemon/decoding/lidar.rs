//! The config's words for a LiDAR, as the decoder's settings.

use tumbled_velodyne::Model;
use tumbled_velodyne::hdl64::Calibration;
use tumbled_velodyne::stream::{Settings, StampReference};

use crate::cli::Failure;
use crate::config::{Hdl32eStamp, LidarConfig, LidarModel, Switch};

/// The decoder's settings; the HDL-64E calibration file is read here. No range limits: these are the pipeline's.
///
/// # Errors
/// A calibration file that cannot be read or understood: exit code 2.
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

fn forced_model(model: LidarModel) -> Option<Model> {
    match model {
        LidarModel::Auto => None,
        LidarModel::Vlp32c => Some(Model::Vlp32c),
        LidarModel::Vlp16 => Some(Model::Vlp16),
        LidarModel::Vlp16HiRes => Some(Model::Vlp16HiRes),
        LidarModel::Hdl32e => Some(Model::Hdl32e),
        LidarModel::Hdl64e => Some(Model::Hdl64e),
    }
}

/// Reads the calibration file. The config check has warned of one that is not there, or is no file, where it may not be
/// needed.
fn hdl64e_calibration(lidar: &LidarConfig) -> Result<Option<Calibration>, Failure> {
    let Some(path) = lidar.calibration.as_ref().filter(|path| path.exists()) else { return Ok(None) };
    if !matches!(lidar.model, LidarModel::Auto | LidarModel::Hdl64e) {
        return Ok(None);
    }
    let text = std::fs::read_to_string(path)
        .map_err(|error| Failure::input(format!("cannot read the calibration {}: {error}", path.display())))?;
    let calibration = Calibration::parse(&text)
        .map_err(|error| Failure::input(format!("the calibration {}: {error}", path.display())))?;
    Ok(Some(calibration))
}
