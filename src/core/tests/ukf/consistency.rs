//! Squared errors over seeds, against the covariance that the filter states.

use crate::truth::{Run, nees};
use tumbled_core::ukf::FilterOptions;
use tumbled_model::se3::adjoint;

/// Runs, and the times at which each is looked at, s.
const RUNS: u64 = 24;
const TIMES: [f64; 3] = [3.0, 8.0, 14.9];

/// Mean NEES at each of the times, and the mean NIS.
fn means(options: FilterOptions, rate_dps: f64) -> ([f64; 3], f64) {
    let mut squares = [0.0; 3];
    let (mut nis, mut taken) = (0.0, 0.0);
    for seed in 0..RUNS {
        let run = Run::new(&options, 15.0, rate_dps, 100 + seed);
        let (mut filter, rest) = run.start(options);
        let mut due = TIMES.iter().zip(&mut squares).peekable();
        for z in rest {
            let verdict = filter.update(z);
            nis += verdict.nis.expect("a pose of a known sensor");
            taken += 1.0;
            if let Some((_, square)) = due.next_if(|(time, _)| z.t.0 as f64 * 1e-9 >= **time) {
                *square += nees(&filter.estimate(), &run.at(z)) / RUNS as f64;
            }
        }
        assert!(due.next().is_none(), "every time was reached");
        assert_eq!(filter.counts().failed, 0);
    }
    (squares, nis / taken)
}

// Of 12 degrees of freedom and 24 runs the mean's variance is 2·12/24 = 1: [10.1, 14.0] holds 95 of 100, and four
// standard deviations, for three times and two motions, reach [8, 16]. The runs' 546 poses each have six degrees of
// freedom: the mean NIS of 13,104 varies by √(12/13,104) = 0.03, four times that is 0.12.

#[test]
fn a_fixed_axis_is_known_as_well_as_it_says() {
    let (nees, nis) = means(FilterOptions::fixed_axis(), 20.0);
    println!("NEES {nees:?}, NIS {nis}");
    assert!(nees.iter().all(|mean| (8.0..16.0).contains(mean)), "{nees:?}");
    assert!((nis - 6.0).abs() < 0.12, "{nis}");
}

#[test]
fn a_tumble_of_unknown_inertia_is_known_as_well_as_it_says() {
    let (nees, nis) = means(FilterOptions::free_tumble(), 10.0);
    println!("NEES {nees:?}, NIS {nis}");
    assert!(nees.iter().all(|mean| (8.0..16.0).contains(mean)), "{nees:?}");
    assert!((nis - 6.0).abs() < 0.12, "{nis}");
}

#[test]
fn extrinsics_and_lateness_are_known_as_well_as_they_say() {
    let options = FilterOptions::fixed_axis();
    let (mut squares, mut late) = (0.0, 0.0);
    for seed in 0..RUNS {
        let run = Run::new(&options, 10.0, 20.0, 700 + seed);
        let (mut filter, rest) = run.start(options);
        for z in rest {
            filter.update(z);
        }
        let (drift, covariance) = filter.extrinsic_drift(0, 1).expect("two sensors");
        let to_first = adjoint(&run.priors[0].nominal.inv_mul(&run.priors[1].nominal));
        let off = drift - (to_first * run.constant[1] - run.constant[0]);
        squares += off.dot(&covariance.cholesky().expect("positive").solve(&off)) / RUNS as f64;
        let (late_s, sigma_s) = filter.lateness(0).expect("a Kinect");
        // How late a Kinect is shows against the LiDAR only: 20 °/s times 2 ms are 0.04°, little beside their biases.
        assert!(sigma_s <= 0.002 && filter.lateness(1).is_none());
        let off = (late_s - run.late_s[0]) / sigma_s;
        late += off * off / RUNS as f64;
    }
    println!("extrinsic {squares}, lateness {late}");
    // Six degrees of freedom over 24 runs: the mean's variance is 2·6/24, four standard deviations are 2.8. One: 1.15.
    assert!((squares - 6.0).abs() < 2.8 && (late - 1.0).abs() < 1.15, "{squares} {late}");
}

#[test]
fn the_sources_of_uncertainty_add_up_to_the_poses_own() {
    let options = FilterOptions::fixed_axis();
    let run = Run::new(&options, 6.0, 20.0, 11);
    let (mut filter, rest) = run.start(options);
    for z in rest {
        filter.update(z);
    }
    let sources = filter.sigma_by_source().expect("calibration is a state");
    let parts = [sources.calibration, sources.time, sources.slow, sources.noise];
    let (attitude, position) = filter.estimate().sigma();
    let length = |pick: fn(&(f64, f64)) -> f64| parts.iter().map(|part| pick(part) * pick(part)).sum::<f64>().sqrt();
    assert!((length(|part| part.0) / attitude - 1.0).abs() < 1e-9);
    assert!((length(|part| part.1) / position - 1.0).abs() < 1e-9);
    // Every source has a part in it: nothing of this is known exactly.
    assert!(parts.iter().all(|part| part.0 > 0.0 && part.1 > 0.0), "{parts:?}");
}
