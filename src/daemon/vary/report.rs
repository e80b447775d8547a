//! The figures of a capture against each value of an assumption.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::evaluate::{EvaluateOptions, evaluate_turntable};
use tumbled_model::RigNs;

use crate::calibration::plays::Played;
use crate::experiment::page::table;

/// A curve whose ends are less than this share above its least value says nothing.
const FLAT: f64 = 0.02;

/// `tumbled replay --vary --json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled replay --vary --json")]
pub struct VaryReport {
    /// Version and commit of the program.
    pub program: String,
    /// The inputs as they were given.
    pub inputs: Vec<String>,
    /// Whether angle and rate are held against a turntable's encoder.
    pub turntable: bool,
    /// Session time from which on states count, s: the same in all plays.
    pub from_s: f64,
    /// Assumption by assumption; the others are as the config has them.
    pub assumptions: Vec<AssumptionRows>,
    /// Nothing of the inputs was missing. Otherwise the exit code is 3.
    pub complete: bool,
    /// What a person should know.
    pub warnings: Vec<String>,
}

/// One assumption.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AssumptionRows {
    /// What is varied, with its unit: `near.time_offset_ms`.
    pub name: String,
    /// Value by value.
    pub rows: Vec<ValueRow>,
    /// Where each figure is least.
    pub minima: Vec<Minimum>,
}

/// The figures of one value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ValueRow {
    /// Added to what the config has.
    pub value: f64,
    /// Epochs that count.
    pub states: u64,
    /// The mean spin axis, rig axes; null: it did not turn.
    pub axis: Option<[f64; 3]>,
    /// Angle of the states' spin axes with it, r.m.s., degrees.
    pub axis_rms_deg: Option<f64>,
    /// Rate less the encoder's, or without one less its mean, r.m.s., °/s.
    pub rate_rms_dps: Option<f64>,
    /// Angle about the axis less the encoder's, r.m.s. about its mean, degrees.
    pub about_axis_rms_deg: Option<f64>,
    /// Tilt of the target off the axis, r.m.s., degrees.
    pub tilt_rms_deg: Option<f64>,
    /// Distance of the registered points from the model, r.m.s., mm.
    pub residual_rms_mm: Option<f64>,
    /// Mean of the innovations' normalised squares; 6 if all is as assumed.
    pub nis: Option<f64>,
}

/// Where a figure is least.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Minimum {
    /// The figure.
    pub figure: String,
    /// Where it is least, by a parabola through the lowest value and its neighbours, in the assumption's unit.
    pub at: f64,
    /// How much higher the lower end of the curve is, a share of the least value.
    pub depth: f64,
    /// `inside`: evidence; `edge`: it is least at an end, vary farther; `flat`: the capture does not tell.
    pub kind: MinimumKind,
}

/// What a minimum is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MinimumKind {
    /// Evidence.
    Inside,
    /// Least at an end.
    Edge,
    /// The same everywhere.
    Flat,
}

/// A figure by its name, as tables and curves have it.
type Figure = (&'static str, fn(&ValueRow) -> Option<f64>);

/// The figures that have a minimum.
pub const FIGURES: [Figure; 6] = [
    ("axis, deg", |row| row.axis_rms_deg),
    ("rate, deg/s", |row| row.rate_rms_dps),
    ("about the axis, deg", |row| row.about_axis_rms_deg),
    ("tilt, deg", |row| row.tilt_rms_deg),
    ("residual, mm", |row| row.residual_rms_mm),
    ("NIS", |row| row.nis),
];

/// The figures of a play from a time on, against the turntable where there is one.
pub fn row(value: f64, played: &Played, from: RigNs) -> ValueRow {
    let states: Vec<_> = played.gathered.estimates.iter().filter(|state| state.t >= from).collect();
    let mut row = ValueRow {
        value,
        states: states.len() as u64,
        residual_rms_mm: played.residual_rms_m.map(|metres| 1e3 * metres),
        nis: mean(states.iter().filter_map(|state| state.nis)),
        ..ValueRow::default()
    };
    let options = EvaluateOptions { from: Some(from), ..EvaluateOptions::default() };
    let against = (!played.gathered.turntable.is_empty())
        .then(|| played.encoder(&mut Vec::new()).ok())
        .flatten()
        .and_then(|encoder| evaluate_turntable(&played.gathered.estimates, &encoder, &options).ok());
    if let Some(found) = against {
        row.axis = Some(found.axis.into());
        row.axis_rms_deg = Some(found.cone_rad.rms.to_degrees());
        row.rate_rms_dps = Some(found.rate_rps.rms.to_degrees());
        row.about_axis_rms_deg = Some(found.about_axis_rad.rms.to_degrees());
        row.tilt_rms_deg = Some(found.tilt_rms_rad.to_degrees());
        return row;
    }
    let spins = || states.iter().map(|state| state.angular_velocity_rps);
    let sum: nalgebra::Vector3<f64> = spins().sum();
    let mean_rate = mean(spins().map(|spin| spin.norm()));
    let Some((axis, rate)) = sum.try_normalize(1e-9).zip(mean_rate.filter(|rate| rate.to_degrees() > 0.5)) else {
        return row;
    };
    let rms = |squares: Option<f64>| squares.map(|square| square.sqrt().to_degrees());
    row.axis = Some(axis.into());
    row.axis_rms_deg = rms(mean(spins().map(|spin| spin.angle(&axis) * spin.angle(&axis))));
    row.rate_rms_dps = rms(mean(spins().map(|spin| (spin.norm() - rate) * (spin.norm() - rate))));
    row
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_u64), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / count as f64)
}

/// Where each figure is least.
pub fn minima(rows: &[ValueRow]) -> Vec<Minimum> {
    let of = |(name, figure): &Figure| {
        let points: Option<Vec<(f64, f64)>> = rows.iter().map(|row| Some((row.value, figure(row)?))).collect();
        minimum(name, &points?)
    };
    FIGURES.iter().filter_map(of).collect()
}

/// Of at least three points at even steps.
fn minimum(figure: &str, points: &[(f64, f64)]) -> Option<Minimum> {
    let lowest = points.iter().enumerate().min_by(|a, b| a.1.1.total_cmp(&b.1.1))?.0;
    let (first, at, last) = (points.first()?, points.get(lowest)?, points.last()?);
    let depth = if at.1 > 0.0 { first.1.min(last.1) / at.1 - 1.0 } else { 0.0 };
    let highest = points.iter().map(|point| point.1).fold(f64::NEG_INFINITY, f64::max);
    let told = |at, kind| Some(Minimum { figure: figure.to_owned(), at, depth, kind });
    if at.1 > 0.0 && highest / at.1 - 1.0 < FLAT {
        return told(at.0, MinimumKind::Flat);
    }
    let around = lowest.checked_sub(1).and_then(|before| Some((points.get(before)?, points.get(lowest + 1)?)));
    let Some((before, after)) = around else { return told(at.0, MinimumKind::Edge) };
    let bend = before.1 - 2.0 * at.1 + after.1;
    let shift = if bend > 0.0 { 0.5 * (before.1 - after.1) / bend } else { 0.0 };
    told(at.0 + shift * (after.0 - at.0), if depth < FLAT { MinimumKind::Flat } else { MinimumKind::Inside })
}

/// What is read on a terminal.
pub fn text(report: &VaryReport) -> String {
    let mut text = String::new();
    for assumption in &report.assumptions {
        let Some(first) = assumption.rows.first() else { continue };
        let figures: Vec<&Figure> = FIGURES.iter().filter(|(_, figure)| figure(first).is_some()).collect();
        text.push_str(&format!("{}, added to the config's\n{:>10}", assumption.name, "value"));
        figures.iter().for_each(|(name, _)| text.push_str(&format!("  {name:>19}")));
        text.push('\n');
        for row in &assumption.rows {
            text.push_str(&format!("{:>10.3}", row.value));
            for (_, figure) in &figures {
                text.push_str(&format!("  {:>19}", figure(row).map_or_else(|| "-".to_owned(), |v| format!("{v:.4}"))));
            }
            text.push('\n');
        }
        for minimum in &assumption.minima {
            text.push_str(&format!("  {}\n", sentence(minimum)));
        }
    }
    text
}

/// What a minimum says.
pub fn sentence(minimum: &Minimum) -> String {
    let Minimum { figure, at, depth, kind } = minimum;
    match kind {
        MinimumKind::Inside => format!("{figure}: least at {at:+.3}, the ends are {:.0} % higher", 100.0 * depth),
        MinimumKind::Edge => format!("{figure}: least at the end {at:+.3}: vary farther"),
        MinimumKind::Flat => format!("{figure}: the capture does not tell it"),
    }
}

/// The rows as a page's table.
pub fn html_table(assumption: &AssumptionRows) -> String {
    let head: Vec<&str> = std::iter::once("value").chain(FIGURES.iter().map(|(name, _)| *name)).collect();
    let row = |row: &ValueRow| {
        let cell = |(_, figure): &Figure| figure(row).map_or_else(|| "–".to_owned(), |value| format!("{value:.4}"));
        std::iter::once(format!("{:+.3}", row.value)).chain(FIGURES.iter().map(cell)).collect()
    };
    let rows: Vec<Vec<String>> = assumption.rows.iter().map(row).collect();
    table(&head, &rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(at: f64, floor: f64, bend: f64) -> Vec<(f64, f64)> {
        (-4..=4).map(f64::from).map(|x| (x, floor + bend * (x - at) * (x - at))).collect()
    }

    #[test]
    fn a_parabola_is_least_where_it_is_and_a_flat_curve_tells_nothing() {
        let found = minimum("NIS", &curve(0.7, 5.0, 0.5)).expect("nine points");
        assert!((found.at - 0.7).abs() < 1e-9 && found.kind == MinimumKind::Inside, "{found:?}");
        // The nearer end, 4: 5 + 0.5 · 3.3² = 10.445, 5.045 is the lowest point's.
        assert!((found.depth - (10.445 / 5.045 - 1.0)).abs() < 1e-9, "{found:?}");
        assert_eq!(minimum("NIS", &curve(0.7, 5.0, 1e-3)).map(|found| found.kind), Some(MinimumKind::Flat));
        assert_eq!(minimum("NIS", &curve(9.0, 5.0, 0.5)).map(|found| found.kind), Some(MinimumKind::Edge));
    }
}
