//! Boards: what is found of them, and what is said of sets that fix nothing.

use nalgebra::Isometry3;
use tumbled_calib::board::{BoardSize, calibrate};
use tumbled_calib::fit::difference;
use tumbled_calib::{Extrinsic, Status};

use crate::made::{Making, Thing, boards, drawing, truth, views};

fn board() -> BoardSize {
    BoardSize::new(0.6, 0.8)
}

/// How far a result is off: degrees, mm.
fn off(found: &Extrinsic) -> (f64, f64) {
    let fit = found.fit().unwrap_or_else(|| panic!("{:?}", found.gates));
    let difference = difference(&fit.t_lidar_camera, &truth(), 0.0);
    (difference.fixed_rows::<3>(0).norm().to_degrees(), 1e3 * difference.fixed_rows::<3>(3).norm())
}

fn said(found: &Extrinsic) -> String {
    found.gates.iter().filter_map(|gate| gate.remedy.clone()).collect::<Vec<_>>().join(" | ")
}

fn verdict(found: &Extrinsic) -> Status {
    Status::worst(found.gates.iter().map(|gate| gate.status))
}

#[test]
fn twelve_tilted_boards_give_the_place_of_the_camera() {
    let found = calibrate(&views(&boards(12, 40.0), &Making::default()), &board(), &drawing());
    let (degrees, mm) = off(&found);
    assert!(degrees < 0.15 && mm < 4.0, "{degrees} {mm}");
    assert!(verdict(&found) < Status::Fail, "{}", said(&found));
    let sigma = found.fit().expect("a result").sigma();
    assert!(sigma[..6].iter().all(|sigma| *sigma > 0.0), "{sigma:?}");
}

#[test]
fn a_depth_scale_of_one_per_cent_is_found_and_does_not_move_the_camera() {
    let making = Making { depth_scale: 1.01, ..Making::default() };
    let found = calibrate(&views(&boards(14, 40.0), &making), &board(), &drawing());
    let scale = found.fit().and_then(|fit| fit.depth_scale).expect("solved for");
    assert!((scale - 1.0 / 1.01).abs() < 1e-3, "{scale}");
    let (degrees, mm) = off(&found);
    assert!(degrees < 0.15 && mm < 6.0, "{degrees} {mm}");
}

#[test]
fn boards_that_face_one_way_are_refused_and_the_missing_tilt_is_named() {
    let found = calibrate(&views(&boards(6, 0.5), &Making::default()), &board(), &drawing());
    assert_eq!((verdict(&found), found.fit().is_some()), (Status::Fail, false));
    assert!(said(&found).contains("face nearly the same way"), "{}", said(&found));
}

#[test]
fn two_poses_are_refused() {
    let found = calibrate(&views(&boards(2, 40.0), &Making::default()), &board(), &drawing());
    assert_eq!((verdict(&found), found.fit().is_some()), (Status::Fail, false));
    assert!(said(&found).contains("2 of 2 poses are usable, at least 3 are needed"), "{}", said(&found));
}

#[test]
fn another_boards_size_is_refused_and_what_was_seen_is_told() {
    let found = calibrate(&views(&boards(4, 30.0), &Making::default()), &BoardSize::new(1.2, 0.9), &drawing());
    assert_eq!(verdict(&found), Status::Fail);
    let said = said(&found);
    assert!(
        said.contains("nothing flat of 1.20 x 0.90 m") && said.contains("the nearest in size is 0.79 x 0.59 m"),
        "{said}"
    );
}

#[test]
fn a_tenth_of_points_anywhere_changes_little() {
    let making = Making { outliers: 0.1, ..Making::default() };
    let (degrees, mm) = off(&calibrate(&views(&boards(12, 40.0), &making), &board(), &drawing()));
    assert!(degrees < 0.15 && mm < 4.0, "{degrees} {mm}");
}

#[test]
fn a_pose_in_which_the_board_moved_between_the_sensors_is_left_aside() {
    let mut shown = views(&boards(12, 40.0), &Making::default());
    // The LiDAR saw it 8 cm farther away.
    let mut moved = boards(12, 40.0);
    if let Thing::Board(pose, _) = &mut moved[3] {
        *pose = Isometry3::translation(0.0, 0.0, 0.08) * *pose;
    }
    shown[3].lidar.clone_from(&views(&moved, &Making::default())[3].lidar);
    let found = calibrate(&shown, &board(), &drawing());
    let aside: Vec<usize> =
        found.poses.iter().filter(|pose| pose.left_aside.is_some()).map(|pose| pose.number).collect();
    assert_eq!(aside, [3]);
    let (degrees, mm) = off(&found);
    assert!(degrees < 0.15 && mm < 4.0, "{degrees} {mm}");
}
