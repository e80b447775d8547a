//! An epoch for each crossing of the region of interest, at the time when its middle is passed.

use crate::support::chance::Chance;
use crate::support::devices::{FIRING_NS, Way, lidar, packets, packets_by, vlp32c};
use crate::support::faults::{burst, repeat, swap};
use crate::support::ledger::{MS, S, Source, US, ledger, run_with, ticks};
use crate::support::rig;
use crate::support::tally::Tally;
use crate::synth::Sensor;
use tumbled_core::{CoreConfig, LidarScan, RegionOfInterest, Scan};
use tumbled_model::{Point, RigNs};
use tumbled_velodyne::{Model, ReturnMode};

/// What a test looks at of an epoch.
#[derive(Clone, Debug)]
struct Turn {
    t: i64,
    span: (i64, i64),
    coverage: f64,
    crossing: core::ops::Range<usize>,
    points: usize,
    packets: u32,
    in_roi: Vec<usize>,
    /// First and last firing that a point is of.
    firings: Vec<i64>,
}

fn turns_of(config: CoreConfig, front: Source) -> (Vec<Turn>, tumbled_core::SensorHealth) {
    let until = front.last().map_or(0, |(arrived, _)| arrived + S);
    let tally = Tally::new(Way::PERFECT);
    let mut turns = Vec::new();
    let (pipeline, _) = run_with(config, &ledger(&[front, ticks(until)]), |epoch| {
        let Scan::Lidar(scan) = &epoch.scan else { return };
        let LidarScan { crossing, coverage, packets, points, .. } = scan.as_ref();
        turns.push(Turn {
            t: epoch.t.0,
            span: (epoch.span.0.0, epoch.span.1.0),
            coverage: *coverage,
            crossing: crossing.clone(),
            points: points.len(),
            packets: *packets,
            in_roi: (0..points.len()).filter(|n| epoch.rig.in_roi[*n]).collect(),
            firings: tally.firings(scan),
        });
    });
    (turns, pipeline.sensors()[0].clone())
}

fn turns(sensor: &Sensor, ns: i64) -> Vec<Turn> {
    turns_of(rig::lidar_only(), lidar(&packets(sensor, ns), Way::PERFECT, 0)).0
}

/// The least delay of a packet that leaves when its last firing is over.
const PACKET_NS: i64 = 12 * FIRING_NS;

#[test]
fn each_passing_of_the_middle_is_an_epoch_at_its_time() {
    for rpm in [300.0, 600.0, 1_200.0] {
        let turn_ns = (60e9 / rpm) as i64;
        // The region is 323.13° to 36.87°: of the silences one lies behind it, one covers the cut, one the middle, one
        // a half, and one all of it.
        let views = [
            (None, 1.0),
            (Some((100.0, 200.0)), 1.0),
            (Some((40.0, 320.0)), 1.0),
            (Some((350.0, 10.0)), 1.0 - 20.0 / 73.74),
            (Some((0.0, 120.0)), 0.5),
            (Some((300.0, 60.0)), 0.0),
        ];
        for (silent_deg, coverage) in views {
            let turns = turns(&Sensor { rpm, silent_deg, ..vlp32c() }, 5 * S);
            let whole: Vec<&Turn> = turns.iter().filter(|turn| turn.t > 2_500 * MS && turn.t < 4_800 * MS).collect();
            assert!((whole.len() as i64 - 2_300 * MS / turn_ns).abs() <= 1, "{rpm} {silent_deg:?}: {}", whole.len());
            for turn in whole {
                // From straight back it is half a turn to the middle.
                let since = (turn.t - PACKET_NS - turn_ns / 2).rem_euclid(turn_ns);
                let error = since.min(turn_ns - since);
                assert!(error <= FIRING_NS + 2 * US, "{rpm} {silent_deg:?}: {error} ns off");
                assert!((turn.coverage - coverage).abs() < 0.02, "{rpm} {silent_deg:?}: {}", turn.coverage);
            }
        }
    }
}

#[test]
fn everything_inside_the_region_is_in_the_crossing() {
    for (model, mode) in
        [(Model::Vlp32c, ReturnMode::Strongest), (Model::Vlp32c, ReturnMode::Dual), (Model::Vlp16, ReturnMode::Last)]
    {
        let sensor = Sensor { model, mode, start_deg: 180.0, ..vlp32c() };
        // 2 m away: 500 counts of 4 mm, 1000 of 2 mm.
        let count = if model == Model::Vlp16 { 1_000 } else { 500 };
        let period = 12 / mode.blocks_per_firing() as i64 * if model == Model::Vlp16 { 110_592 } else { FIRING_NS };
        let packets = sensor.packets((2 * S / period) as usize, |slot, _| match slot {
            3 | 20 => (count, count),
            _ => (0, 0),
        });
        let (turns, _) = turns_of(rig::lidar_only(), lidar(&packets, Way::PERFECT, 0));
        assert!((20..=22).contains(&turns.len()), "{model} {mode}: {} {:?} {}", turns.len(), turns[0], packets.len());
        for turn in &turns[1..turns.len() - 1] {
            let crossing = &turn.crossing;
            assert!(
                turn.in_roi.len() > 100 && turn.in_roi.iter().all(|n| crossing.contains(n)),
                "{model}: {crossing:?}"
            );
            // 46.87° to both sides, of 360°, a firing more at most at either end.
            let share = crossing.len() as f64 / turn.points as f64;
            assert!(
                (share - 93.74 / 360.0).abs() < 2e-3,
                "{model} {mode}: {share} {crossing:?} {}..{} t {} in_roi {}",
                turn.span.0,
                turn.span.1,
                turn.t,
                turn.in_roi.len()
            );
            assert_eq!(crossing.end, turn.points, "the turn ends where the crossing does");
        }
    }
}

#[test]
fn around_the_sensor_the_whole_turn_is_the_crossing() {
    let roi = RegionOfInterest { center: Point::new(0.5, 0.0, 0.0), radius_m: 1.2 };
    let front = lidar(&packets(&vlp32c(), 3 * S), Way::PERFECT, 0);
    let (turns, _) = turns_of(CoreConfig { roi, ..rig::lidar_only() }, front);
    for turn in &turns[1..turns.len() - 1] {
        assert_eq!(turn.crossing, 0..turn.points);
        assert!(turn.coverage > 0.99, "{}", turn.coverage);
    }
    assert!((30..=31).contains(&turns.len()), "{}", turns.len());
}

#[test]
fn a_standing_motor_fills_turns_of_one_second() {
    for azimuth in [0.0, 46.87, 46.8, 200.0] {
        let front = lidar(&packets_by(5 * S, 500, |_| azimuth), Way::PERFECT, 0);
        let (turns, sensor) = turns_of(rig::lidar_only(), front);
        assert!((5..=6).contains(&turns.len()), "{azimuth}°: {} turns", turns.len());
        assert!(turns.iter().all(|turn| turn.span.1 - turn.span.0 <= S), "{azimuth}°");
        assert_eq!(sensor.points.decoded, sensor.points.in_epochs);
    }
}

#[test]
fn an_encoder_that_jitters_cuts_no_turn_twice() {
    let jitter = |t_ns: i64| (t_ns / FIRING_NS * 7_919 % 41) as f64 * 0.01 - 0.2; // ±0.2°, a firing's step
    let turning = packets_by(5 * S, 500, |t_ns| 180.0 + t_ns as f64 * 3_600e-9 + jitter(t_ns));
    let (turns, _) = turns_of(rig::lidar_only(), lidar(&turning, Way::PERFECT, 0));
    assert_eq!(turns.len(), 51, "50 cuts and the rest");
    assert!(turns[1..50].iter().all(|turn| turn.span.1 - turn.span.0 > 98 * MS));
}

#[test]
fn a_change_of_speed_leaves_one_epoch_a_turn() {
    // 300 rpm for 2 s, then faster by 300 rpm a second for 3 s, then 1200 rpm.
    let azimuth = |t_ns: i64| {
        let t = t_ns as f64 * 1e-9;
        let (ramp, rest) = ((t - 2.0).clamp(0.0, 3.0), (t - 5.0).max(0.0));
        180.0 + 1_800.0 * (t - rest) + 900.0 * ramp * ramp + 7_200.0 * rest
    };
    let last = azimuth(7 * S);
    let (turns, sensor) = turns_of(rig::lidar_only(), lidar(&packets_by(7 * S, 500, azimuth), Way::PERFECT, 0));
    // Cuts at 46.87° + n · 360°, from 180° on.
    let cuts = ((last - 46.87) / 360.0).floor() as usize;
    assert_eq!(turns.len(), cuts + 1);
    assert_eq!(sensor.lidar.expect("a LiDAR").missed_crossings, 0);
    for pair in turns.windows(2) {
        let ms = (pair[1].t - pair[0].t) / MS;
        assert!((49..=201).contains(&ms), "{ms} ms from turn to turn");
    }
}

#[test]
fn views_as_narrow_as_a_packet_give_one_epoch_a_turn() {
    // 3° and 10° within the region: half a packet, and two.
    for (from, to) in [(13.0, 10.0), (20.0, 10.0)] {
        let turns = turns(&Sensor { silent_deg: Some((from, to)), start_deg: 10.5, ..vlp32c() }, 4 * S);
        let whole: Vec<&Turn> = turns.iter().filter(|turn| (2_500 * MS..3_700 * MS).contains(&turn.t)).collect();
        assert!((11..=13).contains(&whole.len()), "{from}: {}", whole.len());
        for pair in whole.windows(2) {
            assert!((pair[1].t - pair[0].t - 100 * MS).abs() <= FIRING_NS + 10 * US, "{} {}", pair[0].t, pair[1].t);
        }
        let firings = |turn: &Turn| turn.firings[turn.firings.len() - 1] - turn.firings[0];
        assert!(whole.iter().all(|turn| firings(turn) < 55), "each epoch is of one pass: 10° are 50 firings");
    }
}

#[test]
fn a_burst_of_one_and_a_half_turns_glues_no_halves_together() {
    let turn_firings = (100 * MS / FIRING_NS) + 2;
    for from in (3_050..3_200).step_by(10) {
        let mut front = lidar(&packets(&vlp32c(), 4 * S), Way::PERFECT, 0);
        burst(&mut front, from, 226);
        let (turns, sensor) = turns_of(rig::lidar_only(), front);
        for turn in &turns {
            let (first, last) = (turn.firings[0], turn.firings[turn.firings.len() - 1]);
            assert!(last - first <= turn_firings, "from packet {from}: firings {first}..{last}");
        }
        assert!(turns.is_sorted_by_key(|turn| turn.t));
        let missed = sensor.lidar.expect("a LiDAR").missed_crossings;
        // 1.5 turns: 39 whole turns are seen or missed, and the beginning and the end.
        assert_eq!(turns.len() as u64 + missed, 41, "from packet {from}: {missed} missed");
        assert_eq!(sensor.lost.total, 226);
    }
}

#[test]
fn a_turn_counts_the_packets_that_its_points_are_from() {
    // 1507 packets a second, 150.7 a turn; the one with the cut in it counts for both turns.
    let turns = turns(&vlp32c(), 3 * S);
    assert!(turns[1..turns.len() - 1].iter().all(|turn| (151..=152).contains(&turn.packets)), "{turns:?}");
}

#[test]
fn overtaken_and_repeated_packets_change_no_epoch() {
    for silent_deg in [None, Some((40.0, 320.0)), Some((350.0, 10.0))] {
        let sensor = Sensor { silent_deg, ..vlp32c() };
        let clean = lidar(&packets(&sensor, 5 * S), Way::UDP, 3);
        let mut rough = clean.clone();
        let mut chance = Chance::new(4);
        let repeated = repeat(&mut rough, 50_000, &mut chance);
        let swapped = swap(&mut rough, 20_000, &mut chance);
        let (before, _) = turns_of(rig::lidar_only(), clean);
        let (after, health) = turns_of(rig::lidar_only(), rough);
        assert!(
            repeated > 50 && swapped > 20 && health.duplicates >= repeated / 2,
            "{repeated}, {swapped}: {health:?}"
        );
        assert_eq!((health.lost.total, health.points.late), (0, 0));
        assert_eq!(before.len(), after.len());
        for (before, after) in before.iter().zip(&after) {
            assert_eq!(before.firings, after.firings, "{silent_deg:?}: the same points in the same order");
            assert_eq!((before.crossing.clone(), before.coverage), (after.crossing.clone(), after.coverage));
            // The clock learns from a few packets less.
            let tolerance = if before.t > 3 * S { 30 * US } else { 200 * US };
            assert!((before.t - after.t).abs() <= tolerance, "{silent_deg:?}: {} and {}", before.t, after.t);
        }
    }
}

#[test]
fn the_stream_may_begin_anywhere() {
    for start_deg in [0.0, 10.0, 46.86, 46.88, 90.0, 313.0, 359.99] {
        let turns = turns(&Sensor { start_deg, ..vlp32c() }, S);
        assert!(turns.is_sorted_by_key(|turn| turn.t), "{start_deg}");
        assert!((10..=11).contains(&turns.len()), "{start_deg}: {}", turns.len());
        assert!(RigNs(turns[0].t) <= RigNs(turns[0].span.1), "{start_deg}");
    }
}
