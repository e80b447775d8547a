//! The states a clock goes through, and what it says of itself.

use crate::generator::{CAMERA, Device, LIDAR, S, run, run_fresh, since};
use tumbled_core::clock::{ClockMode, ClockState, DeviceClock, DeviceClockKind, Pushed};
use tumbled_model::{RigNs, Span};

#[test]
fn from_nothing_to_locked_to_lost_and_back() {
    let mut clock = DeviceClock::new(CAMERA.kind, ClockMode::Hull);
    let state = |clock: &DeviceClock, at: i64| clock.report(RigNs(at)).state;
    assert_eq!(state(&clock, 0), ClockState::Lost);
    assert_eq!(clock.map(0), None);

    let samples = CAMERA.samples(0, 10, 1);
    let (first, rest) = samples.split_at(45); // 1.5 s
    run(&mut clock, first, CAMERA.least_delay_ns);
    assert_eq!(state(&clock, 3 * S / 2), ClockState::Acquiring);
    run(&mut clock, rest, CAMERA.least_delay_ns);
    assert_eq!(state(&clock, 10 * S), ClockState::Locked);
    assert_eq!(state(&clock, 12 * S), ClockState::Holdover);
    assert_eq!(state(&clock, 16 * S), ClockState::Lost);
}

#[test]
fn a_holdover_ends_after_half_a_second_of_data() {
    let samples = CAMERA.samples(0, 20, 2);
    let heard: Vec<_> = samples.iter().filter(|sample| !(10 * S..13 * S).contains(&sample.made)).copied().collect();
    let (outcomes, report) = run_fresh(&CAMERA, ClockMode::Hull, &heard);
    let after = since(&outcomes, 13);
    assert_eq!(
        after.first().map(|outcome| (outcome.pushed, outcome.state)),
        Some((Pushed::InOrder, ClockState::Holdover))
    );
    let held = after.iter().filter(|outcome| outcome.state == ClockState::Holdover).count();
    // 0.5 s at 30 Hz are 15 frames; the frame that completes them is locked.
    assert!((14..=16).contains(&held), "{held}");
    assert_eq!((report.state, report.counts.resets.total()), (ClockState::Locked, 0));
}

#[test]
fn uncertainty_is_the_arrivals_while_acquiring_small_when_locked_and_grows_in_holdover() {
    let mut clock = DeviceClock::new(LIDAR.kind, ClockMode::Hull);
    let samples = LIDAR.samples(0, 60, 3);
    let outcomes = run(&mut clock, &samples, LIDAR.least_delay_ns);
    assert!(outcomes.first().is_some_and(|first| first.sigma >= 300_000));
    let locked = clock.report(RigNs(60 * S));
    assert!((1_000..20_000).contains(&locked.sigma.0), "{locked:?}");
    // 1 ppm of 4 s = 4 µs, and the newest stamp is up to a packet old at 60 s.
    let grown = clock.report(RigNs(64 * S)).sigma - locked.sigma;
    assert!((3_990..=4_010).contains(&grown.0), "{grown:?}");
}

#[test]
fn offset_and_skew_are_published() {
    let samples = LIDAR.samples(0, 60, 4);
    let (outcomes, report) = run_fresh(&LIDAR, ClockMode::Hull, &samples);
    assert!((report.skew_ppm - 20.0).abs() < 1.0, "{report:?}");
    // The stamp is µs past the hour, t is what it was mapped to.
    let (newest, t) = (samples.last().expect("data").raw, outcomes.last().and_then(|last| last.t).expect("mapped"));
    assert_eq!(report.offset, Span(t - i64::from(newest) * 1_000));
    // 30 to 31 s (the window is cut once a second) of 150.7 pairs: 4,521 to 4,672.
    assert!((4_500..=4_680).contains(&report.pairs) && (29 * S..=31 * S).contains(&report.window.0), "{report:?}");
    assert_eq!(report.counts.pushed, samples.len() as u64);
}

#[test]
fn only_stamps_near_the_newest_are_mapped() {
    let samples = LIDAR.samples(0, 5, 5);
    let mut clock = DeviceClock::new(LIDAR.kind, ClockMode::Hull);
    run(&mut clock, &samples, LIDAR.least_delay_ns);
    let newest = samples.last().expect("data").raw;
    let at = |clock: &mut DeviceClock, raw: u32| clock.map(raw).map(|mapped| mapped.t);
    let here = at(&mut clock, newest).expect("the newest itself");
    // The far end of a packet with a pause in it: 50 ms later, by a clock that is 20 ppm slow and so 1 µs more; the
    // slope is measured to better than 10 ppm here.
    let pause = (at(&mut clock, newest + 50_000).expect("near") - here).0;
    assert!((50_000_000 - 500..50_000_000 + 2_500).contains(&pause), "{pause}");
    assert!(at(&mut clock, newest - 1_000_000).is_some());
    assert_eq!((at(&mut clock, newest + 1_000_001), at(&mut clock, newest - 1_000_001)), (None, None));
}

#[test]
fn a_clock_off_by_more_than_any_crystal_is_suspect() {
    use crate::generator::Skew;
    let device = Device { skew: Skew::Constant(800.0), ..CAMERA };
    let (_, report) = run_fresh(&device, ClockMode::Hull, &device.samples(0, 30, 6));
    assert_eq!((report.state, report.counts.resets.total()), (ClockState::Suspect, 0));
}

#[test]
fn encoder_lines_lock_too() {
    let device = Device {
        kind: DeviceClockKind::LineStream,
        rate_hz: 200.0,
        first_raw: u32::MAX - 5_000_000, // wraps after 5 s
        ..CAMERA
    };
    let (outcomes, report) = run_fresh(&device, ClockMode::Hull, &device.samples(0, 60, 7));
    assert_eq!((report.state, report.counts.resets.total()), (ClockState::Locked, 0));
    assert!(crate::generator::worst(since(&outcomes, 30)) < 300_000);
}

#[test]
fn the_mode_in_use_is_in_the_report() {
    for mode in [ClockMode::Hull, ClockMode::Arrival, ClockMode::Kalman] {
        let (_, report) = run_fresh(&CAMERA, mode, &CAMERA.samples(0, 10, 8));
        assert_eq!((report.mode, report.state), (mode, ClockState::Locked));
    }
}
