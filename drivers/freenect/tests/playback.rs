//! The driver on the player of recorded frames (fakenect), and on the real library without a device.
//!
//! Which library is loaded is decided when a program starts, so `kinect-dump` is run with the environment that decides it.

mod dump;

use dump::{Dumped, HEADER, digest, dump, player, real_frame};
use std::ffi::OsStr;
use std::fs;
use std::path::Path;

/// Plays a folder.
fn play(player: &Path, folder: Option<&Path>, arguments: &[&str]) -> Dumped {
    let mut environment: Vec<(&str, &OsStr)> = vec![("LD_LIBRARY_PATH", player.as_os_str())];
    environment.extend(folder.map(|folder| ("FAKENECT_PATH", folder.as_os_str())));
    dump(&environment, arguments)
}

fn frame_line(number: usize, ticks: u32, payload: &[u8]) -> String {
    format!("frame {number} ticks={ticks} encoding=Raw11 missing=0 lost=- bytes=614400 digest={}", digest(payload))
}

fn recorded(frames: &[(u32, Vec<u8>)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let mut index = String::new();
    for (ticks, payload) in frames {
        // All at one host time: played without a pause.
        let name = format!("d-1.000000-{ticks}.pgm");
        fs::write(folder.path().join(&name), [HEADER, payload].concat()).expect("a frame");
        index.push_str(&name);
        index.push('\n');
    }
    fs::write(folder.path().join("INDEX.txt"), index).expect("an index");
    folder
}

/// 307 200 codes of eleven bits, little-endian.
fn made(seed: u32) -> Vec<u8> {
    (0..307_200u32).flat_map(|pixel| (((pixel * 31 + seed * 977) % 2_048) as u16).to_le_bytes()).collect()
}

#[test]
fn recorded_frames_come_out_identical_and_their_end_is_no_error() {
    let Some(player) = player() else { return };
    // The stamps wrap between the second and the third.
    let frames: Vec<(u32, Vec<u8>)> =
        [4_290_967_296, 4_292_967_296, 0].into_iter().zip(0..).map(|(ticks, seed)| (ticks, made(seed))).collect();
    let played = play(&player, Some(recorded(&frames).path()), &[]);
    let mut expected = vec!["opened library=Fakenect serial=-".to_owned()];
    expected.extend(frames.iter().enumerate().map(|(n, (ticks, payload))| frame_line(n + 1, *ticks, payload)));
    expected.extend(["ended Played".to_owned(), "stopped Closed".to_owned()]);
    assert_eq!((played.lines, played.code), (expected, Some(0)));
}

#[test]
fn a_real_frame_comes_out_identical() {
    let (Some(payload), Some(player)) = (real_frame(), player()) else { return };
    let played = play(&player, Some(recorded(&[(123_456, payload.clone())]).path()), &[]);
    assert_eq!(played.lines.get(1), Some(&frame_line(1, 123_456, &payload)), "{played:?}");
}

#[test]
fn a_sink_that_has_enough_ends_the_stream() {
    let Some(player) = player() else { return };
    let folder = recorded(&[(1, made(1)), (2, made(2)), (3, made(3))]);
    let played = play(&player, Some(folder.path()), &["--frames", "2"]);
    assert_eq!(played.lines[2..], [frame_line(2, 2, &made(2)), "ended SinkClosed".into(), "stopped Closed".into()]);
}

#[test]
fn tilt_lamp_and_accelerometer_are_there_when_asked_for() {
    let Some(player) = player() else { return };
    let folder = recorded(&[(1, made(1))]);
    // A reading: x = 0, y = 819 counts = 1 g, z = 0; tilt 2 × 15 degrees; then three frames 0.3 s apart.
    let mut reading = [0u8; 12];
    reading[2..4].copy_from_slice(&819i16.to_le_bytes());
    reading[6] = 30;
    fs::write(folder.path().join("a-0.000000-0.dump"), reading).expect("a reading");
    let frames = ["d-0.000000-1.pgm", "d-0.300000-2.pgm", "d-0.600000-3.pgm"];
    for name in frames {
        fs::copy(folder.path().join("d-1.000000-1.pgm"), folder.path().join(name)).expect("a copy");
    }
    fs::write(folder.path().join("INDEX.txt"), format!("a-0.000000-0.dump\n{}\n", frames.join("\n")))
        .expect("an index");
    let played = play(&player, Some(folder.path()), &["--accelerometer", "--led", "green", "--tilt", "15"]);
    assert_eq!(played.said("acceleration"), "x=0.000 y=9.807 z=0.000 tilt=Some(15.0)", "{played:?}");
}

#[test]
fn a_missing_index_is_an_error_and_not_the_programs_end() {
    let Some(player) = player() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    for (frames, said) in [(Some(folder.path()), "INDEX.txt: No such file"), (None, "FAKENECT_PATH names no folder")] {
        let played = play(&player, frames, &[]);
        assert!(played.lines.len() == 1 && played.said("error").contains(said), "{played:?}");
    }
}

#[test]
fn without_a_kinect_the_real_library_finds_none() {
    let vendors = fs::read_dir("/sys/bus/usb/devices").into_iter().flatten().flatten();
    let mut vendors = vendors.filter_map(|device| fs::read_to_string(device.path().join("idVendor")).ok());
    if vendors.any(|vendor| vendor.trim() == "045e") {
        println!("skipped: a device of the Kinect's vendor is plugged in");
        return;
    }
    let nothing: &[(&str, &str)] = &[];
    let dumped = dump(nothing, &[]);
    // A machine whose kernel has no USB at all refuses the library's context already.
    let causes = ["no Kinect is on the USB", "libfreenect does not start"];
    assert!(causes.iter().any(|cause| dumped.said("error").contains(cause)), "{dumped:?}");
    assert_eq!((dumped.lines.len(), dumped.code), (1, Some(1)));
}
