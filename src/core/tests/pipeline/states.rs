//! What a sensor is doing, when it shows, and what is done with data that make no sense.

use crate::support::chance::Chance;
use crate::support::devices::{Way, depth_frame, kinect, lidar, lidar_packet, packets, silent_between, vlp32c};
use crate::support::ledger::{MS, S, Source, anchors, ledger, run_with, ticks};
use crate::support::rig::{self, KINECT, LIDAR};
use bytes::Bytes;
use proptest::prelude::*;
use tumbled_core::health::SensorState;
use tumbled_core::{Notice, NoticeKind, Outputs};
use tumbled_model::{Body, DepthEncoding, KinectTicks, PacketMask, RigNs, SensorId, SourceState};

fn state(sensor: &str, state: SourceState) -> Body {
    Body::SensorState { sensor: SensorId::from(sensor), state }
}

/// The changes of state that are told: when (ms) and the sentence.
fn changes(out: &Outputs) -> Vec<(i64, String)> {
    let changes = out.notices.iter().filter(|notice| notice.kind == NoticeKind::SensorState);
    changes.map(|notice| ((notice.t.0 + 1) / MS, notice.message.clone())).collect()
}

fn of_kind(out: &Outputs, kind: NoticeKind) -> Vec<&Notice> {
    out.notices.iter().filter(|notice| notice.kind == kind).collect()
}

#[test]
fn a_silence_shows_within_half_a_second_and_a_return_at_once() {
    let mut front = lidar(&packets(&vlp32c(), 6 * S), Way::UDP, 1);
    silent_between(&mut front, 2_030 * MS, 4_030 * MS);
    let (_, out) = run_with(rig::lidar_only(), &ledger(&[front, ticks(7 * S)]), |_| {});
    let expected = [
        (100, "front is live (was absent)"),
        (2_400, "front is stale (was live)"), // 300 ms after 2.03 s, at the next tenth
        (4_100, "front is live (was stale)"),
        (6_400, "front is stale (was live)"),
    ];
    assert_eq!(changes(&out), expected.map(|(ms, text)| (ms, text.to_owned())));
}

#[test]
fn a_pause_of_200_ms_is_no_change_of_state() {
    let mut front = lidar(&packets(&vlp32c(), 3 * S), Way::UDP, 1);
    silent_between(&mut front, S, 1_200 * MS);
    let (_, out) = run_with(rig::lidar_only(), &ledger(&[front, ticks(3 * S)]), |_| {});
    assert_eq!(changes(&out).len(), 1, "{:?}", changes(&out));
}

#[test]
fn what_the_source_says_shows_at_the_next_tenth_of_a_second() {
    let mut near = kinect(6 * S, Way::USB, 1);
    silent_between(&mut near, 2 * S, 4_050 * MS);
    near.insert(0, (0, state(KINECT, SourceState::Opened)));
    near.push((2_010 * MS, state(KINECT, SourceState::Lost)));
    near.push((4_010 * MS, state(KINECT, SourceState::Opened)));
    near.push((6_040 * MS, state(KINECT, SourceState::Closed)));
    near.sort_by_key(|(arrived, _)| *arrived);
    let (_, out) = run_with(rig::kinect_only(), &ledger(&[near, ticks(7 * S)]), |_| {});
    let texts: Vec<_> = changes(&out);
    let expected = [
        (100, "near is live (was absent)"),
        (2_100, "near is absent (was live)"),
        (4_100, "near is live (was absent)"),
        (6_100, "near is absent (was live)"),
    ];
    // Opened at 0 and the first frame at 30 ms: by the first tenth it is live.
    assert_eq!(texts, expected.map(|(ms, text)| (ms, text.to_owned())));
}

#[test]
fn an_open_source_without_data_is_opening() {
    let events = ledger(&[vec![(0, state(LIDAR, SourceState::Opened))], ticks(3 * S)]);
    let (pipeline, out) = run_with(rig::lidar_only(), &events, |_| {});
    assert_eq!(changes(&out), [(100, "front is opening (was absent)".to_owned())]);
    assert_eq!(pipeline.sensors()[0].state, SensorState::Opening);
}

#[test]
fn a_frozen_camera_is_a_fault_and_gives_no_epochs() {
    let mut near = kinect(3 * S, Way::USB, 1);
    let frozen = near[29].1.clone();
    let Body::DepthFrame { bytes: same, .. } = &frozen else { panic!("a frame") };
    for (n, (_, body)) in near.iter_mut().enumerate().skip(30).take(30) {
        let Body::DepthFrame { bytes, ticks, .. } = body else { panic!("a frame") };
        *bytes = same.clone();
        *ticks = Some(KinectTicks(n as u32 * 2_000_000)); // the device counts on
    }
    let mut epochs = 0;
    let (pipeline, out) = run_with(rig::kinect_only(), &ledger(&[near, ticks(3 * S)]), |_| epochs += 1);
    assert_eq!(epochs, 60);
    let kinect = pipeline.sensors()[0].kinect.expect("a Kinect");
    assert_eq!((kinect.repeated, kinect.repeated_in_a_row), (30, 0));
    let texts: Vec<String> = changes(&out).into_iter().map(|(_, text)| text).collect();
    assert_eq!(texts[1..], ["near is fault (was live)", "near is live (was fault)"]);
}

/// Frames that repeat the one numbered `from`, under stamps that go on.
fn freeze(near: &mut [(i64, Body)], from: usize) {
    let Body::DepthFrame { bytes: same, .. } = near[from].1.clone() else { panic!("a frame") };
    for (_, body) in near.iter_mut().skip(from + 1) {
        let Body::DepthFrame { bytes, .. } = body else { panic!("a frame") };
        *bytes = same.clone();
    }
}

#[test]
fn a_frozen_camera_stays_a_fault_while_it_is_opened_anew_and_no_frame_of_it_is_used_until_one_is_new() {
    let mut near = kinect(2 * S, Way::USB, 1);
    freeze(&mut near, 29);
    let (image, lost_at) = (near[29].1.clone(), near[59].0 + 10 * MS);
    // Opened anew at 2.5 s it sends the same image from 3 s on, thirty times, then new ones.
    let mut again = kinect(2 * S, Way { start_ns: 3 * S, ..Way::USB }, 2);
    let (Body::DepthFrame { bytes: same, .. }, still) = (image, &mut again[..30]) else { panic!("a frame") };
    for (_, body) in still {
        let Body::DepthFrame { bytes, .. } = body else { panic!("a frame") };
        *bytes = same.clone();
    }
    near.push((lost_at, state(KINECT, SourceState::Lost)));
    near.push((2_500 * MS, state(KINECT, SourceState::Opened)));
    near.extend(again);
    let mut t = Vec::new();
    let (_, out) = run_with(rig::kinect_only(), &ledger(&[near, ticks(6 * S)]), |epoch| t.push(epoch.t.0));
    let texts: Vec<String> = changes(&out).into_iter().map(|(_, text)| text).collect();
    assert_eq!(texts[1..], ["near is fault (was live)", "near is live (was fault)", "near is stale (was live)"]);
    assert!(t.iter().all(|t| !(1_001 * MS..3_999 * MS).contains(t)), "{t:?}");
}

#[test]
fn a_frozen_camera_that_does_not_come_back_is_absent_after_five_seconds() {
    let mut near = kinect(2 * S, Way::USB, 1);
    freeze(&mut near, 29);
    let last = near[59].0;
    near.push((last + 10 * MS, state(KINECT, SourceState::Lost)));
    let (_, out) = run_with(rig::kinect_only(), &ledger(&[near, ticks(9 * S)]), |_| {});
    let changes = changes(&out);
    let (absent_ms, text) = changes.last().expect("it changed");
    assert_eq!(text, "near is absent (was fault)");
    // Judged each tenth of a second.
    assert!((0..=100).contains(&(absent_ms - (last + 5 * S) / MS)), "{absent_ms}");
}

#[test]
fn a_reopened_camera_whose_counter_begins_anew_loses_no_frame() {
    let mut near = kinect(2 * S, Way::USB, 1);
    let lost_at = near[59].0;
    near.push((lost_at + 10 * MS, state(KINECT, SourceState::Lost)));
    near.push((lost_at + 900 * MS, state(KINECT, SourceState::Opened)));
    let again = kinect(2 * S, Way { start_ns: 3 * S, ..Way::USB }, 2);
    near.extend(again);
    let mut t = Vec::new();
    let (pipeline, out) = run_with(rig::kinect_only(), &ledger(&[near, ticks(6 * S)]), |epoch| t.push(epoch.t.0));
    assert_eq!(pipeline.sensors()[0].kinect.expect("a Kinect").repeated, 0);
    assert_eq!(of_kind(&out, NoticeKind::ClockReset).len(), 1);
    assert!(t.is_sorted());
    // Sixty frames; opened again at 2.9 s it joins at 3.4 s: of those from 3.0 s on twelve are left out.
    let after = t.iter().filter(|t| **t > 3 * S).count();
    assert_eq!((t.len(), after), (60 + 48, 48));
}

#[test]
fn a_hundred_thousand_random_payloads_are_counted_and_the_next_packet_is_used() {
    let mut chance = Chance::new(9);
    let good = packets(&vlp32c(), S);
    let mut front = Source::new();
    let mut bad = 0;
    for n in 0..100_000i64 {
        let lengths = [1_206, 1_206, 512, 0, 1, 1_205, 1_207, 1_500, 100];
        let mut bytes = vec![0; lengths[chance.below(9) as usize]];
        bytes.iter_mut().for_each(|byte| *byte = chance.below(256) as u8);
        if chance.below(4) == 0 {
            // Almost a packet.
            let whole = &good[n as usize % 100].bytes;
            bytes = whole[..bytes.len().min(1_206)].to_vec();
            let place = chance.below(bytes.len().max(1) as u64) as usize;
            if let Some(byte) = bytes.get_mut(place / 100 * 100) {
                *byte ^= 0x55;
            }
        }
        bad += 1;
        front.push((n * 10_000, lidar_packet(&bytes)));
    }
    let until = 100_000 * 10_000;
    let way = Way { start_ns: until, ..Way::UDP };
    front.extend(lidar(&good, way, 3));
    let mut epochs = 0;
    let (pipeline, out) = run_with(rig::lidar_only(), &ledger(&[front, ticks(3 * S)]), |_| epochs += 1);
    let sensor = &pipeline.sensors()[0];
    let malformed: u64 = sensor.malformed.values().sum();
    // Of 512 bytes any are a position packet; where the changed byte is one of a distance, it is a packet.
    assert!(malformed > 50_000 && malformed <= bad, "{malformed}");
    assert!(sensor.malformed.len() <= 64, "{} kinds", sensor.malformed.len());
    assert!(epochs >= 10, "{epochs} turns of the second that follows");
    let told = of_kind(&out, NoticeKind::Malformed).len();
    assert!((1..=3).contains(&told), "the first in a second is told: {told}");
}

#[test]
fn nothing_but_nonsense_is_a_fault() {
    let front = (0..3_000).map(|n| (n * MS, lidar_packet(&[7; 900]))).collect();
    let (pipeline, out) = run_with(rig::lidar_only(), &ledger(&[front, ticks(3 * S)]), |_| {});
    assert_eq!(pipeline.sensors()[0].state, SensorState::Fault);
    assert_eq!(changes(&out).last().map(|(_, text)| text.as_str()), Some("front is fault (was live)"));
}

#[test]
fn frames_of_a_wrong_length_are_counted_and_told_once_a_second() {
    let frame = |n: i64| {
        let bytes = Bytes::from(vec![n as u8; 1_000]);
        let ticks = Some(KinectTicks(n as u32 * 2_000_000));
        let (sensor, lost_packets) = (SensorId::from(KINECT), PacketMask::NONE);
        Body::DepthFrame { sensor, ticks, encoding: DepthEncoding::Mm16, lost_packets, bytes }
    };
    let near = (0..60)
        .map(|n| (n * 100 * MS / 3, if n == 40 { depth_frame(n, Some(KinectTicks(80_000_000))) } else { frame(n) }));
    let mut epochs = 0;
    let (pipeline, out) = run_with(rig::kinect_only(), &ledger(&[near.collect(), ticks(2 * S)]), |_| epochs += 1);
    assert_eq!((epochs, pipeline.sensors()[0].malformed.values().sum::<u64>()), (1, 59));
    assert_eq!(of_kind(&out, NoticeKind::Malformed).len(), 2);
}

#[test]
fn data_of_a_sensor_that_the_config_does_not_have_are_told_of_once() {
    let strange = (0..100)
        .map(|n| (n * 10 * MS, Body::SerialChunk { sensor: SensorId::from("who"), bytes: Bytes::from_static(b"?") }))
        .collect();
    let (_, out) = run_with(rig::whole(), &ledger(&[strange, ticks(2 * S)]), |_| {});
    let told = of_kind(&out, NoticeKind::UnknownSensor);
    assert_eq!(told.len(), 1);
    assert!(told[0].message.contains("who"), "{}", told[0].message);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    /// A damaged recording may have any arrivals: nothing breaks, and what is given out is in the order of its times.
    #[test]
    fn arrivals_that_make_no_sense_break_nothing(
        strange in prop::collection::vec(
            (0usize..700, prop_oneof![any::<i64>(), Just(i64::MIN), Just(i64::MAX)], any::<bool>()),
            1..6,
        ),
        ordinary in prop::collection::vec((0usize..700, -20 * S..20 * S), 0..6),
    ) {
        let until = 400 * MS;
        let sources =
            [kinect(until, Way::USB, 1), lidar(&packets(&vlp32c(), until), Way::UDP, 1), ticks(until), anchors(until, &[])];
        let mut events = ledger(&sources);
        let len = events.len();
        for (n, arrived) in ordinary {
            events[n % len].arrived = RigNs(arrived);
        }
        for (n, arrived, is_tick) in strange {
            events[n % len].arrived = RigNs(arrived);
            if is_tick {
                events[n % len].body = Body::Tick;
            }
        }
        let mut times = Vec::new();
        let (pipeline, _) = run_with(rig::whole(), &events, |epoch| times.push(epoch.t));
        prop_assert!(times.is_sorted());
        for sensor in pipeline.sensors() {
            prop_assert!(sensor.points.in_epochs <= sensor.points.decoded, "{:?}", sensor);
        }
    }
}
