//! What a LiDAR's packet and a Kinect's frame cost on their way through the whole core, and what they allocate.
//!
//! `cargo bench -p tumbled-core --bench pipeline`

use bytes::Bytes;
use divan::AllocProfiler;
use divan::counter::ItemsCount;
use std::sync::Arc;
use tumbled_core::{CoreConfig, KinectSetup, LidarSetup, Outputs, Pipeline, RegionOfInterest, Timing, Workers};
use tumbled_kinect::{
    BackProjector, DepthTable, Image, Intrinsics, NoiseModel, PIXELS, RawDisparity, ZeroPlane, encode_raw,
};
use tumbled_model::{
    Body, DepthEncoding, Event, Iso, KinectTicks, LidarTime, PacketMask, Point, RigNs, SensorId, Span,
};
use tumbled_velodyne::encode::DataPacketBuilder;
use tumbled_velodyne::stream::Settings;
use tumbled_velodyne::{Model, ReturnMode};

#[global_allocator]
static ALLOC: AllocProfiler = AllocProfiler::system();

fn main() {
    divan::main();
}

const PACKETS: i64 = 1_507;
const PACKET_NS: i64 = 663_552;
const FRAMES: i64 = 30;

fn config() -> CoreConfig {
    CoreConfig {
        lidars: Vec::new(),
        kinects: Vec::new(),
        turntables: Vec::new(),
        turntable_axis: None,
        roi: RegionOfInterest { center: Point::new(2.0, 0.0, 0.0), radius_m: 1.2 },
        timing: Timing::default(),
        estimate: Default::default(),
        ignore_skips: false,
    }
}

fn workers(threads: usize) -> Workers {
    if threads == 0 {
        return Workers::none();
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    Workers::pool(Arc::new(pool))
}

/// The ticks of a second, each ahead of what arrives with it.
fn with_ticks(events: impl Iterator<Item = (i64, Body)>) -> Vec<Event> {
    let event = |(arrived, body)| Event { seq: 0, arrived: RigNs(arrived), body };
    let mut all = Vec::new();
    let mut tick = None;
    for (arrived, body) in events {
        let now = arrived / 100_000_000;
        if tick.replace(now).is_some_and(|before| before != now) {
            all.push(event((arrived, Body::Tick)));
        }
        all.push(event((arrived, body)));
    }
    all
}

/// A second of a VLP-32C at 600 rpm, every laser with a return.
fn second_of_packets(second: i64) -> Vec<Event> {
    let packet = |n: i64| {
        let t_ns = n * PACKET_NS;
        let mut builder = DataPacketBuilder::new(Model::Vlp32c, ReturnMode::Strongest);
        for block in 0..12 {
            let azimuth = (t_ns + block * 55_296) * 36 / 100_000 % 36_000;
            builder.block(block as usize, azimuth as u16, &core::array::from_fn(|slot| (400 + 40 * slot as u16, 80)));
        }
        let bytes = builder.stamp(LidarTime((t_ns / 1_000 % 3_600_000_000) as u32)).build();
        let body = Body::LidarPacket { sensor: SensorId::from("front"), bytes: Bytes::copy_from_slice(&bytes) };
        (t_ns + PACKET_NS + 100_000, body)
    };
    with_ticks((second * PACKETS..(second + 1) * PACKETS).map(packet))
}

#[divan::bench(args = [0, 1, 2], sample_count = 20)]
fn second_of_a_vlp32c(bencher: divan::Bencher<'_, '_>, threads: usize) {
    let front = LidarSetup {
        id: SensorId::from("front"),
        decoder: Settings::default(),
        t_rig_lidar: Iso::identity(),
        time_offset: Span(0),
    };
    let mut pipeline = Pipeline::new(CoreConfig { lidars: vec![front], ..config() }, workers(threads));
    let mut out = Outputs::default();
    let second = core::cell::Cell::new(0);
    let next = || second_of_packets(second.replace(second.get() + 1));
    for _ in 0..5 {
        run(&mut pipeline, &next(), &mut out); // buffers have grown, the clock is locked
    }
    bencher
        .counter(ItemsCount::new((PACKETS * 384) as usize))
        .with_inputs(next)
        .bench_local_refs(|events| run(&mut pipeline, events, &mut out));
}

/// A second of a Kinect, every pixel with a depth.
fn second_of_frames(frames: &[Bytes], second: i64) -> Vec<Event> {
    let frame = |n: i64| {
        let body = Body::DepthFrame {
            sensor: SensorId::from("near"),
            ticks: Some(KinectTicks((n * 2_000_000) as u32)),
            encoding: DepthEncoding::Packed11,
            lost_packets: PacketMask::NONE,
            bytes: frames[n as usize % frames.len()].clone(),
        };
        (n * 100_000_000 / 3 + 30_000_000, body)
    };
    with_ticks((second * FRAMES..(second + 1) * FRAMES).map(frame))
}

#[divan::bench(args = [0, 1, 2], sample_count = 20)]
fn second_of_a_kinect(bencher: divan::Bencher<'_, '_>, threads: usize) {
    let near = KinectSetup {
        id: SensorId::from("near"),
        table: DepthTable::from_law(&ZeroPlane::default()),
        projector: BackProjector::new(&Intrinsics::default(), &NoiseModel::default()).expect("the factory's camera"),
        t_rig_kinect: Iso::from_parts([0.0, 0.3, 0.0], [-0.5, 0.5, -0.5, 0.5]).expect("a rotation"),
        time_offset: Span(0),
    };
    let image = |n: usize| Image::from_fn(|u, v| RawDisparity(700 + ((u + 3 * v + n) % 200) as u16));
    let frame = |n| Bytes::from(encode_raw(&image(n), DepthEncoding::Packed11).expect("eleven bits"));
    let frames: Vec<Bytes> = (0..4).map(frame).collect();
    let mut pipeline = Pipeline::new(CoreConfig { kinects: vec![near], ..config() }, workers(threads));
    let mut out = Outputs::default();
    let second = core::cell::Cell::new(0);
    let next = || second_of_frames(&frames, second.replace(second.get() + 1));
    for _ in 0..3 {
        run(&mut pipeline, &next(), &mut out);
    }
    bencher
        .counter(ItemsCount::new(FRAMES as usize * PIXELS))
        .with_inputs(next)
        .bench_local_refs(|events| run(&mut pipeline, events, &mut out));
}

fn run(pipeline: &mut Pipeline, events: &[Event], out: &mut Outputs) {
    for event in events {
        pipeline.step(event, out);
        divan::black_box(&out.epochs);
        out.clear();
    }
}
