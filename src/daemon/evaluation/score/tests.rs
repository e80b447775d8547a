//! Right and wrong states of a made-up turntable.

use nalgebra::{Isometry3, Vector3};
use tumbled_core::TurntableSample;
use tumbled_core::evaluate::{EstimateSample, TruthSample};
use tumbled_model::{SensorId, Span};

use super::*;
use crate::evaluation::gather::Mark;

const S: i64 = 1_000_000_000;
/// 20 °/s.
const RATE: f64 = 20.0 / 360.0 * TAU;

fn pose(seconds: f64) -> Isometry3<f64> {
    Isometry3::new(Vector3::x() * 2.0, Vector3::z() * (RATE * seconds))
}

/// Right states ten times a second from 1 s on, those from 2 s to 2.5 s half a turn off and `degraded` until 2.2 s. The
/// session began at wall time 1000 s.
fn gathered(until_s: i64) -> Gathered {
    let mut gathered = Gathered::new(UnixNs(1_000 * S));
    gathered.span = Some((RigNs(0), RigNs(until_s * S)));
    for n in 10..=10 * until_s {
        let (t, off) = (n * S / 10, (20..25).contains(&n));
        let flip = Isometry3::rotation(Vector3::x() * if off { TAU / 2.0 } else { 0.0 });
        gathered.estimates.push(EstimateSample {
            t: RigNs(t),
            t_rig_target: pose(t as f64 * 1e-9) * flip,
            velocity_mps: Vector3::zeros(),
            angular_velocity_rps: Vector3::z() * RATE,
            covariance: None,
            nis: None,
            momentum: None,
        });
        let is_ok = !(20..22).contains(&n);
        gathered.marks.push(Mark { unix: UnixNs(1_000 * S + t), is_ok, spin_sigma: None });
    }
    gathered
}

/// Ten times a second; `t_ns` from `session_s`, `unix_ns` from `wall_s` on.
fn truth(session_s: i64, wall_s: i64) -> Vec<TimedTruth> {
    let sample = |n: i64| TimedTruth {
        sample: TruthSample {
            t: RigNs(session_s * S + n * S / 10),
            t_rig_target: pose(n as f64 * 0.1),
            angular_velocity_rps: Vector3::z() * RATE,
        },
        unix: UnixNs(wall_s * S + n * S / 10),
    };
    (0..=300).map(sample).collect()
}

fn scored(
    gathered: &mut Gathered,
    samples: &[TimedTruth],
    have_wall: bool,
    from: From,
) -> (Scored, TruthClock, Vec<String>) {
    let (truth, source) = poses(Path::new("t.csv"), samples, gathered, have_wall, false).expect("a truth");
    let mut warnings = Vec::new();
    let Outcome::Scored(scored, _) = score(gathered, &truth, &Wanted::from(from), &mut warnings).expect("scored")
    else {
        panic!("unscored")
    };
    (*scored, source.clock, warnings)
}

#[test]
fn scoring_begins_after_a_revolution_and_wrong_states_before_it_are_counted() {
    let (found, clock, warnings) = scored(&mut gathered(25), &truth(0, 1_000), true, From::Turns(1.0));
    // First tracked at 1 s, 18 s for a revolution; 19 to 25 s.
    assert!((found.from_s - 19.0).abs() < 0.11 && found.to_s == 25.0, "{found:?}");
    assert!(found.states.abs_diff(61) <= 1 && found.states + found.left_out == 241);
    let figures = found.pose.expect("poses");
    assert!(figures.pose[0].attitude_max_deg < 1e-5 && figures.rate_dps.max < 1e-9);
    // 0.5 s of ten a second, less two that said `degraded`; of 241 less those two.
    assert_eq!((found.wrong.count, found.wrong.of), (3, 239));
    assert_eq!((clock, warnings.len()), (TruthClock::Wall, 0));
}

#[test]
fn less_than_a_revolution_is_scored_from_its_start_with_a_warning() {
    let (found, _, warnings) = scored(&mut gathered(10), &truth(0, 1_000), true, From::Turns(1.0));
    assert_eq!((found.from_s, found.states), (1.0, 91));
    // 9 s at 20 °/s.
    assert!(warnings.len() == 1 && warnings[0].contains("over 0.50 revolutions"), "{warnings:?}");
    let (found, _, warnings) = scored(&mut gathered(10), &truth(0, 1_000), true, From::At(RigNs(4 * S)));
    assert_eq!((found.from_s, found.states, warnings.len()), (4.0, 61, 0));
}

#[test]
fn a_truth_is_laid_on_the_session_by_the_clock_that_both_have() {
    // t_ns of another start: by wall time. Wall times of another day, or none: by session time.
    assert_eq!(scored(&mut gathered(10), &truth(500, 1_000), true, From::Turns(0.0)).1, TruthClock::Wall);
    assert_eq!(scored(&mut gathered(10), &truth(0, 90_000), true, From::Turns(0.0)).1, TruthClock::Session);
    assert_eq!(scored(&mut gathered(10), &truth(0, 1_000), false, From::Turns(0.0)).1, TruthClock::Session);
    let neither = poses(Path::new("t.csv"), &truth(500, 90_000), &mut gathered(10), true, false);
    let told = neither.expect_err("of another time").to_string();
    assert!(told.contains("t_ns 500.000 to 530.000 s") && told.contains("0.000 to 10.000 s"), "{told}");
    // Set back by 5 s in the middle.
    let mut set_back = gathered(10);
    set_back.marks.iter_mut().skip(50).for_each(|mark| mark.unix = UnixNs(mark.unix.0 - 5 * S));
    let refused = poses(Path::new("t.csv"), &truth(0, 1_000), &mut set_back, true, false);
    assert!(refused.expect_err("set back").to_string().contains("set back"));
}

#[test]
fn a_turntable_is_truth_where_its_encoder_is() {
    let angle = |n: i64, is_truth: bool| TurntableSample {
        sensor: SensorId::from("turntable"),
        t: RigNs(n * S / 20),
        t_sigma: Span(0),
        half_rtt: None,
        angle_rad: -RATE * n as f64 / 20.0,
        sigma_rad: 1e-5,
        rate_rps: -RATE,
        moving: Some(true),
        is_truth,
    };
    let mut gathered = gathered(25);
    assert!(turntable(&gathered, &mut Vec::new()).expect_err("none").to_string().contains("no angle of a turntable"));
    gathered.turntable = (0..=520).map(|n| angle(n, false)).collect();
    let told = turntable(&gathered, &mut Vec::new()).expect_err("commanded").to_string();
    assert!(told.contains("of 521 angles of turntable none is truth"), "{told}");
    // A fault in the first second.
    gathered.turntable = (0..=520).map(|n| angle(n, n >= 20)).collect();
    let mut warnings = Vec::new();
    let (truth, source) = turntable(&gathered, &mut warnings).expect("a turntable");
    assert_eq!((source.samples, source.left_out, warnings.len()), (501, 20, 1));
    let found = score(&gathered, &truth, &Wanted::from(From::Turns(1.0)), &mut warnings).expect("scored");
    let Outcome::Scored(found, _) = found else { panic!("{found:?}") };
    let figures = found.turntable.expect("a turntable");
    assert!(figures.about_axis_deg.max < 1e-5 && figures.axis[2] > 0.999_999, "{figures:?}");
    assert_eq!((found.wrong.count, found.wrong.of), (3, 239));
}

#[test]
fn an_interval_ends_where_it_is_told_to() {
    let mut gathered = gathered(25);
    let (truth, _) = poses(Path::new("t.csv"), &truth(0, 1_000), &mut gathered, true, false).expect("a truth");
    let span = |from, until| {
        let wanted = Wanted { until: Some(until), ..Wanted::from(from) };
        match score(&gathered, &truth, &wanted, &mut Vec::new()).expect("scored") {
            Outcome::Scored(scored, _) => (scored.from_s, scored.to_s, scored.states),
            Outcome::Unscored(reason) => panic!("{reason}"),
        }
    };
    assert_eq!(span(From::At(RigNs(4 * S)), From::At(RigNs(6 * S))), (4.0, 6.0, 21));
    // Half a turn at 20 °/s is 9 s, and tracking began at 1 s.
    assert_eq!(span(From::Turns(0.0), From::Turns(0.5)), (1.0, 10.0, 91));
}
