//! The tables of `docs/velodyne.md`, as Markdown.

use crate::cells::Plane;
use crate::gls::{Assumed, Assumptions, Estimate, GlsError, Problem, Solution};
use std::collections::BTreeMap;

/// How well one range bias of all lasers is known beforehand, metres.
const BIAS_SIGMA_M: f64 = 0.015;
/// How well one elevation error of all lasers (a tilted mirror, a lens of another focal length) is known, radians: 0.1°.
const ELEVATION_SIGMA_RAD: f64 = 0.1 * core::f64::consts::PI / 180.0;

const OFF: Assumed = Assumed::Known(0.0);
const ON: Assumed = Assumed::Known(1.0);
const NO_BIAS: Assumed = Assumed::Known(0.0);

const fn assume(scale: Assumed, bias: Assumed) -> Assumptions {
    Assumptions { scale, bias, elevation_sigma_rad: 0.0 }
}

/// Some surfaces fitted under every hypothesis.
pub(crate) struct Line {
    name: String,
    problem: Problem,
    off: Solution,
    on: Solution,
    off_biased: Solution,
    on_biased: Solution,
    /// Scale with no bias, a bias known to 15 mm, and besides an elevation error known to 0.1°.
    scales: [Estimate; 3],
    /// What the last of these costs the hypothesis "off": its AIC less that of "on".
    cautious_aic: f64,
    /// Scale and bias both free.
    both: Solution,
    jackknife: Jackknife,
}

/// The scale with each ring left out in turn.
struct Jackknife {
    sigma: f64,
    lowest: f64,
    highest: f64,
}

impl Line {
    /// Fits everything.
    pub(crate) fn fit(name: impl Into<String>, problem: Problem) -> Result<Self, GlsError> {
        let within = Assumed::Within(BIAS_SIGMA_M);
        let cautious = |scale| Assumptions { elevation_sigma_rad: ELEVATION_SIGMA_RAD, ..assume(scale, within) };
        Ok(Self {
            name: name.into(),
            off: problem.solve(assume(OFF, NO_BIAS))?,
            on: problem.solve(assume(ON, NO_BIAS))?,
            off_biased: problem.solve(assume(OFF, Assumed::Free))?,
            on_biased: problem.solve(assume(ON, Assumed::Free))?,
            scales: [
                scale(&problem, assume(Assumed::Free, NO_BIAS))?,
                scale(&problem, assume(Assumed::Free, within))?,
                scale(&problem, cautious(Assumed::Free))?,
            ],
            cautious_aic: problem.solve(cautious(OFF))?.aic - problem.solve(cautious(ON))?.aic,
            both: problem.solve(assume(Assumed::Free, Assumed::Free))?,
            jackknife: Jackknife::of(&problem)?,
            problem,
        })
    }
}

impl Jackknife {
    fn of(problem: &Problem) -> Result<Self, GlsError> {
        let rings = problem.rings();
        let mut scales = Vec::with_capacity(rings.len());
        for ring in &rings {
            scales.push(scale(&problem.without_ring(*ring), assume(Assumed::Free, NO_BIAS))?.value);
        }
        let n = scales.len() as f64;
        let mean = scales.iter().sum::<f64>() / n;
        let squares: f64 = scales.iter().map(|s| (s - mean) * (s - mean)).sum();
        Ok(Self {
            sigma: ((n - 1.0) / n * squares).sqrt(),
            lowest: scales.iter().copied().fold(f64::INFINITY, f64::min),
            highest: scales.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        })
    }
}

fn scale(problem: &Problem, assumed: Assumptions) -> Result<Estimate, GlsError> {
    let missing = GlsError::Undetermined { cells: problem.cells(), parameters: 1 };
    problem.solve(assumed)?.scale.ok_or(missing)
}

/// Height of each ring over the fitted floor, without and with the offset.
pub(crate) fn print_rings(floor: &Plane, line: &Line) {
    let mut rings: BTreeMap<u8, Vec<usize>> = BTreeMap::new();
    for (at, ring) in line.problem.ring_of_cell().enumerate() {
        rings.entry(ring).or_default().push(at);
    }
    println!("## {}, ring by ring\n", line.name);
    println!("| ring | distance on the floor m | cells | offset mm | height mm, off | height mm, on |");
    println!("|--:|--:|--:|--:|--:|--:|");
    for (ring, cells) in rings {
        let mean = |of: &dyn Fn(usize) -> f64| cells.iter().map(|at| of(*at)).sum::<f64>() / cells.len() as f64;
        let distance = mean(&|at| (floor.cells[at].point.xy()).norm());
        let offset = mean(&|at| floor.cells[at].height_m) * 1e3;
        // The normal points down, away from the sensor: heights are the negative distances along it.
        let off = mean(&|at| -line.off.residual_m[at]) * 1e3;
        let on = mean(&|at| -line.on.residual_m[at]) * 1e3;
        println!("| {ring} | {distance:.2} | {} | {offset:+.1} | {off:+.1} | {on:+.1} |", cells.len());
    }
    println!();
}

/// The four hypotheses: offsets off or on, no common range bias or a fitted one.
pub(crate) fn print_hypotheses(lines: &[Line]) {
    println!("## Offsets off or on, without and with a fitted range bias b\n");
    println!(
        "| surfaces | cells | rings | RMS mm: off | on | off, b | on, b | χ²: off | on | off, b | on, b | ΔAIC: off | on | off, b | on, b |"
    );
    println!("|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|");
    for line in lines {
        let fits = [&line.off, &line.on, &line.off_biased, &line.on_biased];
        let best = fits.iter().map(|fit| fit.aic).fold(f64::INFINITY, f64::min);
        let rms = row(fits.map(|fit| format!("{:.2}", rms_m(fit) * 1e3)));
        let chi2 = row(fits.map(|fit| format!("{:.1}", fit.chi2)));
        let aic = row(fits.map(|fit| format!("{:.1}", fit.aic - best)));
        println!(
            "| {} | {} | {} | {rms} | {chi2} | {aic} |",
            line.name,
            line.problem.cells(),
            line.problem.rings().len()
        );
    }
    println!();
}

/// The scale of the offsets under three assumptions about what else all lasers may share.
pub(crate) fn print_scales(lines: &[Line]) {
    println!("## Scale s of the offsets (0 off, 1 on), ± one standard deviation\n");
    println!(
        "| surfaces | s, b = 0 | jackknife over rings | s, b = 0 ± 15 mm | s, also c = 0 ± 0.1° | AIC off − on, the same | s, b free | correlation of b and s | b mm, off | b mm, on |"
    );
    println!("|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|");
    for line in lines {
        let [plain, biased, cautious] = line.scales.map(|s| plus_minus(Some(s), 1.0, 2));
        let Jackknife { sigma, lowest, highest } = line.jackknife;
        let free = plus_minus(line.both.scale, 1.0, 2);
        let bias = [&line.off_biased, &line.on_biased].map(|fit| plus_minus(fit.bias, 1e3, 0)).join(" | ");
        let correlation = line.both.correlation.map_or("–".to_owned(), |c| format!("{c:+.3}"));
        println!(
            "| {} | {plain} | ±{sigma:.2} ({lowest:+.2}…{highest:+.2}) | {biased} | {cautious} | {:+.1} | {free} | {correlation} | {bias} |",
            line.name, line.cautious_aic
        );
    }
    println!();
}

fn row(entries: [String; 4]) -> String {
    entries.join(" | ")
}

fn rms_m(fit: &Solution) -> f64 {
    (fit.residual_m.iter().map(|e| e * e).sum::<f64>() / fit.residual_m.len() as f64).sqrt()
}

fn plus_minus(estimate: Option<Estimate>, unit: f64, digits: usize) -> String {
    match estimate {
        Some(Estimate { value, sigma }) => format!("{:+.digits$} ± {:.digits$}", value * unit, sigma * unit),
        None => "–".to_owned(),
    }
}
