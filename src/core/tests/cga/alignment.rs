//! The closed form against an alignment by singular values, against its own 8×8 form, and at its limits.

use crate::arbitrary::{direction, motion, point};
use nalgebra::{Isometry3, Matrix3, Point3, SMatrix, SVector, Vector3};
use proptest::prelude::*;
use tumbled_core::cga::{
    Alignment, AlignmentError, ConformalPoint, DirectionPair, Plane, PlanePair, PointPair, Sphere, align,
    align_with_planes,
};
use tumbled_model::se3::angle_between;

/// Points that span space: four corners and some others.
fn pairs(motion: Isometry3<f64>, points: &[Point3<f64>], noise: &[Point3<f64>], scale: f64) -> Vec<PointPair> {
    let corners =
        [Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(0.0, 1.2, 0.0), Point3::new(0.0, 0.0, 1.5)];
    let all = corners.iter().chain(points);
    let noises = noise.iter().map(|noise| noise.coords * scale).chain(core::iter::repeat(Vector3::zeros()));
    let weights = (0..).map(|n| 0.2 + f64::from(n * 7 % 5));
    all.zip(noises)
        .zip(weights)
        .map(|((point, noise), weight)| PointPair { point: *point, center: motion * point + noise, weight })
        .collect()
}

fn cost(motion: &Isometry3<f64>, pairs: &[PointPair]) -> f64 {
    pairs.iter().map(|pair| pair.weight * (motion * pair.point - pair.center).norm_squared()).sum()
}

/// The weighted alignment by singular values of the cross covariance (Kabsch, Umeyama).
fn kabsch(pairs: &[PointPair]) -> Isometry3<f64> {
    let total: f64 = pairs.iter().map(|pair| pair.weight).sum();
    let from = pairs.iter().map(|pair| pair.point.coords * pair.weight).sum::<Vector3<f64>>() / total;
    let to = pairs.iter().map(|pair| pair.center.coords * pair.weight).sum::<Vector3<f64>>() / total;
    let cross: Matrix3<f64> =
        pairs.iter().map(|p| (p.center.coords - to) * (p.point.coords - from).transpose() * p.weight).sum();
    let svd = cross.svd(true, true);
    let (u, v_t) = (svd.u.expect("asked for"), svd.v_t.expect("asked for"));
    let handed = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant().signum()));
    let rotation = nalgebra::Rotation3::from_matrix_unchecked(u * handed * v_t);
    Isometry3::from_parts((to - rotation * from).into(), nalgebra::UnitQuaternion::from_rotation_matrix(&rotation))
}

fn distance(a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    angle_between(&a.rotation, &b.rotation).max((a.translation.vector - b.translation.vector).norm())
}

proptest! {
    #[test]
    fn it_is_the_alignment_by_singular_values(
        motion in motion(), points in prop::collection::vec(point(), 0..26), noise in prop::collection::vec(point(), 30),
    ) {
        // Noise of ±2.5 cm, half a metre to several metres of points: the optimum is sharp.
        let pairs = pairs(motion, &points, &noise, 0.005);
        let found = align(&pairs, &[]).expect("four corners");
        prop_assert!(distance(&found.motor.isometry(), &kabsch(&pairs)) < 1e-10);
        prop_assert!((found.cost - cost(&found.motor.isometry(), &pairs)).abs() < 1e-10);
        prop_assert!(found.motor.rotor().w >= 0.0);
    }

    #[test]
    fn the_least_eigenvalue_is_what_the_inner_products_lose(
        motion in motion(), points in prop::collection::vec(point(), 4), noise in prop::collection::vec(point(), 8), r in 0.01..0.5f64,
    ) {
        // Σ w P'·S = ½(Σ w r² − λ).
        let pairs = pairs(motion, &points, &noise, 0.01);
        let found = align(&pairs, &[]).expect("four corners");
        let products: f64 = pairs.iter().map(|pair| {
            let (moved, sphere) = (found.motor.point(&pair.point), Sphere::new(&pair.center, r * r));
            pair.weight * ConformalPoint::new(&moved).vector().dot(sphere.vector())
        }).sum();
        let total: f64 = pairs.iter().map(|pair| pair.weight).sum();
        prop_assert!((products - 0.5 * (total * r * r - found.cost)).abs() < 1e-10);
    }

    #[test]
    fn it_is_the_minimum_of_the_eight_by_eight_form(
        motion in motion(), points in prop::collection::vec(point(), 4), noise in prop::collection::vec(point(), 8),
    ) {
        let pairs = pairs(motion, &points, &noise, 0.01);
        let found = align(&pairs, &[]).expect("four corners");
        let form = eight(&pairs);
        let m = stacked(&found);
        prop_assert!(((m.transpose() * form * m).x - found.cost).abs() < 1e-9);
        // The derivative by d, 2ΣwA q + 4W d, is 0: d is the best for this q.
        let slope = form * m;
        prop_assert!(slope.fixed_rows::<4>(4).norm() < 1e-9, "{slope}");
        // And by q it is λ q: nothing to gain on the unit sphere.
        let rest = slope.fixed_rows::<4>(0) - m.fixed_rows::<4>(0) * found.cost;
        prop_assert!(rest.norm() < 1e-8, "{rest}");
    }

    #[test]
    fn moving_either_side_moves_the_answer(
        motion in motion(), a in motion(), b in motion(), noise in prop::collection::vec(point(), 8),
    ) {
        let pairs = pairs(motion, &[], &noise, 0.01);
        let moved: Vec<_> = pairs.iter().map(|pair| PointPair { point: b * pair.point, center: a * pair.center, ..*pair }).collect();
        let (here, there) = (align(&pairs, &[]).expect("corners"), align(&moved, &[]).expect("corners"));
        prop_assert!(distance(&there.motor.isometry(), &(a * here.motor.isometry() * b.inverse())) < 1e-9);
    }

    #[test]
    fn a_line_of_points_becomes_unique_with_one_direction(motion in motion(), n in direction(), place in point()) {
        prop_assume!(n.x.abs() < 0.9);
        let line = |s: f64| Point3::from(place.coords + Vector3::x() * s);
        let pairs: Vec<_> = [0.0, 0.4, 1.0].map(|s| PointPair { point: line(s), center: motion * line(s), weight: 1.0 }).into();
        let axis = motion * Vector3::x();
        match align(&pairs, &[]) {
            Err(AlignmentError::Rotation { axis: found, separation }) => {
                prop_assert!(found.dot(&axis).abs() > 1.0 - 1e-6, "{found} {axis}");
                prop_assert!(separation < 1e-6);
            }
            other => prop_assert!(false, "{other:?}"),
        }
        let helper = DirectionPair { direction: n.into_inner(), target: motion * n.into_inner(), weight: 0.1 };
        let found = align(&pairs, &[helper]).expect("held");
        prop_assert!(distance(&found.motor.isometry(), &motion) < 1e-8);
        prop_assert!(found.cost < 1e-12);
    }

    #[test]
    fn three_planes_and_their_normals_fix_everything(motion in motion(), p in point(), q in point(), r in point()) {
        let normals = [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()];
        let directions = normals.map(|n| DirectionPair { direction: n.into_inner(), target: motion * n.into_inner(), weight: 1.0 });
        let planes: Vec<_> = normals.iter().zip([p, q, r]).map(|(n, point)| {
            let target = nalgebra::Unit::new_unchecked(motion * n.into_inner());
            let plane = Plane::new(&target, target.dot(&(motion * point).coords));
            PlanePair { point, plane, weight: 2.0 }
        }).collect();
        let found = align_with_planes(&[], &directions, &planes).expect("three planes");
        prop_assert!(distance(&found.motor.isometry(), &motion) < 1e-10);
        // Two of them leave the third's normal open.
        match align_with_planes(&[], &directions, &planes[..2]) {
            Err(AlignmentError::Translation { direction }) => prop_assert!(direction.dot(&(motion * Vector3::z())).abs() > 1.0 - 1e-9),
            other => prop_assert!(false, "{other:?}"),
        }
    }
}

/// `[q;d]ᵀ [[ΣwAᵀA, 2ΣwAᵀ], [2ΣwA, 4WI]] [q;d]`, A = 𝑅(p) − 𝐿(c), its columns found by multiplying quaternions.
fn eight(pairs: &[PointPair]) -> SMatrix<f64, 8, 8> {
    let mut form = SMatrix::<f64, 8, 8>::zeros();
    for pair in pairs {
        let (p, c) = (pure(&pair.point), pure(&pair.center));
        let mut a = nalgebra::Matrix4::zeros();
        for column in 0..4 {
            let mut unit = [0.0; 4];
            unit[column] = 1.0;
            let y = nalgebra::Quaternion::new(unit[0], unit[1], unit[2], unit[3]);
            let z = y * p - c * y;
            a.set_column(column, &nalgebra::Vector4::new(z.w, z.i, z.j, z.k));
        }
        let mut add = |row, column, block: nalgebra::Matrix4<f64>| {
            let mut view = form.fixed_view_mut::<4, 4>(row, column);
            view += block * pair.weight;
        };
        add(0, 0, a.transpose() * a);
        add(0, 4, a.transpose() * 2.0);
        add(4, 0, a * 2.0);
        add(4, 4, nalgebra::Matrix4::identity() * 4.0);
    }
    form
}

fn pure(point: &Point3<f64>) -> nalgebra::Quaternion<f64> {
    nalgebra::Quaternion::from_imag(point.coords)
}

fn stacked(found: &Alignment) -> SVector<f64, 8> {
    let (q, d) = (found.motor.rotor(), found.motor.dual());
    SVector::from([q.w, q.i, q.j, q.k, d.w, d.i, d.j, d.k])
}

#[test]
fn two_hundred_motors_come_back_a_quarter_of_them_exact_half_turns() {
    use proptest::strategy::ValueTree;
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let draw =
        |strategy: &BoxedStrategy<Vector3<f64>>, runner: &mut _| strategy.new_tree(runner).expect("a draw").current();
    let ways = direction().prop_map(|d| d.into_inner()).boxed();
    let places = point().prop_map(|p| p.coords).boxed();
    for case in 0..200 {
        let (axis, place) = (draw(&ways, &mut runner), draw(&places, &mut runner));
        let angle = if case % 4 == 0 { core::f64::consts::PI } else { 0.0157 * f64::from(case) };
        let rotation = tumbled_model::se3::exp_rotation(&(axis * angle));
        let motion = Isometry3::from_parts(place.into(), rotation);
        let points: Vec<_> = (0..3 + case % 20).map(|_| Point3::from(draw(&places, &mut runner))).collect();
        let pairs: Vec<_> = points.iter().map(|p| PointPair { point: *p, center: motion * p, weight: 1.0 }).collect();
        let found = align(&pairs, &[]).expect("points anywhere span space");
        assert!(distance(&found.motor.isometry(), &motion) < 1e-10, "{case}: {found:?}");
        // λ comes from sums of squares up to 25 · 75 m² · 20 points.
        assert!(found.cost < 1e-10, "{case}: {}", found.cost);
        let first = [found.motor.rotor().w, found.motor.rotor().i, found.motor.rotor().j, found.motor.rotor().k];
        assert!(first.into_iter().find(|number| *number != 0.0).expect("unit") > 0.0);
    }
}

#[test]
fn mirrored_points_are_turned_never_mirrored() {
    let corners =
        [Point3::new(1.0, 0.0, 0.0), Point3::new(0.0, 2.0, 0.0), Point3::new(0.0, 0.0, 3.0), Point3::origin()];
    let pairs = corners.map(|p| PointPair { point: p, center: Point3::new(p.x, p.y, -p.z), weight: 1.0 });
    let found = align(&pairs, &[]).expect("a best rotation");
    assert!(found.motor.rotation().to_rotation_matrix().matrix().determinant() > 0.999_999);
    assert!(found.cost > 1.0);
}

#[test]
fn what_cannot_be_aligned_is_an_error() {
    let pair = |x: f64, weight| PointPair { point: Point3::new(x, 0.0, 0.0), center: Point3::new(0.0, x, 0.0), weight };
    assert_eq!(align(&[], &[]), Err(AlignmentError::Empty));
    assert_eq!(align(&[pair(1.0, 0.0), pair(2.0, 0.0)], &[]), Err(AlignmentError::Empty));
    assert_eq!(align(&[pair(f64::NAN, 1.0)], &[]), Err(AlignmentError::NotFinite));
    assert_eq!(align(&[pair(1.0, -1.0)], &[]), Err(AlignmentError::NotFinite));
    assert!(matches!(align(&[pair(1.0, 1.0)], &[]), Err(AlignmentError::Rotation { .. })));
    assert!(matches!(align(&[pair(1.0, 1.0); 9], &[]), Err(AlignmentError::Rotation { .. })));
    assert!(matches!(align(&[pair(1.0, 1.0), pair(2.0, 1.0)], &[]), Err(AlignmentError::Rotation { .. })));
    let directions = [Vector3::x(), Vector3::y()].map(|n| DirectionPair { direction: n, target: n, weight: 1.0 });
    assert!(matches!(align(&[], &directions), Err(AlignmentError::Translation { .. })));
}
