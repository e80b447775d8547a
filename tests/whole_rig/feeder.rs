//! The sensors of a scene in a process of their own, each at its real interface: the LiDAR by UDP, the Kinect's frames into the
//! feed of the libusb stand-in, the stage on a pseudo terminal.
//!
//! The process is this test binary once more, with [`child`]'s ignored test as its only one.

use std::ffi::OsString;
use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::net::SocketAddr;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::thread::JoinHandle;

use fake_libusb_control::FrameWriter;
use tumbled::session::live::unix_at_zero;
use tumbled::simulation::live::shortfall::ShortfallReport;
use tumbled::simulation::live::{SimulatedRig, Way};
use tumbled_io::live::{EventReceiver, Ledger, QueueBound, SessionClock, StopToken};
use tumbled_model::Body;

/// What its lines begin with: the test runner writes to the same stream.
pub(super) const MARK: &str = "feeder: ";
/// Where the Kinect's frames go: a FIFO.
pub(super) const KINECT: &str = "TUMBLED_FEEDER_KINECT";
/// The scene: a name or a file.
pub(super) const OF_SCENE: &str = "TUMBLED_FEEDER_SCENE";
/// What the stage's pseudo terminal is called, where the scene has one.
pub(super) const STAGE: &str = "TUMBLED_FEEDER_STAGE";

/// A feeder that runs, as its parent sees it.
pub(crate) struct Feeder {
    child: Child,
    lines: BufReader<ChildStdout>,
}

/// What a feeder did not send because this machine was too slow.
#[derive(Debug)]
pub(crate) struct Fed {
    pub(crate) left_out: ShortfallReport,
}

impl Feeder {
    /// Starts it on a scene, a name or a file, and waits until that is built.
    pub(crate) fn start(scene: &str, kinect: &Path, stage: &Path) -> Self {
        Self::spawn("whole_rig::feeder::child", scene, kinect, stage, &[])
    }

    /// Starts a test of this binary that sends, and waits until it can.
    pub(super) fn spawn(test: &str, scene: &str, kinect: &Path, stage: &Path, more: &[(&str, String)]) -> Self {
        let this = std::env::current_exe().expect("it has a path");
        // Sensors do not compete with the program for this machine's processors; where `nice` may not, it goes on without.
        let mut command = Command::new("nice");
        command.args(["-n", "-15"]).arg(this);
        command.args(["--ignored", "--exact", test, "--nocapture"]).envs(more.iter().cloned());
        command.env(OF_SCENE, scene).env(KINECT, kinect).env(STAGE, stage).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().expect("starts");
        let lines = BufReader::new(child.stdout.take().expect("piped"));
        let mut feeder = Self { child, lines };
        feeder.wait_for("ready");
        feeder
    }

    /// Lets it send: data and position packets to these sockets.
    pub(crate) fn begin(&mut self, data: SocketAddr, position: SocketAddr) {
        writeln!(self.child.stdin.as_mut().expect("piped"), "{data} {position}").expect("it listens");
    }

    /// Tells it to stop, and waits for its end.
    pub(crate) fn stop(self) -> Fed {
        Fed { left_out: serde_json::from_str(&self.stopped()).expect("a report") }
    }

    /// Tells it to stop; its last line.
    pub(super) fn stopped(mut self) -> String {
        drop(self.child.stdin.take());
        self.wait_for("{")
    }

    fn wait_for(&mut self, beginning: &str) -> String {
        let mut line = String::new();
        loop {
            line.clear();
            assert!(self.lines.read_line(&mut line).expect("reads") > 0, "the feeder ended");
            if let Some(own) = line.trim_end().strip_prefix(MARK).filter(|own| own.starts_with(beginning)) {
                return own.to_owned();
            }
        }
    }
}

impl Drop for Feeder {
    /// A test that fails leaves no feeder behind.
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

#[test]
#[ignore = "a part of the other tests"]
fn child() {
    let path = |name: &str| std::env::var_os(name).map(|value: OsString| PathBuf::from(value));
    let (Some(kinect), Some(stage), Ok(scene)) = (path(KINECT), path(STAGE), std::env::var(OF_SCENE)) else { return };
    let clock = SessionClock::start_on_system();
    let rig = SimulatedRig::load(&scene, None, unix_at_zero(&clock)).expect("a scene");
    println!("{MARK}ready");
    let mut orders = std::io::stdin().lines();
    let order = orders.next().expect("an order").expect("reads");
    let (data, position) = order.split_once(' ').expect("two addresses");
    let address = |text: &str| text.parse().expect("an address");
    let datagrams = Way::Datagrams { data: address(data), position: address(position) };

    // The Kinect's frames go through a ledger of their own: it is the way out of a scene that there is.
    let mut ledger = Ledger::live(clock.clone());
    let intake = ledger.intake("near".into(), QueueBound::KINECT_FRAMES);
    let frames = ledger.recorder();
    let ledger = ledger.start().expect("a thread");
    let writer = write_frames(frames, kinect);
    let stop = StopToken::new().expect("a descriptor");
    let ways = [("front".into(), datagrams), ("near".into(), Way::Intake(intake))];
    let scene = rig.start(ways.into_iter().collect(), &clock, &stop).expect("starts");
    if let Some(terminal) = scene.stage() {
        symlink(terminal, stage).expect("a new link");
    }
    // The end of the input is the order to stop.
    assert!(orders.next().is_none(), "there is no other order");
    stop.stop();
    let (left_out, _) = scene.join();
    ledger.stop();
    writer.join().expect("no panic");
    println!("{MARK}{}", serde_json::to_string(&left_out).expect("JSON"));
}

/// Each frame as it comes, until the frames end or nobody reads them any more.
fn write_frames(frames: EventReceiver, to: PathBuf) -> JoinHandle<()> {
    std::thread::spawn(move || {
        // Waits for the reader.
        let fifo = File::options().write(true).open(to).expect("the test made it");
        let mut writer = FrameWriter::new(fifo).expect("it is read");
        for event in frames {
            let Body::DepthFrame { ticks: Some(ticks), bytes, .. } = event.body else { continue };
            if writer.write(ticks.0, &bytes).is_err() {
                return;
            }
        }
    })
}
