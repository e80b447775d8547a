use super::super::measure::{area, assert_closed, extents, volume};
use super::*;
use core::f64::consts::PI;

fn close(found: f64, expected: f64, part: f64) -> bool {
    (found - expected).abs() <= part * expected.abs()
}

#[test]
fn a_cuboid_has_its_edges_whatever_its_cells() {
    for cells in [1, 2, 5] {
        let mesh = cuboid(Vector3::new(2.0, 3.0, 4.0), cells, |_, _| Material::Matt);
        assert_closed(&mesh, "cuboid");
        // 2·3·4 and 2·(6 + 12 + 8).
        assert!(close(volume(&mesh), 24.0, 1e-12) && close(area(&mesh), 52.0, 1e-12));
        assert_eq!(extents(&mesh), (Vector3::new(-1.0, -1.5, -2.0), Vector3::new(1.0, 1.5, 2.0)));
        assert_eq!(mesh.triangles.len() as u32, 12 * cells * cells);
    }
}

#[test]
fn a_cuboid_is_painted_by_side_and_place() {
    let paint = |out: Vector3<f64>, at: Point3<f64>| {
        if out == Vector3::x() && at.y > 0.0 && at.z > 0.0 { Material::Foil } else { Material::Matt }
    };
    let mesh = cuboid(Vector3::new(2.0, 3.0, 4.0), 2, paint);
    let foil: Vec<_> = mesh.triangles.iter().filter(|triangle| triangle.material == Material::Foil).collect();
    // One of the four squares of one side: two triangles, at x = 1 with y and z from 0 up.
    assert_eq!(foil.len(), 2);
    for corner in foil.iter().flat_map(|triangle| mesh.corners(triangle).unwrap()) {
        assert!(corner.x == 1.0 && corner.y >= 0.0 && corner.z >= 0.0, "{corner}");
    }
}

#[test]
fn a_cylinder_is_a_prism_over_a_regular_polygon() {
    let mesh = cylinder(0.5, 2.0, 12, Material::Dark);
    assert_closed(&mesh, "cylinder");
    // A regular 12-gon in a circle of radius r: area 12/2 · sin 30° · r² = 3 r², side 2 r sin 15°.
    let side = 2.0 * 0.5 * libm::sin(PI / 12.0);
    assert!(close(volume(&mesh), 3.0 * 0.25 * 2.0, 1e-12));
    assert!(close(area(&mesh), 2.0 * 3.0 * 0.25 + 12.0 * side * 2.0, 1e-12));
}

#[test]
fn a_sphere_lies_between_its_corners_and_its_facets() {
    let mesh = sphere(0.3, 96, Material::Matt);
    assert_closed(&mesh, "sphere");
    assert!(mesh.vertices.iter().all(|v| (v.coords.norm() - 0.3).abs() < 1e-15));
    // Inscribed: chords of α = 3.75° both around and from pole to pole, each of which costs about α²/6 = 0.07 %.
    let ball = 4.0 / 3.0 * PI * 0.027;
    assert!(volume(&mesh) < ball && close(volume(&mesh), ball, 2e-3), "{}", volume(&mesh) / ball);
    let nearest = mesh.triangles.iter().map(|triangle| {
        let [a, b, c] = mesh.corners(triangle).unwrap();
        super::super::normal([a, b, c]).dot(&a.coords)
    });
    let bound = 0.3 * (1.0 - (PI / 96.0) * (PI / 96.0));
    assert!(nearest.fold(f64::INFINITY, f64::min) >= bound);
}

#[test]
fn a_dish_is_a_shell_of_its_wall() {
    let mesh = dish(0.125, 0.06, 0.005, 48, |_| Material::Matt);
    assert_closed(&mesh, "dish");
    assert_eq!(extents(&mesh).0.z, 0.0);
    assert!((extents(&mesh).1.z - 0.065).abs() < 1e-15);
    // The wall is measured along the axis: its volume is the disc's area (48-gon) times 5 mm.
    let disc = 24.0 * libm::sin(PI / 24.0) * 0.125 * 0.125;
    assert!(close(volume(&mesh), disc * 0.005, 1e-9));
}

#[test]
fn a_bell_is_hollow() {
    let mesh = bell(0.025, 0.08, 0.12, 0.005, 48, Material::Dark);
    assert_closed(&mesh, "bell");
    // Frustums h/3 · (r² + r·R + R²), with the 48-gon's area for π: outside 0.12 m high from 25 to 80 mm, inside
    // 0.115 m from 20 to 75 mm.
    let frustum = |h: f64, r: f64, big: f64| 24.0 * libm::sin(PI / 24.0) * h / 3.0 * (r * r + r * big + big * big);
    assert!(close(volume(&mesh), frustum(0.12, 0.025, 0.08) - frustum(0.115, 0.02, 0.075), 1e-9));
}
