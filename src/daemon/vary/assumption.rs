//! What is assumed of a rig and varied: one number of one sensor.

use std::fmt;
use std::sync::Arc;

use nalgebra::{UnitQuaternion, Vector3};
use tumbled_model::Span;

use crate::calibration::plays::Change;
use crate::config::Config;

/// Values of an assumption where none are asked for.
const VALUES: usize = 9;
/// Values of one assumption at most.
const MOST_VALUES: usize = 41;
/// Assumptions at most.
const MOST_ASSUMPTIONS: usize = 8;

/// What of a sensor is varied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum What {
    /// The time offset, ms.
    Time,
    /// The mounting's rotation about a rig axis, degrees.
    Turn(usize),
    /// The mounting's place along a rig axis, mm.
    Shift(usize),
}

const NAMES: [(&str, What); 7] = [
    ("time_offset_ms", What::Time),
    ("extrinsic.rx_deg", What::Turn(0)),
    ("extrinsic.ry_deg", What::Turn(1)),
    ("extrinsic.rz_deg", What::Turn(2)),
    ("extrinsic.x_mm", What::Shift(0)),
    ("extrinsic.y_mm", What::Shift(1)),
    ("extrinsic.z_mm", What::Shift(2)),
];

/// One assumption with the values it is given, each added to what the config has.
#[derive(Clone, Debug, PartialEq)]
pub struct Assumption {
    /// The sensor; empty: the first Kinect, or without one the first LiDAR.
    sensor: String,
    what: What,
    values: Vec<f64>,
}

/// What `--vary` is given: `time_offset_ms=-10..10,near.extrinsic.rz_deg=-1..1:5`.
///
/// # Errors
/// What is wrong, in words.
pub fn parse(text: &str) -> Result<Vec<Assumption>, String> {
    let all: Vec<Assumption> = text.split(',').map(|part| one(part.trim())).collect::<Result<_, _>>()?;
    if all.len() > MOST_ASSUMPTIONS {
        return Err(format!("{} assumptions, at most {MOST_ASSUMPTIONS} at a time", all.len()));
    }
    Ok(all)
}

fn one(text: &str) -> Result<Assumption, String> {
    let names = || NAMES.map(|(name, _)| name).join(", ");
    let form = || format!("`{text}`: expected KEY=FROM..TO or KEY=FROM..TO:COUNT, KEY one of {}", names());
    let (key, range) = text.split_once('=').ok_or_else(form)?;
    let found = NAMES.iter().find_map(|(name, what)| {
        let before = key.strip_suffix(name)?;
        let sensor = if before.is_empty() { "" } else { before.strip_suffix('.').filter(|id| !id.is_empty())? };
        Some((sensor, *what))
    });
    let (sensor, what) = found.ok_or_else(form)?;
    let (ends, count) = match range.split_once(':') {
        Some((ends, count)) => (ends, count.parse().ok().filter(|count| (3..=MOST_VALUES).contains(count))),
        None => (range, Some(VALUES)),
    };
    let count = count.ok_or_else(|| format!("`{text}`: expected 3 to {MOST_VALUES} values"))?;
    let (from, to) = ends.split_once("..").ok_or_else(form)?;
    let number = |end: &str| end.parse::<f64>().ok().filter(|value| value.abs() <= 1e4).ok_or_else(form);
    let (from, to) = (number(from)?, number(to)?);
    if from >= to {
        return Err(format!("`{text}`: {from} is not below {to}"));
    }
    let value = |n: usize| from + (to - from) * n as f64 / (count - 1) as f64;
    Ok(Assumption { sensor: sensor.to_owned(), what, values: (0..count).map(value).collect() })
}

impl fmt::Display for Assumption {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = NAMES.iter().find(|(_, what)| *what == self.what).map_or("", |(name, _)| name);
        if self.sensor.is_empty() { f.write_str(name) } else { write!(f, "{}.{name}", self.sensor) }
    }
}

impl Assumption {
    /// With the sensor it is of, as the config has it.
    ///
    /// # Errors
    /// The config has no such sensor.
    pub fn of(self, config: &Config) -> Result<Self, String> {
        let kinects = config.kinects.iter().map(|kinect| kinect.id.to_string());
        let ids: Vec<String> = kinects.chain(config.lidars.iter().map(|lidar| lidar.id.to_string())).collect();
        let sensor = if self.sensor.is_empty() { ids.first().cloned() } else { Some(self.sensor.clone()) };
        match sensor.filter(|sensor| ids.contains(sensor)) {
            Some(sensor) => Ok(Self { sensor, ..self }),
            None => Err(format!("{self}: the config's sensors are {}", ids.join(", "))),
        }
    }

    /// The values, each added to what the config has.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// A config's change to one of its values.
    pub fn change(&self, value: f64) -> Change {
        let (sensor, what) = (self.sensor.clone(), self.what);
        Arc::new(move |config| {
            for lidar in config.lidars.iter_mut().filter(|lidar| lidar.id.to_string() == sensor) {
                vary(what, value, &mut lidar.time_offset, &mut lidar.t_rig_lidar.isometry);
            }
            for kinect in config.kinects.iter_mut().filter(|kinect| kinect.id.to_string() == sensor) {
                vary(what, value, &mut kinect.time_offset, &mut kinect.t_rig_kinect.isometry);
            }
        })
    }
}

/// A mounting turns about the sensor's own place, by the rig's axes.
fn vary(what: What, value: f64, offset: &mut Span, mounting: &mut nalgebra::Isometry3<f64>) {
    let along = |n: usize| Vector3::from_fn(|row, _| if row == n { 1.0 } else { 0.0 });
    match what {
        What::Time => offset.0 += (value * 1e6).round() as i64,
        What::Turn(n) => {
            mounting.rotation = UnitQuaternion::from_scaled_axis(along(n) * value.to_radians()) * mounting.rotation;
        }
        What::Shift(n) => mounting.translation.vector += along(n) * (value * 1e-3),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_goes_from_end_to_end_and_has_the_middle() {
        let all = parse("time_offset_ms=-10..10,near.extrinsic.rz_deg=-1..1:5").expect("two");
        assert_eq!((all[0].values().len(), all[0].values()[4]), (9, 0.0));
        assert_eq!(all[1].values(), [-1.0, -0.5, 0.0, 0.5, 1.0]);
        assert_eq!(
            all.iter().map(ToString::to_string).collect::<Vec<_>>(),
            ["time_offset_ms", "near.extrinsic.rz_deg"]
        );
    }

    #[test]
    fn what_is_no_assumption_is_told_with_what_one_is() {
        let fault = |text| parse(text).expect_err("none");
        assert!(fault("time_offset=-1..1").contains("KEY one of time_offset_ms"));
        assert!(fault("time_offset_ms=1..-1").contains("1 is not below -1"));
        assert!(fault("time_offset_ms=0..1:2").contains("expected 3 to 41 values"));
        assert!(fault(".time_offset_ms=0..1").contains("KEY=FROM..TO"));
        assert!(fault("time_offset_ms=0..inf").contains("KEY=FROM..TO"));
        assert!(fault(&["extrinsic.x_mm=0..1"; 9].join(",")).contains("9 assumptions"));
    }

    #[test]
    fn a_mounting_turns_about_its_own_place_by_the_rigs_axes() {
        let mut mounting = nalgebra::Isometry3::translation(1.0, 2.0, 3.0);
        let mut offset = Span(0);
        vary(What::Turn(2), 90.0, &mut offset, &mut mounting);
        vary(What::Shift(0), -5.0, &mut offset, &mut mounting);
        vary(What::Time, 1.5, &mut offset, &mut mounting);
        assert!((mounting.translation.vector - Vector3::new(0.995, 2.0, 3.0)).norm() < 1e-12);
        assert!((mounting.rotation * Vector3::x() - Vector3::y()).norm() < 1e-12);
        assert_eq!(offset, Span(1_500_000));
    }
}
