//! The whole rig at once: a VLP-32C over UDP, a Kinect on the USB (the real libfreenect over the stand-in for libusb) and a stage
//! on a pseudo terminal, each fed by another process, for as long as it takes. Run by `.ci/long rig`.

mod clients;
mod feeder;
mod prepared;
mod procedure;
mod watcher;

use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;
use std::process::{Child, Command};
use std::sync::Arc;
use std::time::Duration;

use fake_libusb_control::{FrameTruth, FrameWriter};
use tumbled::cli::replay::ReplayReport;
use tumbled::cli::run::RunReport;
use tumbled::simulation::rig::{self, View};
use tumbled::simulation::scenes;
use tumbled_core::ClockState;
use tumbled_core::turntable::TruthState;
use tumbled_io::recording::Reader;
use tumbled_model::{Body, RigNs};
use tumbled_sim::session::Simulation;

use crate::support::Workbench;
use crate::support::usb::Usb;
use feeder::Feeder;
use watcher::{Watcher, percentile};

/// What a config adds so that a daemon serves on free ports.
const SERVED: &str = "[stream]\ntcp = \"127.0.0.1:0\"\nunix = \"\"\nfoxglove = \"\"\n[record]\nmin_free = \"\"\n";
/// The scene that the sensors look at.
const SCENE: &str = "turntable-5dps";
/// Seconds of the whole rig; `RIG_SECONDS` in the environment says otherwise.
const SECONDS: u64 = 600;

/// What a recording says of losses.
#[derive(Debug, Default)]
struct Ledger {
    gaps: Vec<Body>,
    skips: u64,
    /// Of each depth frame: when it arrived, its stamp, its lost packets.
    frames: Vec<(RigNs, u32, u32)>,
}

impl Ledger {
    fn read(parts: &[PathBuf]) -> Self {
        let mut ledger = Self::default();
        for event in Reader::open(parts).expect("opens") {
            let event = event.expect("reads");
            match event.body {
                Body::Gap { .. } => ledger.gaps.push(event.body),
                Body::Skip { .. } => ledger.skips += 1,
                Body::DepthFrame { ticks: Some(ticks), lost_packets, .. } => {
                    ledger.frames.push((event.arrived, ticks.0, lost_packets.count()));
                }
                _ => {}
            }
        }
        ledger
    }
}

#[test]
#[ignore = "ten minutes in a release build: .ci/long rig"]
fn the_whole_rig_loses_nothing_and_its_replay_is_the_same() {
    let seconds = std::env::var("RIG_SECONDS").map_or(SECONDS, |text| text.parse().expect("a number of seconds"));
    let bench = Workbench::new();
    let (feed, stage) = (bench.path("kinect.feed"), bench.path("turntable"));
    assert!(Command::new("mkfifo").arg(&feed).status().expect("mkfifo runs").success());
    let mut feeder = Feeder::start(SCENE, &feed, &stage);
    let usb = Usb::with(bench, "kinect 1414 serial A1 port 1\nfeed kinect.feed");
    let scene = scenes::load_with(SCENE, None, None).expect("a scene");
    // What an operator would have, with ports of this machine.
    let operators = rig::toml(&scene, View::Operator).replace("/dev/rig/turntable", &stage.display().to_string());
    usb.bench.file("rig.toml", format!("{operators}\n{SERVED}"));
    let duration = format!("{seconds}s");
    let mut running = usb.start(&["--duration", &duration]);
    let watcher = Watcher::start(running.daemon.stream.expect("a stream"), running.daemon.id());
    running.daemon.once_said("receiving from a Kinect");
    feeder.begin(running.daemon.data, running.daemon.position);
    let ended = running.daemon.finish();
    let fed = feeder.stop();
    let seen = watcher.seen();

    let live: RunReport = serde_json::from_str(&ended.report).unwrap_or_else(|error| panic!("{error} in {ended:?}"));
    let ledger = Ledger::read(&parts(&usb, &live));
    let sensor = |id: &str| live.sensors.iter().find(|sensor| sensor.id == id).expect("it is in the config");
    let (front, near) = (sensor("front"), sensor("near"));
    println!(
        "{:.0} s: {} packets, {} frames ({:.3} a second), {} epochs; gaps {:?}, skips {}, frames with loss {}; the feeder \
         left out {:.2} s and {} items",
        live.duration_s,
        front.received,
        near.received,
        rate(&ledger.frames),
        live.checkpoint.epochs,
        ledger.gaps,
        ledger.skips,
        ledger.frames.iter().filter(|(_, _, lost)| *lost > 0).count(),
        fed.left_out.left_out_s,
        fed.left_out.late,
    );
    println!(
        "{} states of epochs, {} tracked, {} predicted; last byte to the line: {}; middle of the exposure or crossing to the \
         line p50 {:.1} ms, p99 {:.1} ms; {:.2} processors",
        seen.total_ms.len(),
        seen.tracked,
        seen.predicted,
        ["frames", "crossings"].iter().zip(&seen.after_last_byte_ms).map(in_words).collect::<Vec<_>>().join(", "),
        percentile(&seen.total_ms, 0.5),
        percentile(&seen.total_ms, 0.99),
        seen.processors.expect("it ran for more than five seconds"),
    );
    assert!(live.complete && ended.code == Some(0), "{ended:?}");
    // The client reads all that is said, and the target stands there all the time: at first it is acquired.
    assert!(seen.tracked as u64 * 100 > live.checkpoint.epochs * 95, "{} of {}", seen.tracked, live.checkpoint.epochs);
    assert!(seen.predicted as f64 > 80.0 * (live.duration_s - 5.0), "{}", seen.predicted);
    assert_eq!((ledger.gaps.len(), ledger.skips), (0, 0));
    assert!(ledger.frames.iter().all(|(_, _, lost)| *lost == 0));
    let sent = usb.standin.truth().expect("a truth file");
    let cut = |frame: &&FrameTruth| frame.sent == Some(frame.packets) && !frame.is_whole();
    assert_eq!(sent.frames(0).filter(cut).count(), 0);
    for sensor in [front, near] {
        assert_eq!(sensor.clock.expect("it has one").state, ClockState::Locked, "{sensor:?}");
        assert!(sensor.points.in_epochs > 0, "{sensor:?}");
    }
    let stage = sensor("turntable").turntable.as_ref().expect("a turntable");
    println!(
        "{} angles of the stage, half a round trip {:?} ns, refused {:?}, truth at the end {:?}",
        stage.samples, stage.half_rtt_ns, stage.refused, stage.truth
    );
    // 50 readings a second; of those that were held up somewhere no angle is made, nor of those of the stage's opening. The
    // port is closed before the Kinect is: the last angle may be stale then.
    assert!(stage.samples as f64 > 40.0 * (live.duration_s - 2.0), "{stage:?}");
    assert!(stage.truth != TruthState::Invalid && stage.invalid_since_ns.is_none(), "{stage:?}");
    let recorded: Vec<String> = parts(&usb, &live).iter().map(|part| part.display().to_string()).collect();
    let recorded: Vec<&str> = recorded.iter().map(String::as_str).collect();
    let done = usb.bench.run(&[&["replay"][..], &recorded, &["--json"]].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    let replay: ReplayReport = done.json();
    assert_eq!((replay.checkpoint, replay.digest), (live.checkpoint, live.digest));
}

/// Percentiles of what one sensor's states took.
fn in_words((what, ms): (&&str, &Vec<f64>)) -> String {
    let [half, most, all] = [0.5, 0.99, 1.0].map(|share| percentile(ms, share));
    format!("{what} p50 {half:.2} ms, p99 {most:.2} ms, largest {all:.2} ms")
}

/// The files of a session's recording.
fn parts(usb: &Usb, live: &RunReport) -> Vec<PathBuf> {
    live.recording.iter().map(|part| usb.bench.path(".").join(part)).collect()
}

/// Frames a second.
fn rate(frames: &[(RigNs, u32, u32)]) -> f64 {
    match frames {
        [(first, ..), .., (last, ..)] => (frames.len() - 1) as f64 / (*last - *first).as_secs_f64(),
        _ => 0.0,
    }
}

/// A process that does nothing but keep a processor busy; ended when dropped.
struct Busy(Child);

impl Busy {
    fn start() -> Self {
        Self(Command::new("sh").args(["-c", "while :; do :; done"]).spawn().expect("a shell"))
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        drop(self.0.kill());
        drop(self.0.wait());
    }
}

#[test]
#[ignore = "half a minute of real time: .ci/long rig"]
fn twenty_seconds_of_a_scene_come_from_the_usb_at_thirty_frames_a_second_beside_a_busy_process() {
    let bench = Workbench::new();
    let mut scene = scenes::load_with("demo", None, Some(Duration::from_secs(21))).expect("a scene");
    scene.lidars.clear();
    let file = File::create(bench.path("usb.frames")).expect("a file");
    let mut writer = FrameWriter::new(BufWriter::new(file)).expect("writes");
    let frames = Simulation::new(Arc::new(scene), None).filter_map(|item| match item.body {
        Body::DepthFrame { ticks: Some(ticks), bytes, .. } => Some((ticks.0, bytes)),
        _ => None,
    });
    for (ticks, bytes) in frames.take(600) {
        writer.write(ticks, &bytes).expect("writes");
    }
    writer.finish().expect("flushes");

    let _busy = Busy::start();
    let usb = Usb::with(bench, "kinect 1414 serial A1 port 1\nframes usb.frames once");
    let running = usb.start(&["--set", "lidar.port=0"]);
    let mut control = running.control();
    while control.status().expect("a status").frames < 600 {
        std::thread::sleep(Duration::from_millis(50));
    }
    std::thread::sleep(Duration::from_millis(100)); // the last is being sent
    let (ended, _) = running.stop();
    let live: RunReport = serde_json::from_str(&ended.report).unwrap_or_else(|error| panic!("{error} in {ended:?}"));
    let ledger = Ledger::read(&parts(&usb, &live));
    let (rate, damaged) = (rate(&ledger.frames), ledger.frames.iter().filter(|(_, _, lost)| *lost > 0).count());
    println!("{} frames at {rate:.3} a second, {damaged} with loss, gaps {:?}", ledger.frames.len(), ledger.gaps);
    assert_eq!((ledger.frames.len(), damaged, ledger.gaps.len()), (600, 0, 0));
    // The bus sends 30.0 a second whatever the host does: 599 intervals, each end late by a few milliseconds at most.
    assert!((rate - 30.0).abs() < 0.05, "{rate}");
}
