//! `tumbled replay --vary`: one capture against several values of each assumption about the rig.

use std::f64::consts::TAU;
use std::path::Path;
use std::sync::Arc;

use tumbled_model::RigNs;

use super::{Failure, InputArgs, Outcome, VERSION, output, signals};
use crate::calibration::plays::{Change, Played, play_all};
use crate::evaluation::interval::Travel;
use crate::vary::report::{AssumptionRows, minima, row, text};
use crate::vary::{Assumption, VaryReport, page};

/// How far states without an encoder are left out, s: a model of the target is made.
const SETTLES_S: f64 = 20.0;

/// Varies each assumption alone, `threads` plays at a time.
///
/// # Errors
/// Exit code 2: inputs or a config that cannot be used, an assumption of a sensor that is none. 1: a page that cannot be
/// written.
pub fn run(
    input: &InputArgs,
    assumptions: &[Assumption],
    threads: usize,
    html: Option<&Path>,
    json: bool,
) -> Result<Outcome, Failure> {
    let loaded = input.load()?;
    let of_config = |assumption: &Assumption| assumption.clone().of(&loaded.config).map_err(Failure::input);
    let assumptions: Vec<Assumption> = assumptions.iter().map(of_config).collect::<Result<_, _>>()?;
    // The config as it is comes first, and is not played again where a grid holds 0.
    let mut changes: Vec<Change> = vec![Arc::new(|_| {})];
    for assumption in &assumptions {
        changes
            .extend(assumption.values().iter().filter(|value| **value != 0.0).map(|value| assumption.change(*value)));
    }
    let Some(plays) = play_all(&input.inputs, &loaded.config, &changes, threads, &signals::stop_token()?)? else {
        return Err(Failure::failed("stopped before the inputs' end: nothing was compared"));
    };
    let mut plays = plays.into_iter();
    let Some(as_it_is) = plays.next() else { return Err(Failure::failed("nothing was played")) };
    let mut warnings = as_it_is.warnings.clone();
    let from = begin(&as_it_is, &mut warnings)?;
    let mut complete = as_it_is.complete;
    let mut rows_of = |assumption: &Assumption| {
        let mut value_row = |value: &f64| {
            if *value == 0.0 {
                return Some(row(0.0, &as_it_is, from));
            }
            let played = plays.next()?;
            complete &= played.complete;
            Some(row(*value, &played, from))
        };
        let rows: Vec<_> = assumption.values().iter().filter_map(&mut value_row).collect();
        AssumptionRows { name: assumption.to_string(), minima: minima(&rows), rows }
    };
    let assumptions: Vec<AssumptionRows> = assumptions.iter().map(&mut rows_of).collect();
    let report = VaryReport {
        program: VERSION.to_owned(),
        inputs: input.inputs.iter().map(|input| input.display().to_string()).collect(),
        turntable: !as_it_is.gathered.turntable.is_empty(),
        from_s: from.0 as f64 * 1e-9,
        assumptions,
        complete,
        warnings,
    };
    report.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    if let Some(path) = html {
        output::file(path, page::vary(&report))?;
    }
    output::report(&report, json, || text(&report))?;
    Ok(if report.complete { Outcome::Fine } else { Outcome::Incomplete })
}

/// When states begin to count: after the first turn of the stage, or some time after the target was first tracked.
fn begin(played: &Played, warnings: &mut Vec<String>) -> Result<RigNs, Failure> {
    let states = &played.gathered.estimates;
    let Some((first, last)) = states.first().zip(states.last()) else {
        return Err(Failure::input("no epoch of the inputs was tracked with the config as it is")
            .with_help("`tumbled replay -o -` says why; correct the config first"));
    };
    let turned = if played.gathered.turntable.is_empty() {
        None
    } else {
        let travel = Travel::of_encoder(&played.encoder(warnings)?);
        travel.after(first.t, TAU)
    };
    let begin = turned.unwrap_or(RigNs(first.t.0 + (SETTLES_S * 1e9) as i64));
    if begin < last.t {
        return Ok(begin);
    }
    warnings.push("the capture is short: the time in which the model of the target is made counts too".to_owned());
    Ok(first.t)
}
