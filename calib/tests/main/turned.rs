//! A turntable's axis and a sensor's lateness, of made poses.

use core::f64::consts::TAU;

use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use tumbled_calib::time::{NoCorrelation, NoPhase, TimedAngle, correlate, phase};
use tumbled_calib::turntable::{NoAxis, TurnedPose, TurntableFit, turntable};

struct Noise(ChaCha8Rng);

impl Noise {
    fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// Sum of twelve: normal enough.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64).sum::<f64>() - 6.0
    }

    fn vector(&mut self, sigma: f64) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal()) * sigma
    }
}

/// What is made.
#[derive(Clone, Copy)]
struct Stage {
    count: usize,
    span_deg: f64,
    sigma_deg: f64,
    sigma_m: f64,
    gain: f64,
}

const AXIS: [f64; 3] = [0.1, -0.05, 1.0];
const CENTER: [f64; 3] = [2.0, 0.1, -0.1];

fn axis() -> Unit<Vector3<f64>> {
    Unit::new_normalize(Vector3::from(AXIS))
}

fn poses(stage: Stage, seed: u64) -> Vec<TurnedPose> {
    let mut noise = Noise::new(seed);
    let (axis, center) = (axis(), Vector3::from(CENTER));
    let first =
        Isometry3::from_parts(Translation3::new(2.1, 0.05, 0.2), UnitQuaternion::from_euler_angles(0.3, -0.2, 0.9));
    let pose = |n: usize| {
        let angle_rad = 0.7 + (stage.span_deg * n as f64 / (stage.count - 1) as f64).to_radians();
        let turned = UnitQuaternion::from_axis_angle(&axis, stage.gain * (angle_rad - 0.7));
        let place = center + turned * (first.translation.vector - center) + noise.vector(stage.sigma_m);
        let off = UnitQuaternion::from_scaled_axis(noise.vector(stage.sigma_deg.to_radians()));
        TurnedPose { angle_rad, t_rig_target: Isometry3::from_parts(place.into(), off * turned * first.rotation) }
    };
    (0..stage.count).map(pose).collect()
}

/// Axis, degrees, and distance of the lines, mm.
fn errors(fit: &TurntableFit) -> (f64, f64) {
    let (found, center) = (fit.axis, Vector3::from(CENTER));
    let off = libm::asin(found.cross(&axis()).norm()).to_degrees();
    // Where the axis found passes at the target's height.
    let at = center - fit.point_m;
    (off, 1e3 * (at - found.scale(found.dot(&at))).norm())
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
fn an_axis_of_36_angles_is_within_what_its_noise_allows_and_its_sigma_holds() {
    let stage = Stage { count: 36, span_deg: 350.0, sigma_deg: 1.0, sigma_m: 0.010, gain: 1.0 };
    let (mut off, mut apart, mut within) = (Vec::new(), Vec::new(), 0);
    for seed in 0..100 {
        let fit = turntable(&poses(stage, seed), false).expect("an axis");
        let (deg, mm) = errors(&fit);
        within += usize::from(deg.to_radians() < 3.0 * fit.axis_sigma_rad());
        off.push(deg);
        apart.push(mm);
        assert!((fit.gain - 1.0).abs() < 3.5 * fit.gain_sigma, "{} {}", fit.gain, fit.gain_sigma);
        assert_eq!(fit.sign, 1.0);
    }
    // 1° and 10 mm: 0.17° (0.41°) and 1.8 mm (4.2 mm) are what such a fit gives in the median (at worst).
    let (off, apart, worst) = (median(off.clone()), median(apart), off.into_iter().fold(0.0, f64::max));
    assert!(off < 0.25 && apart < 2.7 && worst < 0.65, "{off}° {apart} mm, worst {worst}°");
    // Two tilts: beyond three σ of the larger lie at most 1.1 of 100.
    assert!(within >= 96, "{within}");
}

#[test]
fn twelve_angles_give_less_and_small_noise_gives_more() {
    let of = |stage, seeds| {
        let fits = (0..seeds).map(|seed| errors(&turntable(&poses(stage, seed), false).expect("an axis")));
        let (off, apart): (Vec<f64>, Vec<f64>) = fits.unzip();
        (median(off), median(apart))
    };
    let (off, apart) = of(Stage { count: 12, span_deg: 350.0, sigma_deg: 1.0, sigma_m: 0.010, gain: 1.0 }, 60);
    assert!(off < 0.45 && apart < 5.5, "{off}° {apart} mm");
    let (off, apart) = of(Stage { count: 24, span_deg: 350.0, sigma_deg: 0.3, sigma_m: 0.003, gain: 1.0 }, 60);
    assert!(off < 0.11 && apart < 1.3, "{off}° {apart} mm");
}

#[test]
fn a_stage_that_counts_backwards_or_in_wrong_units_is_told() {
    let stage = Stage { count: 36, span_deg: 350.0, sigma_deg: 0.1, sigma_m: 0.001, gain: -1.0 };
    let fit = turntable(&poses(stage, 1), false).expect("an axis");
    assert_eq!(fit.sign, -1.0);
    assert!(errors(&fit).0 < 0.1 && fit.axis.z > 0.9, "{fit:?}");
    // The pose that the fit gives for an angle is that of the sample.
    let sample = poses(stage, 1)[20];
    let off = fit.pose(sample.angle_rad).rotation.angle_to(&sample.t_rig_target.rotation);
    assert!(off.to_degrees() < 0.5, "{}°", off.to_degrees());
    let fit = turntable(&poses(Stage { gain: 1.02, ..stage }, 1), false).expect("an axis");
    assert!((fit.gain - 1.02).abs() < 0.002);
    let gate = fit.gates().into_iter().find(|gate| gate.name == "gain less 1").expect("a gate");
    assert!(gate.remedy.is_some_and(|remedy| remedy.contains("units per turn")));
}

#[test]
fn too_little_turning_and_a_target_that_stands_still_are_refused_with_the_reason() {
    let stage = Stage { count: 36, span_deg: 60.0, sigma_deg: 0.1, sigma_m: 0.001, gain: 1.0 };
    assert!(matches!(turntable(&poses(stage, 1), false), Err(NoAxis::Span { .. })));
    let few = Stage { count: 11, span_deg: 350.0, ..stage };
    assert_eq!(turntable(&poses(few, 1), false), Err(NoAxis::Few { found: 11, least: 12 }));
    let still = Stage { gain: 0.0, span_deg: 350.0, ..stage };
    let refused = turntable(&poses(still, 1), false).expect_err("it does not turn");
    assert!(matches!(refused, NoAxis::Apart { .. }) && refused.to_string().contains("does not stand on this stage"));
}

/// Runs at rates, °/s, two turns and some each, 3 s of rest between; states at 10 Hz, late by `late_s`.
fn spun(rates_dps: &[f64], late_s: f64, (sigma_deg, bias_deg): (f64, f64), seed: u64) -> Vec<TimedAngle> {
    let mut noise = Noise::new(seed);
    let mut legs = Vec::new();
    let (mut t, mut angle) = (0.0, 0.0);
    for rate in rates_dps.iter().map(|dps: &f64| dps.to_radians()) {
        let took = 2.4 * TAU / rate.abs();
        let bias = noise.normal() * bias_deg.to_radians();
        legs.push((t + 3.0, t + 3.0 + took, angle, rate, bias));
        (t, angle) = (t + 3.0 + took, angle + rate * took);
    }
    let at = |time: f64| {
        let leg = legs.iter().rev().find(|leg| time >= leg.0);
        leg.map_or(0.0, |(from, to, angle, rate, _)| angle + rate * (time.min(*to) - from))
    };
    let sample = |n: usize| {
        let t_s = 0.1 * n as f64;
        let (encoder_rad, shown) = (at(t_s), at(t_s - late_s));
        let bias = legs.iter().rev().find(|leg| t_s >= leg.0).map_or(0.0, |leg| leg.4);
        // An error that depends on the attitude, 0.5°, is the same in every turn.
        let of_attitude = 0.5_f64.to_radians() * libm::sin(2.0 * shown);
        let state_rad = shown + of_attitude + bias + sigma_deg.to_radians() * noise.normal() - 400.0 * TAU;
        TimedAngle { t_s, encoder_rad, state_rad }
    };
    (0..(10.0 * t) as usize).map(sample).collect()
}

const BOTH_WAYS: [f64; 6] = [5.0, -5.0, 10.0, -10.0, 20.0, -20.0];

#[test]
fn seven_milliseconds_are_found_by_phases_within_what_the_noise_allows() {
    // 0.2° white: within 2 ms; 1°: within 5 ms; and both within the σ that is told.
    for (sigma_deg, bound_ms) in [(0.2, 2.0), (1.0, 5.0)] {
        let mut within = 0;
        for seed in 0..40 {
            let found = phase(&spun(&BOTH_WAYS, 0.007, (sigma_deg, 0.0), seed)).expect("phases");
            let off_ms = 1e3 * (found.late_s - 0.007).abs();
            assert!(off_ms < bound_ms, "{sigma_deg}°, seed {seed}: {off_ms} ms off");
            within += usize::from(off_ms <= 3e3 * found.sigma_s);
            assert_eq!((found.runs.len(), found.runs[0].turns), (6, 2));
        }
        assert!(within >= 39, "{within} of 40 within three σ");
    }
}

#[test]
fn a_bias_of_each_run_is_in_the_sigma() {
    // 0.06° from run to run: 1.8 ms by rig geometry; the fit's own residual tells it.
    let found: Vec<_> = (0..40)
        .map(|seed| phase(&spun(&BOTH_WAYS, -0.012, (0.2, 0.06), seed)).expect("phases"))
        .map(|found| ((found.late_s + 0.012) / found.sigma_s, found.sigma_s))
        .collect();
    let within = found.iter().filter(|(off, _)| off.abs() <= 3.0).count();
    let sigma_ms = 1e3 * median(found.iter().map(|(_, sigma)| *sigma).collect());
    assert!(within >= 38 && (0.5..5.0).contains(&sigma_ms), "{within} of 40, σ {sigma_ms} ms");
}

#[test]
fn one_direction_or_one_run_tells_no_offset() {
    let one_way = spun(&[5.0, 10.0, 20.0], 0.007, (0.2, 0.0), 1);
    assert_eq!(phase(&one_way), Err(NoPhase::OneDirection));
    let one = spun(&[20.0], 0.007, (0.2, 0.0), 1);
    assert_eq!(phase(&one), Err(NoPhase::FewRuns { found: 1 }));
}

/// Stops and goes: a run's length and the rest's from a list; or swings of a period.
fn changing(angle: impl Fn(f64) -> f64, late_s: f64, sigma_deg: f64, seed: u64) -> Vec<TimedAngle> {
    let mut noise = Noise::new(seed);
    let sample = |n: usize| {
        let t_s = n as f64 / 30.0;
        let state_rad = angle(t_s - late_s) + sigma_deg.to_radians() * noise.normal();
        TimedAngle { t_s, encoder_rad: angle(t_s), state_rad }
    };
    (0..3_000).map(sample).collect()
}

#[test]
fn seven_milliseconds_are_found_by_correlation_within_three_sigma() {
    // To and fro by 40° in 9 s: at most 28 °/s.
    let swing = |t: f64| 40.0_f64.to_radians() * libm::sin(TAU * t / 9.0);
    let mut within = 0;
    for seed in 0..20 {
        let found = correlate(&changing(swing, 0.007, 0.2, seed)).expect("a peak");
        assert!((found.late_s - 0.007).abs() < 0.005, "{found:?}");
        within += usize::from((found.late_s - 0.007).abs() <= 3.0 * found.sigma_s);
    }
    assert!(within >= 19, "{within}");
}

#[test]
fn an_even_rate_and_a_fast_swing_are_refused_with_the_reason() {
    let even = correlate(&changing(|t| 0.3 * t, 0.007, 0.2, 1)).expect_err("nothing changes");
    assert!(matches!(even, NoCorrelation::NoSignal { .. } | NoCorrelation::BeyondReach), "{even}");
    let fast = correlate(&changing(|t| 0.5 * libm::sin(TAU * t / 0.3), 0.007, 0.05, 1)).expect_err("peaks everywhere");
    assert!(matches!(fast, NoCorrelation::Ambiguous { .. } | NoCorrelation::NoSignal { .. }), "{fast}");
}
