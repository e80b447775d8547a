//! The empty room: learned at the start, and on an operator's order that a replay repeats.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::path::Path;

use tumbled::stream::StateLine;
use tumbled_core::estimate::{Mode, StateReason};

use crate::support::Workbench;
use crate::support::daemon::{Daemon, FREE_PORTS};
use crate::support::states::lines;

/// Somebody who stands in the region of interest for good, and a bus that is carried to a place before him.
const ROOM: &str = r#"
name = "room"
about = "a room in which somebody stands still, and a box bus that is carried there"
seed = 1
duration_s = 20.0
unix_ns_at_zero = 1_795_341_600_000_000_000
roi_center_m = [2.2, 0.0, 0.0]
roi_radius_m = 1.0
[target]
shape = "box_bus"
[motion]
kind = "poses"
rest_s = 1.7
move_s = 2.4
poses = [{ at_m = [2.2, 3.5, 0.0] }, { at_m = [2.2, 0.0, 0.0] }]
[room]
floor_m = [2.0, 0.0, -1.2]
size_m = [8.0, 9.0, 2.8]
[intruder]
points_m = [[2.8, 0.3, -1.2], [2.8, 2.3, -1.2]]
speed_mps = 0.5
begins_s = 900.0
[[lidar]]
id = "front"
model = "vlp-32c"
rpm = 600
clock = { offset_ns = 754_000_000_000, skew_ppm = 12.0 }
[[kinect]]
id = "near"
t_rig_kinect = { translation_m = [0.0, 0.3, 0.0], rotation_xyzw = [-0.5, 0.5, -0.5, 0.5] }
clock = { offset_ns = 31_000_000_000, skew_ppm = -25.0 }
"#;

#[test]
fn what_stands_in_an_empty_room_is_no_target_once_it_is_learned() {
    let bench = Workbench::new();
    bench.file("room.toml", ROOM);
    let done = bench.run(&["simulate", "room.toml", "-o", "sim", "--duration", "6400ms"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let replay = ["replay", "sim/capture.mcap", "--config", "sim/rig.toml", "-o", "-"];
    // Unlearned, whoever stands there is the target.
    let unlearned = lines(&bench.run(&replay).stdout);
    let early = |state: &&StateLine| (1_100_000_000..1_700_000_000).contains(&state.t_ns);
    assert!(unlearned.iter().filter(early).any(|state| state.mode != Mode::NoTarget), "nobody is seen");
    let start = ["--set", "target.background=start", "--set", "target.background_s=1"];
    let done = bench.run(&[&replay[..], &start].concat());
    assert!(done.stderr.contains("voxels of 5 cm is learned"), "{}", done.stderr);
    let learned = lines(&done.stdout);
    let first = learned.first().expect("states").t_ns;
    for state in &learned {
        let is_learning = state.t_ns < first + 1_000_000_000;
        assert_eq!(state.reasons.contains(&StateReason::Learning), is_learning, "at {} ns", state.t_ns);
        assert!(!is_learning || state.mode == Mode::NoTarget);
    }
    assert!(learned.iter().filter(early).all(|state| state.mode == Mode::NoTarget), "the room is taken for a target");
    let last = learned.last().expect("states");
    assert_eq!(last.mode, Mode::Tracking, "{:?}", last.reasons);
    assert!(last.spin.is_none());
}

/// One line to the control socket, and its answer.
fn ask(path: &Path, line: &[u8]) -> String {
    let mut socket = UnixStream::connect(path).expect("connects");
    socket.write_all(line).expect("sends");
    let mut answer = String::new();
    BufReader::new(socket).read_line(&mut answer).expect("an answer");
    answer
}

#[test]
fn an_order_stands_in_the_ledger_and_a_replay_repeats_it_to_the_bit() {
    let bench = Workbench::new();
    let socket = bench.path("control.sock");
    let control = format!("stream.control={}", socket.display());
    let run = ["run", "--sim", "demo", "--json", "--min-free", "0", "--record", "run.mcap", "--set", &control];
    let mut daemon = Daemon::start(&bench, &[&run[..], &FREE_PORTS].concat());
    daemon.once_said("running");
    let mode = std::fs::metadata(&socket).expect("a socket").permissions().mode();
    assert_eq!(mode & 0o777, 0o660, "orders are for the owner and the group");
    for nonsense in [&b"hello\n"[..], b"{\"order\":\"fire\"}\n", &[b'x'; 9_000], b"\n"] {
        let answer = ask(&socket, nonsense);
        assert!(answer.starts_with("{\"class\":\"ERROR\""), "{answer}");
    }
    let connect = socket.to_str().expect("a path");
    let done = bench.run(&["ctl", "learn-background", "--lasts", "500ms", "--connect", connect]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    daemon.once_said("is learned");
    let done = bench.run(&["ctl", "forget-background", "--connect", connect, "--json"]);
    assert!(
        done.stdout.contains("\"order\":\"forget_background\"")
            || done.stdout.contains("\"order\": \"forget_background\""),
        "{}",
        done.stdout
    );
    daemon.once_said("is forgotten");
    assert_eq!(bench.run(&["ctl", "reset-filter", "--connect", connect]).code, 0);
    daemon.once_said("acquired anew");
    let refused = bench.run(&["ctl", "learn-background", "--lasts", "1ms", "--connect", connect]);
    assert!(refused.code == 1 && refused.stderr.contains("0.1 to 600"), "{}", refused.stderr);
    daemon.signal("TERM");
    assert_eq!(daemon.finish().code, Some(0));
    assert!(!socket.exists(), "it goes with its daemon");
    let verified = bench.run(&["verify", "run.mcap"]);
    assert!(verified.code == 0 && verified.stdout.contains("match"), "{}{}", verified.stdout, verified.stderr);
    let all = lines(&bench.run(&["replay", "run.mcap", "-o", "-"]).stdout);
    assert!(all.iter().any(|state| state.reasons == [StateReason::Learning]));
}

#[test]
fn without_a_daemon_an_order_fails_with_a_remedy() {
    let bench = Workbench::new();
    let done = bench.run(&["ctl", "reset-filter", "--connect", "nobody.sock"]);
    assert_eq!(done.code, 1);
    assert!(done.stderr.contains("nobody.sock") && done.stderr.contains("tumbled run"), "{}", done.stderr);
}
