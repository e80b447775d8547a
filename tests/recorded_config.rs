//! A recording is read with the config it was made with.

use std::fs;

use tumbled::cli::info::report::hdl64e::CalibrationSource;
use tumbled::cli::info::report::{ConfigOrigin, InfoReport};
use tumbled_io::recording::{AttachedFile, Recorder, RecorderOptions, RecordingHeader};

use crate::rig_files::{header, rig};
use crate::support::{Done, Workbench};

/// `drive.mcap`, imported with a config whose files are gone since.
fn moved() -> Workbench {
    let bench = rig();
    let done = bench.run(&["import", "drive.pcap", "-o", "drive.mcap", "--config", "rig/rig.toml"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    fs::remove_dir_all(bench.path("rig")).expect("removes the rig");
    bench
}

fn info(bench: &Workbench, arguments: &[&str]) -> InfoReport {
    let done = bench.run(&[&["info", "--json"], arguments].concat());
    assert_eq!((done.code, done.stderr.as_str()), (0, ""), "{}", done.stdout);
    done.json()
}

fn calibration(report: &InfoReport) -> CalibrationSource {
    let [lidar] = report.lidars.as_slice() else { panic!("one LiDAR") };
    lidar.hdl64e.as_ref().expect("an HDL-64E").calibration
}

fn recording(bench: &Workbench, name: &str, header: RecordingHeader) {
    let header = RecordingHeader { session: name.to_owned(), ..header };
    Recorder::create(&bench.path(name), header, RecorderOptions::default()).expect("a new file").finish();
}

fn refused(done: &Done, sentence: &str) {
    assert_eq!(done.code, 2, "{}", done.stderr);
    assert!(done.stderr.contains(sentence) && done.stderr.contains("--config FILE"), "{}", done.stderr);
}

#[test]
fn alone_it_is_decoded_with_its_own_config_and_files_wherever_it_is() {
    let bench = moved();
    let report = info(&bench, &["drive.mcap"]);
    assert_eq!((report.config.origin, report.config.path.as_deref()), (ConfigOrigin::Recorded, Some("drive.mcap")));
    assert_eq!((calibration(&report), report.lidars[0].data_packets), (CalibrationSource::File, 10));
    let export = |output: &str, more: &[&str]| {
        let arguments = ["export", "drive.mcap", "--what", "lidar-points", "--format", "csv", "-o", output];
        bench.run(&[&arguments[..], more].concat()).code
    };
    assert_eq!(export("own.csv", &[]), 0);
    assert!(bench.read("own.csv").lines().count() > 1_000);
}

#[test]
fn set_goes_on_top_and_config_in_its_place() {
    let bench = moved();
    let report = info(&bench, &["drive.mcap", "--set", "lidar.calibration="]);
    assert_eq!(report.config.settings, ["lidar.calibration="]);
    assert_eq!((report.config.origin, report.lidars[0].data_packets), (ConfigOrigin::Recorded, 0), "no calibration");
    bench.file("other.toml", "[rig]\nname = 'other'\n");
    let report = info(&bench, &["drive.mcap", "--config", "other.toml"]);
    assert_eq!((report.config.origin, report.config.path.as_deref()), (ConfigOrigin::File, Some("other.toml")));
    assert_eq!(report.lidars[0].data_packets, 0, "the other config has no calibration");
}

#[test]
fn a_file_that_set_names_is_this_machines() {
    let bench = moved();
    let done = bench.run(&["info", "drive.mcap", "--set", "kinect.near.depth_table=mine.csv"]);
    assert!(done.code == 2 && done.stderr.contains("the file mine.csv is not there"), "{}", done.stderr);
    bench.file("mine.csv", "raw11,depth_mm\n500,701\n");
    assert_eq!(bench.run(&["info", "drive.mcap", "--set", "kinect.near.depth_table=mine.csv"]).code, 0);
}

#[test]
fn with_other_inputs_the_built_in_config_holds() {
    let bench = moved();
    let report = info(&bench, &["drive.mcap", "drive.pcap"]);
    assert_eq!((report.config.origin, report.config.path), (ConfigOrigin::Default, None));
    recording(&bench, "other.mcap", header(&bench, "drive.mcap"));
    assert_eq!(info(&bench, &["drive.mcap", "other.mcap"]).config.origin, ConfigOrigin::Default, "two recordings");
    let bare = RecordingHeader { config: String::new(), files: Vec::new(), ..header(&bench, "drive.mcap") };
    recording(&bench, "bare.mcap", bare);
    assert_eq!(info(&bench, &["bare.mcap"]).config.origin, ConfigOrigin::Default, "none is attached");
}

#[test]
fn parts_of_one_recording_count_as_one() {
    let bench = moved();
    let header = header(&bench, "drive.mcap");
    let options = RecorderOptions { rotate_bytes: Some(1), ..RecorderOptions::default() };
    let mut recorder = Recorder::create(&bench.path("part.mcap"), header, options).expect("a new file");
    let tick = |seq| tumbled_model::Event { seq, arrived: tumbled_model::RigNs(0), body: tumbled_model::Body::Tick };
    recorder.write(&tick(0));
    recorder.write(&tick(1));
    assert_eq!(recorder.finish().parts.len(), 2);
    let report = info(&bench, &["part-0001.mcap", "part.mcap"]);
    assert_eq!(report.config.origin, ConfigOrigin::Recorded);
}

#[test]
fn a_calibration_is_not_laid_over_what_was_set_when_it_was_recorded() {
    let bench = rig(); // its calibration says 1.5 ms
    let recorded = ["import", "drive.pcap", "-o", "drive.mcap", "--config", "rig/rig.toml"];
    bench.run(&[&recorded[..], &["--set", "lidar.time_offset_ms=3.0"]].concat());
    let header = header(&bench, "drive.mcap");
    let load = |settings: &[String]| {
        let recorded = tumbled::config::Recorded { path: bench.path("drive.mcap"), header: header.clone() };
        tumbled::config::load_recorded(recorded, settings).expect("fine").config
    };
    let config = load(&[]);
    assert_eq!(config.lidars[0].time_offset, tumbled_model::Span(3_000_000));
    assert_eq!(config.attachments(), header.files, "and whoever records again carries the same files");
    let cal = bench.file("new.toml", "[lidar.front]\ntime_offset_ms = 9.0\n");
    let config = load(&[format!("rig.calibration={}", cal.display())]);
    assert_eq!(config.lidars[0].time_offset, tumbled_model::Span(9_000_000), "a new one is");
}

#[test]
fn a_recorded_config_that_cannot_be_used_is_refused_with_the_way_out() {
    let bench = moved();
    let good = header(&bench, "drive.mcap");
    let newer = RecordingHeader { config: format!("{}\n[novelty]\nx = 1\n", good.config), ..good.clone() };
    recording(&bench, "newer.mcap", newer);
    refused(&bench.run(&["info", "newer.mcap"]), "`novelty` is not a key of the config");
    bench.file("other.toml", "");
    assert_eq!(bench.run(&["info", "newer.mcap", "--config", "other.toml"]).code, 0);

    let damaged = RecordingHeader { config: String::new(), config_damaged: true, ..good.clone() };
    recording(&bench, "damaged.mcap", damaged);
    refused(&bench.run(&["info", "damaged.mcap"]), "the config recorded in damaged.mcap is damaged");

    let lost = |file: &AttachedFile| AttachedFile { content: None, ..file.clone() };
    let without = RecordingHeader { files: good.files.iter().map(lost).collect(), ..good };
    recording(&bench, "without.mcap", without);
    let done = bench.run(&["info", "without.mcap"]);
    refused(&done, "the copy of hdl64e.csv in without.mcap is damaged");
    assert!(done.stderr.contains("--set kinect.near.depth_table=FILE"), "{}", done.stderr);
}
