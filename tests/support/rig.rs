//! A rig that sends what a real one does, at its rates, for as long as is wanted: its ledger, made event by event.
//!
//! A VLP-32C at 600 rpm, single return; a Kinect at 30 Hz; ticks and anchors. Nothing is lost and nothing is random: the
//! same rig makes the same ledger every time.

use std::path::Path;

use bytes::Bytes;
use tumbled::cli::Failure;
use tumbled::session::{Engine, setup};
use tumbled_core::{CoreConfig, Workers};
use tumbled_io::recording::{Origin, Recorder, RecorderOptions, RecordingHeader};
use tumbled_kinect::encode_raw;
use tumbled_kinect::{RawDisparity, RawImage, ZeroPlane};
use tumbled_model::{Body, DepthEncoding, Event, KinectTicks, PacketMask, RigNs, Span, UnixNs};
use tumbled_velodyne::encode::DataPacketBuilder;
use tumbled_velodyne::wire::{BLOCK_LEN, BLOCKS, DATA_LEN};
use tumbled_velodyne::{Model, ReturnMode};

use super::pcap::START_UNIX_S;

/// From firing to firing of a VLP-32C, single return: 24 firings of 2.304 µs.
const BLOCK_NS: i64 = 55_296;
/// From packet to packet: 1 507 a second.
pub(crate) const PACKET_NS: i64 = 12 * BLOCK_NS;
/// A turn at 600 rpm.
pub(crate) const TURN_NS: i64 = 100_000_000;
/// Points of a packet: every firing hits something.
pub(crate) const PACKET_POINTS: u64 = 384;
/// Frames a second.
pub(crate) const FRAME_HZ: i64 = 30;
/// The Kinect's clock.
const KINECT_HZ: i64 = 60_000_000;
/// Its first stamp: the counter of 32 bits wraps after 3 s, and then every 71.6 s.
const FIRST_TICKS: u32 = u32::MAX - 3 * KINECT_HZ as u32;
/// The LiDAR's first stamp: its hour ends after 2 s.
const FIRST_STAMP_US: i64 = 3_598_000_000;
/// The least time from a measurement to its arrival.
pub(crate) const LIDAR_DELAY_NS: i64 = PACKET_NS + 60_000;
/// The same for a frame: it is read out and sent for most of its 33 ms.
pub(crate) const KINECT_DELAY_NS: i64 = 25_000_000;
/// Arrivals come later by up to this.
const JITTER_NS: i64 = 200_000;
/// Different frames, sent in turn: no two that follow each other are the same.
const FRAMES: usize = 16;

/// What a rig sends from its start on, without end.
pub(crate) struct Rig {
    packet: [u8; DATA_LEN],
    frames: Vec<Bytes>,
    seq: u64,
    /// The next of each, and when it arrives.
    anchor: Next,
    tick: Next,
    frame: Next,
    data: Next,
}

#[derive(Clone, Copy)]
struct Next {
    number: i64,
    at: i64,
}

impl Rig {
    /// A rig whose Kinect sees a target of so many columns and rows, 2 m away, before nothing.
    pub(crate) fn new(columns: usize, rows: usize) -> Self {
        let slots = core::array::from_fn(|slot| (500 + slot as u16, 100)); // 2 m
        let mut builder = DataPacketBuilder::new(Model::Vlp32c, ReturnMode::Strongest);
        (0..BLOCKS).for_each(|block| {
            builder.block(block, 0, &slots);
        });
        let frames = (0..FRAMES).map(|n| depth_frame(n, columns, rows)).collect();
        let first = |at: i64| Next { number: 0, at };
        Self {
            packet: builder.build(),
            frames,
            seq: 0,
            anchor: first(0),
            tick: Next { number: 1, at: 100_000_000 },
            frame: first(KINECT_DELAY_NS),
            data: first(LIDAR_DELAY_NS),
        }
    }

    fn data_packet(&mut self, number: i64) -> Bytes {
        let began = number * PACKET_NS;
        for block in 0..BLOCKS {
            let t_ns = began + block as i64 * BLOCK_NS;
            // 36 000 hundredths of a degree in 100 ms.
            let azimuth = (t_ns * 36 / 100_000 % 36_000) as u16;
            let at = block * BLOCK_LEN + 2;
            self.packet[at..at + 2].copy_from_slice(&azimuth.to_le_bytes());
        }
        let stamp = (FIRST_STAMP_US + (began + 500) / 1_000) % 3_600_000_000;
        self.packet[DATA_LEN - 6..DATA_LEN - 2].copy_from_slice(&(stamp as u32).to_le_bytes());
        Bytes::copy_from_slice(&self.packet)
    }

    fn take_data(&mut self) -> Body {
        let bytes = self.data_packet(self.data.number);
        let number = self.data.number + 1;
        self.data = Next { number, at: number * PACKET_NS + LIDAR_DELAY_NS + jitter(number) };
        Body::LidarPacket { sensor: "front".into(), bytes }
    }

    fn take_frame(&mut self) -> Body {
        let shown = self.frame.number;
        let ticks = FIRST_TICKS.wrapping_add((shown * KINECT_HZ / FRAME_HZ) as u32);
        let number = shown + 1;
        let at = number * 1_000_000_000 / FRAME_HZ + KINECT_DELAY_NS + jitter(number);
        self.frame = Next { number, at };
        Body::DepthFrame {
            sensor: "near".into(),
            ticks: Some(KinectTicks(ticks)),
            encoding: DepthEncoding::Packed11,
            lost_packets: PacketMask::NONE,
            bytes: self.frames[shown as usize % FRAMES].clone(),
        }
    }
}

impl Iterator for Rig {
    type Item = Event;

    fn next(&mut self) -> Option<Event> {
        let at = [self.anchor.at, self.tick.at, self.frame.at, self.data.at].into_iter().min()?;
        let body = if at == self.anchor.at {
            let number = self.anchor.number + 1;
            self.anchor = Next { number, at: number * 1_000_000_000 };
            Body::Anchor { unix: UnixNs(START_UNIX_S * 1_000_000_000) + Span(at) }
        } else if at == self.tick.at {
            let number = self.tick.number + 1;
            self.tick = Next { number, at: number * 100_000_000 };
            Body::Tick
        } else if at == self.frame.at {
            self.take_frame()
        } else {
            self.take_data()
        };
        let seq = self.seq;
        self.seq += 1;
        Some(Event { seq, arrived: RigNs(at), body })
    }
}

/// Spread over the jitter by a multiplicative hash.
fn jitter(number: i64) -> i64 {
    ((number as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 33) as i64 % JITTER_NS
}

/// A target in the middle of nothing; `n` shifts its relief.
fn depth_frame(n: usize, columns: usize, rows: usize) -> Bytes {
    let near = ZeroPlane::default().code_at(2.0).expect("2 m is in range").0;
    let (left, top) = ((640 - columns) / 2, (480 - rows) / 2);
    let image = RawImage::from_fn(|u, v| {
        let inside = (left..left + columns).contains(&u) && (top..top + rows).contains(&v);
        if inside { RawDisparity(near + ((u + v + n) % 8) as u16) } else { RawDisparity::NO_DATA }
    });
    encode_raw(&image, DepthEncoding::Packed11).expect("eleven bits").into()
}

/// What a recording of such a rig says of itself.
pub(crate) fn header() -> RecordingHeader {
    RecordingHeader {
        session: "made".to_owned(),
        origin: Origin::Import,
        program: "test".to_owned(),
        unix_at_zero: UnixNs(START_UNIX_S * 1_000_000_000),
        ..RecordingHeader::default()
    }
}

/// The data packets of the LiDAR alone, without end.
pub(crate) fn packets() -> impl Iterator<Item = Bytes> {
    Rig::new(1, 1).filter_map(|event| match event.body {
        Body::LidarPacket { bytes, .. } => Some(bytes),
        _ => None,
    })
}

/// The core of the built-in rig, without its Kinect.
pub(crate) fn lidar_core() -> CoreConfig {
    let config = tumbled::config::load(None, &[]).expect("the built-in config").config;
    CoreConfig { kinects: Vec::new(), ..setup::core_config(&config).expect("a core") }
}

/// That core with its chain, on one thread.
pub(crate) fn lidar_engine() -> Engine {
    Engine::new(
        lidar_core(),
        String::new(),
        Workers::none(),
        Box::new(|_| Err(Failure::input("no changed config here"))),
    )
}

/// Records the first `time` of a rig, as `import` would: no checkpoints. Gives the number of events.
pub(crate) fn record(rig: Rig, time: Span, path: &Path) -> u64 {
    let mut recorder = Recorder::create(path, header(), RecorderOptions::default()).expect("begins");
    let mut events = 0;
    for event in rig.take_while(|event| event.arrived.0 < time.0) {
        assert!(recorder.write(&event));
        events += 1;
    }
    assert!(recorder.finish().stopped.is_none());
    events
}
