//! Nanoseconds per channel slot, from payload to points in columns. `cargo bench -p tumbled-velodyne`.
//!
//! Each sample decodes 1 000 packets of 384 slots into cleared columns; divan's item is a slot, so `1 / (items/s)` is
//! ns per slot. `share` is how many slots hold a return: 100 % is the worst case, an indoor scene has about 90 %, the
//! edge of a field half of it.

use divan::counter::ItemsCount;
use tumbled_model::{CivilTime, LidarTime, RigNs};
use tumbled_velodyne::encode::DataPacketBuilder;
use tumbled_velodyne::hdl64::encode::{Hdl64Encoder, Said, Slot};
use tumbled_velodyne::hdl64::{Calibration, Generation, Unit};
use tumbled_velodyne::stream::{Decoded, Settings, StreamDecoder};
use tumbled_velodyne::{Model, ReturnMode};

fn main() {
    divan::main();
}

const PACKETS: usize = 1_000;
const SLOTS: usize = 384;

/// A turning sensor; `share` percent of the slots have a return, drawn by a fixed sequence.
fn packets(model: Model, mode: ReturnMode, share: u32) -> Vec<[u8; 1206]> {
    let period_ns = tumbled_velodyne::detect::packet_period_ns(model, mode).unwrap_or(1);
    let groups = 12 / mode.blocks_per_firing();
    let mut draw = 1u32;
    (0..PACKETS)
        .map(|k| {
            let mut builder = DataPacketBuilder::new(model, mode);
            builder.stamp(LidarTime((k as i64 * period_ns / 1_000) as u32));
            for block in 0..12 {
                let group = k * groups + block / mode.blocks_per_firing();
                let slots = core::array::from_fn(|_| {
                    draw = draw.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    if (draw >> 8) % 100 < share {
                        (500 + (draw >> 16) as u16 % 5_000, (draw >> 20) as u8)
                    } else {
                        (0, 0)
                    }
                });
                builder.block(block, (group * 20 % 36_000) as u16, &slots);
            }
            builder.build()
        })
        .collect()
}

/// An HDL-64E S2 with the golden captures' made-up calibration, two-point correction in half of the lasers.
fn hdl64e_packets(calibration: &Calibration, share: u32) -> Vec<[u8; 1206]> {
    let mut encoder = Hdl64Encoder::new(Generation::S2, calibration, &Unit::default());
    let time = CivilTime { year: 2026, month: 11, day: 22, hour: 9, minute: 0, second: 0, nanosecond: 0 };
    let said = Said { time, gps: b'A', temperature_c: 40, firmware: 7, warnings: 0 };
    let mut draw = 1u32;
    (0..PACKETS)
        .map(|k| {
            let azimuths = core::array::from_fn(|block| ((k * 6 + block / 2) * 17 % 36_000) as u16);
            let slots = core::array::from_fn(|_| {
                core::array::from_fn(|_| {
                    draw = draw.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    let raw = if (draw >> 8) % 100 < share { 1_000 + (draw >> 16) as u16 % 20_000 } else { 0 };
                    Slot { raw, intensity: (draw >> 20) as u8 }
                })
            });
            encoder.encode(LidarTime(k as u32 * 288), &azimuths, &slots, &said)
        })
        .collect()
}

fn decode(bencher: divan::Bencher<'_, '_>, model: Model, mode: ReturnMode, share: u32) {
    decode_packets(bencher, &packets(model, mode, share), &Settings { model: Some(model), ..Settings::default() });
}

fn decode_packets(bencher: divan::Bencher<'_, '_>, packets: &[[u8; 1206]], settings: &Settings) {
    let mut out = Decoded::default();
    bencher.counter(ItemsCount::new(PACKETS * SLOTS)).bench_local(|| {
        let mut decoder = StreamDecoder::new(settings.clone());
        for (k, payload) in packets.iter().enumerate() {
            if k % 76 == 0 {
                out.clear(); // a scan's worth, as the daemon does it
            }
            decoder.push(payload, RigNs(k as i64 * 663_552), &mut out);
        }
        divan::black_box(out.points.len())
    });
}

#[divan::bench(args = [100, 90, 50])]
fn vlp32c_single(bencher: divan::Bencher<'_, '_>, share: u32) {
    decode(bencher, Model::Vlp32c, ReturnMode::Strongest, share);
}

#[divan::bench(args = [90])]
fn vlp32c_dual(bencher: divan::Bencher<'_, '_>, share: u32) {
    decode(bencher, Model::Vlp32c, ReturnMode::Dual, share);
}

#[divan::bench(args = [90])]
fn vlp16_single(bencher: divan::Bencher<'_, '_>, share: u32) {
    decode(bencher, Model::Vlp16, ReturnMode::Strongest, share);
}

#[divan::bench(args = [90])]
fn hdl32e_single(bencher: divan::Bencher<'_, '_>, share: u32) {
    decode(bencher, Model::Hdl32e, ReturnMode::Strongest, share);
}

#[divan::bench(args = [90])]
fn hdl64e_s2_single(bencher: divan::Bencher<'_, '_>, share: u32) {
    let calibration = Calibration::parse(include_str!("../../../tests/captures/hdl64e-made.csv")).expect("64 lasers");
    let packets = hdl64e_packets(&calibration, share);
    decode_packets(bencher, &packets, &Settings { hdl64e_calibration: Some(calibration), ..Settings::default() });
}
