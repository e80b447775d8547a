//! Axis, rate and momentum of seeded targets.

use crate::truth::{DEGREE, Run};
use tumbled_core::ukf::{CalibrationTreatment, FilterOptions};

/// Of a minute each.
const TUMBLES: u64 = 3;

fn square(value: f64) -> f64 {
    value * value
}

/// Root mean squares over seeds: axis, its stated sigma (degrees), rate (degrees a second).
fn fixed_axis(options: FilterOptions, runs: u64) -> (f64, f64, f64) {
    let (mut axis, mut stated, mut rate) = (0.0, 0.0, 0.0);
    for seed in 0..runs {
        let run = Run::new(&FilterOptions::fixed_axis(), 20.0, 20.0, 300 + seed);
        let (mut filter, rest) = run.start(options);
        for z in rest {
            filter.update(z);
        }
        let (spin, truth) = (filter.estimate().spin.expect("it spins"), run.at(rest.last().expect("poses")));
        axis += square(spin.axis_rig.angle(&truth.rate));
        stated += square(spin.axis_sigma_rad);
        rate += square(spin.rate_rps - truth.rate.norm());
    }
    let mean = |sum: f64| (sum / runs as f64).sqrt() / DEGREE;
    (mean(axis), mean(stated), mean(rate))
}

#[test]
fn after_a_turn_the_axis_is_as_good_as_the_extrinsics_and_the_rate_much_better() {
    let (axis, stated, rate) = fixed_axis(FilterOptions::fixed_axis(), 12);
    println!("axis {axis}° (stated {stated}°), rate {rate} °/s");
    // The Kinect's constant tilt of 0.275° in two directions, the LiDAR's of 0.71° beside it, tempered by the weighted
    // mean of both: 0.3–0.4°. Twelve runs of two degrees of freedom scatter by a fifth.
    assert!(axis < 0.5 && (0.25..0.4).contains(&stated), "{axis} {stated}");
    assert!((0.6..1.7).contains(&(stated / axis)), "{}", stated / axis);
    assert!(rate < 0.02, "{rate}");
}

#[test]
fn without_calibration_states_and_by_the_published_filter_the_axis_is_still_found() {
    let inflated = FilterOptions { calibration: CalibrationTreatment::Inflated, ..FilterOptions::fixed_axis() };
    for (name, options) in [("inflated", inflated), ("paper", FilterOptions::paper())] {
        // The bounds are three times what is found: four runs tell.
        let (axis, stated, rate) = fixed_axis(options, 4);
        println!("{name}: axis {axis}° (stated {stated}°), rate {rate} °/s");
        assert!(axis < 1.0 && rate < 0.1, "{name} {axis} {rate}");
    }
}

#[test]
fn a_tumble_with_unknown_inertia_settles() {
    let options = FilterOptions::free_tumble();
    let mut squares = 0.0;
    for seed in 0..TUMBLES {
        let run = Run::new(&options, 60.0, 10.0, 500 + seed);
        let (mut filter, rest) = run.start(options);
        for z in rest {
            filter.update(z);
        }
        let momentum = filter.estimate().momentum.expect("an inertia is estimated");
        let off = momentum.axis_rig.angle(&run.at(rest.last().expect("poses")).momentum);
        squares += off * off / TUMBLES as f64;
    }
    let momentum = squares.sqrt() / DEGREE;
    println!("momentum {momentum}°");
    assert!(momentum < 1.5, "{momentum}");
}

#[test]
fn what_rests_does_not_spin() {
    for options in [FilterOptions::fixed_axis(), FilterOptions::free_tumble()] {
        for seed in 0..4 {
            let noise = FilterOptions { q_angular: 0.0, ..options };
            let run = Run::new(&noise, 8.0, 0.0, 900 + seed);
            let (mut filter, rest) = run.start(options);
            for z in rest {
                filter.update(z);
                assert_eq!(filter.estimate().spin, None, "{:?} {seed}", z.t);
            }
        }
    }
}
