use super::*;
use crate::ukf::StatedUncertainty;
use nalgebra::{Quaternion, Translation3, Vector3};
use tumbled_model::Span;
use tumbled_model::se3::exp_rotation;

const DEGREE: f64 = core::f64::consts::PI / 180.0;

/// A Kinect 0.3 m beside a LiDAR at the rig's origin, both looking along x at a target 2.2 m in front.
fn mountings() -> [Isometry3<f64>; 2] {
    let camera = UnitQuaternion::from_quaternion(Quaternion::new(0.5, -0.5, 0.5, -0.5));
    [Isometry3::from_parts(Translation3::new(0.0, 0.3, 0.0), camera), Isometry3::identity()]
}

fn check() -> MountingCheck {
    let center = Isometry3::translation(2.2, 0.0, 0.0);
    let camera = center * mountings()[0].rotation;
    let stated = StatedUncertainty::default();
    let priors = vec![SensorPrior::kinect(camera, 2.2, &stated), SensorPrior::lidar(center, 2.2, &stated)];
    MountingCheck::new(priors, mountings().to_vec())
}

/// Twenty seconds of a target at 20°/s, seen by a Kinect that is in truth moved by `moved` from where the config has it, and a
/// LiDAR that is where it should be; the filter follows the LiDAR.
fn seen(check: &mut MountingCheck, moved: &Isometry3<f64>) -> RigNs {
    let mut newest = RigNs(0);
    for n in 0..600 {
        newest = RigNs(0) + Span(n * 33_333_333);
        let angle = 20.0 * DEGREE * n as f64 / 30.0;
        let truth = Isometry3::from_parts(Translation3::new(2.2, 0.0, 0.0), exp_rotation(&(Vector3::z() * angle)));
        // The sensor measures `true_mounting⁻¹ truth` and the config's mounting puts that into the rig.
        let [kinect, _] = mountings();
        check.take(0, newest, &truth, &(kinect * (kinect * moved).inverse() * truth));
        if n % 3 == 0 {
            check.take(1, newest, &truth, &truth);
        }
    }
    newest
}

#[test]
fn sensors_that_are_where_the_config_says_agree() {
    let mut check = check();
    let t = seen(&mut check, &Isometry3::identity());
    let [found] = check.disagreements(t).try_into().expect("one pair");
    assert!(found.chi_square < 1e-9 && !found.is_alarm && !check.is_alarm(), "{found:?}");
}

#[test]
fn a_camera_turned_by_two_degrees_about_any_axis_is_told_with_axis_and_angle() {
    for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
        let mut check = check();
        let turn = Isometry3::from_parts(Translation3::identity(), exp_rotation(&(axis * 2.0 * DEGREE)));
        let t = seen(&mut check, &turn);
        let [found] = check.disagreements(t).try_into().expect("one pair");
        assert!(found.is_alarm && check.is_alarm(), "{axis}: {found:?}");
        assert_eq!((found.sensor, found.reference), (0, 1));
        // It turned about itself, and is told in the rig's axes.
        let axis = mountings()[0].rotation * axis;
        let told = found.correction.fixed_rows::<3>(0).into_owned();
        assert!((told - axis * 2.0 * DEGREE).norm() < 1e-6, "{told}");
        assert!(found.correction.fixed_rows::<3>(3).norm() < 1e-6, "{found:?}");
    }
}

#[test]
fn what_the_stated_sigma_explains_is_no_alarm_and_a_shift_of_eight_centimetres_is() {
    // σ is 0.2° and 4 mm over the three axes together: three times that.
    let mut quiet = check();
    let turn = exp_rotation(&(Vector3::new(0.2, 0.2, 0.2) * DEGREE * 3.0 / 3f64.sqrt()));
    let t = seen(&mut quiet, &Isometry3::from_parts(Translation3::new(0.004, 0.004, 0.004), turn));
    assert!(!quiet.is_alarm(), "{:?}", quiet.disagreements(t));
    let mut loud = check();
    let t = seen(&mut loud, &Isometry3::translation(0.08, 0.0, 0.0));
    let [found] = loud.disagreements(t).try_into().expect("one pair");
    assert!(found.is_alarm);
    assert!((found.correction - Vector6::new(0.0, 0.0, 0.0, 0.0, -0.08, 0.0)).norm() < 1e-6, "{found:?}");
}

#[test]
fn one_sensor_alone_and_one_that_is_silent_are_held_against_nothing() {
    let mut check = check();
    let t = seen(&mut check, &Isometry3::identity());
    assert!(check.disagreements(t + Span(2_900_000_000)).len() == 1);
    assert!(check.disagreements(t + Span(3_100_000_000)).is_empty());
    let alone = MountingCheck::new(check.priors[..1].to_vec(), mountings()[..1].to_vec());
    assert!(alone.disagreements(t).is_empty() && !alone.is_alarm());
}
