//! Time per frame of 307 200 pixels, one thread.
//!
//! `cargo bench -p tumbled-kinect`. The scene is a tilted, noisy surface from 0.8 to 3.6 m with a tenth of the pixels
//! without data, as in real frames.

use divan::{Bencher, black_box};
use tumbled_kinect::{
    BackProjector, DepthImage, DepthTable, Image, Intrinsics, MmImage, NoiseModel, Points, RawDisparity, RayTable,
    ZeroPlane, decode_metres, decode_mm, encode_mm, encode_raw,
};
use tumbled_model::{DepthEncoding, PacketMask};

fn main() {
    divan::main();
}

fn table() -> DepthTable {
    DepthTable::from_law(&ZeroPlane::default())
}

fn frame(encoding: DepthEncoding) -> Vec<u8> {
    let law = ZeroPlane::default();
    let codes = Image::from_fn(|u, v| {
        if u >= 632 || (u / 40 + v / 40) % 11 == 0 {
            return RawDisparity::NO_DATA;
        }
        let metres = 0.8 + 0.004 * u as f64 + 0.0005 * v as f64;
        let noise = ((u * 7 + v * 13) * 31 % 3) as u16; // −1, 0, +1 steps
        law.code_at(metres).map_or(RawDisparity::NO_DATA, |code| RawDisparity(code.0 + noise - 1))
    });
    match encoding {
        DepthEncoding::Mm16 => {
            let raw = encode_raw(&codes, DepthEncoding::Raw11).expect("eleven bits");
            let mut mm = MmImage::new();
            decode_mm(DepthEncoding::Raw11, &raw, &PacketMask::NONE, &table(), &mut mm).expect("a whole frame");
            encode_mm(&mm)
        }
        raw => encode_raw(&codes, raw).expect("eleven bits"),
    }
}

#[divan::bench(args = [DepthEncoding::Packed11, DepthEncoding::Raw11, DepthEncoding::Mm16])]
fn to_metres(bencher: Bencher<'_, '_>, encoding: DepthEncoding) {
    let (bytes, table, mut out) = (frame(encoding), table(), DepthImage::new());
    bencher.bench_local(|| decode_metres(encoding, black_box(&bytes), &PacketMask::NONE, &table, &mut out));
}

#[divan::bench(args = [DepthEncoding::Packed11, DepthEncoding::Raw11, DepthEncoding::Mm16])]
fn to_mm(bencher: Bencher<'_, '_>, encoding: DepthEncoding) {
    let (bytes, table, mut out) = (frame(encoding), table(), MmImage::new());
    bencher.bench_local(|| decode_mm(encoding, black_box(&bytes), &PacketMask::NONE, &table, &mut out));
}

#[divan::bench]
fn packed_to_points(bencher: Bencher<'_, '_>) {
    let (bytes, table) = (frame(DepthEncoding::Packed11), table());
    let projector = BackProjector::new(&Intrinsics::default(), &NoiseModel::default()).expect("a camera");
    let (mut depth, mut points) = (DepthImage::new(), Points::new());
    bencher.bench_local(|| {
        let loss = decode_metres(DepthEncoding::Packed11, black_box(&bytes), &PacketMask::NONE, &table, &mut depth);
        projector.points(&depth, &mut points);
        (loss, points.len())
    });
}

#[divan::bench]
fn metres_to_points(bencher: Bencher<'_, '_>) {
    let (bytes, table) = (frame(DepthEncoding::Packed11), table());
    let projector = BackProjector::new(&Intrinsics::default(), &NoiseModel::default()).expect("a camera");
    let (mut depth, mut points) = (DepthImage::new(), Points::new());
    decode_metres(DepthEncoding::Packed11, &bytes, &PacketMask::NONE, &table, &mut depth).expect("a whole frame");
    bencher.bench_local(|| {
        projector.points(black_box(&depth), &mut points);
        points.len()
    });
}

#[divan::bench]
fn ray_table_with_distortion(bencher: Bencher<'_, '_>) {
    let camera = Intrinsics { k1: -0.26, k2: 0.99, p1: -0.001, p2: 0.005, k3: -1.3, ..Intrinsics::default() };
    bencher.bench_local(|| RayTable::new(black_box(&camera)).map(|rays| rays.report()));
}
