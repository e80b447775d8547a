//! What holds for any input.

use proptest::prelude::*;
use tumbled_core::clock::{ClockMode, DeviceClock, DeviceClockKind, Pushed, UtcMap, WallClock};
use tumbled_model::{RigNs, Span, UnixNs};
use tumbled_velodyne::clock::UtcState;
use tumbled_velodyne::position::Pps;

const KINDS: [DeviceClockKind; 3] = [DeviceClockKind::Velodyne, DeviceClockKind::Kinect, DeviceClockKind::LineStream];
const MODES: [ClockMode; 3] = [ClockMode::Hull, ClockMode::Arrival, ClockMode::Kalman];

/// Steps of device time, ns: mostly packet-sized, sometimes seconds, up to near half a wrap of a Kinect.
fn device_step() -> impl Strategy<Value = i64> {
    prop_oneof![
        8 => 600_000i64..40_000_000,
        2 => 40_000_000i64..3_000_000_000,
        1 => 3_000_000_000i64..35_000_000_000,
    ]
}

/// Arrival against the device's time, ns: usually late by little, sometimes by much, sometimes early.
fn lateness() -> impl Strategy<Value = i64> {
    prop_oneof![
        6 => 0i64..2_000_000,
        2 => 0i64..3_000_000_000,
        1 => -10_000_000_000i64..0,
        1 => any::<i64>().prop_map(|any| any >> 8),
    ]
}

proptest! {
    #[test]
    fn times_of_later_ticks_are_not_earlier_whatever_arrives_when(
        kind in 0..KINDS.len(), mode in 0..MODES.len(), first in 0u32..3_600_000_000,
        steps in prop::collection::vec((device_step(), lateness(), 0u8..40), 1..400)
    ) {
        let kind = KINDS[kind];
        let parameters = kind.parameters();
        let mut clock = DeviceClock::new(kind, MODES[mode]);
        let (mut elapsed, mut last) = (0, RigNs(i64::MIN));
        for (step, late, chance) in steps {
            elapsed += step;
            let ticks = i128::from(first) + i128::from(elapsed) * i128::from(parameters.hz) / 1_000_000_000;
            let raw = (ticks % i128::from(parameters.wrap)) as u32;
            match chance {
                0 => clock.reanchor(),
                1 => clock.note_pps(Pps::from_byte(step as u8 % 4)),
                _ => {}
            }
            // Far beyond half a wrap of arrival time against ticks a later tick cannot be told from an earlier one.
            let pushed = clock.push(raw, RigNs(elapsed.saturating_add(late)));
            if matches!(pushed, Pushed::InOrder | Pushed::NewEpoch) {
                let t = clock.map(raw).expect("the newest stamp").t;
                prop_assert!(t >= last, "{t:?} after {last:?}");
                last = t;
            }
        }
    }

    #[test]
    fn arbitrary_stamps_and_arrivals_are_counted_and_bounded(
        kind in 0..KINDS.len(), mode in 0..MODES.len(),
        pushes in prop::collection::vec((any::<u32>(), any::<i64>(), any::<u32>(), any::<u8>()), 1..300)
    ) {
        let mut clock = DeviceClock::new(KINDS[kind], MODES[mode]);
        let mut last = RigNs(i64::MIN);
        let count = pushes.len() as u64;
        for (raw, arrived, mapped, what) in pushes {
            clock.push(raw, RigNs(arrived));
            match what {
                0..=5 => clock.note_pps(Pps::from_byte(what)),
                6 => clock.reanchor(),
                _ => {}
            }
            let _near = clock.map(mapped);
            let newest = clock.map(raw);
            let report = clock.report(RigNs(arrived.wrapping_add(i64::from(mapped))));
            prop_assert!(report.pairs <= 8_192 && report.sigma >= Span(0));
            last = newest.map_or(last, |newest| newest.t);
        }
        prop_assert_eq!(clock.report(last).counts.pushed, count);
    }

    #[test]
    fn arbitrary_trains_of_plausible_packets_keep_their_books(
        seed in any::<u32>(), jumps in prop::collection::vec((1u32..2_000, any::<u32>()), 1..30)
    ) {
        // Runs of regular packets between arbitrary jumps of the counter: every push is one of the five kinds.
        let mut clock = DeviceClock::new(DeviceClockKind::Velodyne, ClockMode::Hull);
        let (mut raw, mut arrived) = (seed, 0i64);
        let (mut in_order, mut epochs) = (0, 0);
        for (run, to) in jumps {
            for _ in 0..run {
                match clock.push(raw, RigNs(arrived)) {
                    Pushed::InOrder => in_order += 1,
                    Pushed::NewEpoch => epochs += 1,
                    Pushed::Reordered | Pushed::Duplicate | Pushed::Doubtful => {}
                }
                raw = raw.wrapping_add(663);
                arrived += 663_552;
            }
            raw = to;
        }
        let counts = clock.report(RigNs(arrived)).counts;
        let kinds = in_order + epochs + counts.reordered + counts.duplicates + counts.doubtful;
        prop_assert_eq!((kinds, counts.resets.total() + 1), (counts.pushed, epochs));
    }

    #[test]
    fn arbitrary_anchors_give_wall_time_at_the_newest(anchors in prop::collection::vec((any::<i64>(), any::<i64>()), 1..60)) {
        let mut wall = WallClock::new();
        for (rig, unix) in anchors {
            let (rig, unix) = (RigNs(rig >> 1), UnixNs(unix >> 1));
            wall.anchor(rig, unix);
            prop_assert_eq!(wall.unix(rig), Some(unix));
        }
    }

    #[test]
    fn arbitrary_utc_updates_never_speak_before_a_lock_of_five_seconds(
        updates in prop::collection::vec((any::<bool>(), any::<i64>(), any::<i64>()), 1..60)
    ) {
        let mut map = UtcMap::new();
        for (locked, utc, t) in updates {
            let state = if locked { UtcState::Locked } else { UtcState::Sentence };
            map.update(state, Some(UnixNs(utc)), RigNs(t), Span(1_000));
            if !locked {
                prop_assert_eq!(map.utc(RigNs(t)), None);
            }
        }
    }
}
