//! The calibration file: several results in one file, each replaced by itself.
//!
//! What was there is never lost: the old file is kept beside the new one, its time in its name.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use tumbled_model::{CivilTime, UnixNs};

use super::provenance::Provenance;
use crate::cli::{Failure, output};
use crate::config::calibration::RawCalibration;

/// What stands at the top of every calibration file.
const HEADER: &str = "# What `tumbled calibrate` found. Name it in the config: [rig] calibration = \"…\".\n\
    # Quaternions are x, y, z, w; t_rig_X takes coordinates of X to the rig's; time = stamp - time_offset_ms.\n\n";

/// Reads the calibration file that is there; where there is none, an empty one.
///
/// # Errors
/// Exit code 2: a file that is there and is no calibration file. It is not written over.
pub fn read(path: &Path) -> Result<RawCalibration, Failure> {
    let unusable = |problem: String| {
        Failure::input(format!("{}: {problem}", path.display()))
            .with_help("a calibration file is expected there, or nothing: name another file with -o")
    };
    match fs::read_to_string(path) {
        Ok(text) => toml::from_str(&text).map_err(|error| unusable(error.to_string())),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(RawCalibration::default()),
        Err(error) => Err(unusable(format!("cannot be read: {error}"))),
    }
}

/// Says how a result was found, under the name of the command that found it.
///
/// # Errors
/// A provenance that cannot be written as JSON: none can.
pub fn note(file: &mut RawCalibration, command: &str, provenance: &Provenance) -> Result<(), Failure> {
    let value = serde_json::to_value(provenance).map_err(Failure::failed)?;
    file.provenance.insert(command.to_owned(), value);
    Ok(())
}

/// Writes the calibration file. Where one is there already it is kept as `NAME.YYYYMMDDThhmmssZ.bak`, the time being that of
/// its last change; its path is given back.
///
/// # Errors
/// Exit code 1: the folder cannot be written.
pub fn write(path: &Path, file: &RawCalibration) -> Result<Option<PathBuf>, Failure> {
    let failed = |error: std::io::Error| Failure::failed(format!("cannot write {}: {error}", path.display()));
    let text = toml::to_string(file).map_err(Failure::failed)?;
    let mut fresh = output::beside(output::folder_of(path)).map_err(failed)?;
    fresh.write_all(HEADER.as_bytes()).and_then(|()| fresh.write_all(text.as_bytes())).map_err(failed)?;
    fresh.as_file().sync_all().map_err(failed)?;
    let kept = match fs::metadata(path) {
        Ok(there) => {
            let backup = backup(path, there.modified().map_err(failed)?);
            fs::copy(path, &backup).map_err(failed)?;
            Some(backup)
        }
        Err(_) => None,
    };
    let permissions = std::os::unix::fs::PermissionsExt::from_mode(0o644);
    fresh.as_file().set_permissions(permissions).map_err(failed)?;
    fresh.persist(path).map_err(|error| failed(error.error))?;
    Ok(kept)
}

/// A name for the old file that nothing has.
fn backup(path: &Path, changed: SystemTime) -> PathBuf {
    let since = changed.duration_since(UNIX_EPOCH).unwrap_or_default();
    let CivilTime { year, month, day, hour, minute, second, .. } =
        CivilTime::from_unix(UnixNs(since.as_secs() as i64 * 1_000_000_000));
    let stamp = format!("{year:04}{month:02}{day:02}T{hour:02}{minute:02}{second:02}Z");
    let named = |suffix: &str| {
        let mut name = path.as_os_str().to_owned();
        name.push(suffix);
        PathBuf::from(name)
    };
    let first = named(&format!(".{stamp}.bak"));
    let others = (2..u32::MAX).map(|n| named(&format!(".{stamp}.{n}.bak")));
    std::iter::once(first.clone()).chain(others).find(|name| !name.exists()).unwrap_or(first)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::calibration::{CalibratedKinect, CalibratedTransform};

    fn of_kinect(x: f64) -> RawCalibration {
        let t = CalibratedTransform { translation_m: [x, 0.0, 0.0], rotation_xyzw: [0.0, 0.0, 0.0, 1.0] };
        let kinect = CalibratedKinect { t_rig_kinect: Some(t), ..CalibratedKinect::default() };
        RawCalibration { kinect: [("near".to_owned(), kinect)].into(), ..RawCalibration::default() }
    }

    #[test]
    fn what_is_written_is_read_and_what_was_there_is_kept() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("calibration.toml");
        assert_eq!(read(&path).expect("nothing there"), RawCalibration::default());
        let mut first = of_kinect(0.1);
        note(&mut first, "extrinsic", &Provenance::new(Vec::new(), Vec::new())).expect("JSON");
        assert_eq!(write(&path, &first).expect("written"), None);
        assert_eq!(read(&path).expect("a calibration"), first);
        let kept = [0.2, 0.3].map(|x| write(&path, &of_kinect(x)).expect("written").expect("kept"));
        assert_eq!(read(&path).expect("a calibration"), of_kinect(0.3));
        // Two within one second have two names.
        assert_ne!(kept[0], kept[1]);
        assert_eq!(read(&kept[0]).expect("the first"), first);
        assert_eq!(read(&kept[1]).expect("the second"), of_kinect(0.2));
    }

    #[test]
    fn a_file_that_is_none_is_not_taken_for_one() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("rig.toml");
        fs::write(&path, "[stream]\nrate_hz = 50\n").expect("written");
        let failure = read(&path).expect_err("a config");
        assert!(failure.exit_code() == 2 && failure.to_string().contains("stream"), "{failure}");
    }
}
