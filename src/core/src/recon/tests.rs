//! Bodies of known planes and edges, with noise.

use super::*;
use crate::register::SensorKind;
use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use tumbled_model::RigNs;

fn uniform(rng: &mut ChaCha8Rng) -> f64 {
    f64::from(rng.next_u32()) / 4_294_967_296.0
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    // Twelve uniform numbers have a variance of 1.
    (0..12).map(|_| uniform(rng)).sum::<f64>() - 6.0
}

const SIZE: [f64; 3] = [0.5, 0.4, 0.3];

/// Somewhere, turned by something.
fn placed() -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -0.8, 0.4));
    Isometry3::from_parts(Translation3::new(0.05, -0.1, 0.2), turn)
}

/// Points on a box, in the box's frame, with outward normals: about so many on each side.
fn on_box(rng: &mut ChaCha8Rng, count: usize) -> Vec<(Vector3<f64>, Vector3<f64>)> {
    let mut points = Vec::new();
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            for _ in 0..count {
                let mut place = Vector3::from_fn(|c, _| (uniform(rng) - 0.5) * SIZE[c]);
                place[axis] = sign * 0.5 * SIZE[axis];
                points.push((place, Vector3::from_fn(|c, _| if c == axis { sign } else { 0.0 })));
            }
        }
    }
    points
}

/// Frames of a sensor that goes around: of each the sides it sees, with noise along its sight.
fn frames(kind: SensorKind, count: usize, points: usize, sigma_m: f64, seed: u64) -> Vec<RegisteredFrame> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let at = placed();
    (0..count)
        .map(|number| {
            let angle = core::f64::consts::TAU * number as f64 / count as f64;
            let height = if number % 2 == 0 { 1.2 } else { -1.2 };
            let viewpoint = Point3::new(2.0 * libm::cos(angle), 2.0 * libm::sin(angle), height);
            let mut seen = Vec::new();
            for (place, outward) in on_box(&mut rng, points) {
                let sight = (viewpoint.coords - place).normalize();
                if outward.dot(&sight) < 0.2 {
                    continue;
                }
                let place = place + sight * (sigma_m * normal(&mut rng));
                // As sensors' normals are: some degrees off.
                let tilt = Vector3::from_fn(|_, _| 0.1 * normal(&mut rng));
                seen.push(Sighting {
                    place: at * Point3::from(place),
                    normal: at * (outward + tilt).normalize(),
                    sigma_m,
                });
            }
            RegisteredFrame { kind, t: RigNs(number as i64), viewpoint: at * viewpoint, points: seen }
        })
        .collect()
}

/// The box's twelve edges.
fn box_edges() -> Vec<[Point3<f64>; 2]> {
    let mut edges = Vec::new();
    for axis in 0..3 {
        for signs in [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]] {
            let end = |along: f64| {
                let mut rest = signs.iter();
                let corner =
                    Vector3::from_fn(|c, _| 0.5 * SIZE[c] * if c == axis { along } else { *rest.next().unwrap() });
                placed() * Point3::from(corner)
            };
            edges.push([end(-1.0), end(1.0)]);
        }
    }
    edges
}

#[test]
fn a_boxs_twelve_edges_are_found_at_5_mm_noise() {
    let fused = fuse(&frames(SensorKind::Kinect, 24, 250, 0.005, 3));
    let made = reconstruct(&fused.points, &[], &ReconSettings::default());
    assert_eq!(made.planes.len(), 6);
    let creases: Vec<&Edge> = made.edges.iter().filter(|edge| edge.kind == EdgeKind::Crease).collect();
    assert_eq!((creases.len(), made.edges.len()), (12, 12), "{:#?}", made.edges);
    for [from, to] in box_edges() {
        let off = |edge: &&&Edge| {
            let [a, b] = edge.ends;
            ((a - from).norm() + (b - to).norm()).min((a - to).norm() + (b - from).norm())
        };
        let edge = creases.iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap();
        // The two ends together within twice a centimetre, and either of them within one.
        let ends = edge.ends.map(|end| (end - from).norm().min((end - to).norm()));
        assert!(ends.iter().all(|off| *off < 0.010), "{ends:?}");
        let angle = libm::acos((to - from).normalize().dot(&edge.direction()).abs().min(1.0)).to_degrees();
        assert!(angle < 0.5, "{angle}");
        assert!((edge.angle_rad.unwrap().to_degrees() - 90.0).abs() < 1.0);
    }
}

#[test]
fn a_planes_stated_uncertainty_holds_its_error() {
    let fused = fuse(&frames(SensorKind::Kinect, 24, 250, 0.005, 5));
    let made = reconstruct(&fused.points, &[], &ReconSettings::default());
    for plane in &made.planes {
        let outward = placed().inverse() * plane.normal;
        let axis = outward.iamax();
        let truth = placed() * Point3::from(outward.map(f64::round).component_mul(&Vector3::from(SIZE)) * 0.5);
        let height = plane.normal.dot(&(truth.coords)) - plane.height_m;
        // The truth's middle is some millimetres from the points': a tilt of 3 σ there adds less than a millimetre.
        assert!(height.abs() < 4.0 * plane.height_sigma_m + 0.001, "{height} {}", plane.height_sigma_m);
        let tilt = libm::acos(outward[axis].abs().min(1.0));
        let stated = libm::hypot(plane.tilt_sigma_rad[0], plane.tilt_sigma_rad[1]);
        assert!(tilt < 4.0 * stated, "{tilt} {stated}");
        let area: f64 = SIZE.iter().product::<f64>() / SIZE[axis];
        assert!((plane.area_m2 / area - 1.0).abs() < 0.15, "{} of {area}", plane.area_m2);
    }
}

#[test]
fn a_lidars_points_are_put_on_the_planes_to_a_quarter_of_their_distance() {
    // A camera at 7 mm and a LiDAR at 18 mm a point; σ_s = 2 mm leaves 4/(4 + 324) of a LiDAR's distance.
    let mut all = frames(SensorKind::Kinect, 24, 250, 0.007, 7);
    let first_lidar = all.len();
    all.extend(frames(SensorKind::Lidar, 24, 40, 0.018, 8));
    let fused = fuse(&all);
    let settings = ReconSettings::default();
    let made = reconstruct(&fused.points, &[], &settings);
    let true_distance = |place: &Point3<f64>| {
        let inside = placed().inverse() * place;
        (0..3).map(|axis| (inside[axis].abs() - 0.5 * SIZE[axis]).abs()).fold(f64::INFINITY, f64::min)
    };
    let (mut before, mut after, mut count) = (0.0, 0.0, 0);
    for point in all[first_lidar..].iter().flat_map(|frame| &frame.points) {
        let Some((_, flat)) = made.flatten(&point.place, &point.normal, point.sigma_m, &settings) else { continue };
        let [measured, put] = [&point.place, &flat].map(true_distance);
        before += measured * measured;
        after += put * put;
        count += 1;
    }
    assert!(count > 1500, "{count}");
    let ratio = (before / after).sqrt();
    assert!(ratio > 4.0, "{ratio}");
    // And the fused points lie three times as close to their planes.
    let thick = made.thickness_m(&fused.points).unwrap();
    let thin = made.thickness_m(&made.points).unwrap();
    assert!(thick > 3.0 * thin, "{thick} {thin}");
}

#[test]
fn what_is_no_plane_stays_as_it_was_measured() {
    // A ball of 15 cm: a cap within 1 σ of a plane turns its normals by more than a plane's do.
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let points: Vec<FusedPoint> = (0..4000)
        .map(|_| {
            let out = Vector3::from_fn(|_, _| normal(&mut rng)).normalize();
            let place = Point3::from(out * (0.15 + 0.002 * normal(&mut rng)));
            FusedPoint {
                place,
                normal: out,
                sigma_m: 0.002,
                kinect: 9,
                lidar: 0,
                views_rad: 1.0,
                beside_cameras: false,
            }
        })
        .collect();
    let made = reconstruct(&points, &[], &ReconSettings::default());
    assert_eq!((made.planes.len(), made.edges.len()), (0, 0));
    assert_eq!(made.points, points);
}

#[test]
fn sides_of_a_thin_panel_are_two_planes() {
    let mut rng = ChaCha8Rng::seed_from_u64(13);
    let side = |out: f64, rng: &mut ChaCha8Rng| -> Vec<FusedPoint> {
        (0..2000)
            .map(|_| {
                let place = Point3::new(uniform(rng) * 0.6, uniform(rng) * 0.3, out * 0.0075 + 0.003 * normal(rng));
                FusedPoint {
                    place,
                    normal: Vector3::z() * out,
                    sigma_m: 0.003,
                    kinect: 9,
                    lidar: 0,
                    views_rad: 1.0,
                    beside_cameras: false,
                }
            })
            .collect()
    };
    let points = [side(1.0, &mut rng), side(-1.0, &mut rng)].concat();
    // Frames of it, each with points of its own.
    let frames: Vec<RegisteredFrame> = (0..24)
        .map(|number| {
            let seen = [side(1.0, &mut rng), side(-1.0, &mut rng)].concat();
            let seen = seen.iter().map(|FusedPoint { place, normal, sigma_m, .. }| Sighting {
                place: *place,
                normal: *normal,
                sigma_m: *sigma_m,
            });
            let viewpoint = Point3::new(0.3, 0.15, 2.0);
            RegisteredFrame { kind: SensorKind::Kinect, t: RigNs(number), viewpoint, points: seen.collect() }
        })
        .collect();
    let made = reconstruct(&points, &frames, &ReconSettings::default());
    assert_eq!(made.planes.len(), 2);
    // The longer sides run along x, to a quarter of a degree and within what is stated.
    for edge in made.edges.iter().filter(|edge| edge.length_m() > 0.45) {
        let off = libm::acos(edge.direction().x.abs().min(1.0));
        assert!(off < 0.004_4 && off < 4.0 * edge.direction_sigma_rad, "{edge:?}");
    }
    assert!(made.planes[0].normal.dot(&made.planes[1].normal) < -0.999);
    assert!(made.planes.iter().all(|plane| (plane.height_m - 0.0075).abs() < 0.001));
    // Four boundaries, each of both sides: 15 mm apart they are one edge. Points are 9.5 mm apart, so that corners are known to
    // some two of them.
    let lengths: Vec<f64> = made.edges.iter().map(Edge::length_m).collect();
    assert_eq!(lengths.len(), 4, "{lengths:?}");
    assert!(made.edges.iter().all(|edge| edge.kind == EdgeKind::Boundary));
    assert!(lengths[..2].iter().all(|length| (length - 0.6).abs() < 0.035), "{lengths:?}");
    assert!(lengths[2..].iter().all(|length| (length - 0.3).abs() < 0.035), "{lengths:?}");
}

#[test]
fn no_points_and_nonsense_have_no_planes() {
    let settings = ReconSettings::default();
    let nothing = reconstruct(&[], &[], &settings);
    assert_eq!(nothing, Reconstruction { spacing_m: nothing.spacing_m, ..Reconstruction::default() });
    let nonsense = FusedPoint {
        place: Point3::new(f64::NAN, 0.0, f64::INFINITY),
        normal: Vector3::z(),
        sigma_m: 0.0,
        kinect: 1,
        lidar: 0,
        views_rad: 0.0,
        beside_cameras: false,
    };
    assert!(reconstruct(&vec![nonsense; 100], &[], &settings).planes.is_empty());
}
