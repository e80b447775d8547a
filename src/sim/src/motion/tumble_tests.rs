use super::*;
use proptest::prelude::*;

fn tumble(inertia: [f64; 3], rates: [f64; 3]) -> Tumble {
    let start = Isometry3::new(Vector3::new(2.0, 0.5, 0.1), Vector3::new(0.4, -1.2, 0.3));
    Tumble::new(inertia.into(), rates.into(), start, Point3::new(0.02, -0.05, 0.03)).unwrap()
}

/// Kinetic energy and the angular momentum in the rig's axes.
fn conserved(inertia: [f64; 3], state: &BodyState) -> (f64, Vector3<f64>) {
    let rates = state.t_rig_body.inverse_transform_vector(&state.angular_velocity_rps);
    let momentum = Vector3::from(inertia).component_mul(&rates);
    (rates.dot(&momentum) / 2.0, state.t_rig_body * momentum)
}

fn secs(s: f64) -> RigNs {
    RigNs((s * 1e9) as i64)
}

/// Euler's equations and the quaternion's, by Runge and Kutta's fourth order.
fn integrated(inertia: [f64; 3], rates: [f64; 3], start: UnitQuaternion<f64>, seconds: f64) -> UnitQuaternion<f64> {
    use nalgebra::Quaternion;
    let inertia = Vector3::from(inertia);
    let slope = |q: Quaternion<f64>, w: Vector3<f64>| {
        let turning = q * Quaternion::from_imag(w) * 0.5;
        (turning, inertia.component_mul(&w).cross(&w).component_div(&inertia))
    };
    let steps = (seconds / 1e-3).ceil();
    let h = seconds / steps;
    let (mut q, mut w) = (start.into_inner(), Vector3::from(rates));
    for _ in 0..steps as u32 {
        let k1 = slope(q, w);
        let k2 = slope(q + k1.0 * (h / 2.0), w + k1.1 * (h / 2.0));
        let k3 = slope(q + k2.0 * (h / 2.0), w + k2.1 * (h / 2.0));
        let k4 = slope(q + k3.0 * h, w + k3.1 * h);
        q += (k1.0 + k2.0 * 2.0 + k3.0 * 2.0 + k4.0) * (h / 6.0);
        w += (k1.1 + k2.1 * 2.0 + k3.1 * 2.0 + k4.1) * (h / 6.0);
    }
    UnitQuaternion::new_normalize(q)
}

/// About either end axis, in every order of the moments, symmetric bodies, close to the middle axis, even spins.
const CASES: [([f64; 3], [f64; 3]); 12] = [
    ([1.0, 1.5, 2.0], [0.1, 0.05, 0.4]),
    ([1.0, 1.5, 2.0], [0.4, 0.05, 0.1]),
    ([2.0, 1.0, 1.5], [-0.3, 0.1, 0.2]),
    ([1.5, 2.0, 1.0], [0.3, -0.2, -0.4]),
    ([1.5, 1.0, 2.0], [0.2, 0.3, -0.1]),
    ([2.0, 1.5, 1.0], [-0.2, -0.3, 0.3]),
    ([1.0, 2.0, 1.5], [0.01, -0.3, 0.5]),
    ([1.0, 1.0, 1.6], [0.2, 0.1, 0.3]),
    ([1.0, 1.8, 1.8], [0.3, 0.2, 0.1]),
    ([1.0, 1.5, 2.0], [1e-6, 0.5, 1e-7]),
    ([1.0, 1.5, 2.0], [0.0, 0.7, 0.0]),
    ([1.3, 1.3, 1.3], [0.2, -0.4, 0.1]),
];

#[test]
fn energy_and_momentum_hold_for_a_thousand_seconds() {
    for (inertia, rates) in CASES {
        let motion = tumble(inertia, rates);
        let (energy, momentum) = conserved(inertia, &motion.state(RigNs(0)));
        for k in 0..=10_000 {
            let (now, turned) = conserved(inertia, &motion.state(secs(f64::from(k) * 0.1)));
            let off = ((now - energy) / energy).abs().max((turned - momentum).norm() / momentum.norm());
            // The promise is 1e-6; the closed form holds to rounding.
            assert!(off < 1e-12, "{inertia:?} {rates:?} at {k}: {off}");
        }
    }
}

#[test]
fn it_begins_where_it_is_told() {
    for (inertia, rates) in CASES {
        let state = tumble(inertia, rates).state(RigNs(0));
        let start = Isometry3::new(Vector3::new(2.0, 0.5, 0.1), Vector3::new(0.4, -1.2, 0.3));
        let off = state.t_rig_body.to_homogeneous() - start.to_homogeneous();
        let found = state.t_rig_body.inverse_transform_vector(&state.angular_velocity_rps);
        assert!(off.amax() < 1e-12, "{inertia:?} {rates:?}: {off}");
        assert!((found - Vector3::from(rates)).amax() < 1e-12, "{inertia:?} {rates:?}: {found}");
    }
}

#[test]
fn the_attitude_is_what_eulers_equations_integrate_to() {
    for (inertia, rates) in CASES {
        let motion = tumble(inertia, rates);
        let start = motion.state(RigNs(0)).t_rig_body.rotation;
        for seconds in [3.0, 40.0] {
            let off =
                motion.state(secs(seconds)).t_rig_body.rotation.angle_to(&integrated(inertia, rates, start, seconds));
            // Runge and Kutta's error at 1 ms and 1 rad/s is about 1e-14 per second. Near the middle axis it grows by
            // 0.5 · √(0.5 · 0.5 / 2) = 0.18 per second: e⁷, a thousandfold, in 40 s.
            assert!(off < 1e-9, "{inertia:?} {rates:?} after {seconds} s: {off}");
        }
    }
}

#[test]
fn the_centre_of_mass_stays() {
    let motion = tumble([1.0, 1.5, 2.0], [0.4, 0.05, 0.1]);
    let centre = Point3::new(0.02, -0.05, 0.03);
    let at = |s: f64| motion.state(secs(s)).t_rig_body * centre;
    assert!((1..100).all(|k| (at(f64::from(k)) - at(0.0)).norm() < 1e-14));
}

#[test]
fn spinning_almost_about_the_middle_axis_it_turns_over() {
    let motion = tumble([1.0, 1.5, 2.0], [1e-6, 0.5, 1e-7]);
    let rate = |s: f64| {
        let state = motion.state(secs(s));
        state.t_rig_body.inverse_transform_vector(&state.angular_velocity_rps).y
    };
    let least = (0..3_000).map(|k| rate(f64::from(k) * 0.1)).fold(f64::INFINITY, f64::min);
    assert!((least + 0.5).abs() < 1e-6, "{least}");
}

#[test]
fn moments_that_no_body_has_are_refused() {
    let try_new = |inertia: [f64; 3], rates: [f64; 3]| {
        Tumble::new(inertia.into(), rates.into(), Isometry3::identity(), Point3::origin()).err()
    };
    for inertia in [[1.0, 1.0, 2.1], [0.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [f64::NAN, 1.0, 1.0], [f64::INFINITY, 1.0, 1.0]]
    {
        assert!(matches!(try_new(inertia, [0.1; 3]), Some(TumbleError::Inertia(_))), "{inertia:?}");
    }
    assert!(matches!(try_new([1.0, 1.5, 2.0], [0.1, f64::NAN, 0.0]), Some(TumbleError::Rates(_))));
    // A flat plate: the third is the sum.
    assert_eq!(try_new([1.0, 1.0, 2.0], [0.1; 3]), None);
}

/// Moments that are equal, or almost, are as likely as others.
fn moment() -> impl Strategy<Value = f64> {
    prop_oneof![1.0..1.9_f64, Just(1.5), Just(1.5 + 1e-12), Just(1.5 - 1e-7)]
}

/// So are rates of almost nothing.
fn rate() -> impl Strategy<Value = f64> {
    prop_oneof![-1.0..1.0_f64, Just(0.0), -1e-9..1e-9, Just(1e-15)]
}

proptest! {
    #[test]
    fn tumbles_hold_energy_and_momentum(
        inertia in [moment(), moment(), moment()],
        rates in [rate(), rate(), rate()],
        times in prop::collection::vec(-1e3..1e3_f64, 1..20),
    ) {
        let motion = tumble(inertia, rates);
        let (energy, momentum) = conserved(inertia, &motion.state(RigNs(0)));
        for s in times {
            let (now, turned) = conserved(inertia, &motion.state(secs(s)));
            prop_assert!((now - energy).abs() <= 1e-11 * energy, "{} {}", now, energy);
            prop_assert!((turned - momentum).norm() <= 1e-11 * momentum.norm());
        }
    }
}
