//! The driver on the player of recorded frames (fakenect), and on the real library without a device.
//!
//! Which library is loaded is decided when a program starts, so `kinect-dump` is run with the environment that decides it.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The first line of every depth file.
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

fn dump(library: &Path, frames: Option<&Path>, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kinect-dump"));
    command.args(arguments).env("LD_LIBRARY_PATH", library).env_remove("FAKENECT_PATH");
    if let Some(frames) = frames {
        command.env("FAKENECT_PATH", frames);
    }
    command.output().expect("kinect-dump runs")
}

/// The lines of the dump itself: the player writes to the same stream.
fn lines(output: &Output) -> Vec<String> {
    let own = ["opened ", "frame ", "ended ", "stopped ", "error ", "warning ", "acceleration "];
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    text.lines().filter(|line| own.iter().any(|word| line.starts_with(word))).map(str::to_owned).collect()
}

/// FNV-1a, 64 bits, as the dump prints it.
fn digest(bytes: &[u8]) -> String {
    let hash = bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325u64, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3));
    format!("{hash:016x}")
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
    let folder = recorded(&frames);
    let output = dump(&player, Some(folder.path()), &[]);
    let mut expected = vec!["opened library=Fakenect serial=-".to_owned()];
    expected.extend(frames.iter().enumerate().map(|(n, (ticks, payload))| frame_line(n + 1, *ticks, payload)));
    expected.extend(["ended Played".to_owned(), "stopped Closed".to_owned()]);
    assert_eq!(lines(&output), expected);
    assert!(output.status.success());
}

#[test]
fn a_real_frame_comes_out_identical() {
    let real = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/kinect/raw11/nyu_raw11_le.pgm");
    let Ok(file) = fs::read(&real) else {
        println!("skipped: ../shared/data/kinect/raw11/nyu_raw11_le.pgm is not there");
        return;
    };
    let Some(player) = player() else { return };
    let payload = file.strip_prefix(HEADER).expect("its header").to_vec();
    let folder = recorded(&[(123_456, payload.clone())]);
    let output = dump(&player, Some(folder.path()), &[]);
    assert!(lines(&output).contains(&frame_line(1, 123_456, &payload)), "{output:?}");
}

#[test]
fn a_sink_that_has_enough_ends_the_stream() {
    let Some(player) = player() else { return };
    let folder = recorded(&[(1, made(1)), (2, made(2)), (3, made(3))]);
    let lines = lines(&dump(&player, Some(folder.path()), &["--frames", "2"]));
    assert_eq!(lines[2..], [frame_line(2, 2, &made(2)), "ended SinkClosed".to_owned(), "stopped Closed".to_owned()]);
}

#[test]
fn tilt_lamp_and_accelerometer_are_there_when_asked_for() {
    let Some(player) = player() else { return };
    let folder = recorded(&[(1, made(1))]);
    // A reading: x = 0, y = 819 counts = 1 g, z = 0; tilt 2 × 15 degrees; then a frame 0.3 s later.
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
    let lines = lines(&dump(&player, Some(folder.path()), &["--accelerometer", "--led", "green", "--tilt", "15"]));
    assert!(lines.contains(&"acceleration x=0.000 y=9.807 z=0.000 tilt=Some(15.0)".to_owned()), "{lines:?}");
}

#[test]
fn a_missing_index_is_an_error_and_not_the_programs_end() {
    let Some(player) = player() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    for (frames, said) in [(Some(folder.path()), "INDEX.txt: No such file"), (None, "FAKENECT_PATH names no folder")] {
        let output = dump(&player, frames, &[]);
        let lines = lines(&output);
        assert!(lines.len() == 1 && lines[0].starts_with("error ") && lines[0].contains(said), "{output:?}");
    }
}

#[test]
fn without_a_kinect_the_real_library_finds_none() {
    let kinects = fs::read_dir("/sys/bus/usb/devices").into_iter().flatten().flatten();
    if kinects
        .into_iter()
        .any(|device| fs::read_to_string(device.path().join("idVendor")).is_ok_and(|id| id.trim() == "045e"))
    {
        println!("skipped: a Microsoft device is plugged in");
        return;
    }
    let output = dump(Path::new(""), None, &[]);
    let lines = lines(&output);
    // A machine whose kernel has no USB at all refuses the library's context already.
    let causes = ["no Kinect is on the USB", "libfreenect does not start"];
    assert!(lines.len() == 1 && causes.iter().any(|cause| lines[0].contains(cause)), "{output:?}");
    assert_eq!(output.status.code(), Some(1));
}
