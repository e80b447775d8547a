//! Whole captures, written by other libraries than the readers use wherever there is one.

mod bags;
mod damaged_bags;
mod folders;
mod merging;
mod packets;
mod real;

use super::{Capture, CaptureError, CaptureRecord, CaptureSummary, Routing, open};
use std::path::Path;
use tumbled_model::{Body, SensorId, UnixNs};

fn open_default(path: &Path) -> Result<Capture, CaptureError> {
    open(path, &Routing::default())
}

/// Everything a capture yields, and its final summary.
fn read_all(path: &Path) -> (Vec<CaptureRecord>, CaptureSummary) {
    read_routed(path, &Routing::default())
}

fn read_routed(path: &Path, routing: &Routing) -> (Vec<CaptureRecord>, CaptureSummary) {
    let mut capture = open(path, routing).unwrap();
    let records = capture.by_ref().collect::<Result<_, _>>().unwrap();
    (records, capture.summary().clone())
}

fn lidar(host: i64, sensor: &str, payload: &[u8]) -> CaptureRecord {
    let body = Body::LidarPacket { sensor: SensorId::from(sensor), bytes: payload.to_vec().into() };
    CaptureRecord::foreign(UnixNs(host), body)
}

fn lost(host: i64, sensor: &str) -> CaptureRecord {
    CaptureRecord::foreign(UnixNs(host), super::packets::gap(&SensorId::from(sensor), 1))
}

/// Of a depth frame: host stamp, encoding, ticks, first sample.
fn depth(record: &CaptureRecord) -> (i64, tumbled_model::DepthEncoding, Option<u32>, u16) {
    let Body::DepthFrame { encoding, ticks, bytes, .. } = &record.body else { panic!("{record:?}") };
    (record.host.0, *encoding, ticks.map(|ticks| ticks.0), u16::from_le_bytes([bytes[0], bytes[1]]))
}
