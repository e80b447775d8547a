//! Point to point, point to plane, distribution to distribution.

use crate::scene::{Chance, cloud, errors, moved, nees, pair, prior, right};
use nalgebra::{Isometry3, Point3, Vector3};
use tumbled_core::register::baseline::{IterationOptions, Target, gicp, icp, plane_icp};
use tumbled_core::register::{Cloud, Doubt, Prior, RegisterError, Registration, SensorKind};
use tumbled_model::Twist;

type Method = fn(&Cloud, &Cloud, Option<&Prior>, &IterationOptions) -> Result<Registration, RegisterError>;

fn methods() -> [(&'static str, Method, IterationOptions); 3] {
    [
        ("icp", icp, IterationOptions::points()),
        ("plane-icp", plane_icp, IterationOptions::planes()),
        ("gicp", gicp, IterationOptions::points()),
    ]
}

#[test]
fn from_ten_degrees_and_ten_centimetres_they_find_views_that_overlap() {
    // Right in so many of 24 at sights 5..40° apart. Others' programs: 94, 78 and 97 % of such pairs.
    for ((name, method, options), needed) in methods().into_iter().zip([20, 16, 22]) {
        let (mut found_right, mut sum) = (0, 0.0);
        for seed in 0..24 {
            let views = pair(seed, 5.0 + 35.0 * seed as f64 / 24.0);
            let guess = prior(&mut Chance::new(seed), &views.t_lidar_kinect, &views.kinect, 10f64.to_radians(), 0.10);
            let found = method(&views.kinect, &views.lidar, Some(&guess), &options).expect("clouds");
            if right(&found, &views.t_lidar_kinect, &views.kinect) {
                found_right += 1;
                sum += nees(&found, &views.t_lidar_kinect);
            }
        }
        assert!(found_right >= needed, "{name}: {found_right} of 24");
        // Six on average; these methods' own biases (a sparse target's discs, pairs of unlike density) are in no residual.
        let mean = sum / f64::from(found_right);
        assert!((0.5..20.0).contains(&mean), "{name}: NEES {mean:.1}");
    }
}

#[test]
fn a_cloud_fits_itself_exactly() {
    let views = pair(3, 20.0);
    let guess = prior(&mut Chance::new(5), &Isometry3::identity(), &views.kinect, 0.02, 0.01);
    for (name, method, options) in methods() {
        let fine = IterationOptions {
            rotation_epsilon_rad: 1e-9,
            translation_epsilon_m: 1e-9,
            max_iterations: 200,
            ..options
        };
        let found = method(&views.kinect, &views.kinect, Some(&guess), &fine).expect("clouds");
        let (angle, length) = errors(&found, &Isometry3::identity(), &views.kinect);
        assert!(angle < 1e-5 && length < 1e-7, "{name}: {angle} {length}");
        assert!(found.accepted, "{name}: {:?}", found.doubts);
        assert_eq!(found.inliers, 1.0, "{name}");
    }
}

#[test]
fn moving_both_clouds_moves_the_answer_with_them() {
    let views = pair(8, 15.0);
    let guess = prior(&mut Chance::new(1), &views.t_lidar_kinect, &views.kinect, 0.05, 0.03);
    let a = Twist::new(Vector3::new(0.4, -0.2, 0.3), Vector3::new(0.3, 0.1, -0.2)).exp();
    let b = Twist::new(Vector3::new(-0.1, 0.5, 0.2), Vector3::new(-0.2, 0.3, 0.1)).exp();
    let elsewhere = Prior { t_reference_moving: a * guess.t_reference_moving * b.inverse(), ..guess };
    for (name, method, options) in methods() {
        let here = method(&views.kinect, &views.lidar, Some(&guess), &options).expect("clouds");
        let (kinect, lidar) = (moved(&views.kinect, &b), moved(&views.lidar, &a));
        let there = method(&kinect, &lidar, Some(&elsewhere), &options).expect("clouds");
        // Coordinates are rounded anew, a pair at the edge comes or goes, and when a step counts as small depends on how
        // far the source's origin is: within three standard deviations, not to the bit.
        let away = nees(&there, &(a * here.t_reference_moving * b.inverse()));
        assert!(away < 9.0, "{name}: {away}");
    }
}

#[test]
fn exchanged_clouds_give_the_inverse() {
    let views = pair(9, 15.0);
    let guess = prior(&mut Chance::new(2), &views.t_lidar_kinect, &views.kinect, 0.05, 0.03);
    let back = Prior { t_reference_moving: guess.t_reference_moving.inverse(), ..guess };
    for (name, method, options) in methods() {
        // Sparser and denser stay who they are: the same sums in the same order.
        let one = method(&views.kinect, &views.lidar, Some(&guess), &options).expect("clouds");
        let other = method(&views.lidar, &views.kinect, Some(&back), &options).expect("clouds");
        let both = one.t_reference_moving * other.t_reference_moving;
        assert!(both.rotation.angle() < 1e-9 && both.translation.vector.norm() < 1e-9, "{name}");
        // The covariance is told in the other frame: Ad Σ Adᵀ.
        let there = tumbled_model::se3::adjoint(&one.t_reference_moving);
        let expected = there * other.covariance * there.transpose();
        assert!((one.covariance - expected).norm() < 0.02 * expected.norm(), "{name}");
        assert_eq!(one.inliers, other.inliers, "{name}");
    }
}

#[test]
fn without_a_prior_they_start_from_centroid_to_centroid() {
    // Of one view, moved by 7 cm: laid on each other the centroids are right.
    let views = pair(4, 10.0);
    let step = Isometry3::translation(0.05, -0.04, 0.03);
    for (name, method, options) in methods() {
        let found = method(&views.kinect, &moved(&views.kinect, &step), None, &options).expect("clouds");
        let (angle, length) = errors(&found, &step, &views.kinect);
        assert!(angle < 0.01 && length < 1e-4, "{name}: {angle} {length}");
    }
}

#[test]
fn a_start_out_of_reach_is_not_accepted() {
    let views = pair(4, 10.0);
    for (name, method, options) in methods() {
        let mut guess = prior(&mut Chance::new(2), &views.t_lidar_kinect, &views.kinect, 0.0, 0.0);
        guess.t_reference_moving.translation.x += 3.0;
        let found = method(&views.kinect, &views.lidar, Some(&guess), &options).expect("clouds");
        assert!(!found.accepted, "{name}");
        assert!(found.doubts.iter().any(|doubt| matches!(doubt, Doubt::Support { .. })), "{name}: {:?}", found.doubts);
        assert!(found.covariance.iter().all(|number| number.is_finite()), "{name}");
    }
}

#[test]
fn a_wall_leaves_three_directions_open_and_they_say_so() {
    let wall = |seed: u64, count: u32, noise: f64| {
        let mut chance = Chance::new(seed);
        let place = |_| Vector3::new(2.0 * chance.share() - 1.0, 1.5 * chance.share(), 2.0 + noise * chance.normal());
        cloud(SensorKind::Kinect, (0..count).map(place).collect::<Vec<_>>().into_iter())
    };
    let guess = Prior { t_reference_moving: Isometry3::identity(), sigma_rotation_rad: 0.1, sigma_translation_m: 0.1 };
    for (name, method, options) in methods() {
        let found = method(&wall(1, 2000, 0.004), &wall(2, 300, 0.004), Some(&guess), &options).expect("clouds");
        assert!(!found.accepted, "{name}");
        assert!(
            found.doubts.iter().any(|doubt| matches!(doubt, Doubt::Degenerate { .. })),
            "{name}: {:?}",
            found.doubts
        );
        // What is open is a shift along the wall or a turn about its normal.
        let (way, _) = found.weakest;
        assert!(way[0].abs() < 0.2 && way[1].abs() < 0.2 && way[5].abs() < 0.2, "{name}: {way}");
    }
}

#[test]
fn what_is_no_cloud_or_no_prior_is_refused() {
    let views = pair(1, 10.0);
    let none = cloud(SensorKind::Lidar, core::iter::empty());
    let mut millimetres = views.lidar.clone();
    millimetres.points.iter_mut().for_each(|point| *point *= 1000.0);
    let mut bad = prior(&mut Chance::new(1), &views.t_lidar_kinect, &views.kinect, 0.1, 0.1);
    bad.t_reference_moving.translation.y = f64::INFINITY;
    for (name, method, options) in methods() {
        let refused = |moving: &Cloud, prior| method(moving, &views.kinect, prior, &options).expect_err(name);
        assert_eq!(refused(&none, None), RegisterError::TooFewPoints { cloud: "moving", found: 0, needed: 10 });
        assert!(
            matches!(refused(&millimetres, None), RegisterError::Size { cloud: "moving", size_m } if size_m > 100.0)
        );
        assert!(matches!(refused(&views.lidar, Some(&bad)), RegisterError::Prior { .. }));
    }
}

#[test]
fn the_target_asked_for_is_the_target() {
    // A sparse target makes 2600 pairs of a dense source, a dense one 358 of a sparse: the answers differ.
    let views = pair(6, 15.0);
    let guess = prior(&mut Chance::new(3), &views.t_lidar_kinect, &views.kinect, 0.05, 0.03);
    let with = |target| {
        let options = IterationOptions { target, ..IterationOptions::points() };
        gicp(&views.kinect, &views.lidar, Some(&guess), &options).expect("clouds").t_reference_moving
    };
    assert_eq!(with(Target::Reference), with(Target::Sparser));
    assert_ne!(with(Target::Reference), with(Target::Denser));
}

#[test]
fn points_that_are_no_numbers_change_nothing() {
    let views = pair(7, 15.0);
    let guess = prior(&mut Chance::new(3), &views.t_lidar_kinect, &views.kinect, 0.05, 0.03);
    let mut spoilt = views.kinect.clone();
    for index in [2000, 700, 0] {
        spoilt.points.insert(index, Point3::new(0.1, f32::NAN, 2.0));
    }
    for (name, method, options) in methods() {
        let clean = method(&views.kinect, &views.lidar, Some(&guess), &options).expect("clouds");
        assert_eq!(method(&spoilt, &views.lidar, Some(&guess), &options).expect("clouds"), clean, "{name}");
    }
}
