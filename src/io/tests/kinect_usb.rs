//! A Kinect as a supervised source, on recorded frames: what goes into the ledger, and how it ends.
//!
//! Which USB library is loaded is decided when a program starts, so each test runs this binary again as a child, with the
//! environment that decides it. The child is the ignored test below; what it sees it prints, a line an event.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use tumbled_io::live::{
    Device, KinectOpener, KinectUsbConfig, Ledger, Notice, QueueBound, SessionClock, StopToken, supervise,
};
use tumbled_model::{Body, DepthEncoding, Event};

/// What every line of the child begins with: the test runner and the player of recorded frames write there too.
const MARK: &str = "kinect: ";
const HEADER: &[u8] = b"P5 640 480 65535\n";

/// Runs a Kinect into a ledger until the session closes it, printing; a line on the standard input stops it.
#[test]
#[ignore = "a part of the other tests"]
fn child() {
    let clock = SessionClock::start_on_system();
    let mut ledger = Ledger::live(clock.clone());
    let intake = ledger.intake("near".into(), QueueBound::KINECT_FRAMES);
    let events = ledger.recorder();
    let ledger = ledger.start().expect("a thread");
    let stop = StopToken::new().expect("a descriptor");
    let config = KinectUsbConfig::new("near".into(), "");
    let opener = KinectOpener::new(config, clock.clone(), stop.clone());
    let notice = |notice| match notice {
        Notice::Opened(info) => match info.device {
            Device::Kinect(kinect) => println!("{MARK}opened recorded={}", kinect.recorded),
            other => println!("{MARK}opened {other:?}"),
        },
        Notice::Failed { error, .. } => println!("{MARK}failed {error}"),
        _ => {}
    };
    let supervised = supervise(Box::new(opener), None, intake, clock, stop.clone(), KinectOpener::BACKOFF, notice)
        .expect("a thread");
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
    println!(
        "{MARK}ended delivered={} error={:?}",
        ended.summary.delivered,
        ended.error.map(|error| error.to_string())
    );
    ledger.stop();
    printed.join().expect("no panic");
}

fn print(event: &Event) {
    match &event.body {
        Body::DepthFrame { ticks, encoding, lost_packets, bytes, .. } => {
            let digest = digest(bytes);
            println!("{MARK}frame {ticks:?} {encoding:?} lost={} digest={digest:016x}", lost_packets.count());
        }
        Body::SensorState { state, .. } => println!("{MARK}state {state:?}"),
        Body::Gap { lost, place, .. } => println!("{MARK}gap {lost} {place:?}"),
        _ => {}
    }
}

/// FNV-1a, 64 bits.
fn digest(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}

fn player() -> Option<PathBuf> {
    let output = Command::new("pkg-config").args(["--variable=libdir", "libfreenect"]).output().ok()?;
    let folder = PathBuf::from(String::from_utf8(output.stdout).ok()?.trim()).join("fakenect");
    if folder.join("libfreenect.so.0.5").exists() {
        return Some(folder);
    }
    println!("skipped: no fakenect folder beside libfreenect");
    None
}

fn start(library: &Path, frames: &Path) -> Child {
    Command::new(std::env::current_exe().expect("this binary"))
        .args(["child", "--exact", "--ignored", "--nocapture"])
        .env("LD_LIBRARY_PATH", library)
        .env("FAKENECT_PATH", frames)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("this binary runs")
}

/// The child's own lines, to its end.
fn lines(child: &mut Child) -> Vec<String> {
    let output = BufReader::new(child.stdout.take().expect("piped"));
    // The runner's words may stand ahead of the first line, on the same one.
    let own = |line: String| line.split_once(MARK).map(|(_, own)| own.to_owned());
    let lines = output.lines().map_while(Result::ok).filter_map(own).collect();
    assert!(child.wait().expect("it ends").success());
    lines
}

fn recorded(host_times: &[&str]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let mut index = String::new();
    for (n, time) in (1u32..).zip(host_times) {
        let name = format!("d-{time}-{}.pgm", n * 2_000_000);
        fs::write(folder.path().join(&name), [HEADER, &made(n)].concat()).expect("a frame");
        index.push_str(&name);
        index.push('\n');
    }
    fs::write(folder.path().join("INDEX.txt"), index).expect("an index");
    folder
}

fn made(seed: u32) -> Vec<u8> {
    (0..307_200u32).flat_map(|pixel| (((pixel * 31 + seed * 977) % 2_048) as u16).to_le_bytes()).collect()
}

#[test]
fn recorded_frames_go_into_the_ledger_and_their_end_closes_the_source() {
    let Some(player) = player() else { return };
    let folder = recorded(&["1.000000", "1.000000", "1.020000"]);
    let lines = lines(&mut start(&player, folder.path()));
    let frame = |n: u32| {
        let (encoding, digest) = (DepthEncoding::Raw11, digest(&made(n)));
        format!("frame Some(KinectTicks({})) {encoding:?} lost=0 digest={digest:016x}", n * 2_000_000)
    };
    let of = |word: &str| lines.iter().filter(|line| line.starts_with(word)).cloned().collect::<Vec<_>>();
    assert_eq!(of("frame"), [frame(1), frame(2), frame(3)], "{lines:#?}");
    assert_eq!(of("state"), ["state Opened", "state Closed"]);
    assert_eq!(of("opened"), ["opened recorded=true"]);
    assert_eq!(of("ended"), ["ended delivered=3 error=None"]);
}

#[test]
fn a_folder_that_cannot_be_played_ends_the_source_with_the_cause() {
    let Some(player) = player() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let lines = lines(&mut start(&player, folder.path()));
    assert!(lines.iter().any(|line| line.starts_with("ended") && line.contains("INDEX.txt")), "{lines:#?}");
}

#[test]
fn a_stop_ends_it_though_the_library_sleeps() {
    let Some(player) = player() else { return };
    // The second frame an hour after the first: the player sleeps as long, in a call that nothing can end.
    let folder = recorded(&["1.000000", "3601.000000"]);
    let mut child = start(&player, folder.path());
    let mut output = BufReader::new(child.stdout.take().expect("piped"));
    let mut seen = String::new();
    while !seen.contains("frame") {
        assert!(output.read_line(&mut seen).expect("text") > 0, "{seen}");
    }
    std::thread::sleep(Duration::from_millis(100));
    std::io::Write::write_all(child.stdin.as_mut().expect("piped"), b"stop\n").expect("it listens");
    // It ends: an hour would be more than any test's patience.
    std::io::Read::read_to_string(&mut output, &mut seen).expect("text");
    assert!(child.wait().expect("it ends").success());
    assert!(seen.contains("state Closed") && seen.contains("ended delivered=1 error=None"), "{seen}");
}
