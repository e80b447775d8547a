//! `tumbled record` on real UDP over loopback.

use std::net::{Ipv4Addr, UdpSocket};
use std::time::Duration;

use tumbled::cli::record::RecordReport;

use crate::support::daemon::{Daemon, packets, send};
use crate::support::{Workbench, repository};

fn recording(bench: &Workbench, more: &[&str]) -> Daemon {
    Daemon::start(
        bench,
        &[&["record", "-o", "run.mcap", "--json", "--min-free", "0", "--set", "kinect=[]"], more].concat(),
    )
}

#[test]
fn what_is_sent_is_recorded_and_decodes_to_the_same_points() {
    let bench = Workbench::new();
    let daemon = recording(&bench, &[]);
    let sent = packets(600);
    send(&sent, daemon.data);
    send(&[vec![0; 512], vec![0; 512]], daemon.position);
    std::thread::sleep(Duration::from_millis(200)); // sent is not yet received
    daemon.signal("INT");
    let ended = daemon.finish();
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let report: RecordReport = serde_json::from_str(&ended.report).expect("a report");
    assert!(report.complete && report.stopped.is_none());
    assert_eq!((report.sources[0].packets, report.sources[0].lost_kernel), (602, 0));

    // The same packets as a capture file, made by hand, and the recording give the same points.
    let datagrams: Vec<_> = sent
        .iter()
        .enumerate()
        .map(|(k, payload)| crate::support::pcap::Datagram {
            t_ns: k as i64 * 663_552,
            port: 2368,
            payload: payload.clone(),
        })
        .collect();
    bench.file("same.pcap", crate::support::pcap::write_pcap(&datagrams));
    for (input, output) in [("run.mcap", "a.pts"), ("same.pcap", "b.pts")] {
        let done = bench.run(&["export", input, "--what", "lidar-points", "--format", "pts", "-o", output]);
        assert_eq!(done.code, 0, "{}", done.stderr);
    }
    let read = |name: &str| std::fs::read(bench.path(name)).expect("points");
    assert_eq!(read("a.pts").len(), 600 * 384 * 24);
    assert!(read("a.pts") == read("b.pts"));
}

#[test]
fn a_duration_ends_it_and_a_silent_sensor_is_told() {
    let bench = Workbench::new();
    let ended = recording(&bench, &["--duration", "300ms"]).finish();
    let report: RecordReport = serde_json::from_str(&ended.report).expect("a report");
    assert_eq!((ended.code, report.sources[0].packets, report.complete), (Some(0), 0, true));
    // Ticks and an anchor at least: the session itself is recorded.
    assert!(report.ledger.events > 0);
}

#[test]
fn a_kill_costs_at_most_the_last_second() {
    let bench = Workbench::new();
    let daemon = recording(&bench, &[]);
    let sent = packets(1_500);
    send(&sent, daemon.data);
    // Synced every 0.9 s: after 1.2 s everything sent before is on the disk.
    std::thread::sleep(Duration::from_millis(1_200));
    send(&packets(100), daemon.data);
    daemon.signal("KILL");
    daemon.finish();
    let done = bench.run(&["recover", "run.mcap", "-o", "whole.mcap", "--json"]);
    assert!(done.code == 0 || done.code == 3, "{}", done.stderr);
    let done = bench.run(&["export", "whole.mcap", "--what", "lidar-points", "--format", "pts", "-o", "p.pts"]);
    assert!(done.code == 0 || done.code == 3, "{}", done.stderr);
    let bytes = std::fs::metadata(bench.path("p.pts")).expect("points").len();
    assert!(bytes >= 1_500 * 384 * 24, "{bytes} bytes of points");
}

#[test]
fn a_port_that_is_taken_is_named() {
    let bench = Workbench::new();
    let taken = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).expect("a socket");
    let port = taken.local_addr().expect("bound").port();
    let done = bench.run(&[
        "record",
        "-o",
        "run.mcap",
        "--set",
        &format!("lidar.port={port}"),
        "--set",
        "lidar.position_port=0",
    ]);
    assert_eq!(done.code, 1);
    assert!(done.stderr.contains(&port.to_string()), "{}", done.stderr);
}

#[test]
fn an_existing_recording_is_not_replaced() {
    let bench = Workbench::new();
    bench.file("run.mcap", "precious");
    let done = bench.run(&[
        "record",
        "-o",
        "run.mcap",
        "--duration",
        "100ms",
        "--set",
        "lidar.port=0",
        "--set",
        "lidar.position_port=0",
    ]);
    assert_eq!((done.code, bench.read("run.mcap").as_str()), (2, "precious"));
    assert!(repository().join("docs/schema/record.schema.json").is_file());
}

#[test]
fn the_config_says_how_much_space_stays_free_and_the_command_line_goes_before_it() {
    let bench = Workbench::new();
    let arguments = ["record", "-o", "run.mcap", "--set", "lidar.port=0", "--set", "lidar.position_port=0"];
    // 8 EB: no disk has them, so the recording does not even begin.
    let by_config = [&arguments[..], &["--set", "record.min_free=8000000TB"]].concat();
    let refused = bench.run(&by_config);
    assert_eq!(refused.code, 1, "{}", refused.stderr);
    assert!(refused.stderr.contains("fewer than the 8000000000000000000"), "{}", refused.stderr);
    let recorded = bench.run(&[&by_config[..], &["--min-free", "0", "--duration", "100ms"]].concat());
    assert_eq!(recorded.code, 0, "{}", recorded.stderr);
}
