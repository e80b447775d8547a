use super::*;
use crate::shape::{Material, Triangle};
use proptest::prelude::*;

/// Every triangle in turn.
fn brute(mesh: &Mesh, line: &Line, nearest: f64, farthest: f64) -> Option<(f64, u32)> {
    let mut best: Option<(f64, u32)> = None;
    for facet in Facet::all(mesh) {
        let Some(range) = facet.range(line) else { continue };
        if range > nearest && range <= farthest && best.is_none_or(|(known, _)| range < known) {
            best = Some((range, facet.place));
        }
    }
    best
}

fn coordinate() -> impl Strategy<Value = f64> {
    // A coarse grid makes shared edges, flat boxes and rays along sides common.
    prop_oneof![-2.0..2.0, (-4..=4_i32).prop_map(|k| f64::from(k) * 0.5)]
}

fn point() -> impl Strategy<Value = Point3<f64>> {
    [coordinate(), coordinate(), coordinate()].prop_map(|[x, y, z]| Point3::new(x, y, z))
}

fn mesh() -> impl Strategy<Value = Mesh> {
    let soup = (prop::collection::vec(point(), 3..40), prop::collection::vec([0..44_u32, 0..44, 0..44], 0..200));
    soup.prop_map(|(vertices, corners)| {
        let triangles = corners.into_iter().map(|corners| Triangle { corners, material: Material::Matt }).collect();
        Mesh { vertices, triangles }
    })
}

fn line() -> impl Strategy<Value = Line> {
    let long = |v: &Point3<f64>| v.coords.norm() > 1e-3;
    (point(), point().prop_filter("a direction", long)).prop_map(|(o, d)| Line::new(o, d.coords.normalize()))
}

proptest! {
    #[test]
    fn rays_meet_in_the_tree_what_they_meet_trying_every_triangle(
        mesh in mesh(),
        lines in prop::collection::vec(line(), 1..20),
        nearest in prop_oneof![Just(0.0), 0.0..1.0],
        farthest in prop_oneof![Just(f64::INFINITY), 0.0..3.0],
    ) {
        let bvh = Bvh::new(&mesh);
        for line in &lines {
            let expected = brute(&mesh, line, nearest, farthest);
            let found = bvh.first(line, nearest, farthest).map(|(range, facet)| (range, facet.place));
            prop_assert_eq!(found, expected);
            prop_assert_eq!(bvh.any(line, nearest, farthest), expected.is_some());
        }
    }

    #[test]
    fn meshes_lie_in_their_spheres(mesh in mesh()) {
        let bvh = Bvh::new(&mesh);
        let corners = Facet::all(&mesh).flat_map(|facet| facet.corners());
        prop_assert!(corners.into_iter().all(|corner| (corner - bvh.centre).norm() <= bvh.radius));
    }
}

/// Triangles in a row, each far larger than the one before: the area rule cuts off one at a time.
#[test]
fn a_mesh_that_would_make_a_chain_keeps_its_tree_low() {
    let mut mesh = Mesh::default();
    let mut size = 1e-30;
    for _ in 0..1_000_u32 {
        let first = mesh.vertices.len() as u32;
        let corner = |x: f64, y: f64| Point3::new(size * x, size * y, 0.0);
        mesh.vertices.extend([corner(1.0, 0.0), corner(1.2, 0.0), corner(1.0, 0.2)]);
        mesh.triangles.push(Triangle { corners: [first, first + 1, first + 2], material: Material::Dark });
        size *= 1.1;
    }
    let bvh = Bvh::new(&mesh);
    fn depth(bvh: &Bvh, place: usize) -> usize {
        let node = bvh.nodes[place];
        if node.count > 0 { 1 } else { 1 + depth(bvh, place + 1).max(depth(bvh, node.first as usize)) }
    }
    // 24 levels by area, then halves of at most 1,000: 10 more and the root.
    assert!(depth(&bvh, 0) <= 24 + 10 + 1, "{}", depth(&bvh, 0));
    // The largest triangle, from below: range 1.
    let top = bvh.facets.iter().max_by_key(|facet| facet.place).unwrap();
    let [a, b, c] = top.corners();
    let middle = Point3::from((a.coords + b.coords + c.coords) / 3.0);
    let line = Line::new(middle - Vector3::z(), Vector3::z());
    let (range, facet) = bvh.first(&line, 0.0, f64::INFINITY).unwrap();
    assert!(facet.place == 999 && (range - 1.0).abs() < 1e-12);
}
