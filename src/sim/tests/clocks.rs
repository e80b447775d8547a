//! The simulated clocks and lines, through the mapper that has to follow real ones.

use tumbled_core::clock::{ClockMode, ClockState, DeviceClock, DeviceClockKind};
use tumbled_model::RigNs;
use tumbled_sim::clock::{ClockReset, SimClock, WarmUp};
use tumbled_sim::transport::{Line, Transport};

/// Feeds a device's stamps as they arrive, `hz` a second for so many seconds. Gives the clock and the errors of its times
/// after 10 s, ns, the line's least delay taken off.
fn followed(
    clock: &SimClock,
    kind: DeviceClockKind,
    transport: Transport,
    hz: i64,
    seconds: i64,
) -> (DeviceClock, Vec<i64>) {
    let mut mapper = DeviceClock::new(kind, ClockMode::Hull);
    let mut line = Line::new(transport, "device", 0, 7);
    let least = (transport.least_s * 1e9) as i64;
    let mut errors = Vec::new();
    for k in 0..hz * seconds {
        let t = RigNs(k * 1_000_000_000 / hz);
        let raw = if kind == DeviceClockKind::Kinect { clock.kinect(t).0 } else { clock.lidar(t).0 };
        let _pushed = mapper.push(raw, line.arrive(t));
        // Right after a reset a stamp is doubted and has no time.
        if let Some(mapped) = mapper.map(raw)
            && k >= 10 * hz
        {
            errors.push((mapped.t - t).0 - least);
        }
    }
    (mapper, errors)
}

fn worst(errors: &[i64]) -> i64 {
    errors.iter().map(|error| error.abs()).max().expect("errors")
}

#[test]
fn skew_of_300_ppm_either_way_is_found_across_the_hour() {
    for skew_ppm in [-300.0, 300.0] {
        // The counter passes the hour after 15 s.
        let clock = SimClock { offset_ns: 3_585_000_000_000, skew_ppm, ..SimClock::default() };
        let (mapper, errors) = followed(&clock, DeviceClockKind::Velodyne, Transport::UDP, 1_500, 30);
        let report = mapper.report(RigNs(30_000_000_000));
        assert_eq!((report.state, report.counts.resets.total()), (ClockState::Locked, 0));
        assert_eq!(errors.len(), 20 * 1_500);
        // 300 ppm left in would be 3 ms over the hull's window; three stages of 15 µs rarely all stay below 10 µs.
        assert!(worst(&errors) < 60_000, "{} ns", worst(&errors));
    }
}

#[test]
fn a_kinect_that_warms_up_is_followed_across_the_wrap() {
    let warm_up = Some(WarmUp { ppm: 5.0, tau_s: 300.0 });
    // The counter wraps after 60 s.
    let clock = SimClock { offset_ns: 11_582_000_000, skew_ppm: 40.0, warm_up, ..SimClock::default() };
    let transport = Transport { granularity_s: 0.0, ..Transport::KINECT };
    let (mapper, errors) = followed(&clock, DeviceClockKind::Kinect, transport, 30, 90);
    let report = mapper.report(RigNs(90_000_000_000));
    assert_eq!((report.state, report.counts.resets.total()), (ClockState::Locked, 0));
    // Least of two stages of 150 µs at 30 Hz: a few tens of µs above none, 0.5 ms is the design's largest p99 with jitter.
    assert!(worst(&errors) < 500_000, "{} ns", worst(&errors));
}

#[test]
fn a_reboot_is_a_new_epoch() {
    let resets = vec![ClockReset { at_ns: 15_000_000_000, to_ns: 0 }];
    let clock = SimClock { offset_ns: 500_000_000_000, resets, ..SimClock::default() };
    let (mapper, _) = followed(&clock, DeviceClockKind::Velodyne, Transport::UDP, 1_500, 20);
    assert_eq!(mapper.report(RigNs(20_000_000_000)).counts.resets.device, 1);
}

/// The looks of a host 2 ms apart pass over a Kinect's frames as slowly as its clock is off, so a frame that was looked for
/// at once comes seldom; 30 frames a second lie at three places between two looks, 0.67 ms apart.
#[test]
fn a_kinects_mapped_stamps_are_late_by_what_its_line_takes_at_least() {
    const FRAME_NS: i64 = 33_333_333;
    for skew_ppm in [-60.0, -25.0, 40.0] {
        let clock = SimClock { offset_ns: 31_000_000_000, skew_ppm, ..SimClock::default() };
        let mut mapper = DeviceClock::new(DeviceClockKind::Kinect, ClockMode::Hull);
        let mut line = Line::new(Transport::KINECT, "near", 0, 1);
        let mut late = Vec::new();
        for frame in 0..3_000 {
            let sent = clock.instant(frame * FRAME_NS + FRAME_NS / 2);
            let raw = clock.kinect(sent).0;
            let _pushed = mapper.push(raw, line.arrive(sent));
            late.extend(mapper.map(raw).filter(|_| frame > 1_000).map(|mapped| (mapped.t - sent).0 as f64 * 1e-6));
        }
        let mean_ms = late.iter().sum::<f64>() / late.len() as f64 - Transport::KINECT.least().as_secs_f64() * 1e3;
        assert!(late.len() > 1_900 && mean_ms.abs() < 0.35, "{skew_ppm} ppm: {mean_ms} ms");
    }
}
