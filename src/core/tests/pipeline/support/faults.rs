//! What can happen to a LiDAR's packets on their way.

use super::chance::Chance;
use super::ledger::Source;
use crate::synth::Packet;
use tumbled_model::{Body, LidarTime, LossPoint, SensorId};

/// Loses packets from `from` on, so many.
pub(crate) fn burst(source: &mut Source, from: usize, lost: usize) {
    source.drain(from.min(source.len())..(from + lost).min(source.len()));
}

/// Loses `ppm` of the packets; returns how many between others, which is what stamps can tell.
pub(crate) fn lose(source: &mut Source, ppm: u64, chance: &mut Chance) -> u64 {
    let (before, last) = (source.len(), source.len() - 1);
    let mut n = 0;
    source.retain(|_| {
        n += 1;
        n == 1 || n == last + 1 || !chance.happens(ppm)
    });
    (before - source.len()) as u64
}

/// Repeats `ppm` of the packets, right behind themselves or three packets later; returns how many.
pub(crate) fn repeat(source: &mut Source, ppm: u64, chance: &mut Chance) -> u64 {
    let mut repeated = 0;
    let mut n = 0;
    while n + 4 < source.len() {
        if chance.happens(ppm) {
            let later = if chance.happens(500_000) { 1 } else { 4 };
            let copy = (source[n + later - 1].0, source[n].1.clone());
            source.insert(n + later, copy);
            repeated += 1;
            n += later;
        }
        n += 1;
    }
    repeated
}

/// Lets `ppm` of the packets be overtaken by the next one to three; returns how many. They come with the last of these.
pub(crate) fn swap(source: &mut Source, ppm: u64, chance: &mut Chance) -> u64 {
    let mut swapped = 0;
    let mut n = 2;
    while n + 4 < source.len() {
        if chance.happens(ppm) {
            let by = 1 + chance.below(3) as usize;
            let (_, overtaken) = source.remove(n);
            source.insert(n + by, (source[n + by - 1].0, overtaken));
            swapped += 1;
            n += by;
        }
        n += 1;
    }
    swapped
}

/// Sets the sensor's clock by so many µs from a packet on.
pub(crate) fn set_clock(packets: &mut [Packet], from: usize, shift_us: i64) {
    for packet in packets.iter_mut().skip(from) {
        let stamp = u32::from_le_bytes(packet.bytes[1_200..1_204].try_into().expect("four bytes"));
        let set = (i64::from(stamp) + shift_us).rem_euclid(i64::from(LidarTime::HOUR_US)) as u32;
        packet.bytes[1_200..1_204].copy_from_slice(&set.to_le_bytes());
    }
}

/// The host's word on so many lost packets.
pub(crate) fn gap(sensor: &str, lost: u32, place: LossPoint) -> Body {
    Body::Gap { sensor: SensorId::from(sensor), lost, place }
}
