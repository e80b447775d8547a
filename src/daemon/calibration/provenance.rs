//! How a result was found: stands beside it in the calibration file and in the report.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_calib::{Gate, Status};
use tumbled_model::{CivilTime, UnixNs};

use crate::cli::{Failure, VERSION};

/// How a result was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Provenance {
    /// The verdict: the worst of the gates. A result that fails is not written to a calibration file.
    pub status: Status,
    /// Version and commit of the program.
    pub program: String,
    /// When it was calculated, UTC.
    pub date: String,
    /// What it was calculated from.
    pub inputs: Vec<InputDigest>,
    /// The sensors' serial numbers by id; a sensor whose number nobody knows is left out.
    pub serials: BTreeMap<String, String>,
    /// What the rows of `covariance` are, with units, frame and the side that a perturbation is on.
    pub covariance_of: Vec<String>,
    /// The covariance, row by row.
    pub covariance: Vec<Vec<f64>>,
    /// What was asked of the result, and what was found.
    pub gates: Vec<Gate>,
}

/// An input and its content.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct InputDigest {
    /// Its name as it was given.
    pub name: String,
    /// BLAKE3 of its content, of a folder's files in the order of their names; of a simulated scene its name's alone.
    pub blake3: String,
}

impl Provenance {
    /// Of a result with these gates, now. Covariance and serials are left empty.
    pub fn new(inputs: Vec<InputDigest>, gates: Vec<Gate>) -> Self {
        Self {
            status: Status::worst(gates.iter().map(|gate| gate.status)),
            program: VERSION.to_owned(),
            date: now_utc(),
            inputs,
            serials: BTreeMap::new(),
            covariance_of: Vec::new(),
            covariance: Vec::new(),
            gates,
        }
    }
}

/// The wall clock, UTC to the second: `2026-11-23T10:00:00Z`.
pub fn now_utc() -> String {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    // Whole seconds of this century fit.
    let now = CivilTime::from_unix(UnixNs(since.as_secs() as i64 * 1_000_000_000));
    let CivilTime { year, month, day, hour, minute, second, .. } = now;
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

/// The digests of inputs.
///
/// # Errors
/// Exit code 2: an input that cannot be read.
pub fn digests(inputs: &[PathBuf]) -> Result<Vec<InputDigest>, Failure> {
    inputs.iter().map(|input| digest(input)).collect()
}

fn digest(input: &Path) -> Result<InputDigest, Failure> {
    let unreadable =
        |error: io::Error| Failure::input(format!("{} cannot be read for its digest: {error}", input.display()));
    let mut hasher = blake3::Hasher::new();
    if crate::simulation::scene_of(input).is_some() {
        hasher.update(input.as_os_str().as_encoded_bytes());
    } else if input.is_dir() {
        let entries = input.read_dir().map_err(unreadable)?;
        let mut files: Vec<PathBuf> =
            entries.map(|entry| entry.map(|entry| entry.path())).collect::<Result<_, _>>().map_err(unreadable)?;
        files.sort();
        for file in files.iter().filter(|file| file.is_file()) {
            absorb(&mut hasher, file).map_err(unreadable)?;
        }
    } else {
        absorb(&mut hasher, input).map_err(unreadable)?;
    }
    Ok(InputDigest { name: input.display().to_string(), blake3: hasher.finalize().to_hex().to_string() })
}

fn absorb(hasher: &mut blake3::Hasher, file: &Path) -> io::Result<()> {
    let mut file = File::open(file)?;
    let mut piece = vec![0; 1 << 16];
    loop {
        let read = file.read(&mut piece)?;
        if read == 0 {
            return Ok(());
        }
        hasher.update(piece.get(..read).unwrap_or_default());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_date_is_utc_to_the_second() {
        let now = now_utc();
        assert_eq!((now.len(), now.get(4..5), now.get(10..11), now.get(19..)), (20, Some("-"), Some("T"), Some("Z")));
    }

    #[test]
    fn a_digest_is_of_the_content_and_an_input_that_is_not_there_is_told() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("a");
        std::fs::write(&file, "abc").expect("written");
        let found = digest(&file).expect("readable");
        assert_eq!(found.blake3, blake3::hash(b"abc").to_hex().to_string());
        // A folder with that file alone has the same content.
        assert_eq!(digest(folder.path()).expect("readable").blake3, found.blake3);
        assert_eq!(digest(&folder.path().join("b")).expect_err("not there").exit_code(), 2);
    }
}
