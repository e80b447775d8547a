//! The process that has the Kinect: both what runs in it and what its parent sees of it.

use std::ffi::OsString;
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::{Duration, Instant};

use tumbled_io::live::{
    Device, KinectOpener, KinectUsbConfig, Ledger, Notice, QueueBound, SessionClock, StopToken, supervise,
};
use tumbled_model::{Body, Event};

/// What every line begins with: the test runner and the player of recorded frames write to the same stream.
const MARK: &str = "kinect: ";
/// How long a test waits for what must come: far beyond what it takes, so that only a defect runs into it.
const PATIENCE: Duration = Duration::from_secs(60);

/// Runs a Kinect into a ledger until it is over, a line an event; a line on the standard input stops it.
pub(crate) fn run() {
    let clock = SessionClock::start_on_system();
    let mut ledger = Ledger::live(clock.clone());
    let intake = ledger.intake("near".into(), QueueBound::KINECT_FRAMES);
    let events = ledger.recorder();
    let ledger = ledger.start().expect("a thread");
    let stop = StopToken::new().expect("a descriptor");
    let opener = KinectOpener::new(KinectUsbConfig::new("near".into(), ""), clock.clone(), stop.clone());
    let abandoned = opener.abandoned();
    let supervised = supervise(Box::new(opener), None, intake, clock, stop.clone(), KinectOpener::BACKOFF, notice)
        .expect("a thread");
    println!("{MARK}started");
    std::thread::spawn(move || {
        let mut line = String::new();
        // The end of the input is no order.
        if std::io::stdin().read_line(&mut line).is_ok_and(|length| length > 0) {
            stop.stop();
        }
    });
    let printed = std::thread::spawn(move || {
        while let Some(event) = events.recv() {
            print(&event);
        }
    });
    let ended = supervised.join();
    ledger.stop();
    printed.join().expect("no panic");
    let error = ended.error.map(|error| error.to_string());
    let (delivered, lost) = (ended.summary.delivered, ended.summary.lost_usb + ended.summary.lost_queue);
    println!("{MARK}ended delivered={delivered} lost={lost} abandoned={} error={error:?}", abandoned.total());
}

fn notice(notice: Notice) {
    match notice {
        Notice::Opened(info) => match info.device {
            Device::Kinect(kinect) => println!("{MARK}opened recorded={} serial={:?}", kinect.recorded, kinect.serial),
            other => println!("{MARK}opened {other:?}"),
        },
        Notice::Failed { error, .. } => println!("{MARK}failed {error}"),
        _ => {}
    }
}

fn print(event: &Event) {
    match &event.body {
        Body::DepthFrame { ticks, encoding, lost_packets, bytes, .. } => {
            let (ticks, lost) = (ticks.map_or(0, |ticks| ticks.0), lost_packets.count());
            println!("{MARK}frame {encoding:?} ticks={ticks} lost={lost} digest={}", digest(bytes));
        }
        Body::SensorState { state, .. } => println!("{MARK}state {state:?}"),
        Body::Gap { lost, place, .. } => println!("{MARK}gap {lost} {place:?}"),
        _ => {}
    }
}

/// FNV-1a, 64 bits.
pub(crate) fn digest(bytes: &[u8]) -> String {
    let hash = bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325u64, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3));
    format!("{hash:016x}")
}

/// A child that runs, as its parent sees it. Killed when it is dropped.
pub(crate) struct Running {
    child: Child,
    lines: Receiver<(Instant, String)>,
    /// Everything it has said so far.
    pub(crate) said: Vec<String>,
}

impl Running {
    pub(crate) fn start(environment: &[(OsString, OsString)]) -> Self {
        let mut child = Command::new(std::env::current_exe().expect("this binary"))
            .args(["child", "--exact", "--ignored", "--nocapture"])
            .envs(environment.iter().cloned())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("this binary runs");
        let output = BufReader::new(child.stdout.take().expect("piped"));
        let (tell, lines) = sync_channel(100_000);
        std::thread::spawn(move || {
            for line in output.lines().map_while(Result::ok) {
                // The runner's words may stand ahead of the first line, on the same one.
                if let Some((_, own)) = line.split_once(MARK)
                    && tell.send((Instant::now(), own.to_owned())).is_err()
                {
                    break;
                }
            }
        });
        Self { child, lines, said: Vec::new() }
    }

    pub(crate) fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Waits for a line that begins so; when it came, and the line.
    pub(crate) fn wait_for(&mut self, beginning: &str) -> (Instant, String) {
        loop {
            let Ok((at, line)) = self.lines.recv_timeout(PATIENCE) else {
                panic!("no line `{beginning}…` came after: {:#?}", self.said);
            };
            self.said.push(line.clone());
            if line.starts_with(beginning) {
                return (at, line);
            }
        }
    }

    /// Waits for so many frames.
    pub(crate) fn wait_for_frames(&mut self, count: usize) -> Instant {
        let mut last = Instant::now();
        for _ in 0..count {
            last = self.wait_for("frame ").0;
        }
        last
    }

    /// Forgets what it has said and is saying, up to now.
    pub(crate) fn forget(&mut self) {
        while self.lines.try_recv().is_ok() {}
        self.said.clear();
    }

    /// Tells it to stop, and waits for its end.
    pub(crate) fn stop(mut self) -> Vec<String> {
        self.child.stdin.as_mut().expect("piped").write_all(b"stop\n").expect("it listens");
        self.end()
    }

    /// Waits for its end; everything it said.
    pub(crate) fn end(mut self) -> Vec<String> {
        self.wait_for("ended ");
        let until = Instant::now() + PATIENCE;
        while Instant::now() < until {
            if let Some(status) = self.child.try_wait().expect("it is ours") {
                assert!(status.success(), "{:#?}", self.said);
                return std::mem::take(&mut self.said);
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        panic!("it does not end: {:#?}", self.said);
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // Of one that has ended there is nothing to kill, and nothing to wait for.
        if self.child.kill().is_ok() {
            assert!(self.child.wait().is_ok(), "a child that was killed ends");
        }
    }
}

/// The lines that begin with a word.
pub(crate) fn of<'a>(lines: &'a [String], word: &str) -> Vec<&'a str> {
    lines.iter().filter(|line| line.starts_with(word)).map(String::as_str).collect()
}
