//! A guess from a file.

use std::fs;
use std::path::Path;

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use serde::Deserialize;
use tumbled_core::register::Prior;

use super::Failure;

/// The part of the file that is read: a result of `register --json` has more.
#[derive(Debug, Deserialize)]
struct Guess {
    t_reference_moving: Pose,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Pose {
    translation_m: [f64; 3],
    rotation_xyzw: [f64; 4],
}

/// What a file with a guess looks like.
const EXPECTED: &str =
    "write {\"t_reference_moving\": {\"translation_m\": [0, 0, 0], \"rotation_xyzw\": [0, 0, 0, 1]}}";
/// A quaternion is re-normalised within this of length 1.
const UNIT: f64 = 1e-6;

/// Reads a guess and gives it its standard deviations, degrees and m.
///
/// # Errors
/// A file that holds none: exit code 2.
pub(super) fn read(path: &Path, sigma_deg: f64, sigma_m: f64) -> Result<Prior, Failure> {
    let wrong = |problem: String| Failure::input(format!("{}: {problem}", path.display())).with_help(EXPECTED);
    let text = fs::read_to_string(path).map_err(|error| wrong(format!("cannot be read: {error}")))?;
    let Guess { t_reference_moving: Pose { translation_m, rotation_xyzw } } =
        serde_json::from_str(&text).map_err(|error| wrong(error.to_string()))?;
    let [i, j, k, w] = rotation_xyzw;
    let quaternion = Quaternion::new(w, i, j, k);
    let length = quaternion.norm();
    if length.is_nan() || (length - 1.0).abs() >= UNIT {
        return Err(wrong(format!("rotation_xyzw {rotation_xyzw:?} has length {length}, 1 expected")));
    }
    let [x, y, z] = translation_m;
    let rotation = UnitQuaternion::from_quaternion(quaternion);
    Ok(Prior {
        t_reference_moving: Isometry3::from_parts(Translation3::new(x, y, z), rotation),
        sigma_rotation_rad: sigma_deg.to_radians(),
        sigma_translation_m: sigma_m,
    })
}
