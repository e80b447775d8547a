//! Poses that come late, and poses that come too late.

use crate::truth::Run;
use tumbled_core::ukf::{FilterOptions, Used};
use tumbled_model::Span;

#[test]
fn late_poses_give_the_same_bits_as_poses_in_order() {
    for options in [FilterOptions::fixed_axis(), FilterOptions::free_tumble()] {
        let run = Run::new(&options, 6.0, 10.0, 7);
        let (mut in_order, rest) = run.start(options);
        let mut late = in_order.clone();
        for z in rest {
            in_order.update(z);
        }
        // The LiDAR's poses wait until eleven of the Kinect's are through: 0.37 s.
        let mut waiting = std::collections::VecDeque::new();
        for (index, z) in rest.iter().enumerate() {
            if z.sensor == 1 {
                waiting.push_back((index + 14, z));
            } else {
                late.update(z);
            }
            while let Some((_, z)) = waiting.pop_front_if(|(due, _)| *due <= index) {
                assert_eq!(late.update(z).used, Used::Full);
            }
        }
        for (_, z) in waiting {
            late.update(z);
        }
        assert_eq!(in_order.estimate(), late.estimate());
        assert_eq!(in_order.extrinsic_drift(0, 1), late.extrinsic_drift(0, 1));
        let t = in_order.estimate().t - Span(700_000_000);
        assert_eq!(in_order.predict(t), late.predict(t));
    }
}

#[test]
fn what_is_older_than_two_seconds_is_dropped_and_counted() {
    let options = FilterOptions::fixed_axis();
    let run = Run::new(&options, 6.0, 10.0, 8);
    let (mut filter, rest) = run.start(options);
    for z in rest {
        filter.update(z);
    }
    let before = filter.estimate();
    let mut z = *rest.first().expect("poses");
    z.t = before.t - Span(2_000_000_001);
    assert_eq!(filter.update(&z).used, Used::TooOld);
    assert_eq!((filter.counts().too_old, filter.estimate()), (1, before.clone()));
    z.t = before.t - Span(1_999_999_999);
    assert_ne!(filter.update(&z).used, Used::TooOld);
}

#[test]
fn predicting_changes_nothing_and_widens_with_time() {
    let options = FilterOptions::fixed_axis();
    let run = Run::new(&options, 4.0, 20.0, 9);
    let (filter, _) = run.start(options);
    let now = filter.estimate();
    assert_eq!(filter.predict(now.t), now);
    let sigma = |seconds: f64| filter.predict(now.t + Span((seconds * 1e9) as i64)).sigma();
    assert!(sigma(5.0).0 > sigma(1.0).0 && sigma(1.0).0 > now.sigma().0);
    assert_eq!(filter.estimate(), now);
    // A Kinect's points fit the model at the target's pose after its bias: they are apart by that alone.
    let apart = filter.seen_by(now.t, 1).rotation.angle_to(&now.t_rig_target.rotation);
    assert!(apart > 0.0 && apart < 0.06, "{apart}");
}
