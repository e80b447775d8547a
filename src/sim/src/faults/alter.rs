//! Payloads, changed: stamps set, bytes flipped, lengths wrong.

use super::script::{Payload, Pulse};
use crate::noise::Noise;
use bytes::Bytes;
use tumbled_model::{Body, KinectTicks, LidarTime};
use tumbled_velodyne::position::Pps;
use tumbled_velodyne::wire::{DATA_LEN, POSITION_LEN};

/// Where a data packet's stamp stands.
const DATA_STAMP: usize = DATA_LEN - 6;
/// Where a position packet's stamp and pulse stand.
const POSITION_STAMP: usize = 0xC6;
const POSITION_PPS: usize = 0xCA;
/// The product byte of a VLS-128.
const VLS128: u8 = 0xA1;

/// The payload of an item; `None` for what is none.
pub(super) fn payload(body: &Body) -> Option<&Bytes> {
    match body {
        Body::LidarPacket { bytes, .. } | Body::DepthFrame { bytes, .. } | Body::SerialChunk { bytes, .. } => {
            Some(bytes)
        }
        _ => None,
    }
}

/// The item with another payload.
pub(super) fn with_payload(mut body: Body, new: Bytes) -> Body {
    if let Body::LidarPacket { bytes, .. } | Body::DepthFrame { bytes, .. } | Body::SerialChunk { bytes, .. } =
        &mut body
    {
        *bytes = new;
    }
    body
}

/// The item with bytes of its payload changed.
pub(super) fn edited(body: Body, edit: impl FnOnce(&mut Vec<u8>)) -> Body {
    let Some(bytes) = payload(&body) else { return body };
    let mut bytes = bytes.to_vec();
    edit(&mut bytes);
    with_payload(body, bytes.into())
}

/// Whether the item is a LiDAR's position packet.
pub(super) fn is_position(body: &Body) -> bool {
    matches!(body, Body::LidarPacket { bytes, .. } if bytes.len() == POSITION_LEN)
}

/// The device's stamp, in its own ticks; `None` for an item without one.
pub(super) fn stamp(body: &Body) -> Option<u32> {
    match body {
        Body::LidarPacket { bytes, .. } => {
            let at = stamp_at(bytes.len())?;
            Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
        }
        Body::DepthFrame { ticks, .. } => ticks.map(|ticks| ticks.0),
        _ => None,
    }
}

/// The item with its stamp moved by seconds, round its own counter's end.
pub(super) fn shifted(body: Body, seconds: f64) -> Body {
    match body {
        Body::LidarPacket { .. } => {
            let moved = |us: i64| us.rem_euclid(LidarTime::HOUR_US.into()) as u32;
            let Some(before) = stamp(&body) else { return body };
            let after = moved(i64::from(before).saturating_add(libm::round(seconds * 1e6) as i64));
            edited(body, |bytes| {
                let place = stamp_at(bytes.len()).and_then(|at| bytes.get_mut(at..at + 4));
                if let Some(place) = place {
                    place.copy_from_slice(&after.to_le_bytes());
                }
            })
        }
        Body::DepthFrame { sensor, ticks, encoding, lost_packets, bytes } => {
            let by = libm::round(seconds * f64::from(KinectTicks::HZ)) as i64;
            let ticks = ticks.map(|ticks| KinectTicks(i64::from(ticks.0).wrapping_add(by) as u32));
            Body::DepthFrame { sensor, ticks, encoding, lost_packets, bytes }
        }
        other => other,
    }
}

/// Seconds that a number of the device's ticks lasts.
pub(super) fn tick_s(body: &Body) -> f64 {
    match body {
        Body::DepthFrame { .. } => 1.0 / f64::from(KinectTicks::HZ),
        _ => 1e-6,
    }
}

/// The item with so many of its bytes changed.
pub(super) fn corrupted(body: Body, count: u32, noise: &mut Noise) -> Body {
    edited(body, |bytes| {
        for _ in 0..count {
            let (at, flip) = (noise.bits(), noise.bits());
            let at = if bytes.is_empty() { 0 } else { (at % bytes.len() as u64) as usize };
            if let Some(byte) = bytes.get_mut(at) {
                *byte ^= (flip % 255) as u8 + 1;
            }
        }
    })
}

/// A payload that is not the sensor's, as if it came from it; `None` where nobody could send one.
pub(super) fn spoofed(genuine: &Body, what: Payload, noise: &mut Noise) -> Option<Body> {
    let bytes = match genuine {
        Body::LidarPacket { bytes, .. } => bytes,
        Body::SerialChunk { bytes, .. } if what == Payload::Noise => bytes,
        _ => return None,
    };
    match what {
        Payload::Noise => {
            let random: Vec<u8> = (0..bytes.len()).map(|_| noise.bits() as u8).collect();
            Some(with_payload(genuine.clone(), random.into()))
        }
        Payload::OtherProduct if bytes.len() == DATA_LEN => Some(edited(genuine.clone(), |bytes| {
            if let Some(product) = bytes.last_mut() {
                *product = VLS128;
            }
        })),
        Payload::OtherSensor if bytes.len() == DATA_LEN => Some(shifted(genuine.clone(), 777.0)),
        Payload::OtherProduct | Payload::OtherSensor => None,
    }
}

/// A position packet that says something else of the pulse; other items are left as they are.
pub(super) fn with_pulse(body: Body, state: Pulse) -> Body {
    let pps = match state {
        Pulse::Absent => Pps::Absent,
        Pulse::Synchronising => Pps::Synchronising,
        Pulse::Locked => Pps::Locked,
        Pulse::Error => Pps::Error,
    };
    edited(body, |bytes| {
        if let Some(byte) = bytes.get_mut(POSITION_PPS) {
            *byte = pps.byte();
        }
    })
}

fn stamp_at(len: usize) -> Option<usize> {
    match len {
        DATA_LEN => Some(DATA_STAMP),
        POSITION_LEN => Some(POSITION_STAMP),
        _ => None,
    }
}
