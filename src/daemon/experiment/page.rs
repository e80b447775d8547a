//! Figures as a page of its own: no network, no other file.

use std::collections::BTreeMap;

use super::plot::{Line, Plot, escaped};
use super::registration::{ExperimentReport, Row};
use super::sweep::{Parameter, SweepPoint};
use super::text;

const PAGE: &str = include_str!("page.html");

/// A page of a title and a body.
pub fn page(title: &str, body: &str) -> String {
    PAGE.replacen("TITLE_OF_THE_PAGE", &escaped(title), 1).replacen("BODY_OF_THE_PAGE", body, 1)
}

/// A table; a cell is written as it is.
pub fn table(heading: &[&str], rows: &[Vec<String>]) -> String {
    let cells = |cells: &mut dyn Iterator<Item = String>| cells.collect::<String>();
    let head = cells(&mut heading.iter().map(|cell| format!("<th>{}</th>", escaped(cell))));
    let line = |row: &Vec<String>| {
        let line =
            cells(&mut row.iter().map(|cell| {
                if cell.starts_with("<td") { cell.clone() } else { format!("<td>{}</td>", escaped(cell)) }
            }));
        format!("<tr>{line}</tr>")
    };
    let body: String = rows.iter().map(line).collect();
    format!("<div class=\"scroll\"><table><tr>{head}</tr>{body}</table></div>")
}

/// The experiment's page.
pub fn experiment(report: &ExperimentReport) -> String {
    let mut body = format!(
        "<h1>Registration experiment</h1><p>{} on {}</p><p>{}, truth: {}, seed {}. Right: within 5° and 5 cm at the moving \
        cloud's centroid. Errors, residuals and NEES are of the right ones, times of all; 95 %: Clopper and Pearson's bounds.</p>",
        escaped(&report.program),
        escaped(&report.machine.line()),
        escaped(&report.source.join(", ")),
        escaped(&report.truth),
        report.seed
    );
    for warning in &report.warnings {
        body.push_str(&format!("<p class=\"bad\">{}</p>", escaped(warning)));
    }
    body.push_str(&format!("<div class=\"plots\">{}</div>", density_plots(&report.rows)));
    for rows in text::by_set(&report.rows) {
        let Some(first) = rows.first() else { continue };
        let lines: Vec<Vec<String>> =
            rows.iter().map(|row| text::cells(&row.method, &row.start.name(), &row.figures)).collect();
        body.push_str(&format!("<h2>{}</h2>{}", escaped(&text::set_title(first)), table(&text::COLUMNS, &lines)));
    }
    if !report.sweep.is_empty() {
        body.push_str("<h2>The published method, one parameter at a time</h2><div class=\"plots\">");
        body.extend(Parameter::ALL.map(|parameter| sweep_plots(parameter, &report.sweep)));
        body.push_str("</div>");
    }
    page("tumbled: registration experiment", &body)
}

/// Success and time against the density, a plot for each set and start.
fn density_plots(rows: &[Row]) -> String {
    let mut groups: BTreeMap<(String, String), Vec<&Row>> = BTreeMap::new();
    let densities = |row: &Row| rows.iter().filter(|other| other.lidar_points != row.lidar_points).count();
    // One density is no curve.
    for row in rows.iter().filter(|row| densities(row) > 0) {
        groups.entry((row.set.clone(), row.start.name())).or_default().push(row);
    }
    let plots = groups.iter().map(|((set, start), rows)| {
        let mut methods: Vec<&str> = Vec::new();
        for row in rows {
            if !methods.contains(&row.method.as_str()) {
                methods.push(&row.method);
            }
        }
        let plot = |title: &str, y: &str, logarithmic: bool, of: &dyn Fn(&Row) -> Option<f64>| {
            let line = |method: &&str| Line {
                name: (*method).to_owned(),
                points: rows
                    .iter()
                    .filter(|row| row.method == **method)
                    .filter_map(|row| Some((row.lidar_points as f64, of(row)?)))
                    .collect(),
            };
            let lines = methods.iter().map(line).collect();
            Plot {
                title: format!("{title}: {set}, {start}"),
                x: "LiDAR points".into(),
                y: y.into(),
                logarithmic,
                // Shares are of 100.
                y_to: if logarithmic { 0.0 } else { 100.0 },
                lines,
            }
            .svg()
        };
        plot("Right", "%", false, &|row| row.figures.right.share.map(|share| 100.0 * share))
            + &plot("Time", "ms", true, &|row| row.figures.time_ms.map(|time| time.median))
    });
    plots.collect()
}

fn sweep_plots(parameter: Parameter, points: &[SweepPoint]) -> String {
    let plot = |y: &str, of: &dyn Fn(&SweepPoint) -> Option<f64>| {
        let of_it = points.iter().filter(|point| point.parameter == parameter);
        let line =
            Line { name: y.to_owned(), points: of_it.filter_map(|point| Some((point.value, of(point)?))).collect() };
        let (title, x) = (format!("{} against {}", y, parameter.name()), parameter.name().to_owned());
        let y_to = if y.ends_with('%') { 100.0 } else { 0.0 };
        Plot { title, x, y: String::new(), logarithmic: false, y_to, lines: vec![line] }.svg()
    };
    plot("right, %", &|point| point.figures.right.share.map(|share| 100.0 * share))
        + &plot("error of all, °", &|point| point.rotation_of_all_deg)
        + &plot("time, ms", &|point| point.figures.time_ms.map(|time| time.median))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_whole_and_asks_for_nothing_else() {
        let page = page("a < b", &table(&["x"], &[vec!["1 & 2".to_owned()]]));
        assert!(page.contains("<title>a &lt; b</title>") && page.contains("<td>1 &amp; 2</td>"));
        assert!(!page.contains("OF_THE_PAGE") && !page.contains("http") && !page.contains("src="));
    }
}
