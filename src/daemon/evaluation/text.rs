//! An evaluation for a terminal, and the tables that the page shares with it.

use tumbled_core::estimate::Mode;

use super::figures::{Errors, MeanSquare, PoseFigures, SigmaOverRms};
use super::report::{EvaluateReport, Scored, TruthClock};
use crate::experiment::text::table;
use crate::limits;

/// The heading of [`motion`].
pub const ERRORS: [&str; 5] = ["error", "r.m.s.", "mean", "largest", "last"];
/// The heading of [`pose`].
pub const POSE: [&str; 9] =
    ["poses", "attitude", "largest", "about axis", "across", "position", "offset", "velocity", "NEES(12), NEES(6)"];
/// The heading of [`sigma`].
pub const SIGMA: [&str; 4] = ["sigma / r.m.s. error", "x", "y", "z"];

/// Errors that no alignment changes.
pub fn motion(scored: &Scored) -> Vec<Vec<String>> {
    let mut rows = Vec::new();
    let mut row = |what: &str, errors: Option<&Errors>, unit: &str| {
        let Some(errors) = errors else { return };
        // No `-0.0000`.
        let cell = |value: f64| format!("{:.4}{unit}", if value.abs() < 5e-5 { 0.0 } else { value });
        rows.push(vec![what.to_owned(), cell(errors.rms), cell(errors.mean), cell(errors.max), cell(errors.end)]);
    };
    if let Some(pose) = &scored.pose {
        row("spin axis", pose.axis_deg.as_ref(), "°");
        row("rate", Some(&pose.rate_dps), "°/s");
    }
    if let Some(turntable) = &scored.turntable {
        row("about the axis", Some(&turntable.about_axis_deg), "°");
        row("axis cone", Some(&turntable.cone_deg), "°");
        row("rate", Some(&turntable.rate_dps), "°/s");
        let tilt = format!("{:.4}°", turntable.tilt_rms_deg);
        rows.push(vec!["tilt off the axis".to_owned(), tilt, "-".into(), "-".into(), "-".into()]);
    }
    rows
}

/// Errors of poses, an alignment a row.
pub fn pose(scored: &Scored) -> Vec<Vec<String>> {
    let square = |found: &MeanSquare| format!("{:.1} ({:.1}-{:.1})", found.mean, found.low, found.high);
    let row = |pose: &PoseFigures| {
        let offset = pose.position_offset_mm.iter().map(|value| value * value).sum::<f64>().sqrt();
        let nees = pose.consistency.as_ref();
        let nees = nees.map_or_else(|| "-".to_owned(), |c| format!("{}, {}", square(&c.nees12), square(&c.nees6)));
        vec![
            pose.alignment.name().to_owned(),
            format!("{:.3}°", pose.attitude_rms_deg),
            format!("{:.3}°", pose.attitude_max_deg),
            format!("{:.3}°", pose.about_axis_rms_deg),
            format!("{:.3}°", pose.across_axis_rms_deg),
            format!("{:.2} mm", pose.position_rms_mm),
            format!("{offset:.1} mm"),
            format!("{:.2} mm/s", pose.velocity_rms_mmps),
            nees,
        ]
    };
    scored.pose.iter().flat_map(|figures| &figures.pose).map(row).collect()
}

/// How stated deviations compare with the errors, axis by axis, gauge-free.
pub fn sigma(scored: &Scored) -> Vec<Vec<String>> {
    let first = scored.pose.as_ref().and_then(|figures| figures.pose.first());
    let Some(consistency) = first.and_then(|pose| pose.consistency.as_ref()) else { return Vec::new() };
    let SigmaOverRms { rotation, translation, velocity, angular_velocity } = consistency.sigma_over_rms;
    let rows = [
        ("rotation (target axes)", rotation),
        ("translation (target axes)", translation),
        ("velocity (rig axes)", velocity),
        ("angular velocity (rig axes)", angular_velocity),
    ];
    let cell = |ratio: Option<f64>| ratio.map_or_else(|| "-".to_owned(), |ratio| format!("{ratio:.2}"));
    rows.iter().map(|(what, ratios)| std::iter::once((*what).to_owned()).chain(ratios.map(cell)).collect()).collect()
}

/// What was scored, and by what.
pub fn scored_line(report: &EvaluateReport, scored: &Scored) -> String {
    let clock = match report.truth.clock {
        TruthClock::Wall => "wall time",
        TruthClock::Session => "session time",
    };
    format!(
        "scored {} states from {:.3} to {:.3} s, {:.0}° of turning; {} not scored; truth: {}, {} samples by {clock}",
        scored.states,
        scored.from_s,
        scored.to_s,
        scored.travel_deg,
        scored.left_out,
        report.truth.name,
        report.truth.samples
    )
}

/// Modes and the most frequent reasons.
pub fn epochs_line(report: &EvaluateReport) -> String {
    let modes = report.modes.iter().filter(|mode| mode.epochs > 0);
    let modes: Vec<String> =
        modes.map(|mode| format!("{} {:.1} %", mode_name(mode.mode), 100.0 * mode.share)).collect();
    let reasons: Vec<String> =
        report.reasons.iter().take(4).map(|count| format!("{} {}", count.reason.name(), count.epochs)).collect();
    let first = report.first_tracking_s.map_or_else(String::new, |at| format!("; tracked from {at:.3} s on"));
    let reasons = if reasons.is_empty() { String::new() } else { format!("; reasons: {}", reasons.join(", ")) };
    format!("{} epochs: {}{first}{reasons}", report.epochs, modes.join(", "))
}

/// The word in the state stream.
fn mode_name(mode: Mode) -> &'static str {
    match mode {
        Mode::NoTarget => "no_target",
        Mode::Acquiring => "acquiring",
        Mode::Tracking => "tracking",
        Mode::Predicted => "predicted",
        Mode::Lost => "lost",
    }
}

/// How often a state that says all is well was wrong, and the measurements' innovations.
pub fn trust_line(scored: &Scored) -> String {
    let wrong = &scored.wrong;
    let nis = scored.nis.as_ref().map_or_else(String::new, |nis| {
        format!("; NIS(6) {:.2} ({:.2}-{:.2} if all is as stated)", nis.mean, nis.low, nis.high)
    });
    format!(
        "`tracking`, `ok` and more than 10° off: {} of {} (95 %: below {:.4} %){nis}",
        wrong.count,
        wrong.of,
        100.0 * wrong.high
    )
}

/// The whole report.
pub fn report(report: &EvaluateReport) -> String {
    let mut text = format!("{}\n", epochs_line(report));
    match (&report.scored, &report.unscored) {
        (Some(scored), _) => {
            text.push_str(&format!("{}\n{}\n", scored_line(report, scored), trust_line(scored)));
            for (heading, rows) in [(&POSE[..], pose(scored)), (&ERRORS, motion(scored)), (&SIGMA, sigma(scored))] {
                if !rows.is_empty() {
                    text.push_str(&format!("\n{}", table(heading, &rows)));
                }
            }
        }
        (None, reason) => text.push_str(&format!("nothing scored: {}\n", reason.as_deref().unwrap_or("unknown"))),
    }
    text + &limits::lines(&report.limits)
}
