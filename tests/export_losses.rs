//! `tumbled export`: what is missing, told in words and by exit code 3.

use std::fs;

use tumbled_velodyne::{Model, ReturnMode};

use crate::export_cli::{datagrams, drive, dump, export, fine, partials};
use crate::support::pcap::{Datagram, write_pcap};
use crate::support::{Done, Workbench};
use crate::synth::Sensor;

/// File header of a pcap; a record of one data packet: header 16, Ethernet 14, IP 20, UDP 8, payload 1 206.
const PCAP_HEADER: usize = 24;
const RECORD: usize = 1_264;
/// Where in a record the last byte of the sender's address stands, and the UDP length.
const SENDER: usize = 16 + 14 + 15;
const UDP_LENGTH: usize = 16 + 14 + 20 + 4;

/// The datagrams of a VLP-16 at 600 rpm: 4.7776° a packet.
fn vlp16(n: usize) -> Vec<Datagram> {
    datagrams(&Sensor::new(Model::Vlp16, ReturnMode::Strongest).packets(n, |_, _| (1_000, 1_000)))
}

fn bench(datagrams: &[Datagram]) -> Workbench {
    let bench = Workbench::new();
    bench.file("drive.pcap", write_pcap(datagrams));
    bench
}

fn run(bench: &Workbench, more: &[&str]) -> Done {
    export(bench, "drive.pcap", "lidar-points", "pts", "cloud.pts", &[more, &["--json"]].concat())
}

fn number(done: &Done, key: &str) -> u64 {
    let report: serde_json::Value = serde_json::from_str(&done.stdout).expect("JSON");
    assert_eq!(report["complete"].as_bool(), Some(done.code == 0), "the exit code says the same");
    report[key].as_u64().expect("a number")
}

#[test]
fn packets_lost_before_the_capture_are_exit_code_3() {
    let mut packets = vlp16(60);
    packets.drain(20..23);
    let done = run(&bench(&packets), &[]);
    assert_eq!((done.code, number(&done, "lost"), number(&done, "records")), (3, 3, 57));
    assert!(done.stderr.contains("3 packets lost in 1 places"), "{}", done.stderr);
    // What is asked for is whole: the packets are missing at 20 × 4.7776° = 95.6°, in turn 0 of 0 to 75.
    let mut packets = vlp16(200);
    packets.drain(20..23);
    let bench = bench(&packets);
    assert_eq!(run(&bench, &["--frames", "1"]).code, 0);
    assert_eq!(run(&bench, &["--frames", "0"]).code, 3);
}

#[test]
fn payloads_that_are_refused_are_exit_code_3() {
    for (at, value, reason) in [
        (1_205, 0x28, "lidar.source"), // says that it is of a VLP-32C
        (1_205, 0xA1, "VLS-128 packets are not supported"),
        (1_205, 0x99, "product byte 0x99 is unknown"),
        (1_204, 0x11, "return mode byte 0x11"),
        (0, 0x00, "1 payloads not decoded"), // a block without its flag
    ] {
        let mut packets = vlp16(30);
        packets[10].payload[at] = value;
        let done = run(&bench(&packets), &[]);
        assert_eq!((done.code, number(&done, "not_decoded")), (3, 1), "{reason}: {}", done.stderr);
        assert!(done.stderr.contains(reason), "{}", done.stderr);
    }
    let mut packets = vlp16(30);
    packets[10].payload.truncate(1_000);
    assert_eq!(run(&bench(&packets), &[]).code, 3);
}

#[test]
fn frames_of_the_network_that_cannot_be_read_are_exit_code_3() {
    let (bench, _) = drive(5);
    let whole = bench.read_bytes("drive.pcap");
    let mut malformed = whole.clone();
    malformed[PCAP_HEADER + RECORD + UDP_LENGTH..][..2].copy_from_slice(&[0, 7]); // the UDP header alone has 8
    bench.file("drive.pcap", malformed);
    let done = run(&bench, &[]);
    assert_eq!((done.code, number(&done, "records")), (3, 4));
    assert!(done.stderr.contains("1 frames with contradictory IP or UDP headers"), "{}", done.stderr);
    assert_eq!(bench.run(&["info", "drive.pcap"]).code, 3);
}

#[test]
fn frames_of_a_kinect_that_cannot_be_read_are_exit_code_3() {
    let bench = dump(3);
    fine(&export(&bench, "dump", "kinect-depth", "png", "all", &[]));
    let name = "dump/d-1000.033333-2000000.pgm";
    bench.file(name, &bench.read_bytes(name)[..1_000]);
    let done = export(&bench, "dump", "kinect-depth", "png", "some", &[]);
    assert_eq!(done.code, 3, "{}", done.stderr);
    // A time for each frame that is there.
    assert_eq!(bench.read("some/times.txt"), "1000.000000000\n1000.066666000\n");
}

#[test]
fn an_export_that_finds_nothing_says_what_is_wrong_with_the_input() {
    let (bench, _) = drive(1);
    let whole = bench.read_bytes("drive.pcap");
    bench.file("drive.pcap", &whole[..whole.len() - 1]);
    let done = run(&bench, &[]);
    assert_eq!(done.code, 2, "{}", done.stderr);
    assert!(done.stderr.contains("no LiDAR packets"), "{}", done.stderr);
    assert!(done.stderr.contains("drive.pcap is readable only up to byte 24"), "{}", done.stderr);
    assert_eq!(partials(&bench), 0);

    let bench = dump(2);
    for name in ["dump/d-1000.000000-0.pgm", "dump/d-1000.033333-2000000.pgm"] {
        bench.file(name, &bench.read_bytes(name)[..1_000]);
    }
    let done = export(&bench, "dump", "kinect-depth", "png", "all", &[]);
    assert_eq!(done.code, 2, "{}", done.stderr);
    assert!(done.stderr.contains("d-1000.033333-2000000.pgm: "), "{}", done.stderr);
}

#[test]
fn two_senders_on_one_port_are_told_with_the_setting_that_takes_them_apart() {
    let (bench, _) = drive(9);
    let mut capture = bench.read_bytes("drive.pcap");
    for k in [2, 4] {
        capture[PCAP_HEADER + k * RECORD + SENDER] = 202;
    }
    bench.file("drive.pcap", capture);
    let warning = "192.168.1.201 (7 packets), 192.168.1.202 (2 packets); set lidar.source=192.168.1.201";
    let done = run(&bench, &[]);
    assert!(done.code == 0 && done.stderr.contains(warning), "{}", done.stderr);
    let told = bench.run(&["info", "drive.pcap"]);
    assert!(told.code == 0 && told.stdout.contains(warning), "{}", told.stdout);
    // Taken apart it is one sensor, which now lacks two packets.
    let done = run(&bench, &["--set", "lidar.source=192.168.1.201"]);
    assert_eq!((number(&done, "records"), number(&done, "lost")), (7, 2));
    assert!(!done.stderr.contains("several senders"), "{}", done.stderr);
}

#[test]
fn one_input_given_twice_is_refused() {
    let (bench, _) = drive(3);
    let done = run(&bench, &["./drive.pcap"]);
    assert!(done.code == 2 && done.stderr.contains("given twice"), "{}", done.stderr);
    // A copy is another file; its packets are told to be there twice.
    fs::copy(bench.path("drive.pcap"), bench.path("copy.pcap")).expect("copied");
    let done = run(&bench, &["copy.pcap"]);
    assert_eq!((done.code, number(&done, "records")), (0, 6), "{}", done.stderr);
    assert!(done.stderr.contains("3 packets came twice"), "{}", done.stderr);
}

#[test]
fn packets_that_come_late_turn_nothing() {
    // Turn 0 has packets 0 to 75, turn 1 76 to 150 and turn 2 the rest, however they are swapped: also across the end
    // of a turn, where 76 comes before 75.
    let mut packets = vlp16(200);
    for k in (5..195).step_by(10) {
        packets.swap(k, k + 1);
    }
    let times: Vec<i64> = vlp16(200).iter().map(|packet| packet.t_ns).collect();
    packets.iter_mut().zip(times).for_each(|(packet, t_ns)| packet.t_ns = t_ns);
    let bench = bench(&packets);
    let in_turn = |turn: &str| {
        let done = run(&bench, &["--frames", turn]);
        (done.code, number(&done, "records"))
    };
    assert_eq!([in_turn("0"), in_turn("1"), in_turn("2"), in_turn("..")], [(0, 76), (0, 75), (0, 49), (0, 200)]);
}

#[test]
fn turns_go_on_through_a_gap_of_many() {
    // Without packets 100 to 476, five turns, the next is 477 × 4.7776° = 2 278.9° from the first: in turn 6, to which
    // packets up to 527 × 4.7776° = 2 517.8° belong. 51 packets then, and behind them 600 - 528 = 72 in turn 7.
    let mut packets = vlp16(600);
    packets.drain(100..477);
    let bench = bench(&packets);
    let in_turn = |turn: &str| number(&run(&bench, &["--frames", turn]), "records");
    assert_eq!([in_turn("0"), in_turn("1"), in_turn("6"), in_turn("7")], [76, 24, 51, 72]);
    assert_eq!(run(&bench, &["--frames", "2..6"]).code, 2, "nothing is there of these turns");
}
