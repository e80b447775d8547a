//! A `tumbled` on the real libfreenect, with a stand-in for libusb under it that has a Kinect by script.

use std::fs::File;
use std::io::{BufRead, BufReader, BufWriter, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use fake_libusb_control::{Control, FrameWriter, Standin};
use serde_json::Value;
use tumbled_kinect::{RawDisparity, RawImage, encode_raw};
use tumbled_model::DepthEncoding;

use super::daemon::{Daemon, Ended};
use super::{Done, Workbench, rig};

/// So long is waited for what has to happen; a machine that is busy may take its time.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);
/// From frame to frame.
const FRAME_TICKS: u32 = 2_000_000;
/// Different frames, sent in turn.
pub(crate) const FRAMES: usize = 3;

/// A rig of a LiDAR and a Kinect that serves on free ports.
pub(crate) const RIG: &str = "[[lidar]]\nid = \"front\"\n[[kinect]]\nid = \"near\"\n[stream]\ntcp = \"127.0.0.1:0\"\n\
                              unix = \"\"\nfoxglove = \"\"\n[record]\nmin_free = \"\"\n";

/// A stand-in in a workbench: no device is there before something runs under it.
pub(crate) struct Usb {
    pub(crate) bench: Workbench,
    pub(crate) standin: Standin,
}

impl Usb {
    /// One Kinect that sends three frames in turn; `script` follows its lines.
    pub(crate) fn new(script: &str) -> Self {
        let bench = Workbench::new();
        let file = File::create(bench.path("usb.frames")).expect("a file");
        let mut writer = FrameWriter::new(BufWriter::new(file)).expect("writes");
        for n in 0..FRAMES {
            writer.write((n as u32 + 1) * FRAME_TICKS, &sent(n)).expect("writes");
        }
        writer.finish().expect("flushes");
        Self::with(bench, &format!("kinect 1414 serial A1 port 1\nframes usb.frames\n{script}"))
    }

    /// By a script of its own.
    pub(crate) fn with(bench: Workbench, script: &str) -> Self {
        bench.file("rig.toml", RIG);
        let standin = Standin::new(&bench.path("."), script).expect("the stand-in builds");
        Self { bench, standin }
    }

    /// Runs a command to its end.
    pub(crate) fn run(&self, arguments: &[&str]) -> Done {
        let mut command = self.bench.command();
        let output = command.envs(self.standin.environment()).args(arguments).output().expect("tumbled runs");
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("UTF-8");
        Done { code: output.status.code().unwrap_or(-1), stdout: text(output.stdout), stderr: text(output.stderr) }
    }

    /// Starts `tumbled run` with a recording.
    pub(crate) fn start(&self, more: &[&str]) -> Running<'_> {
        let arguments = [&["run", "--config", "rig.toml", "--json", "--record", "run.mcap"], more].concat();
        let daemon = Daemon::start_in(&self.bench, &self.standin.environment(), &arguments);
        let lines = lines(daemon.stream.expect("a stream"));
        Running { usb: self, daemon, lines }
    }
}

/// Rows of a frame in which every pixel has a depth; below them none has, so that a busy machine has little to compute.
pub(crate) const ROWS: usize = 60;

/// Frame `n` of those sent in turn: no two that follow each other are the same.
pub(crate) fn sent(n: usize) -> Vec<u8> {
    let depth = |u, v| RawDisparity((500 + (u * 7 + v * 3 + n * 11) % 400) as u16);
    let image = RawImage::from_fn(|u, v| if v < ROWS { depth(u, v) } else { RawDisparity::NO_DATA });
    encode_raw(&image, DepthEncoding::Packed11).expect("eleven bits")
}

/// What a client is told, each line with its instant, read as it comes.
fn lines(stream: SocketAddr) -> Receiver<(Instant, Value)> {
    let mut client = TcpStream::connect(stream).expect("connects");
    client.write_all(b"{\"subscribe\":[\"HEALTH\",\"EVENT\"]}\n").expect("sends");
    let (told, lines) = channel();
    std::thread::spawn(move || {
        for line in BufReader::new(client).lines().map_while(Result::ok) {
            let Ok(line) = serde_json::from_str(&line) else { return };
            if told.send((Instant::now(), line)).is_err() {
                return;
            }
        }
    });
    lines
}

/// A daemon under the stand-in, and what it tells.
pub(crate) struct Running<'a> {
    usb: &'a Usb,
    pub(crate) daemon: Daemon,
    lines: Receiver<(Instant, Value)>,
}

impl Running<'_> {
    /// The strings that the Kinect hangs on.
    pub(crate) fn control(&self) -> Control {
        self.usb.standin.connect(PATIENCE).expect("the stand-in is up")
    }

    /// Waits for a line of the stream; when it came.
    pub(crate) fn wait_for(&self, what: &str, is_it: impl Fn(&Value) -> bool) -> (Instant, Value) {
        let (until, mut last) = (Instant::now() + PATIENCE, Value::Null);
        loop {
            match self.lines.recv_timeout(until.saturating_duration_since(Instant::now())) {
                Ok((at, line)) if is_it(&line) => return (at, line),
                Ok((_, line)) => last = line,
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => panic!("no {what}; at last {last}"),
            }
        }
    }

    /// Waits for an event that says `text` of a sensor; when it came.
    pub(crate) fn wait_for_event(&self, text: &str) -> Instant {
        let says = |line: &Value| line["message"].as_str().is_some_and(|message| message.starts_with(text));
        self.wait_for(text, |line| line["class"] == "EVENT" && says(line)).0
    }

    /// Waits until health gives a reason that holds `text`, from the core or the shell.
    pub(crate) fn wait_for_reason(&self, text: &str) {
        let told = |part: &Value| {
            let reasons = part["reasons"].as_array().into_iter().flatten();
            reasons.filter_map(|reason| reason["message"].as_str()).any(|message| message.contains(text))
        };
        self.wait_for(text, |line| line["class"] == "HEALTH" && (told(&line["core"]) || told(&line["shell"])));
    }

    /// Ends it; how it ended, and how long that took.
    pub(crate) fn stop(self) -> (Ended, Duration) {
        let began = Instant::now();
        self.daemon.signal("TERM");
        let ended = self.daemon.finish();
        (ended, began.elapsed())
    }
}

/// A LiDAR that sends at the rig's rate until it is told to stop.
pub(crate) struct SendingLidar {
    stop: Arc<AtomicBool>,
    sent: Arc<AtomicU64>,
    thread: JoinHandle<()>,
}

impl SendingLidar {
    pub(crate) fn start(to: SocketAddr) -> Self {
        let (stop, sent) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicU64::new(0)));
        let (told, count) = (Arc::clone(&stop), Arc::clone(&sent));
        let thread = std::thread::spawn(move || {
            let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a socket");
            let began = Instant::now();
            for (n, packet) in (1u64..).zip(rig::packets()) {
                socket.send_to(&packet, to).expect("sends");
                count.store(n, Ordering::Relaxed);
                if told.load(Ordering::Relaxed) {
                    return;
                }
                let due = Duration::from_nanos(n * rig::PACKET_NS as u64);
                std::thread::sleep(due.saturating_sub(began.elapsed()));
            }
        });
        Self { stop, sent, thread }
    }

    /// Packets sent in all.
    pub(crate) fn stop(self) -> u64 {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().expect("no panic");
        self.sent.load(Ordering::Relaxed)
    }
}
