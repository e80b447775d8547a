//! What tests measure of a mesh.

use super::{Mesh, normal};
use nalgebra::{Point3, Vector3};
use std::collections::BTreeMap;

fn triangles(mesh: &Mesh) -> impl Iterator<Item = [Point3<f64>; 3]> + '_ {
    mesh.triangles.iter().map(|triangle| mesh.corners(triangle).unwrap())
}

fn doubled_area([a, b, c]: [Point3<f64>; 3]) -> f64 {
    (b - a).cross(&(c - a)).norm()
}

pub(crate) fn area(mesh: &Mesh) -> f64 {
    triangles(mesh).map(|corners| doubled_area(corners) / 2.0).sum()
}

/// By the divergence theorem: positive where closed and outward.
pub(crate) fn volume(mesh: &Mesh) -> f64 {
    triangles(mesh).map(|[a, b, c]| a.coords.dot(&b.coords.cross(&c.coords)) / 6.0).sum()
}

/// The lowest and the highest coordinates.
pub(crate) fn extents(mesh: &Mesh) -> (Vector3<f64>, Vector3<f64>) {
    let [low, high] = mesh.extents();
    (low.coords, high.coords)
}

/// Every edge is run through once in each direction, every triangle has area, every vertex is used, and
/// corners − edges + triangles = 2: one closed surface without a hole through it, its sides turned one way.
pub(crate) fn assert_closed(mesh: &Mesh, what: &str) {
    let mut edges = BTreeMap::new();
    let mut used = vec![false; mesh.vertices.len()];
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.corners;
        for (from, to) in [(a, b), (b, c), (c, a)] {
            *edges.entry((from, to)).or_insert(0) += 1;
            used[from as usize] = true;
        }
        let corners = mesh.corners(triangle).unwrap();
        assert!(doubled_area(corners) > 1e-9 && (normal(corners).norm() - 1.0).abs() < 1e-12, "{what}: {corners:?}");
    }
    assert!(used.iter().all(|used| *used), "{what}: a corner of no triangle");
    for (&(from, to), &count) in &edges {
        assert_eq!((count, edges.get(&(to, from))), (1, Some(&1)), "{what}: edge {from} to {to}");
    }
    let euler = mesh.vertices.len() as i64 - edges.len() as i64 / 2 + mesh.triangles.len() as i64;
    assert_eq!(euler, 2, "{what}: Euler characteristic");
}
