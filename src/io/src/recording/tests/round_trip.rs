//! Writing and reading back.

use super::*;
use crate::recording::{AttachedFile, ChannelKey, ChannelKind, InputFile, PartEnd, digest_of};
use bytes::Bytes;
use std::fs;
use tumbled_model::Span;

proptest! {
    // Each case brings a file to the medium, which takes its time.
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases.min(64), ..ProptestConfig::default() })]

    #[test]
    fn arbitrary_events_come_back_to_the_bit(events in any_events(40)) {
        let (_folder, path) = folder();
        let summary = record(&path, &events, RecorderOptions::default());
        prop_assert_eq!(summary.unrecordable, 0);
        let (back, info) = read(&[&path]);
        prop_assert_eq!(&back, &events);
        prop_assert!(info.whole(), "{:?}", info);
        prop_assert_eq!(&info.counters, &summary.counters);
        prop_assert_eq!(info.parts[0].end.as_ref(), Some(&PartEnd::Finished));
    }

    #[test]
    fn the_same_events_make_the_same_bytes(events in any_events(40)) {
        let (_folder, path) = folder();
        let twin = path.with_file_name("twin.mcap");
        record(&path, &events, RecorderOptions::default());
        record(&twin, &events, RecorderOptions::default());
        prop_assert!(fs::read(&path).unwrap() == fs::read(&twin).unwrap());
    }
}

#[test]
fn the_header_comes_back_whole() {
    let (_folder, path) = folder();
    let input = |name: &str| InputFile { name: name.to_owned(), bytes: 7, blake3: "ab".repeat(32) };
    let written = RecordingHeader {
        origin: Origin::Simulated,
        synthetic_times: true,
        files: vec![
            AttachedFile::new("rig.calibration", "cal.toml", Bytes::from_static(b"t = 1\n")),
            AttachedFile::new("lidar.front.calibration", "db.xml", noise(5_000, 3).into()),
            AttachedFile::new("kinect.near.depth_table", "empty.csv", Bytes::new()),
        ],
        // Eleven, so that an order by text ("10" before "2") would show.
        inputs: (0..11).map(|n| input(&format!("in.{n}.pcap"))).collect(),
        notes: [("operator".to_owned(), "Ada = \"1\"\n".to_owned())].into(),
        ..header("a b")
    };
    let recorder = Recorder::create(&path, written.clone(), RecorderOptions::default()).unwrap();
    recorder.finish();
    assert_eq!(Reader::open(&[&path]).unwrap().header(), &written);
}

#[test]
fn counters_tell_events_bytes_silences_and_losses() {
    let (_folder, path) = folder();
    let gap = Body::Gap { sensor: SensorId::from("front"), lost: 5, place: LossPoint::Kernel };
    let events = [
        lidar(0, 10, &[1; 1206]),
        tick(1, 20),
        lidar(2, 40, &[2; 1206]),
        Event { seq: 5, arrived: RigNs(41), body: gap },
        lidar(6, 45, &[3; 1206]),
    ];
    record(&path, &events, RecorderOptions::default());
    let (_, info) = read(&[&path]);
    let packets = ChannelKey { kind: ChannelKind::LidarPackets, sensor: Some(SensorId::from("front")) };
    let count = &info.counters.channels[&packets];
    // Three packets of 1206 bytes at 10, 40 and 45.
    assert_eq!((count.events, count.bytes, count.longest_gap), (3, 3618, Span(30)));
    assert_eq!(info.counters.lost[&(SensorId::from("front"), LossPoint::Kernel)], 5);
    // 3 and 4 are not there.
    assert_eq!((info.counters.missing_seqs, info.counters.last_seq), (2, Some(6)));
    assert!(info.whole(), "what was never recorded is not lost by the file");
}

#[test]
fn log_times_rise_strictly_though_arrivals_do_not() {
    let (_folder, path) = folder();
    let events = [lidar(0, 500, b"a"), lidar(1, 100, b"b"), lidar(2, 500, b"c"), lidar(3, 700, b"d")];
    record(&path, &events, RecorderOptions::default());
    let file = fs::read(&path).unwrap();
    let messages = mcap::MessageStream::new(&file).unwrap().collect::<Result<Vec<_>, _>>().unwrap();
    let at: Vec<_> = messages.iter().map(|message| message.log_time as i64 - START.0).collect();
    let emitted: Vec<_> = messages.iter().map(|message| message.publish_time as i64 - START.0).collect();
    // 500; 100 is before it: + 1; so is 500; 700 is later.
    assert_eq!(at, [500, 501, 502, 700]);
    assert_eq!(emitted, [500, 100, 500, 700]);
    assert!(messages.iter().all(|message| message.channel.topic == "/lidar/front/packets"));
}

#[test]
fn a_public_reader_counts_the_same_messages() {
    let (_folder, path) = folder();
    let events: Vec<_> = (0..3000).map(|n| lidar(n, n as i64 * 663_000, &noise(1206, n))).collect();
    let summary = record(&path, &events, RecorderOptions::default());
    let file = fs::read(&path).unwrap();
    let stats = mcap::Summary::read(&file).unwrap().expect("a summary").stats.expect("statistics");
    assert_eq!(stats.message_count, summary.counters.events);
    assert_eq!(summary.file_bytes, file.len() as u64);
}

#[test]
fn an_event_too_large_to_be_read_back_is_refused_and_counted() {
    let (_folder, path) = folder();
    let large = vec![0; crate::recording::layout::MAX_MESSAGE_BYTES];
    let events = [lidar(0, 0, b"a"), lidar(1, 1, &large), lidar(2, 2, b"b")];
    let summary = record(&path, &events, RecorderOptions::default());
    assert_eq!((summary.counters.events, summary.unrecordable), (2, 1));
    assert_eq!(read(&[&path]).0, [events[0].clone(), events[2].clone()]);
}

#[test]
fn texts_are_recorded_up_to_their_limits_and_refused_beyond() {
    let (_folder, path) = folder();
    let marker = |bytes| Body::Command(Command::Marker { text: "m".repeat(bytes).into() });
    let config = |bytes| Body::Config { toml: "c".repeat(bytes).into() };
    let bodies = [marker(1_024), marker(1_025), config(1 << 20), config((1 << 20) + 1), marker(0)];
    let events: Vec<_> = (0..).zip(bodies).map(|(seq, body)| Event { seq, arrived: RigNs(0), body }).collect();
    let summary = record(&path, &events, RecorderOptions::default());
    assert_eq!((summary.counters.events, summary.unrecordable), (3, 2));
    assert_eq!(read(&[&path]).0, [events[0].clone(), events[2].clone(), events[4].clone()]);
}

#[test]
fn texts_that_are_no_utf_8_too_long_or_of_an_unknown_order_are_no_events() {
    let ledger = ChannelKey { kind: ChannelKind::Ledger, sensor: None };
    let decode = |body: &[u8]| crate::recording::layout::decode(&ledger, &[&[0; 16], body].concat().into());
    let marker = |text: &[u8]| decode(&[&[6, 0], text].concat());
    let config = |toml: &[u8]| decode(&[&[7], toml].concat());
    assert!(marker(&[b'a'; 1_024]).is_some() && marker(&[b'a'; 1_025]).is_none());
    assert!(config(&[b'a'; 1 << 20]).is_some() && config(&[b'a'; (1 << 20) + 1]).is_none());
    // 0xff begins no character; 0xc3 begins one that does not end.
    assert!(marker(b"\xff").is_none() && config(b"name = \"\xc3").is_none());
    assert!(decode(&[6]).is_none() && decode(&[6, 1, b'a']).is_none(), "no order, an order nobody knows");
}

#[test]
fn digest_is_that_of_the_content_and_the_name_has_no_folder() {
    let (folder, _) = folder();
    let path = folder.path().join("x.pcap");
    fs::write(&path, b"").unwrap();
    // BLAKE3 of nothing (its specification's first test vector).
    let expected = "af1349b9f5f9a1a6a0404dea36dcc9499bcb25c9adc112b7cc9a93cae41f3262";
    let digest = digest_of(&path).unwrap();
    assert_eq!((digest.name.as_str(), digest.bytes, digest.blake3.as_str()), ("x.pcap", 0, expected));
    let (before, name) = (digest_of(folder.path()).unwrap(), folder.path().file_name().unwrap());
    assert_eq!(before.name, format!("{}/", name.to_string_lossy()));
    fs::rename(&path, folder.path().join("y.pcap")).unwrap();
    assert_ne!(digest_of(folder.path()).unwrap().blake3, before.blake3, "names are part of a folder");
}
