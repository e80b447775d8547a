//! `tumbled info`: what it says of made and of real captures.
//!
//! Made captures are received from 10:00:00 UTC on 22 November 2026 on ([`START_UNIX_S`]); the made sensor's stamps
//! begin one second past its hour unless a test says otherwise.

use tumbled::cli::info::report::InfoReport;
use tumbled::cli::info::report::hdl64e::CalibrationSource;
use tumbled::cli::info::report::kinect::Encoding;
use tumbled::cli::info::report::lidar::{ClockState, LidarReport, LossReport, ModelSource};
use tumbled_kinect::{RawDisparity, RawImage, encode_raw};
use tumbled_model::{DepthEncoding, UnixNs, nmea};
use tumbled_velodyne::encode::position_packet;
use tumbled_velodyne::position::Pps;
use tumbled_velodyne::{Model, ReturnMode};

use crate::support::pcap::{Datagram, START_UNIX_S, write_pcap};
use crate::support::real::real;
use crate::support::{Done, Workbench, repository};
use crate::synth::{Packet, Sensor};

/// Nothing lost, nothing odd.
const NO_LOSS: LossReport =
    LossReport { lost: 0, gaps: 0, longest_gap: 0, duplicates: 0, late: 0, resets: 0, pauses: 0 };

/// A wall all around, 1 000 counts away.
fn wall(_slot: usize, _t_ns: i64) -> (u16, u16) {
    (1_000, 1_000)
}

fn sensor(model: Model) -> Sensor {
    Sensor::new(model, ReturnMode::Strongest)
}

/// A sensor that looks from 270° over the front to 91° only.
fn limited() -> Sensor {
    Sensor { start_deg: 300.0, silent_deg: Some((91.0, 270.0)), ..sensor(Model::Vlp32c) }
}

/// The packet as the host has it: some µs after its last firing.
fn data(packet: &Packet) -> Datagram {
    let t_ns = packet.group_t_ns.last().expect("firings") + 80_000;
    Datagram { t_ns, port: 2368, payload: packet.bytes.to_vec() }
}

/// The packets, and after each tenth a position packet with the sentence of the second before its stamp, `off_s` off.
/// `hour` is the UTC hour of the sensor's first stamp.
fn with_receiver(sensor: &Sensor, packets: &[Packet], hour: UnixNs, pps: Pps, off_s: i64) -> Vec<Datagram> {
    let mut datagrams = Vec::new();
    for (k, packet) in packets.iter().enumerate() {
        datagrams.push(data(packet));
        if k % 10 == 9 {
            let utc_ns = hour.0 + i64::from(sensor.start_us) * 1_000 + packet.t_ns;
            let second = UnixNs((utc_ns.div_euclid(1_000_000_000) + off_s) * 1_000_000_000);
            let payload = position_packet(sensor.stamp(packet.t_ns), pps, &nmea::format_rmc(second, true));
            let t_ns = datagrams.last().expect("pushed above").t_ns + 50_000;
            datagrams.push(Datagram { t_ns, port: 8308, payload: payload.to_vec() });
        }
    }
    datagrams
}

/// 09:00 UTC on 22 November 2026.
fn nine_o_clock() -> UnixNs {
    UnixNs((START_UNIX_S - 3_600) * 1_000_000_000)
}

fn run(bytes: &[u8], arguments: &[&str]) -> Done {
    let bench = Workbench::new();
    bench.file("drive.pcap", bytes);
    bench.run(&[&["info", "drive.pcap"], arguments].concat())
}

fn report(datagrams: &[Datagram], arguments: &[&str]) -> InfoReport {
    let done = run(&write_pcap(datagrams), &[arguments, &["--json"]].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    done.json()
}

fn only_lidar(report: &InfoReport) -> &LidarReport {
    match report.lidars.as_slice() {
        [lidar] => lidar,
        other => panic!("one LiDAR expected: {other:#?}"),
    }
}

fn loss_of(datagrams: &[Datagram]) -> LossReport {
    only_lidar(&report(datagrams, &[])).loss.expect("the sensor has a clock")
}

#[test]
fn removing_packets_counts_exactly_those() {
    let packets = sensor(Model::Vlp16).packets(200, wall);
    // One; two neighbours; seven in three places.
    for removed in [&[50][..], &[60, 61], &[20, 21, 22, 100, 150, 151, 198]] {
        let kept = packets.iter().enumerate().filter(|(k, _)| !removed.contains(k));
        let loss = loss_of(&kept.map(|(_, packet)| data(packet)).collect::<Vec<_>>());
        let gaps = removed.iter().filter(|k| !removed.contains(&(*k - 1))).count() as u64;
        assert_eq!((loss.lost, loss.gaps), (removed.len() as u64, gaps), "{removed:?}");
    }
    assert_eq!(loss_of(&packets.iter().map(data).collect::<Vec<_>>()), NO_LOSS);
}

#[test]
fn packets_twice_and_out_of_order_are_no_loss() {
    let mut datagrams: Vec<Datagram> = sensor(Model::Vlp16).packets(60, wall).iter().map(data).collect();
    let twice = Datagram { t_ns: datagrams[20].t_ns + 1_000, port: 2368, payload: datagrams[20].payload.clone() };
    datagrams.insert(21, twice);
    datagrams.swap(40, 41);
    assert_eq!(loss_of(&datagrams), LossReport { duplicates: 1, late: 1, gaps: 1, longest_gap: 1, ..NO_LOSS });
}

#[test]
fn the_silence_of_a_limited_view_is_not_loss() {
    // 400 packets of 12 firings, 0.199° each, are 955.6°: from 300° to 91° (151°), then 4.4 times 181°, so 5 pauses.
    let packets = limited().packets(400, wall);
    let report = report(&packets.iter().map(data).collect::<Vec<_>>(), &[]);
    let lidar = only_lidar(&report);
    let loss = lidar.loss.expect("a clock");
    assert_eq!((loss.lost, loss.pauses), (0, 5));
    let view = lidar.field_of_view.expect("known");
    // A firing every 0.2° at 600 rpm: the ends are that uncertain. Silent for 179°, that is 49.7 ms.
    assert!(view.limited && (view.from_deg - 270.0).abs() < 0.25 && (view.to_deg - 91.0).abs() < 0.25, "{view:?}");
    assert!((view.pause_ms - 49.7).abs() < 0.1, "{view:?}");
    // 1 507.04 packets a second while it fires, for 181° of 360°.
    let rate = lidar.packets_per_s.expect("known");
    assert!((rate - 1_507.04 * 181.0 / 360.0).abs() < 2.0, "{rate}");
    assert!(lidar.rpm.is_some_and(|rpm| (rpm - 600.0).abs() < 0.2), "{:?}", lidar.rpm);
}

#[test]
fn loss_is_counted_exactly_beside_the_silences_of_a_limited_view() {
    let packets = limited().packets(400, wall);
    let ordinary = |k: &usize| !packets[*k].has_jump && !packets[k + 1].has_jump && !packets[k - 1].has_jump;
    let removed: Vec<usize> = (30..390).step_by(45).filter(ordinary).collect();
    let kept = packets.iter().enumerate().filter(|(k, _)| !removed.contains(k));
    let loss = loss_of(&kept.map(|(_, packet)| data(packet)).collect::<Vec<_>>());
    assert_eq!((loss.lost, loss.gaps), (removed.len() as u64, removed.len() as u64));
    assert!(removed.len() >= 6, "{removed:?}");
}

#[test]
fn a_locked_receiver_dates_the_first_firing_across_the_hour() {
    // 09:59:59.9 at the start; 200 packets of 1.327 ms end at 10:00:00.164.
    let sensor = Sensor { start_us: 3_599_900_000, ..sensor(Model::Vlp16) };
    let packets = sensor.packets(200, wall);
    let report = report(&with_receiver(&sensor, &packets, nine_o_clock(), Pps::Locked, 0), &[]);
    let lidar = only_lidar(&report);
    assert_eq!((lidar.clock.state, lidar.loss), (ClockState::Locked, Some(NO_LOSS)));
    let first = lidar.clock.first_firing.as_ref().expect("locked");
    assert_eq!(first.utc, "2026-11-22T09:59:59.900000000Z");
    // Ten o'clock less a tenth of a second.
    assert_eq!(first.unix_ns, (START_UNIX_S * 1_000_000_000 - 100_000_000).to_string());
    let last_us = lidar.last_stamp_us.expect("a clock");
    // 199 × 1 327.104 µs - 100 000 µs = 164 093.7 µs past ten.
    assert_eq!((lidar.first_stamp_us, last_us), (Some(3_599_900_000), 164_094));
    assert_eq!((lidar.clock.sentences.valid, lidar.position_packets), (20, 20));
}

#[test]
fn sentences_without_a_pulse_are_told_from_a_locked_clock() {
    let sensor = sensor(Model::Hdl32e);
    let packets = sensor.packets(30, wall);
    let report = report(&with_receiver(&sensor, &packets, nine_o_clock(), Pps::Absent, 0), &[]);
    let clock = &only_lidar(&report).clock;
    assert_eq!((clock.state, clock.pps.as_deref()), (ClockState::Sentence, Some("absent")));
    assert_eq!(clock.first_firing.as_ref().map(|t| t.utc.as_str()), Some("2026-11-22T09:00:01.000000000Z"));
}

#[test]
fn a_stamp_that_marks_the_last_firing_moves_the_first_one() {
    let sensor = sensor(Model::Hdl32e);
    let packets = sensor.packets(30, wall);
    let datagrams = with_receiver(&sensor, &packets, nine_o_clock(), Pps::Locked, 0);
    let report = report(&datagrams, &["--set", "lidar.hdl32e_stamp=last"]);
    // 542.592 µs before 09:00:01.
    let first = only_lidar(&report).clock.first_firing.as_ref().map(|t| t.utc.as_str());
    assert_eq!(first, Some("2026-11-22T09:00:00.999457408Z"));
}

#[test]
fn a_sentence_that_contradicts_the_stamps_gives_no_utc() {
    let sensor = sensor(Model::Vlp16);
    let packets = sensor.packets(30, wall);
    let report = report(&with_receiver(&sensor, &packets, nine_o_clock(), Pps::Absent, 600), &[]);
    let lidar = only_lidar(&report);
    assert_eq!((lidar.clock.state, &lidar.clock.first_firing), (ClockState::Contradicted, &None));
    assert!(lidar.warnings.iter().any(|warning| warning.contains("contradicts")), "{:?}", lidar.warnings);
}

#[test]
fn a_clock_set_in_between_does_not_date_what_came_before() {
    // Counted from power-up at first, then set to ten minutes past nine by the receiver.
    let before = sensor(Model::Vlp16);
    let after = Sensor { start_us: 600_000_000, ..sensor(Model::Vlp16) };
    let mut datagrams: Vec<Datagram> = before.packets(40, wall).iter().map(data).collect();
    let resumed_ns = datagrams.last().expect("40").t_ns;
    for mut datagram in with_receiver(&after, &after.packets(40, wall), nine_o_clock(), Pps::Locked, 0) {
        datagram.t_ns += resumed_ns;
        datagrams.push(datagram);
    }
    let report = report(&datagrams, &[]);
    let lidar = only_lidar(&report);
    assert_eq!((lidar.clock.state, &lidar.clock.first_firing), (ClockState::Locked, &None));
    assert_eq!(lidar.loss.map(|loss| loss.resets), Some(1));
    assert!(lidar.warnings.iter().any(|warning| warning.contains("first firing's UTC is unknown")), "{lidar:#?}");
}

#[test]
fn an_old_vlp16_that_says_hdl32e_is_warned_about_and_right_when_forced() {
    let mut packets = sensor(Model::Vlp16).packets(60, wall);
    for packet in &mut packets {
        packet.bytes[1204..].copy_from_slice(&[0x37, 0x21]);
    }
    let datagrams: Vec<Datagram> = packets.iter().map(data).collect();
    let believed = report(&datagrams, &[]);
    let lidar = only_lidar(&believed);
    assert_eq!((lidar.model.as_deref(), lidar.model_source), (Some("hdl-32e"), Some(ModelSource::ProductByte)));
    assert!(lidar.warnings.iter().any(|warning| warning.contains("lidar.model=vlp-16")), "{:?}", lidar.warnings);
    assert_eq!(lidar.loss.map(|loss| loss.lost), Some(0), "the period of the packets counts, not that of the claim");

    let forced = report(&datagrams, &["--set", "lidar.model=vlp-16"]);
    let lidar = only_lidar(&forced);
    assert_eq!((lidar.model.as_deref(), lidar.model_source), (Some("vlp-16"), Some(ModelSource::Config)));
    assert_eq!((lidar.claims[0].product.as_str(), lidar.claims[0].packets), ("hdl-32e", 60));
    assert_eq!(lidar.warnings.len(), 1, "{:?}", lidar.warnings);
    assert!(lidar.warnings[0].contains("firmware before 3.0.29"), "{:?}", lidar.warnings);
    assert_eq!((lidar.points, lidar.return_share), (60 * 384, Some(1.0)));
}

#[test]
fn a_second_sensor_on_the_port_is_counted_apart() {
    let mut datagrams: Vec<Datagram> = sensor(Model::Vlp16).packets(30, wall).iter().map(data).collect();
    for packet in sensor(Model::Vlp32c).packets(7, wall) {
        datagrams.push(data(&packet));
    }
    let report = report(&datagrams, &[]);
    let lidar = only_lidar(&report);
    assert_eq!((lidar.model.as_deref(), lidar.data_packets), (Some("vlp-16"), 30));
    assert_eq!((lidar.rejected.len(), lidar.rejected[0].count), (1, 7));
    assert!(lidar.rejected[0].reason.contains("lidar.source"), "{:?}", lidar.rejected);
    assert_eq!(report.verdict.lidar_payloads_rejected, 7);
}

#[test]
fn two_returns_of_one_shot_are_one_shot() {
    // Slots in turn: nothing, one return in both blocks, two different ones, only the last.
    let mixed = |slot: usize, _t_ns: i64| [(0, 0), (900, 900), (900, 700), (900, 0)][slot % 4];
    let packets = Sensor::new(Model::Vlp32c, ReturnMode::Dual).packets(20, mixed);
    let report = report(&packets.iter().map(data).collect::<Vec<_>>(), &[]);
    let lidar = only_lidar(&report);
    // 20 packets × 6 firings × 32 slots, a quarter of each kind: 960.
    assert_eq!((lidar.returns.both, lidar.returns.last, lidar.returns.strongest), (960, 1_920, 960));
    assert_eq!((lidar.points, lidar.return_share), (3_840, Some(0.75)));
    assert_eq!((lidar.return_modes.len(), lidar.return_modes[0].mode.as_str()), (1, "dual"));
    let range = lidar.range_m.expect("points");
    // 700 and 900 counts of 4 mm; 960 of the 3 840 points are the nearer.
    assert_eq!((range.min, range.median, range.max), (2.8, 3.6, 3.6));
}

#[test]
fn packets_on_another_port_come_with_the_setting_that_reads_them() {
    let mut datagrams: Vec<Datagram> = sensor(Model::Vlp16).packets(30, wall).iter().map(data).collect();
    for datagram in &mut datagrams {
        datagram.port = 2370;
    }
    let missed = report(&datagrams, &[]);
    assert!(missed.lidars.is_empty());
    assert!(missed.inputs[0].hint.as_ref().is_some_and(|hint| hint.contains("lidar.port=2370")), "{missed:#?}");
    assert_eq!((missed.inputs[0].left_out[0].count, missed.inputs[0].left_out[0].lost), (30, false));
    let told = run(&write_pcap(&datagrams), &[]).stdout;
    assert!(told.contains("set lidar.port=2370") && told.contains("Nothing in the inputs"), "{told}");
    assert_eq!(only_lidar(&report(&datagrams, &["--set", "lidar.port=2370"])).data_packets, 30);
}

#[test]
fn a_capture_that_breaks_off_ends_with_code_3_and_the_place() {
    let datagrams: Vec<Datagram> = sensor(Model::Vlp16).packets(30, wall).iter().map(data).collect();
    let whole = write_pcap(&datagrams);
    let cut = &whole[..whole.len() - 700];
    let done = run(cut, &["--json"]);
    assert_eq!(done.code, 3, "{}", done.stderr);
    let report: InfoReport = done.json();
    assert_eq!((report.verdict.inputs_whole, report.inputs[0].whole), (false, false));
    // 24 bytes of file header, 29 records of 16 + 42 + 1206 bytes before the broken one.
    assert_eq!(report.inputs[0].broken_off[0].byte, Some(24 + 29 * 1_264));
    let told = run(cut, &[]);
    assert_eq!(told.code, 3);
    assert!(told.stdout.contains("readable only up to byte 36680"), "{}", told.stdout);
}

#[test]
fn unusable_inputs_end_with_code_2() {
    let bench = Workbench::new();
    bench.file("notes.pcap", "hello, world");
    for arguments in [&["info"][..], &["info", "gone.pcap"], &["info", "notes.pcap"]] {
        let done = bench.run(arguments);
        assert_eq!((done.code, done.stdout.as_str()), (2, ""), "{arguments:?}: {}", done.stderr);
    }
}

#[test]
fn nothing_of_the_report_is_left_out_of_the_json() {
    // Every field is there, null or not: reading the JSON strictly and writing it again gives the same.
    let sensor = limited();
    let packets = sensor.packets(120, wall);
    let done = run(&write_pcap(&with_receiver(&sensor, &packets, nine_o_clock(), Pps::Locked, 0)), &["--json"]);
    let printed: serde_json::Value = serde_json::from_str(&done.stdout).expect("JSON");
    assert_eq!(serde_json::to_value(done.json::<InfoReport>()).expect("serialises"), printed);

    let schema = std::fs::read_to_string(repository().join("docs/schema/info.schema.json")).expect("the schema");
    let schema: serde_json::Value = serde_json::from_str(&schema).expect("JSON");
    let properties = |of: &serde_json::Value| -> Vec<String> {
        let mut names: Vec<String> = of.as_object().expect("an object").keys().cloned().collect();
        names.sort();
        names
    };
    assert_eq!(properties(&printed), properties(&schema["properties"]));
    assert_eq!(properties(&printed["lidars"][0]), properties(&schema["$defs"]["LidarReport"]["properties"]));
    assert_eq!(properties(&printed["inputs"][0]), properties(&schema["$defs"]["InputReport"]["properties"]));
}

#[test]
fn the_text_is_a_table_for_people() {
    let sensor = limited();
    let packets = sensor.packets(120, wall);
    let mut datagrams = with_receiver(&sensor, &packets, nine_o_clock(), Pps::Locked, 0);
    datagrams.retain(|datagram| datagram.payload != packets[33].bytes.to_vec());
    datagrams.push(Datagram { t_ns: 300_000_000, port: 53, payload: vec![0; 80] });
    insta::assert_snapshot!("info_text", run(&write_pcap(&datagrams), &[]).transcript());
}

#[test]
fn an_hdl64e_s2_tells_the_time_with_or_without_its_calibration() {
    // Ten packets of the project's encoder: stamps from 1 s past the hour, status bytes 09:59:59 with GPS status A.
    let capture = repository().join("tests/captures/hdl64e-s2-600rpm.pcap");
    let bytes = std::fs::read(capture).expect("the capture");
    let setting = format!("lidar.calibration={}", repository().join("tests/captures/hdl64e-made.csv").display());
    let report: InfoReport = run(&bytes, &["--json", "--set", &setting]).json();
    let lidar = only_lidar(&report);
    assert_eq!((lidar.data_packets, lidar.loss, lidar.clock.state), (10, Some(NO_LOSS), ClockState::Locked));
    let first = lidar.clock.first_firing.as_ref().map(|t| t.utc.as_str());
    assert_eq!(first, Some("2026-11-22T10:00:01.000000000Z"));
    let hdl64e = lidar.hdl64e.as_ref().expect("an HDL-64E");
    assert_eq!((hdl64e.generation.as_deref(), hdl64e.calibration), (Some("S2"), CalibrationSource::File));
    assert_eq!(hdl64e.date_time.as_deref(), Some("2026-11-22T09:59:59.000000000Z"));

    let report: InfoReport = run(&bytes, &["--json"]).json();
    let lidar = only_lidar(&report);
    assert_eq!((lidar.data_packets, lidar.clock.state), (0, ClockState::Locked));
    let awaiting = lidar.hdl64e.as_ref().and_then(|hdl64e| hdl64e.awaiting.as_ref()).expect("no calibration yet");
    // Of ten packets the first nine are time and unit (H M S D N Y G T V), the tenth carries one byte.
    assert_eq!((awaiting.bytes, awaiting.of), (1, 1_820));
}

/// A fakenect dump of unpacked frames: device ticks and the code all over.
fn dump(bench: &Workbench, frames: &[(u32, u16)]) {
    let mut index = String::new();
    for (k, (ticks, code)) in frames.iter().enumerate() {
        let name = format!("d-{}.{:06}-{ticks}.pgm", 1_000, k * 40_000);
        let payload = encode_raw(&RawImage::filled(RawDisparity(*code)), DepthEncoding::Raw11).expect("eleven bits");
        bench.file(&format!("dump/{name}"), [b"P5 640 480 65535\n".as_slice(), &payload].concat());
        index.push_str(&format!("{name}\n"));
    }
    bench.file("dump/INDEX.txt", index);
}

#[test]
fn a_kinect_is_timed_by_its_own_counter() {
    let bench = Workbench::new();
    // Two million ticks a frame: the third frame of four is missing, across the counter's wrap.
    let start = u32::MAX - 2_999_999;
    let ticks = [0, 2_000_000, 6_000_000].map(|after: u32| start.wrapping_add(after));
    dump(&bench, &[(ticks[0], 700), (ticks[1], 701), (ticks[2], 2_047)]);
    let done = bench.run(&["info", "dump", "--json"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let report: InfoReport = done.json();
    let [kinect] = report.kinects.as_slice() else { panic!("{report:#?}") };
    assert_eq!((kinect.frames, kinect.encodings[0].encoding), (3, Encoding::Raw11));
    assert_eq!((kinect.first_ticks, kinect.last_ticks), (Some(ticks[0]), Some(ticks[2])));
    assert_eq!((kinect.frames_missing, kinect.repeated), (Some(1), 0));
    // Two steps in six million ticks of 60 MHz.
    assert!(kinect.rate_hz.is_some_and(|hz| (hz - 20.0).abs() < 1e-6), "{:?}", kinect.rate_hz);
    // The third frame has no data at all.
    let share = kinect.valid_share.expect("decoded");
    assert_eq!((share.mean, share.min), (2.0 / 3.0, 0.0));
    assert_eq!(report.verdict.kinect_frames_missing, 1);
}

#[test]
fn a_frozen_kinect_and_a_damaged_dump_are_told() {
    let bench = Workbench::new();
    dump(&bench, &[(0, 700), (2_000_000, 700), (4_000_000, 700)]);
    let report: InfoReport = bench.run(&["info", "dump", "--json"]).json();
    assert_eq!(report.kinects[0].repeated, 2);
    assert_eq!(report.verdict.kinect_frames_repeated, 2);

    // The second frame's file is half there.
    let name = "dump/d-1000.040000-2000000.pgm";
    bench.file(name, &std::fs::read(bench.path(name)).expect("the frame")[..300_000]);
    let done = bench.run(&["info", "dump", "--json"]);
    let report: InfoReport = done.json();
    assert_eq!((done.code, report.kinects[0].frames, report.verdict.inputs_whole), (3, 2, false));
}

#[test]
fn frames_without_times_have_no_rate() {
    let Some(folder) = real("kinect/seq7") else { return };
    let report: InfoReport = Workbench::new().run(&["info", folder.to_str().expect("UTF-8"), "--json"]).json();
    let kinect = &report.kinects[0];
    assert_eq!((kinect.frames, kinect.rate_hz, kinect.frames_missing), (60, None, None));
    assert_eq!((&report.epoch_unix_ns, &report.inputs[0].first), (&None, &None));
    let share = kinect.valid_share.expect("decoded");
    // The data's description: 7.6 to 11.5 % invalid, without the pixels of 10 m and more.
    assert!((0.88..0.93).contains(&share.mean), "{share:?}");
}

fn real_lidar(name: &str, arguments: &[&str]) -> Option<LidarReport> {
    let path = real(&format!("velodyne/{name}"))?;
    let arguments = [&["info", path.to_str().expect("UTF-8"), "--json"], arguments].concat();
    let done = Workbench::new().run(&arguments);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let report: InfoReport = done.json();
    Some(only_lidar(&report).clone())
}

#[test]
fn real_vlp16_with_a_receiver() {
    let Some(lidar) = real_lidar("vlp16_strongest_gps_600rpm.pcap", &[]) else { return };
    assert_eq!((lidar.clock.state, lidar.loss), (ClockState::Locked, Some(NO_LOSS)));
    // Stamp 1 082 340 595 µs, 18 min 2.340595 s; sentence 081802.00 of 21 January 2016.
    let first = lidar.clock.first_firing.expect("locked");
    assert_eq!(first.utc, "2016-01-21T08:18:02.340595000Z");
    assert_eq!((lidar.data_packets, lidar.position_packets, lidar.clock.sentences.valid), (150, 30, 30));
    assert!(lidar.rpm.is_some_and(|rpm| (rpm - 599.1).abs() < 0.1), "{:?}", lidar.rpm);
}

#[test]
fn real_hdl32e_that_never_reports_a_pulse() {
    let Some(lidar) = real_lidar("hdl32e_strongest_gps_700rpm.pcap", &[]) else { return };
    assert_eq!((lidar.clock.state, lidar.loss), (ClockState::Sentence, Some(NO_LOSS)));
    assert_eq!((lidar.model.as_deref(), lidar.warnings.as_slice()), (Some("hdl-32e"), &[][..]));
}

#[test]
fn real_vlp32c_with_a_limited_view() {
    let Some(lidar) = real_lidar("vlp32c_strongest_600rpm_fov180_a.pcap", &[]) else { return };
    let view = lidar.field_of_view.expect("known");
    // Block azimuths end at 90.95° and begin at 270.12°, a firing of 0.2° more or less.
    assert!(view.limited && (view.from_deg - 270.1).abs() < 0.2 && (view.to_deg - 91.0).abs() < 0.2, "{view:?}");
    assert_eq!((lidar.loss.map(|loss| (loss.lost, loss.pauses)), lidar.points), (Some((0, 2)), 78_978));
}

#[test]
fn real_hdl64e_s1_waits_for_its_calibration() {
    let Some(lidar) = real_lidar("hdl64e_s1_600rpm_a.pcap", &[]) else { return };
    let hdl64e = lidar.hdl64e.expect("an HDL-64E");
    assert_eq!((hdl64e.calibration, hdl64e.firmware.as_deref()), (CalibrationSource::None, Some("v25c")));
    assert_eq!((lidar.data_packets, lidar.rejected[0].count, lidar.loss), (0, 153, None));

    let Some(calibration) = real("velodyne/hdl64e_calibration.csv") else { return };
    let setting = format!("lidar.calibration={}", calibration.display());
    let Some(lidar) = real_lidar("hdl64e_s1_600rpm_a.pcap", &["--set", &setting]) else { return };
    let hdl64e = lidar.hdl64e.expect("an HDL-64E");
    assert_eq!((hdl64e.calibration, hdl64e.generation.as_deref()), (CalibrationSource::File, Some("S1")));
    assert_eq!((lidar.clock.state, lidar.data_packets), (ClockState::None, 153));
    assert_eq!((lidar.model_source, lidar.first_stamp_us), (Some(ModelSource::BlockStructure), None));
}
