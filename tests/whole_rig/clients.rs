//! What clients cost: how late states are with one client, and with two more on TCP and one on the page's WebSocket besides, by turns.

use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpStream};
use std::process::Command;
use std::thread::JoinHandle;

use serde_json::Value;
use tumbled::simulation::rig::{self, View};
use tumbled::simulation::scenes;

use super::watcher::{Seen, Watcher, percentile};
use super::{SCENE, SERVED, prepared};
use crate::support::Workbench;
use crate::support::usb::Usb;

/// Runs with few clients and with all, by turns.
const PAIRS: usize = 4;
/// Each, s.
const SECONDS: u64 = 40;
/// What the clients on TCP ask for; the page is sent all there is.
const OF_CLIENT: &str = r#"{"subscribe":["STATE","HEALTH"]}"#;
/// Of Student's distribution with [`PAIRS`] - 1 degrees of freedom: 95 % lie within.
const STUDENT: f64 = 3.182;

#[test]
#[ignore = "eight minutes in a release build: .ci/long rig"]
fn three_clients_and_a_page_leave_the_states_as_soon_as_they_are() {
    let mut apart: [Vec<f64>; 2] = Default::default();
    for pair in 0..PAIRS {
        // The one that is first is second in the next pair.
        let order = if pair % 2 == 0 { [false, true] } else { [true, false] };
        let mut found = [[0.0; 2]; 2];
        for with_all in order {
            let seen = session(with_all);
            assert!(seen.tracked > 500, "{} states", seen.tracked);
            let late = [0, 1].map(|of| percentile(&seen.after_last_byte_ms[of], 0.99));
            println!(
                "{}: p99 of frames {:.2} ms, of crossings {:.2} ms",
                if with_all { "all" } else { "one" },
                late[0],
                late[1]
            );
            found[usize::from(with_all)] = late;
        }
        for (of, apart) in apart.iter_mut().enumerate() {
            apart.push(found[1][of] - found[0][of]);
        }
    }
    for (what, apart) in ["frames", "crossings"].iter().zip(&apart) {
        let count = apart.len() as f64;
        let mean = apart.iter().sum::<f64>() / count;
        let variance = apart.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>() / (count - 1.0);
        let half = STUDENT * (variance / count).sqrt();
        println!("{what}: last byte to the line, p99, all less one: {mean:+.2} ms, 95 % within {half:.2} ms of it");
    }
}

/// Forty seconds on the rig; what the one client saw that is always there.
fn session(with_all: bool) -> Seen {
    let bench = Workbench::new();
    let (feed, stage) = (bench.path("kinect.feed"), bench.path("turntable"));
    assert!(Command::new("mkfifo").arg(&feed).status().expect("mkfifo runs").success());
    let mut feeder = prepared::start(SCENE, SECONDS, &feed, &stage);
    let usb = Usb::with(bench, "kinect 1414 serial A1 port 1\nfeed kinect.feed");
    let scene = scenes::load_with(SCENE, None, None).expect("a scene");
    let operators = rig::toml(&scene, View::Operator).replace("/dev/rig/turntable", &stage.display().to_string());
    let served = SERVED.replacen("[stream]\n", "[stream]\nhttp = \"127.0.0.1:0\"\n", 1);
    usb.bench.file("rig.toml", format!("{operators}\n{served}"));
    let mut running = usb.start(&["--duration", &format!("{SECONDS}s")]);
    let (stream, page) = (running.daemon.stream.expect("a stream"), running.daemon.http.expect("a page"));
    let watcher = Watcher::start(stream, running.daemon.id());
    let mut others: Vec<JoinHandle<usize>> = Vec::new();
    if with_all {
        others.extend((0..2).map(|_| std::thread::spawn(move || on_tcp(stream))));
        others.push(std::thread::spawn(move || on_page(page)));
    }
    running.daemon.once_said("receiving from a Kinect");
    feeder.begin(running.daemon.data, running.daemon.position);
    let ended = running.daemon.finish();
    assert_eq!(ended.code, Some(0), "{ended:?}");
    feeder.stopped();
    for other in others {
        let lines = other.join().expect("no panic");
        assert!(lines > 1_000, "{lines} lines");
    }
    watcher.seen()
}

/// Reads until the daemon ends: how many lines it was told, none of them dropped.
fn on_tcp(stream: SocketAddr) -> usize {
    let mut client = TcpStream::connect(stream).expect("connects");
    writeln!(client, "{OF_CLIENT}").expect("sends");
    let lines = BufReader::new(client).lines().map_while(Result::ok);
    lines.inspect(|line| none_dropped(line)).count()
}

/// The same as the page does: it asks for nothing.
fn on_page(page: SocketAddr) -> usize {
    let (mut socket, _) = tungstenite::client(format!("ws://{page}/ws"), TcpStream::connect(page).expect("connects"))
        .expect("the page's WebSocket");
    let mut lines = 0;
    while let Ok(message) = socket.read() {
        lines += usize::from(message.is_text());
    }
    lines
}

fn none_dropped(line: &str) {
    let Ok(line) = serde_json::from_str::<Value>(line) else { return };
    let dropped = line["dropped"].as_u64().unwrap_or(0);
    assert_eq!(dropped, 0, "{line}");
}
