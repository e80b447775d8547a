//! Fault files: what goes wrong on purpose, and what was done.

use std::path::Path;

use serde::Deserialize;
use tumbled_io::recording::{Origin, RecordingHeader};
use tumbled_model::SensorId;
use tumbled_sim::faults::{FaultCounts, FaultScript, FaultTruth};
use tumbled_sim::turntable;

use crate::cli::Failure;
use crate::config::Config;

/// The longest fault file, bytes: thousands of faults.
const LONGEST: u64 = 1 << 20;

/// The fault files that come with the program: name and text.
const FAULTS: [(&str, &str); 2] = [
    ("lost-target", include_str!("../../../config/faults/lost-target.toml")),
    ("bad-lines", include_str!("../../../config/faults/bad-lines.toml")),
];

/// The names of the program's own fault files.
pub fn names() -> impl Iterator<Item = &'static str> {
    FAULTS.iter().map(|(name, _)| *name)
}

/// Reads a fault file: one of the program's by its name, or a file.
///
/// # Errors
/// Exit code 2: a file that cannot be read, keys that are none, numbers that mean nothing.
pub fn read(path: &Path) -> Result<FaultScript, Failure> {
    parse(path, &text(path)?)
}

/// The same for a rig: a fault of a sensor that it does not have is refused.
///
/// # Errors
/// As [`read`]; exit code 2 for such a sensor.
pub fn read_for(path: &Path, sensors: &[SensorId]) -> Result<FaultScript, Failure> {
    let text = text(path)?;
    let script = parse(path, &text)?;
    for (number, fault) in script.fault.iter().enumerate() {
        let Some(name) = &fault.sensor else { continue };
        if !sensors.iter().any(|sensor| sensor.as_str() == name) {
            let place = place(path, &text, number);
            let known: Vec<&str> = sensors.iter().map(SensorId::as_str).collect();
            return Err(Failure::input(format!("{place}: the rig has no sensor \"{name}\""))
                .with_help(format!("its sensors are {}; without `sensor` a fault is everybody's", known.join(", "))));
        }
    }
    Ok(script)
}

/// The sensors of a rig, as fault files name them.
pub fn sensors(config: &Config) -> Vec<SensorId> {
    let lidars = config.lidars.iter().map(|lidar| lidar.id.clone());
    let kinects = config.kinects.iter().map(|kinect| kinect.id.clone());
    let stage = config.turntable.iter().map(|_| SensorId::from(turntable::SENSOR));
    lidars.chain(kinects).chain(stage).collect()
}

/// Tells in a recording's header that faults are in it: another session than it would be without, simulated from now on,
/// with the script among its notes.
pub fn mark(script: &FaultScript, header: &mut RecordingHeader) {
    let script = serde_json::to_string(script).unwrap_or_default();
    let digest = blake3::hash(script.as_bytes()).to_hex();
    header.session = format!("{}-faults-{}", header.session, digest.get(..8).unwrap_or_default());
    header.origin = Origin::Simulated;
    header.notes.insert("faults".to_owned(), script);
}

/// What was done, a line for each sensor and one for the wall clock; what was not done is left out.
pub fn lines(truth: &FaultTruth) -> Vec<String> {
    let mut lines: Vec<String> = truth.sensors.iter().map(|(sensor, counts)| line(sensor, counts)).collect();
    if truth.anchors_stepped > 0 {
        lines.push(format!("wall clock: {} anchors stepped", truth.anchors_stepped));
    }
    lines
}

/// Whether anything was done at all.
pub fn any_done(truth: &FaultTruth) -> bool {
    truth.anchors_stepped > 0 || truth.sensors.values().any(|counts| done(counts).next().is_some())
}

fn line(sensor: &str, counts: &FaultCounts) -> String {
    let done: Vec<String> = done(counts).map(|(count, what)| format!("{count} {what}")).collect();
    let done = if done.is_empty() { "nothing".to_owned() } else { done.join(", ") };
    format!("{sensor}: of {} items {done}", counts.items)
}

/// Destructured, so that a new count is not forgotten.
fn done(counts: &FaultCounts) -> impl Iterator<Item = (u64, &'static str)> {
    let FaultCounts {
        items: _,
        lost,
        lost_positions,
        bursts,
        duplicated,
        overtaken,
        corrupted,
        resized,
        spoofed,
        delayed,
        silenced,
        reboots,
        frozen,
        pulses,
        stepped,
    } = *counts;
    [
        (lost, "lost"),
        (lost_positions, "position packets lost"),
        (bursts, "bursts"),
        (duplicated, "duplicated"),
        (overtaken, "overtaken"),
        (corrupted, "corrupted"),
        (resized, "resized"),
        (spoofed, "foreign ones added"),
        (delayed, "delayed"),
        (silenced, "silenced"),
        (reboots, "reboots"),
        (frozen, "frozen"),
        (pulses, "pulses changed"),
        (stepped, "stamps stepped"),
    ]
    .into_iter()
    .filter(|(count, _)| *count > 0)
}

fn text(path: &Path) -> Result<String, Failure> {
    if let Some((_, text)) = FAULTS.iter().find(|(name, _)| path == Path::new(name)) {
        return Ok((*text).to_owned());
    }
    let failed = |error: String| {
        Failure::input(format!("the faults {}: {error}", path.display())).with_help(format!(
            "give a TOML file, or one of the program's own by its name: {}",
            names().collect::<Vec<_>>().join(", ")
        ))
    };
    match std::fs::metadata(path) {
        Err(error) => return Err(failed(format!("cannot be read: {error}"))),
        Ok(found) if !found.is_file() => return Err(failed("no regular file".to_owned())),
        Ok(found) if found.len() > LONGEST => {
            return Err(failed(format!("{} bytes: a fault file has at most {LONGEST}", found.len())));
        }
        Ok(_) => {}
    }
    std::fs::read_to_string(path).map_err(|error| failed(format!("cannot be read: {error}")))
}

fn parse(path: &Path, text: &str) -> Result<FaultScript, Failure> {
    let script: FaultScript = toml::from_str(text).map_err(|error| {
        Failure::input(format!("the faults {}: {error}", path.display()))
            .with_help("docs/faults.md has every key; docs/schema/faults.schema.json lets an editor complete them")
    })?;
    script.check().map_err(|error| {
        let place = place(path, text, error.number.saturating_sub(1));
        let help = format!("`{}` may be {}", error.name, error.expected);
        Failure::input(format!("{place}: fault {}: {} is {}", error.number, error.name, error.found)).with_help(help)
    })?;
    Ok(script)
}

/// `the faults FILE:LINE`, where a fault begins; faults count from 0.
fn place(path: &Path, text: &str, number: usize) -> String {
    #[derive(Default, Deserialize)]
    struct Places {
        #[serde(default)]
        fault: Vec<toml::Spanned<serde::de::IgnoredAny>>,
    }
    let places: Places = toml::from_str(text).unwrap_or_default();
    let before = places.fault.get(number).and_then(|fault| text.get(..fault.span().start)).unwrap_or_default();
    format!("the faults {}:{}", path.display(), 1 + before.matches('\n').count())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn every_fault_file_of_the_program_is_one() {
        for name in names() {
            assert!(!read(Path::new(name)).expect("a fault file").fault.is_empty(), "{name}");
        }
    }

    proptest! {
        #[test]
        fn any_text_is_a_fault_file_or_an_error_that_names_it(
            pieces in prop::collection::vec(
                prop_oneof![
                    prop::sample::select(vec![
                        "[[fault]]\n", "seed = 1\n", "action = \"unplug\"\n", "action.loss.probability = ", "sensor = \"rear\"\n",
                        "from_s = ", "until_s = ", "0.5\n", "-1\n", "1e300\n", "nan\n", "fault = [{ action = \"freeze\" }]\n",
                    ]).prop_map(str::to_owned),
                    "\\PC{0,5}",
                ],
                0..12,
            ),
        ) {
            let text = pieces.concat();
            match parse(Path::new("mine.toml"), &text) {
                Ok(script) => {
                    prop_assert!(script.check().is_ok());
                    prop_assert!(place(Path::new("mine.toml"), &text, 0).starts_with("the faults mine.toml:"));
                }
                Err(failure) => prop_assert!(failure.to_string().contains("mine.toml"), "{}", failure),
            }
        }
    }

    #[test]
    fn what_was_done_is_told_and_what_was_not_is_not() {
        let mut truth = FaultTruth::default();
        assert!(!any_done(&truth));
        truth.sensors.insert("near".to_owned(), FaultCounts { items: 90, ..FaultCounts::default() });
        assert!(!any_done(&truth));
        truth.sensors.insert("front".to_owned(), FaultCounts { items: 1_508, lost: 30, ..FaultCounts::default() });
        truth.anchors_stepped = 2;
        let expected = ["front: of 1508 items 30 lost", "near: of 90 items nothing", "wall clock: 2 anchors stepped"];
        assert_eq!((lines(&truth), any_done(&truth)), (expected.map(str::to_owned).to_vec(), true));
    }
}
