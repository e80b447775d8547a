use super::orbit::ClohessyWiltshire;
use super::path::{Drifting, Walk};
use super::profile::Profile;
use super::tumble::Tumble;
use super::turntable::Turntable;
use super::*;
use nalgebra::{Point3, Unit};
use proptest::prelude::*;
use tumbled_model::Span;

fn vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
    let part = || -size..size;
    [part(), part(), part()].prop_map(Vector3::from)
}

fn pose() -> impl Strategy<Value = Isometry3<f64>> {
    (vector(3.0), vector(1.8)).prop_map(|(place, turn)| Isometry3::new(place, turn))
}

fn span() -> impl Strategy<Value = Span> {
    (1_i64..5_000).prop_map(|ms| Span(ms * 1_000_000))
}

fn profile() -> impl Strategy<Value = Profile> {
    let rate = || -1.0..1.0_f64;
    prop_oneof![
        rate().prop_map(|rate_rps| Profile::Constant { rate_rps }),
        (rate(), rate(), span(), span()).prop_map(|(from_rps, to_rps, begins, lasts)| Profile::Ramp {
            from_rps,
            to_rps,
            begins: RigNs(begins.0),
            lasts
        }),
        (rate(), span(), span(), span())
            .prop_map(|(rate_rps, stop, go, ramp)| { Profile::StopAndGo { rate_rps, stop, go, ramp } }),
        (rate(), span(), span(), span(), 0..20_u32).prop_map(|(step_rad, rest, moving, ramp, count)| {
            Profile::Steps { step_rad, rest, moving, ramp, count }
        }),
        (rate(), rate(), span())
            .prop_map(|(mean_rps, amplitude_rad, period)| { Profile::Sinusoid { mean_rps, amplitude_rad, period } }),
    ]
}

fn turntable() -> impl Strategy<Value = Arc<dyn Motion>> {
    let axis = vector(1.0).prop_filter("a direction", |axis| axis.norm() > 0.01);
    (axis, vector(3.0), pose(), -7.0..7.0_f64, profile()).prop_map(|(axis, centre, mount, start_rad, profile)| {
        let (axis, centre) = (Unit::new_normalize(axis), Point3::from(centre));
        Arc::new(Turntable { axis, centre, mount, start_rad, profile }) as _
    })
}

fn tumble() -> impl Strategy<Value = Arc<dyn Motion>> {
    let inertia = || 1.0..1.9_f64;
    let inertia = [inertia(), inertia(), inertia()].prop_map(Vector3::from);
    (inertia, vector(1.0), pose(), vector(0.2)).prop_map(|(inertia, rates, start, centre)| {
        Arc::new(Tumble::new(inertia, rates, start, centre.into()).unwrap()) as _
    })
}

fn orbit() -> impl Strategy<Value = Arc<dyn Motion>> {
    (pose(), prop_oneof![Just(0.0), 0.0..0.1], vector(2.0), vector(0.1)).prop_map(
        |(t_rig_hill, mean_motion_rps, position_m, velocity_mps)| {
            Arc::new(ClohessyWiltshire { t_rig_hill, mean_motion_rps, position_m, velocity_mps }) as _
        },
    )
}

fn motion() -> impl Strategy<Value = Arc<dyn Motion>> {
    let straight = || (pose(), vector(1.0));
    prop_oneof![
        pose().prop_map(|pose| Arc::new(Still(pose)) as _),
        straight().prop_map(|(start, velocity_mps)| Arc::new(Drifting { start, velocity_mps }) as _),
        turntable(),
        tumble(),
        orbit(),
        (orbit(), tumble()).prop_map(|(path, attitude)| Arc::new(Superposed { path, attitude }) as _),
    ]
}

proptest! {
    /// Central differences over ±0.2 ms. Draws where a profile's rate bends within that are set aside: there the
    /// difference is a mean over the bend.
    #[test]
    fn motions_have_the_velocities_that_their_poses_show(motion in motion(), t_ms in -5_000_i64..60_000) {
        const H: i64 = 200_000;
        let t = RigNs(t_ms * 1_000_000 + 333_333);
        let (before, now, after) = (motion.state(RigNs(t.0 - H)), motion.state(t), motion.state(RigNs(t.0 + H)));
        let bend = (after.angular_velocity_rps - 2.0 * now.angular_velocity_rps + before.angular_velocity_rps).norm();
        prop_assume!(bend < 1e-6);
        let per_s = 1e9 / (2 * H) as f64;
        let moved = (after.t_rig_body.translation.vector - before.t_rig_body.translation.vector) * per_s;
        let turned = (after.t_rig_body.rotation * before.t_rig_body.rotation.inverse()).scaled_axis() * per_s;
        // Second order in h, and 1e-16 / h of rounding.
        prop_assert!((moved - now.velocity_mps).norm() < 2e-5, "{} {}", moved, now.velocity_mps);
        prop_assert!((turned - now.angular_velocity_rps).norm() < 2e-5, "{} {}", turned, now.angular_velocity_rps);
    }

    #[test]
    fn motions_are_a_rotation_and_a_place_at_any_time(motion in motion(), t in any::<i64>()) {
        let state = motion.state(RigNs(t));
        prop_assert!((state.t_rig_body.rotation.norm() - 1.0).abs() < 1e-12);
        prop_assert!(state.t_rig_body.translation.vector.iter().all(|x| x.is_finite()));
    }
}

#[test]
fn a_drifting_tumble_has_its_centre_of_mass_on_the_path() {
    let path = Walk::new(&[Point3::new(1.0, 0.0, 0.0), Point3::new(5.0, 0.0, 0.0)], 0.5, RigNs(0));
    let centre = Point3::new(0.1, 0.2, -0.1);
    let start = Isometry3::translation(-0.1, -0.2, 0.1);
    let tumble = Tumble::new(Vector3::new(1.0, 1.5, 2.0), Vector3::new(0.3, 0.2, 0.1), start, centre).unwrap();
    let motion = Superposed { path: Arc::new(path), attitude: Arc::new(tumble) };
    let placed = motion.state(RigNs(4_000_000_000)).t_rig_body * centre;
    // 4 s at 0.5 m/s from x = 1.
    assert!((placed - Point3::new(3.0, 0.0, 0.0)).norm() < 1e-12);
}
