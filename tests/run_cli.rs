//! `tumbled run` on real UDP over loopback, and its replay.

use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use serde_json::Value;
use tumbled::cli::replay::ReplayReport;
use tumbled::cli::run::RunReport;
use tumbled::cli::verify::{Verdict, VerifyReport};
use tumbled_io::live::{Pace, StopToken, UdpSender};

use crate::support::daemon::{Daemon, Ended, packets, send};
use crate::support::{Workbench, real};

/// A rig of one LiDAR that serves on free ports.
const RIG: &str = "kinect = []\n[stream]\ntcp = \"127.0.0.1:0\"\nunix = \"\"\nfoxglove = \"\"\n";

fn running(bench: &Workbench, more: &[&str]) -> Daemon {
    bench.file("rig.toml", RIG);
    Daemon::start(bench, &[&["run", "--config", "rig.toml", "--json", "--min-free", "0"], more].concat())
}

fn report(ended: &Ended) -> RunReport {
    serde_json::from_str(&ended.report).unwrap_or_else(|error| panic!("{error} in {ended:?}"))
}

fn replayed(bench: &Workbench, arguments: &[&str]) -> ReplayReport {
    let done = bench.run(&[&["replay", "run.mcap", "--json"], arguments].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    done.json()
}

#[test]
fn a_live_session_its_replays_and_its_verification_agree_to_the_bit() {
    let bench = Workbench::new();
    let daemon = running(&bench, &["--record", "run.mcap"]);
    send(&packets(3_200), daemon.data); // 2.1 s of rig time
    std::thread::sleep(Duration::from_millis(1_500)); // the core's first health comes at 1.2 s
    daemon.signal("TERM");
    let ended = daemon.finish();
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let live = report(&ended);
    assert!(live.complete && live.checkpoint.epochs > 10, "{live:?}");
    assert_eq!((live.sensors[0].received, live.sensors[0].lost.total), (3_200, 0));
    // A machine that cannot keep up sheds whole scans and counts them; no point goes any other way.
    let fate = live.sensors[0].points;
    assert_eq!((fate.decoded, fate.in_epochs + fate.shed), (3_200 * 384, 3_200 * 384));

    for arguments in [&["--threads", "1"][..], &["--threads", "2"], &["--threads", "4", "--speed", "8"]] {
        let replay = replayed(&bench, arguments);
        assert_eq!(replay.checkpoint, live.checkpoint, "{arguments:?}");
        assert_eq!(replay.digest, live.digest);
        assert_eq!(replay.sensors, live.sensors);
    }
    let verified = bench.run(&["verify", "run.mcap", "--json"]);
    let report: VerifyReport = verified.json();
    assert_eq!((verified.code, report.verdict, report.digest), (0, Verdict::Match, live.digest), "{}", verified.stderr);
    assert!(report.checkpoints >= 2, "one of health, one of the end: {}", report.checkpoints);
}

#[test]
fn the_real_capture_over_loopback_decodes_to_the_same_points_as_the_file() {
    let Some(capture) = real::real("velodyne/vlp32c_strongest_600rpm_fov180_a.pcap") else { return };
    let bench = Workbench::new();
    let daemon = running(&bench, &["--record", "run.mcap"]);
    let (data, position) = (daemon.data, daemon.position);
    let datagrams = real::datagrams(&capture, data, position);
    assert_eq!(datagrams.len(), 228);
    let sender = UdpSender::bind("127.0.0.1:0".parse().expect("an address")).expect("a socket");
    let stop = StopToken::new().expect("a descriptor");
    sender.send(datagrams, Pace::Times(1.0), &stop).expect("sends");
    std::thread::sleep(Duration::from_millis(500));
    daemon.signal("INT");
    let ended = daemon.finish();
    let live = report(&ended);
    assert_eq!((ended.code, live.sensors[0].received, live.sensors[0].lost.total), (Some(0), 228, 0));
    // 78,978 points of 24 bytes (the capture's README).
    let file = bench.points(capture.to_str().expect("UTF-8"), "rig.toml");
    assert_eq!(file.len(), 78_978 * 24);
    assert!(bench.points("run.mcap", "rig.toml") == file);
    assert_eq!(replayed(&bench, &[]).digest, live.digest);
}

#[test]
fn clients_are_told_hello_events_health_and_clouds() {
    let bench = Workbench::new();
    let daemon = running(&bench, &[]);
    let client = TcpStream::connect(daemon.stream.expect("a stream")).expect("connects");
    client.set_read_timeout(Some(Duration::from_secs(10))).expect("a timeout");
    std::io::Write::write_all(&mut &client, b"{\"subscribe\":[\"HEALTH\",\"CLOUD\",\"EVENT\"]}\n").expect("sends");
    let data = daemon.data;
    let sender = std::thread::spawn(move || send(&packets(9_000), data));
    let mut classes = std::collections::BTreeMap::<String, Value>::new();
    for line in BufReader::new(&client).lines() {
        let line: Value = serde_json::from_str(&line.expect("a line")).expect("JSON");
        let class = line["class"].as_str().expect("a class").to_owned();
        // A turn with points and not the beginning of one.
        let counts = class != "CLOUD" || line["points_total"].as_u64().is_some_and(|points| points > 30_000);
        if counts {
            classes.entry(class).or_insert(line);
        }
        if classes.len() == 4 {
            break;
        }
    }
    assert_eq!(classes["HELLO"]["origin"], "live");
    assert_eq!(classes["HEALTH"]["core"]["sensors"][0]["id"], "front");
    assert!(classes["EVENT"]["message"].as_str().is_some_and(|text| text.contains("front")));
    // A VLP-32C at 600 rpm: 150.7 packets of 384 points a turn; decimated to at most 2 000.
    let cloud = &classes["CLOUD"];
    let (total, kept) = (cloud["points_total"].as_u64(), cloud["xyz_m"].as_array().expect("points").len());
    assert!(total.is_some_and(|total| (57_000..=58_500).contains(&total)), "{total:?}");
    assert!((1_000..=2_000).contains(&kept), "{kept}");
    sender.join().expect("sends");
    daemon.signal("INT");
    assert_eq!(daemon.finish().code, Some(0));
}

#[test]
fn a_changed_config_is_taken_over_on_sighup_recorded_and_replayed() {
    let bench = Workbench::new();
    let mut daemon = running(&bench, &["--record", "run.mcap"]);
    send(&packets(1_000), daemon.data);
    bench.file("rig.toml", format!("{RIG}[target]\nroi_radius_m = 0.5\n"));
    daemon.signal("HUP");
    daemon.wait_for("the config was taken over");
    send(&packets(1_000), daemon.data);
    bench.file("rig.toml", RIG.replace("kinect = []", "kinect = []\nlidar = []"));
    daemon.signal("HUP");
    daemon.wait_for("not taken over");
    std::thread::sleep(Duration::from_millis(300));
    daemon.signal("INT");
    let ended = daemon.finish();
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert_eq!(replayed(&bench, &[]).digest, report(&ended).digest);
}

#[test]
fn a_second_signal_is_not_needed_a_full_stop_takes_less_than_five_seconds() {
    let bench = Workbench::new();
    let daemon = running(&bench, &["--record", "run.mcap"]);
    let client = TcpStream::connect(daemon.stream.expect("a stream")).expect("connects");
    send(&packets(500), daemon.data);
    let began = Instant::now();
    daemon.signal("TERM");
    assert_eq!(daemon.finish().code, Some(0));
    assert!(began.elapsed() < Duration::from_secs(5));
    drop(client);
    let info = bench.run(&["info", "run.mcap"]);
    assert_eq!(info.code, 0, "{}{}", info.stdout, info.stderr);
}

#[cfg(not(feature = "kinect-usb"))]
#[test]
fn a_kinect_in_the_config_is_refused_by_a_program_that_cannot_read_one() {
    let bench = Workbench::new();
    bench.file("rig.toml", "");
    for command in [&["run"][..], &["record", "-o", "run.mcap"]] {
        let done = bench.run(&[command, &["--config", "rig.toml", "--duration", "100ms"]].concat());
        assert_eq!(done.code, 2);
        let stderr = done.stderr.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(stderr.contains("--features kinect-usb") && stderr.contains("kinect = []"), "{stderr}");
    }
}

#[test]
fn one_flipped_byte_of_a_packet_is_found_by_verify() {
    let bench = Workbench::new();
    let daemon = running(&bench, &["--record", "run.mcap"]);
    send(&packets(2_400), daemon.data);
    std::thread::sleep(Duration::from_millis(1_300));
    daemon.signal("INT");
    assert_eq!(daemon.finish().code, Some(0));
    crate::support::ledger::rewrite(&bench.path("run.mcap"), &bench.path("other.mcap"), |seq, payload| {
        if seq == 1_000 {
            payload[700] ^= 1;
        }
    });
    let done = bench.run(&["verify", "other.mcap", "--json"]);
    let report: VerifyReport = done.json();
    assert_eq!((done.code, report.verdict), (1, Verdict::Different), "{}", done.stderr);
    let difference = report.difference.expect("a difference");
    assert!(difference.fields.contains(&"ledger".to_owned()), "{difference:?}");
}
