//! Drawings of a calibration's report, as SVG in the colours of the page they stand in.

use crate::experiment::plot::escaped;

const WIDTH: f64 = 460.0;
const HEIGHT: f64 = 260.0;
const MARGIN: f64 = 44.0;

fn open(title: &str) -> String {
    format!(
        "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{0}\"><text x=\"12\" y=\"17\" class=\"title\">{0}</text>",
        escaped(title)
    )
}

fn text(x: f64, y: f64, anchor: &str, words: &str) -> String {
    format!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{}</text>", escaped(words))
}

/// One bar a pose, from the zero line up or down; those that are not used are pale.
pub(super) fn bars(title: &str, unit: &str, bars: &[(usize, f64, bool)]) -> String {
    let largest = bars.iter().map(|(_, value, _)| value.abs()).fold(0.0, f64::max);
    if bars.is_empty() || largest <= 0.0 {
        return String::new();
    }
    let negative = bars.iter().any(|(_, value, _)| *value < 0.0);
    let (top, bottom) = (30.0, HEIGHT - 30.0);
    let zero = if negative { 0.5 * (top + bottom) } else { bottom };
    let scale = (zero - top) / largest;
    let step = (WIDTH - 2.0 * MARGIN) / bars.len() as f64;
    let mut svg = open(title);
    for (value, at) in [(largest, zero - largest * scale), (0.0, zero)] {
        svg.push_str(&format!(
            "<line x1=\"{MARGIN}\" x2=\"{:.1}\" y1=\"{at:.1}\" y2=\"{at:.1}\" class=\"grid\"/>",
            WIDTH - MARGIN
        ));
        svg.push_str(&text(MARGIN - 4.0, at + 4.0, "end", &format!("{value:.2}")));
    }
    svg.push_str(&text(WIDTH - MARGIN + 4.0, top + 4.0, "start", unit));
    for (n, (pose, value, used)) in bars.iter().enumerate() {
        let (x, height) = (MARGIN + step * (n as f64 + 0.15), value.abs() * scale);
        let y = if *value < 0.0 { zero } else { zero - height };
        let opacity = if *used { 1.0 } else { 0.3 };
        svg.push_str(&format!(
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{height:.1}\" style=\"fill:var(--c0);opacity:{opacity}\"/>",
            step * 0.7
        ));
        svg.push_str(&text(x + 0.35 * step, HEIGHT - 10.0, "middle", &pose.to_string()));
    }
    svg + "</svg>"
}

/// Counts in classes; `edges`: the first class' lower edge and a class' width.
pub(super) fn histogram(title: &str, unit: &str, (low, width): (f64, f64), counts: &[u32]) -> String {
    let largest = counts.iter().copied().max().unwrap_or(0);
    if largest == 0 {
        return String::new();
    }
    let (top, bottom) = (30.0, HEIGHT - 30.0);
    let step = (WIDTH - 2.0 * MARGIN) / counts.len() as f64;
    let mut svg = open(title);
    for (n, count) in counts.iter().enumerate() {
        let height = f64::from(*count) / f64::from(largest) * (bottom - top);
        let x = MARGIN + step * n as f64;
        svg.push_str(&format!(
            "<rect x=\"{x:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{height:.1}\" style=\"fill:var(--c0)\"/>",
            bottom - height,
            step * 0.92
        ));
    }
    svg.push_str(&format!(
        "<line x1=\"{MARGIN}\" x2=\"{:.1}\" y1=\"{bottom}\" y2=\"{bottom}\" class=\"grid\"/>",
        WIDTH - MARGIN
    ));
    for share in [0.0, 0.25, 0.5, 0.75, 1.0] {
        let value = low + share * width * counts.len() as f64;
        svg.push_str(&text(MARGIN + share * (WIDTH - 2.0 * MARGIN), HEIGHT - 12.0, "middle", &format!("{value:.0}")));
    }
    svg.push_str(&text(WIDTH - 8.0, HEIGHT - 12.0, "end", unit));
    svg + "</svg>"
}

/// Directions on the half sphere that looks away from the camera: its axis in the middle, rings each 15°, 60° the outermost.
pub(super) fn half_sphere(title: &str, directions: &[(usize, [f64; 3], bool)]) -> String {
    if directions.is_empty() {
        return String::new();
    }
    let (centre_x, centre_y, radius) = (0.5 * WIDTH, 0.5 * HEIGHT + 10.0, 0.5 * HEIGHT - 26.0);
    let mut svg = open(title);
    for ring in [15.0, 30.0, 45.0, 60.0] {
        svg.push_str(&format!(
            "<circle cx=\"{centre_x}\" cy=\"{centre_y}\" r=\"{:.1}\" class=\"grid\" style=\"fill:none\"/>",
            radius * ring / 60.0
        ));
        // Along a diagonal that boards seldom lie on.
        let along = 0.924 * radius * ring / 60.0;
        svg.push_str(&text(centre_x - along, centre_y + 0.42 * along, "end", &format!("{ring:.0}°")));
    }
    for (pose, [x, y, z], used) in directions {
        let beside = (x * x + y * y).sqrt();
        let angle = beside.atan2(*z).to_degrees();
        let away = radius * angle / 60.0 / beside.max(1e-9);
        let (u, v) = (centre_x + x * away, centre_y + y * away);
        let opacity = if *used { 1.0 } else { 0.3 };
        svg.push_str(&format!(
            "<circle cx=\"{u:.1}\" cy=\"{v:.1}\" r=\"5\" class=\"of0\" style=\"opacity:{opacity}\"/>"
        ));
        svg.push_str(&text(u + 7.0, v + 4.0, "start", &pose.to_string()));
    }
    svg + "</svg>"
}

/// Points of two sensors on one plane, one metre as long along both axes.
pub(super) fn overlay(title: &str, names: [&str; 2], axes: [&str; 2], points: [&[[f64; 2]]; 2]) -> String {
    let all = || points.iter().flat_map(|points| points.iter());
    let range = |axis: usize| {
        let values = || all().filter_map(|point| point.get(axis)).filter(|value| value.is_finite());
        (values().copied().fold(f64::INFINITY, f64::min), values().copied().fold(f64::NEG_INFINITY, f64::max))
    };
    let ((x_low, x_high), (y_low, y_high)) = (range(0), range(1));
    if x_low >= x_high || y_low >= y_high {
        return String::new();
    }
    let (wide, high) = (WIDTH - 2.0 * MARGIN, HEIGHT - 70.0);
    let scale = (wide / (x_high - x_low)).min(high / (y_high - y_low));
    let (x_middle, y_middle) = (0.5 * (x_low + x_high), 0.5 * (y_low + y_high));
    // Few points are places, many are surfaces.
    let dot = if all().count() <= 60 { 4.0 } else { 1.1 };
    let mut svg = open(title);
    for (n, (name, points)) in names.iter().zip(points).enumerate() {
        svg.push_str(&format!(
            "<text x=\"{:.1}\" y=\"17\" text-anchor=\"end\" class=\"of{n}\">{}</text>",
            WIDTH - 12.0 - 70.0 * (1.0 - n as f64),
            escaped(name)
        ));
        for [x, y] in points {
            let u = 0.5 * WIDTH + (x - x_middle) * scale;
            let v = 0.5 * HEIGHT - (y - y_middle) * scale;
            svg.push_str(&format!("<circle cx=\"{u:.1}\" cy=\"{v:.1}\" r=\"{dot}\" class=\"of{n}\"/>"));
        }
    }
    let bar = 0.5 * scale;
    svg.push_str(&format!(
        "<line x1=\"20\" x2=\"{:.1}\" y1=\"{1:.1}\" y2=\"{1:.1}\" style=\"stroke:var(--ink)\"/>",
        20.0 + bar,
        HEIGHT - 16.0
    ));
    svg.push_str(&text(26.0 + bar, HEIGHT - 12.0, "start", "0.5 m"));
    let [x, y] = axes;
    svg.push_str(&text(WIDTH - 12.0, HEIGHT - 12.0, "end", &format!("→ {x}   ↑ {y}")));
    svg + "</svg>"
}

/// Numbers over a picture, cell by cell, row by row: one sign in one colour, the other in the other, the stronger the larger.
pub(super) fn map(title: &str, [columns, rows]: [usize; 2], cells: &[Option<f64>], full: f64) -> String {
    let (top, left) = (26.0, 6.0);
    let (width, height) = ((WIDTH - 2.0 * left) / columns.max(1) as f64, (HEIGHT - top - 6.0) / rows.max(1) as f64);
    let mut svg = open(title);
    for (n, value) in cells.iter().enumerate().take(columns * rows) {
        let (x, y) = (left + (n % columns) as f64 * width, top + (n / columns) as f64 * height);
        let Some(value) = value else { continue };
        let colour = if *value < 0.0 { "var(--c1)" } else { "var(--c0)" };
        svg.push_str(&format!(
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" style=\"fill:{colour};opacity:{:.2}\"/>",
            (value.abs() / full).clamp(0.05, 0.85)
        ));
        svg.push_str(&format!(
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" style=\"font-size:8px\">{value:.1}</text>",
            x + 0.5 * width,
            y + 0.5 * height + 3.0
        ));
    }
    svg + "</svg>"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pose_has_its_bar_and_nothing_to_draw_is_no_drawing() {
        let svg = bars("offset", "mm", &[(0, 1.0, true), (3, -2.0, false)]);
        assert_eq!((svg.matches("<rect").count(), svg.matches("opacity:0.3").count()), (2, 1));
        assert_eq!(bars("offset", "mm", &[]), "");
        assert_eq!(histogram("h", "mm", (0.0, 1.0), &[0, 0]), "");
    }

    #[test]
    fn a_normal_turned_by_thirty_degrees_lies_on_the_ring_of_thirty_degrees() {
        let (sin, cos) = 30f64.to_radians().sin_cos();
        let svg = half_sphere("normals", &[(7, [sin, 0.0, cos], true)]);
        // The middle is at 230, the outermost ring 104 away and of 60°.
        assert!(svg.contains("cx=\"282.0\" cy=\"140.0\" r=\"5\""), "{svg}");
    }

    #[test]
    fn overlays_keep_both_axes_in_one_scale() {
        let svg = overlay("o", ["a", "b"], ["x", "y"], [&[[0.0, 0.0], [2.0, 0.0]], &[[0.0, 1.0]]]);
        assert_eq!(svg.matches("r=\"4\"").count(), 3);
        // 2 m along x fill 372, so 1 m along y is 186: from 130 + 93 to 130 − 93.
        assert!(svg.contains("cy=\"223.0\"") && svg.contains("cy=\"37.0\""), "{svg}");
    }
}
