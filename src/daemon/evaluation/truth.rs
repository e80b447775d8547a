//! Truth from a file, as `tumbled simulate` writes it: `truth.csv`.

use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::path::Path;

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use tumbled_core::evaluate::TruthSample;
use tumbled_model::{RigNs, UnixNs};

/// The columns; their order is that of the heading, and others may stand among them.
pub const COLUMNS: [&str; 12] = ["t_ns", "unix_ns", "px", "py", "pz", "qx", "qy", "qz", "qw", "wx", "wy", "wz"];

/// A line of a truth file is a few hundred bytes.
const LONGEST_LINE: u64 = 8_192;
/// 14 hours at 100 a second, 112 bytes each.
const MOST_SAMPLES: usize = 5_000_000;
/// A quaternion may be so much longer or shorter than 1: those of four decimals are.
const LENGTH_OFF: f64 = 1e-3;

/// A truth with both its times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedTruth {
    /// The truth at its session time.
    pub sample: TruthSample,
    /// Its wall time.
    pub unix: UnixNs,
}

/// Why a file is no truth.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TruthError {
    /// It cannot be read.
    #[error("cannot read {path}: {error}")]
    Io {
        /// The file.
        path: String,
        /// Why.
        error: io::Error,
    },
    /// A line is not as it must be.
    #[error("{path}:{line}: {fault}")]
    Line {
        /// The file.
        path: String,
        /// The line, from 1.
        line: usize,
        /// What was found and what was expected.
        fault: String,
    },
}

/// Reads a file: a heading with [`COLUMNS`], and a line for each time, in the order of `t_ns` and of `unix_ns`.
///
/// # Errors
/// [`TruthError`].
pub fn read(path: &Path) -> Result<Vec<TimedTruth>, TruthError> {
    let name = path.display().to_string();
    let file = File::open(path).map_err(|error| TruthError::Io { path: name.clone(), error })?;
    parse(BufReader::new(file), &name)
}

fn parse(mut text: impl BufRead, path: &str) -> Result<Vec<TimedTruth>, TruthError> {
    let mut columns: Option<[usize; COLUMNS.len()]> = None;
    let mut samples: Vec<TimedTruth> = Vec::new();
    let mut buffer = Vec::new();
    for line in 1.. {
        let at = |fault: String| TruthError::Line { path: path.to_owned(), line, fault };
        buffer.clear();
        let read = io::Read::take(&mut text, LONGEST_LINE).read_until(b'\n', &mut buffer);
        if read.map_err(|error| TruthError::Io { path: path.to_owned(), error })? == 0 {
            break;
        }
        if buffer.len() as u64 == LONGEST_LINE {
            return Err(at(format!("the line is longer than {LONGEST_LINE} bytes: this is no table of truth")));
        }
        let row = std::str::from_utf8(&buffer);
        let row = row.map_err(|error| at(format!("not text ({error}): expected a CSV file with a heading")))?.trim();
        if row.is_empty() {
            continue;
        }
        let cells: Vec<&str> = row.split(',').map(str::trim).collect();
        let Some(columns) = &columns else {
            columns = Some(heading(&cells).map_err(at)?);
            continue;
        };
        let sample = sample(&cells, columns).map_err(at)?;
        let is_later = |last: &TimedTruth| sample.sample.t > last.sample.t && sample.unix > last.unix;
        if !samples.last().is_none_or(is_later) {
            return Err(at(
                "t_ns or unix_ns is not later than on the line before: sort by time, leave out doubles".into()
            ));
        }
        if samples.len() >= MOST_SAMPLES {
            return Err(at(format!("more than {MOST_SAMPLES} lines: give the part that the inputs cover")));
        }
        samples.push(sample);
    }
    if samples.len() < 2 {
        let (line, fault) = (1, format!("{} samples of truth, and two are the least", samples.len()));
        return Err(TruthError::Line { path: path.to_owned(), line, fault });
    }
    Ok(samples)
}

fn heading(cells: &[&str]) -> Result<[usize; COLUMNS.len()], String> {
    let mut columns = [0; COLUMNS.len()];
    for (to, name) in columns.iter_mut().zip(COLUMNS) {
        let Some(found) = cells.iter().position(|cell| *cell == name) else {
            let found: String = cells.join(",").chars().take(80).collect();
            return Err(format!("no column {name} in the heading `{found}`; expected `{}`", COLUMNS.join(",")));
        };
        *to = found;
    }
    Ok(columns)
}

fn sample(cells: &[&str], columns: &[usize; COLUMNS.len()]) -> Result<TimedTruth, String> {
    let named = |wanted: usize| {
        let (name, column) = (COLUMNS[wanted], columns[wanted]);
        let cell = cells.get(column).ok_or_else(|| format!("{} values, and {name} would be one more", cells.len()))?;
        Ok::<_, String>((name, *cell))
    };
    let time = |wanted: usize| {
        let (name, cell) = named(wanted)?;
        cell.parse::<i64>().ok().ok_or_else(|| format!("{name}: expected whole nanoseconds, found `{}`", short(cell)))
    };
    let mut values = [0.0; 10];
    for (n, value) in values.iter_mut().enumerate() {
        let (name, cell) = named(n + 2)?;
        let number = cell.parse::<f64>().ok().filter(|number| number.abs() < 1e6);
        *value = number.ok_or_else(|| format!("{name}: expected a number below a million, found `{}`", short(cell)))?;
    }
    let [px, py, pz, qx, qy, qz, qw, wx, wy, wz] = values;
    let rotation = Quaternion::new(qw, qx, qy, qz);
    if (rotation.norm() - 1.0).abs() > LENGTH_OFF {
        return Err(format!("qx, qy, qz, qw: expected a quaternion of length 1, found one of {:.4}", rotation.norm()));
    }
    let pose = Isometry3::from_parts(Translation3::new(px, py, pz), UnitQuaternion::from_quaternion(rotation));
    let sample = TruthSample { t: RigNs(time(0)?), t_rig_target: pose, angular_velocity_rps: Vector3::new(wx, wy, wz) };
    Ok(TimedTruth { sample, unix: UnixNs(time(1)?) })
}

/// What is quoted of a foreign cell.
fn short(cell: &str) -> String {
    cell.chars().take(24).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const HEADING: &str = "t_ns,unix_ns,px,py,pz,qx,qy,qz,qw,wx,wy,wz";

    fn fault(text: &str) -> String {
        parse(text.as_bytes(), "t.csv").expect_err("no truth").to_string()
    }

    #[test]
    fn columns_are_found_by_their_names_in_any_order() {
        let text = "unix_ns,t_ns,note,px,py,pz,qw,qx,qy,qz,wx,wy,wz\r\n1000,0,a,1,2,3,1,0,0,0,0.1,0.2,0.3\r\n\
                    1010,10,b,1,2,3,0,0,0,1,0,0,0\r\n\n";
        let found = parse(text.as_bytes(), "t.csv").expect("a truth");
        assert_eq!((found.len(), found[0].unix, found[1].sample.t), (2, UnixNs(1000), RigNs(10)));
        assert_eq!(found[0].sample.t_rig_target.translation.vector, Vector3::new(1.0, 2.0, 3.0));
        assert_eq!(found[0].sample.angular_velocity_rps, Vector3::new(0.1, 0.2, 0.3));
        // qz = 1: half a turn about z.
        assert!((found[1].sample.t_rig_target.rotation.angle() - std::f64::consts::PI).abs() < 1e-12);
    }

    #[test]
    fn what_is_no_truth_is_told_with_its_line() {
        let good = "0,0,1,2,3,0,0,0,1,0,0,0";
        assert!(fault("a,b\n1,2\n").starts_with("t.csv:1: no column t_ns in the heading `a,b`"));
        assert!(fault(HEADING).contains("0 samples"));
        let cases = [
            ("1,1,1,2", "t.csv:3: 4 values, and pz"),
            ("1,1,x,2,3,0,0,0,1,0,0,0", "t.csv:3: px: expected a number below a million, found `x`"),
            ("1,1,NaN,2,3,0,0,0,1,0,0,0", "px: expected a number"),
            ("1.5,1,1,2,3,0,0,0,1,0,0,0", "t_ns: expected whole nanoseconds, found `1.5`"),
            ("1,1,1,2,3,0,0,0,2,0,0,0", "expected a quaternion of length 1, found one of 2.0000"),
            ("0,1,1,2,3,0,0,0,1,0,0,0", "not later than on the line before"),
        ];
        for (line, expected) in cases {
            let found = fault(&format!("{HEADING}\n{good}\n{line}\n"));
            assert!(found.contains(expected), "{found}");
        }
        assert!(parse(&b"\xff\xfe\n"[..], "t.csv").expect_err("binary").to_string().contains("not text"));
        assert!(fault(&"x".repeat(10_000)).contains("longer than"));
    }

    proptest! {
        #[test]
        fn whatever_the_bytes_a_truth_is_in_order_and_finite(
            bytes in proptest::collection::vec(any::<u8>(), 0..400),
            rows in proptest::collection::vec("[-]?[0-9]{1,3}(,[-]?[0-9.e]{1,4}){11}", 0..6),
        ) {
            for text in [bytes, format!("{HEADING}\n{}", rows.join("\n")).into_bytes()] {
                let Ok(found) = parse(&text[..], "t.csv") else { continue };
                prop_assert!(found.len() >= 2 && found.is_sorted_by(|a, b| a.sample.t < b.sample.t && a.unix < b.unix));
                prop_assert!(found.iter().all(|truth| truth.sample.angular_velocity_rps.norm().is_finite()));
            }
        }
    }
}
