use super::*;
use crate::motion::Still;
use crate::shape::Triangle;
use nalgebra::UnitQuaternion;

/// A square of side 2 m, its middle at the origin, its outer side toward +z.
fn square(material: Material) -> Arc<Mesh> {
    let vertices = vec![
        Point3::new(-1.0, -1.0, 0.0),
        Point3::new(1.0, -1.0, 0.0),
        Point3::new(1.0, 1.0, 0.0),
        Point3::new(-1.0, 1.0, 0.0),
    ];
    let triangles = [[0, 1, 2], [0, 2, 3]].map(|corners| Triangle { corners, material }).to_vec();
    Arc::new(Mesh { vertices, triangles })
}

fn still(role: Role, mesh: Arc<Mesh>, x: f64, y: f64, z: f64) -> Body {
    Body { role, mesh, motion: Arc::new(Still(Isometry3::translation(x, y, z))) }
}

fn up_from(x: f64, y: f64, z: f64) -> Ray {
    Ray { origin: Point3::new(x, y, z), direction: Vector3::z() }
}

const T: RigNs = RigNs(0);

#[test]
fn the_nearest_body_is_hit_and_beyond_the_nearest_range_the_next() {
    let target = still(Role::Target, square(Material::Foil), 0.0, 0.0, 2.0);
    let wall = still(Role::Room, square(Material::Dark), 0.5, 0.0, 3.0);
    for bodies in [vec![target.clone(), wall.clone()], vec![wall, target]] {
        let world = World::new(bodies);
        let hit = world.at(T).cast(&up_from(0.0, 0.0, 0.0), 0.0).unwrap();
        // The outer side looks along +z, the ray too: what is seen is the inner side.
        let expected = Hit { range_m: 2.0, normal: -Vector3::z(), material: Material::Foil, role: Role::Target };
        assert_eq!(hit, expected);
        let beyond = world.at(T).cast(&up_from(0.0, 0.0, 0.0), 2.0).unwrap();
        assert_eq!((beyond.range_m, beyond.role), (3.0, Role::Room));
        assert_eq!(world.at(T).cast(&up_from(0.0, 0.0, 0.0), 3.0), None);
        assert_eq!(world.at(T).cast(&up_from(-1.2, 0.0, 0.0), 0.0), None);
    }
}

#[test]
fn the_seam_of_two_triangles_has_no_gap() {
    // Turned so that no coordinate of the diagonal is exact.
    let pose = Isometry3::from_parts(
        nalgebra::Translation3::new(0.1, 0.2, 4.0),
        UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -0.2, 0.7)),
    );
    let body = Body { role: Role::Target, mesh: square(Material::Matt), motion: Arc::new(Still(pose)) };
    let world = World::new(vec![body]);
    for k in -999..1_000 {
        let on_seam = pose * Point3::new(f64::from(k) * 1e-3, f64::from(k) * 1e-3, 0.0);
        let hit = world.at(T).cast(&up_from(on_seam.x, on_seam.y, 0.0), 0.0).unwrap();
        assert!((hit.range_m - on_seam.z).abs() < 1e-12);
    }
}

#[test]
fn a_surface_seen_edge_on_is_not_seen() {
    let world = World::new(vec![still(Role::Target, square(Material::Matt), 0.0, 0.0, 0.0)]);
    let ray = Ray { origin: Point3::new(-3.0, 0.1, 0.0), direction: Vector3::x() };
    assert_eq!(world.at(T).cast(&ray, 0.0), None);
}

#[test]
fn one_ray_at_its_own_time_meets_what_the_snapshot_shows_with_few_bodies_and_many() {
    let mesh = square(Material::Matt);
    for count in [0, 1, 8, 9, 30] {
        let stack = (0..count).map(|n| still(Role::Room, Arc::clone(&mesh), 0.0, 0.0, f64::from(n) + 1.0));
        let world = World::new(stack.collect());
        for nearest in 0..=count {
            let ray = up_from(0.2, -0.3, 0.0);
            let expected = (nearest < count).then(|| f64::from(nearest) + 1.0);
            let snapshot = world.at(T).cast(&ray, f64::from(nearest));
            assert_eq!(snapshot.map(|hit| hit.range_m), expected);
            assert_eq!(world.cast_at(T, &ray, f64::from(nearest)), snapshot);
        }
    }
}

#[test]
fn a_body_between_two_points_hides_them_from_each_other() {
    let world = World::new(vec![still(Role::Target, square(Material::Matt), 0.0, 0.0, 1.0)]);
    let at = |x: f64, z: f64| Point3::new(x, 0.0, z);
    let snapshot = world.at(T);
    assert!(snapshot.occluded(&at(0.0, 0.0), &at(0.0, 2.0), 0.01));
    assert!(snapshot.occluded(&at(0.0, 2.0), &at(0.5, 0.0), 0.01));
    // Past the edge at x = 1: the way from (1.5, 0) to (1.1, 2) is at x = 1.3 there.
    assert!(!snapshot.occluded(&at(1.5, 0.0), &at(1.1, 2.0), 0.01));
    // A point on the surface does not hide itself, one 2 cm behind it is hidden.
    assert!(!snapshot.occluded(&at(0.0, 0.0), &at(0.0, 1.0), 0.01));
    assert!(snapshot.occluded(&at(0.0, 0.0), &at(0.0, 1.02), 0.01));
}

#[test]
fn spheres_follow_their_bodies() {
    let world = World::new(vec![still(Role::Target, square(Material::Matt), 1.0, 2.0, 3.0)]);
    let snapshot = world.at(T);
    let sphere = snapshot.spheres().next().unwrap();
    assert_eq!((sphere.role, sphere.centre), (Role::Target, Point3::new(1.0, 2.0, 3.0)));
    // Half the diagonal of a square of side 2.
    assert!((sphere.radius_m - 2.0_f64.sqrt()).abs() < 1e-6);
}
