//! Shadows, edges, flying pixels, drop-outs and empty columns.

use crate::scenes::{SEED, code, frame, kinect, placed, plate, received, wall};
use nalgebra::{Isometry3, Vector3};
use std::sync::Arc;
use tumbled_kinect::{Intrinsics, ZeroPlane};
use tumbled_model::RigNs;
use tumbled_sim::kinect::{Frame, KinectModel, KinectParameters};
use tumbled_sim::motion::{BodyState, Motion};
use tumbled_sim::shape::Material;
use tumbled_sim::world::{Body, Role, World};

/// A plate 0.4 m wide at `near` before a wall at `far`, both square to the camera.
fn plate_before_wall(near: f64, far: f64) -> World {
    World::new(vec![
        placed(plate(0.2, 0.15, Material::Matt), [0.0, 0.0, near], 0.0, 0.0, Role::Target),
        placed(plate(30.0, 30.0, Material::Matt), [0.0, 0.0, far], 0.0, 0.0, Role::Room),
    ])
}

/// The holes in a row: first column and width.
fn holes(frame: &Frame, v: usize) -> Vec<(usize, usize)> {
    let mut holes: Vec<(usize, usize)> = Vec::new();
    for u in (0..632).filter(|u| code(frame, *u, v).is_none()) {
        match holes.last_mut() {
            Some((first, width)) if *first + *width == u => *width += 1,
            _ => holes.push((u, 1)),
        }
    }
    holes
}

/// Share of pixels with data in a window about the middle.
fn filled(frame: &Frame, half: usize) -> f64 {
    let window = (240 - half..240 + half).flat_map(|v| (320 - half..320 + half).map(move |u| (u, v)));
    window.filter(|(u, v)| code(frame, *u, *v).is_some()).count() as f64 / (4 * half * half) as f64
}

#[test]
fn the_shadow_lies_left_of_the_near_surface_and_is_as_wide_as_the_baseline_makes_it() {
    for (near, far) in [(0.8, 1.6), (1.0, 3.0), (1.5, 2.5), (2.0, 4.0)] {
        let frame = frame(KinectParameters::ideal(), &plate_before_wall(near, far));
        // f·b = 575.8 · 0.075 = 43.185 px·m. The plate's left edge: 320 − 575.8 · 0.2/near.
        let (width, edge) = (43.185 * (1.0 / near - 1.0 / far), 320.0 - 115.16 / near);
        let found = holes(&frame, 240);
        assert_eq!(found.len(), 1, "{near} m before {far} m: {found:?}");
        let (first, wide) = found[0];
        assert!((wide as f64 - width).abs() <= 1.0, "{near} m before {far} m: {wide} px, expected {width}");
        assert_eq!(first + wide, edge.ceil() as usize, "it ends at the plate");
    }
}

#[test]
fn shadows_of_a_real_device_with_its_ragged_edges_are_as_wide_in_the_mean() {
    for (near, far) in [(0.8, 1.2), (0.8, 1.6), (1.0, 2.0), (1.0, 3.0), (1.5, 2.5), (1.5, 4.0), (2.0, 4.0)] {
        let frame = frame(KinectParameters::default(), &plate_before_wall(near, far));
        // Rows clear of the plate's upper and lower end, 575.8 · 0.15/near to either side, and of their raggedness.
        let half = (86.37 / near) as usize - 8;
        let rows = 240 - half..240 + half;
        let empty: usize = rows.clone().flat_map(|v| holes(&frame, v)).map(|(_, width)| width).sum();
        let (found, expected) = (empty as f64 / rows.len() as f64, 43.185 * (1.0 / near - 1.0 / far));
        println!("{near} m before {far} m: {found:.1} px, expected {expected:.1} px");
        assert!((found / expected - 1.0).abs() < 0.15, "{near} m before {far} m: {found} px, expected {expected}");
    }
}

#[test]
fn a_thin_thing_casts_a_shadow_beside_itself() {
    // A rod of 20 mm at 1 m is 11.5 px wide, its shadow on a wall at 3 m begins 43.185 · (1 − 1/3) = 28.8 px farther left:
    // between the two the wall is lit.
    let rod = placed(plate(0.01, 1.0, Material::Matt), [0.0, 0.0, 1.0], 0.0, 0.0, Role::Target);
    let back = placed(plate(30.0, 30.0, Material::Matt), [0.0, 0.0, 3.0], 0.0, 0.0, Role::Room);
    let found = holes(&frame(KinectParameters::ideal(), &World::new(vec![rod, back])), 240);
    assert_eq!(found.len(), 1, "{found:?}");
    let (first, wide) = found[0];
    assert!((wide as f64 - 11.5).abs() <= 1.0 && (first as f64 - (314.24 - 28.8)).abs() <= 1.0, "{found:?}");
}

#[test]
fn the_last_eight_columns_are_empty() {
    let frame = frame(KinectParameters::default(), &wall(2.0, 0.0, 0.0));
    for v in 0..480 {
        assert!((632..640).all(|u| code(&frame, u, v).is_none()) && code(&frame, 631, v).is_some(), "row {v}");
    }
}

#[test]
fn surfaces_are_lost_between_70_and_80_degrees() {
    let share = |deg: f64| {
        // 60 × 60 pixels about the axis, where the incidence is the plate's turn within 2.9°.
        filled(&frame(KinectParameters::default(), &wall(1.5, deg, 0.0)), 30)
    };
    assert_eq!(share(0.0), 1.0);
    assert_eq!(share(66.0), 1.0);
    let half = share(75.0);
    assert!((0.2..0.8).contains(&half), "{half}");
    assert_eq!(share(84.0), 0.0);
}

#[test]
fn dark_surfaces_end_early_and_foil_shines_only_towards_the_camera() {
    let share = |material: Material, metres: f64, deg: f64| {
        let body = placed(plate(30.0, 30.0, material), [0.0, 0.0, metres], deg, 0.0, Role::Target);
        filled(&frame(KinectParameters::default(), &World::new(vec![body])), 20)
    };
    // Dark: to 2.5 m, at 60° to 2.5 · √0.5 = 1.77 m, 5 % either way; over the window the turned plate is 6 % nearer to farther.
    let dark = [(2.3, 0.0), (2.7, 0.0), (1.5, 60.0), (2.2, 60.0)].map(|(z, deg)| share(Material::Dark, z, deg));
    assert_eq!(dark, [1.0, 0.0, 1.0, 0.0]);
    let foil = [0.0, 35.0, 60.0].map(|deg| share(Material::Foil, 1.5, deg));
    assert_eq!(foil[..2], [1.0, 1.0]);
    // 5 % of 1600 pixels are 80 ± 9.
    assert!((foil[2] - 0.05).abs() < 0.025, "{foil:?}");
    assert_eq!(share(Material::Matt, 1.5, 60.0), 1.0);
}

#[test]
fn there_is_no_data_out_of_range() {
    for (metres, expected) in [(0.40, 0.0), (0.50, 1.0), (6.5, 1.0), (7.5, 0.0), (20.0, 0.0)] {
        assert_eq!(filled(&frame(KinectParameters::default(), &wall(metres, 0.0, 0.0)), 20), expected, "{metres} m");
    }
}

#[test]
fn edges_stray_by_a_pixel_or_two_and_never_more_than_four() {
    let parameters =
        KinectParameters { noise_share: 0.0, warp_m: 0.0, flying_share: 0.0, ..KinectParameters::default() };
    let frame = frame(parameters, &plate_before_wall(1.5, 2.5));
    // The plate's right edge, where there is no shadow: 320 + 115.16/1.5 = 396.8: the last column is 396. Rows 192 to 288 are
    // clear of the plate's ends at 240 ± 57.6.
    let near = ZeroPlane::default().code_at(1.5).expect("in range").0;
    let strays: Vec<f64> = (192..288)
        .flat_map(|v| {
            let line = frame.raw.pixels()[v * 640..][..640].iter().map(|code| code.0 == near).collect::<Vec<bool>>();
            let last = (320..632).rev().find(|u| line[*u]).expect("the plate is in the row");
            [last as f64 - 396.0]
        })
        .collect();
    let spread = (strays.iter().map(|x| x * x).sum::<f64>() / strays.len() as f64).sqrt();
    assert!((0.7..3.0).contains(&spread), "{spread} px");
    assert!(strays.iter().all(|stray| stray.abs() <= 4.0), "{strays:?}");
}

#[test]
fn flying_pixels_lie_between_fore_and_background_and_only_at_edges() {
    let parameters = KinectParameters { noise_share: 0.0, warp_m: 0.0, ..KinectParameters::default() };
    let frame = frame(parameters, &plate_before_wall(1.5, 2.5));
    let law = ZeroPlane::default();
    let [near, far] = [1.5, 2.5].map(|z| law.code_at(z).expect("in range").0);
    let mut flying = 0;
    for (u, v) in (0..480).flat_map(|v| (0..632).map(move |u| (u, v))) {
        let Some(code) = code(&frame, u, v).filter(|code| ![near, far].contains(code)) else { continue };
        flying += 1;
        assert!((near..far).contains(&code), "{code} at {u}, {v}");
        // The plate is 243.2..396.8 across and 182.4..297.6 down, its shadow 43.185 · (1/1.5 − 1/2.5) = 11.5 px to the left.
        let near_edge = |at: usize, edges: &[f64]| edges.iter().any(|edge| (at as f64 - edge).abs() <= 5.0);
        assert!(near_edge(u, &[231.7, 243.2, 396.8]) || near_edge(v, &[182.4, 297.6]), "{u}, {v}");
    }
    // Some 420 px of edge, about half of one pixel strayed over on either side, 15 % of them: tens.
    assert!((20..400).contains(&flying), "{flying}");
}

/// Moves along x.
#[derive(Debug)]
struct Slide {
    metres_per_s: f64,
    z: f64,
}

impl Motion for Slide {
    fn state(&self, t: RigNs) -> BodyState {
        let x = self.metres_per_s * t.0 as f64 * 1e-9;
        let velocity_mps = Vector3::x() * self.metres_per_s;
        BodyState {
            t_rig_body: Isometry3::translation(x, 0.0, self.z),
            velocity_mps,
            angular_velocity_rps: Vector3::zeros(),
        }
    }
}

#[test]
fn rows_are_seen_one_after_the_other() {
    // 1 m/s at 1.5 m is 383.9 px/s: from row 0 to row 479 of a 30 ms readout an upright edge leans by 11.5 px, and is at its
    // place at the frame's time in row 240.
    let motion = Arc::new(Slide { metres_per_s: 1.0, z: 1.5 });
    let body = Body { role: Role::Target, mesh: Arc::new(plate(0.2, 5.0, Material::Matt)), motion };
    let world = World::new(vec![body]);
    let parameters = KinectParameters { readout_s: 0.03, ..KinectParameters::ideal() };
    let frame = received(kinect(parameters).frame(&world, RigNs(100_000_000), 0, SEED));
    for v in [0, 100, 240, 479] {
        // Right edge: x = 0.2 + t.
        let t = 0.1 + 0.03 * (v as f64 / 480.0 - 0.5);
        let expected = (320.0 + 575.8 * (0.2 + t) / 1.5).floor() as usize;
        let last = (0..632).rev().find(|u| code(&frame, *u, v).is_some());
        assert_eq!(last, Some(expected), "row {v}");
    }
}

#[test]
fn distortion_bends_what_is_straight() {
    // A mild barrel: the plate's right edge in row 240 is where the camera's own formula puts it.
    let camera = Intrinsics { k1: -0.1, k2: 0.02, p1: 1e-3, ..Intrinsics::default() };
    let kinect = KinectModel::new("bent", &camera, Isometry3::identity(), KinectParameters::ideal()).expect("a camera");
    let plate = placed(plate(0.6, 0.45, Material::Matt), [0.0, 0.0, 1.5], 0.0, 0.0, Role::Target);
    let frame = received(kinect.frame(&World::new(vec![plate]), RigNs(0), 0, SEED));
    for y in [-0.2, 0.0, 0.25] {
        let (u, v) = camera.pixel(0.6 / 1.5, y);
        let last = (0..632).rev().find(|u| code(&frame, *u, v.round() as usize).is_some()).expect("in the row");
        assert!((last as f64 - u).abs() <= 1.0, "{last}, expected {u}");
    }
}
