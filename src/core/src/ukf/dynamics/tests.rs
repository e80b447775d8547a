use super::*;
use proptest::prelude::*;

/// Free of an orbit.
fn moved(from: &Kinematics, dt: f64) -> Kinematics {
    from.moved(&ClohessyWiltshire::new(0.0, dt), dt)
}

/// A target 1 m before the rig's origin.
fn target(rate: [f64; 3], center: [f64; 3], inertia: [f64; 5]) -> Kinematics {
    Kinematics {
        pose: Isometry3::translation(0.0, 0.0, 1.0),
        velocity: Vector3::new(0.01, -0.02, 0.005),
        rate: rate.into(),
        center: center.into(),
        inertia: inertia.into(),
    }
}

#[test]
fn a_tumble_keeps_energy_and_momentum_for_a_thousand_seconds() {
    // 10 °/s off every principal axis, moments as 1 : 1.35 : 2.1, in steps of a frame.
    let mut body = target([0.06, 0.14, 0.08], [0.0; 3], [-0.3, -0.3, 0.1, 0.05, -0.1]);
    let inertia = Inertia::new(&body.inertia);
    let energy = |body: &Kinematics| body.rate.dot(&(inertia.tensor * body.rate));
    let momentum = |body: &Kinematics| body.pose.rotation * (inertia.tensor * body.rate);
    let (before, first) = (energy(&body), momentum(&body));
    for _ in 0..30_000 {
        body = moved(&body, 1.0 / 30.0);
    }
    assert!((energy(&body) / before - 1.0).abs() < 1e-6, "{}", energy(&body) / before - 1.0);
    assert!((momentum(&body) - first).norm() < 1e-6 * first.norm(), "{}", (momentum(&body) - first).norm());
}

#[test]
fn spin_about_a_principal_axis_stays() {
    // S is diagonal: the body's axes are principal.
    let mut body = target([0.0, 0.35, 0.0], [0.0; 3], [0.3, 0.2, 0.0, 0.0, 0.0]);
    for _ in 0..1000 {
        body = moved(&body, 1.0);
    }
    assert!((body.rate - Vector3::new(0.0, 0.35, 0.0)).norm() < 1e-12);
    // 350 rad about y.
    let expected = exp_rotation(&Vector3::new(0.0, 350.0, 0.0));
    assert!(body.pose.rotation.angle_to(&expected) < 1e-6);
}

#[test]
fn the_origin_circles_about_the_centre_of_mass() {
    // Half a turn about z: the origin, 5 cm from the centre along −x, comes to lie 5 cm along +x of it.
    let mut body = target([0.0, 0.0, core::f64::consts::PI], [0.05, 0.0, 0.0], [0.0; 5]);
    body.velocity = Vector3::zeros();
    let after = moved(&body, 1.0);
    assert!((after.pose.translation.vector - Vector3::new(0.1, 0.0, 1.0)).norm() < 1e-12);
    // Its velocity is that of its place: by central differences, whose error is (ω h)²/6 of 0.16 m/s.
    let h = 1e-4;
    let place = |dt: f64| moved(&body, dt).pose.translation.vector;
    let expected = (place(0.3 + h) - place(0.3 - h)) / (2.0 * h);
    let at = moved(&body, 0.3);
    assert!((at.pose.rotation * at.origin_velocity() - expected).norm() < 1e-7);
}

fn kinematics() -> impl Strategy<Value = Kinematics> {
    let three = |size: f64| proptest::array::uniform3(-size..size);
    (three(0.4), three(0.1), proptest::array::uniform5(-0.5..0.5f64), three(2.0)).prop_map(
        |(rate, center, inertia, turn)| {
            let mut body = target(rate, center, inertia);
            body.pose.rotation = exp_rotation(&turn.into());
            body
        },
    )
}

proptest! {
    #[test]
    fn going_back_comes_back(body in kinematics(), dt in 0.0..3.0f64) {
        let back = moved(&moved(&body, dt), -dt).minus(&body);
        // Of order four in steps of 0.1 rad.
        prop_assert!(back.norm() < 1e-4, "{back}");
    }

    #[test]
    fn attitude_follows_the_rate(body in kinematics()) {
        // Ṙ = R [ω]× and ω̇ = −J⁻¹(ω × Jω), by central differences: of an error (ω h)²/6.
        let h = 1e-4;
        let (after, before) = (moved(&body, h), moved(&body, -h));
        let turn = tumbled_model::se3::log_rotation(&(before.pose.rotation.inverse() * after.pose.rotation)) / (2.0 * h);
        prop_assert!((turn - body.rate).norm() < 1e-8);
        let inertia = Inertia::new(&body.inertia);
        let torque: Vector3<f64> = inertia.tensor * ((after.rate - before.rate) / (2.0 * h));
        prop_assert!((torque + body.rate.cross(&(inertia.tensor * body.rate))).norm() < 1e-8);
    }

    #[test]
    fn what_is_added_is_what_differs(body in kinematics(), by in proptest::array::uniform20(-0.5..0.5f64)) {
        let by = Deviation::from(by);
        prop_assert!((body.plus(&by).minus(&body) - by).norm() < 1e-12);
    }
}

#[test]
fn the_steps_do_not_show() {
    // 3.7 rad/s over 2 s, in 75 steps and in 2000: of order four.
    let body = target([3.0, 2.0, 1.0], [0.0; 3], [0.2, 0.1, 0.0, 0.1, 0.0]);
    let mut fine = body;
    for _ in 0..2000 {
        fine = moved(&fine, 1e-3);
    }
    let coarse = moved(&body, 2.0);
    assert!((coarse.rate - fine.rate).norm() < 1e-5, "{}", (coarse.rate - fine.rate).norm());
    assert!(coarse.pose.rotation.angle_to(&fine.pose.rotation) < 1e-5);
}
