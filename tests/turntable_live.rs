//! `tumbled run`, `record` and `doctor` with a turntable on a serial port.

use serde_json::Value;
use tumbled::cli::replay::ReplayReport;
use tumbled::cli::run::RunReport;
use tumbled_core::turntable::TruthState;
use tumbled_io::live::{PseudoTerminal, SessionClock};
use tumbled_model::RigNs;
use tumbled_sim::turntable::StageFault;

use crate::support::Workbench;
use crate::support::daemon::FREE_PORTS;
use crate::support::stage::{Manners, Port, turning};

/// Where the LiDAR's packets would come.
const LIDAR_PORTS: [&str; 4] = ["--set", "lidar.port=0", "--set", "lidar.position_port=0"];

/// A rig with a turntable behind the bench's link.
fn rig(bench: &Workbench) {
    let port = bench.path("turntable");
    bench.file("rig.toml", format!("kinect = []\n[turntable]\nport = \"{}\"\n", port.display()));
}

#[test]
fn a_live_turntable_is_recorded_and_its_replay_is_the_same_to_the_bit() {
    let (bench, clock) = (Workbench::new(), SessionClock::start_on_system());
    rig(&bench);
    let faults = vec![StageFault::Stall { from: RigNs(5_000_000_000), until: RigNs(600_000_000_000) }];
    let mut port = Port::new(bench.path("turntable"), turning(20.0, faults), &clock);
    port.plug(Manners::default());
    let arguments = ["run", "--config", "rig.toml", "--record", "run.mcap", "--min-free", "0", "--duration", "8s"];
    let done = bench.run(&[&arguments[..], &["--json"], &FREE_PORTS, &LIDAR_PORTS].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert!(done.stderr.contains("device=1 axis=1"), "{}", done.stderr);
    let live: RunReport = done.json();
    let sensor = live.sensors.iter().find(|sensor| sensor.id == "turntable").expect("the turntable");
    let turntable = sensor.turntable.as_ref().expect("a turntable");
    assert!(turntable.samples > 100 && turntable.counts_per_turn == Some(768_000), "{turntable:?}");
    assert_eq!(turntable.truth, TruthState::Invalid, "it stalled for good: {turntable:?}");
    let source = live.sources.iter().find(|source| source.sensor == "turntable").expect("its source");
    assert!((source.packets, &source.error) == (sensor.received, &None), "{source:?}, {}", sensor.received);

    let replay: ReplayReport = bench.run(&["replay", "run.mcap", "--json"]).json();
    assert_eq!((replay.checkpoint, replay.digest), (live.checkpoint, live.digest));
    let again = replay.sensors.iter().find(|sensor| sensor.id == "turntable").expect("the turntable");
    assert_eq!(again.turntable, sensor.turntable);
}

#[test]
fn a_turntable_that_is_not_there_holds_up_neither_the_start_nor_the_end_and_the_log_says_what_to_do() {
    let bench = Workbench::new();
    rig(&bench);
    let done =
        bench.run(&[&["run", "--config", "rig.toml", "--duration", "1s"], &FREE_PORTS[..], &LIDAR_PORTS].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert!(
        done.stderr.contains("there is no serial port") && done.stderr.contains("tumbled devices"),
        "{}",
        done.stderr
    );
    let recorded =
        ["record", "--config", "rig.toml", "-o", "run.mcap", "--duration", "1s", "--min-free", "0", "--json"];
    let done = bench.run(&[&recorded[..], &LIDAR_PORTS].concat());
    let report: Value = done.json();
    let sensors: Vec<&str> =
        report["sources"].as_array().expect("sources").iter().filter_map(|source| source["sensor"].as_str()).collect();
    assert_eq!(sensors, ["front", "turntable"]);
}

#[test]
fn doctor_names_what_is_the_matter_with_the_port() {
    let bench = Workbench::new();
    let finding = |port: &str| {
        let set = format!("turntable.port={port}");
        let arguments = ["doctor", "--json", "--listen", "100ms", "--set", "lidar=[]", "--set", "kinect=[]", "--set"];
        let report: Value = bench.run(&[&arguments[..], &[&set]].concat()).json();
        let findings = report["findings"].as_array().expect("findings").clone();
        findings.into_iter().find(|finding| finding["check"] == "turntable").expect("the turntable")
    };
    let absent = finding("/dev/ttyUSB77");
    assert!(absent["level"] == "fail" && absent["remedy"].as_str().is_some_and(|text| text.contains("devices")));
    let number = finding("usb:NO-SUCH-NUMBER");
    assert!(number["message"].as_str().is_some_and(|text| text.contains("USB serial number")), "{number}");
    assert_eq!(number["subject"], "usb:NO-SUCH-NUMBER");
    let terminal = PseudoTerminal::open().expect("a pseudo terminal");
    // This test has it open.
    let held = finding(&terminal.path().display().to_string());
    assert!(
        held["level"] == "fail" && held["message"].as_str().is_some_and(|text| text.contains("in use by")),
        "{held}"
    );
}
