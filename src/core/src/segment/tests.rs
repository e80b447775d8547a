//! Whole epochs.

use super::scene::{epoch_of, kinect_epoch, square};
use super::*;
use tumbled_kinect::Intrinsics;
use tumbled_model::Point;

fn region() -> Search {
    Search::Region(RegionOfInterest { center: Point::new(2.0, 0.0, 0.0), radius_m: 1.0 })
}

/// With `in_roi` as the pipeline makes it.
fn in_region(mut epoch: Epoch) -> Epoch {
    let region = Sphere { center: Point3::new(2.0, 0.0, 0.0), radius_m: 1.0 };
    let places: Vec<_> = (0..epoch.rig.len() as u32).filter_map(|number| epoch.rig.place(number)).collect();
    epoch.rig.in_roi = places.into_iter().map(|place| region.holds(place)).collect();
    epoch
}

fn segmented(segmenter: &mut Segmenter, epoch: &Epoch, expected: Option<&Expectation>) -> Segment {
    let mut segment = Segment::default();
    segmenter.segment(epoch, expected, &mut segment);
    let counts = segment.counts;
    let sum = counts.flying + counts.background + counts.planes + counts.others + counts.target;
    assert_eq!((sum, counts.target as usize), (counts.looked_at, segment.indices.len()));
    assert!(segment.indices.is_sorted());
    segment
}

/// A plate of 161 × 161 pixels at 2 m in front of a wall at 4 m, and a floor 0.5 m below the camera.
fn plate_and_floor(u: usize, v: usize) -> f32 {
    let is_plate = (240..=400).contains(&u) && (160..=320).contains(&v);
    // The row of the default camera at which the floor is at a depth: v = 240 + f · 0.5 / z.
    let below = v as f32 - Intrinsics::default().cy as f32;
    let floor = if below > 0.0 { Intrinsics::default().fy as f32 * 0.5 / below } else { f32::INFINITY };
    if is_plate { 2.0 } else { floor.min(4.0) }
}

#[test]
fn a_plate_over_a_floor_in_the_region_is_found_alone() {
    let epoch = in_region(kinect_epoch(plate_and_floor));
    let segment = segmented(&mut Segmenter::new(region()), &epoch, None);
    assert!(!segment.ambiguous);
    // 161² pixels are the plate's; it is not seen to touch the floor 0.2 m below it.
    assert_eq!(segment.counts.target, 161 * 161, "{:?}", segment.counts);
    assert!(segment.indices.iter().all(|number| (epoch.rig.x[*number as usize] - 2.0).abs() < 1e-6));
    assert!(segment.counts.planes > 1_000);
}

#[test]
fn a_learned_room_is_left_out_and_forgotten_on_command() {
    let mut segmenter = Segmenter::new(Search::Nearest);
    let chair = || square([1.5, 0.8, 0.0], 0.2);
    let room = epoch_of(&chair());
    segmenter.learn(&room);
    segmenter.learn(&room);
    // Not learned before it is said.
    assert_eq!(segmented(&mut segmenter, &room, None).counts.target, 41 * 41);
    let learned = segmenter.learned();
    assert_eq!(learned[&SensorId::from("lidar")].epochs, 2);
    let mut both = chair();
    both.extend(square([2.0, 0.0, 0.0], 0.3));
    let both = epoch_of(&both);
    let segment = segmented(&mut segmenter, &both, None);
    assert_eq!((segment.counts.background, segment.counts.target), (41 * 41, 61 * 61));
    assert!(segment.indices.iter().all(|number| *number >= 41 * 41));
    segmenter.forget();
    // The chair is nearer.
    assert_eq!(segmented(&mut segmenter, &both, None).indices.first(), Some(&0));
}

#[test]
fn another_sensors_room_is_not_this_ones() {
    let mut segmenter = Segmenter::new(Search::Everything);
    let cloud = epoch_of(&square([2.0, 0.0, 0.0], 0.3));
    let other = Epoch { sensor: "other".into(), ..cloud.clone() };
    segmenter.learn(&other);
    segmenter.learn(&other);
    segmenter.learned();
    assert_eq!(segmented(&mut segmenter, &cloud, None).counts.background, 0);
    assert_eq!(segmented(&mut segmenter, &other, None).counts.target, 0);
}

#[test]
fn a_tracked_target_is_cut_from_what_touches_it() {
    // A pole through the target, 2 m high; the target reaches 0.45 m.
    let mut places = square([2.0, 0.0, 0.0], 0.3);
    let pole = places.len();
    places.extend((0..200).map(|n| [2.0, 0.0, -1.0 + n as f32 * 0.01]));
    let expected = Expectation { center: Point3::new(2.0, 0.0, 0.0), radius_m: 0.45 };
    let segment = segmented(&mut Segmenter::new(Search::Nearest), &epoch_of(&places), Some(&expected));
    // Of the pole −0.45..=0.45 m: 91 points or the one fewer that rounding leaves.
    let of_pole = segment.indices.iter().filter(|number| **number as usize >= pole).count();
    assert!((90..=91).contains(&of_pole) && segment.indices.len() == pole + of_pole, "{of_pole}");
    // The pole beyond the sphere, up to 0.675 m, is 10 cells: a fifteenth of the target.
    assert!(!segment.ambiguous);
}

#[test]
fn an_empty_region_has_no_target() {
    let nothing = epoch_of(&[]);
    for search in [region(), Search::Nearest, Search::Everything] {
        assert_eq!(segmented(&mut Segmenter::new(search), &nothing, None), Segment::default());
    }
}

#[test]
fn places_that_are_no_places_are_not_looked_at() {
    let mut places = square([2.0, 0.0, 0.0], 0.3);
    places.extend([[f32::NAN, 0.0, 0.0], [2.0, f32::INFINITY, 0.0]]);
    let segment = segmented(&mut Segmenter::new(region()), &epoch_of(&places), None);
    assert_eq!(segment.counts.looked_at, 61 * 61);
}
