//! Claims about what sensors say, on scenes whose truth is known.

use super::caster::{Body, Chance, depth_image, direction, lidar_at, points_of, range_image, returns_of, thinned};
use super::rings::{Direction, Rings};
use super::*;
use crate::register::cloud::{DepthView, RangeView};
use crate::surface::spacing_m;
use nalgebra::{Isometry3, Rotation3, Unit};
use proptest::prelude::*;

/// A plate 1 m × 0.8 m, 2 m before the camera and across its sight.
fn plate_for_camera() -> DepthView {
    // The plate lies across x of its frame: x to the camera's z.
    let turn = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -core::f64::consts::FRAC_PI_2);
    let place = Isometry3::from_parts(nalgebra::Translation3::new(0.0, 0.0, 2.0), turn);
    depth_image(&Body::plate(0.4, 0.5), &place, 0.0, &mut Chance::new(1))
}

/// A plate 0.8 m × 0.8 m, 3 m before the LiDAR.
fn plate_for_lidar() -> RangeView {
    range_image(&Body::plate(0.4, 0.4), &Isometry3::translation(3.0, 0.0, 0.0), 0.0, &mut Chance::new(1))
}

fn bare(sensor: SensorKind, points: Vec<Point3<f32>>) -> Cloud {
    Cloud { sensor, points, viewpoint: Some(Point3::origin()), view: View::Bare }
}

fn built(cloud: &Cloud) -> FreeSpace {
    FreeSpace::build(cloud, spacing_m(&cloud.points)).expect("sights")
}

/// Bare and organised, camera and LiDAR: a place before the plate, behind it, on it, and beside it.
fn sensors() -> [(&'static str, FreeSpace, [[f32; 3]; 4]); 4] {
    let (image, ranges) = (plate_for_camera(), plate_for_lidar());
    let camera = bare(SensorKind::Kinect, points_of(&image, 6));
    let lidar = bare(SensorKind::Lidar, returns_of(&ranges));
    let in_camera = [[0.05, -0.1, 1.7], [0.05, -0.1, 2.3], [0.05, -0.1, 2.0], [0.65, 0.1, 2.0]];
    // At 0° elevation rings are a third of a degree apart, 1.7 cm.
    let in_lidar = [[2.7, 0.1, 0.0], [3.3, 0.1, 0.0], [3.0, 0.1, 0.0], [3.0, 0.6, 0.0]];
    [
        ("bare camera", built(&camera), in_camera),
        ("depth image", built(&Cloud { view: View::Depth(image), ..camera.clone() }), in_camera),
        ("bare LiDAR", built(&lidar), in_lidar),
        ("range image", built(&Cloud { view: View::Ranges(ranges), ..lidar.clone() }), in_lidar),
    ]
}

#[test]
fn every_sensor_tells_front_hidden_surface_and_sky_of_a_plate() {
    for (name, sights, [front, hidden, on, beside]) in sensors() {
        // 30 cm before: (0.30 − 0.05)/0.04 is far above 1. The plate itself would stand there: nothing is hidden.
        let seen = sights.look(&front);
        assert!(seen.known && seen.front > 0.9 && seen.hidden == 0.0 && seen.sky == 0.0, "{name} {seen:?}");
        let seen = sights.look(&hidden);
        assert!(seen.known && seen.hidden > 0.9 && seen.front == 0.0 && seen.sky == 0.0, "{name} {seen:?}");
        let seen = sights.look(&on);
        assert!(seen.known && seen.front == 0.0 && seen.hidden == 0.0 && seen.sky == 0.0, "{name} {seen:?}");
        assert!(seen.behind_m.abs() < 0.02, "{name} {seen:?}");
        // 15 or 20 cm beside its edge: beyond the largest disc (12 cm) and the ramp (3 cm).
        let seen = sights.look(&beside);
        assert!(seen.known && seen.sky > 0.9 && seen.front == 0.0 && seen.hidden == 0.0, "{name} {seen:?}");
    }
}

#[test]
fn nothing_is_known_outside_the_view() {
    let [(_, camera, _), (_, depth, _), (_, lidar, _), (_, ranges, _)] = sensors();
    // 45° aside and behind the camera; above the LiDAR's rings, and between two of them 4° apart and 3 m away.
    for place in [[2.0, 0.0, 2.0], [0.0, 0.0, -2.0], [0.0, 0.0, 0.0]] {
        assert!(!camera.look(&place).known && !depth.look(&place).known, "{place:?}");
    }
    for place in [[3.0, 0.0, 1.2], [3.0, 0.0, -1.1], [3.0, 2.9, 0.0]] {
        assert!(!ranges.look(&place).known, "{place:?}");
    }
    // Bare points know of the rings they are on only, and end 30 cm beyond them.
    assert!(!lidar.look(&[3.0, 0.0, 1.2]).known);
    let between = (13.0f32).to_radians();
    assert!(!ranges.look(&[3.0 * libm::cosf(between), 0.0, 3.0 * libm::sinf(between)]).known);
}

#[test]
fn a_pixel_nobody_knows_tells_nothing_nor_does_its_neighbourhood() {
    let mut image = plate_for_camera();
    image.z_m[240 * 640 + 320] = f32::NAN;
    let sights = DepthMask::build(&image).expect("an image");
    // The principal ray meets that pixel; a place 4 cm before the plate's middle, and 30 cm before it, are the same to it.
    assert!(!sights.look([0.0, 0.0, 1.7]).known && !sights.look([0.0, 0.0, 2.0]).known);
    // 30 px aside: known.
    assert!(sights.look([0.1, 0.0, 1.7]).front > 0.9);
}

#[test]
fn a_missed_firing_on_a_surface_is_no_sky_nor_are_three_but_a_hole_is() {
    let mut ranges = plate_for_lidar();
    // Ring 20 is at 0°, column 150 at azimuth 0.
    let middle = 20 * 301 + 150;
    ranges.range_m[middle] = f32::INFINITY;
    let once = RangeMask::build(&ranges).expect("an image");
    assert_eq!(once.look([3.0, 0.0, 0.0]).sky, 0.0);
    for side in [middle - 1, middle + 1] {
        ranges.range_m[side] = f32::INFINITY;
    }
    let three = RangeMask::build(&ranges).expect("an image").look([3.0, 0.0, 0.0]);
    assert!(three.known && three.sky == 0.0, "rings above and below returned: {three:?}");
    // Nothing within 1.4° up and down and 1.6° aside: the nearest return is 1.667° away, 8.7 cm at 3 m, and 6 cm are a hole.
    for (ring, elevation) in ranges.elevations_rad.iter().enumerate() {
        if elevation.abs() < 1.4f32.to_radians() {
            ranges.range_m[ring * 301 + 142..=ring * 301 + 158].fill(f32::INFINITY);
        }
    }
    assert_eq!(RangeMask::build(&ranges).expect("an image").look([3.0, 0.0, 0.0]).sky, 1.0);
    ranges.range_m[middle] = f32::NAN;
    assert!(!RangeMask::build(&ranges).expect("an image").look([3.0, 0.0, 0.0]).known);
}

#[test]
fn a_turn_that_begins_anywhere_is_read_where_it_begins() {
    // One ring, 360 columns of 1°, from 170°: the return at −175° is column 15.
    let mut range_m = vec![f32::INFINITY; 360];
    range_m[14..17].fill(5.0);
    let view = RangeView {
        elevations_rad: vec![0.0],
        first_azimuth_rad: 170f32.to_radians(),
        azimuth_step_rad: 1f32.to_radians(),
        range_m,
    };
    let mask = RangeMask::build(&view).expect("an image");
    let at = |azimuth: f32| -> [f32; 3] { (direction(azimuth.to_radians(), 0.0) * 4.0).into() };
    assert_eq!(mask.look(at(-175.0)).front, 1.0);
    assert_eq!(mask.look(at(0.0)).sky, 1.0);
    assert_eq!(mask.look(at(165.0)).sky, 1.0);
    // The first column has no neighbour before it.
    assert!(!mask.look(at(170.0)).known);
}

#[test]
fn images_that_are_not_what_they_say_give_no_sights() {
    let image = plate_for_camera();
    assert!(DepthMask::build(&DepthView { width: 641, ..image.clone() }).is_none());
    assert!(DepthMask::build(&DepthView { focal_px: [0.0, 590.0], ..image.clone() }).is_none());
    assert!(DepthMask::build(&DepthView { width: usize::MAX, height: 2, ..image }).is_none());
    let ranges = plate_for_lidar();
    assert!(RangeMask::build(&RangeView { azimuth_step_rad: 0.0, ..ranges.clone() }).is_none());
    assert!(RangeMask::build(&RangeView { elevations_rad: Vec::new(), ..ranges.clone() }).is_none());
    assert!(RangeMask::build(&RangeView { elevations_rad: vec![0.1, -0.1], ..ranges.clone() }).is_none());
    assert!(RangeMask::build(&RangeView { elevations_rad: vec![-1e9, 1e9], ..ranges }).is_none());
    let unknown = Cloud { viewpoint: None, ..bare(SensorKind::Kinect, points_of(&plate_for_camera(), 6)) };
    assert!(FreeSpace::build(&unknown, 0.02).is_none());
    assert!(FreeSpace::build(&bare(SensorKind::Lidar, Vec::new()), 0.02).is_none());
}

#[test]
fn a_viewpoint_elsewhere_is_taken_off() {
    for sensor in [SensorKind::Kinect, SensorKind::Lidar] {
        let points = match sensor {
            SensorKind::Kinect => points_of(&plate_for_camera(), 6),
            SensorKind::Lidar => returns_of(&plate_for_lidar()),
        };
        let here = bare(sensor, points);
        let step = Vector3::new(4.0, -2.0, 1.0);
        let moved = here.points.iter().map(|point| point + step).collect();
        let there = Cloud { viewpoint: Some(Point3::from(step)), ..bare(sensor, moved) };
        let (here, there) = (built(&here), built(&there));
        let mut chance = Chance::new(3);
        for _ in 0..500 {
            let place = Vector3::new(chance.normal(), chance.normal(), chance.normal()).cast::<f32>() * 0.3
                + if sensor == SensorKind::Kinect { Vector3::z() * 2.0 } else { Vector3::x() * 3.0 };
            let (a, b) = (here.look(&place.into()), there.look(&(place + step).into()));
            // Cells may begin a rounding error elsewhere: nearly the same is the same.
            let differ = (a.front - b.front).abs() + (a.hidden - b.hidden).abs() + (a.sky - b.sky).abs();
            assert!(differ < 0.35, "{place:?} {a:?} {b:?}");
        }
    }
}

fn directions(points: &[Point3<f32>]) -> Vec<Direction> {
    points.iter().map(|point| Direction::of(&point.coords, 0.0)).collect()
}

#[test]
fn rings_and_their_step_are_found_of_full_and_thinned_clouds() {
    // A wall 3 m away and 3 m high: elevations up to ±26.6°, all 32 rings; 60° of azimuth at 0.2°.
    let wall = range_image(&Body::plate(1.5, 1.5), &Isometry3::translation(3.0, 0.0, 0.0), 0.0, &mut Chance::new(1));
    let points = returns_of(&wall);
    let full = Rings::find(&directions(&points), 0.0).expect("rings");
    assert_eq!(full.elevations_rad.len(), 32);
    let step = 0.2f64.to_radians();
    assert!((full.step_rad / step - 1.0).abs() < 0.02, "{}", full.step_rad);
    let mut chance = Chance::new(7);
    for (fold, median) in [(3usize, 2.0), (4, 3.0), (7, 5.0)] {
        let left = thinned(points.clone(), points.len() / fold, &mut chance);
        let found = Rings::find(&directions(&left), 0.0).expect("rings");
        // Gaps are geometric: the median is the least m with 1 − (1 − 1/k)^m ≥ ½. For k = 3: 2; 4: 3; 7: 5 steps.
        assert!((found.step_rad / (median * step) - 1.0).abs() < 0.02, "{fold}: {}", found.step_rad / step);
        // So the rate, 0.7/median, is 0.7/2 · 3 = 1.05, 0.7/3 · 4 = 0.93, 0.7/5 · 7 = 0.98 of the true one.
        let rate = found.expected(0.0, 1e-9) / found.elevations_rad.iter().filter(|e| e.abs() < 1e-9).count() as f64;
        let true_rate = 2e-9 / (fold as f64 * step);
        assert!((0.92..1.07).contains(&(rate / true_rate)), "{fold}: {}", rate / true_rate);
    }
}

#[test]
fn jitter_of_a_third_of_a_degree_leaves_no_rings() {
    let mut chance = Chance::new(9);
    let jittered = |points: Vec<Point3<f32>>, chance: &mut Chance| -> Vec<Point3<f32>> {
        let turn = |point: Point3<f32>, chance: &mut Chance| {
            let axis = Unit::new_normalize(point.coords.cross(&chance.direction().cast()));
            Rotation3::from_axis_angle(&axis, (0.3f64.to_radians() * chance.normal()) as f32) * point
        };
        points.into_iter().map(|point| turn(point, chance)).collect()
    };
    let body = Body::satellite();
    for seed in 0..5 {
        let mut chance_of_place = Chance::new(seed);
        let lidar = lidar_at(&chance_of_place.direction(), 4.0, 1.0);
        let points = thinned(returns_of(&range_image(&body, &lidar, 1.0, &mut chance_of_place)), 358, &mut chance);
        let with = built(&bare(SensorKind::Lidar, points.clone()));
        let rings = with.rings().expect("rings").elevations_rad.len();
        // A body of 1.3 m at 4 m is 19° high at most: of the 32 rings those between −9.5° and 9.5°, 26; panels aside fewer.
        assert!((8..=30).contains(&rings), "{rings}");
        assert!(built(&bare(SensorKind::Lidar, jittered(points, &mut chance))).rings().is_none());
    }
}

#[test]
fn poor_clouds_give_neither_panic_nor_nonsense() {
    let line = |n: usize| (0..n).map(|k| Point3::from(direction(k as f32 * 0.01, 0.0) * 3.0)).collect::<Vec<_>>();
    let upright = (0..20).map(|k| Point3::from(direction(0.0, k as f32 * 0.02) * 3.0)).collect();
    let round = (0..90).map(|k| Point3::from(direction(k as f32 * 0.07, 0.0) * 3.0)).collect();
    let mut clouds: Vec<Vec<Point3<f32>>> = vec![line(1), line(2), line(30), upright, round];
    clouds.push(vec![Point3::origin(); 5]);
    clouds.push(vec![Point3::new(f32::NAN, 1.0, 1.0), Point3::new(1e30, 0.0, 0.0), Point3::new(1.0, 0.0, 1.0)]);
    for points in clouds {
        for sensor in [SensorKind::Kinect, SensorKind::Lidar] {
            let Some(sights) = FreeSpace::build(&bare(sensor, points.clone()), 0.02) else { continue };
            for place in [[0.0; 3], [3.0, 0.0, 0.0], [0.0, 0.0, 3.0], [f32::NAN, 0.0, 0.0], [1e38; 3], [-3.0, 0.0, 0.0]]
            {
                let seen = sights.look(&place);
                assert!([seen.front, seen.hidden, seen.sky].iter().all(|c| (0.0..=1.0).contains(c)), "{seen:?}");
            }
        }
    }
}

proptest! {
    #[test]
    fn shares_are_shares_and_exclude_each_other(
        x in -4.0..4.0f32, y in -4.0..4.0f32, z in -4.0..4.0f32,
    ) {
        thread_local! {
            static ALL: [(&'static str, FreeSpace, [[f32; 3]; 4]); 4] = sensors();
        }
        ALL.with(|all| {
            for (name, sights, _) in all {
                let seen = sights.look(&[x, y, z]);
                let shares = [seen.front, seen.hidden, seen.sky];
                assert!(shares.iter().all(|share| (0.0..=1.0).contains(share)), "{name} {seen:?}");
                assert!(shares.iter().filter(|share| **share > 0.0).count() <= 1, "{name} {seen:?}");
                assert!(seen.known || shares == [0.0; 3], "{name} {seen:?}");
            }
        });
    }
}
