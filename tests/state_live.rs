//! The epoch lines of STATE: the same live and on replay, at any speed.

use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::time::Duration;

use serde_json::Value;

use crate::support::Workbench;
use crate::support::daemon::Daemon;
use crate::support::replaying::Replaying;

/// The line without what is told of its delivery to this client, and without where its data come from: a recording is
/// replayed.
fn identity(line: &Value) -> Value {
    let mut line = line.clone();
    let fields = line.as_object_mut().expect("an object");
    fields.retain(|key, _| !["delivery", "seq", "dropped", "origin"].contains(&key.as_str()));
    line
}

fn is_epoch(line: &Value) -> bool {
    line["class"] == "STATE" && line["kind"] == "epoch"
}

/// What `replay -o` writes of a recording.
fn replayed(bench: &Workbench, arguments: &[&str]) -> Vec<Value> {
    let done = bench.run(&[&["replay", "-o", "-"], arguments].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    let lines: Vec<Value> = done.stdout.lines().map(|line| serde_json::from_str(line).expect(line)).collect();
    assert!(lines.iter().all(|line| is_epoch(line) && line.get("delivery").is_none()));
    lines
}

/// Each line that a client was sent stands in the replay, under its number.
fn assert_same(live: &[Value], replay: &[Value], least: usize) {
    assert!(live.len() >= least, "{} lines came", live.len());
    for line in live {
        let number = line["epoch"].as_u64().expect("a number") as usize;
        assert_eq!(identity(line), identity(&replay[number]), "epoch {number}");
    }
}

#[test]
fn a_live_sessions_states_are_those_of_its_replay_and_it_verifies() {
    let bench = Workbench::new();
    let ports = ["stream.tcp=127.0.0.1:0", "stream.unix=", "stream.foxglove=", "stream.control="];
    let mut arguments = vec!["run", "--sim", "demo", "--json", "--min-free", "0", "--record", "run.mcap"];
    ports.iter().for_each(|port| arguments.extend(["--set", port]));
    let daemon = Daemon::start(&bench, &arguments);
    let mut client = TcpStream::connect(daemon.stream.expect("a stream")).expect("connects");
    client.set_read_timeout(Some(Duration::from_secs(60))).expect("a timeout");
    client.write_all(b"{\"subscribe\":[\"STATE\"]}\n").expect("sends");
    let lines = BufReader::new(client.try_clone().expect("another descriptor")).lines();
    let live = lines.map_while(Result::ok).map(|line| serde_json::from_str::<Value>(&line).expect("JSON"));
    let live: Vec<Value> = live.filter(is_epoch).take(80).collect();
    daemon.signal("TERM");
    assert_eq!(daemon.finish().code, Some(0));
    assert!(live.iter().any(|line| line["mode"] == "tracking"), "it came to tracking");
    assert_same(&live, &replayed(&bench, &["run.mcap"]), 80);
    let verified = bench.run(&["verify", "run.mcap"]);
    assert!(verified.code == 0 && verified.stdout.contains("match"), "{}{}", verified.stdout, verified.stderr);
}

#[test]
fn a_replay_tells_a_client_the_same_at_any_speed() {
    let bench = Workbench::new();
    let done = bench.run(&["simulate", "turntable-20dps", "-o", "sim", "--duration", "1500ms"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let recorded = ["sim/capture.mcap", "--config", "sim/rig.toml"];
    let all = replayed(&bench, &recorded);
    for speed in ["1", "4"] {
        let replaying = Replaying::start(&bench, &[&recorded[..], &["--speed", speed]].concat());
        let told: Vec<Value> = replaying.lines("STATE").filter(is_epoch).collect();
        assert_eq!(replaying.finish().0, Some(0));
        // The first may have gone by when the client had connected.
        assert_same(&told, &all, all.len() / 2);
    }
}
