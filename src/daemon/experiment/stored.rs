//! Pairs as files, for other programs to register: two clouds, the truth, and where to begin.

use std::fs;
use std::io;
use std::path::Path;

use nalgebra::Point3;
use serde::Serialize;
use tumbled_core::register::Prior;

use super::pairs::Pair;
use crate::cli::register::report::PoseReport;

/// What is known of a stored pair.
#[derive(Debug, Serialize)]
struct Known {
    /// The truth, in the form that `register --init` takes.
    t_reference_moving: Option<PoseReport>,
    overlap: Option<f64>,
    sights_deg: Option<f64>,
}

/// A guess, in the same form.
#[derive(Debug, Serialize)]
struct Guess {
    t_reference_moving: PoseReport,
}

/// Writes `NNNN-kinect.ply` (moving), `NNNN-lidar.ply` (reference), `NNNN-truth.json` and, if there is a prior,
/// `NNNN-prior.json` into a folder.
///
/// # Errors
/// Files that cannot be written.
pub fn write(pair: &Pair, prior: Option<&Prior>, folder: &Path) -> io::Result<()> {
    let name = |what: &str| folder.join(format!("{:04}-{what}", pair.index));
    fs::write(name("kinect.ply"), ply(&pair.moving.points))?;
    fs::write(name("lidar.ply"), ply(&pair.reference.points))?;
    let known = Known {
        t_reference_moving: pair.truth.as_ref().map(Into::into),
        overlap: pair.overlap,
        sights_deg: pair.sights_deg,
    };
    fs::write(name("truth.json"), json(&known)?)?;
    if let Some(prior) = prior {
        fs::write(name("prior.json"), json(&Guess { t_reference_moving: (&prior.t_reference_moving).into() })?)?;
    }
    Ok(())
}

fn json(of: &impl Serialize) -> io::Result<String> {
    Ok(serde_json::to_string_pretty(of)? + "\n")
}

/// A cloud as a binary PLY.
fn ply(points: &[Point3<f32>]) -> Vec<u8> {
    let header = format!(
        "ply\nformat binary_little_endian 1.0\ncomment metres, in the sensor's own frame\nelement vertex {}\n\
        property float x\nproperty float y\nproperty float z\nend_header\n",
        points.len()
    );
    let numbers = points.iter().flat_map(|point| [point.x, point.y, point.z]).flat_map(f32::to_le_bytes);
    header.into_bytes().into_iter().chain(numbers).collect()
}
