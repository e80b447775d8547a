//! `import`, `recover`, `diff`, and recordings as inputs of `export` and `info`.

use std::fs;

use serde_json::Value;
use tumbled::cli::diff::DiffReport;
use tumbled::cli::import::ImportReport;
use tumbled::cli::info::report::InfoReport;
use tumbled::cli::info::report::input::{HostStamps, InputKind};
use tumbled::cli::recover::RecoverReport;

use crate::support::pcap::{Datagram, START_UNIX_S, write_pcap};
use crate::support::real::real;
use crate::support::{Done, Workbench};

/// Payloads 50 ms apart, the nth full of n; of 20 the last comes 0.95 s after the first.
fn pcap(packets: u8) -> Vec<u8> {
    let datagram = |n: u8| Datagram { t_ns: i64::from(n) * 50_000_000, port: 2368, payload: vec![n; 1206] };
    write_pcap(&(0..packets).map(datagram).collect::<Vec<_>>())
}

fn imported(bench: &Workbench) -> Done {
    bench.file("drive.pcap", pcap(20));
    let done = bench.run(&["import", "drive.pcap", "-o", "drive.mcap", "--json"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    done
}

fn channel(report: &tumbled::cli::ledger::LedgerReport, name: &str) -> u64 {
    report.channels.iter().filter(|channel| channel.channel == name).map(|channel| channel.events).sum()
}

#[test]
fn an_import_is_the_ledger_a_live_run_would_have_had() {
    let bench = Workbench::new();
    let report: ImportReport = imported(&bench).json();
    assert_eq!(channel(&report.ledger, "/lidar/front/packets"), 20);
    // Ticks at 0.0, 0.1, … 0.9 s and one anchor at 0 s.
    assert_eq!(channel(&report.ledger, "/ledger"), 11);
    assert_eq!((report.ledger.events, report.ledger.first_seq, report.ledger.last_seq), (31, Some(0), Some(30)));
    assert_eq!(report.ledger.last_t_ns, Some(950_000_000));
    assert_eq!(report.epoch_unix_ns, Some(format!("{START_UNIX_S}000000000")));
    assert!(report.whole && report.warnings.is_empty());
    assert_eq!(report.file_bytes, fs::metadata(bench.path("drive.mcap")).expect("written").len());
}

#[test]
fn the_same_inputs_make_the_same_bytes_wherever_they_lie() {
    let bench = Workbench::new();
    imported(&bench);
    bench.file("elsewhere/drive.pcap", pcap(20));
    assert_eq!(bench.run(&["import", "elsewhere/drive.pcap", "-o", "elsewhere/again.mcap"]).code, 0);
    assert!(bench.read_bytes("drive.mcap") == bench.read_bytes("elsewhere/again.mcap"));
}

#[test]
fn an_output_that_is_there_is_replaced_only_by_force_and_an_input_never() {
    let bench = Workbench::new();
    imported(&bench);
    let again = bench.run(&["import", "drive.pcap", "-o", "drive.mcap"]);
    assert_eq!(again.code, 2);
    assert!(again.stderr.contains("--force"), "{}", again.stderr);
    assert_eq!(bench.run(&["import", "drive.pcap", "-o", "drive.mcap", "--force"]).code, 0);
    let before = bench.read_bytes("drive.pcap");
    let own = bench.run(&["import", "drive.pcap", "-o", "./drive.pcap", "--force"]);
    assert_eq!((own.code, bench.read_bytes("drive.pcap") == before), (2, true), "{}", own.stderr);
}

#[test]
fn an_import_that_fails_leaves_no_file() {
    let bench = Workbench::new();
    bench.file("notes.txt", "hello");
    assert_eq!(bench.run(&["import", "notes.txt", "-o", "out.mcap"]).code, 2);
    assert!(!bench.path("out.mcap").exists());
}

#[test]
fn a_capture_and_its_import_export_the_same_points() {
    let Some(capture) = real("velodyne/vlp32c_strongest_600rpm_fov180_a.pcap") else { return };
    let bench = Workbench::new();
    let capture = capture.to_str().expect("a plain path").to_owned();
    assert_eq!(bench.run(&["import", &capture, "-o", "real.mcap"]).code, 0);
    for (input, output) in [(capture.as_str(), "a.pts"), ("real.mcap", "b.pts")] {
        let done = bench.run(&["export", input, "--what", "lidar-points", "--format", "pts", "-o", output]);
        assert_eq!(done.code, 0, "{}", done.stderr);
    }
    assert!(bench.read_bytes("a.pts") == bench.read_bytes("b.pts"));
    assert_eq!(bench.run(&["diff", &capture, "real.mcap"]).code, 0);
}

#[test]
fn diff_finds_the_first_field_that_differs() {
    let bench = Workbench::new();
    imported(&bench);
    let same = bench.run(&["diff", "drive.mcap", "drive.pcap", "--json"]);
    let report: DiffReport = same.json();
    assert_eq!((same.code, report.equal, report.events_a, report.events_b), (0, true, 31, 31), "{}", same.stderr);

    let mut other = pcap(20);
    // The last byte of the last payload.
    *other.last_mut().expect("not empty") = 0xAB;
    bench.file("other.pcap", other);
    let different = bench.run(&["diff", "drive.mcap", "other.pcap", "--json"]);
    let report: DiffReport = different.json();
    assert_eq!((different.code, report.events_different), (1, 1));
    let first = report.first.expect("a difference");
    let at = first.a.expect("A goes on");
    assert_eq!((first.place, at.seq, at.t_ns, at.channel.as_str()), (30, 30, 950_000_000, "/lidar/front/packets"));
    // Packet 19 is full of 19 = 0x13.
    assert_eq!(first.field.as_deref(), Some("bytes"));
    assert_eq!(first.value_a.as_deref(), Some("0x13 at byte 1205"));
    assert_eq!(first.value_b.as_deref(), Some("0xab at byte 1205"));

    bench.file("short.pcap", pcap(19));
    let shorter = bench.run(&["diff", "drive.mcap", "short.pcap"]);
    assert_eq!(shorter.code, 1);
    assert!(shorter.stdout.contains("B: has ended"), "{}", shorter.stdout);
}

#[test]
fn recover_makes_a_finished_file_and_says_exactly_what_was_lost() {
    let bench = Workbench::new();
    imported(&bench);
    let whole = bench.run(&["recover", "drive.mcap", "-o", "same.mcap", "--json"]);
    let report: RecoverReport = whole.json();
    assert_eq!((whole.code, report.whole, report.ledger.events), (0, true, 31), "{}", whole.stderr);
    assert_eq!(bench.run(&["diff", "drive.mcap", "same.mcap"]).code, 0);

    // Without its last 10 bytes the index is broken: the data are whole, and so is the end record.
    let file = bench.read_bytes("drive.mcap");
    bench.file("cut.mcap", &file[..file.len() - 10]);
    let done = bench.run(&["recover", "cut.mcap", "--json"]);
    let report: RecoverReport = done.json();
    assert_eq!((done.code, report.ledger.events, report.parts[0].events_lost), (3, 31, Some(0)), "{}", done.stderr);
    let recovered = bench.run(&["info", "cut.recovered.mcap", "--json"]);
    assert_eq!(recovered.code, 0, "{}", recovered.stderr);

    // Cut behind its start: nothing of the data is there, and nothing tells how much there was.
    let chunk = file.windows(3).position(|window| window == b"lz4").expect("a chunk");
    bench.file("early.mcap", &file[..chunk + 40]);
    let done = bench.run(&["recover", "early.mcap", "--json"]);
    let report: RecoverReport = done.json();
    assert_eq!((done.code, report.ledger.events, report.parts[0].events_lost), (3, 0, None));
    assert!(report.warnings.iter().any(|warning| warning.contains("was not finished")), "{:?}", report.warnings);

    bench.file("drive2.pcap", pcap(3));
    assert_eq!(bench.run(&["recover", "drive2.pcap"]).code, 2, "a pcap is no recording");
}

#[test]
fn info_tells_what_a_recording_says_of_itself() {
    let bench = Workbench::new();
    imported(&bench);
    let done = bench.run(&["info", "drive.mcap", "--json"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let report: InfoReport = done.json();
    let input = &report.inputs[0];
    assert_eq!((input.kind, input.stamp_origin), (InputKind::Recording, HostStamps::Ledger));
    let recording = input.recording.as_ref().expect("a recording");
    assert_eq!((recording.origin.as_str(), recording.ledger.events, recording.whole), ("import", 31, true));
    assert_eq!((recording.inputs[0].name.as_str(), recording.inputs[0].blake3.len()), ("drive.pcap", 64));
    let text = bench.run(&["info", "drive.mcap"]).stdout;
    assert!(text.contains("imported from") && text.contains("/lidar/front/packets"), "{text}");

    let file = bench.read_bytes("drive.mcap");
    bench.file("cut.mcap", &file[..file.len() - 1]);
    let cut = bench.run(&["info", "cut.mcap"]);
    assert_eq!(cut.code, 3);
    assert!(cut.stdout.contains("not complete"), "{}", cut.stdout);
}

#[test]
fn recordings_merge_with_other_captures_by_host_time() {
    let bench = Workbench::new();
    imported(&bench);
    let shifted = Datagram { t_ns: 25_000_000, port: 2369, payload: vec![0xEE; 1206] };
    bench.file("rear.pcap", write_pcap(&[shifted]));
    let config = "[[lidar]]\nid = \"front\"\n[[lidar]]\nid = \"rear\"\nport = 2369\nposition_port = 8309\n";
    bench.file("rig.toml", config);
    let arguments = ["import", "drive.mcap", "rear.pcap", "--config", "rig.toml", "-o", "both.mcap", "--json"];
    let done = bench.run(&arguments);
    let report: ImportReport = done.json();
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert_eq!(channel(&report.ledger, "/lidar/front/packets"), 20);
    assert_eq!(channel(&report.ledger, "/lidar/rear/packets"), 1);
    // The recording's own ticks and anchor are not counted beside the new ones.
    assert_eq!(channel(&report.ledger, "/ledger"), 11);
}

#[test]
fn json_goes_alone_to_stdout() {
    let bench = Workbench::new();
    imported(&bench);
    for arguments in [
        &["import", "drive.pcap", "-o", "x.mcap", "--json"][..],
        &["recover", "drive.mcap", "--json"],
        &["diff", "drive.mcap", "x.mcap", "--json"],
    ] {
        let done = bench.run(arguments);
        let parsed: Result<Value, _> = serde_json::from_str(&done.stdout);
        assert!(parsed.is_ok(), "{arguments:?}: {}", done.stdout);
    }
}
