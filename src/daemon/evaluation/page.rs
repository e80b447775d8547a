//! An evaluation as a page: the tables, and errors against time beside what was stated.

use tumbled_core::evaluate::{EstimateSample, chi_square_quantile};
use tumbled_model::RigNs;

use super::gather::Gathered;
use super::report::EvaluateReport;
use super::score::Series;
use super::text;
use crate::experiment::page::{page, table};
use crate::experiment::plot::{Line, Plot, escaped};

/// Points of a line at most: each is the r.m.s. of its piece of time.
const PIECES: usize = 240;

/// The page; `series`: the errors behind the figures, where there are any.
pub fn evaluation(report: &EvaluateReport, gathered: &Gathered, series: Option<&Series>) -> String {
    let mut body = format!(
        "<h1>Evaluation of {}</h1><p>{}</p><p>{}</p>",
        escaped(&report.inputs.join(", ")),
        escaped(&report.program),
        escaped(&text::epochs_line(report))
    );
    for check in &report.limits {
        let class = if check.kept { "good" } else { "bad" };
        let line = crate::limits::lines(std::slice::from_ref(check));
        body.push_str(&format!("<p class=\"{class}\">{}</p>", escaped(line.trim_end())));
    }
    for warning in &report.warnings {
        body.push_str(&format!("<p class=\"bad\">{}</p>", escaped(warning)));
    }
    if let Some(reason) = &report.unscored {
        body.push_str(&format!("<p class=\"bad\">Nothing scored: {}</p>", escaped(reason)));
    }
    if let Some(scored) = &report.scored {
        let class = if scored.wrong.count == 0 { "good" } else { "bad" };
        body.push_str(&format!(
            "<p>{}</p><p class=\"{class}\">{}</p>",
            escaped(&text::scored_line(report, scored)),
            escaped(&text::trust_line(scored))
        ));
        let tables = [
            ("Poses", &text::POSE[..], text::pose(scored)),
            ("Motion", &text::ERRORS, text::motion(scored)),
            ("Stated and found", &text::SIGMA, text::sigma(scored)),
        ];
        for (title, heading, rows) in tables.iter().filter(|(_, _, rows)| !rows.is_empty()) {
            body.push_str(&format!("<h2>{title}</h2>{}", table(heading, rows)));
        }
        if let Some(series) = series {
            body.push_str(&format!(
                "<h2>Against time</h2><p>Sizes of errors, estimate less truth, r.m.s. of each piece of time, and the σ that was \
                stated, calibration included; NEES and NIS: means; scored from {:.1} s on.</p><div class=\"plots\">{}</div>",
                scored.from_s,
                plots(gathered, series, scored.from_s)
            ));
        }
    }
    page("tumbled: evaluation", &body)
}

/// Values over time, s, not thinned yet.
type Values = Vec<(f64, f64)>;

fn plots(gathered: &Gathered, series: &Series, from_s: f64) -> String {
    match series {
        Series::Poses(found) => {
            let of = |what: &dyn Fn(&tumbled_core::evaluate::ErrorSample) -> Option<f64>| -> Values {
                found.series.iter().filter_map(|(_, error)| Some((seconds(error.t), what(error)?))).collect()
            };
            let offset = found.aligned.first().map(|mean| mean.pose.position_offset_m).unwrap_or_default();
            let nees = of(&|error| error.nees12);
            [
                plot(
                    "Attitude",
                    "°",
                    from_s,
                    [
                        ("error", of(&|error| Some(error.attitude_rad.norm().to_degrees()))),
                        ("σ", stated(gathered, 0, 180.0 / std::f64::consts::PI)),
                    ],
                ),
                plot(
                    "Spin axis",
                    "°",
                    from_s,
                    [
                        ("error", of(&|error| Some(error.axis_rad.to_degrees()))),
                        ("σ", spin(gathered, |(axis, _)| axis)),
                    ],
                ),
                plot(
                    "Rate",
                    "°/s",
                    from_s,
                    [
                        ("error", of(&|error| Some(error.rate_rps.to_degrees()))),
                        ("σ", spin(gathered, |(_, rate)| rate)),
                    ],
                ),
                plot(
                    "Position about its mean offset",
                    "mm",
                    from_s,
                    [
                        ("error", of(&|error| Some(1e3 * (error.position_m - offset).norm()))),
                        ("σ", stated(gathered, 3, 1e3)),
                    ],
                ),
                plot(
                    "Velocity",
                    "mm/s",
                    from_s,
                    [("error", of(&|error| Some(1e3 * error.velocity_mps.norm()))), ("σ", stated(gathered, 6, 1e3))],
                ),
                squares("NEES(12)", 12, nees, from_s),
                squares("NIS(6)", 6, of(&|error| error.nis), from_s),
            ]
            .concat()
        }
        Series::Encoder(found) => {
            let of = |what: &dyn Fn(&tumbled_core::evaluate::TurntableError) -> Option<f64>| -> Values {
                found.series.iter().filter_map(|(_, error)| Some((seconds(error.t), what(error)?))).collect()
            };
            [
                plot(
                    "Angle about the axis, and tilt off it",
                    "°",
                    from_s,
                    [
                        ("about", of(&|error| Some(error.about_axis_rad.to_degrees()))),
                        ("tilt", of(&|error| Some(error.tilt_rad.to_degrees()))),
                    ],
                ),
                plot(
                    "Axis cone",
                    "°",
                    from_s,
                    [
                        ("angle", of(&|error| error.cone_rad.map(f64::to_degrees))),
                        ("σ", spin(gathered, |(axis, _)| axis)),
                    ],
                ),
                plot(
                    "Rate",
                    "°/s",
                    from_s,
                    [
                        ("error", of(&|error| Some(error.rate_rps?.to_degrees()))),
                        ("σ", spin(gathered, |(_, rate)| rate)),
                    ],
                ),
                squares("NIS(6)", 6, of(&|error| error.nis), from_s),
            ]
            .concat()
        }
    }
}

fn seconds(t: RigNs) -> f64 {
    t.0 as f64 * 1e-9
}

/// The σ of a whole length, from the three variances that begin at `row`.
fn stated(gathered: &Gathered, row: usize, unit: f64) -> Values {
    let sigma = |estimate: &EstimateSample| {
        let covariance = estimate.covariance.as_ref()?;
        let variance: f64 = (row..row + 3).filter_map(|n| covariance.get((n, n))).sum();
        Some((seconds(estimate.t), unit * variance.sqrt()))
    };
    gathered.estimates.iter().filter_map(sigma).collect()
}

/// The σ of the spin's axis or rate, degrees.
fn spin(gathered: &Gathered, which: impl Fn((f64, f64)) -> f64) -> Values {
    let pairs = gathered.estimates.iter().zip(&gathered.marks);
    pairs.filter_map(|(estimate, mark)| Some((seconds(estimate.t), which(mark.spin_sigma?).to_degrees()))).collect()
}

/// A logarithmic plot: errors while a filter settles are a hundred times those afterwards.
fn plot(title: &str, unit: &str, from_s: f64, lines: [(&str, Values); 2]) -> String {
    let mut lines: Vec<Line> =
        lines.into_iter().map(|(name, values)| Line { name: name.to_owned(), points: thinned(&values) }).collect();
    lines.extend(begin(from_s, &lines));
    let (title, x, y) = (title.to_owned(), "s".to_owned(), unit.to_owned());
    Plot { title, x, y, logarithmic: true, y_to: 0.0, lines }.svg()
}

/// The mean of normalised squares, with where 95 of 100 single ones lie if all is as stated.
fn squares(title: &str, freedom: u32, values: Values, from_s: f64) -> String {
    let Some(((first, _), (last, _))) = values.first().zip(values.last()) else { return String::new() };
    let level = |name: String, y: f64| Line { name, points: vec![(*first, y), (*last, y)] };
    let bound = |probability: f64| chi_square_quantile(probability, freedom.into());
    // The r.m.s. of the roots is the root of the mean.
    let roots: Values = values.iter().map(|(t, square)| (*t, square.sqrt())).collect();
    let points = thinned(&roots).into_iter().map(|(t, root)| (t, root * root)).collect();
    let points = Line { name: title.to_owned(), points };
    let mut lines = vec![points, level("97.5 %".to_owned(), bound(0.975)), level("2.5 %".to_owned(), bound(0.025))];
    lines.extend(begin(from_s, &lines));
    let (title, x) = (format!("{title}, expected {freedom}"), "s".to_owned());
    Plot { title, x, y: String::new(), logarithmic: true, y_to: 0.0, lines }.svg()
}

/// A vertical line where scoring begins, as high as the others.
fn begin(from_s: f64, lines: &[Line]) -> Option<Line> {
    let values = || lines.iter().flat_map(|line| line.points.iter().map(|(_, y)| *y)).filter(|y| *y > 0.0);
    let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(0.0, f64::max));
    (low < high).then(|| Line { name: "scored from".to_owned(), points: vec![(from_s, low), (from_s, high)] })
}

/// The r.m.s. of each piece of time, at the mean of its times.
fn thinned(values: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let piece = values.len().div_ceil(PIECES).max(1);
    let rms = |piece: &[(f64, f64)]| {
        let count = piece.len() as f64;
        let (time, square) = piece.iter().fold((0.0, 0.0), |(time, square), (t, y)| (time + t, square + y * y));
        (time / count, (square / count).sqrt())
    };
    values.chunks(piece).map(rms).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_line_is_thinned_to_the_rms_of_its_pieces() {
        // 4800 values in 240 pieces of 20, half of them 1 and half of them 7: √25.
        let values: Values = (0..4_800).map(|n| (f64::from(n), if n % 2 == 0 { 1.0 } else { -7.0 })).collect();
        let thin = thinned(&values);
        assert_eq!(thin.len(), 240);
        assert!(thin.iter().all(|(_, y)| (y - 5.0).abs() < 1e-12) && (thin[0].0 - 9.5).abs() < 1e-12, "{:?}", thin[0]);
        assert_eq!(thinned(&values[..3]), [(0.0, 1.0), (1.0, 7.0), (2.0, 1.0)]);
        assert!(thinned(&[]).is_empty());
    }
}
