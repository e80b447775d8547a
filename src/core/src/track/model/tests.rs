use super::*;
use proptest::prelude::*;

fn observed(x: f64, y: f64, z: f64) -> Observed {
    Observed { place: Point3::new(x, y, z), normal: Vector3::z(), sigma_m: 0.004 }
}

fn model(points: &[Observed]) -> Model {
    let mut model = Model::default();
    insert(&mut model, points);
    model
}

fn insert(model: &mut Model, points: &[Observed]) {
    let noisiest = points.iter().map(|point| point.sigma_m).fold(0.0, f64::max);
    model.insert(points.iter().copied(), noisiest, CAMERA_SLOPE_RAD, RigNs(model.insertions as i64));
}

#[test]
fn a_point_moves_its_surfel_along_the_normal_by_its_weight() {
    let mut model = model(&[observed(0.0, 0.0, 0.0)]);
    // Twice the σ, a quarter of the weight: 10 mm · ¼ / (1 + ¼) = 2 mm; nothing along the surface.
    insert(&mut model, &[Observed { sigma_m: 0.008, ..observed(0.005, 0.0, 0.010) }]);
    let [place] = model.surfels.positions() else { panic!("{:?}", model.surfels) };
    assert!((place - Point3::new(0.0, 0.0, 0.002)).norm() < 1e-15, "{place}");
    // 1/(4 mm)² + 1/(8 mm)².
    assert!((model.surfels.weights()[0] - (62_500.0 + 15_625.0)).abs() < 1e-6);
    assert_eq!(model.surfels.last_seen(), [RigNs(1)]);
}

#[test]
fn between_11_and_13_mm_a_point_is_dropped_and_beyond_it_makes_a_surfel() {
    for (aside, surfels, weight) in
        [(0.0109, 1, 125_000.0), (0.0111, 1, 62_500.0), (0.0129, 1, 62_500.0), (0.0131, 2, 62_500.0)]
    {
        let mut model = model(&[observed(0.0, 0.0, 0.0)]);
        insert(&mut model, &[observed(aside, 0.0, 0.0)]);
        assert_eq!(model.surfels.len(), surfels, "{aside}");
        assert!((model.surfels.weights()[0] - weight).abs() < 1e-6, "{aside}");
    }
}

#[test]
fn a_point_off_the_gate_makes_a_surfel_and_a_noisy_one_has_a_wider_gate() {
    for (off, sigma_m, surfels) in [(0.017, 0.004, 1), (0.019, 0.004, 2), (0.024, 0.010, 1), (0.026, 0.010, 2)] {
        let mut model = model(&[observed(0.0, 0.0, 0.0)]);
        insert(&mut model, &[Observed { sigma_m, ..observed(0.0, 0.0, off) }]);
        assert_eq!(model.surfels.len(), surfels, "{off} m at {sigma_m} m");
    }
}

#[test]
fn the_two_sides_of_a_thin_panel_are_two_surfels() {
    let front = observed(0.0, 0.0, 0.004);
    let back = Observed { normal: -Vector3::z(), ..observed(0.0, 0.0, -0.004) };
    // In one frame and one after the other; both lie within one voxel of 13 mm but for the facing.
    assert_eq!(model(&[front, back]).surfels.len(), 2);
    let mut model = model(&[front]);
    insert(&mut model, &[back]);
    assert_eq!(model.surfels.len(), 2);
    assert!(model.surfels.weights().iter().all(|weight| (weight - 62_500.0).abs() < 1e-6));
}

#[test]
fn what_lies_beyond_the_reach_or_is_too_much_is_refused_and_counted() {
    let mut model = model(&[observed(MODEL_REACH_M + 0.02, 0.0, 0.0), observed(MODEL_REACH_M - 0.02, 0.0, 0.0)]);
    assert_eq!((model.surfels.len(), model.refused()), (1, 1));
    // A grid of 14 mm in layers 60 mm apart: every point its own surfel, 500 × 500 more than there is room for in 2 layers.
    for layer in 0..3 {
        let points: Vec<_> = (0..250_000 / 2)
            .map(|k| observed(f64::from(k % 500) * 0.0131, f64::from(k / 500) * 0.0131, f64::from(layer) * 0.07))
            .filter(|point| point.place.coords.norm() < MODEL_REACH_M)
            .collect();
        insert(&mut model, &points);
    }
    assert!(model.surfels.len() == MOST_SURFELS && model.refused() > 1, "{} {}", model.surfels.len(), model.refused());
}

#[test]
fn normals_are_made_anew_from_where_the_surfels_lie() {
    // A plane whose first normals are 20° off: after six insertions of the same all are within 2°.
    let tilted = Vector3::new(libm::sin(20f64.to_radians()), 0.0, libm::cos(20f64.to_radians()));
    let grid: Vec<_> = (0..400)
        .map(|k| Observed { normal: tilted, ..observed(f64::from(k % 20) * 0.0135, f64::from(k / 20) * 0.0135, 0.0) })
        .collect();
    let mut model = model(&grid);
    for _ in 0..6 {
        insert(&mut model, &grid);
    }
    assert!(model.surfels.normals().iter().all(|normal| normal.z > libm::cos(2f64.to_radians())));
}

#[test]
fn a_patch_is_as_large_as_its_noise_asks_for() {
    // 16.5 mm of a LiDAR's range: √(2 · 16.5 mm · 13 mm / (√π · 0.026)) = 96 mm; 40 mm: more than the most. 4 mm of a camera's:
    // 34 mm at 0.05 rad. 1 mm: less than the least.
    for (sigma_m, slope_rad, expected_m) in
        [(0.0165, 0.026, 0.0965), (0.040, 0.026, 0.130), (0.004, 0.05, 0.0343), (0.001, 0.05, 0.032)]
    {
        let found = patch_m(1.0 / (sigma_m * sigma_m), slope_rad);
        assert!((found - expected_m).abs() < 1e-4, "{sigma_m} m: {found}");
    }
}

#[test]
fn a_new_surfels_normal_is_made_of_its_patch_at_once() {
    // A plane 0.3 m wide of which every normal was measured 20° off: what is in the middle lies as the plane does.
    let tilted = Vector3::new(libm::sin(20f64.to_radians()), 0.0, libm::cos(20f64.to_radians()));
    let grid: Vec<_> = (0..400)
        .map(|k| Observed { normal: tilted, ..observed(f64::from(k % 20) * 0.0135, f64::from(k / 20) * 0.0135, 0.0) })
        .collect();
    assert!(model(&grid).surfels.normals().iter().all(|normal| normal.z > 0.9999));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn the_same_frames_make_the_same_model_bit_for_bit(
        frames in proptest::collection::vec(
            proptest::collection::vec((-0.2..0.2f64, -0.2..0.2f64, -0.02..0.02f64, any::<bool>()), 0..200), 1..4,
        ),
    ) {
        let grow = || {
            let mut model = Model::default();
            for frame in &frames {
                let points: Vec<_> = frame
                    .iter()
                    .map(|&(x, y, z, back)| {
                        let normal = if back { -Vector3::z() } else { Vector3::z() };
                        Observed { normal, ..observed(x, y, z) }
                    })
                    .collect();
                insert(&mut model, &points);
            }
            model.surfels
        };
        let (first, second) = (grow(), grow());
        prop_assert_eq!(&first, &second);
        // Unit normals, and what was measured is never forgotten.
        prop_assert!(first.normals().iter().all(|normal| (normal.norm() - 1.0).abs() < 1e-9));
        let points: usize = frames.iter().map(Vec::len).sum();
        prop_assert!(first.weights().iter().sum::<f64>() <= 62_500.0 * points as f64 * (1.0 + 1e-9));
    }
}
