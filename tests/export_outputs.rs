//! `tumbled export`: where it writes, and what it never writes to.

use std::fs;
use std::io::Read;
use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};
use std::process::{Command, Stdio};

use crate::export_cli::{PTS_RECORD, drive, dump, export, fine, partials, refused};
use crate::support::Workbench;

/// Refused as bad usage, and the file is what it was.
fn refused_and_kept(bench: &Workbench, kept: &str, arguments: [&str; 5], more: &[&str]) {
    let before = bench.read_bytes(kept);
    let [input, what, format, output, reason] = arguments;
    let done = export(bench, input, what, format, output, more);
    assert_eq!((done.code, done.stdout.as_str()), (2, ""), "{output}: {}", done.stderr);
    assert!(done.stderr.contains(reason), "{output}: {}", done.stderr);
    assert!(bench.read_bytes(kept) == before, "{output}: {kept} was changed");
    assert_eq!(partials(bench), 0);
}

#[test]
fn an_input_is_never_written_to_by_whatever_name() {
    let (bench, _) = drive(3);
    symlink("drive.pcap", bench.path("alias.pts")).expect("a link");
    fs::create_dir(bench.path("sub")).expect("a folder");
    symlink("..", bench.path("sub/up")).expect("a link");
    for output in ["drive.pcap", "./drive.pcap", "sub/../drive.pcap", "alias.pts", "sub/up/drive.pcap"] {
        let arguments = ["drive.pcap", "lidar-points", "pts", output, "is read by this export"];
        refused_and_kept(&bench, "drive.pcap", arguments, &[]);
    }
    bench.file("rig.toml", "[rig]\nname = 'mine'\n");
    let arguments = ["drive.pcap", "lidar-points", "pts", "rig.toml", "is read by this export"];
    refused_and_kept(&bench, "rig.toml", arguments, &["--config", "rig.toml"]);
    let arguments = ["drive.pcap", "lidar-points", "pts", "drive.pcap-wal", "is read by this export"];
    refused_and_kept(&bench, "drive.pcap", arguments, &[]);
}

#[test]
fn nothing_is_written_into_an_input_folder() {
    let bench = dump(2);
    let frames = || fs::read_dir(bench.path("dump")).expect("the dump").count();
    let before = frames();
    for output in ["dump", "dump/", "dump/new", "dump/new/deep"] {
        let reason = if output.starts_with("dump/new") { "lies in the input" } else { "is read by this export" };
        let arguments = ["dump", "kinect-depth", "png", output, reason];
        refused_and_kept(&bench, "dump/INDEX.txt", arguments, &[]);
    }
    assert_eq!(frames(), before);
    // One PNG as the input: its folder may be written to, but not the file itself.
    fine(&export(&bench, "dump", "kinect-depth", "png", "all", &[]));
    let arguments = ["all/frame-000000.png", "kinect-depth", "png", "all", "is read by this export"];
    refused_and_kept(&bench, "all/frame-000000.png", arguments, &[]);
}

#[test]
fn a_file_that_was_there_is_replaced_only_by_a_whole_one() {
    let (bench, points) = drive(3);
    bench.file("cloud.pts.partial", "mine");
    bench.file("cloud.pts", "old");
    fs::set_permissions(bench.path("cloud.pts"), fs::Permissions::from_mode(0o640)).expect("permissions");
    let done = export(&bench, "drive.pcap", "lidar-points", "pts", "cloud.pts", &["--frames", "7.."]);
    assert_eq!((done.code, bench.read("cloud.pts").as_str()), (2, "old"));
    fine(&export(&bench, "drive.pcap", "lidar-points", "pts", "cloud.pts", &[]));
    assert_eq!(bench.read_bytes("cloud.pts").len(), points * PTS_RECORD);
    let mode = |name: &str| fs::metadata(bench.path(name)).expect("there").permissions().mode() & 0o777;
    assert_eq!(mode("cloud.pts"), 0o640, "as before");
    assert_eq!(bench.read("cloud.pts.partial"), "mine", "no name is taken that somebody may have");
    // A new file is like any other that is made here.
    fine(&export(&bench, "drive.pcap", "lidar-points", "pts", "new.pts", &[]));
    assert_eq!(mode("new.pts"), mode("drive.pcap"));
}

#[test]
fn a_link_stays_and_what_it_names_is_written() {
    let (bench, points) = drive(3);
    fs::create_dir(bench.path("store")).expect("a folder");
    for name in ["there", "not-there"] {
        symlink(format!("store/{name}.pts"), bench.path(name)).expect("a link");
    }
    bench.file("store/there.pts", "old");
    for name in ["there", "not-there"] {
        fine(&export(&bench, "drive.pcap", "lidar-points", "pts", name, &[]));
        assert!(fs::symlink_metadata(bench.path(name)).expect("there").is_symlink(), "{name}");
        assert_eq!(bench.read_bytes(&format!("store/{name}.pts")).len(), points * PTS_RECORD);
    }
}

#[test]
fn a_device_is_written_to_and_stays_a_device() {
    let (bench, _) = drive(3);
    for format in ["pts", "csv", "ply", "pcd"] {
        fine(&export(&bench, "drive.pcap", "lidar-points", format, "/dev/null", &[]));
    }
    let null = fs::metadata("/dev/null").expect("there");
    assert!(null.file_type().is_char_device());
    let done = export(&bench, "drive.pcap", "lidar-points", "pts", "/dev/full", &[]);
    assert_eq!(done.code, 1, "{}", done.stderr);
    assert!(done.stderr.contains("cannot write /dev/full"), "{}", done.stderr);
}

#[test]
fn a_pipe_takes_text_and_records_and_no_format_with_a_count_in_its_header() {
    let (bench, points) = drive(3);
    // The standard output of these runs is a pipe.
    let done = export(&bench, "drive.pcap", "lidar-points", "csv", "/dev/stdout", &[]);
    fine(&done);
    assert_eq!(done.stdout.lines().count(), 1 + points, "points alone, the report is not among them");
    assert!(done.stderr.contains("3 packets"), "{}", done.stderr);
    for format in ["ply", "pcd"] {
        let done = export(&bench, "drive.pcap", "lidar-points", format, "/dev/stdout", &[]);
        refused(&bench, &done, "stdout", "--format csv or pts");
    }
}

#[test]
fn a_reader_of_the_points_that_leaves_is_no_failure() {
    let (bench, _) = drive(100); // 38 400 lines of CSV: more than a pipe holds
    let mut child = Command::new(assert_cmd::cargo::cargo_bin!("tumbled"))
        .args(["export", "drive.pcap", "--what", "lidar-points", "--format", "csv", "-o", "/dev/stdout"])
        .current_dir(bench.path("."))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("tumbled starts");
    let mut heading = [0; 6];
    child.stdout.take().expect("piped").read_exact(&mut heading).expect("the heading");
    let done = child.wait_with_output().expect("tumbled ends");
    assert_eq!((&heading, done.status.code()), (b"x,y,z,", Some(0)), "{}", String::from_utf8_lossy(&done.stderr));
}

#[test]
fn depth_frames_keep_their_host_times() {
    let bench = dump(3);
    fine(&export(&bench, "dump", "kinect-depth", "png", "depth", &["--frames", "1.."]));
    // The dump's names: a 30 Hz camera from 1 000 s on.
    assert_eq!(bench.read("depth/times.txt"), "1000.033333000\n1000.066666000\n");
    // So the folder has times to be merged by.
    let (drive, _) = drive(3);
    let drive = drive.path("drive.pcap");
    let done = bench.run(&["info", drive.to_str().expect("UTF-8"), "depth", "--json"]);
    let report: tumbled::cli::info::report::InfoReport = done.json();
    assert_eq!((done.code, report.kinects[0].frames, report.lidars[0].data_packets), (0, 2, 3));

    // Frames of another export in the same folder would be taken for frames of this one.
    let done = export(&bench, "dump", "kinect-depth", "png", "depth", &["--frames", "0"]);
    assert!(done.code == 0 && done.stderr.contains("holds 2 more .png files"), "{}", done.stderr);
}

#[test]
fn frames_without_times_get_none() {
    let bench = dump(2);
    fine(&export(&bench, "dump", "kinect-depth", "png", "depth", &[]));
    fs::remove_file(bench.path("depth/times.txt")).expect("there");
    fine(&export(&bench, "depth", "kinect-depth", "png", "again", &[]));
    assert!(!bench.path("again/times.txt").exists());
    bench.file("again/times.txt", "1\n2\n");
    let done = export(&bench, "depth", "kinect-depth", "png", "again", &[]);
    assert!(done.code == 0 && done.stderr.contains("is not of these frames"), "{}", done.stderr);
}

#[test]
fn a_name_that_is_no_utf8_is_reported_all_the_same() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    let (bench, _) = drive(3);
    let input = OsStr::from_bytes(b"dr\xffive.pcap");
    fs::rename(bench.path("drive.pcap"), bench.path(".").join(input)).expect("renamed");
    let exported = bench
        .command()
        .args(["export", "--what", "lidar-points", "--format", "pts", "--json", "-o"])
        .args([OsStr::from_bytes(b"p\xff.pts"), input])
        .output()
        .expect("tumbled runs");
    let report: serde_json::Value = serde_json::from_slice(&exported.stdout).expect("JSON");
    assert_eq!((exported.status.code(), report["files"][0].as_str()), (Some(0), Some("p\u{fffd}.pts")));
    let told = bench.command().args(["info", "--json"]).arg(input).output().expect("tumbled runs");
    let report: serde_json::Value = serde_json::from_slice(&told.stdout).expect("JSON");
    assert_eq!(report["inputs"][0]["path"].as_str(), Some("dr\u{fffd}ive.pcap"));
}
