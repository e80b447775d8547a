//! What `calibrate turntable` tells: the stage's axis in the rig.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_calib::Status;
use tumbled_calib::turntable::{TurnedPose, TurntableFit, across};
use tumbled_core::evaluate::EstimateSample;

use super::frame::{self, Parameter};
use super::provenance::Provenance;
use crate::config::calibration::CalibratedTurntable;
use crate::experiment::plot::{Line, Plot};

/// Poses nearer to each other tell nothing new, rad: 2°.
const APART: f64 = 2.0 / 180.0 * std::f64::consts::PI;
/// Poses used at most: 11 turns of 2°.
const MOST_POSES: usize = 2_000;

/// `tumbled calibrate turntable --json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled calibrate turntable --json")]
pub struct TurntableReport {
    /// The verdict, gates and inputs.
    pub provenance: Provenance,
    /// The result; null: there is none, and a gate says why.
    pub turntable: Option<CalibratedTurntable>,
    /// One standard deviation of the axis, degrees: the larger of its two tilts.
    pub axis_sigma_deg: Option<f64>,
    /// Of its point, mm.
    pub point_sigma_mm: Option<f64>,
    /// Of the gain.
    pub gain_sigma: Option<f64>,
    /// Angle between the axis found and the rig's z axis, degrees.
    pub tilt_deg: Option<f64>,
    /// Poses used.
    pub poses: u64,
    /// How many of them are independent.
    pub independent: u64,
    /// From the smallest to the largest angle of the stage, degrees.
    pub span_deg: Option<f64>,
    /// Scatter of the poses about the fit along one axis, degrees.
    pub scatter_deg: Option<f64>,
    /// The same of their places, mm.
    pub scatter_mm: Option<f64>,
    /// What is not independent of the sensors.
    pub note: String,
    /// The file the result stands in; null: it was not written.
    pub written: Option<String>,
    /// What a person should know.
    pub warnings: Vec<String>,
}

/// What the figures do not tell.
pub const NOTE: &str = "The poses are the sensors' own: an error of their mounting turns the axis and moves its point alike, and no \
     scatter shows it. Against this axis the encoder checks angle, axis and rate; an absolute place it does not.";

/// States with their angles as poses, thinned to some degrees of turning.
pub fn poses(turned: &[(&EstimateSample, f64)]) -> Vec<TurnedPose> {
    let travel: f64 = turned.iter().zip(turned.iter().skip(1)).map(|(a, b)| (b.1 - a.1).abs()).sum();
    let apart = APART.max(travel / MOST_POSES as f64);
    let mut poses: Vec<TurnedPose> = Vec::new();
    for (state, angle_rad) in turned {
        if poses.last().is_none_or(|last| (angle_rad - last.angle_rad).abs() >= apart) {
            poses.push(TurnedPose { angle_rad: *angle_rad, t_rig_target: state.t_rig_target });
        }
    }
    poses
}

/// The result as it stands in the file.
pub fn calibrated(fit: &TurntableFit) -> CalibratedTurntable {
    let entry = |row: usize, column: usize| fit.covariance.get((row, column)).copied().unwrap_or_default();
    CalibratedTurntable {
        axis: fit.axis.into_inner().into(),
        point_m: fit.point_m.into(),
        angle0_rad: fit.angle0_rad,
        sign: fit.sign,
        gain: fit.gain,
        covariance: std::array::from_fn(|row| std::array::from_fn(|column| entry(row, column))),
    }
}

/// The report of a fit, or of none.
pub fn report(fit: Option<&TurntableFit>, mut provenance: Provenance, warnings: Vec<String>) -> TurntableReport {
    if let Some(fit) = fit {
        let [u, v] = across(&fit.axis);
        let named = |what: &str, d: nalgebra::Vector3<f64>| format!("{what} ({:.3}, {:.3}, {:.3})", d.x, d.y, d.z);
        provenance.covariance_of = vec![
            named("rotation of the axis, rad, about", u),
            named("rotation of the axis, rad, about", v),
            named("offset of the point, m, along", u),
            named("offset of the point, m, along", v),
        ];
        provenance.covariance = calibrated(fit).covariance.iter().map(|row| row.to_vec()).collect();
    }
    TurntableReport {
        provenance,
        turntable: fit.map(calibrated),
        axis_sigma_deg: fit.map(|fit| fit.axis_sigma_rad().to_degrees()),
        point_sigma_mm: fit.map(|fit| 1e3 * fit.point_sigma_m()),
        gain_sigma: fit.map(|fit| fit.gain_sigma),
        tilt_deg: fit.map(|fit| fit.axis.angle(&nalgebra::Vector3::z()).to_degrees()),
        poses: fit.map_or(0, |fit| fit.poses as u64),
        independent: fit.map_or(0, |fit| fit.independent as u64),
        span_deg: fit.map(|fit| fit.span_rad.to_degrees()),
        scatter_deg: fit.map(|fit| fit.scatter.0.to_degrees()),
        scatter_mm: fit.map(|fit| 1e3 * fit.scatter.1),
        note: NOTE.to_owned(),
        written: None,
        warnings,
    }
}

/// What is read on a terminal.
pub fn text(report: &TurntableReport) -> String {
    let mut text = format!("{}\n", frame::verdict(&report.provenance));
    for parameter in parameters(report) {
        text.push_str(&format!("  {:<28} {}  ± {}\n", parameter.name, parameter.value, parameter.sigma));
    }
    for gate in report.provenance.gates.iter().filter(|gate| gate.status != Status::Pass) {
        let remedy = gate.remedy.as_deref().unwrap_or_default();
        text.push_str(&format!("  {}: {}: {remedy}\n", gate.status.name(), gate.name));
    }
    if let Some(path) = &report.written {
        text.push_str(&format!("written to {path}\n"));
    }
    text
}

fn parameters(report: &TurntableReport) -> Vec<Parameter> {
    let Some(found) = &report.turntable else { return Vec::new() };
    let vector = |[x, y, z]: [f64; 3]| format!("({x:.5}, {y:.5}, {z:.5})");
    let told = |value: Option<f64>, unit: &str| value.map_or_else(String::new, |v| format!("{v:.4} {unit}"));
    let row = |name: &str, value: String, sigma| Parameter { name: name.to_owned(), value, sigma };
    let counts = if found.sign > 0.0 { "counter-clockwise" } else { "clockwise" };
    vec![
        row("axis, rig axes", vector(found.axis), told(report.axis_sigma_deg, "deg")),
        row("its point nearest the origin", format!("{} m", vector(found.point_m)), told(report.point_sigma_mm, "mm")),
        row("the encoder counts", format!("{counts} about the axis (sign {:+})", found.sign), "–".to_owned()),
        row("gain", format!("{:.5}", found.gain), told(report.gain_sigma, "")),
        row("tilt off the rig's z axis", told(report.tilt_deg, "deg"), told(report.axis_sigma_deg, "deg")),
    ]
}

/// The report's page.
pub fn page(report: &TurntableReport, fit: Option<&TurntableFit>, poses: &[TurnedPose]) -> String {
    let mut rest = format!("<p>{NOTE}</p>");
    if let Some(fit) = fit {
        let line = |name: &str, value: &dyn Fn(usize) -> f64| Line {
            name: name.to_owned(),
            points: poses.iter().enumerate().map(|(n, pose)| (pose.angle_rad.to_degrees(), value(n))).collect(),
        };
        let part = |n: usize| fit.residuals.get(n).copied().unwrap_or_default();
        let about = |n: usize| part(n).0.dot(&fit.axis).to_degrees();
        let across = |n: usize| (part(n).0 - fit.axis.scale(part(n).0.dot(&fit.axis))).norm().to_degrees();
        let place = |n: usize| 1e3 * part(n).1.norm();
        let plot = |title: &str, y: &str, lines: Vec<Line>| Plot {
            title: title.to_owned(),
            x: "encoder, degrees".to_owned(),
            y: y.to_owned(),
            logarithmic: false,
            y_to: 0.0,
            lines,
        };
        rest.push_str("<h2>What the fit leaves of each pose</h2>");
        rest.push_str(&plot("rotation", "degrees", vec![line("about", &about), line("across", &across)]).svg());
        rest.push_str(&plot("place", "mm", vec![line("distance", &place)]).svg());
    }
    let about = "The stage's axis in the rig's frame, from the target's poses and the encoder's angles.";
    frame::report("Turntable", about, &report.provenance, &parameters(report), &rest)
}
