use super::super::options::{FilterOptions, StatedUncertainty};
use super::*;
use tumbled_model::Span;

/// A motion at 20 °/s, its poses at 30 Hz as a sensor without noise has them.
fn motion() -> Steady {
    Steady {
        t: RigNs(0),
        pose: Isometry3::new(Vector3::new(0.1, 0.2, 1.0), Vector3::new(0.3, -0.2, 0.1)),
        velocity: Vector3::new(0.02, -0.01, 0.03),
        rate: Vector3::new(0.1, 0.3, -0.15),
    }
}

fn poses(count: i64) -> Vec<PoseMeasurement> {
    (0..count)
        .map(|k| {
            let t = RigNs(0) + Span(33_333_333 * k);
            PoseMeasurement { t, sensor: 0, pose: motion().at(t), information: Matrix6::identity() * 1e6 }
        })
        .collect()
}

fn setup() -> Setup {
    let prior = SensorPrior::kinect(Isometry3::identity(), 2.0, &StatedUncertainty::default());
    Setup::new(FilterOptions::fixed_axis(), vec![prior])
}

/// Off by half a radian and half a metre.
fn wrong(z: &mut PoseMeasurement, salt: usize) {
    let turn = Vector3::new(0.5, 0.1 * salt as f64, -0.3);
    z.pose *= Twist::new(turn, Vector3::new(0.5, 0.0, 0.1 * salt as f64)).exp();
}

#[test]
fn without_noise_the_motion_is_found_as_it_is() {
    let begun = start(&setup(), &poses(31)).expect("a motion");
    assert!((begun.state.target.rate - motion().rate).norm() < 1e-9);
    assert!((begun.state.target.velocity - motion().velocity).norm() < 1e-9);
    assert_eq!((begun.state.t, begun.poses.len()), (RigNs(0), 31));
}

#[test]
fn wrong_poses_are_outvoted_and_left_out() {
    // 10 of 31, the first among them.
    let mut window = poses(31);
    for (salt, z) in window.iter_mut().step_by(3).take(10).enumerate() {
        wrong(z, salt);
    }
    let begun = start(&setup(), &window).expect("a motion");
    assert!((begun.state.target.rate - motion().rate).norm() < 1e-6);
    assert_eq!((begun.state.t, begun.poses.len()), (RigNs(33_333_333), 21));
}

#[test]
fn three_poses_that_disagree_are_no_motion() {
    let mut window: Vec<_> = poses(31).into_iter().step_by(15).collect();
    assert!(window.len() == 3 && start(&setup(), &window).is_some());
    wrong(&mut window[1], 1);
    assert!(start(&setup(), &window).is_none());
}

#[test]
fn half_a_turn_between_poses_is_no_motion() {
    // 20 °/s every 8 s: 160°.
    let window: Vec<_> = (0..3)
        .map(|k| {
            let t = RigNs(8_000_000_000 * k);
            PoseMeasurement { t, pose: motion().at(t), ..poses(1)[0] }
        })
        .collect();
    assert!(motion().rate.norm() * 8.0 > MOST_TURN && start(&setup(), &window).is_none());
}

#[test]
fn the_covariance_of_the_rate_is_that_of_a_line_through_the_poses() {
    let (prior, window) = (setup(), poses(31));
    let weighed: Vec<_> = window.iter().filter_map(|z| Weighed::new(z, &prior.priors[0])).collect();
    let (_, covariance) = least_squares(motion(), &weighed).expect("a motion");
    // A slope through 31 evenly spaced points over 1 s: σ² / Σ (t − t̄)² = σ² / (31·32·30/12 · (1/30)²) = σ² / 2.756.
    // σ² = 1e-6 + (0.15°)²: 7.85e-6. A turn in between mixes the axes, which are alike.
    let expected = (1e-6 + 6.854e-6) / 2.756;
    let found = covariance.fixed_view::<3, 3>(9, 9).trace() / 3.0;
    assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
}

#[test]
fn where_the_centre_lies_says_how_it_moves() {
    let begun = start(&setup(), &poses(31)).expect("a motion");
    let mixed: Matrix3<f64> = begun.state.root.covariance::<3, 3>(VELOCITY, CENTER);
    let rotation = motion().pose.rotation.to_rotation_matrix().into_inner();
    assert!((mixed - rotation * skew(&motion().rate) * (0.06 * 0.06)).norm() < 1e-8);
}
