//! What happens to clocks in the field. After each: right again within 5 s of data, and no time ever falls.

use crate::generator::{CAMERA, Device, LIDAR, MS, Outcome, S, Sample, never_falls, run, run_fresh, since, worst};
use tumbled_core::clock::{ClockMode, ClockState, DeviceClock, Pushed, WallClock};
use tumbled_model::{RigNs, Span, UnixNs};
use tumbled_velodyne::position::Pps;

/// Locked and right from 5 s of data after `incident_s` on: 100 µs over UDP, the accepted maximum of 1 ms over USB.
fn assert_recovered(device: &Device, outcomes: &[Outcome], incident_s: i64) {
    assert!(never_falls(outcomes), "a time fell");
    let after = since(outcomes, incident_s + 5);
    let limit = if device.kind == LIDAR.kind { 100_000 } else { MS };
    let worst = worst(after);
    assert!(worst <= limit, "{worst} ns off");
    assert!(after.iter().all(|outcome| outcome.t.is_some() && outcome.state == ClockState::Locked));
}

/// Ticks shifted by `ticks` for the samples made at or after `from_s`.
fn shifted(device: &Device, mut samples: Vec<Sample>, from_s: i64, ticks: i64) -> Vec<Sample> {
    for sample in samples.iter_mut().filter(|sample| sample.made >= from_s * S) {
        sample.raw = (i64::from(sample.raw) + ticks).rem_euclid(device.kind.parameters().wrap) as u32;
    }
    samples
}

#[test]
fn a_start_is_right_within_five_seconds() {
    for device in [LIDAR, CAMERA] {
        for seed in 0..20 {
            let (outcomes, _) = run_fresh(&device, ClockMode::Hull, &device.samples(0, 20, seed));
            assert_recovered(&device, &outcomes, 0);
        }
    }
}

/// The host reads 50 µs after the kernel stamped in wall time, and converts with both clocks as they are then.
#[test]
fn an_hour_of_wall_clock_step_moves_no_time() {
    for step in [3_600 * S, -3_600 * S] {
        let samples = LIDAR.samples(0, 90, 11);
        let wall_at = |mono: i64| 1_800_000_000 * S + mono + if mono >= 60 * S { step } else { 0 };
        let through_wall_time = |sample: &Sample| {
            let kernel_stamp = wall_at(sample.arrived);
            let read_at = sample.arrived + 50_000;
            let arrived = read_at - (wall_at(read_at) - kernel_stamp);
            // A step between stamp and read: the read's own time serves.
            let plausible = (read_at - S..=read_at).contains(&arrived);
            Sample { arrived: if plausible { arrived } else { read_at }, ..*sample }
        };
        let stepped: Vec<Sample> = samples.iter().map(through_wall_time).collect();
        let times = |samples: &[Sample]| -> Vec<Option<i64>> {
            run_fresh(&LIDAR, ClockMode::Hull, samples).0.iter().map(|outcome| outcome.t).collect()
        };
        assert_eq!(times(&stepped), times(&samples));

        let mut wall = WallClock::new();
        let steps: Vec<Span> =
            (0..90).filter_map(|second| wall.anchor(RigNs(second * S), UnixNs(wall_at(second * S)))).collect();
        assert_eq!(steps, [Span(step)]);
    }
}

#[test]
fn the_top_of_the_hour_is_no_incident() {
    let device = Device { first_raw: 3_570_000_000, ..LIDAR };
    let samples = device.samples(0, 90, 12);
    assert!(samples.iter().any(|sample| sample.raw < 1_000));
    let (outcomes, report) = run_fresh(&device, ClockMode::Hull, &samples);
    assert_recovered(&device, &outcomes, 0);
    assert_eq!((report.counts.resets.total(), report.counts.raw_over_hour), (0, 0));
}

#[test]
fn the_wrap_at_two_to_the_32_is_no_incident() {
    // 150 s at 60 MHz are 9e9 ticks: two wraps.
    let samples = CAMERA.samples(0, 150, 13);
    assert_eq!(samples.windows(2).filter(|pair| pair[1].raw < pair[0].raw).count(), 2);
    let (outcomes, report) = run_fresh(&CAMERA, ClockMode::Hull, &samples);
    assert_recovered(&CAMERA, &outcomes, 0);
    assert_eq!(report.counts.resets.total(), 0);
}

#[test]
fn a_counter_that_was_never_set_runs_past_the_hour_to_two_to_the_32_and_is_flagged() {
    // 2³² − 4,264,967,296 = 30,000,000: 30 s to the wrap. 20 s to the hour from 3,580,000,000.
    for (first, over_before_wrap) in [(4_264_967_296_i64, true), (3_580_000_000, false)] {
        let mut samples = LIDAR.samples(0, 60, 14);
        let base = i64::from(LIDAR.first_raw);
        for sample in &mut samples {
            sample.raw = ((first + i64::from(sample.raw) - base) & 0xFFFF_FFFF) as u32;
        }
        let over = samples.iter().filter(|sample| sample.raw >= 3_600_000_000).count() as u64;
        let (outcomes, report) = run_fresh(&LIDAR, ClockMode::Hull, &samples);
        assert_recovered(&LIDAR, &outcomes, 0);
        assert_eq!((report.counts.resets.total(), report.counts.raw_over_hour), (0, over));
        assert_eq!(samples.first().is_some_and(|first| first.raw >= 3_600_000_000), over_before_wrap);
    }
}

#[test]
fn a_counter_set_by_the_pulse_begins_an_epoch() {
    // Below a second, both ways; whole minutes, both ways: 0.4 s, 17 min.
    for ticks in [-400_000, 400_000, -1_020_000_000, 1_020_000_000] {
        let samples = shifted(&LIDAR, LIDAR.samples(0, 120, 15), 60, ticks);
        let mut clock = DeviceClock::new(LIDAR.kind, ClockMode::Hull);
        // The position packet that tells comes up to 14 data packets after the counter was set.
        let told = samples.partition_point(|sample| sample.made < 60 * S) + 14;
        let mut outcomes = Vec::new();
        for (said, samples) in [(Pps::Synchronising, &samples[..told]), (Pps::Locked, &samples[told..])] {
            for part in samples.chunks(14) {
                clock.note_pps(said);
                outcomes.extend(run(&mut clock, part, LIDAR.least_delay_ns));
            }
        }
        assert_recovered(&LIDAR, &outcomes, 60);
        assert!(outcomes.iter().filter(|outcome| outcome.t.is_none()).count() <= 2, "two doubtful stamps at most");
        let resets = clock.report(RigNs(120 * S)).counts.resets;
        // A counter 0.4 s back looks like reordering for 32 packets, and the second word comes before; what the stamps
        // themselves tell at once is not told again.
        let expected = if ticks == -400_000 { (1, 0) } else { (0, 1) };
        assert_eq!((resets.pps, resets.device, resets.total()), (expected.0, expected.1, 1), "{ticks}");
    }
}

#[test]
fn a_set_counter_is_noticed_without_being_told() {
    for ticks in [-400_000, 400_000, -1_020_000_000, 1_020_000_000] {
        let samples = shifted(&LIDAR, LIDAR.samples(0, 120, 16), 60, ticks);
        let (outcomes, report) = run_fresh(&LIDAR, ClockMode::Hull, &samples);
        assert_recovered(&LIDAR, &outcomes, 60);
        assert_eq!((report.counts.resets.device, report.counts.resets.total()), (1, 1), "{ticks}");
    }
}

#[test]
fn a_pulse_state_that_stays_resets_nothing() {
    let samples = LIDAR.samples(0, 10, 17);
    let mut clock = DeviceClock::new(LIDAR.kind, ClockMode::Hull);
    for part in samples.chunks(14) {
        clock.note_pps(Pps::Locked);
        run(&mut clock, part, LIDAR.least_delay_ns);
    }
    let report = clock.report(RigNs(10 * S));
    assert_eq!((report.counts.resets.total(), report.pps, report.state), (0, Some(Pps::Locked), ClockState::Locked));
}

#[test]
fn one_forged_word_about_the_pulse_resets_nothing() {
    let samples = LIDAR.samples(0, 30, 28);
    let mut clock = DeviceClock::new(LIDAR.kind, ClockMode::Hull);
    let lies = [Pps::Locked, Pps::Absent, Pps::Error, Pps::Unknown(200)];
    for (part, lie) in samples.chunks(140).zip(lies.iter().cycle()) {
        clock.note_pps(Pps::Synchronising);
        run(&mut clock, part, LIDAR.least_delay_ns);
        clock.note_pps(*lie);
    }
    // The first word may be the forged one: nothing is known before two agree.
    let mut begun = DeviceClock::new(LIDAR.kind, ClockMode::Hull);
    begun.note_pps(Pps::Unknown(77));
    for part in samples.chunks(140) {
        run(&mut begun, part, LIDAR.least_delay_ns);
        begun.note_pps(Pps::Absent);
    }
    for clock in [clock, begun] {
        let report = clock.report(RigNs(30 * S));
        assert_eq!((report.counts.resets.total(), report.state), (0, ClockState::Locked), "{report:?}");
    }
}

#[test]
fn a_reboot_begins_an_epoch() {
    for device in [LIDAR, CAMERA] {
        // The device is away for 3 s and comes back with its counter at 0; and, for longer than a silence, 20 s.
        for away_s in [3, 20] {
            let mut samples = device.samples(0, 60, 18);
            let back = Device { first_raw: 0, ..device };
            samples.extend(back.samples(60 + away_s, 120, 19));
            let (outcomes, report) = run_fresh(&device, ClockMode::Hull, &samples);
            assert_recovered(&device, since(&outcomes, 60 + away_s), 60 + away_s);
            assert!(never_falls(&outcomes));
            assert_eq!((report.counts.resets.device, report.counts.resets.total()), (1, 1), "{device:?}, {away_s} s");
        }
    }
}

#[test]
fn two_hours_of_silence_begin_an_epoch_and_the_counter_is_known_to_have_run_on() {
    for device in [LIDAR, CAMERA] {
        let all = device.samples(0, 7_320, 20);
        let heard = |sample: &&Sample| sample.made < 60 * S || sample.made >= 7_260 * S;
        let samples: Vec<Sample> = all.iter().filter(heard).copied().collect();
        let (outcomes, report) = run_fresh(&device, ClockMode::Hull, &samples);
        assert_recovered(&device, since(&outcomes, 7_260), 7_260);
        assert!(never_falls(&outcomes));
        assert_eq!((report.counts.resets.gap, report.counts.resets.total()), (1, 1), "{device:?}");
    }
}

#[test]
fn duplicates_change_nothing() {
    let samples = LIDAR.samples(0, 90, 21);
    let mut doubled = Vec::new();
    for (index, sample) in samples.iter().enumerate() {
        doubled.push(*sample);
        if index % 5 == 0 {
            doubled.push(Sample { arrived: sample.arrived + 100_000, ..*sample });
        }
    }
    let (plain, _) = run_fresh(&LIDAR, ClockMode::Hull, &samples);
    let (all, report) = run_fresh(&LIDAR, ClockMode::Hull, &doubled);
    assert_eq!(report.counts.duplicates, (doubled.len() - samples.len()) as u64);
    let first_of_each: Vec<Outcome> =
        all.iter().filter(|outcome| outcome.pushed != Pushed::Duplicate).copied().collect();
    assert_eq!(first_of_each, plain);
}

#[test]
fn reordered_packets_get_the_times_of_their_stamps() {
    let mut samples = LIDAR.samples(0, 90, 22);
    // One packet is overtaken by the next, another by the next 20; arrivals stay sorted.
    for (every, by) in [(7, 1), (501, 20)] {
        for index in (0..samples.len() - by).step_by(every) {
            samples[index].arrived = samples[index + by].arrived;
            samples[index..=index + by].rotate_left(1);
        }
    }
    let (mut outcomes, report) = run_fresh(&LIDAR, ClockMode::Hull, &samples);
    assert_eq!(report.counts.resets.total(), 0);
    assert!(report.counts.reordered > 10_000, "{report:?}");
    outcomes.sort_by_key(|outcome| outcome.made);
    assert!(outcomes.is_sorted_by_key(|outcome| outcome.t), "a later stamp got an earlier time");
    assert_recovered(&LIDAR, &outcomes, 0);
}

#[test]
fn forged_stamps_have_no_time_and_move_no_other() {
    for device in [LIDAR, CAMERA] {
        let samples = device.samples(0, 90, 23);
        let mut attacked = Vec::new();
        for (index, sample) in samples.iter().enumerate() {
            attacked.push(*sample);
            if index % 3 == 0 && sample.made > 5 * S {
                // Ahead by 0.1 s to 20 min, or behind by more than a second.
                let raw = sample.raw.wrapping_add(device.kind.parameters().hz as u32 / 10 * (1 + index as u32 % 500));
                attacked.push(Sample { raw, made: -1, ..*sample });
            }
        }
        let (plain, _) = run_fresh(&device, ClockMode::Hull, &samples);
        let (all, report) = run_fresh(&device, ClockMode::Hull, &attacked);
        let (forged, genuine): (Vec<Outcome>, Vec<Outcome>) = all.iter().partition(|outcome| outcome.made == -1);
        assert_eq!(genuine, plain, "{device:?}");
        // 500 · 0.1 s lies beyond a Kinect's half wrap (35.8 s) and so behind, where the last second is reordering.
        let refused = forged.iter().filter(|outcome| outcome.t.is_none()).count();
        assert!(refused * 100 >= forged.len() * 95, "{refused} of {}", forged.len());
        assert_eq!(report.counts.resets.total(), 0);
    }
}

#[test]
fn a_counter_that_stood_still_begins_an_epoch() {
    // The stamps stop for 3 s of data and go on from there: nothing goes back, but all is 3 s late from then on.
    let mut samples = LIDAR.samples(0, 90, 24);
    let stopped_at =
        samples.iter().find(|sample| sample.made >= 60 * S).map(|sample| sample.raw).expect("in the middle");
    for sample in &mut samples {
        if (60 * S..63 * S).contains(&sample.made) {
            sample.raw = stopped_at;
        } else if sample.made >= 63 * S {
            sample.raw -= 3_000_000;
        }
    }
    let (outcomes, report) = run_fresh(&LIDAR, ClockMode::Hull, &samples);
    // Two seconds to be sure, then 5 s of data.
    assert_recovered(&LIDAR, &outcomes, 63 + 3);
    assert_eq!(report.counts.resets.device, 1);
    assert!(report.counts.duplicates > 4_000);
}

#[test]
fn a_host_that_anchors_anew_begins_an_epoch() {
    let samples = CAMERA.samples(0, 90, 25);
    let half = samples.len() / 2;
    let mut clock = DeviceClock::new(CAMERA.kind, ClockMode::Hull);
    let mut outcomes = run(&mut clock, &samples[..half], CAMERA.least_delay_ns);
    clock.reanchor();
    outcomes.extend(run(&mut clock, &samples[half..], CAMERA.least_delay_ns));
    assert_recovered(&CAMERA, &outcomes, 45);
    assert_eq!(clock.report(RigNs(90 * S)).counts.resets.reanchor, 1);
}

/// 10 s of 20 ms more delay on everything, as a busy host gives: less than half the window, so the hull stays below.
#[test]
fn a_stall_of_the_host_shorter_than_half_a_window_moves_nothing() {
    let mut samples = LIDAR.samples(0, 180, 26);
    for sample in samples.iter_mut().filter(|sample| (90 * S..100 * S).contains(&sample.made)) {
        sample.arrived += 20 * MS;
    }
    let (outcomes, report) = run_fresh(&LIDAR, ClockMode::Hull, &samples);
    assert_recovered(&LIDAR, &outcomes, 0);
    assert_eq!((report.counts.steps, report.counts.resets.total()), (0, 0));
}

/// 60 s of it: two windows. Nothing tells it from the clock, so the line follows in one step; the first packets after it
/// come 20 ms before they could have been sent, and that begins an epoch.
#[test]
fn a_stall_of_the_host_longer_than_a_window_is_followed_and_left_again() {
    let mut samples = LIDAR.samples(0, 200, 27);
    for sample in samples.iter_mut().filter(|sample| (90 * S..150 * S).contains(&sample.made)) {
        sample.arrived += 20 * MS;
    }
    let (outcomes, report) = run_fresh(&LIDAR, ClockMode::Hull, &samples);
    assert_recovered(&LIDAR, &outcomes, 150);
    assert!(worst(since(&outcomes, 130)) >= 19 * MS, "followed");
    assert_eq!((report.counts.steps, report.counts.resets.device), (1, 1));
    assert!(report.counts.held > 0);
}
