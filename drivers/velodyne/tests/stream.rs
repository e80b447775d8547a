//! Streams of synthetic packets: products, modes, limits, arbitrary bytes.

mod support;

use proptest::prelude::*;
use support::streams::{far, run};
use support::synth::Sensor;
use tumbled_model::{LidarTime, RigNs};
use tumbled_velodyne::encode::DataPacketBuilder;
use tumbled_velodyne::stream::{Decoded, Refused, Rejection, Settings, StreamDecoder};
use tumbled_velodyne::{Model, ReturnMode, WireError};

#[test]
fn dual_returns_are_one_point_when_equal_and_last_first_when_not() {
    let returns = |slot: usize, _| match slot {
        0 => (500, 500),
        1 => (700, 300),
        2 => (700, 0),
        3 => (0, 300),
        _ => (0, 0),
    };
    let sensor = Sensor::new(Model::Vlp32c, ReturnMode::Dual);
    let (_, out) = run(&sensor.packets(1, returns), Settings::default());
    let first: Vec<(u8, f32, u8)> =
        (0..5).filter_map(|k| out.points.get(k)).map(|p| (p.laser, p.range_m, p.ret as u8)).collect();
    // Even block = last (2), odd block = strongest (1), both (3); 4 mm a count.
    assert_eq!(first, [(0, 2.0, 3), (1, 2.8, 2), (1, 1.2, 1), (2, 2.8, 2), (3, 1.2, 1)]);
    assert_eq!(out.points.len(), 5 * 6);
}

#[test]
fn an_old_vlp16_that_says_hdl32e_is_warned_about_and_right_when_forced() {
    let sensor = Sensor::new(Model::Vlp16, ReturnMode::Strongest);
    let mut packets = sensor.packets(60, |slot, t| (1_000 + slot as u16 + (t / 100_000) as u16, 0));
    let (_, want) = run(&packets, Settings::default());
    for packet in &mut packets {
        packet.bytes[1205] = 0x21;
    }
    let (believed, _) = run(&packets, Settings::default());
    assert_eq!(believed.model(), Some(Model::Hdl32e));
    let mismatch = believed.period_mismatch().expect("1327 µs is no HDL-32E's period");
    assert_eq!(mismatch.fits, Some(Model::Vlp16));
    assert_eq!(believed.tracker().totals().lost, 0, "no losses by a period that is not the sensor's");
    let (forced, got) = run(&packets, Settings { model: Some(Model::Vlp16), ..Settings::default() });
    assert_eq!(forced.period_mismatch(), None);
    assert_eq!(got.points, want.points);
}

#[test]
fn products_that_are_not_decoded_are_refused_by_name() {
    let verdict = |build: &dyn Fn(&mut [u8; 1206])| {
        let mut bytes = DataPacketBuilder::new(Model::Vlp16, ReturnMode::Strongest).build();
        build(&mut bytes);
        let mut decoder = StreamDecoder::new(Settings::default());
        decoder.push(&bytes, RigNs(0), &mut Decoded::default());
        decoder.counts().rejected.values().next().map(|refused| refused.first.to_string()).unwrap_or_default()
    };
    assert!(verdict(&|b| b[1205] = 0xA1).contains("VLS-128"));
    // A VLS-128's four banks, whatever the byte says.
    assert!(verdict(&|b| b[201] = 0xCC).contains("VLS-128"));
    assert!(verdict(&|b| b[1205] = 0x23).contains("VLP-32A/B"));
    assert!(verdict(&|b| b[1205] = 0x77).contains("0x77"));
    assert!(verdict(&|b| b[1204] = 0x30).contains("0x30"));
    assert!(verdict(&|b| b[0] = 0).contains("block 0"));
}

#[test]
fn a_second_sensor_on_the_port_is_counted_and_not_mixed_in() {
    let mut packets = Sensor::new(Model::Vlp16, ReturnMode::Strongest).packets(10, far);
    packets.insert(5, Sensor::new(Model::Vlp32c, ReturnMode::Strongest).packets(1, far).remove(0));
    let (decoder, out) = run(&packets, Settings::default());
    assert_eq!(out.packets.len(), 10);
    let other = Rejection::OtherModel { expected: Model::Vlp16, found: Model::Vlp32c };
    assert_eq!(decoder.counts().rejected.get(&other.kind()), Some(&Refused { count: 1, first: other }));
}

#[test]
fn a_stray_first_packet_does_not_decide_the_model() {
    let mut packets = Sensor::new(Model::Vlp32c, ReturnMode::Strongest).packets(1, far);
    packets.extend(Sensor::new(Model::Vlp16, ReturnMode::Strongest).packets(50, far));
    let (decoder, out) = run(&packets, Settings::default());
    assert_eq!(decoder.model(), Some(Model::Vlp16));
    // The stray, and all but the seven packets it took to find out.
    assert_eq!(out.packets.len(), 1 + 50 - 7);
    assert_eq!(decoder.tracker().totals().lost, 0);
}

#[test]
fn a_forced_model_that_the_packets_contradict_is_told() {
    let packets = Sensor::new(Model::Vlp16, ReturnMode::Strongest).packets(5, far);
    let forced = |model| run(&packets, Settings { model: Some(model), ..Settings::default() }).0.contradiction();
    assert_eq!(forced(Model::Vlp32c), Some(tumbled_velodyne::Product::Supported(Model::Vlp16)));
    assert_eq!(forced(Model::Vlp16), None);
}

#[test]
fn equal_distances_are_one_return_whatever_their_reflectivity() {
    let packets = Sensor::new(Model::Vlp16, ReturnMode::Dual).packets(1, far);
    let mut packet = packets[0].clone();
    packet.bytes[6] = 10; // even block, slot 0: the last return's reflectivity
    packet.bytes[106] = 20; // odd block: the strongest one's
    let (_, out) = run(&[packet], Settings::default());
    let first = out.points.get(0).expect("a point");
    assert_eq!((out.points.len(), first.intensity, first.ret as u8), (192, 20, 3));
}

#[test]
fn numbers_of_packets_count_the_broken_ones_too() {
    let mut packets = Sensor::new(Model::Vlp16, ReturnMode::Strongest).packets(4, far);
    packets[1].bytes[0] = 0;
    let (_, out) = run(&packets, Settings::default());
    assert_eq!(out.packets.iter().map(|info| info.index).collect::<Vec<_>>(), [0, 2, 3]);
}

#[test]
fn a_steady_stream_does_not_allocate() {
    let sensor = Sensor {
        silent_deg: Some((91.0, 270.0)),
        start_deg: 271.0,
        ..Sensor::new(Model::Vlp32c, ReturnMode::Strongest)
    };
    let packets = sensor.packets(600, far);
    let mut decoder = StreamDecoder::new(Settings::default());
    let mut out = Decoded::default();
    let mut memory = None;
    for (k, packet) in packets.iter().enumerate() {
        if k % 76 == 0 {
            out.clear();
        }
        decoder.push(&packet.bytes, RigNs(packet.t_ns), &mut out);
        if k == 300 {
            memory = Some((out.points.x.as_ptr(), out.points.x.capacity(), out.packets.as_ptr()));
        }
    }
    // Columns that grew would lie elsewhere.
    assert_eq!(memory, Some((out.points.x.as_ptr(), out.points.x.capacity(), out.packets.as_ptr())));
}

#[test]
fn range_limits_leave_out_and_count() {
    let near_and_far = |slot: usize, _| (if slot == 0 { 50 } else { 1_000 }, 0); // 0.2 m and 4 m
    let packets = Sensor::new(Model::Vlp32c, ReturnMode::Strongest).packets(3, near_and_far);
    let settings = Settings { range_limits_m: Some(Model::Vlp32c.range_limits_m()), ..Settings::default() };
    let (decoder, out) = run(&packets, settings);
    assert_eq!((decoder.counts().out_of_range, out.points.len()), (36, 36 * 31));
    assert!(out.points.laser.iter().all(|laser| *laser != 0));
    assert_eq!(out.packets[2].points, 2 * 12 * 31..3 * 12 * 31);
}

#[test]
fn payloads_are_counted_by_what_is_wrong_and_the_first_of_each_kind_is_kept() {
    let mut decoder = StreamDecoder::new(Settings::default());
    let mut out = Decoded::default();
    for len in [0, 1205, 1207, 1205] {
        decoder.push(&vec![0; len], RigNs(0), &mut out);
    }
    for flag in 0..=u8::MAX {
        let mut bytes = [flag; 1206];
        bytes[1205] = 0x28; // a VLP-32C, by what it says
        decoder.push(&bytes, RigNs(0), &mut out);
    }
    decoder.push(&[0xFF; 512], RigNs(0), &mut out);
    let refused: Vec<(&str, u64, Rejection)> =
        decoder.counts().rejected.iter().map(|(kind, refused)| (kind.name(), refused.count, refused.first)).collect();
    let expected = [
        ("length", 4, WireError::Length { got: 0 }),
        ("block_flag", 256, WireError::Flag { block: 0, found: 0 }),
        ("sentence", 1, WireError::Sentence { offset: 0xCE, found: 0xFF }),
    ];
    assert_eq!(refused, expected.map(|(kind, count, first)| (kind, count, Rejection::Wire(first))));
    assert_eq!(decoder.counts().refused(), 4 + 256 + 1);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn arbitrary_payloads_are_counted_one_by_one(payloads in prop::collection::vec(
        prop_oneof![prop::collection::vec(any::<u8>(), 0..64), prop::collection::vec(any::<u8>(), 1206), prop::collection::vec(any::<u8>(), 512)], 1..8),
        model in prop::option::of(prop::sample::select(Model::ALL.to_vec()))) {
        let mut decoder = StreamDecoder::new(Settings { model, ..Settings::default() });
        let mut out = Decoded::default();
        for payload in &payloads {
            decoder.push(payload, RigNs(0), &mut out);
        }
        let counts = decoder.counts();
        prop_assert_eq!(counts.data_packets + counts.position_packets + counts.refused(), payloads.len() as u64);
    }

    /// Right flags, everything else arbitrary: azimuths, stamps and distances that no sensor would send.
    #[test]
    fn arbitrary_contents_decode_without_a_panic(
        azimuths in prop::collection::vec(prop::array::uniform12(any::<u16>()), 1..6),
        stamps in prop::collection::vec(any::<u32>(), 6), arrivals in prop::collection::vec(any::<i64>(), 6),
        mode in prop::sample::select(vec![0x37u8, 0x38, 0x39]), product in prop::sample::select(vec![0x21u8, 0x22, 0x24, 0x28]),
        raw in any::<u16>(),
    ) {
        let mut decoder = StreamDecoder::new(Settings::default());
        let mut out = Decoded::default();
        for (k, blocks) in azimuths.iter().enumerate() {
            let mut builder = DataPacketBuilder::new(Model::Vlp32c, ReturnMode::Strongest);
            builder.stamp(LidarTime(stamps[k])).factory_bytes(mode, product);
            for (block, azimuth) in blocks.iter().enumerate() {
                builder.block(block, *azimuth, &[(raw, 9); 32]);
            }
            decoder.push(&builder.build(), RigNs(arrivals[k]), &mut out);
        }
        decoder.finish(&mut out);
        prop_assert_eq!(decoder.counts().data_packets, azimuths.len() as u64);
        prop_assert!(out.points.azimuth_rad.iter().all(|a| (0.0..std::f32::consts::TAU).contains(a)));
        prop_assert!(out.points.x.iter().chain(&out.points.y).chain(&out.points.z).all(|v| v.is_finite() && v.abs() < 270.0));
    }
}
