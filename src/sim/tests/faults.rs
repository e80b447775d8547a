//! What the injector says it did is what the receivers find.

mod support;

use bytes::Bytes;
use proptest::prelude::*;
use support::{sensor, vlp32c};
use tumbled_model::{Body, DepthEncoding, Event, KinectTicks, PacketMask, RigNs, SensorId, SourceState, UnixNs};
use tumbled_sim::faults::{Action, Fault, FaultCounts, FaultInjector, FaultScript, FaultTruth, Payload, Pulse};
use tumbled_sim::world::World;
use tumbled_velodyne::position::{PositionPacket, Pps};
use tumbled_velodyne::stream::{Decoded, Settings, StreamDecoder};

fn fault(sensor: Option<&str>, from_s: f64, until_s: Option<f64>, action: Action) -> Fault {
    Fault { sensor: sensor.map(str::to_owned), from_s, until_s, action }
}

/// A VLP-32C for so many seconds, as it comes, its position packets once a second.
fn lidar(seconds: u64) -> Vec<Event> {
    let model = sensor(vlp32c());
    let mut events = Vec::new();
    let mut positions = (0..seconds).filter_map(|index| model.position(index)).peekable();
    let body = |bytes| Body::LidarPacket { sensor: SensorId::from("front"), bytes };
    for index in 0..model.first_packet_at(RigNs(seconds as i64 * 1_000_000_000)) {
        let packet = model.packet(&World::default(), index, 1);
        while let Some(position) = positions.next_if(|position| position.end <= packet.end) {
            events.push((packet.end, body(position.bytes)));
        }
        events.push((packet.end, body(packet.bytes)));
    }
    numbered(events)
}

/// Frames at 30 Hz with an anchor a second.
fn kinect(frames: i64) -> Vec<Event> {
    let mut events = Vec::new();
    for k in 0..frames {
        let arrived = RigNs(k * 33_333_333);
        if k % 30 == 0 {
            events.push((arrived, Body::Anchor { unix: UnixNs(1_000 + arrived.0) }));
        }
        events.push((
            arrived,
            Body::DepthFrame {
                sensor: SensorId::from("left"),
                ticks: Some(KinectTicks((k * 2_000_000) as u32)),
                encoding: DepthEncoding::Packed11,
                lost_packets: PacketMask::NONE,
                bytes: Bytes::from(vec![k as u8; 64]),
            },
        ));
    }
    numbered(events)
}

fn numbered(events: Vec<(RigNs, Body)>) -> Vec<Event> {
    (0..).zip(events).map(|(seq, (arrived, body))| Event { seq, arrived, body }).collect()
}

fn run(events: &[Event], seed: u64, fault: Vec<Fault>) -> (Vec<Event>, FaultTruth) {
    let script = FaultScript { seed, fault };
    let mut injector = FaultInjector::new(events.iter().cloned(), script).expect("a script that means something");
    let out: Vec<Event> = injector.by_ref().collect();
    assert!((0..).zip(&out).all(|(seq, event)| event.seq == seq), "numbered anew");
    assert!(out.is_sorted_by_key(|event| event.arrived), "in the order of arrival");
    (out, injector.truth().clone())
}

fn front(truth: &FaultTruth) -> FaultCounts {
    truth.sensors["front"]
}

fn decode(events: &[Event]) -> StreamDecoder {
    let (mut decoder, mut out) = (StreamDecoder::new(Settings::default()), Decoded::default());
    for event in events {
        if let Body::LidarPacket { bytes, .. } = &event.body {
            out.clear();
            decoder.push(bytes, event.arrived, &mut out);
        }
    }
    decoder
}

#[test]
fn nothing_is_done_without_faults() {
    let events = lidar(1);
    let (out, truth) = run(&events, 1, Vec::new());
    assert_eq!((out, front(&truth).items), (events, 1_508));
}

#[test]
fn losses_by_the_stamps_are_those_injected() {
    // The last second is whole, so that stamps can tell all losses.
    let events = lidar(6);
    let window = |action| fault(Some("front"), 1.0, Some(5.0), action);
    let faults = vec![
        window(Action::Loss { probability: 0.02 }),
        window(Action::Burst { probability: 0.000_5, items: 40 }),
        fault(Some("rear"), 0.0, None, Action::Loss { probability: 1.0 }),
    ];
    let (out, truth) = run(&events, 3, faults);
    let counts = front(&truth);
    // Four seconds: 6028 packets, 2 % of them 121 ± 11; bursts 3 ± 1.7 of 40.
    assert!((80..170).contains(&(counts.lost - 40 * counts.bursts)) && counts.bursts > 0, "{counts:?}");
    assert_eq!(events.len() - out.len(), (counts.lost + counts.lost_positions) as usize);
    let decoder = decode(&out);
    assert_eq!(decoder.tracker().totals().lost, counts.lost);
    assert_eq!(decoder.tracker().totals().received, counts.items - counts.lost);
}

#[test]
fn repeated_and_overtaken_packets_are_those_injected() {
    let events = lidar(2);
    let (out, truth) = run(&events, 4, vec![fault(None, 0.1, Some(1.8), Action::Duplicate { probability: 0.03 })]);
    let (totals, counts) = (decode(&out).tracker().totals(), front(&truth));
    let positions =
        out.iter().filter(|event| matches!(&event.body, Body::LidarPacket { bytes, .. } if bytes.len() == 512));
    let repeated_positions = positions.count() as u64 - 2;
    assert!(counts.duplicated > 40, "{counts:?}");
    assert_eq!((totals.duplicates, totals.lost), (counts.duplicated - repeated_positions, 0));

    let action = Action::Reorder { probability: 0.02, depth: 3 };
    let (out, truth) = run(&events, 4, vec![fault(None, 0.1, Some(1.8), action)]);
    let (totals, counts) = (decode(&out).tracker().totals(), front(&truth));
    assert!(counts.overtaken > 30, "{counts:?}");
    assert_eq!((out.len(), totals.lost), (events.len(), 0));
    // A packet that waits behind one that waits itself may find its place again.
    assert!(totals.late <= counts.overtaken && totals.late * 10 >= counts.overtaken * 9, "{totals:?} {counts:?}");
}

#[test]
fn broken_and_foreign_payloads_are_refused_and_counted() {
    let events = lidar(2);
    let spoof = |payload| Action::Spoof { probability: 0.05, payload };
    for action in
        [Action::Resize { probability: 0.05, bytes: 100 }, spoof(Payload::Noise), spoof(Payload::OtherProduct)]
    {
        let (out, truth) = run(&events, 5, vec![fault(None, 0.2, Some(1.8), action)]);
        let counts = front(&truth);
        let refused = decode(&out).counts().refused();
        let done = counts.resized + counts.spoofed;
        // A position packet that is resized or copied is refused or not by its length; there are two.
        assert!(done > 80 && refused.abs_diff(done) <= 2, "{action:?}: {refused} {counts:?}");
    }
    let action = Action::Corrupt { probability: 1.0, bytes: 3 };
    let (out, truth) = run(&events, 5, vec![fault(None, 0.0, None, action)]);
    let changed = events.iter().zip(&out).filter(|(before, after)| before.body != after.body).count();
    // Three flips of one byte can undo each other: hardly ever.
    assert!(changed + 2 >= events.len() && front(&truth).corrupted == events.len() as u64);
}

#[test]
fn late_items_arrive_late_and_others_do_not_wait_for_them() {
    let mut both = lidar(1);
    both.extend(kinect(30));
    both.sort_by_key(|event| event.arrived);
    let faults = vec![fault(Some("left"), 0.0, None, Action::Delay { delay_s: 0.2, jitter_s: 0.0 })];
    let (out, truth) = run(&both, 1, faults);
    assert_eq!((out.len(), truth.sensors["left"].delayed, front(&truth).delayed), (both.len(), 30, 0));
    let of = |events: &[Event], name: &str| {
        let id = SensorId::from(name);
        let times = events.iter().filter(|event| event.body.sensor() == Some(&id)).map(|event| event.arrived.0);
        times.collect::<Vec<_>>()
    };
    assert_eq!(of(&out, "front"), of(&both, "front"));
    assert!(of(&out, "left").iter().zip(of(&both, "left")).all(|(late, before)| late - before == 200_000_000));
}

#[test]
fn a_reboot_is_silence_and_a_counter_from_one_second_on() {
    let (out, truth) = run(&lidar(5), 1, vec![fault(None, 2.0, None, Action::Reboot { silent_s: 1.5 })]);
    let counts = front(&truth);
    // 1.5 s at 1507 packets/s and the position packets of 2 s and 3 s.
    assert!((2_255..2_270).contains(&counts.silenced) && counts.reboots == 1, "{counts:?}");
    assert_eq!(decode(&out).tracker().totals().resets, 1);
    let after = out.iter().find(|event| event.arrived >= RigNs(3_500_000_000)).expect("it comes back");
    let Body::LidarPacket { bytes, .. } = &after.body else { panic!("{after:?}") };
    assert_eq!(bytes[1_200..1_204], 1_000_000u32.to_le_bytes());
}

#[test]
fn an_unplugged_kinect_is_lost_and_opened_again() {
    let (out, truth) = run(&kinect(120), 1, vec![fault(Some("left"), 1.0, Some(2.5), Action::Unplug)]);
    // Frames 31 (1.033 s) to 75 (2.499999975 s).
    assert_eq!(truth.sensors["left"].silenced, 45);
    let states: Vec<_> = out
        .iter()
        .filter_map(|event| match event.body {
            Body::SensorState { state, .. } => Some((state, event.arrived.0 / 33_333_333)),
            _ => None,
        })
        .collect();
    assert_eq!(states, [(SourceState::Lost, 31), (SourceState::Opened, 76)]);
    assert_eq!(out.len(), 120 - 45 + 2 + 4);
}

#[test]
fn frozen_frames_keep_their_stamps_and_clocks_step() {
    let faults = vec![
        fault(None, 1.0, Some(2.0), Action::Freeze),
        fault(None, 3.0, None, Action::ClockStep { step_s: -100.0 }),
        fault(None, 2.0, Some(3.0), Action::WallStep { step_s: 3_600.0 }),
    ];
    let events = kinect(120);
    let (out, truth) = run(&events, 1, faults);
    let frame = |k: usize| {
        let frames = out.iter().filter_map(|event| match &event.body {
            Body::DepthFrame { ticks, bytes, .. } => Some((ticks.expect("stamped").0, bytes[0])),
            _ => None,
        });
        frames.collect::<Vec<_>>()[k]
    };
    // Frames 31 to 60 show what 31 saw.
    assert_eq!([frame(30).1, frame(31).1, frame(60).1, frame(61).1], [30, 31, 31, 61]);
    assert_eq!((frame(60).0, truth.sensors["left"].frozen), (120_000_000, 29));
    // 100 s are 6e9 ticks.
    assert_eq!(frame(91).0, 182_000_000u32.wrapping_sub(6_000_000_000u64 as u32));
    let anchors = out.iter().filter_map(|event| match event.body {
        Body::Anchor { unix } => Some(unix.0 - event.arrived.0 - 1_000),
        _ => None,
    });
    // Anchors come with frames 0, 30, 60 and 90: at 0, 1, 2 and 3 s less some ns.
    assert_eq!((anchors.collect::<Vec<_>>(), truth.anchors_stepped), (vec![0, 0, 0, 3_600_000_000_000], 1));
}

#[test]
fn a_pulse_comes_and_goes() {
    let faults = vec![fault(None, 1.5, Some(3.5), Action::Pps { state: Pulse::Locked })];
    let (out, truth) = run(&lidar(5), 1, faults);
    let pulses: Vec<Pps> = out
        .iter()
        .filter_map(|event| match &event.body {
            Body::LidarPacket { bytes, .. } => PositionPacket::parse(bytes).ok().map(|position| position.pps),
            _ => None,
        })
        .collect();
    assert_eq!(pulses, [Pps::Absent, Pps::Absent, Pps::Locked, Pps::Locked, Pps::Absent]);
    assert_eq!(front(&truth).pulses, 2);
}

#[test]
fn numbers_that_mean_nothing_are_named() {
    let refused = |fault| {
        let script = FaultScript { seed: 0, fault: vec![fault] };
        script.check().expect_err("refused").to_string()
    };
    let loss = fault(None, 0.0, None, Action::Loss { probability: 1.5 });
    assert_eq!(refused(loss), "fault 1: probability is 1.5; 0 to 1 expected");
    let window = fault(None, 5.0, Some(4.0), Action::Unplug);
    assert_eq!(refused(window), "fault 1: until_s is 4; 0 s or later, and the end not before the beginning expected");
    let nan = fault(None, 0.0, None, Action::Delay { delay_s: f64::NAN, jitter_s: 0.0 });
    assert_eq!(refused(nan), "fault 1: delay_s is NaN; 0 to 60 s expected");
}

fn any_action() -> impl Strategy<Value = Action> {
    let probability = 0.0f64..0.3;
    prop_oneof![
        probability.clone().prop_map(|probability| Action::Loss { probability }),
        (probability.clone(), 1u32..5).prop_map(|(probability, items)| Action::Burst { probability, items }),
        probability.clone().prop_map(|probability| Action::Duplicate { probability }),
        (probability.clone(), 1u32..6).prop_map(|(probability, depth)| Action::Reorder { probability, depth }),
        (probability.clone(), 1u32..9).prop_map(|(probability, bytes)| Action::Corrupt { probability, bytes }),
        (probability.clone(), 0u32..99).prop_map(|(probability, bytes)| Action::Resize { probability, bytes }),
        probability.prop_map(|probability| Action::Spoof { probability, payload: Payload::Noise }),
        (0.0f64..0.1, 0.0f64..0.1).prop_map(|(delay_s, jitter_s)| Action::Delay { delay_s, jitter_s }),
        (0.0f64..0.5).prop_map(|silent_s| Action::Reboot { silent_s }),
        Just(Action::Unplug),
        Just(Action::Freeze),
        (-9.0f64..9.0).prop_map(|step_s| Action::ClockStep { step_s }),
    ]
}

proptest! {
    /// Any script: what comes out is what went in, less and more what the counts say; and the same again. What is done to
    /// one sensor does not depend on another's events.
    #[test]
    fn counts_are_the_whole_truth(
        actions in prop::collection::vec((any_action(), 0.0f64..2.0, 0.0f64..2.0), 0..5),
        seed in any::<u64>(),
    ) {
        let frames = kinect(90);
        let faults: Vec<_> = actions
            .into_iter()
            .map(|(action, from_s, lasts_s)| fault(Some("left"), from_s, Some(from_s + lasts_s), action))
            .collect();
        let (out, truth) = run(&frames, seed, faults.clone());
        prop_assert_eq!(&run(&frames, seed, faults.clone()).0, &out);
        let count = |events: &[Event]| events.iter().filter(|event| matches!(event.body, Body::DepthFrame { .. })).count();
        let counts = truth.sensors["left"];
        let expected = counts.items + counts.duplicated + counts.spoofed - counts.lost - counts.silenced;
        prop_assert_eq!((counts.items, count(&out) as u64), (90, expected));

        let mut merged = frames.clone();
        merged.extend(kinect(90).into_iter().map(|mut event| {
            event.arrived.0 += 5_000_000;
            if let Body::DepthFrame { sensor, .. } = &mut event.body {
                *sensor = SensorId::from("right");
            }
            event
        }));
        merged.sort_by_key(|event| event.arrived);
        let (both, _) = run(&merged, seed, faults);
        let left = |events: &[Event]| {
            let left = events.iter().filter(|event| event.body.sensor().is_some_and(|id| id.as_str() == "left"));
            left.map(|event| event.body.clone()).collect::<Vec<_>>()
        };
        prop_assert_eq!(left(&both), left(&out));
    }
}
