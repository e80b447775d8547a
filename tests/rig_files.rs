//! The files a config names travel with the recordings made with it.

use bytes::Bytes;
use tumbled::cli::diff::DiffReport;
use tumbled_io::recording::{AttachedFile, Reader, RecordingHeader};

use crate::support::{Workbench, repository};

/// A rig with every kind of file, and a capture of an HDL-64E S2 beside it.
pub(crate) fn rig() -> Workbench {
    let bench = Workbench::new();
    let captures = repository().join("tests/captures");
    let copy = |from: &str, to: &str| bench.file(to, std::fs::read(captures.join(from)).expect("a capture"));
    copy("hdl64e-s2-600rpm.pcap", "drive.pcap");
    copy("hdl64e-made.csv", "rig/db/hdl64e.csv");
    bench.file("rig/depth.csv", TABLE);
    bench.file("rig/cal.toml", CALIBRATION);
    bench.file(
        "rig/rig.toml",
        "[rig]\ncalibration = 'cal.toml'\n[[lidar]]\ncalibration = 'db/hdl64e.csv'\n[[kinect]]\ndepth_table = 'depth.csv'\n",
    );
    bench
}

const CALIBRATION: &str = "[lidar.front]\ntime_offset_ms = 1.5\n";
const TABLE: &str = "raw11,depth_mm\n500,700\n600,900\n";

pub(crate) fn header(bench: &Workbench, name: &str) -> RecordingHeader {
    Reader::open(&[bench.path(name)]).expect("a recording").header().clone()
}

fn expected() -> [AttachedFile; 3] {
    let calibration = std::fs::read(repository().join("tests/captures/hdl64e-made.csv")).expect("a capture");
    [
        AttachedFile::new("rig.calibration", "cal.toml", Bytes::from_static(CALIBRATION.as_bytes())),
        AttachedFile::new("lidar.front.calibration", "hdl64e.csv", calibration.into()),
        AttachedFile::new("kinect.near.depth_table", "depth.csv", Bytes::from_static(TABLE.as_bytes())),
    ]
}

#[test]
fn an_import_carries_every_file_of_its_config() {
    let bench = rig();
    let done = bench.run(&["import", "drive.pcap", "-o", "drive.mcap", "--config", "rig/rig.toml"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert_eq!(header(&bench, "drive.mcap").files, expected());
}

#[test]
fn a_live_recording_carries_them_too() {
    let bench = rig();
    let ports = ["--set", "lidar.port=0", "--set", "lidar.position_port=0", "--min-free", "0", "--duration", "50ms"];
    let done = bench.run(&[&["record", "-o", "run.mcap", "--config", "rig/rig.toml"][..], &ports].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert_eq!(header(&bench, "run.mcap").files, expected());
}

#[test]
fn recovering_and_copying_keep_them() {
    let bench = rig();
    bench.run(&["import", "drive.pcap", "-o", "drive.mcap", "--config", "rig/rig.toml"]);
    let whole = bench.read_bytes("drive.mcap");
    bench.file("cut.mcap", &whole[..whole.len() - 40]);
    assert_eq!(bench.run(&["recover", "cut.mcap", "-o", "recovered.mcap"]).code, 3);
    assert_eq!(bench.run(&["import", "drive.mcap", "-o", "copy.mcap"]).code, 0);
    for name in ["recovered.mcap", "copy.mcap"] {
        assert_eq!(header(&bench, name).files, expected(), "{name}");
    }
    assert!(whole == bench.read_bytes("copy.mcap"), "a copy is a copy");
}

#[test]
fn files_that_are_not_used_do_not_travel() {
    let bench = rig();
    let settings = ["--set", "lidar.model=vlp-16", "--set", "kinect.depth_table=", "--set", "rig.calibration="];
    let arguments = ["import", "drive.pcap", "-o", "drive.mcap", "--config", "rig/rig.toml"];
    bench.run(&[&arguments[..], &settings].concat());
    assert_eq!(header(&bench, "drive.mcap").files, []);
}

#[test]
fn another_file_makes_another_session_and_diff_names_it() {
    let bench = rig();
    let import = |output| bench.run(&["import", "drive.pcap", "-o", output, "--config", "rig/rig.toml"]).code;
    assert_eq!(import("a.mcap"), 0);
    bench.file("rig/depth.csv", "raw11,depth_mm\n500,701\n600,900\n");
    assert_eq!(import("b.mcap"), 0);
    let report: DiffReport = bench.run(&["diff", "a.mcap", "b.mcap", "--json"]).json();
    let fields: Vec<_> = report.header.iter().map(|difference| difference.field.as_str()).collect();
    assert_eq!((report.equal, fields), (true, vec!["session", "files"]));
}

#[test]
fn a_file_too_large_for_a_recording_is_refused_with_the_config() {
    let bench = rig();
    bench.file("rig/depth.csv", vec![b'#'; (4 << 20) + 1]);
    let done = bench.run(&["config", "check", "rig/rig.toml"]);
    assert!(done.code == 2 && done.stderr.contains("depth.csv has more than 4194304 bytes"), "{}", done.stderr);
}
