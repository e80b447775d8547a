//! Whether recorded frames can be played.
//!
//! The player ends the *program* when a file is not there, and hands out what it read whatever its length. So everything it
//! will read is looked at before it is called; who changes the folder while it plays does so at his own risk.

use crate::error::PlaybackError;
use crate::frame::UNPACKED_BYTES;
use std::ffi::OsStr;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

/// A header line is 17 bytes; a comment may make it longer.
const HEADER_LIMIT: u64 = 1_024;
/// The longest name a file can have on Linux, and a line break.
const LINE_LIMIT: u64 = 256;

/// Looks at the folder that the environment names to the player.
pub(crate) fn check(folder: Option<&OsStr>) -> Result<(), PlaybackError> {
    let folder = PathBuf::from(folder.filter(|folder| !folder.is_empty()).ok_or(PlaybackError::NoFolder)?);
    let index = folder.join("INDEX.txt");
    let unreadable = |error| PlaybackError::Unreadable { path: index.clone(), error };
    if !index.metadata().map_err(unreadable)?.is_file() {
        return Err(PlaybackError::IndexIsNoFile { path: index });
    }
    let mut lines = BufReader::new(File::open(&index).map_err(unreadable)?);
    for number in 1.. {
        let mut line = Vec::new();
        lines.by_ref().take(LINE_LIMIT).read_until(b'\n', &mut line).map_err(unreadable)?;
        let name = line.strip_suffix(b"\n").unwrap_or(&line);
        if name.is_empty() {
            // The end, or a blank line, which the player takes for the end.
            return Ok(());
        }
        let Some((name, is_depth)) = std::str::from_utf8(name).ok().and_then(entry) else {
            let found = String::from_utf8_lossy(name).chars().take(80).collect();
            return Err(PlaybackError::IndexLine { path: index, line: number, found });
        };
        check_file(&folder.join(name), is_depth)?;
    }
    Ok(())
}

/// A name of the form TYPE-SECONDS-TICKS.ext, and whether it is a depth frame's.
fn entry(name: &str) -> Option<(&str, bool)> {
    let mut parts = name.splitn(3, '-');
    let is_depth = match parts.next()? {
        "d" => true,
        "r" | "a" => false,
        _ => return None,
    };
    let seconds: f64 = parts.next()?.parse().ok()?;
    let (ticks, _extension) = parts.next()?.split_once('.')?;
    let _ticks: u32 = ticks.parse().ok()?;
    (seconds.is_finite() && !name.contains('/')).then_some((name, is_depth))
}

fn check_file(path: &Path, is_depth: bool) -> Result<(), PlaybackError> {
    let unreadable = |error| PlaybackError::Unreadable { path: path.to_owned(), error };
    let file = File::open(path).map_err(unreadable)?;
    let metadata = file.metadata().map_err(unreadable)?;
    if !metadata.is_file() {
        return Err(unreadable(io::Error::new(io::ErrorKind::InvalidInput, "not a regular file")));
    }
    if !is_depth {
        return Ok(());
    }
    let mut header = Vec::new();
    file.take(HEADER_LIMIT).read_to_end(&mut header).map_err(unreadable)?;
    // Without a line break the whole file is payload: of a wrong length.
    let header = header.iter().position(|&byte| byte == b'\n').map_or(0, |end| end as u64 + 1);
    let (found, expected) = (metadata.len() - header.min(metadata.len()), UNPACKED_BYTES as u64);
    if header == 0 || found != expected {
        return Err(PlaybackError::WrongLength { path: path.to_owned(), found, expected });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(index: &str, depth_bytes: usize) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("INDEX.txt"), index).expect("an index");
        let mut frame = b"P5 640 480 65535\n".to_vec();
        frame.resize(17 + depth_bytes, 0);
        std::fs::write(folder.path().join("d-1.000000-5.pgm"), frame).expect("a frame");
        std::fs::write(folder.path().join("a-1.000000-5.dump"), [0; 12]).expect("a reading");
        folder
    }

    fn refusal(index: &str, depth_bytes: usize) -> String {
        let folder = folder(index, depth_bytes);
        check(Some(folder.path().as_os_str())).expect_err("refused").to_string()
    }

    #[test]
    fn a_whole_folder_is_played_up_to_its_first_blank_line() {
        let folder = folder("a-1.000000-5.dump\nd-1.000000-5.pgm\n\nnothing of this name", 614_400);
        check(Some(folder.path().as_os_str())).expect("all is there");
    }

    #[test]
    fn what_would_end_the_program_is_an_error() {
        assert!(matches!(check(None), Err(PlaybackError::NoFolder)));
        assert!(matches!(check(Some(OsStr::new(""))), Err(PlaybackError::NoFolder)));
        let missing = check(Some(OsStr::new("/nowhere"))).expect_err("not there").to_string();
        assert!(missing.contains("/nowhere/INDEX.txt"), "{missing}");
        assert!(refusal("d-2.000000-5.pgm\n", 614_400).contains("d-2.000000-5.pgm"));
        assert!(refusal("../d-1.000000-5.pgm\n", 614_400).contains("line 1: `../d-1"));
        assert!(refusal(&format!("a-1.000000-5.dump\nd-1-{}\n", "5".repeat(1_000)), 614_400).contains("line 2"));
    }

    #[test]
    fn a_frame_of_another_length_is_not_handed_to_the_player() {
        // It would hand out 614 400 bytes whatever it has read.
        assert!(refusal("d-1.000000-5.pgm\n", 614_399).contains("holds 614399 bytes"));
        assert!(refusal("d-1.000000-5.pgm\n", 422_400).contains("expected 614400"));
    }
}
