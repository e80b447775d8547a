//! Spheres.

use nalgebra::Point3;
use tumbled_calib::fit::difference;
use tumbled_calib::sphere::calibrate;
use tumbled_calib::{Extrinsic, Status};

use crate::made::{Making, Thing, drawing, truth, views};

const RADIUS_M: f64 = 0.25;

fn spheres(count: usize) -> Vec<Thing> {
    let sphere = |n: usize| {
        let z = 1.4 + 1.1 * (n as f64 * 0.618).fract();
        let (x, y) = (0.7 * z * ((n as f64 * 0.414).fract() - 0.5), 0.28 * z * ((n as f64 * 0.73).fract() - 0.5));
        Thing::Sphere(Point3::new(x, y, z), RADIUS_M)
    };
    (0..count).map(sphere).collect()
}

fn said(found: &Extrinsic) -> String {
    found.gates.iter().filter_map(|gate| gate.remedy.clone()).collect::<Vec<_>>().join(" | ")
}

fn verdict(found: &Extrinsic) -> Status {
    Status::worst(found.gates.iter().map(|gate| gate.status))
}

#[test]
fn fifteen_places_give_the_place_of_the_camera() {
    let found = calibrate(&views(&spheres(15), &Making::default()), RADIUS_M, &drawing());
    let fit = found.fit().unwrap_or_else(|| panic!("{}", said(&found)));
    let off = difference(&fit.t_lidar_camera, &truth(), 0.0);
    let (degrees, mm) = (off.fixed_rows::<3>(0).norm().to_degrees(), 1e3 * off.fixed_rows::<3>(3).norm());
    assert!(degrees < 0.1 && mm < 3.0, "{degrees} {mm} {:?}", fit.misfits);
    assert!(verdict(&found) < Status::Fail, "{}", said(&found));
}

#[test]
fn another_radius_is_refused_and_the_one_seen_is_told() {
    let found = calibrate(&views(&spheres(6), &Making::default()), 0.20, &drawing());
    assert_eq!((verdict(&found), found.fit().is_some()), (Status::Fail, false));
    assert!(
        said(&found).contains("radius about 0.25 m") && said(&found).contains("0.200 m was said"),
        "{}",
        said(&found)
    );
}

#[test]
fn places_on_a_line_are_refused_and_named() {
    let line: Vec<Thing> =
        (0..8).map(|n| Thing::Sphere(Point3::new(0.0, 0.0, 1.4 + 0.15 * f64::from(n)), RADIUS_M)).collect();
    let found = calibrate(&views(&line, &Making::default()), RADIUS_M, &drawing());
    assert_eq!(verdict(&found), Status::Fail);
    assert!(said(&found).contains("near one line"), "{}", said(&found));
}
