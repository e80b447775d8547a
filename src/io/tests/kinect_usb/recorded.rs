//! On the player of recorded frames (fakenect).

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::child::{Running, digest, of};

const HEADER: &[u8] = b"P5 640 480 65535\n";

/// Where the player's library lies: beside the real one, in a folder of its own.
fn player() -> Option<PathBuf> {
    let output = Command::new("pkg-config").args(["--variable=libdir", "libfreenect"]).output().ok()?;
    let folder = PathBuf::from(String::from_utf8(output.stdout).ok()?.trim()).join("fakenect");
    if folder.join("libfreenect.so.0.5").exists() {
        return Some(folder);
    }
    println!("skipped: no fakenect folder beside libfreenect");
    None
}

fn start(player: &Path, frames: &Path) -> Running {
    let variable = |name: &str, value: &Path| (OsString::from(name), value.as_os_str().to_owned());
    Running::start(&[variable("LD_LIBRARY_PATH", player), variable("FAKENECT_PATH", frames)])
}

/// Frames 1, 2, … recorded at these host times.
fn recorded(host_times: &[&str]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let mut index = String::new();
    for (n, time) in (1u32..).zip(host_times) {
        let name = format!("d-{time}-{}.pgm", n * 2_000_000);
        fs::write(folder.path().join(&name), [HEADER, &made(n)].concat()).expect("a frame");
        index.push_str(&name);
        index.push('\n');
    }
    fs::write(folder.path().join("INDEX.txt"), index).expect("an index");
    folder
}

fn made(seed: u32) -> Vec<u8> {
    (0..307_200u32).flat_map(|pixel| (((pixel * 31 + seed * 977) % 2_048) as u16).to_le_bytes()).collect()
}

#[test]
fn recorded_frames_go_into_the_ledger_and_their_end_closes_the_source() {
    let Some(player) = player() else { return };
    let folder = recorded(&["1.000000", "1.000000", "1.020000"]);
    let lines = start(&player, folder.path()).end();
    let frame = |n: u32| format!("frame Raw11 ticks={} lost=0 digest={}", n * 2_000_000, digest(&made(n)));
    assert_eq!(of(&lines, "frame"), [frame(1), frame(2), frame(3)]);
    assert_eq!(of(&lines, "state"), ["state Opened", "state Closed"]);
    assert_eq!(of(&lines, "opened"), ["opened recorded=true serial=None"]);
    assert_eq!(of(&lines, "ended"), ["ended delivered=3 lost=0 abandoned=0 error=None"]);
}

#[test]
fn a_folder_that_cannot_be_played_ends_the_source_with_the_cause() {
    let Some(player) = player() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let lines = start(&player, folder.path()).end();
    assert!(of(&lines, "ended")[0].contains("INDEX.txt: No such file"), "{lines:#?}");
}

#[test]
fn a_stop_ends_it_though_the_library_sleeps() {
    let Some(player) = player() else { return };
    // The second frame an hour after the first: the player sleeps as long, in a call that nothing can end.
    let folder = recorded(&["1.000000", "3601.000000"]);
    let mut running = start(&player, folder.path());
    running.wait_for_frames(1);
    let lines = running.stop();
    assert_eq!(of(&lines, "ended"), ["ended delivered=1 lost=0 abandoned=1 error=None"]);
    assert_eq!(of(&lines, "state"), ["state Opened", "state Closed"]);
}
