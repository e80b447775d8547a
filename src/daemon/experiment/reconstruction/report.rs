//! What the experiment found, for machines and for people.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::trial::Row;
use crate::experiment::machine::Machine;
use crate::experiment::page::{self, page};
use crate::experiment::plot::escaped;
use crate::experiment::text;
use crate::simulation::rig::View;

/// What `tumbled experiment reconstruction` measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled experiment reconstruction --json")]
pub struct ReconstructionReport {
    /// The program's version and commit.
    pub program: String,
    /// Where it ran.
    pub machine: Machine,
    /// Whose view of the rig.
    pub view: View,
    /// The first seed, and how many.
    pub seed: u64,
    /// See `seed`.
    pub seeds: u64,
    /// A line for each target, seed, set of sensors, with and without planes.
    pub rows: Vec<Row>,
    /// What a person should know.
    pub warnings: Vec<String>,
}

const COLUMNS: [&str; 13] = [
    "sensors",
    "planes",
    "LiDAR before",
    "after",
    "ratio",
    "to mesh",
    "worst",
    "complete",
    "precision",
    "recall",
    "loop",
    "axis",
    "rate",
];
/// What must be reached, and what is aimed at, in the columns' order.
const BOUNDS: [[&str; 13]; 2] = [
    ["must", "", "", "", "≥ 2", "≤ 4 mm", "", "≥ 90 %", "≥ 90 %", "≥ 80 %", "≤ 0.3°", "≤ 0.2°", "≤ 0.01 °/s"],
    ["aim", "", "", "", "≥ 3", "≤ 2.5 mm", "", "≥ 97 %", "≥ 95 %", "≥ 95 %", "≤ 0.15°", "≤ 0.08°", "≤ 0.002 °/s"],
];

fn mean(rows: &[&Row], of: impl Fn(&Row) -> Option<f64>) -> Option<f64> {
    let values: Vec<f64> = rows.iter().filter_map(|row| of(row)).collect();
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

fn cells(rows: &[&Row]) -> Vec<String> {
    let told = |value: Option<f64>, decimals: usize, unit: &str| {
        value.map_or_else(|| "-".to_owned(), |value| format!("{value:.decimals$}{unit}"))
    };
    let percent = |of: &dyn Fn(&Row) -> Option<f64>| told(mean(rows, of).map(|share| 100.0 * share), 1, " %");
    let worst = rows.iter().filter_map(|row| row.to_mesh_mm).reduce(f64::max);
    vec![
        rows.first().map(|row| row.sensors.clone()).unwrap_or_default(),
        if rows.first().is_some_and(|row| row.planes) { "yes" } else { "no" }.to_owned(),
        told(mean(rows, |row| row.lidar_before_mm), 1, " mm"),
        told(mean(rows, |row| row.lidar_after_mm), 1, " mm"),
        told(mean(rows, |row| row.lidar_ratio), 1, ""),
        told(mean(rows, |row| row.to_mesh_mm), 2, " mm"),
        told(worst, 2, " mm"),
        percent(&|row| row.complete),
        percent(&|row| row.precision),
        percent(&|row| row.recall),
        told(mean(rows, |row| row.loop_deg), 3, "°"),
        told(mean(rows, |row| row.axis_deg), 3, "°"),
        told(mean(rows, |row| row.rate_dps), 4, " °/s"),
    ]
}

impl ReconstructionReport {
    /// What the figures are.
    fn about(&self) -> String {
        format!(
            "one turn at 20°/s, 2.2 m away, {} config; {} seeds from {} on, means over them; contour: within 1.5 cm and 1°",
            match self.view {
                View::Operator => "the operator's",
                View::Truth => "the true",
            },
            self.seeds,
            self.seed
        )
    }

    /// Each target's lines.
    fn tables(&self) -> Vec<(String, Vec<Vec<String>>)> {
        let mut targets: Vec<&str> = Vec::new();
        for row in &self.rows {
            if !targets.contains(&row.target.as_str()) {
                targets.push(&row.target);
            }
        }
        let table = |target: &str| {
            let mut kinds: Vec<(&str, bool)> = Vec::new();
            for row in self.rows.iter().filter(|row| row.target == target) {
                if !kinds.contains(&(row.sensors.as_str(), row.planes)) {
                    kinds.push((&row.sensors, row.planes));
                }
            }
            let line = |(sensors, planes): &(&str, bool)| {
                let of = |row: &&Row| row.target == target && row.sensors == *sensors && row.planes == *planes;
                cells(&self.rows.iter().filter(of).collect::<Vec<_>>())
            };
            let bounds = BOUNDS.map(|bound| bound.map(str::to_owned).to_vec());
            (target.to_owned(), kinds.iter().map(line).chain(bounds).collect())
        };
        targets.into_iter().map(table).collect()
    }

    /// For a terminal.
    pub fn text(&self) -> String {
        let mut text = format!("{}\n{}\n", self.machine.line(), self.about());
        for (target, lines) in self.tables() {
            text.push_str(&format!("\n{target}\n{}", text::table(&COLUMNS, &lines)));
        }
        text
    }

    /// As a page.
    pub fn page(&self) -> String {
        let mut body = format!(
            "<h1>Reconstruction experiment</h1><p>{} on {}</p><p>{}</p>",
            escaped(&self.program),
            escaped(&self.machine.line()),
            escaped(&self.about())
        );
        for warning in &self.warnings {
            body.push_str(&format!("<p class=\"bad\">{}</p>", escaped(warning)));
        }
        for (target, lines) in self.tables() {
            body.push_str(&format!("<h2>{}</h2>{}", escaped(&target), page::table(&COLUMNS, &lines)));
        }
        page("tumbled: reconstruction experiment", &body)
    }
}
