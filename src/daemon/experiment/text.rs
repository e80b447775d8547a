//! Figures as tables of text.

use super::figures::{Figures, number};
use super::registration::{ExperimentReport, Row};
use super::sweep::SweepPoint;

/// A table in columns: the first to the left, the others to the right.
pub fn table(heading: &[&str], rows: &[Vec<String>]) -> String {
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count());
        cells.chain(heading.get(column).map(|cell| cell.chars().count())).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..heading.len()).map(width).collect();
    let line = |cells: Vec<&str>| {
        let padded: Vec<String> = cells
            .iter()
            .zip(&widths)
            .enumerate()
            .map(|(n, (cell, width))| if n == 0 { format!("{cell:<width$}") } else { format!("{cell:>width$}") })
            .collect();
        format!("{}\n", padded.join("  ").trim_end())
    };
    let body: String = rows.iter().map(|row| line(row.iter().map(String::as_str).collect())).collect();
    line(heading.to_vec()) + &body
}

/// The columns of a line of figures.
pub const COLUMNS: [&str; 11] =
    ["method", "start", "right", "95 %", "accepted", "wrong acc.", "deg", "mm", "rmse mm", "NEES", "ms (p95)"];

/// A line of figures.
pub fn cells(method: &str, start: &str, figures: &Figures) -> Vec<String> {
    let median = |spread: Option<super::figures::Spread>| spread.map(|spread| spread.median);
    vec![
        method.to_owned(),
        start.to_owned(),
        figures.right.percent(),
        format!("{:.0}-{:.0}", 100.0 * figures.right.low, 100.0 * figures.right.high),
        figures.accepted.percent(),
        format!("{}/{}", figures.wrong_accepted.count, figures.wrong_accepted.of),
        number(median(figures.rotation_deg), 2),
        number(median(figures.translation_mm), 1),
        number(median(figures.rmse_mm), 1),
        number(figures.nees_mean, 1),
        figures.time_ms.map_or_else(|| "-".to_owned(), |time| format!("{:.1} ({:.1})", time.median, time.p95)),
    ]
}

/// What a set's pairs are.
pub fn set_title(row: &Row) -> String {
    let points = format!(", {}/{} points", row.kinect_points, row.lidar_points);
    let sights = row.sights_deg.map(|[low, high]| format!(", sights {low}-{high} degrees apart")).unwrap_or_default();
    let overlap = row.figures.overlap.map(|overlap| format!(", median overlap {:.2}", overlap.median));
    let view = if row.organised { ", with misses" } else { "" };
    format!("{}{points}{sights}{view}{}, {} pairs", row.set, overlap.unwrap_or_default(), row.figures.accepted.of)
}

/// The rows of one set after the other.
pub fn by_set(rows: &[Row]) -> impl Iterator<Item = &[Row]> {
    let key = |row: &Row| (row.set.clone(), row.kinect_points, row.lidar_points);
    rows.chunk_by(move |a, b| key(a) == key(b))
}

/// The whole report.
pub fn report(report: &ExperimentReport) -> String {
    let mut text = format!("{}\n", report.machine.line());
    text.push_str(&format!(
        "{}, truth: {}; right: within 5 degrees and 5 cm; deg, mm, rmse and NEES are of the right ones\n",
        report.source.join(", "),
        report.truth
    ));
    for rows in by_set(&report.rows) {
        let Some(first) = rows.first() else { continue };
        let lines: Vec<Vec<String>> =
            rows.iter().map(|row| cells(&row.method, &row.start.name(), &row.figures)).collect();
        text.push_str(&format!("\n{}\n{}", set_title(first), table(&COLUMNS, &lines)));
    }
    if !report.sweep.is_empty() {
        text.push_str(&format!("\ncga-paper, one parameter at a time\n{}", sweep(&report.sweep)));
    }
    text
}

fn sweep(points: &[SweepPoint]) -> String {
    let line = |point: &SweepPoint| {
        vec![
            format!("{} = {}", point.parameter.name(), point.value),
            point.figures.right.percent(),
            number(point.rotation_of_all_deg, 1),
            number(point.translation_of_all_mm, 0),
            number(point.figures.time_ms.map(|time| time.median), 1),
        ]
    };
    table(&["parameter", "right", "deg of all", "mm of all", "ms"], &points.iter().map(line).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_as_wide_as_their_widest_cell() {
        let rows = [vec!["a".to_owned(), "1.5".to_owned()], vec!["long".to_owned(), "22".to_owned()]];
        assert_eq!(table(&["x", "y"], &rows), "x       y\na     1.5\nlong   22\n");
    }
}
