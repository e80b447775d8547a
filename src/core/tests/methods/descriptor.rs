//! The curvature-based descriptor.

use crate::scene::{Chance, cloud, errors, moved, nees, pair, whole_surface};
use tumbled_core::register::baseline::{CbdOptions, cbd};
use tumbled_core::register::{Doubt, RegisterError, SensorKind};
use tumbled_model::Twist;

#[test]
fn a_body_is_found_in_its_own_points_whatever_the_motion() {
    for seed in 0..6 {
        let mut chance = Chance::new(seed);
        let truth = Twist::new(chance.direction() * (3.1 * chance.share()), chance.direction() * 2.0).exp();
        let points = whole_surface(seed, 2600).into_iter().map(|point| point.coords.cast());
        let body = cloud(SensorKind::Kinect, points);
        let found = cbd(&body, &moved(&body, &truth), &CbdOptions::default()).expect("clouds");
        // The same points have the same descriptors: the motion comes back but for the rounding of coordinates.
        let (angle, length) = errors(&found, &truth, &body);
        assert!(angle < 1.0 && length < 0.01, "{seed}: {angle} {length}");
    }
}

#[test]
fn between_sensors_it_is_coarse_and_what_is_accepted_knows_how_coarse() {
    let (mut accepted, mut sum) = (0, 0.0);
    for seed in 0..24 {
        let views = pair(seed, 5.0 + 35.0 * seed as f64 / 24.0);
        let found = cbd(&views.kinect, &views.lidar, &CbdOptions::default()).expect("clouds");
        assert!(found.covariance.cholesky().is_some());
        if found.accepted {
            // Keypoints are 5 cm apart on a body of 0.4 m radius: some degrees off, not another mode.
            let (angle, length) = errors(&found, &views.t_lidar_kinect, &views.kinect);
            assert!(angle < 15.0 && length < 0.08, "{seed}: {angle} {length}");
            accepted += 1;
            sum += nees(&found, &views.t_lidar_kinect);
        }
    }
    assert!(accepted >= 6, "{accepted} of 24");
    // Six on average, of a dozen: ± 1.
    let mean = sum / f64::from(accepted);
    assert!((2.0..12.0).contains(&mean), "NEES {mean}");
}

#[test]
fn no_pairs_is_no_measurement_and_no_cloud_is_refused() {
    let views = pair(2, 10.0);
    let nothing = CbdOptions { epsilon: 0.0, ..CbdOptions::default() };
    let found = cbd(&views.kinect, &views.lidar, &nothing).expect("clouds");
    assert!(!found.accepted && found.doubts.contains(&Doubt::Pairs { found: 0, needed: 4 }), "{:?}", found.doubts);
    let empty = cloud(SensorKind::Lidar, core::iter::empty());
    let refused = cbd(&views.kinect, &empty, &CbdOptions::default()).expect_err("no cloud");
    assert_eq!(refused, RegisterError::TooFewPoints { cloud: "reference", found: 0, needed: 10 });
}
