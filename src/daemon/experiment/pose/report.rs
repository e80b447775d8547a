//! What the experiment found, for machines and for people.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::figures::{AtRest, PoseRow, Spread};
use crate::experiment::machine::Machine;
use crate::experiment::page::{self, page};
use crate::experiment::plot::{Line, Plot, escaped};
use crate::experiment::text;

/// What `tumbled experiment pose` measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled experiment pose --json")]
pub struct PoseExperimentReport {
    /// The program's version and commit.
    pub program: String,
    /// Where it ran.
    pub machine: Machine,
    /// The inputs, or `simulated`.
    pub source: Vec<String>,
    /// What the rests were found by: `scene`, `turntable ID` or `estimate`.
    pub rests_by: String,
    /// The seed.
    pub seed: u64,
    /// A line for each set, axis and method.
    pub rows: Vec<PoseRow>,
    /// What a person should know.
    pub warnings: Vec<String>,
}

const COLUMNS: [&str; 10] = [
    "method",
    "rests",
    "attitude r.m.s.",
    "largest",
    "position",
    "axis",
    "step axis r.m.s.",
    "largest",
    "step angle r.m.s.",
    "largest",
];

fn cells(row: &PoseRow) -> Vec<String> {
    let number =
        |value: Option<f64>, unit: &str| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.3}{unit}"));
    let rms = |spread: &Option<Spread>| number(spread.map(|spread| spread.rms), "°");
    let max = |spread: &Option<Spread>| number(spread.map(|spread| spread.max), "°");
    vec![
        row.method.name().to_owned(),
        format!("{}/{}", row.posed, row.rests),
        rms(&row.attitude_deg),
        max(&row.attitude_deg),
        row.position_rms_mm.map_or_else(|| "-".to_owned(), |value| format!("{value:.1} mm")),
        number(row.axis_deg, "°"),
        rms(&row.step_axis_deg),
        max(&row.step_axis_deg),
        rms(&row.step_deg),
        max(&row.step_deg),
    ]
}

/// The rows of one session after the other.
fn sessions(rows: &[PoseRow]) -> impl Iterator<Item = &[PoseRow]> {
    rows.chunk_by(|a, b| (&a.set, &a.axis) == (&b.set, &b.axis))
}

fn title(rows: &[PoseRow]) -> String {
    let Some(first) = rows.first() else { return String::new() };
    match &first.axis {
        Some(axis) => format!("{} and Kinect, about {axis}", first.set),
        None => first.set.clone(),
    }
}

impl PoseExperimentReport {
    /// What the figures are.
    fn about(&self) -> String {
        format!(
            "{}, rests by {}, seed {}; attitude: at the rests, gauge-free; axis: of all steps together; step axis and angle: \
             from rest to rest",
            self.source.join(", "),
            self.rests_by,
            self.seed
        )
    }

    /// For a terminal.
    pub fn text(&self) -> String {
        let mut text = format!("{}\n{}\n", self.machine.line(), self.about());
        for rows in sessions(&self.rows) {
            let lines: Vec<Vec<String>> = rows.iter().map(cells).collect();
            text.push_str(&format!("\n{}\n{}", title(rows), text::table(&COLUMNS, &lines)));
        }
        text
    }

    /// As a page, with plots rest by rest.
    pub fn page(&self) -> String {
        let mut body = format!(
            "<h1>Rotation experiment</h1><p>{} on {}</p><p>{}</p>",
            escaped(&self.program),
            escaped(&self.machine.line()),
            escaped(&self.about())
        );
        for warning in &self.warnings {
            body.push_str(&format!("<p class=\"bad\">{}</p>", escaped(warning)));
        }
        for rows in sessions(&self.rows) {
            let lines: Vec<Vec<String>> = rows.iter().map(cells).collect();
            let plot = |name: &str, of: &dyn Fn(&AtRest) -> Option<f64>| {
                let line = |row: &PoseRow| Line {
                    name: row.method.name().to_owned(),
                    points: row.at.iter().filter_map(|at| Some((at.rest as f64, of(at)?))).collect(),
                };
                let lines = rows.iter().map(line).collect();
                let x = "rest".to_owned();
                Plot { title: format!("{name}, degrees"), x, y: String::new(), logarithmic: true, y_to: 0.0, lines }
                    .svg()
            };
            body.push_str(&format!(
                "<h2>{}</h2>{}<div class=\"plots\">{}{}{}</div>",
                escaped(&title(rows)),
                page::table(&COLUMNS, &lines),
                plot("Attitude error", &|at| at.attitude_deg),
                plot("Step axis off", &|at| at.step_axis_deg),
                plot("Step angle off", &|at| Some((at.step_deg? - at.true_step_deg?).abs()))
            ));
        }
        page("tumbled: rotation experiment", &body)
    }
}
