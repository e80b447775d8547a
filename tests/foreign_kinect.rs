//! Simulated frames through fakenect, libfreenect's player of recorded ones: what a program with a Kinect gets.
//!
//! Wants a C compiler and `libfreenect-dev`; without them the test prints that it was skipped.

use std::path::{Path, PathBuf};
use std::process::Command;

use tumbled_io::recording::Reader;
use tumbled_kinect::{RawImage, decode_raw};
use tumbled_model::Body;

use crate::support::{Workbench, repository};

/// The folder of fakenect's library, which has the name of the real one; `None`: not installed.
fn fakenect() -> Option<PathBuf> {
    let found = Command::new("cc").arg("-print-file-name=libfreenect.so").output().ok()?;
    let library = PathBuf::from(String::from_utf8(found.stdout).ok()?.trim());
    let folder = library.parent()?.join("fakenect");
    folder.join("libfreenect.so").exists().then_some(folder)
}

/// A program that plays a dump, linked with fakenect in the place of libfreenect.
fn player(bench: &Workbench, library: &Path) -> PathBuf {
    let program = bench.path("fakenect_dump");
    let done = Command::new("cc")
        .args(["-std=c99", "-Wall", "-Werror", "-o"])
        .arg(&program)
        .arg(repository().join("tests/foreign/fakenect_dump.c"))
        .arg(format!("-Wl,-rpath,{}", library.display()))
        .arg("-L")
        .arg(library)
        .arg("-lfreenect")
        .output()
        .expect("cc runs");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    program
}

#[test]
fn fakenect_plays_every_simulated_frame_with_its_stamp_unchanged() {
    let Some(library) = fakenect() else {
        println!("skipped: fakenect is not installed (libfreenect-dev)");
        return;
    };
    let bench = Workbench::new();
    let done = bench.run(&["simulate", "demo", "-o", "out", "--duration", "1500ms"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let frames = bench.path("frames.bin");
    let played =
        Command::new(player(&bench, &library)).arg(&frames).env("FAKENECT_PATH", bench.path("out/kinect")).output();
    let played = played.expect("the player runs");
    assert!(played.status.success(), "{played:?}");

    let mut expected = Vec::new();
    let (mut raw, mut count) = (RawImage::new(), 0);
    for event in Reader::open(&[bench.path("out/capture.mcap")]).expect("opens") {
        let Body::DepthFrame { ticks, encoding, bytes, lost_packets, .. } = event.expect("reads").body else {
            continue;
        };
        decode_raw(encoding, &bytes, &lost_packets, &mut raw).expect("a whole frame");
        expected.extend(ticks.expect("stamped").0.to_ne_bytes());
        expected.extend(raw.pixels().iter().flat_map(|code| code.0.to_ne_bytes()));
        count += 1;
    }
    // 30 a second, the first after half a period: 1.5 s of them.
    assert_eq!(count, 45);
    let handed_out = std::fs::read(&frames).expect("frames");
    assert_eq!(handed_out.len(), count * (4 + 2 * 640 * 480), "all of them, none twice");
    assert!(handed_out == expected, "a frame or its stamp has changed");
    println!("{count} frames and stamps through fakenect unchanged");
}
