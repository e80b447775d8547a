use super::*;
use tumbled_model::se3::angle_between;

fn spec(sights_deg: [f64; 2], organised: bool) -> PairSpec {
    PairSpec {
        target: TargetKind::BoxBus,
        points: PointCounts { kinect: 1239, lidar: 126 },
        sights_deg,
        overlap: [0.0, 1.0],
        attitudes: Attitudes::Random,
        organised,
    }
}

fn stand() -> Stand {
    Stand::new(TargetKind::BoxBus).expect("a stand")
}

/// Distance of a place in the target's frame from its surface, m.
fn off_surface(stand: &Stand, place: &Point3<f64>) -> f64 {
    // Rays along the axes through the place: the nearest hit on either side of it.
    let world = stand.world.at(RigNs(0));
    let ways = [Vector3::x(), Vector3::y(), Vector3::z()].into_iter().flat_map(|way| [way, -way]);
    let hits = ways.filter_map(|way| {
        let ray = Ray { origin: place - way * 0.1, direction: way };
        world.cast(&ray, 0.0).map(|hit| (hit.range_m - 0.1).abs())
    });
    hits.fold(f64::INFINITY, f64::min)
}

#[test]
fn a_pair_has_the_points_and_sights_it_was_asked_for() {
    let stand = stand();
    for index in 0..4 {
        let pair = stand.pair(&spec([20.0, 30.0], false), 1, index).expect("a pair");
        assert_eq!((pair.moving.points.len(), pair.reference.points.len()), (1239, 126));
        let sights = pair.sights_deg.expect("known");
        // The target stands up to 14 cm beside the sight's middle: at 1.3 and 1.8 m that is 6.2° and 4.5°.
        assert!((20.0 - 10.7..=30.0 + 10.7).contains(&sights), "{sights}");
        assert!((0.0..=1.0).contains(&pair.overlap.expect("known")));
        assert!(matches!((&pair.moving.view, &pair.reference.view), (View::Bare, View::Bare)));
    }
}

#[test]
fn the_truth_lays_both_clouds_on_the_target() {
    let stand = stand();
    let pair = stand.pair(&spec([5.0, 80.0], false), 2, 0).expect("a pair");
    let (_, t_kinect_body) = pair.body.expect("simulated");
    let t_body_lidar = t_kinect_body.inverse() * pair.truth.expect("simulated").inverse();
    let near = |points: &[Point3<f32>], to_body: Isometry3<f64>, within_m: f64| {
        let off = |point: &&Point3<f32>| off_surface(&stand, &(to_body * point.cast::<f64>())) < within_m;
        points.iter().filter(off).count() as f64 / points.len() as f64
    };
    // Ranges scatter by 1.5 cm and beams by 1 cm: 5 cm is 2.8 σ. Depths at 3 m by 1.3 cm, and a warp of 5 mm. Edges stray.
    let (kinect, lidar) =
        (near(&pair.moving.points, t_kinect_body.inverse(), 0.04), near(&pair.reference.points, t_body_lidar, 0.05));
    assert!(kinect > 0.9 && lidar > 0.9, "{kinect} {lidar}");
}

#[test]
fn overlap_is_all_where_the_sights_are_one_and_little_where_they_are_opposite() {
    let stand = stand();
    let mean = |sights| {
        let overlap = |index| stand.pair(&spec(sights, false), 3, index).expect("a pair").overlap.expect("known");
        (0..6).map(overlap).sum::<f64>() / 6.0
    };
    let (beside, opposite) = (mean([0.0, 4.0]), mean([170.0, 180.0]));
    assert!(beside > 0.75 && opposite < 0.2, "{beside} {opposite}");
}

#[test]
fn a_seed_and_a_number_are_always_the_same_pair() {
    let (one, other) = (stand(), stand());
    let spec = spec([5.0, 40.0], true);
    // The other stand has made none before.
    assert!(one.pair(&spec, 5, 0).is_ok());
    let (a, b) = (one.pair(&spec, 5, 1).expect("a pair"), other.pair(&spec, 5, 1).expect("a pair"));
    assert_eq!((&a.moving.points, &a.reference.points, a.truth), (&b.moving.points, &b.reference.points, b.truth));
    let c = one.pair(&spec, 6, 1).expect("a pair");
    assert_ne!(a.truth, c.truth);
}

#[test]
fn overlap_is_drawn_as_asked_for_or_refused() {
    let stand = stand();
    let wanted = PairSpec { overlap: [0.3, 0.5], ..spec([20.0, 80.0], false) };
    for index in 0..4 {
        let overlap = stand.pair(&wanted, 7, index).expect("a pair").overlap.expect("known");
        assert!((0.3..=0.5).contains(&overlap), "{overlap}");
    }
    // More returns than a VLP-32C has on a target of 1.3 m.
    let points = PointCounts { kinect: 1239, lidar: 5000 };
    let error = stand.pair(&PairSpec { points, ..wanted }, 7, 0).expect_err("none").to_string();
    assert!(error.contains("1239/5000") && error.contains("widen"), "{error}");
}

#[test]
fn the_published_attitudes_are_48_of_which_the_first_of_each_axis_are_one() {
    let turn = |index| view(index).angle().to_degrees();
    assert_eq!([turn(0), turn(16), turn(32)], [0.0; 3]);
    assert!((turn(1) - 22.5).abs() < 1e-9 && (turn(17) - 22.5).abs() < 1e-9 && (turn(8) - 180.0).abs() < 1e-9);
    assert!(angle_between(&view(1), &view(17)) > 0.3 && view(3) == view(51));
}

/// Where the LiDAR has points its range image has their ranges, elsewhere misses; the depth image has the Kinect's points.
#[test]
fn organised_views_hold_the_points_and_the_misses() {
    let stand = stand();
    let pair = stand.pair(&spec([5.0, 40.0], true), 9, 0).expect("a pair");
    let View::Ranges(ranges) = &pair.reference.view else { panic!("no range image") };
    let columns = ranges.range_m.len() / ranges.elevations_rad.len();
    assert!(ranges.elevations_rad.is_sorted() && columns == 301, "{columns}");
    let misses = ranges.range_m.iter().filter(|range| range.is_infinite()).count();
    assert!(misses > ranges.range_m.len() / 2 && misses < ranges.range_m.len());
    for point in &pair.reference.points {
        let range = point.coords.norm();
        let elevation = (point.z / range).asin();
        let off = |ring: &usize| (ranges.elevations_rad[*ring] - elevation).abs();
        let ring = (0..ranges.elevations_rad.len()).min_by(|a, b| off(a).total_cmp(&off(b))).expect("rings");
        // A ring's neighbours are 0.33° away; its own elevation moves by the beam's height of 1 cm with the distance.
        assert!(off(&ring).to_degrees() < 0.1, "{}", off(&ring).to_degrees());
        let column = ((point.y.atan2(point.x) - ranges.first_azimuth_rad) / ranges.azimuth_step_rad).round() as usize;
        let near = (column.saturating_sub(1)..=column + 1).filter_map(|c| ranges.range_m.get(ring * columns + c));
        let nearest = near.map(|r| (r - range).abs()).fold(f32::INFINITY, f32::min);
        assert!(nearest < 0.05, "{nearest}");
    }
    let View::Depth(depth) = &pair.moving.view else { panic!("no depth image") };
    assert_eq!((depth.width, depth.height, depth.z_m.len()), (640, 480, 307_200));
    let seen = depth.z_m.iter().filter(|z| **z > 0.0).count();
    assert!((1239..150_000).contains(&seen), "{seen}");
}
