//! Both clouds before and after in a page of its own: no network, no other file.

use std::path::{Path, PathBuf};

use serde::Serialize;
use tumbled_core::register::{Cloud, Registration};

use super::report::{CloudReport, PoseReport, RegisterReport};
use super::text::Sigmas;
use crate::cli::{Failure, output};
use crate::experiment::trial::centroid;

/// The page, with a place for its data.
const PAGE: &str = include_str!("viewer.html");
const PLACE: &str = "DATA_OF_THE_PAGE";
/// Points of a cloud that a browser turns smoothly.
const SHOWN: usize = 40_000;

/// What the page is given.
#[derive(Debug, Serialize)]
struct Data<'a> {
    method: &'a str,
    accepted: bool,
    reason: Option<&'a str>,
    moving: Shown<'a>,
    reference: Shown<'a>,
    poses: Vec<Pose>,
}

#[derive(Debug, Serialize)]
struct Shown<'a> {
    name: String,
    sensor: &'a str,
    count: usize,
    shown: usize,
    /// x, y, z of each, tenths of a millimetre.
    points: Vec<i32>,
}

#[derive(Debug, Serialize)]
struct Pose {
    name: String,
    t_reference_moving: PoseReport,
    figures: Vec<[String; 2]>,
}

/// Writes the page.
///
/// # Errors
/// A file that cannot be written: exit code 1.
pub(super) fn write(
    page: &Path,
    names: [&PathBuf; 2],
    clouds: [&Cloud; 2],
    report: &RegisterReport,
    found: &Registration,
) -> Result<(), Failure> {
    let text = page_of(names, clouds, report, found)?;
    output::file(page, text)
}

fn page_of(
    [moving_name, reference_name]: [&PathBuf; 2],
    [moving, reference]: [&Cloud; 2],
    report: &RegisterReport,
    found: &Registration,
) -> Result<String, Failure> {
    let data = Data {
        method: &report.method,
        accepted: report.accepted,
        reason: report.reason.as_deref(),
        moving: shown(moving_name, moving, &report.moving),
        reference: shown(reference_name, reference, &report.reference),
        poses: poses(moving, report, found),
    };
    let json = serde_json::to_string(&data).map_err(Failure::failed)?;
    // `<` only stands in texts: written so, no text can end the element.
    Ok(PAGE.replacen(PLACE, &json.replace('<', "\\u003c"), 1))
}

fn shown<'a>(path: &Path, cloud: &Cloud, report: &'a CloudReport) -> Shown<'a> {
    let every = cloud.points.len().div_ceil(SHOWN).max(1);
    let tenths = |metres: f32| (f64::from(metres) * 1e4).round() as i32;
    let points: Vec<i32> =
        cloud.points.iter().step_by(every).flat_map(|point| [point.x, point.y, point.z].map(tenths)).collect();
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    Shown { name, sensor: &report.sensor, count: cloud.points.len(), shown: points.len() / 3, points }
}

fn poses(moving: &Cloud, report: &RegisterReport, found: &Registration) -> Vec<Pose> {
    let at = found.t_reference_moving * centroid(moving);
    let sigma = Sigmas::of(found, &at.coords);
    let row = |what: &str, value: String| [what.to_owned(), value];
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    let place = |pose: &PoseReport| {
        let ([x, y, z], [i, j, k, w]) = (pose.translation_m, pose.rotation_xyzw);
        [
            row("Translation, m", format!("{x:.4} {y:.4} {z:.4}")),
            row("Rotation x y z w", format!("{i:.5} {j:.5} {k:.5} {w:.5}")),
        ]
    };
    let mut figures = place(&report.t_reference_moving).to_vec();
    figures.extend([
        row("± rotation", format!("{:.2}°", sigma.rotation_deg)),
        row("± position at the centroid", format!("{:.1} mm", sigma.position_mm)),
        row("Score", format!("{:.3}", report.score)),
        row("Ahead of the next pose by", report.gap.map_or_else(|| "-".to_owned(), |gap| format!("{gap:.3}"))),
        row("Probability", percent(report.probability)),
        row("On the surface", percent(report.inliers)),
        row("R.m.s. distance", format!("{:.1} mm", 1e3 * report.rmse_m)),
        row("Iterations", report.iterations.to_string()),
        row("Time", format!("{:.1} ms", report.time_ms)),
    ]);
    let result = Pose { name: "result".to_owned(), t_reference_moving: report.t_reference_moving, figures };
    let alternative = |(mode, n): (&super::report::Alternative, u32)| {
        let mut figures = place(&mode.t_reference_moving).to_vec();
        figures.extend([row("Score", format!("{:.3}", mode.score)), row("Probability", percent(mode.probability))]);
        Pose { name: format!("alternative {n}"), t_reference_moving: mode.t_reference_moving, figures }
    };
    std::iter::once(result).chain(report.alternatives.iter().zip(1..).map(alternative)).collect()
}
