//! Real sockets on loopback, real packets, scripted clocks.

#![allow(dead_code, reason = "each test binary uses its own part")]

use bytes::Bytes;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::Mutex;
use std::time::Duration;
use tumbled_io::live::{EventReceiver, HostClock, HostSample, UdpConfig};
use tumbled_model::{Body, Event, LidarTime, LossPoint, RigNs, SensorId, Span, UnixNs};
use tumbled_velodyne::encode::DataPacketBuilder;
use tumbled_velodyne::{Model, ReturnMode};

/// How long a test waits for what must come: far beyond what it takes, so that only a defect runs into it.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);

/// A VLP-32C data packet, told from others by its stamp.
pub(crate) fn packet(n: u32) -> Bytes {
    let mut builder = DataPacketBuilder::new(Model::Vlp32c, ReturnMode::Strongest);
    // 663.552 µs a packet, as the sensor sends them (manual 63-9325, 9.4); twelve blocks 0.33° apart at 10 Hz × 0.2.
    builder.stamp(LidarTime(n * 664));
    for block in 0..12 {
        let azimuth = (n * 12 + block as u32) * 20 % 36_000;
        let slots = std::array::from_fn(|slot| ((n as u16).wrapping_mul(31).wrapping_add(slot as u16), slot as u8));
        builder.block(block, azimuth as u16, &slots);
    }
    Bytes::copy_from_slice(&builder.build())
}

/// Loopback, any free ports.
pub(crate) fn config(sensor: &str) -> UdpConfig {
    let mut config = UdpConfig::new(sensor.into());
    config.address = IpAddr::V4(Ipv4Addr::LOCALHOST);
    config.port = 0;
    config.position_port = Some(0);
    config
}

/// A plain socket to send from.
pub(crate) fn sender() -> UdpSocket {
    UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("a free port")
}

pub(crate) fn localhost(port: u16) -> SocketAddr {
    SocketAddr::from((Ipv4Addr::LOCALHOST, port))
}

/// Takes events until `enough` says so.
pub(crate) fn collect_until(events: &EventReceiver, mut enough: impl FnMut(&[Event]) -> bool) -> Vec<Event> {
    let mut seen = Vec::new();
    while !enough(&seen) {
        let event = events.recv_timeout(PATIENCE);
        seen.push(event.unwrap_or_else(|| panic!("nothing more came after {} events", seen.len())));
    }
    seen
}

/// The payloads of one sensor, in order.
pub(crate) fn payloads(events: &[Event], of: &str) -> Vec<Bytes> {
    let payload = |event: &Event| match &event.body {
        Body::LidarPacket { sensor, bytes } if sensor.as_str() == of => Some(bytes.clone()),
        _ => None,
    };
    events.iter().filter_map(payload).collect()
}

/// What the gaps of one place add up to.
pub(crate) fn lost(events: &[Event], at: LossPoint) -> u64 {
    let lost = |event: &Event| match event.body {
        Body::Gap { lost, place, .. } if place == at => u64::from(lost),
        _ => 0,
    };
    events.iter().map(lost).sum()
}

/// Data packets among the events.
pub(crate) fn packets(events: &[Event]) -> usize {
    events.iter().filter(|event| matches!(event.body, Body::LidarPacket { .. })).count()
}

/// When the data packets arrived, in the ledger's order.
pub(crate) fn arrivals(events: &[Event]) -> Vec<RigNs> {
    let packets = events.iter().filter(|event| matches!(event.body, Body::LidarPacket { .. }));
    packets.map(|event| event.arrived).collect()
}

/// A packet event's parts.
pub(crate) fn lidar_packet(sensor: &SensorId, bytes: &Bytes) -> Body {
    Body::LidarPacket { sensor: sensor.clone(), bytes: bytes.clone() }
}

/// A host clock that advances by a fixed step with every look and whose wall clock steps once.
pub(crate) struct ScriptedClock {
    pub(crate) step: Span,
    pub(crate) wall_at_zero: UnixNs,
    /// From this instant on the wall clock is ahead by so much.
    pub(crate) wall_step: (Span, Span),
    now: Mutex<Span>,
}

impl ScriptedClock {
    pub(crate) fn new(step: Span, wall_at_zero: UnixNs, wall_step: (Span, Span)) -> Self {
        Self { step, wall_at_zero, wall_step, now: Mutex::new(Span(0)) }
    }
}

impl HostClock for ScriptedClock {
    fn sample(&self) -> HostSample {
        let mut now = self.now.lock().expect("no panic");
        let at = *now;
        *now = at + self.step;
        let (from, ahead) = self.wall_step;
        let wall = self.wall_at_zero + at + if at >= from { ahead } else { Span(0) };
        HostSample { monotonic: at, wall, uncertainty: Span(0) }
    }
}
