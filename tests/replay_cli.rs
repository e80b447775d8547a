//! `replay` and `verify` on the command line.

use std::time::{Duration, Instant};

use tumbled::cli::diff::DiffReport;
use tumbled::cli::replay::ReplayReport;
use tumbled::cli::verify::{Verdict, VerifyReport};
use tumbled::session::lines::EpochLine;
use tumbled_io::recording::{Origin, Reader};
use tumbled_model::Span;

use crate::support::Workbench;
use crate::support::daemon::{Daemon, packets, send};
use crate::support::pcap::{Datagram, write_pcap};
use crate::support::replaying::Replaying;
use crate::support::rig::{self, Rig};

/// A workbench with `made.mcap`: so many ms of a LiDAR and a Kinect that sees a small target.
fn bench(ms: i64) -> Workbench {
    let bench = Workbench::new();
    rig::record(Rig::new(80, 60), Span(ms * 1_000_000), &bench.path("made.mcap"));
    bench
}

fn replayed(bench: &Workbench, arguments: &[&str]) -> ReplayReport {
    let done = bench.run(&[&["replay", "--json"], arguments].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    done.json()
}

#[test]
fn one_digest_at_any_speed_and_on_any_number_of_threads() {
    let bench = bench(1_500);
    let digest = |arguments: &[&str]| {
        let done = bench.run(&[&["replay", "made.mcap", "--digest"], arguments].concat());
        assert_eq!(done.code, 0, "{}", done.stderr);
        done.stdout
    };
    let first = digest(&[]);
    assert_eq!(first.trim().len(), 32, "128 bits: {first}");
    for arguments in [["--speed", "1"], ["--speed", "4"], ["--threads", "1"], ["--threads", "2"], ["--threads", "4"]] {
        assert_eq!(digest(&arguments), first, "{arguments:?}");
    }
}

#[test]
fn epochs_are_told_line_by_line_and_hold_every_point() {
    let bench = bench(1_500);
    let report = replayed(&bench, &["made.mcap", "--epochs", "epochs.jsonl"]);
    let text = bench.read("epochs.jsonl");
    let lines: Vec<EpochLine> = text.lines().map(|line| serde_json::from_str(line).expect(line)).collect();
    assert!(lines.iter().enumerate().all(|(n, line)| line.epoch == n as u64), "{lines:?}");
    assert_eq!(lines.len() as u64, report.checkpoint.epochs);
    for sensor in &report.sensors {
        let sum: u64 = lines.iter().filter(|line| line.sensor == sensor.id).map(|line| line.points).sum();
        assert_eq!((sum, sensor.points.in_epochs), (sensor.points.decoded, sensor.points.decoded), "{}", sensor.id);
    }
    // 1.5 s: the head passes the cut 14 or 15 times; frames are 1/30 s apart and come 25 ms late.
    let of = |kind: &str| lines.iter().filter(|line| line.kind == kind).count();
    assert!((15..=16).contains(&of("lidar")) && of("kinect") == 45, "{} and {}", of("lidar"), of("kinect"));
    let stdout = bench.run(&["replay", "made.mcap", "--epochs", "-"]);
    assert_eq!((stdout.code, stdout.stdout == text), (0, true), "{}", stdout.stderr);
}

#[test]
fn a_recorded_replay_verifies_has_the_same_ledger_and_is_never_live() {
    let bench = bench(2_500);
    let report = replayed(&bench, &["made.mcap", "--record", "again.mcap"]);
    let verified = bench.run(&["verify", "again.mcap", "--json"]);
    let verify: VerifyReport = verified.json();
    assert_eq!((verified.code, verify.verdict, &verify.digest), (0, Verdict::Match, &report.digest));
    // Health at 1.2 and 2.2 s, and the end.
    assert_eq!(verify.checkpoints, 3);
    let diff: DiffReport = bench.run(&["diff", "made.mcap", "again.mcap", "--json"]).json();
    assert!(diff.equal && diff.whole, "{diff:?}");
    let header = Reader::open(&[bench.path("again.mcap")]).expect("opens").header().clone();
    assert_eq!((header.origin, header.session.as_str()), (Origin::Import, "made"));
    assert_eq!(replayed(&bench, &["again.mcap"]).digest, report.digest, "with its own config");
    assert_eq!(replayed(&bench, &["again.mcap", "--ignore-skips"]).digest, report.digest, "nothing was shed");

    let import = bench.run(&["verify", "made.mcap", "--json"]);
    assert_eq!((import.code, import.json::<VerifyReport>().verdict), (3, Verdict::NothingToCompare));
}

#[test]
fn a_recordings_own_config_is_used_and_may_be_overruled() {
    let bench = bench(600);
    let narrow = replayed(&bench, &["made.mcap", "--set", "target.roi_radius_m=0.2", "--record", "narrow.mcap"]);
    assert_ne!(narrow.digest, replayed(&bench, &["made.mcap"]).digest);
    assert_eq!(replayed(&bench, &["narrow.mcap"]).digest, narrow.digest);
    assert_ne!(replayed(&bench, &["narrow.mcap", "--set", "target.roi_radius_m=0.5"]).digest, narrow.digest);
}

#[test]
fn a_session_that_was_killed_verifies_up_to_its_last_checkpoint() {
    let bench = Workbench::new();
    bench.file("rig.toml", "kinect = []\n[stream]\ntcp = \"127.0.0.1:0\"\nunix = \"\"\nfoxglove = \"\"\n");
    let daemon = Daemon::start(&bench, &["run", "--config", "rig.toml", "--min-free", "0", "--record", "run.mcap"]);
    send(&packets(3_000), daemon.data);
    std::thread::sleep(Duration::from_millis(3_000)); // health at 1.2 and 2.2 s, then a sync
    daemon.signal("KILL");
    assert_eq!(daemon.finish().code, None);
    let verified = bench.run(&["verify", "run.mcap", "--json"]);
    let report: VerifyReport = verified.json();
    assert_eq!((verified.code, report.verdict, report.complete), (3, Verdict::Match, false), "{}", verified.stderr);
    assert!(report.checkpoints >= 1 && report.difference.is_none(), "{report:?}");
}

#[test]
fn a_damaged_recording_is_told_with_its_file_and_never_taken_for_whole() {
    let bench = bench(1_400);
    replayed(&bench, &["made.mcap", "--record", "whole.mcap"]);
    let whole = bench.read_bytes("whole.mcap");
    let told = |what: &str, command: &str| {
        let done = bench.run(&[command, "damaged.mcap"]);
        assert!([0, 1, 3].contains(&done.code) && !done.stderr.contains("panicked"), "{what}: {}", done.stderr);
        assert!(done.code == 0 || done.stderr.contains("damaged.mcap"), "{what}: {}", done.stderr);
        done.code != 0
    };
    // Behind the first tenth, which holds the head of the file.
    for tenths in [3, 7] {
        bench.file("damaged.mcap", &whole[..whole.len() * tenths / 10]);
        assert!(told("cut", "verify") && told("cut", "replay"), "cut at {tenths}/10");
    }
    let mut found = 0;
    for tenths in 2..8 {
        let mut bytes = whole.clone();
        bytes[whole.len() * tenths / 10] ^= 1;
        bench.file("damaged.mcap", &bytes);
        let (what, found_here) = (format!("flipped at {tenths}/10"), told("flipped", "verify"));
        found += usize::from(found_here);
        // The indexes between the chunks hold nothing that the chunks do not.
        assert!(found_here || bench.run(&["diff", "made.mcap", "damaged.mcap"]).code == 0, "{what} and not found");
    }
    assert!(found > 0, "no bit fell into a chunk");
}

#[test]
fn what_is_replayed_is_served_as_a_replay_and_only_to_this_machine() {
    let bench = bench(1_400);
    let replaying = Replaying::start(&bench, &["made.mcap", "--speed", "1"]);
    let hello = replaying.lines("HEALTH").next().expect("HELLO");
    assert_eq!(
        (&hello["class"], &hello["origin"], &hello["session"]),
        (&"HELLO".into(), &"replay".into(), &"made".into())
    );
    assert_eq!(replaying.finish().0, Some(0));

    let everywhere = ["--set", "stream.tcp=0.0.0.0:0", "--set", "stream.unix=", "--set", "stream.foxglove="];
    let refused = bench.run(&[&["replay", "made.mcap", "--serve"], &everywhere[..]].concat());
    assert_eq!(refused.code, 2);
    assert!(refused.stderr.contains("--allow-nonlive"), "{}", refused.stderr);
    let allowed = bench.run(&[&["replay", "made.mcap", "--serve", "--allow-nonlive"], &everywhere[..]].concat());
    assert_eq!(allowed.code, 0, "{}", allowed.stderr);
}

#[test]
fn a_stop_ends_a_paced_replay_at_once_and_says_so() {
    let bench = bench(500);
    // 500 s at this speed.
    let replaying = Replaying::start(&bench, &["made.mcap", "--speed", "0.001", "--record", "part.mcap"]);
    std::thread::sleep(Duration::from_millis(1_200));
    let began = Instant::now();
    replaying.signal("INT");
    let (code, log) = replaying.finish();
    assert!(began.elapsed() < Duration::from_secs(5), "{:?}", began.elapsed());
    assert_eq!(code, Some(3), "{log}");
    assert!(log.contains("stopped before the inputs' end"), "{log}");
    let mut part = Reader::open(&[bench.path("part.mcap")]).expect("opens");
    assert!(part.by_ref().all(|event| event.is_ok()) && part.info().whole());
}

#[test]
fn several_captures_are_one_session_and_none_of_them_is_written_to() {
    let bench = Workbench::new();
    let datagram = |(n, payload): (i64, bytes::Bytes)| Datagram {
        t_ns: n * rig::PACKET_NS,
        port: 2368,
        payload: payload.to_vec(),
    };
    let datagrams: Vec<Datagram> = (0..).zip(rig::packets().take(900)).map(datagram).collect();
    bench.file("whole.pcap", write_pcap(&datagrams));
    bench.file("first.pcap", write_pcap(&datagrams[..400]));
    bench.file("second.pcap", write_pcap(&datagrams[400..]));
    let (whole, parts) = (replayed(&bench, &["whole.pcap"]), replayed(&bench, &["second.pcap", "first.pcap"]));
    assert_eq!((whole.checkpoint, whole.digest), (parts.checkpoint, parts.digest));
    let before = bench.read_bytes("first.pcap");
    for output in ["--record", "--epochs"] {
        let own = bench.run(&["replay", "second.pcap", "first.pcap", output, "./first.pcap", "--force"]);
        assert_eq!((own.code, bench.read_bytes("first.pcap") == before), (2, true), "{}", own.stderr);
    }
}
