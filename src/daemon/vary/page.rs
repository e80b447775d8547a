//! The curves of each assumption as a page.

use super::report::{AssumptionRows, FIGURES, VaryReport, html_table, sentence};
use crate::experiment::page::page;
use crate::experiment::plot::{Line, Plot, escaped};

/// The page.
pub fn vary(report: &VaryReport) -> String {
    let against = if report.turntable { "held against the turntable's encoder" } else { "without a turntable" };
    let mut body = format!(
        "<h1>What the capture says of the rig</h1><p>{}, {}; states from {:.3} s on, {against}. Each assumption is varied alone. \
         Where a figure is least is evidence, as far as the curve is not flat: what a figure does not depend on, it does not tell.</p>",
        escaped(&report.program),
        escaped(&report.inputs.join(", ")),
        report.from_s
    );
    for warning in &report.warnings {
        body.push_str(&format!("<p class=\"bad\">{}</p>", escaped(warning)));
    }
    for assumption in &report.assumptions {
        body.push_str(&format!("<h2>{}</h2><ul>", escaped(&assumption.name)));
        for minimum in &assumption.minima {
            body.push_str(&format!("<li>{}</li>", escaped(&sentence(minimum))));
        }
        body.push_str("</ul>");
        FIGURES.iter().for_each(|figure| body.push_str(&plot(assumption, figure)));
        body.push_str(&html_table(assumption));
    }
    page("tumbled: replay --vary", &body)
}

fn plot(assumption: &AssumptionRows, (name, figure): &(&str, fn(&super::report::ValueRow) -> Option<f64>)) -> String {
    let points: Vec<(f64, f64)> = assumption.rows.iter().filter_map(|row| Some((row.value, figure(row)?))).collect();
    if points.is_empty() {
        return String::new();
    }
    let lines = vec![Line { name: String::new(), points }];
    let (title, x, y) = ((*name).to_owned(), assumption.name.clone(), String::new());
    Plot { title, x, y, logarithmic: false, y_to: 0.0, lines }.svg()
}
