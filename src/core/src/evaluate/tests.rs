//! Errors of known size.

use super::made_up::{RATE, STEP_NS, by_pairs, in_turn, other_frame, right, turntable_truth};
use super::*;
use nalgebra::Translation3;
use tumbled_model::Twist;
use tumbled_model::se3::exp_rotation;

const DEGREE: f64 = core::f64::consts::PI / 180.0;

fn scored(estimates: &[EstimateSample]) -> Evaluation {
    evaluate(estimates, &turntable_truth(20_000_000), &EvaluateOptions::default()).expect("scored")
}

fn near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found}, not {expected} ± {tolerance}");
}

#[test]
fn right_estimates_in_another_body_frame_have_no_error() {
    let found = scored(&right());
    assert_eq!((found.scored, found.left_out), (100, 0));
    // 99 steps of 3.6°.
    near(found.travel_rad, 356.4 * DEGREE, 1e-9);
    assert_eq!(
        found.aligned.iter().map(|aligned| aligned.alignment).collect::<Vec<_>>(),
        [Alignment::MeanTwist, Alignment::FirstSecond]
    );
    for aligned in &found.aligned {
        let pose = aligned.pose;
        assert!(pose.attitude_max_rad < 1e-7 && pose.position_rms_m < 1e-9 && pose.position_offset_m.norm() < 1e-9);
        // At the first estimate the truth's velocity is a one-sided difference: 0.35 m × (20 °/s)² × 5 ms = 0.2 mm/s, over √100.
        assert!(pose.velocity_rms_mps < 3e-5, "{}", pose.velocity_rms_mps);
        let off = Twist::log(&(aligned.gauge.inverse() * other_frame()));
        assert!(off.vector().norm() < 1e-7);
    }
    assert!(found.motion.axis_rad.max < 1e-9 && found.motion.rate_rps.max < 1e-9);
}

#[test]
fn a_tilt_that_stays_in_the_rig_is_an_error_across_the_axis_and_of_the_axis() {
    // An extrinsic 0.3° off about x, at the turntable's middle. Over a whole revolution its body twist has no mean.
    let middle = Translation3::new(2.5, 0.0, 0.0);
    let tilt = middle * exp_rotation(&(Vector3::x() * 0.3 * DEGREE)) * middle.inverse();
    let mut estimates = right();
    for estimate in &mut estimates {
        estimate.t_rig_target = tilt * estimate.t_rig_target;
        estimate.angular_velocity_rps = tilt.rotation * estimate.angular_velocity_rps;
    }
    let found = scored(&estimates);
    let pose = found.aligned[0].pose;
    near(pose.attitude_rms_rad, 0.3 * DEGREE, 1e-6);
    near(pose.across_axis_rms_rad, 0.3 * DEGREE, 1e-6);
    near(pose.about_axis_rms_rad, 0.0, 2e-5);
    near(found.motion.axis_rad.rms, 0.3 * DEGREE, 1e-9);
    near(found.motion.axis_rad.end, 0.3 * DEGREE, 1e-9);
    near(found.motion.rate_rps.max, 0.0, 1e-12);
    // Aligned at the first second, what was right there has moved away: half a turn later it is 0.6° off, r.m.s. √2 · 0.3°
    // and a little less, the second being 18° long.
    near(found.aligned[1].pose.attitude_rms_rad, libm::sqrt(2.0) * 0.3 * DEGREE, 0.02 * DEGREE);
}

#[test]
fn scatter_about_the_axis_is_told_from_scatter_across_it() {
    let mut estimates = right();
    for (n, estimate) in estimates.iter_mut().enumerate() {
        let error = Vector3::new(0.1 * by_pairs(n), 0.0, 0.2 * in_turn(n)) * DEGREE;
        estimate.t_rig_target.rotation = exp_rotation(&error) * estimate.t_rig_target.rotation;
    }
    let pose = scored(&estimates).aligned[0].pose;
    near(pose.about_axis_rms_rad, 0.2 * DEGREE, 1e-5);
    near(pose.across_axis_rms_rad, 0.1 * DEGREE, 1e-5);
    near(pose.attitude_rms_rad, libm::sqrt(0.05) * DEGREE, 1e-5);
}

#[test]
fn a_position_scatters_about_its_mean_offset() {
    // 8 mm to the left always, and 2 mm up and down in turn.
    let mut estimates = right();
    for (n, estimate) in estimates.iter_mut().enumerate() {
        estimate.t_rig_target.translation.vector += Vector3::new(0.0, 0.008, 0.002 * in_turn(n));
        estimate.velocity_mps += Vector3::new(0.003, 0.0, 0.0) * by_pairs(n);
    }
    let pose = scored(&estimates).aligned[0].pose;
    near(pose.position_rms_m, 0.002, 1e-6);
    assert!((pose.position_offset_m - Vector3::new(0.0, 0.008, 0.0)).norm() < 1e-4);
    near(pose.velocity_rms_mps, 0.003, 1e-5);
}

#[test]
fn a_rate_that_is_too_high_is_too_high_in_the_mean_and_at_the_end() {
    let mut estimates = right();
    for (n, estimate) in estimates.iter_mut().enumerate() {
        estimate.angular_velocity_rps *= 1.0 + (0.02 + 0.01 * in_turn(n)) * DEGREE / RATE;
    }
    let rate = scored(&estimates).motion.rate_rps;
    near(rate.mean, 0.02 * DEGREE, 1e-12);
    // √(0.02² + 0.01²); the last, number 99, is 0.01 below.
    near(rate.rms, libm::sqrt(0.0005) * DEGREE, 1e-12);
    near(rate.max, 0.03 * DEGREE, 1e-12);
    near(rate.end, 0.01 * DEGREE, 1e-12);
}

#[test]
fn errors_as_large_as_stated_are_consistent() {
    let sigmas = [0.002, 0.003, 0.004, 0.001, 0.002, 0.003, 0.01, 0.02, 0.03, 0.001, 0.002, 0.003];
    let covariance = Covariance::from_diagonal(&nalgebra::SVector::from(sigmas.map(|sigma| sigma * sigma)));
    let mut estimates = right();
    for (n, estimate) in estimates.iter_mut().enumerate() {
        let part = |from: usize, sign: f64| Vector3::from_iterator(sigmas.into_iter().skip(from).take(3)) * sign;
        let error = Twist::new(part(0, in_turn(n)), part(3, by_pairs(n)));
        // Truth = estimate · Exp(ξ).
        estimate.t_rig_target *= error.exp().inverse();
        estimate.velocity_mps -= part(6, in_turn(n));
        estimate.angular_velocity_rps -= part(9, by_pairs(n));
        estimate.covariance = Some(covariance);
        estimate.nis = Some(if n % 2 == 0 { 4.0 } else { 9.0 });
    }
    let found = scored(&estimates);
    let consistency = found.aligned[0].consistency.clone().expect("covariances");
    near(consistency.nees12.mean, 12.0, 0.05);
    near(consistency.nees6.mean, 6.0, 0.05);
    assert!(consistency.sigma_over_rms.iter().all(|ratio| (ratio - 1.0).abs() < 0.01), "{consistency:?}");
    // 356° of travel are 12 independent pieces.
    assert_eq!(consistency.nees12.bounds, mean_bounds(12, 12));
    let nis = found.nis.expect("innovations");
    assert_eq!((nis.mean, nis.count, nis.bounds), (6.5, 100, mean_bounds(6, 100)));
    near(
        found.series.iter().filter_map(|(_, sample)| sample.nees12).sum::<f64>() / 100.0,
        consistency.nees12.mean,
        1e-9,
    );
}

#[test]
fn a_given_gauge_keeps_what_the_mean_would_remove() {
    let error = Twist::new(Vector3::y() * 0.5 * DEGREE, Vector3::zeros()).exp();
    let mut estimates = right();
    estimates.iter_mut().for_each(|estimate| estimate.t_rig_target *= error);
    let options = EvaluateOptions { gauge: Some(other_frame()), ..EvaluateOptions::default() };
    let found = evaluate(&estimates, &turntable_truth(20_000_000), &options).expect("scored");
    let [mean, _, given] = found.aligned.as_slice() else { panic!("{found:?}") };
    near(mean.pose.attitude_rms_rad, 0.0, 1e-7);
    near(given.pose.attitude_rms_rad, 0.5 * DEGREE, 1e-7);
}

#[test]
fn only_the_interval_with_truth_is_scored() {
    let options = EvaluateOptions { from: Some(RigNs(50 * STEP_NS)), ..EvaluateOptions::default() };
    let found = evaluate(&right(), &turntable_truth(20_000_000), &options).expect("scored");
    assert_eq!((found.scored, found.left_out, found.span.0), (50, 50, RigNs(50 * STEP_NS)));
    // What is not scored has its errors all the same.
    assert!(found.series.iter().map(|(number, _)| *number).eq(0..100));
    let late = EvaluateOptions { from: Some(RigNs(99 * STEP_NS)), ..EvaluateOptions::default() };
    let none = evaluate(&right(), &turntable_truth(20_000_000), &late);
    assert_eq!(none, Err(EvaluateError::FewEstimates { found: 1, estimates: 100 }));
    let mut reversed = right();
    reversed.reverse();
    let refused = evaluate(&reversed, &turntable_truth(20_000_000), &EvaluateOptions::default());
    assert_eq!(refused, Err(EvaluateError::EstimatesOutOfOrder { estimate: 1 }));
}

#[test]
fn a_momentum_direction_is_compared_where_both_are_known() {
    let mut estimates = right();
    for estimate in estimates.iter_mut().skip(40) {
        estimate.momentum = Some(exp_rotation(&(Vector3::x() * 0.5 * DEGREE)) * Vector3::z() * 3.0);
    }
    assert_eq!(scored(&estimates).motion.momentum_rad, None);
    let options = EvaluateOptions { momentum: Some(Vector3::z()), ..EvaluateOptions::default() };
    let found = evaluate(&estimates, &turntable_truth(20_000_000), &options).expect("scored");
    near(found.motion.momentum_rad.expect("both").rms, 0.5 * DEGREE, 1e-9);
}

/// Readings of the turntable's encoder 50 ms apart, from half a second before to two seconds after, counting one way or the other.
fn encoder(sense: f64) -> Vec<EncoderSample> {
    let reading = |t: i64| EncoderSample { t: RigNs(t), angle_rad: 1.0 + sense * RATE * t as f64 * 1e-9 };
    (-10..400).map(|n| reading(n * 50_000_000)).collect()
}

#[test]
fn an_encoder_of_unknown_axis_and_sense_judges_rotation_about_it_and_rate() {
    let mut estimates = right();
    for (n, estimate) in estimates.iter_mut().enumerate() {
        let error = Vector3::new(0.1 * by_pairs(n), 0.0, 0.2 * in_turn(n)) * DEGREE;
        estimate.t_rig_target.rotation = exp_rotation(&error) * estimate.t_rig_target.rotation;
        estimate.angular_velocity_rps *= 1.0 + 0.02 * DEGREE / RATE;
    }
    for sense in [1.0, -1.0] {
        let found = evaluate_turntable(&estimates, &encoder(sense), &EvaluateOptions::default()).expect("scored");
        assert_eq!((found.scored, found.left_out), (100, 0));
        near(found.travel_rad, 356.4 * DEGREE, 1e-9);
        // The first and the last estimate are 0.2° and 0.1° off: over a revolution the axis is not.
        assert!(super::angle(&found.axis, &Vector3::z()) < 0.1 * DEGREE, "{:?}", found.axis);
        near(found.about_axis_rad.rms, 0.2 * DEGREE, 0.01 * DEGREE);
        near(found.about_axis_rad.mean, 0.0, 1e-12);
        near(found.tilt_rms_rad, 0.1 * DEGREE, 0.01 * DEGREE);
        near(found.rate_rps.mean, 0.02 * DEGREE, 1e-9);
        near(found.cone_rad.max, super::angle(&found.axis, &Vector3::z()), 1e-9);
        let square: f64 = found.series.iter().map(|(_, error)| error.about_axis_rad * error.about_axis_rad).sum();
        near(libm::sqrt(square / 100.0), found.about_axis_rad.rms, 1e-12);
    }
}

#[test]
fn an_error_before_the_interval_is_in_the_series_and_not_in_the_figures() {
    let mut estimates = right();
    for estimate in estimates.iter_mut().take(10) {
        estimate.t_rig_target.rotation = exp_rotation(&(Vector3::z() * 20.0 * DEGREE)) * estimate.t_rig_target.rotation;
    }
    let options = EvaluateOptions { from: Some(RigNs(50 * STEP_NS)), ..EvaluateOptions::default() };
    let found = evaluate_turntable(&estimates, &encoder(1.0), &options).expect("scored");
    assert_eq!((found.scored, found.left_out, found.series.len()), (50, 50, 100));
    near(found.about_axis_rad.max, 0.0, 1e-7);
    near(found.series[9].1.about_axis_rad, 20.0 * DEGREE, 1e-7);
    near(found.series[10].1.about_axis_rad, 0.0, 1e-7);
}

#[test]
fn a_target_at_rest_has_no_axis() {
    let mut estimates = right();
    let pose = estimates[0].t_rig_target;
    estimates.iter_mut().for_each(|estimate| estimate.t_rig_target = pose);
    let found = evaluate_turntable(&estimates, &encoder(1.0), &EvaluateOptions::default());
    assert_eq!(found, Err(EvaluateError::NoTurn { travel_deg: 0 }));
}
