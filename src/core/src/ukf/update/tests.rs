use super::super::dynamics::{Deviation, Kinematics};
use super::super::measurement::innovation;
use super::super::options::{CalibrationTreatment, FilterOptions, PoseMeasurement, SensorPrior, StatedUncertainty};
use super::super::sigma::predict;
use super::super::state::SensorState;
use super::*;
use nalgebra::{Isometry3, SMatrix, SVector, Vector3};
use tumbled_model::{RigNs, Span};

type Covariance = SMatrix<f64, 15, 15>;

/// States without calibration, at rest, so that motion and measurement are linear.
fn resting(sigmas: &Deviation) -> (Setup, State) {
    let options = FilterOptions {
        calibration: CalibrationTreatment::Inflated,
        q_acceleration: 1e-3,
        q_angular: 1e-4,
        ..FilterOptions::fixed_axis()
    };
    let prior = SensorPrior::kinect(Isometry3::identity(), 2.0, &StatedUncertainty::default());
    let setup = Setup::new(options, vec![prior]);
    let root = Root::diagonal(&setup.sigmas(sigmas));
    let target = Kinematics {
        pose: Isometry3::translation(0.0, 0.0, 1.0),
        velocity: Vector3::zeros(),
        rate: Vector3::zeros(),
        center: Vector3::zeros(),
        inertia: SVector::zeros(),
    };
    let state = State { t: RigNs(0), target, sensors: vec![SensorState::default()], root, refused: 0 };
    (setup, state)
}

/// The motion's noise of three states and their rates.
fn add_noise(covariance: &mut Covariance, place: usize, rate: usize, q: f64, dt: f64) {
    for axis in 0..3 {
        covariance[(place + axis, place + axis)] += q * q * dt * dt * dt / 3.0;
        covariance[(place + axis, rate + axis)] += q * q * dt * dt / 2.0;
        covariance[(rate + axis, place + axis)] += q * q * dt * dt / 2.0;
        covariance[(rate + axis, rate + axis)] += q * q * dt;
    }
}

#[test]
fn where_all_is_linear_it_is_the_ordinary_kalman_filter() {
    // Attitudes and rates of 1e-6: what is of second order is 1e-12 of a metre.
    let mut sigmas = Deviation::repeat(1e-6);
    sigmas.fixed_rows_mut::<3>(3).fill(0.03);
    sigmas.fixed_rows_mut::<3>(6).fill(0.02);
    let (setup, mut state) = resting(&sigmas);
    let setup = Setup { options: FilterOptions { q_angular: 1e-9, ..setup.options }, ..setup };
    let mut mean = SVector::<f64, 15>::zeros();
    let mut covariance: Covariance = state.root.covariance::<15, 15>(0, 0);
    let dt = 0.25;
    for step in 1..=12 {
        let t = RigNs(0) + Span(250_000_000 * step);
        state = predict(&setup, &state, t);
        let mut motion = Covariance::identity();
        for axis in 0..3 {
            motion[(axis, 9 + axis)] = dt;
            motion[(3 + axis, 6 + axis)] = dt;
        }
        mean = motion * mean;
        covariance = motion * covariance * motion.transpose();
        add_noise(&mut covariance, 0, 9, 1e-9, dt);
        add_noise(&mut covariance, 3, 6, 1e-3, dt);

        let place = Vector3::new(0.01 * step as f64, -0.004, 1.0 + 0.002 * (step % 3) as f64);
        let z = PoseMeasurement {
            t,
            sensor: 0,
            pose: Isometry3::translation(place.x, place.y, place.z),
            information: Matrix6::identity() * 1e6,
        };
        let innovation = innovation(&setup, &state, &z).expect("a pose");
        let seen = covariance.fixed_view::<15, 6>(0, 0).into_owned();
        let spread = (covariance.fixed_view::<6, 6>(0, 0) + innovation.noise).into_owned();
        let inverse = spread.try_inverse().expect("positive");
        let mut off = Vector6::zeros();
        off.fixed_rows_mut::<3>(3).copy_from(&(place - Vector3::z()));
        let off = off - mean.fixed_rows::<6>(0);
        let (after, nis) = update(&setup, &state, &innovation, 1.0).expect("a correction");
        assert!((nis - off.dot(&(inverse * off))).abs() < 1e-6 * nis.max(1.0), "{step} {nis}");
        mean += seen * inverse * off;
        covariance -= seen * inverse * seen.transpose();
        state = after;

        let found: Covariance = state.root.covariance::<15, 15>(0, 0);
        let scale = sigmas.fixed_rows::<15>(0).into_owned();
        let worst = (found - covariance).component_div(&(scale * scale.transpose())).amax();
        assert!(worst < 1e-6, "{step} {worst}");
        assert!((state.target.pose.translation.vector - Vector3::z() - mean.fixed_rows::<3>(3)).norm() < 1e-9);
        assert!((state.target.velocity - mean.fixed_rows::<3>(6)).norm() < 1e-9);
    }
}

#[test]
fn after_a_correction_of_many_degrees_the_covariance_is_of_the_new_pose() {
    let sigmas = Deviation::repeat(0.2);
    let (setup, state) = resting(&sigmas);
    let root = &state.root;
    let twist = Vector6::new(0.0, 0.0, 0.4, 0.1, 0.0, 0.0);
    let found: Matrix6<f64> = moved_to(root, &twist).covariance::<6, 6>(0, 0);
    // G = I − ½ ad: θ' = θ − ½ [0.4 z]× θ: of equal sigmas the variance about z stays, about x and y it grows by 0.2².
    let expected = 0.04 * (1.0 + 0.04);
    assert!((found[(0, 0)] - expected).abs() < 1e-15 && (found[(2, 2)] - 0.04).abs() < 1e-15);
    // ρ' adds −½ [0.1 x]× θ: 0.05² in y and z.
    assert!((found[(5, 5)] - 0.04 * (1.0 + 0.0025)).abs() < 1e-15, "{}", found[(5, 5)]);
    assert_eq!(setup.layout.width, 15);
}

#[test]
fn prediction_forth_and_back_widens_what_moves() {
    let (setup, state) = resting(&Deviation::repeat(0.01));
    let later = predict(&setup, &state, RigNs(1_000_000_000));
    let variance = |state: &State, at: usize| state.root.covariance::<1, 1>(at, at).x;
    // σ² + (σ t)² of place and velocity, and q²/3, and the centre of mass's lever, 1e-4² of a rate.
    let expected = 1e-4 + 1e-4 + 1e-6 / 3.0;
    assert!((variance(&later, 3) - expected).abs() < 2e-6, "{}", variance(&later, 3));
    assert_eq!(predict(&setup, &state, state.t), state);
    assert!(variance(&predict(&setup, &state, RigNs(-1_000_000_000)), 3) > 1.9e-4);
}
