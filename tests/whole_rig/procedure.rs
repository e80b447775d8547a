//! The lab's procedure from nothing to a judged measurement, as docs/on-the-rig.md has it, on the sensors' real interfaces: UDP,
//! USB, a serial port. Run by `.ci/long rig`.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use serde_json::Value;
use tumbled::cli::verify::{Verdict, VerifyReport};
use tumbled::simulation::rig::{self, View};
use tumbled::simulation::scenes;

use super::SERVED;
use super::prepared;
use crate::support::daemon::{Daemon, Ended};
use crate::support::usb::Usb;
use crate::support::{Done, Workbench, repository};

/// The rates of the turning capture, and how far each way: less than docs/on-the-rig.md asks for, to end in minutes.
const TURNING: &str = "rates_dps = [10.0, 20.0, 40.0], turns = 2.2, rest_s = 2.0, ramp_s = 1.0";
/// How long that takes, s: two turns and some both ways at each rate, and the rests and ramps.
const TURNING_S: u64 = 315;

/// A lab: its folder, its devices, its config.
struct Lab {
    usb: Usb,
    feed: PathBuf,
    stage: PathBuf,
}

impl Lab {
    fn new() -> Self {
        let bench = Workbench::new();
        let (feed, stage) = (bench.path("kinect.feed"), bench.path("turntable"));
        assert!(Command::new("mkfifo").arg(&feed).status().expect("mkfifo runs").success());
        let scene = fs::read_to_string(repository().join("config/scenes/calibration-time.toml")).expect("a scene");
        let usual = "rates_dps = [5.0, 10.0, 20.0], turns = 2.2, rest_s = 2.0, ramp_s = 1.0";
        assert!(scene.contains(usual));
        bench.file("turning.toml", scene.replace(usual, TURNING));
        let loaded = scenes::load_with(bench.path("turning.toml").to_str().expect("a path"), None, None);
        let usb = Usb::with(bench, "kinect 1414 serial A1 port 1\nfeed kinect.feed");
        // What an operator measured with a ruler, and ports of this machine.
        let operators = rig::toml(&loaded.expect("a scene"), View::Operator);
        let config = operators.replace("/dev/rig/turntable", &stage.display().to_string());
        usb.bench.file("rig.toml", format!("{config}\n{SERVED}"));
        Self { usb, feed, stage }
    }

    /// A command on the lab's devices while a scene stands before them.
    fn session(&self, scene: &str, seconds: u64, arguments: &[&str]) -> Ended {
        let mut feeder = prepared::start(scene, seconds, &self.feed, &self.stage);
        let duration = format!("{seconds}s");
        let arguments = &[arguments, &["--duration", &duration, "--json"]].concat();
        let mut daemon = Daemon::start_in(&self.usb.bench, &self.usb.standin.environment(), arguments);
        daemon.once_said("receiving from a Kinect");
        feeder.begin(daemon.data, daemon.position);
        let ended = daemon.finish();
        println!("{scene}: {}", feeder.stopped());
        // The next scene brings another terminal.
        if self.stage.is_symlink() {
            fs::remove_file(&self.stage).expect("a link");
        }
        assert_eq!(ended.code, Some(0), "{ended:?}");
        ended
    }

    /// A command on files, which has to end well; its report.
    fn report(&self, arguments: &[&str]) -> Value {
        let done: Done = self.usb.bench.run(&[arguments, &["--json"]].concat());
        assert_eq!(done.code, 0, "{arguments:?}: {}{}", done.stdout, done.stderr);
        serde_json::from_str(&done.stdout).unwrap_or_else(|error| panic!("{error} in {}", done.stdout))
    }
}

#[test]
#[ignore = "half an hour in a release build: .ci/long rig"]
fn from_a_ruler_to_a_judged_measurement_by_the_procedure_of_the_documents() {
    let lab = Lab::new();
    let files = |names: &[&str]| names.iter().all(|name| lab.usb.bench.path(name).exists());

    // Where the sensors are: a board, shown to both.
    lab.session("calibration-board", 62, &["record", "--config", "rig.toml", "-o", "board.mcap"]);
    let board = ["calibrate", "extrinsic", "--config", "rig.toml", "--target", "board", "--board", "0.8x0.6"];
    let placed = lab
        .report(&[&board[..], &["--from", "board.mcap", "-o", "calibration.toml", "--report", "board.html"]].concat());
    println!("extrinsic: {} {}", placed["provenance"]["status"], placed["result"]);
    let depths = ["calibrate", "kinect", "--config", "rig.toml", "--board", "0.8x0.6", "--from", "board.mcap"];
    let lens = lab.report(&[&depths[..], &["-o", "calibration.toml", "--report", "kinect.html"]].concat());
    println!("kinect: {}", lens["provenance"]);
    let config = lab.usb.bench.read("rig.toml");
    let config = config.replacen("[rig]\n", "[rig]\ncalibration = \"calibration.toml\"\n", 1);
    assert!(config.contains("calibration.toml"), "{config}");
    lab.usb.bench.file("rig.toml", config);

    // Where the stage's axis is, and when the sensors measure: the target, turned both ways.
    let turning = lab.usb.bench.path("turning.toml").display().to_string();
    lab.session(&turning, TURNING_S, &["record", "--config", "rig.toml", "-o", "turning.mcap"]);
    let from = ["--config", "rig.toml", "--from", "turning.mcap", "-o", "calibration.toml", "--report"];
    let axis = lab.report(&[&["calibrate", "turntable"], &from[..], &["turntable.html"]].concat());
    println!("turntable: {}", axis["provenance"]);
    let times = lab.report(&[&["calibrate", "time", "--sensor", "near"], &from[..], &["time.html"]].concat());
    println!("time: {times}");

    // The measurement, its record, its judgement.
    let named = ["--name", "spin 12", "--operator", "AB", "--note", "after calibration"];
    let run = ["run", "--config", "rig.toml", "--record", "run.mcap"];
    let ended = lab.session("demo", 70, &[&run[..], &named].concat());
    let live: Value = serde_json::from_str(&ended.report).expect("JSON");
    assert_eq!(live["complete"], true, "{live}");
    let verified: VerifyReport = serde_json::from_value(lab.report(&["verify", "run.mcap"])).expect("a report");
    assert_eq!(verified.verdict, Verdict::Match);
    let judged = lab.report(&["evaluate", "run.mcap", "--truth", "turntable", "-o", "report"]);
    println!("evaluate: {}", judged["scored"]);
    let rate = &judged["scored"]["rate"];
    assert!(!judged["scored"].is_null(), "{judged} {rate}");
    for command in [
        &["info", "run.mcap", "--html", "info.html"][..],
        &["reconstruct", "run.mcap", "-o", "model"],
        &["target", "save", "run.mcap", "--name", "mockup", "-o", "mockup.target.ply"],
    ] {
        let done = lab.usb.bench.run(command);
        assert_eq!(done.code, 0, "{command:?}: {}", done.stderr);
        println!("{}", done.stdout);
    }
    assert!(files(&["board.html", "kinect.html", "turntable.html", "time.html", "report/report.html", "info.html"]));
}
