//! Devices whose every measurement is known, behind a transport with delays.

use super::chance::Chance;
use super::ledger::{MS, Source, US};
use super::rig::{KINECT, LIDAR, TABLE};
use crate::synth::{Packet, Sensor};
use bytes::Bytes;
use std::sync::OnceLock;
use tumbled_kinect::{MmImage, encode_mm};
use tumbled_model::{Body, DepthEncoding, KinectTicks, LidarTime, PacketMask, SensorId};
use tumbled_serial::zaber::{Address, Command, Message, MessageId, Reply, Request, Setting, Warning};
use tumbled_velodyne::encode::DataPacketBuilder;
use tumbled_velodyne::{Model, ReturnMode};

/// From firing to firing of a VLP-32C, ns.
pub(crate) const FIRING_NS: i64 = 55_296;
/// The lasers that see something, in packet order: few, so that sessions are quick to make and to compare.
pub(crate) const LASERS: [usize; 3] = [0, 13, 31];
/// Firings are numbered in the distances they measure, from 1000 counts of 4 mm on.
const FIRST_COUNT: i64 = 1_000;
const COUNTS: i64 = 60_000;

/// A VLP-32C, 600 rpm, strongest return, that sees all around from straight back on.
pub(crate) fn vlp32c() -> Sensor {
    Sensor { start_deg: 180.0, ..Sensor::new(Model::Vlp32c, ReturnMode::Strongest) }
}

/// The packets of so many ns. Each firing's number is in the distance that its lasers measure.
pub(crate) fn packets(sensor: &Sensor, ns: i64) -> Vec<Packet> {
    let view = sensor.silent_deg.map_or(1.0, |(from, to)| 1.0 - (to - from).rem_euclid(360.0) / 360.0);
    let per_packet = 12 / sensor.mode.blocks_per_firing() as i64 * FIRING_NS;
    let mut packets = sensor.packets((ns as f64 * view) as usize / per_packet as usize, |slot, t_ns| {
        let count = (FIRST_COUNT + (t_ns / FIRING_NS) % COUNTS) as u16;
        if LASERS.contains(&slot) { (count, count) } else { (0, 0) }
    });
    packets.retain(|packet| packet.t_ns < ns);
    packets
}

/// A firing by its distance: its number, modulo 60000 (3.3 s).
pub(crate) fn firing_of(range_m: f32) -> i64 {
    (f64::from(range_m) / 0.004).round() as i64 - FIRST_COUNT
}

/// How a device's data get to the host.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Way {
    /// Rig time of the device's time 0, ns.
    pub(crate) start_ns: i64,
    /// The host's clock gains so many ppm on the device's.
    pub(crate) skew_ppm: i64,
    /// The least delay, and the mean of what comes on top, ns.
    pub(crate) least_ns: i64,
    pub(crate) jitter_ns: i64,
}

impl Way {
    /// No delay, no skew.
    pub(crate) const PERFECT: Self = Self { start_ns: 0, skew_ppm: 0, least_ns: 0, jitter_ns: 0 };
    /// A socket: 20 ppm, 0.1 ms, and 0.06 ms more.
    pub(crate) const UDP: Self = Self { skew_ppm: 20, least_ns: 100 * US, jitter_ns: 60 * US, ..Self::PERFECT };
    /// A camera on USB: −35 ppm, 30 ms, and 0.75 ms more.
    pub(crate) const USB: Self = Self { skew_ppm: -35, least_ns: 30 * MS, jitter_ns: 750 * US, ..Self::PERFECT };

    /// Rig time of a device time, without the delay.
    pub(crate) fn rig(&self, device_ns: i64) -> i64 {
        self.start_ns + device_ns + device_ns / 1_000 * self.skew_ppm / 1_000
    }
}

/// Packets with their arrivals: each leaves when its last firing is over, none overtakes another.
pub(crate) fn lidar(packets: &[Packet], way: Way, seed: u64) -> Source {
    let mut chance = Chance::new(seed);
    let mut newest = 0;
    let arrival = |packet: &Packet| {
        let sent = packet.group_t_ns.last().copied().unwrap_or(0) + FIRING_NS;
        newest = (way.rig(sent) + way.least_ns + chance.delay(way.jitter_ns)).max(newest);
        (newest, lidar_packet(&packet.bytes))
    };
    packets.iter().map(arrival).collect()
}

/// A packet as the ledger has it.
pub(crate) fn lidar_packet(bytes: &[u8]) -> Body {
    Body::LidarPacket { sensor: SensorId::from(LIDAR), bytes: Bytes::copy_from_slice(bytes) }
}

/// Frames from 0 to `until_ns` of the device's time, 30 a second.
pub(crate) fn kinect(until_ns: i64, way: Way, seed: u64) -> Source {
    let mut chance = Chance::new(seed);
    let mut newest = 0;
    let frame = |n: i64| {
        newest = (way.rig(n * 100 * MS / 3) + way.least_ns + chance.delay(way.jitter_ns)).max(newest);
        (newest, depth_frame(n, Some(KinectTicks((n * 2_000_000) as u32))))
    };
    (0..until_ns * 3 / (100 * MS)).map(frame).collect()
}

/// A depth frame that differs from those before and after it: 64 pixels about 2 m away.
pub(crate) fn depth_frame(n: i64, ticks: Option<KinectTicks>) -> Body {
    static FRAMES: OnceLock<Vec<Bytes>> = OnceLock::new();
    let frames = FRAMES.get_or_init(|| {
        let frame = |n: u16| {
            let mut image = MmImage::new();
            image.pixels_mut()[100_000..100_064].fill(2_000 + n);
            Bytes::from(encode_mm(&image))
        };
        (0..8).map(frame).collect()
    });
    Body::DepthFrame {
        sensor: SensorId::from(KINECT),
        ticks,
        encoding: DepthEncoding::Mm16,
        lost_packets: PacketMask::NONE,
        bytes: frames[n.rem_euclid(8) as usize].clone(),
    }
}

/// Pixels with a depth in each of the frames.
pub(crate) const KINECT_POINTS: u64 = 64;

/// A chunk on the turntable's line.
pub(crate) fn chunk(bytes: Vec<u8>) -> Body {
    Body::SerialChunk { sensor: SensorId::from(TABLE), bytes: Bytes::from(bytes) }
}

/// A question and its answer: the request has left at `at`, the reply is there 2 ms later.
pub(crate) fn asked(n: i64, at: i64, setting: Setting, warning: Warning, data: i64) -> [(i64, Body); 2] {
    let id = MessageId::new((n.rem_euclid(100)) as u8).expect("below 100");
    let axis = Address { device: 1, axis: 1 };
    let request = Request::new(axis, id, Command::Get(setting));
    let reply =
        Reply { address: request.address, id: request.id, accepted: true, busy: true, warning, data: data.to_string() };
    [(at, chunk(request.encode())), (at + 2 * MS, chunk(Message::Reply(reply).encode(true)))]
}

/// A turntable of 36 000 counts a turn that is asked every 50 ms where it is, and turns by 1° meanwhile.
pub(crate) fn serial(until_ns: i64) -> Source {
    let position = |n: i64| asked(n, n * 50 * MS + 7 * MS, Setting::EncoderPos, Warning::NONE, 100 * n);
    let first = asked(-1, 0, Setting::LimitCycleDist, Warning::NONE, 36_000);
    first.into_iter().chain((0..until_ns / (50 * MS)).flat_map(position)).collect()
}

/// A source without what it sent between two times.
pub(crate) fn silent_between(source: &mut Source, from_ns: i64, to_ns: i64) {
    source.retain(|(arrived, _)| !(from_ns..to_ns).contains(arrived));
}

/// The packets of a VLP-32C whose head stands where `azimuth_deg` says, every firing `count` counts of 4 mm away.
pub(crate) fn packets_by(ns: i64, count: u16, azimuth_deg: impl Fn(i64) -> f64) -> Vec<Packet> {
    let packet = |n: i64| {
        let t_ns = n * 12 * FIRING_NS;
        let group_t_ns: Vec<i64> = (0..12).map(|block| t_ns + block * FIRING_NS).collect();
        let mut builder = DataPacketBuilder::new(Model::Vlp32c, ReturnMode::Strongest);
        for (block, t_ns) in group_t_ns.iter().enumerate() {
            let cdeg = (azimuth_deg(*t_ns).rem_euclid(360.0) * 100.0).round() as u32 % 36_000;
            let slots = core::array::from_fn(|slot| (if LASERS.contains(&slot) { count } else { 0 }, 100));
            builder.block(block, cdeg as u16, &slots);
        }
        builder.stamp(LidarTime(((t_ns + 500) / 1_000) as u32));
        Packet { bytes: builder.build(), t_ns, group_t_ns, has_jump: false }
    };
    (0..ns / (12 * FIRING_NS)).map(packet).collect()
}
