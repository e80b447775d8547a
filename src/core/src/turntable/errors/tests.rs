use super::*;
use crate::estimate::{StateInputs, TargetMotion, Validity};
use nalgebra::Isometry3;

const S: i64 = 1_000_000_000;
/// The table turns at 20 °/s.
const RATE: f64 = 20.0 / 180.0 * PI;

fn angle(t: f64, from: f64) -> TurntableSample {
    TurntableSample {
        sensor: "turntable".into(),
        t: RigNs((t * 1e9).round() as i64),
        t_sigma: Span(0),
        half_rtt: None,
        angle_rad: from + RATE * t,
        sigma_rad: 0.0,
        rate_rps: RATE,
        moving: None,
        is_truth: true,
    }
}

/// A target that turns about −y, which the encoder counts upwards, `gain` times as fast as the table.
fn state(t: f64, gain: f64, mode: Mode) -> TargetState {
    let turn = Vector3::y() * -(RATE * gain);
    // Any attitude it began with: the errors are of what was turned since.
    let rotation = UnitQuaternion::new(turn * t) * UnitQuaternion::new(Vector3::new(0.4, -1.0, 2.0));
    TargetState {
        epoch: 0,
        t: RigNs((t * 1e9).round() as i64),
        sensor: "near".into(),
        mode,
        validity: Validity::Ok,
        reasons: Vec::new(),
        motion: Some(TargetMotion {
            t_rig_target: Isometry3::from_parts(Default::default(), rotation),
            velocity_mps: Vector3::zeros(),
            angular_velocity_rps: turn,
            covariance: crate::estimate::MotionCovariance::zeros(),
            spin: None,
            momentum: None,
        }),
        nis: None,
        inputs: StateInputs::default(),
        alternatives: 0,
    }
}

/// 50 angles and 10 states a second; what is told at each whole second.
fn told(watch: &mut ErrorWatch, seconds: core::ops::Range<i64>, gain: f64, from: f64) -> Vec<Option<TurntableErrors>> {
    let mut told = Vec::new();
    for n in seconds.start * 50..seconds.end * 50 {
        let t = n as f64 / 50.0;
        watch.angle(&angle(t, from));
        if n % 5 == 0 {
            watch.state(&state(t, gain, Mode::Tracking));
        }
        if n % 50 == 49 {
            told.push(watch.errors(RigNs((n / 50 + 1) * S)));
        }
    }
    told
}

#[test]
fn a_target_that_turns_one_percent_too_fast_is_off_by_what_it_gained_since_the_first_second() {
    let mut watch = ErrorWatch::default();
    watch.set_axis(Some(Vector3::new(0.0, -2.0, 2.0 * libm::tan(PI / 180.0))));
    let all = told(&mut watch, 0..40, 1.01, 0.7);
    // After a second nothing is scored: the rate of a state needs a quarter of a second before it.
    assert_eq!(all[0], None);
    let last = all.last().copied().flatten().expect("errors");
    // From 0.3 s to 39.0 s: 388 states. 0.2 °/s · (39.0 − mean of 0.3 … 1.3 s) = 0.2 · 38.2 = 7.64°.
    assert_eq!((last.since_ns, last.states, last.recent), (S * 3 / 10, 388, 100), "{last:?}");
    assert!((last.about_axis_deg - 7.64).abs() < 1e-6, "{last:?}");
    assert!((last.rate_dps - 0.2).abs() < 1e-9 && (last.rate_rms_dps - 0.2).abs() < 1e-9, "{last:?}");
    // The mean of the last ten seconds is 4.95 s earlier: 6.65°; spread 0.2 · 10 / √12 = 0.577°.
    assert!((last.about_axis_rms_deg - (6.65_f64 * 6.65 + 0.577 * 0.577).sqrt()).abs() < 1e-3, "{last:?}");
    assert!((last.axis_deg.expect("calibrated") - 1.0).abs() < 1e-6, "{last:?}");
}

#[test]
fn without_angles_or_turning_there_are_no_errors_and_without_a_calibrated_axis_none_of_it() {
    let mut watch = ErrorWatch::default();
    for n in 0..100 {
        watch.state(&state(f64::from(n) / 10.0, 1.0, Mode::Tracking));
    }
    assert_eq!(watch.errors(RigNs(20 * S)), None);
    let mut watch = ErrorWatch::default();
    let last = told(&mut watch, 0..5, 1.0, 0.0).last().copied().flatten().expect("errors");
    assert!(last.axis_deg.is_none() && last.about_axis_deg.abs() < 1e-9, "{last:?}");
    // Ten seconds after the last state there is nothing to tell.
    assert_eq!(watch.errors(RigNs(17 * S)), None);
}

#[test]
fn a_new_zero_of_the_encoder_and_a_new_target_begin_anew() {
    let mut watch = ErrorWatch::default();
    told(&mut watch, 0..10, 1.0, 0.0);
    let moved = told(&mut watch, 10..20, 1.0, 2.0).last().copied().flatten().expect("errors");
    assert!((10 * S..11 * S).contains(&moved.since_ns) && moved.about_axis_deg.abs() < 1e-9, "{moved:?}");
    watch.state(&state(20.0, 1.0, Mode::Acquiring));
    let again = told(&mut watch, 20..30, 1.0, 2.0).last().copied().flatten().expect("errors");
    assert!((20 * S..21 * S).contains(&again.since_ns), "{again:?}");
}

#[test]
fn whatever_comes_little_is_kept() {
    let mut watch = ErrorWatch::default();
    for n in 0..100_000 {
        let t = f64::from(n) / 100.0;
        // A new zero every 50 angles.
        watch.angle(&angle(t, f64::from(n / 50)));
        watch.state(&state(t, 1.0, Mode::Tracking));
    }
    assert!(watch.waiting.len() <= MOST && watch.segments.len() <= MOST_SEGMENTS);
    assert!(watch.segments.iter().all(|(_, kept)| kept.len() <= MOST));
}
