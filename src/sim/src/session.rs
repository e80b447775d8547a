//! Everything a scene's sensors send, in the order the host has it.
//!
//! Packets and frames are made a tenth of a second at a time, each by itself: a pool's threads may share them, and the
//! bytes are the same. What a stage and its host say to each other lies among them.

mod skip;

use crate::scene::Scene;
use crate::transport::{Line, Transport};
use crate::turntable::{self, Conversation};
use bytes::Bytes;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::Arc;
use tumbled_model::{Body, DepthEncoding, PacketMask, RigNs, SensorId, Span};

/// Made at once: a LiDAR's turn and three frames of a Kinect.
const STRETCH: Span = Span(100_000_000);
/// From frame to frame of a Kinect, by its own clock.
const FRAME_NS: i64 = 33_333_333;

/// Something a sensor sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Item {
    /// When the host has it, on the session's timeline.
    pub arrived: RigNs,
    /// What it is: packets and frames as they are on the wire.
    pub body: Body,
}

/// An item that waits for those that arrive before it.
#[derive(Debug, PartialEq, Eq)]
struct Waiting {
    arrived: RigNs,
    /// Of equal times the sensor that comes first, then the item made first.
    place: (usize, u64),
    body: Body,
}

impl Ord for Waiting {
    fn cmp(&self, other: &Self) -> core::cmp::Ordering {
        (self.arrived, self.place).cmp(&(other.arrived, other.place))
    }
}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<core::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// A sensor's next item, and its line.
#[derive(Debug)]
struct Sender {
    next: u64,
    line: Line,
}

/// A simulation: an iterator over what arrives.
#[derive(Debug)]
pub struct Simulation {
    scene: Arc<Scene>,
    pool: Option<Arc<rayon::ThreadPool>>,
    packets: Vec<Sender>,
    positions: Vec<Sender>,
    frames: Vec<Sender>,
    /// The stage and its host.
    serial: Option<Conversation>,
    chunks: u64,
    /// Everything sent before this instant has been made.
    made: RigNs,
    waiting: BinaryHeap<Reverse<Waiting>>,
}

impl Simulation {
    /// A scene from its start on. `pool`: threads that share the work; none: the caller's alone.
    pub fn new(scene: Arc<Scene>, pool: Option<Arc<rayon::ThreadPool>>) -> Self {
        let seed = scene.config.seed;
        let sender = |id: &str, line: Transport| Sender { next: 0, line: Line::new(line, id, 0, seed) };
        let packets = scene.lidars.iter().map(|lidar| sender(lidar.id.as_str(), lidar.line)).collect();
        let positions =
            scene.lidars.iter().map(|lidar| sender(&format!("{}.position", lidar.id), lidar.line)).collect();
        let frames = scene.kinects.iter().map(|kinect| sender(kinect.id.as_str(), kinect.line)).collect();
        let serial = scene.conversation();
        let (made, waiting) = (RigNs(0), BinaryHeap::new());
        Self { scene, pool, packets, positions, frames, serial, chunks: 0, made, waiting }
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Makes everything that is sent in the next tenth of a second, and nothing beyond the scene's end.
    fn make(&mut self) {
        let until = (self.made + STRETCH).min(RigNs(self.scene.duration().0));
        let scene = Arc::clone(&self.scene);
        for (n, lidar) in scene.lidars.iter().enumerate() {
            self.make_packets(n, lidar, until);
        }
        for (n, kinect) in scene.kinects.iter().enumerate() {
            self.make_frames(n, kinect, until);
        }
        self.make_chunks(until);
        self.made = until;
    }

    /// What host and stage say to each other, both sides: its times are those of the host already.
    fn make_chunks(&mut self, until: RigNs) {
        let place = 2 * self.scene.lidars.len() + self.scene.kinects.len();
        let Some(serial) = &mut self.serial else { return };
        while let Some(entry) = serial.next_before(until) {
            let body = Body::SerialChunk { sensor: SensorId::from(turntable::SENSOR), bytes: Bytes::from(entry.bytes) };
            self.waiting.push(Reverse(Waiting { arrived: entry.at, place: (place, self.chunks), body }));
            self.chunks += 1;
        }
    }

    fn make_packets(&mut self, n: usize, lidar: &crate::scene::LidarUnit, until: RigNs) {
        let (scene, seed) = (Arc::clone(&self.scene), self.scene.config.seed);
        let (Some(packets), Some(positions)) = (self.packets.get_mut(n), self.positions.get_mut(n)) else { return };
        let last = lidar.model.first_packet_at(until);
        let first = packets.next;
        let one = |index| lidar.model.packet(&scene.world, index, seed);
        let made: Vec<_> = match &self.pool {
            Some(pool) => pool.install(|| (first..last).into_par_iter().map(one).collect()),
            None => (first..last).map(one).collect(),
        };
        packets.next = last.max(first);
        for (index, packet) in (first..).zip(made) {
            let arrived = packets.line.arrive(packet.end);
            let body = Body::LidarPacket { sensor: lidar.id.clone(), bytes: packet.bytes };
            self.waiting.push(Reverse(Waiting { arrived, place: (2 * n, index), body }));
        }
        while let Some(position) = lidar.model.position(positions.next).filter(|position| position.t < until) {
            let arrived = positions.line.arrive(position.end);
            let body = Body::LidarPacket { sensor: lidar.id.clone(), bytes: position.bytes };
            self.waiting.push(Reverse(Waiting { arrived, place: (2 * n + 1, positions.next), body }));
            positions.next += 1;
        }
    }

    fn make_frames(&mut self, n: usize, kinect: &crate::scene::KinectUnit, until: RigNs) {
        let (scene, seed) = (Arc::clone(&self.scene), self.scene.config.seed);
        let Some(frames) = self.frames.get_mut(n) else { return };
        let place = 2 * scene.lidars.len() + n;
        loop {
            // The oscillator paces the frames: the first is half a period after the start.
            let t = kinect.clock.instant((frames.next as i64).saturating_mul(FRAME_NS) + FRAME_NS / 2);
            if t >= until {
                return;
            }
            let frame = match &self.pool {
                Some(pool) => kinect.model.frame_on(pool, &scene.world, t, frames.next, seed),
                None => kinect.model.frame(&scene.world, t, frames.next, seed),
            };
            // Codes of the model are of eleven bits: they can be packed.
            let bytes = frame.packed().map(Bytes::from).unwrap_or_default();
            let sent = t + kinect.latency;
            let body = Body::DepthFrame {
                sensor: kinect.id.clone(),
                // The stamp is that of the frame's last packet.
                ticks: Some(kinect.clock.kinect(sent)),
                encoding: DepthEncoding::Packed11,
                lost_packets: PacketMask::NONE,
                bytes,
            };
            let arrived = frames.line.arrive(sent);
            self.waiting.push(Reverse(Waiting { arrived, place: (place, frames.next), body }));
            frames.next += 1;
        }
    }
}

impl Iterator for Simulation {
    type Item = Item;

    fn next(&mut self) -> Option<Item> {
        let end = RigNs(self.scene.duration().0);
        loop {
            // Nothing that is made later can arrive before what was sent before `made`.
            let ready = self.waiting.peek().is_some_and(|Reverse(item)| item.arrived < self.made || self.made >= end);
            if ready {
                let Reverse(Waiting { arrived, body, .. }) = self.waiting.pop()?;
                return Some(Item { arrived, body });
            }
            if self.made >= end {
                return None;
            }
            self.make();
        }
    }
}
