//! The report's page: the verdict first, the gates that did not pass with what to do, the parameters, then the rest.

use tumbled_calib::{Gate, Status};

use super::provenance::Provenance;
use crate::experiment::page::{page, table};
use crate::experiment::plot::escaped;

/// A parameter of the result as people read it.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// What it is: `rotation about x`.
    pub name: String,
    /// Its value with its unit.
    pub value: String,
    /// One standard deviation with its unit.
    pub sigma: String,
}

/// A page: `title`, one sentence `about` it, how it was found, its parameters, and what else it shows as HTML.
pub fn report(title: &str, about: &str, provenance: &Provenance, parameters: &[Parameter], rest: &str) -> String {
    let class = if provenance.status == Status::Fail { "bad" } else { "good" };
    let mut body = format!(
        "<h1>{}</h1><p class=\"{class}\">{}</p><p>{}</p>",
        escaped(title),
        escaped(&verdict(provenance)),
        escaped(about)
    );
    for gate in provenance.gates.iter().filter(|gate| gate.status != Status::Pass) {
        let remedy = gate.remedy.as_deref().unwrap_or_default();
        body.push_str(&format!("<p class=\"bad\">{}: {}</p>", escaped(&gate.name), escaped(remedy)));
    }
    if !parameters.is_empty() {
        let rows: Vec<Vec<String>> =
            parameters.iter().map(|p| vec![p.name.clone(), p.value.clone(), p.sigma.clone()]).collect();
        body.push_str(&format!("<h2>Result</h2>{}", table(&["parameter", "value", "± 1σ"], &rows)));
    }
    body.push_str(&format!("<h2>Gates</h2>{}", table(&GATES, &gates(&provenance.gates))));
    body.push_str(rest);
    body.push_str(&format!("<h2>Made from</h2><p>{}, {}</p>", escaped(&provenance.program), escaped(&provenance.date)));
    let inputs: Vec<Vec<String>> =
        provenance.inputs.iter().map(|input| vec![input.name.clone(), input.blake3.clone()]).collect();
    body.push_str(&table(&["input", "BLAKE3"], &inputs));
    if !provenance.serials.is_empty() {
        let serials: Vec<Vec<String>> =
            provenance.serials.iter().map(|(id, serial)| vec![id.clone(), serial.clone()]).collect();
        body.push_str(&table(&["sensor", "serial number"], &serials));
    }
    page(&format!("tumbled: {title}"), &body)
}

/// The verdict as a sentence.
pub fn verdict(provenance: &Provenance) -> String {
    let of = |status| provenance.gates.iter().filter(|gate| gate.status == status).count();
    match provenance.status {
        Status::Pass => format!("PASS: every one of {} gates passed", provenance.gates.len()),
        Status::Warn => format!("WARN: usable; {} of {} gates warn", of(Status::Warn), provenance.gates.len()),
        Status::Fail => {
            format!("FAIL: not to be used; {} of {} gates failed", of(Status::Fail), provenance.gates.len())
        }
    }
}

/// The heading of the gates' table.
pub const GATES: [&str; 5] = ["gate", "found", "warns", "fails", "verdict"];

/// The gates as a table's rows.
pub fn gates(gates: &[Gate]) -> Vec<Vec<String>> {
    let number = |value: Option<f64>, unit: &str| match value {
        Some(value) => format!("{} {unit}", significant(value)).trim_end().to_owned(),
        None => "–".to_owned(),
    };
    let row = |gate: &Gate| {
        let [found, warn, fail] = [gate.value, gate.warn, gate.fail].map(|value| number(value, &gate.unit));
        vec![gate.name.clone(), found, warn, fail, gate.status.name().to_owned()]
    };
    gates.iter().map(row).collect()
}

/// A number with three significant digits.
pub fn significant(value: f64) -> String {
    let size = value.abs();
    let digits = match size {
        _ if size == 0.0 || size >= 100.0 => 0,
        _ if size >= 10.0 => 1,
        _ if size >= 1.0 => 2,
        _ if size >= 0.1 => 3,
        _ => 4,
    };
    format!("{value:.digits$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_verdict_and_what_to_do_come_before_everything_else() {
        let gates = vec![
            Gate::at_most("rotation", 0.1, "deg", (Some(0.2), Some(0.5)), "more poses"),
            Gate::failed("normals", "no tilt about the vertical: add boards leaning left and right"),
        ];
        let provenance = Provenance::new(Vec::new(), gates);
        let page = report("Extrinsic", "board", &provenance, &[], "<h2>Poses</h2>");
        let place = |text: &str| page.find(text).unwrap_or_else(|| panic!("{text} in {page}"));
        assert!(place("FAIL: not to be used; 1 of 2 gates failed") < place("no tilt about the vertical"));
        assert!(place("no tilt about the vertical") < place("<h2>Gates"));
        assert!(place("<h2>Gates") < place("<h2>Poses"));
    }

    #[test]
    fn numbers_have_three_digits_that_count() {
        assert_eq!(
            [123.4, 12.34, 1.234, 0.1234, 0.01234, 0.0].map(significant),
            ["123", "12.3", "1.23", "0.123", "0.0123", "0"]
        );
    }
}
