//! What is recorded comes back to the bit; what is lost is told.

mod as_input;
mod attached;
mod damage;
mod failing;
mod kill;
mod parts;
mod queue;
mod rate;
mod round_trip;

use super::{Origin, Reader, Recorder, RecorderOptions, RecordingHeader, RecordingInfo, RecordingSummary};
use proptest::prelude::*;
use std::path::{Path, PathBuf};
use tumbled_model::{
    Body, Command, DepthEncoding, Event, KinectTicks, LossPoint, PacketMask, RigNs, SensorId, SourceState, UnixNs,
};

/// 22 November 2026, 10:00:00 UTC.
const START: UnixNs = UnixNs(1_795_341_600_000_000_000);

fn header(session: &str) -> RecordingHeader {
    RecordingHeader {
        session: session.to_owned(),
        origin: Origin::Live,
        program: "0.1.0 (test)".to_owned(),
        unix_at_zero: START,
        config: "[rig]\nname = \"lab\"\n".to_owned(),
        ..RecordingHeader::default()
    }
}

fn lidar(seq: u64, arrived: i64, payload: &[u8]) -> Event {
    let body = Body::LidarPacket { sensor: SensorId::from("front"), bytes: payload.to_vec().into() };
    Event { seq, arrived: RigNs(arrived), body }
}

fn tick(seq: u64, arrived: i64) -> Event {
    Event { seq, arrived: RigNs(arrived), body: Body::Tick }
}

/// Payload that does not compress: a multiplicative generator's high bytes.
fn noise(length: usize, seed: u64) -> Vec<u8> {
    let mut state = seed | 1;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 56) as u8
    };
    (0..length).map(|_| next()).collect()
}

fn record(path: &Path, events: &[Event], options: RecorderOptions) -> RecordingSummary {
    let mut recorder = Recorder::create(path, header("s"), options).expect("a new file");
    for event in events {
        recorder.write(event);
    }
    recorder.finish()
}

fn read<P: AsRef<Path>>(paths: &[P]) -> (Vec<Event>, RecordingInfo) {
    let mut reader = Reader::open(paths).expect("a recording");
    let events = reader.by_ref().collect::<Result<_, _>>().expect("the disk reads");
    (events, reader.info().clone())
}

fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("session.mcap");
    (folder, path)
}

fn any_bytes(max: usize) -> impl Strategy<Value = bytes::Bytes> {
    prop::collection::vec(any::<u8>(), 0..max).prop_map(bytes::Bytes::from)
}

fn any_sensor() -> impl Strategy<Value = SensorId> {
    // Names with slashes, dots, blanks and none at all are names too.
    prop_oneof![Just("front"), Just("näher/2"), Just(""), Just("a.b c")].prop_map(SensorId::from)
}

fn any_body() -> impl Strategy<Value = Body> {
    let encoding = prop_oneof![Just(DepthEncoding::Packed11), Just(DepthEncoding::Raw11), Just(DepthEncoding::Mm16)];
    let mask = prop::collection::vec(0..PacketMask::PACKETS, 0..5).prop_map(|lost| {
        let mut mask = PacketMask::NONE;
        lost.into_iter().for_each(|packet| mask.mark_lost(packet));
        mask
    });
    let state = prop_oneof![Just(SourceState::Opened), Just(SourceState::Lost), Just(SourceState::Closed)];
    let place = prop_oneof![
        Just(LossPoint::Kernel),
        Just(LossPoint::Queue),
        Just(LossPoint::Usb),
        Just(LossPoint::Recorder),
        Just(LossPoint::Capture)
    ];
    prop_oneof![
        (any_sensor(), any_bytes(300)).prop_map(|(sensor, bytes)| Body::LidarPacket { sensor, bytes }),
        (any_sensor(), any::<Option<u32>>(), encoding, mask, any_bytes(300)).prop_map(
            |(sensor, ticks, encoding, lost_packets, bytes)| Body::DepthFrame {
                sensor,
                ticks: ticks.map(KinectTicks),
                encoding,
                lost_packets,
                bytes
            }
        ),
        (any_sensor(), any_bytes(40)).prop_map(|(sensor, bytes)| Body::SerialChunk { sensor, bytes }),
        (any_sensor(), any_bytes(40)).prop_map(|(sensor, bytes)| Body::DeviceTables { sensor, bytes }),
        (any_sensor(), state).prop_map(|(sensor, state)| Body::SensorState { sensor, state }),
        (any_sensor(), any::<u16>()).prop_map(|(sensor, scans)| Body::Skip { sensor, scans }),
        (any_sensor(), any::<u32>(), place).prop_map(|(sensor, lost, place)| Body::Gap { sensor, lost, place }),
        any::<i64>().prop_map(|unix| Body::Anchor { unix: UnixNs(unix) }),
        ".{0,256}".prop_map(|text| Body::Command(Command::Marker { text: text.into() })),
        "(?s).{0,400}".prop_map(|toml| Body::Config { toml: toml.into() }),
        Just(Body::Tick),
    ]
}

/// Events with any times, numbers and bodies: the recorder does not judge them.
fn any_events(max: usize) -> impl Strategy<Value = Vec<Event>> {
    let event = (any::<u64>(), any::<i64>(), any_body());
    let event = event.prop_map(|(seq, arrived, body)| Event { seq, arrived: RigNs(arrived), body });
    prop::collection::vec(event, 0..max)
}
