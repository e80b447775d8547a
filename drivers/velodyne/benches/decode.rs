//! Nanoseconds per channel slot, from payload to points in columns. `cargo bench -p tumbled-velodyne`.
//!
//! Each sample decodes 1 000 packets of 384 slots into cleared columns; divan's item is a slot, so `1 / (items/s)` is
//! ns per slot. `share` is how many slots hold a return: 100 % is the worst case, an indoor scene has about 90 %, the
//! edge of a field half of it.

use divan::counter::ItemsCount;
use tumbled_model::{LidarTime, RigNs};
use tumbled_velodyne::encode::DataPacketBuilder;
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

fn decode(bencher: divan::Bencher<'_, '_>, model: Model, mode: ReturnMode, share: u32) {
    let packets = packets(model, mode, share);
    let mut out = Decoded::default();
    bencher.counter(ItemsCount::new(PACKETS * SLOTS)).bench_local(|| {
        let mut decoder = StreamDecoder::new(Settings { model: Some(model), ..Settings::default() });
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
