//! Recordings that are ordered while a session runs, over the control socket and from the page.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tumbled::cli::replay::ReplayReport;
use tumbled::cli::run::RunReport;
use tumbled::cli::verify::{Verdict, VerifyReport};
use tumbled::session::Checkpoint;
use tumbled_io::recording::{Reader, Recorder, RecorderOptions};
use tumbled_model::Body;

use crate::support::Workbench;
use crate::support::daemon::{Daemon, packets, send};

const RIG: &str = "kinect = []\n[target]\nbackground = \"start\"\nbackground_s = 0.2\n[stream]\ntcp = \"127.0.0.1:0\"\n\
                   unix = \"\"\nfoxglove = \"\"\nhttp = \"127.0.0.1:0\"\ncontrol = \"control.sock\"\n";

fn running(bench: &Workbench, more: &[&str]) -> Daemon {
    bench.file("rig.toml", RIG);
    let run = ["run", "--config", "rig.toml", "--json", "--min-free", "0"];
    let mut daemon = Daemon::start(bench, &[&run[..], more].concat());
    daemon.once_said("running");
    daemon
}

/// Gives an order that is obeyed.
fn order(bench: &Workbench, words: &[&str]) -> Value {
    let done = bench.run(&[&["ctl", "--connect", "control.sock", "--json"], words].concat());
    assert_eq!(done.code, 0, "{words:?}: {}", done.stderr);
    done.json()
}

/// The answer to a request of the page, or of what pretends to be it: status and body.
fn ask(http: SocketAddr, method: &str, more: &str, body: &str) -> (u16, Value) {
    ask_for(http, &format!("{method} /api/control"), more, body)
}

fn ask_for(http: SocketAddr, what: &str, more: &str, body: &str) -> (u16, Value) {
    let mut stream = TcpStream::connect(http).expect("connects");
    stream.set_read_timeout(Some(Duration::from_secs(20))).expect("a timeout");
    let length = body.len();
    let head = format!("{what} HTTP/1.1\r\nHost: {http}\r\nConnection: close\r\nContent-Length: {length}");
    write!(stream, "{head}\r\n{more}\r\n{body}").expect("sends");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("an answer");
    let (head, body) = answer.split_once("\r\n\r\n").expect("a head");
    let status = head.split(' ').nth(1).and_then(|status| status.parse().ok()).expect("a status");
    (status, serde_json::from_str(body).unwrap_or_else(|_no_json| json!(body)))
}

const JSON: &str = "Content-Type: application/json\r\n";

fn verified(bench: &Workbench, file: &str) -> VerifyReport {
    let done = bench.run(&["verify", file, "--json"]);
    assert_eq!(done.code, 0, "{}{}", done.stdout, done.stderr);
    let report: VerifyReport = done.json();
    assert_eq!(report.verdict, Verdict::Match);
    report
}

/// The same recording with one bit of one packet turned.
fn falsify(file: &Path, to: &Path) {
    let mut reader = Reader::open(&[file]).expect("a recording");
    let options = RecorderOptions::default();
    let mut recorder = Recorder::create(to, reader.header().clone(), options).expect("a recording");
    let kind = Checkpoint::kind();
    let mut packets = 0;
    while let Some(event) = reader.next() {
        for result in reader.take_results() {
            recorder.write_result(&kind, result.t, result.seq, &result.json);
        }
        let mut event = event.expect("an event");
        if let Body::LidarPacket { bytes, .. } = &mut event.body {
            packets += 1;
            if packets == 100 {
                let mut turned = bytes.to_vec();
                turned[500] ^= 1;
                *bytes = turned.into();
            }
        }
        recorder.write(&event);
    }
    for result in reader.take_results() {
        recorder.write_result(&kind, result.t, result.seq, &result.json);
    }
    assert!(recorder.finish().stopped.is_none() && packets >= 100);
}

#[test]
fn a_recording_begun_in_mid_session_and_a_snapshot_replay_and_verify_from_their_own_start() {
    let bench = Workbench::new();
    let said = ["--name", "spin 7", "--operator", "Ada", "--set", "record.pretrigger=1s"];
    let daemon = running(&bench, &said);
    send(&packets(6_000), daemon.data); // more than a second: the ring has let go of the beginning
    let snapshot = order(&bench, &["snapshot", "past.mcap"]);
    let covers_s = snapshot["recording"]["covers_s"].as_f64().expect("s");
    assert!((0.8..1.2).contains(&covers_s), "{snapshot}");
    order(&bench, &["record", "start", "mid.mcap"]);
    let twice = bench.run(&["ctl", "record", "start", "--connect", "control.sock"]);
    assert!(twice.code == 1 && twice.stderr.contains("mid.mcap is being recorded already"), "{}", twice.stderr);
    order(&bench, &["note", "lamp off"]);
    send(&packets(6_000), daemon.data);
    let stopped = order(&bench, &["record", "stop"]);
    assert!(stopped["recording"]["events"].as_u64().is_some_and(|events| events > 5_000), "{stopped}");
    for (file, part) in [
        ("past.mcap", "past.mcap"),
        ("/tmp/away.mcap", "no file name"),
        ("../away.mcap", "no file name"),
        ("away.txt", "no file name"),
    ] {
        let refused = bench.run(&["ctl", "record", "start", file, "--connect", "control.sock"]);
        assert!(refused.code == 1 && refused.stderr.contains(part), "{file}: {}", refused.stderr);
    }
    assert_eq!(bench.run(&["ctl", "record", "stop", "--connect", "control.sock"]).code, 1, "nothing is recorded");
    daemon.signal("TERM");
    let ended = daemon.finish();
    let report: RunReport = serde_json::from_str(&ended.report).expect("a report");
    assert!(report.complete && report.recording == [std::path::PathBuf::from("mid.mcap")], "{ended:?}");

    for file in ["past.mcap", "mid.mcap"] {
        let report = verified(&bench, file);
        assert!(report.checkpoints >= 1 && report.checkpoints_of_events == report.checkpoints, "{report:?}");
        assert!(report.complete && report.epochs > 5, "{report:?}");
        let replay: ReplayReport = bench.run(&["replay", file, "--json"]).json();
        assert_eq!(replay.digest, report.digest, "it is the same whenever it is computed");
        assert_eq!(replay.sensors[0].lost.total, 0);
        let info = bench.run(&["info", file, "--html", "info.html"]);
        let page = bench.read("info.html");
        for part in ["spin 7", "Channels", "/lidar/front/packets", "could be read"] {
            assert!(page.contains(part) && !page.contains("http"), "{part}");
        }
        assert!(info.stdout.contains("name: spin 7") && info.stdout.contains("operator: Ada"), "{}", info.stdout);
        assert!(info.stdout.contains("background") && info.stdout.contains("begun_at_s"), "{}", info.stdout);
    }
    falsify(&bench.path("mid.mcap"), &bench.path("false.mcap"));
    let found = bench.run(&["verify", "false.mcap"]);
    assert!(found.code == 1 && found.stdout.contains("different: ledger"), "{}{}", found.stdout, found.stderr);
    let changed = bench.run(&["replay", "mid.mcap", "--record", "whole.mcap"]);
    assert_eq!(changed.code, 0, "{}", changed.stderr);
    let whole = verified(&bench, "whole.mcap");
    assert_eq!(whole.checkpoints_of_events, 0, "a replay's recording has checkpoints of everything");
}

#[test]
fn the_page_orders_where_the_config_allows_it_and_only_from_itself() {
    let bench = Workbench::new();
    let shut = running(&bench, &[]);
    let http = shut.http.expect("a page");
    let (status, said) = ask(http, "GET", "", "");
    assert_eq!((status, &said["allowed"], &said["orders"]), (200, &json!(false), &json!([])));
    let (status, said) = ask(http, "POST", JSON, "{\"order\":\"reset_filter\"}");
    assert!(status == 403 && said["message"].as_str().is_some_and(|text| text.contains("http_control")), "{said}");
    shut.signal("TERM");
    shut.finish();

    let limits = ["--set", "limits.lost_share=1", "--set", "limits.latency_p99_ms=0"];
    let open = running(&bench, &[&["--set", "stream.http_control=true"][..], &limits].concat());
    let http = open.http.expect("a page");
    let (_, said) = ask(http, "GET", "", "");
    assert_eq!((&said["allowed"], &said["recording"]), (&json!(true), &Value::Null));
    assert!(said["orders"].as_array().is_some_and(|orders| orders.contains(&json!("record_start"))), "{said}");
    let (status, said) = ask(http, "POST", JSON, "{\"order\":\"record_start\",\"file\":\"page.mcap\"}");
    assert_eq!((status, &said["class"], &said["recording"]["file"]), (200, &json!("DONE"), &json!("page.mcap")));
    let (_, said) = ask(http, "GET", "", "");
    assert_eq!(said["recording"]["file"], "page.mcap");
    for (more, body, status) in [
        (JSON, "{\"order\":\"fire\"}", 400),
        ("", "{\"order\":\"reset_filter\"}", 415),
        ("Content-Type: application/json\r\nOrigin: http://evil.example\r\n", "{\"order\":\"reset_filter\"}", 403),
        (JSON, &"x".repeat(9_000), 413),
    ] {
        assert_eq!(ask(http, "POST", more, body).0, status, "{more}{body:.40}");
    }
    let (status, said) = ask(http, "POST", JSON, "{\"order\":\"record_stop\"}");
    assert!(status == 200 && said["recording"]["bytes"].as_u64().is_some_and(|bytes| bytes > 0), "{said}");
    // Not faster than the sensor sends: what is ahead of its clock has no latency.
    for packets in packets(1_200).chunks(12) {
        send(packets, open.data);
        std::thread::sleep(Duration::from_millis(7));
    }
    let began = Instant::now();
    while ask_for(http, "GET /api/state", "", "").0 != 200 {
        assert!(began.elapsed() < Duration::from_secs(20), "no epoch came");
        std::thread::sleep(Duration::from_millis(50));
    }
    open.signal("TERM");
    let ended = open.finish();
    let report: RunReport = serde_json::from_str(&ended.report).expect("a report");
    assert!(report.latency_p99_ms.is_some_and(|ms| ms > 0.0), "{report:?}");
    let kept: Vec<(&str, bool)> = report.limits.iter().map(|check| (check.limit.as_str(), check.kept)).collect();
    assert_eq!((ended.code, kept), (Some(3), vec![("lost_share", true), ("latency_p99_ms", false)]));
}
